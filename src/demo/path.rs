//! The line on the floor that is walked along: an oval, narrow enough for a laboratory.

use nalgebra::Vector2;
use std::f64::consts::TAU;

/// Once around, in mm.
const AROUND_MM: f64 = 17_000.0;
/// How much stronger than the mean the curve is at the ends of the oval. 0 is a circle.
const OVALNESS: f64 = 0.5;
/// Distance of the stored points, in mm. Small enough that the interpolation is exact to far below a micrometre.
const SPACING_MM: f64 = 10.0;

/// An oval, walked counter-clockwise, whose curvature is a smooth function of the distance.
///
/// A curvature that repeats every half turn closes the curve, so the walk may be as long as it likes.
#[derive(Clone, Debug)]
pub(super) struct Oval {
    points_mm: Vec<Vector2<f64>>,
}

impl Oval {
    /// The oval around the origin.
    pub(super) fn new() -> Self {
        let count = (AROUND_MM / SPACING_MM) as usize;
        let mut points_mm = Vec::with_capacity(count + 1);
        let mut here = Vector2::zeros();
        for i in 0..=count {
            points_mm.push(here);
            // Simpson's rule over one spacing.
            let start = i as f64 * SPACING_MM;
            let [a, b, c] = [0.0, 0.5, 1.0].map(|x| tangent(start + x * SPACING_MM));
            here += (a + b * 4.0 + c) * (SPACING_MM / 6.0);
        }
        let centre = points_mm.iter().take(count).sum::<Vector2<f64>>() / count as f64;
        for point in &mut points_mm {
            *point -= centre;
        }
        Self { points_mm }
    }

    /// The place after `distance_mm`, which may be negative.
    pub(super) fn place_mm(&self, distance_mm: f64) -> Vector2<f64> {
        let steps = distance_mm.rem_euclid(AROUND_MM) / SPACING_MM;
        let i = (steps as usize).min(self.points_mm.len() - 2);
        let x = steps - i as f64;
        // Cubic Hermite: the ends and their tangents are known exactly.
        let (from, to) = (self.points_mm[i], self.points_mm[i + 1]);
        let (leaving, arriving) = (tangent(i as f64 * SPACING_MM), tangent((i + 1) as f64 * SPACING_MM));
        let (xx, xxx) = (x * x, x * x * x);
        from * (2.0 * xxx - 3.0 * xx + 1.0)
            + to * (3.0 * xx - 2.0 * xxx)
            + (leaving * (xxx - 2.0 * xx + x) + arriving * (xxx - xx)) * SPACING_MM
    }

    /// The direction of walking after `distance_mm`, counter-clockwise from +x, in rad. It goes on growing, turn after turn.
    pub(super) fn heading_rad(distance_mm: f64) -> f64 {
        TAU * distance_mm / AROUND_MM + 0.5 * OVALNESS * (2.0 * TAU * distance_mm / AROUND_MM).sin()
    }

    /// The curvature after `distance_mm`, in 1/mm. Positive to the left.
    pub(super) fn curvature_per_mm(distance_mm: f64) -> f64 {
        TAU / AROUND_MM * (1.0 + OVALNESS * (2.0 * TAU * distance_mm / AROUND_MM).cos())
    }
}

fn tangent(distance_mm: f64) -> Vector2<f64> {
    let (sin, cos) = Oval::heading_rad(distance_mm).sin_cos();
    Vector2::new(cos, sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oval_closes_and_is_walked_at_the_pace_it_says() {
        let oval = Oval::new();
        assert!((oval.place_mm(0.0) - oval.place_mm(AROUND_MM - 1e-9)).norm() < 1e-6);
        for i in -50..50 {
            let at = f64::from(i) * 391.7;
            let velocity = (oval.place_mm(at + 0.5) - oval.place_mm(at - 0.5)).norm();
            assert!((velocity - 1.0).abs() < 1e-6, "{velocity} at {at}");
        }
    }

    #[test]
    fn heading_is_the_integral_of_curvature() {
        for i in 0..40 {
            let at = f64::from(i) * 500.0;
            let slope = (Oval::heading_rad(at + 0.1) - Oval::heading_rad(at - 0.1)) / 0.2;
            assert!((slope - Oval::curvature_per_mm(at)).abs() < 1e-9);
        }
    }
}
