//! One Gaussian over everything, with every covariance written out: slow, and hard to get wrong.

use mocap_repair::solve::lds::model::Model;
use mocap_repair::solve::lds::smoother::Evidence;
use nalgebra::{DMatrix, DVector};

/// A Gaussian vector.
#[derive(Clone, Debug)]
pub struct Gaussian {
    pub mean: DVector<f64>,
    pub covariance: DMatrix<f64>,
}

impl Gaussian {
    /// The vector `[x, matrix x + noise]`, where the noise is independent, of mean 0 and of covariance `noise`.
    pub fn extend(&self, matrix: &DMatrix<f64>, noise: &DMatrix<f64>) -> Self {
        let (old, new) = (self.mean.len(), matrix.nrows());
        let mut mean = DVector::zeros(old + new);
        mean.rows_mut(0, old).copy_from(&self.mean);
        mean.rows_mut(old, new).copy_from(&(matrix * &self.mean));
        let cross = matrix * &self.covariance;
        let mut covariance = DMatrix::zeros(old + new, old + new);
        covariance.view_mut((0, 0), (old, old)).copy_from(&self.covariance);
        covariance.view_mut((old, 0), (new, old)).copy_from(&cross);
        covariance.view_mut((0, old), (old, new)).copy_from(&cross.transpose());
        covariance.view_mut((old, old), (new, new)).copy_from(&(&cross * matrix.transpose() + noise));
        Self { mean, covariance }
    }

    /// The states of all frames, one below the other.
    pub fn chain(model: &Model, frames: usize) -> Self {
        let hidden = model.hidden();
        let mut states = Self { mean: model.initial_mean.clone(), covariance: model.initial_covariance.clone() };
        for t in 1..frames {
            let mut step = DMatrix::zeros(hidden, t * hidden);
            step.columns_mut((t - 1) * hidden, hidden).copy_from(&model.transition);
            states = states.extend(&step, &model.state_noise);
        }
        states
    }

    /// The states of all frames and below them all coordinates of all markers, frame by frame.
    pub fn system(model: &Model, frames: usize) -> Self {
        let (hidden, width) = (model.hidden(), model.emission.nrows());
        let mut emission = DMatrix::zeros(frames * width, frames * hidden);
        for t in 0..frames {
            emission.view_mut((t * width, t * hidden), (width, hidden)).copy_from(&model.emission);
        }
        let noise = DVector::from_fn(frames * width, |k, _| model.marker_noise[k % width / 3]);
        let mut all = Self::chain(model, frames).extend(&emission, &DMatrix::from_diagonal(&noise));
        for k in 0..frames * width {
            all.mean[frames * hidden + k] += model.offset[k % width];
        }
        all
    }

    /// What is known once the entries `at` turned out to have these `values`, and the log-density of their doing so.
    pub fn given(&self, at: &[usize], values: &[f64]) -> (Self, f64) {
        if at.is_empty() {
            return (self.clone(), 0.0);
        }
        let inner = self.covariance.select_rows(at).select_columns(at).lu();
        let cross = self.covariance.select_columns(at);
        let off = DVector::from_column_slice(values) - self.mean.select_rows(at);
        let inverse = inner.try_inverse().unwrap();
        let gain = &cross * &inverse;
        let posterior = Self { mean: &self.mean + &gain * &off, covariance: &self.covariance - &gain * cross.transpose() };
        let log_determinant: f64 = inner.u().diagonal().iter().map(|d| d.abs().ln()).sum();
        let log_density = -0.5 * (off.dot(&(&inverse * &off)) + log_determinant + at.len() as f64 * std::f64::consts::TAU.ln());
        (posterior, log_density)
    }
}

/// Coordinates of markers in frames, NaN where missing; 3 · markers × T.
pub type Table = DMatrix<f64>;

/// The entries of [`Gaussian::system`] that `table` knows, and their values.
pub fn seen(model: &Model, table: &Table) -> (Vec<usize>, Vec<f64>) {
    let states = model.hidden() * table.ncols();
    table.iter().enumerate().filter(|(_, x)| !x.is_nan()).map(|(k, x)| (states + k, *x)).unzip()
}

/// What the frames of `table` say about their states, by the definition: `Σ (y - d - G z)² / r + ln(2π r)` over the coordinates that are known.
/// Frames in which everything is known share one matrix, as those of a take do.
pub fn evidence(model: &Model, table: &Table) -> Evidence {
    let (hidden, frames) = (model.hidden(), table.ncols());
    let mut said = Evidence {
        matrices: vec![DMatrix::zeros(hidden, hidden)],
        of: vec![0; frames],
        vectors: DMatrix::zeros(hidden, frames),
        constant: 0.0,
    };
    for k in 0..table.nrows() {
        said.matrices[0] += model.emission.row(k).tr_mul(&model.emission.row(k)) / model.marker_noise[k / 3];
    }
    for t in 0..frames {
        let mut matrix = DMatrix::zeros(hidden, hidden);
        for (k, y) in table.column(t).iter().enumerate().filter(|(_, y)| !y.is_nan()) {
            let (row, noise, off) = (model.emission.row(k), model.marker_noise[k / 3], y - model.offset[k]);
            matrix += row.tr_mul(&row) / noise;
            let mut vector = said.vectors.column_mut(t);
            vector += row.transpose() * (off / noise);
            said.constant += off * off / noise + (std::f64::consts::TAU * noise).ln();
        }
        if table.column(t).iter().any(|y| y.is_nan()) {
            said.of[t] = said.matrices.len() as u32;
            said.matrices.push(matrix);
        }
    }
    said
}
