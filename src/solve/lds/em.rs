//! The M-step (Eq. 31-36), with missing entries as what they are: unknown.
//!
//! A missing marker enters with its expectation given everything, `x̂ = A ẑ + k`, and with what is still open about it:
//! `Cov[x, z] = A V̂` and `tr Cov[x] = tr(A V̂ Aᵀ) + rest` (see `bones.rs`; without bones `A = G`, `k = d`, `rest = 3 r`).
//! That makes each round exact EM: without bones the likelihood never falls.

use super::model::{LEAST_MARKER_NOISE, Model};
use super::product::outer;
use super::smoother::Smoothed;
use crate::solve::SolveError;
use nalgebra::{DMatrix, DVector};

/// What is free about the noise of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    /// Σ, Λ and Γ are multiples of the identity: one number each.
    Isotropic,
    /// Σ has one variance per marker; Λ and Γ are full.
    Diagonal,
}

/// Expected sums over all frames of the coordinates `x` (in those of the table, m), missing ones included.
#[derive(Clone, Debug)]
pub struct Moments {
    /// Σ E[x zᵀ], m × H.
    pub cross: DMatrix<f64>,
    /// Σ E[x], m.
    pub sum: DVector<f64>,
    /// Σ E‖x‖², one per marker, m².
    pub squares: Vec<f64>,
}

/// The least variance of a state, which has no unit.
const LEAST_STATE_NOISE: f64 = 1e-9;

/// New parameters from the moments.
/// With G goes the constant term `d` of `x = G z + d`. Eq. 3 has none: the paper centres complete data.
/// With missing data the mean of what was seen is not the centre, and a marker hidden in one phase of a movement would be pulled towards the others. Without `constant` there is none, as printed.
///
/// # Errors
/// The states do not span the hidden space, which takes numbers that are not finite.
pub fn maximise(model: &mut Model, smoothed: &Smoothed, moments: &Moments, noise: Noise, constant: bool) -> Result<(), SolveError> {
    let frames = smoothed.means.ncols();
    let broken = |what: &str| SolveError::Numerical(format!("{what} is not positive definite"));
    let mut states = outer(smoothed.means.as_view(), smoothed.means.as_view()); // Σ E[z zᵀ] over all frames
    states += &smoothed.covariance;
    let second = |t: usize| {
        let mean = smoothed.means.column(t);
        smoothed.covariance_of(t) + mean * mean.transpose()
    };
    // dynamics
    if frames > 1 {
        let past = &states - second(frames - 1);
        let next = &states - second(0);
        let steps = frames - 1;
        let lagged = &smoothed.lagged + outer(smoothed.means.columns(1, steps), smoothed.means.columns(0, steps));
        let factor = ridged(&past, 1e-10).cholesky().ok_or_else(|| broken("the moment matrix of the states"))?;
        let transition = factor.solve(&lagged.transpose()).transpose(); // Eq. 33
        let rest = (next - &transition * lagged.transpose()) / steps as f64; // Eq. 34, with F at its optimum
        model.transition = transition;
        model.state_noise = shaped(&rest, noise);
    }
    model.initial_mean = smoothed.means.column(0).into_owned(); // Eq. 31
    model.initial_covariance = shaped(smoothed.covariance_of(0), noise); // Eq. 32
    // emission: the regression of x on (z, 1), with the column of ones taken out: moments about the means
    let share = if constant { 1.0 / frames as f64 } else { 0.0 }; // without a constant term nothing is taken out
    let state_mean = smoothed.means.column_sum() * share;
    let column_mean = &moments.sum * share;
    let mut cross = moments.cross.clone();
    states.ger(-(frames as f64), &state_mean, &state_mean, 1.0);
    cross.ger(-(frames as f64), &column_mean, &state_mean, 1.0);
    let factor = ridged(&states, 1e-12).cholesky().ok_or_else(|| broken("the moment matrix of the states"))?;
    let emission = factor.solve(&cross.transpose()).transpose(); // Eq. 35
    model.offset = &column_mean - &emission * &state_mean;
    let carried = &emission * &states;
    for (i, own) in model.marker_noise.iter_mut().enumerate() {
        let mut sum = moments.squares[i] - frames as f64 * column_mean.rows(3 * i, 3).norm_squared();
        for k in 3 * i..3 * i + 3 {
            sum += emission.row(k).dot(&carried.row(k)) - 2.0 * emission.row(k).dot(&cross.row(k));
        }
        *own = (sum / (3 * frames) as f64).max(LEAST_MARKER_NOISE); // Eq. 36, its diagonal, shared by the marker's three coordinates
    }
    if noise == Noise::Isotropic {
        let mean = model.marker_noise.iter().sum::<f64>() / model.marker_noise.len().max(1) as f64;
        model.marker_noise.fill(mean);
    }
    model.emission = emission;
    Ok(())
}

/// A covariance made exactly symmetric, of the shape that the noise has, and safe to invert.
fn shaped(covariance: &DMatrix<f64>, noise: Noise) -> DMatrix<f64> {
    let hidden = covariance.nrows();
    let mut out = match noise {
        Noise::Isotropic => DMatrix::identity(hidden, hidden) * (covariance.trace() / hidden as f64).max(0.0),
        Noise::Diagonal => (covariance + covariance.transpose()) * 0.5,
    };
    for k in 0..hidden {
        out[(k, k)] += LEAST_STATE_NOISE;
    }
    out
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
