//! The missing samples given everything: their expectations, and the moments of the coordinates that the M-step needs.

use super::em::Moments;
use super::evidence::Spoken;
use super::product::outer;
use super::smoother::Smoothed;
use super::{EStep, Lds};
use crate::solve::kernel::dot;
use nalgebra::{DMatrix, Vector3};
use rayon::prelude::*;

/// What is expected of one marker where it is missing.
struct Expected {
    /// One for each of its missing samples: expectation (coordinates of the table, m) and variance (trace, m²).
    samples: Vec<([f64; 3], f64)>,
    /// Σ E[x zᵀ], 3 × H.
    cross: DMatrix<f64>,
    /// Σ E‖x‖², m².
    square: f64,
    /// Σ ‖G ẑ + d‖², m²: what the model alone expects, bones aside.
    plain: f64,
}

/// What the E-step found about the coordinates.
pub(super) struct Found {
    /// For the M-step.
    pub moments: Moments,
    /// Variance of each missing sample (trace, m²).
    pub variances: Vec<f64>,
    /// Root mean square 3-D distance between the observed samples and the model, mm.
    pub rms_residual_mm: f64,
}

impl Lds<'_> {
    /// Replaces the expectations of the missing samples (exact E-step), and sums up the moments of all coordinates.
    pub(super) fn expect(&mut self, smoothed: &Smoothed, spoken: &Spoken) -> Found {
        let (problem, markers) = (self.problem, self.problem.markers());
        let exact = self.options.e_step == EStep::Exact;
        let cross = outer(self.table.values.as_view(), smoothed.means.as_view());
        let all: Vec<Expected> = (0..markers).into_par_iter().map(|i| self.expect_marker(i, smoothed, spoken)).collect();
        let rms_residual_mm = self.residual_mm(smoothed, &cross, all.iter().map(|own| own.plain).sum());
        let mut found = Found {
            moments: Moments { cross, sum: self.table.sums.clone(), squares: self.table.squares.clone() },
            variances: vec![f64::NAN; problem.missing.len()],
            rms_residual_mm,
        };
        for (i, own) in all.into_iter().enumerate() {
            let mut rows = found.moments.cross.rows_mut(3 * i, 3);
            rows += own.cross;
            found.moments.squares[i] += own.square;
            for (&k, (place, variance)) in self.table.missing_of[i].iter().zip(own.samples) {
                let mut sum = found.moments.sum.fixed_rows_mut::<3>(3 * i);
                sum += Vector3::from(place);
                found.variances[k] = variance;
                if exact {
                    self.expected[k] = place;
                }
            }
        }
        found
    }

    /// The share of one marker in [`Lds::expect`].
    fn expect_marker(&self, i: usize, smoothed: &Smoothed, spoken: &Spoken) -> Expected {
        let hidden = self.model.hidden();
        let exact = self.options.e_step == EStep::Exact;
        // vectors over the states are columns here, contiguous
        let emission = self.model.emission.rows(3 * i, 3).transpose();
        let offset: Vector3<f64> = self.model.offset.fixed_rows::<3>(3 * i).into_owned();
        let square = &emission * emission.transpose(); // GᵢᵀGᵢ, so that tr(Gᵢ V̂ Gᵢᵀ) is one dot product
        let mut out = Expected { samples: Vec::new(), cross: DMatrix::zeros(3, hidden), square: 0.0, plain: 0.0 };
        let mut cross = DMatrix::zeros(hidden, 3); // Σ E[z xᵀ]
        let mut covariances = DMatrix::zeros(hidden, hidden); // Σ V̂ where no bone speaks
        let mut carried = DMatrix::zeros(hidden, 3);
        for &k in &self.table.missing_of[i] {
            let t = self.problem.missing[k].0;
            let (mean, covariance) = (smoothed.means.column(t), smoothed.covariance_of(t));
            let plain = Vector3::from_fn(|axis, _| dot(emission.column(axis).as_slice(), mean.as_slice())) + offset;
            out.plain += plain.norm_squared();
            let said = spoken.get(t).and_then(Option::as_ref);
            let said = said.and_then(|said| said.group.markers.binary_search(&i).ok().map(|slot| (said, slot)));
            let (place, variance) = if !exact {
                (Vector3::from(self.fill[k]), 0.0)
            } else if let Some((said, slot)) = said {
                let gain = said.gain.columns(3 * slot, 3); // Aᵀ
                covariance.mul_to(&gain, &mut carried); // V̂ Aᵀ
                let bias = offset + Vector3::from_column_slice(&said.offset[3 * slot..3 * slot + 3]); // bones speak relative to d
                let place = Vector3::from_fn(|axis, _| dot(gain.column(axis).as_slice(), mean.as_slice())) + bias;
                let variance = (0..3).map(|axis| dot(gain.column(axis).as_slice(), carried.column(axis).as_slice())).sum::<f64>();
                cross += &carried;
                (place, variance + said.rest[slot])
            } else {
                covariances += covariance;
                (plain, dot(square.as_slice(), covariance.as_slice()) + 3.0 * self.model.marker_noise[i])
            };
            for (axis, mut column) in cross.column_iter_mut().enumerate() {
                column.axpy(place[axis], &mean, 1.0);
            }
            out.square += place.norm_squared() + variance;
            out.samples.push((place.into(), variance));
        }
        cross.gemm(1.0, &covariances, &emission, 1.0);
        out.cross = cross.transpose();
        out
    }

    /// Root mean square 3-D distance between the observed samples and the model, mm: the sum over all frames, with 0 for what is missing, less what those zeros cost.
    fn residual_mm(&self, smoothed: &Smoothed, cross: &DMatrix<f64>, zeros: f64) -> f64 {
        let (model, table) = (&self.model, &self.table);
        let states = outer(smoothed.means.as_view(), smoothed.means.as_view());
        let sum = smoothed.means.column_sum();
        let squares: f64 = table.squares.iter().sum();
        let explained = (&model.emission * states).dot(&model.emission)
            + 2.0 * model.offset.dot(&(&model.emission * sum))
            + self.problem.frames() as f64 * model.offset.norm_squared();
        let shared = model.emission.dot(cross) + model.offset.dot(&table.sums);
        let count: usize = table.seen.iter().sum();
        ((squares + explained - 2.0 * shared - zeros).max(0.0) / count.max(1) as f64).sqrt() * 1000.0
    }
}
