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
