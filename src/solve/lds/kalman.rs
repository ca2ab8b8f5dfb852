//! The exact forward-backward pass (Eq. 14-30), in canonical form.
//!
//! What a frame says about its hidden state arrives as [`Evidence`]: the matrix `L`, the vector `b` and the constant `c` of
//! `log p(evidence | z) = -½ (zᵀ L z - 2 bᵀ z + c)`.
//! Observed markers, missing markers and bones all take this form, so the pass knows nothing of them: Eq. 16-18 become
//! `V = (P⁻¹ + L)⁻¹`, `μ = V (P⁻¹ μ⁻ + b)`, and a frame without evidence (a black-out) is `L = 0`.

use super::model::Model;
use crate::solve::SolveError;
use nalgebra::{DMatrix, DVector};

/// What the frames say about their hidden states.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// L of a frame in which everything was seen, H × H.
    pub complete: DMatrix<f64>,
    /// L of each other frame, H × H.
    pub partial: Vec<Option<DMatrix<f64>>>,
    /// b of each frame as a column, H × T.
    pub vectors: DMatrix<f64>,
    /// c of each frame, T.
    pub constants: Vec<f64>,
}

impl Evidence {
    /// L of a frame.
    fn matrix(&self, frame: usize) -> &DMatrix<f64> {
        self.partial[frame].as_ref().unwrap_or(&self.complete)
    }
}

/// Moments of the hidden states given everything.
#[derive(Clone, Debug)]
pub struct Smoothed {
    /// E[zₜ] as columns, H × T (Eq. 28).
    pub means: DMatrix<f64>,
    /// Cov[zₜ], T matrices H × H (Eq. 27).
    pub covariances: Vec<DMatrix<f64>>,
    /// Σₜ Cov[zₜ, zₜ₋₁] over t = 2 .. T, H × H (Eq. 29 without its mean part).
    pub lagged: DMatrix<f64>,
    /// log p(evidence) in nats.
    pub log_likelihood: f64,
}

/// Inverts a symmetric positive definite matrix into `inverse` and returns the logarithm of its determinant.
fn invert(matrix: &DMatrix<f64>, inverse: &mut DMatrix<f64>) -> Option<f64> {
    let factor = matrix.clone_owned().cholesky()?;
    let log_determinant = 2.0 * (0..matrix.nrows()).map(|k| factor.l_dirty()[(k, k)].ln()).sum::<f64>();
    inverse.fill_with_identity();
    factor.solve_mut(inverse);
    log_determinant.is_finite().then_some(log_determinant)
}

/// Makes a matrix that is symmetric up to rounding exactly so.
fn symmetrise(matrix: &mut DMatrix<f64>) {
    for c in 0..matrix.ncols() {
        for r in 0..c {
            let mean = 0.5 * (matrix[(r, c)] + matrix[(c, r)]);
            matrix[(r, c)] = mean;
            matrix[(c, r)] = mean;
        }
    }
}

/// Runs the filter forward and the smoother backward.
///
/// # Errors
/// A predicted or filtered covariance is not positive definite.
pub fn smooth(model: &Model, evidence: &Evidence) -> Result<Smoothed, SolveError> {
    let (hidden, frames) = evidence.vectors.shape();
    let broken = |frame: usize| SolveError::Numerical(format!("the covariance of frame {frame} is not positive definite"));
    let transposed = model.transition.transpose();
    let mut means = DMatrix::zeros(hidden, frames); // filtered, then smoothed
    let mut covariances: Vec<DMatrix<f64>> = Vec::with_capacity(frames); // the same
    let mut predicted = DMatrix::zeros(hidden, hidden); // P
    let mut predicted_inverse = DMatrix::zeros(hidden, hidden);
    let mut forward = DMatrix::zeros(hidden, hidden); // V Fᵀ
    let mut precision = DMatrix::zeros(hidden, hidden);
    let mut predicted_mean = DVector::zeros(hidden);
    let mut pull = DVector::zeros(hidden);
    let mut log_likelihood = 0.0;
    for t in 0..frames {
        if t == 0 {
            predicted.copy_from(&model.initial_covariance);
            predicted_mean.copy_from(&model.initial_mean);
        } else {
            forward.gemm(1.0, &covariances[t - 1], &transposed, 0.0);
            predicted.copy_from(&model.state_noise);
            predicted.gemm(1.0, &model.transition, &forward, 1.0); // Eq. 15
            predicted_mean.gemv(1.0, &model.transition, &means.column(t - 1), 0.0);
        }
        let log_predicted = invert(&predicted, &mut predicted_inverse).ok_or_else(|| broken(t))?;
        let matrix = evidence.matrix(t);
        precision.copy_from(&predicted_inverse);
        precision += matrix;
        let mut covariance = DMatrix::zeros(hidden, hidden);
        let log_precision = invert(&precision, &mut covariance).ok_or_else(|| broken(t))?;
        symmetrise(&mut covariance);
        // μ = μ⁻ + V (b - L μ⁻): the same as Eq. 17, without forming the gain
        pull.copy_from(&evidence.vectors.column(t));
        let towards = pull.dot(&predicted_mean);
        pull.gemv(-1.0, matrix, &predicted_mean, 1.0);
        let against = pull.dot(&predicted_mean); // bᵀμ⁻ - μ⁻ᵀLμ⁻
        let mut mean = means.column_mut(t);
        mean.copy_from(&predicted_mean);
        mean.gemv(1.0, &covariance, &pull, 1.0);
        let gain = (&covariance * &pull).dot(&pull);
        log_likelihood -= 0.5 * (evidence.constants[t] - towards - against - gain + log_predicted + log_precision);
        covariances.push(covariance);
    }
    let mut lagged = DMatrix::zeros(hidden, hidden);
    let mut back = DMatrix::zeros(hidden, hidden); // J
    let mut work = DMatrix::zeros(hidden, hidden);
    for t in (0..frames.saturating_sub(1)).rev() {
        forward.gemm(1.0, &covariances[t], &transposed, 0.0);
        predicted.copy_from(&model.state_noise);
        predicted.gemm(1.0, &model.transition, &forward, 1.0);
        invert(&predicted, &mut predicted_inverse).ok_or_else(|| broken(t))?;
        back.gemm(1.0, &forward, &predicted_inverse, 0.0); // Eq. 25
        let back_transposed = back.transpose();
        lagged.gemm(1.0, &covariances[t + 1], &back_transposed, 1.0); // Eq. 29
        // Eq. 26
        pull.copy_from(&means.column(t + 1));
        pull.gemv(-1.0, &model.transition, &means.column(t), 1.0);
        means.column_mut(t).gemv(1.0, &back, &pull, 1.0);
        // Eq. 27
        predicted.neg_mut();
        predicted += &covariances[t + 1];
        work.gemm(1.0, &back, &predicted, 0.0);
        covariances[t].gemm(1.0, &work, &back_transposed, 1.0);
        symmetrise(&mut covariances[t]);
    }
    if !log_likelihood.is_finite() {
        return Err(SolveError::Numerical("the log-likelihood is not finite".into()));
    }
    Ok(Smoothed { means, covariances, lagged, log_likelihood })
}
