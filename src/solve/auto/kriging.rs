//! Simple kriging in time: what a smooth process of known covariance does between samples.

use nalgebra::DMatrix;

/// The covariance of a process over time, variance 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Smoothness {
    /// Matérn 3/2: once differentiable.
    Once,
    /// Matérn 5/2: twice differentiable.
    Twice,
}

/// A process over time: covariance and the share of white noise in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Process {
    /// Its smoothness.
    pub smoothness: Smoothness,
    /// Length scale in frames.
    pub scale: f64,
    /// Variance of the noise, as a share of the variance.
    pub nugget: f64,
}

impl Process {
    /// Covariance over a lag in frames.
    pub fn covariance(&self, lag: f64) -> f64 {
        match self.smoothness {
            Smoothness::Once => {
                let q = 3f64.sqrt() * lag.abs() / self.scale;
                (1.0 + q) * (-q).exp()
            }
            Smoothness::Twice => {
                let q = 5f64.sqrt() * lag.abs() / self.scale;
                (1.0 + q + q * q / 3.0) * (-q).exp()
            }
        }
    }

    /// The weights of the samples at `known` times for the values at `wanted` times: known × wanted.
    pub fn weights(&self, known: &[f64], wanted: &[f64]) -> DMatrix<f64> {
        let n = known.len();
        let own = DMatrix::from_fn(n, n, |a, b| self.covariance(known[a] - known[b]) + if a == b { self.nugget } else { 0.0 });
        let cross = DMatrix::from_fn(n, wanted.len(), |a, b| self.covariance(known[a] - wanted[b]));
        match own.clone().cholesky() {
            Some(factor) => factor.solve(&cross),
            // nearly the same times: the least-norm solution says the same
            None => own.svd(true, true).solve(&cross, 1e-12).unwrap_or_else(|_| DMatrix::zeros(n, wanted.len())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [Smoothness; 2] = [Smoothness::Once, Smoothness::Twice];

    /// Uneven, as the frames on both sides of a gap are.
    const KNOWN: [f64; 9] = [-13.0, -8.0, -3.0, -1.0, 0.0, 21.0, 22.0, 26.0, 40.0];

    #[test]
    fn without_noise_what_is_known_comes_back() {
        for smoothness in BOTH {
            let weights = Process { smoothness, scale: 12.0, nugget: 0.0 }.weights(&KNOWN, &KNOWN);
            assert!((weights - DMatrix::identity(9, 9)).amax() < 1e-8, "{smoothness:?}");
        }
    }

    /// The expectation of some of many normal numbers given the others is in the inverse of their covariance: nothing is solved for `known` alone.
    #[test]
    fn weights_are_those_of_one_big_gaussian() {
        let wanted = [-20.0, -1.0, 5.5, 10.0, 33.0, 90.0];
        let times: Vec<f64> = KNOWN.iter().chain(&wanted).copied().collect();
        for (smoothness, scale, nugget) in BOTH.iter().flat_map(|&s| [(s, 8.0, 0.02), (s, 24.0, 1e-3)]) {
            let process = Process { smoothness, scale, nugget };
            let (n, m) = (KNOWN.len(), wanted.len());
            // a value that is wanted where one is known is the same value without its noise; a trace of noise keeps the matrix regular
            let own = |k: usize| if k < n { nugget } else { 1e-7 };
            let covariance =
                DMatrix::from_fn(n + m, n + m, |a, b| process.covariance(times[a] - times[b]) + if a == b { own(a) } else { 0.0 });
            let inverse = covariance.try_inverse().expect("regular");
            let expected = -inverse.view((n, n), (m, m)).into_owned().lu().solve(&inverse.view((n, 0), (m, n))).expect("regular");
            let off = (process.weights(&KNOWN, &wanted).transpose() - expected).amax();
            assert!(off < 1e-6, "{process:?}: {off}");
        }
    }

    /// A covariance and its derivatives at nothing: 3/s² and 5/(3 s²) are the mean squared velocities of the two processes.
    #[test]
    fn processes_are_as_fast_as_they_should_be() {
        for (smoothness, fast) in [(Smoothness::Once, 3.0), (Smoothness::Twice, 5.0 / 3.0)] {
            let process = Process { smoothness, scale: 10.0, nugget: 0.0 };
            let h = 1e-3;
            let bend = 2.0 * (1.0 - process.covariance(h)) / (h * h);
            assert!((bend - fast / 100.0).abs() < 1e-4 * fast, "{smoothness:?}: {bend}");
            assert_eq!(process.covariance(-4.0), process.covariance(4.0));
        }
    }

    #[test]
    fn the_same_time_twice_counts_as_once() {
        for smoothness in BOTH {
            let process = Process { smoothness, scale: 12.0, nugget: 0.0 };
            let wanted = [-4.0, 6.0, 11.0];
            let twice = process.weights(&[0.0, 0.0, 9.0], &wanted);
            let once = process.weights(&[0.0, 9.0], &wanted);
            for k in 0..3 {
                assert!((twice[(0, k)] + twice[(1, k)] - once[(0, k)]).abs() < 1e-9, "{smoothness:?}: {twice}{once}");
                assert!((twice[(2, k)] - once[(1, k)]).abs() < 1e-9, "{smoothness:?}: {twice}{once}");
            }
        }
    }
}
