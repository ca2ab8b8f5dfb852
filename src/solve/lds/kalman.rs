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
/// `factor` is scratch of the same size.
///
/// Three triangular passes over contiguous columns (`A = L Lᵀ`, `M = L⁻¹`, `A⁻¹ = Mᵀ M`), n³/2 multiplications in all:
/// solving against an identity matrix with the library's factorisation takes 7/6 n³, and this is where the filter spends its time.
fn invert(matrix: &DMatrix<f64>, factor: &mut DMatrix<f64>, inverse: &mut DMatrix<f64>) -> Option<f64> {
    let n = matrix.nrows();
    factor.copy_from(matrix);
    let l = factor.as_mut_slice();
    let mut log_determinant = 0.0;
    for j in 0..n {
        let (done, rest) = l.split_at_mut((j + 1) * n);
        let column = &mut done[j * n..];
        let pivot = column[j];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        log_determinant += pivot.ln();
        let root = pivot.sqrt();
        for x in &mut column[j..] {
            *x /= root;
        }
        for (k, other) in rest.chunks_exact_mut(n).enumerate() {
            let k = j + 1 + k;
            let share = column[k];
            for (x, y) in other[k..].iter_mut().zip(&column[k..]) {
                *x -= share * y;
            }
        }
    }
    inverse.fill(0.0);
    let m = inverse.as_mut_slice();
    for (j, column) in m.chunks_exact_mut(n).enumerate() {
        column[j] = 1.0;
        for k in j..n {
            let x = column[k] / l[k * n + k];
            column[k] = x;
            for (y, z) in column[k + 1..].iter_mut().zip(&l[k * n + k + 1..(k + 1) * n]) {
                *y -= x * z;
            }
        }
    }
    // the product goes over the rows below the diagonal; the factor is no longer needed and takes it
    for j in 0..n {
        for i in 0..=j {
            let value = dot(&m[i * n + j..(i + 1) * n], &m[j * n + j..(j + 1) * n]);
            l[j * n + i] = value;
            l[i * n + j] = value;
        }
    }
    inverse.copy_from(factor);
    log_determinant.is_finite().then_some(log_determinant)
}

/// A dot product in four lanes, so that the compiler may use vector registers; the order of summation is fixed.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (heads, tails) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = heads.remainder().iter().zip(tails.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in heads.zip(tails) {
        for k in 0..4 {
            lanes[k] += x[k] * y[k];
        }
    }
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + rest
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
    let mut factor = DMatrix::zeros(hidden, hidden);
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
        let log_predicted = invert(&predicted, &mut factor, &mut predicted_inverse).ok_or_else(|| broken(t))?;
        let matrix = evidence.matrix(t);
        precision.copy_from(&predicted_inverse);
        precision += matrix;
        let mut covariance = DMatrix::zeros(hidden, hidden);
        let log_precision = invert(&precision, &mut factor, &mut covariance).ok_or_else(|| broken(t))?;
        // μ = μ⁻ + V (b - L μ⁻): the same as Eq. 17, without forming the gain
        pull.copy_from(&evidence.vectors.column(t));
        let towards = pull.dot(&predicted_mean);
        pull.gemv(-1.0, matrix, &predicted_mean, 1.0);
        let against = pull.dot(&predicted_mean); // bᵀμ⁻ - μ⁻ᵀLμ⁻
        let mut mean = means.column_mut(t);
        mean.copy_from(&predicted_mean);
        mean.gemv(1.0, &covariance, &pull, 1.0);
        let gain = (&mean - &predicted_mean).dot(&pull);
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
        invert(&predicted, &mut factor, &mut predicted_inverse).ok_or_else(|| broken(t))?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_is_one_and_knows_its_determinant() {
        for n in [1usize, 2, 5, 16, 19] {
            let a = DMatrix::from_fn(n, n, |r, c| ((r * 7 + c * 3) as f64 * 0.37).sin());
            let a = &a * a.transpose() + DMatrix::identity(n, n);
            let (mut factor, mut inverse) = (a.clone(), a.clone());
            let log_determinant = invert(&a, &mut factor, &mut inverse).unwrap_or(f64::NAN);
            assert!((&a * &inverse - DMatrix::<f64>::identity(n, n)).amax() < 1e-10, "{n}");
            assert!((log_determinant - a.determinant().ln()).abs() < 1e-9, "{n}");
        }
        let mut scratch = DMatrix::zeros(2, 2);
        let indefinite = DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 1.0]);
        assert_eq!(invert(&indefinite, &mut scratch.clone(), &mut scratch), None);
    }
}
