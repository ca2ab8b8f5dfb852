//! Joins the filled samples to the observed ones at both edges of a gap.
//!
//! The model explains a marker up to a residual, which the noise of Eq. 3 takes for independent from frame to frame.
//! It is not: where the model is 10 mm off in one frame, it is so in the next, and a fill that jumps by those 10 mm at its edges looks broken.
//! So the residual of each marker is followed into the gap as what it is, close to a first-order autoregressive process:
//! with correlation time τ, its expectation given the residuals `a` and `b` at the two edges, n frames apart, is
//! `a sinh((n - k)/τ)/sinh(n/τ) + b sinh(k/τ)/sinh(n/τ)` after k frames: a bridge that decays in long gaps and is a straight line in short ones.
//! τ is measured for each marker, where it was seen.

use super::{EStep, Lds};
use crate::solve::Problem;
use nalgebra::DMatrix;

/// The frames that enclose each missing sample: the last one before and the first one after in which its marker was seen.
pub fn edges(problem: &Problem) -> Vec<(Option<usize>, Option<usize>)> {
    let mut found = vec![(None, None); problem.missing.len()];
    let mut seen: Vec<Option<usize>> = vec![None; problem.markers()];
    for t in 0..problem.frames() {
        let range = problem.missing_in(t);
        for k in range.clone() {
            found[k].0 = seen[problem.missing[k].1];
        }
        mark(problem, t, &mut seen);
    }
    seen.fill(None);
    for t in (0..problem.frames()).rev() {
        for k in problem.missing_in(t) {
            found[k].1 = seen[problem.missing[k].1];
        }
        mark(problem, t, &mut seen);
    }
    found
}

fn mark(problem: &Problem, t: usize, seen: &mut [Option<usize>]) {
    for (i, seen) in seen.iter_mut().enumerate() {
        if problem.observed(t, i) {
            *seen = Some(t);
        }
    }
}

/// Correlation time of each marker's residual, in frames. `residual` is m × T, 0 where missing.
pub fn correlation_frames(problem: &Problem, residual: &DMatrix<f64>) -> Vec<f64> {
    // a twelfth of a second: long enough to see a decay, short enough to see a correlation
    let lag = (problem.rate_hz / 12.0).round().clamp(1.0, 1000.0) as usize;
    (0..problem.markers())
        .map(|i| {
            let (mut product, mut square) = (0.0, 0.0);
            for t in 0..problem.frames().saturating_sub(lag) {
                if problem.observed(t, i) && problem.observed(t + lag, i) {
                    let (now, then) = (residual.view((3 * i, t), (3, 1)), residual.view((3 * i, t + lag), (3, 1)));
                    product += now.dot(&then);
                    square += 0.5 * (now.norm_squared() + then.norm_squared());
                }
            }
            let correlation = if square > 0.0 { product / square } else { 0.0 };
            -(lag as f64) / correlation.clamp(0.05, 0.999).ln()
        })
        .collect()
}

/// Shortens residuals that are longer than [`LONGEST`] times the marker's median one.
/// The samples next to a gap are where a marker was being lost or found again: many of them are ghosts, and a ghost must not be followed.
pub fn clip(problem: &Problem, residual: &mut DMatrix<f64>) {
    for i in 0..problem.markers() {
        let seen = |t: &usize| problem.observed(*t, i);
        let mut sizes: Vec<f64> = (0..problem.frames()).filter(seen).map(|t| residual.view((3 * i, t), (3, 1)).norm()).collect();
        if sizes.is_empty() {
            continue;
        }
        let middle = sizes.len() / 2;
        let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        let longest = LONGEST * *median;
        for t in (0..problem.frames()).filter(seen) {
            let mut sample = residual.view_mut((3 * i, t), (3, 1));
            let size = sample.norm();
            if size > longest {
                sample *= longest / size;
            }
        }
    }
}

/// A residual this many times longer than the marker's median is no property of the marker.
const LONGEST: f64 = 3.0;

/// The shares of the residuals at both edges in what is expected `k` frames after the first edge, `n` frames lying between the edges.
pub fn bridge(k: f64, n: f64, correlation: f64) -> (f64, f64) {
    // sinh(x) / sinh(n), written with falling exponentials: nothing overflows
    let share = |x: f64| {
        let (x, n) = (x / correlation, n / correlation);
        (x - n).exp() * (-2.0 * x).exp_m1() / (-2.0 * n).exp_m1()
    };
    (share(n - k), share(k))
}

impl Lds<'_> {
    /// What is added to each missing sample so that it joins what was observed, m.
    /// The plain model (DynaMMo) and the paper's E-step stay as they are printed.
    pub(super) fn corrections(&self, expected: &DMatrix<f64>) -> Vec<[f64; 3]> {
        let problem = self.problem;
        if self.bones.is_empty() || self.options.e_step == EStep::Imputing {
            return vec![[0.0; 3]; problem.missing.len()];
        }
        let mut residual = &self.observed - expected;
        for &(t, i) in &problem.missing {
            residual.view_mut((3 * i, t), (3, 1)).fill(0.0);
        }
        let correlations = correlation_frames(problem, &residual);
        clip(problem, &mut residual);
        problem
            .missing
            .iter()
            .zip(&self.edges)
            .map(|(&(t, i), edges)| {
                let at = |frame: usize, axis: usize| residual[(3 * i + axis, frame)];
                std::array::from_fn(|axis| match *edges {
                    (Some(a), Some(b)) => {
                        let (share_a, share_b) = bridge((t - a) as f64, (b - a) as f64, correlations[i]);
                        share_a * at(a, axis) + share_b * at(b, axis)
                    }
                    (Some(a), None) => at(a, axis) * (-((t - a) as f64) / correlations[i]).exp(),
                    (None, Some(b)) => at(b, axis) * (-((b - t) as f64) / correlations[i]).exp(),
                    (None, None) => 0.0,
                })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bridge_starts_and_ends_at_its_edges() {
        for correlation in [0.5, 7.0, 1e6] {
            let near = |a: (f64, f64), b: (f64, f64)| assert!((a.0 - b.0).abs() < 1e-6 && (a.1 - b.1).abs() < 1e-6, "{a:?} {b:?}");
            near(bridge(0.0, 400.0, correlation), (1.0, 0.0));
            near(bridge(400.0, 400.0, correlation), (0.0, 1.0));
        }
        let (a, b) = bridge(25.0, 100.0, 1e6);
        assert!((a - 0.75).abs() < 1e-4 && (b - 0.25).abs() < 1e-4, "long correlation: a straight line");
        assert!(bridge(50.0, 100.0, 5.0).0 < 1e-4, "short correlation: nothing is left in the middle");
    }

    #[test]
    fn a_bridge_is_the_expectation_of_an_autoregressive_process() {
        // the dense Gaussian: covariances exp(-|s - t| / τ)
        let (n, tau) = (9.0f64, 4.0f64);
        let kernel = |d: f64| (-d.abs() / tau).exp();
        for k in 1..9 {
            let k = f64::from(k);
            let (c, a, b) = (kernel(n), kernel(k), kernel(n - k));
            let expected = ((a - c * b) / (1.0 - c * c), (b - c * a) / (1.0 - c * c));
            let found = bridge(k, n, tau);
            assert!((found.0 - expected.0).abs() < 1e-12 && (found.1 - expected.1).abs() < 1e-12);
        }
    }

    #[test]
    fn a_ghost_is_shortened_and_nothing_else() {
        use formats::{Marker, Origin, TakeBuilder};
        let mut take = TakeBuilder::new(vec![Marker::new("A")], 5, 100.0);
        for t in 0..4 {
            take.set(t, 0, [0.0; 3], Origin::Measured);
        }
        let problem = Problem::new(&take.build(), &[true], &[]);
        let mut residual =
            DMatrix::from_column_slice(3, 5, &[1.0, 0.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0, 2.0, 30.0, 40.0, 0.0, 0.0, 0.0, 0.0]);
        clip(&problem, &mut residual);
        assert_eq!(residual.column(3).norm(), 6.0, "three times the median");
        assert_eq!((residual.column(0).norm(), residual.column(1).norm()), (1.0, 2.0));
    }
}
