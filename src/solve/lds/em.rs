//! The M-step (Eq. 31-36), with missing entries as what they are: unknown.
//!
//! A missing marker enters with its expectation given everything, `x̂ = A ẑ + k`, and with what is still open about it:
//! `Cov[x, z] = A V̂` and `tr Cov[x] = tr(A V̂ Aᵀ) + rest` (see `bones.rs`; without bones `A = G`, `k = 0`, `rest = 3 r`).
//! That makes each round exact EM: without bones the likelihood never falls.

use super::kalman::Smoothed;
use super::model::{LEAST_MARKER_NOISE, Model};
use crate::solve::SolveError;
use nalgebra::{DMatrix, DVector};

/// What is still open about the missing samples of each marker, summed over its missing frames.
#[derive(Clone, Debug)]
pub struct Open {
    /// Σ Cov[x, z], m × H.
    pub cross: DMatrix<f64>,
    /// Σ tr Cov[x], one per marker, m².
    pub trace: Vec<f64>,
}

/// New parameters from the moments, and the constant term `d` of `x = G z + d` that belongs to them (m).
/// The caller takes `d` out of the table, so that the model goes on without one. Eq. 3 has none: the paper centres complete data.
/// With missing data the mean of what was seen is not the centre, and a marker hidden in one phase of a movement would be pulled towards the others.
/// `filled` (m × T) holds the observed entries and the expectations of the missing ones.
///
/// # Errors
/// The states do not span the hidden space, which takes numbers that are not finite.
pub fn maximise(model: &mut Model, smoothed: &Smoothed, filled: &DMatrix<f64>, open: &Open) -> Result<DVector<f64>, SolveError> {
    let (hidden, frames) = smoothed.means.shape();
    let broken = |what: &str| SolveError::Numerical(format!("{what} is not positive definite"));
    let mut moments = DMatrix::zeros(hidden, hidden); // Σ E[z zᵀ] over all frames
    for covariance in &smoothed.covariances {
        moments += covariance;
    }
    moments += &smoothed.means * smoothed.means.transpose();
    let second = |t: usize| {
        let mean = smoothed.means.column(t);
        &smoothed.covariances[t] + mean * mean.transpose()
    };
    // dynamics
    if frames > 1 {
        let past = &moments - second(frames - 1);
        let next = &moments - second(0);
        let steps = frames - 1;
        let lagged = &smoothed.lagged + smoothed.means.columns(1, steps) * smoothed.means.columns(0, steps).transpose();
        let factor = ridged(&past, 1e-10).cholesky().ok_or_else(|| broken("the moment matrix of the states"))?;
        let transition = factor.solve(&lagged.transpose()).transpose(); // Eq. 33
        let mut noise = (next - &transition * lagged.transpose()) / steps as f64; // Eq. 34, with F at its optimum
        noise = (&noise + noise.transpose()) * 0.5;
        for k in 0..hidden {
            noise[(k, k)] += 1e-9;
        }
        model.transition = transition;
        model.state_noise = noise;
    }
    model.initial_mean = smoothed.means.column(0).into_owned(); // Eq. 31
    model.initial_covariance = &smoothed.covariances[0] + DMatrix::identity(hidden, hidden) * 1e-9; // Eq. 32
    // emission
    let mut cross = open.cross.clone(); // Σ E[x zᵀ], m × H
    cross.gemm(1.0, filled, &smoothed.means.transpose(), 1.0);
    // the regression of x on (z, 1), with the column of ones taken out: moments about the means
    let state_mean = smoothed.means.column_sum() / frames as f64;
    let column_mean = filled.column_sum() / frames as f64;
    moments.gemm(-(frames as f64), &state_mean, &state_mean.transpose(), 1.0);
    cross.gemm(-(frames as f64), &column_mean, &state_mean.transpose(), 1.0);
    let factor = ridged(&moments, 1e-12).cholesky().ok_or_else(|| broken("the moment matrix of the states"))?;
    let emission = factor.solve(&cross.transpose()).transpose(); // Eq. 35
    let offset = &column_mean - &emission * &state_mean;
    let carried = &emission * &moments;
    for (i, noise) in model.marker_noise.iter_mut().enumerate() {
        let rows = 3 * i..3 * i + 3;
        let mut sum = open.trace[i] + filled.rows(3 * i, 3).norm_squared() - frames as f64 * column_mean.rows(3 * i, 3).norm_squared();
        for k in rows {
            sum += emission.row(k).dot(&carried.row(k)) - 2.0 * emission.row(k).dot(&cross.row(k));
        }
        *noise = (sum / (3 * frames) as f64).max(LEAST_MARKER_NOISE); // Eq. 36, its diagonal, shared by the marker's three coordinates
    }
    model.emission = emission;
    Ok(offset)
}

/// The matrix with a ridge relative to its mean diagonal.
fn ridged(matrix: &DMatrix<f64>, share: f64) -> DMatrix<f64> {
    let mut out = matrix.clone();
    let ridge = share * matrix.trace() / matrix.nrows().max(1) as f64;
    for k in 0..matrix.nrows() {
        out[(k, k)] += ridge;
    }
    out
}
