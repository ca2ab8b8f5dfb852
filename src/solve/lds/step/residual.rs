//! What the model leaves of a marker: how big it is, how long it lasts, and what it is at the edges of gaps.

use nalgebra::Vector3;

/// Correlation of a marker's residual (m, one per frame, none where it was not seen) from one frame to the next.
pub fn correlation(residual: &[Option<Vector3<f64>>], rate_hz: f64) -> f64 {
    // a twelfth of a second: long enough to see a decay, short enough to see a correlation
    let lag = (rate_hz / 12.0).round().clamp(1.0, 1000.0) as usize;
    let (mut product, mut square) = (0.0, 0.0);
    for (now, then) in residual.iter().zip(residual.iter().skip(lag)) {
        if let (Some(now), Some(then)) = (now, then) {
            product += now.dot(then);
            square += 0.5 * (now.norm_squared() + then.norm_squared());
        }
    }
    let correlation: f64 = if square > 0.0 { product / square } else { 0.0 };
    correlation.clamp(0.05, 0.999).powf(1.0 / lag as f64)
}

/// How long a residual may be to count as the marker's own, m: [`LONGEST`] times the median one.
/// The samples next to a gap are where a marker was being lost or found again: many of them are ghosts, and a ghost must not be followed.
pub fn longest(residual: &[Option<Vector3<f64>>]) -> f64 {
    let mut sizes: Vec<f64> = residual.iter().flatten().map(Vector3::norm).collect();
    if sizes.is_empty() {
        return f64::MIN_POSITIVE;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    (LONGEST * *median).max(f64::MIN_POSITIVE)
}

/// A residual this many times longer than the marker's median is no property of the marker.
pub const LONGEST: f64 = 3.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ghost_does_not_say_how_long_residuals_are() {
        let residual = [Some([1.0, 0.0, 0.0]), Some([0.0, -2.0, 0.0]), Some([0.0, 0.0, 2.0]), Some([30.0, 40.0, 0.0]), None];
        assert_eq!(longest(&residual.map(|r| r.map(Vector3::from))), 6.0, "three times the median");
    }

    #[test]
    fn the_correlation_of_a_decay_is_found() {
        let turning = |t: usize, pace: f64| Vector3::new((t as f64 * pace).cos(), (t as f64 * pace).sin(), 0.0);
        let residual: Vec<Option<Vector3<f64>>> = (0..400).map(|t| (t % 7 != 3).then(|| turning(t, 0.05))).collect();
        // ten frames apart, two samples of this circle have the correlation cos(0.5)
        let found = correlation(&residual, 120.0);
        assert!((found.powi(10) - 0.5f64.cos()).abs() < 1e-9, "{found}");
        assert!((correlation(&[None, None], 120.0).powi(10) - 0.05).abs() < 1e-12, "nothing known: nothing lasts");
    }
}
