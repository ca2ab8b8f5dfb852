//! The missing samples given everything: their expectations, and what is still open about them.

use super::bones::BoneEvidence;
use super::kalman::Smoothed;
use super::{Lds, em};
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Frames are summed up in blocks of this many, so that sums do not depend on the number of cores.
const BLOCK: usize = 64;

/// What some frames add to the M-step and the estimate.
#[derive(Default)]
struct Block {
    /// Index of a missing sample, its expectation (centred, m), its variance (trace, m²).
    samples: Vec<(usize, [f64; 3], f64)>,
    /// Σ Cov[x, z] of markers that bones speak about, 3 × H.
    cross: BTreeMap<usize, DMatrix<f64>>,
    /// Σ Cov[z] over the frames in which a marker is missing and no bone speaks, H × H.
    covariances: BTreeMap<usize, DMatrix<f64>>,
}

impl Lds<'_> {
    /// Replaces the expectations of the missing samples and sums up what is still open about them.
    /// Returns it with the variance of each sample (trace, m²).
    pub(super) fn expect(&mut self, smoothed: &Smoothed, expected: &DMatrix<f64>, spoken: &[Vec<BoneEvidence>]) -> (em::Open, Vec<f64>) {
        let problem = self.problem;
        let (markers, hidden) = (problem.markers(), self.model.hidden());
        let incomplete: Vec<usize> = (0..problem.frames()).filter(|&t| !problem.missing_in(t).is_empty()).collect();
        let blocks: Vec<Block> = incomplete.par_chunks(BLOCK).map(|frames| self.expect_block(frames, smoothed, expected, spoken)).collect();
        let mut open = em::Open { cross: DMatrix::zeros(3 * markers, hidden), trace: vec![0.0; markers] };
        let mut variances = vec![f64::NAN; problem.missing.len()];
        let mut sums: Vec<DMatrix<f64>> = vec![DMatrix::zeros(hidden, hidden); markers];
        for block in blocks {
            for (k, place, variance) in block.samples {
                let (t, i) = problem.missing[k];
                self.filled.view_mut((3 * i, t), (3, 1)).copy_from_slice(&place);
                variances[k] = variance;
                open.trace[i] += variance;
            }
            for (i, cross) in block.cross {
                let mut rows = open.cross.rows_mut(3 * i, 3);
                rows += cross;
            }
            for (i, sum) in block.covariances {
                sums[i] += sum;
            }
        }
        for (i, sum) in sums.iter().enumerate() {
            open.cross.rows_mut(3 * i, 3).gemm(1.0, &self.model.emission.rows(3 * i, 3), sum, 1.0);
        }
        (open, variances)
    }

    /// The share of some frames in [`Lds::expect`].
    fn expect_block(&self, frames: &[usize], smoothed: &Smoothed, expected: &DMatrix<f64>, spoken: &[Vec<BoneEvidence>]) -> Block {
        let problem = self.problem;
        let mut block = Block::default();
        for &t in frames {
            let range = problem.missing_in(t);
            let covariance = &smoothed.covariances[t];
            let missing = &problem.missing[range.clone()];
            let mut told = vec![false; range.len()];
            for said in &spoken[t] {
                let carried = &said.gain * covariance; // A V̂
                let place = &said.gain * smoothed.means.column(t) + &said.offset;
                for (slot, &i) in said.group.markers.iter().enumerate() {
                    let rows = carried.rows(3 * slot, 3);
                    let variance = rows.dot(&said.gain.rows(3 * slot, 3)) + said.rest[slot];
                    match block.cross.get_mut(&i) {
                        Some(sum) => *sum += rows,
                        None => drop(block.cross.insert(i, rows.into_owned())),
                    }
                    if let Ok(k) = missing.binary_search(&(t, i)) {
                        told[k] = true;
                        let place = std::array::from_fn(|axis| place[3 * slot + axis]);
                        block.samples.push((range.start + k, place, variance));
                    }
                }
            }
            for (k, &(_, i)) in missing.iter().enumerate().filter(|&(k, _)| !told[k]) {
                let emission = self.model.emission.rows(3 * i, 3);
                let variance = (emission * covariance).dot(&emission) + 3.0 * self.model.marker_noise[i];
                let place = std::array::from_fn(|axis| expected[(3 * i + axis, t)]);
                block.samples.push((range.start + k, place, variance));
                match block.covariances.get_mut(&i) {
                    Some(sum) => *sum += covariance,
                    None => drop(block.covariances.insert(i, covariance.clone())),
                }
            }
        }
        block
    }
}
