//! `linear` and `spline`: each coordinate of each marker alone, through the observed samples on both sides of a gap.
//!
//! Neither extrapolates: before the first and after the last observed sample the nearest one is held.
//! (Whether gaps at the take's ends are filled at all is decided elsewhere.)
//! Neither knows how sure it is, so the standard deviations stay NaN.

use super::{Estimate, Problem, Progress, SolveError, Solver};

/// Which curve goes through the observed samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curve {
    /// A straight line from the last sample before the gap to the first one after it.
    Linear,
    /// The natural cubic spline through all observed samples of the marker.
    Spline,
}

/// Interpolates every gap in one step.
pub struct Interpolate<'a> {
    problem: &'a Problem,
    curve: Curve,
    estimate: Estimate,
}

impl<'a> Interpolate<'a> {
    /// Nothing is computed before the first step.
    pub fn new(problem: &'a Problem, curve: Curve) -> Self {
        Self { problem, curve, estimate: Estimate::open(problem.missing.len()) }
    }
}

impl Solver for Interpolate<'_> {
    fn name(&self) -> &'static str {
        match self.curve {
            Curve::Linear => "linear",
            Curve::Spline => "spline",
        }
    }

    fn step(&mut self) -> Result<Progress, SolveError> {
        let problem = self.problem;
        let mut knots: Vec<(Vec<f64>, [Vec<f64>; 3])> = vec![Default::default(); problem.markers()];
        let mut wanted = vec![false; problem.markers()];
        for &(_, i) in &problem.missing {
            wanted[i] = true;
        }
        for t in 0..problem.frames() {
            for (i, (times, values)) in knots.iter_mut().enumerate() {
                if wanted[i]
                    && let Some(p) = problem.position_mm(t, i)
                {
                    times.push(t as f64);
                    for axis in 0..3 {
                        values[axis].push(p[axis]);
                    }
                }
            }
        }
        let bends: Vec<[Vec<f64>; 3]> = knots
            .iter()
            .map(|(times, values)| {
                std::array::from_fn(|axis| if self.curve == Curve::Spline { bends(times, &values[axis]) } else { vec![0.0; times.len()] })
            })
            .collect();
        for (k, &(t, i)) in problem.missing.iter().enumerate() {
            let (times, values) = &knots[i];
            self.estimate.positions_mm[k] = std::array::from_fn(|axis| spline_at(times, &values[axis], &bends[i][axis], t as f64));
        }
        Ok(Progress { log_likelihood: None, rms_residual_mm: None, largest_move_mm: 0.0, rms_move_mm: 0.0, done: true })
    }

    fn counted(&self) -> bool {
        true
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }
}

/// Second derivatives at the knots of the natural cubic spline: a tridiagonal system, solved by elimination.
pub(super) fn bends(times: &[f64], values: &[f64]) -> Vec<f64> {
    let n = times.len();
    let mut bends = vec![0.0; n];
    if n < 3 {
        return bends;
    }
    let mut shares = vec![0.0; n];
    for k in 1..n - 1 {
        let (before, after) = (times[k] - times[k - 1], times[k + 1] - times[k]);
        let right = 6.0 * ((values[k + 1] - values[k]) / after - (values[k] - values[k - 1]) / before);
        let pivot = 2.0 * (before + after) - before * shares[k - 1];
        shares[k] = after / pivot;
        bends[k] = (right - before * bends[k - 1]) / pivot;
    }
    for k in (1..n - 1).rev() {
        bends[k] -= shares[k] * bends[k + 1];
    }
    bends
}

/// The curve at `time`; held beyond the ends; NaN without knots.
pub(super) fn spline_at(times: &[f64], values: &[f64], bends: &[f64], time: f64) -> f64 {
    let after = times.partition_point(|&k| k < time);
    if times.is_empty() {
        return f64::NAN;
    }
    if after == 0 {
        return values[0];
    }
    if after == times.len() {
        return values[after - 1];
    }
    let (a, b) = (after - 1, after);
    let span = times[b] - times[a];
    let (u, v) = ((times[b] - time) / span, (time - times[a]) / span);
    u * values[a] + v * values[b] + ((u * u * u - u) * bends[a] + (v * v * v - v) * bends[b]) * span * span / 6.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_natural_spline_is_smooth_and_goes_through_its_knots() {
        let times = [0.0, 1.0, 2.0, 5.0, 6.0, 9.0];
        let values = [0.0, 2.0, 1.0, -3.0, 0.5, 0.25];
        let bends = bends(&times, &values);
        let at = |t: f64| spline_at(&times, &values, &bends, t);
        for (t, v) in times.iter().zip(values) {
            assert!((at(*t) - v).abs() < 1e-12);
        }
        let h = 1e-5;
        for &t in &times[1..5] {
            let (left, right) = ((at(t) - at(t - h)) / h, (at(t + h) - at(t)) / h);
            assert!((left - right).abs() < 1e-3, "slope at {t}: {left} {right}");
        }
        assert_eq!((bends[0], bends[5]), (0.0, 0.0));
        assert_eq!((at(-4.0), at(20.0)), (0.0, 0.25), "held, not extrapolated");
    }

    #[test]
    fn a_line_stays_a_line() {
        let times = [0.0, 1.0, 7.0, 8.0];
        let values = [0.0, 2.0, 14.0, 16.0];
        for bends in [bends(&times, &values), vec![0.0; 4]] {
            assert!((spline_at(&times, &values, &bends, 4.0) - 8.0).abs() < 1e-12);
        }
    }
}
