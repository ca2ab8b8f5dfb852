//! What the frames say about their hidden states, given the present parameters.

use super::bones::{self, BoneEvidence};
use super::product::project;
use super::smoother::Evidence;
use super::table::Pattern;
use super::{EStep, Lds};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// What the bones say about the missing markers of each frame.
pub(super) type Spoken = Vec<Option<BoneEvidence>>;

impl Lds<'_> {
    /// The evidence of all frames, and what bones say in each (exact E-step only).
    pub(super) fn evidence(&self) -> (Evidence, Spoken) {
        let (problem, table, model) = (self.problem, &self.table, &self.model);
        let (markers, frames, hidden) = (problem.markers(), problem.frames(), model.hidden());
        let mut weighted = model.emission.clone(); // Σ⁻¹ G
        for (k, mut row) in weighted.row_iter_mut().enumerate() {
            row.scale_mut(1.0 / model.marker_noise[k / 3]);
        }
        let complete = model.emission.tr_mul(&weighted);
        let mut vectors = project(&weighted, &table.values); // Gᵀ Σ⁻¹ x over what was seen
        let leaned: Vec<DVector<f64>> = (0..markers).map(|i| weighted.rows(3 * i, 3).tr_mul(&model.offset.rows(3 * i, 3))).collect(); // Gᵢᵀ dᵢ / rᵢ
        let whole = leaned.iter().fold(DVector::zeros(hidden), |sum, one| sum + one);
        let mut constant: f64 = (0..markers).map(|i| self.constant(i)).sum();

        if self.options.e_step == EStep::Imputing {
            for mut column in vectors.column_iter_mut() {
                column -= &whole;
            }
            for (&(t, i), x) in problem.missing.iter().zip(&self.fill) {
                let own = weighted.rows(3 * i, 3);
                let mut squares = 0.0;
                for (axis, x) in x.iter().enumerate() {
                    vectors.column_mut(t).axpy(*x, &own.row(axis).transpose(), 1.0);
                    squares += (x - model.offset[3 * i + axis]).powi(2);
                }
                constant += squares / model.marker_noise[i] + self.normalisation(i);
            }
            return (Evidence { matrices: vec![complete], of: vec![0; frames], vectors, constant }, Vec::new());
        }

        let each: Vec<DMatrix<f64>> = (0..markers).map(|i| model.emission.rows(3 * i, 3).tr_mul(&weighted.rows(3 * i, 3))).collect();
        let mut matrices: Vec<DMatrix<f64>> = table.patterns.par_iter().map(|pattern| matrix(pattern, &complete, &each)).collect();
        let shifts: Vec<DVector<f64>> =
            table.patterns.iter().map(|p| p.missing.iter().fold(whole.clone(), |sum, &i| sum - &leaned[i])).collect();
        for (mut column, &pattern) in vectors.column_iter_mut().zip(&table.pattern_of) {
            column -= &shifts[pattern as usize];
        }
        let mut of = table.pattern_of.clone();
        let mut spoken: Spoken = Vec::new();
        if self.bones_speak() {
            let speak = |t: usize| {
                let mut said = self.speak(t)?;
                said.matrix += &matrices[of[t] as usize];
                Some(said)
            };
            spoken = (0..frames).into_par_iter().map(speak).collect();
            for (t, said) in spoken.iter_mut().enumerate() {
                let Some(said) = said else { continue };
                let mut vector = vectors.column_mut(t);
                vector += &said.vector;
                constant += said.constant;
                of[t] = matrices.len() as u32;
                matrices.push(std::mem::take(&mut said.matrix)); // together with what was seen, all that the frame says
            }
        }
        (Evidence { matrices, of, vectors, constant }, spoken)
    }

    /// ln |2π r| of a marker's three coordinates.
    fn normalisation(&self, marker: usize) -> f64 {
        3.0 * (std::f64::consts::TAU * self.model.marker_noise[marker]).ln()
    }

    /// Σ over the frames in which a marker was seen of `‖x - d‖² / r + ln |2π r|`.
    fn constant(&self, marker: usize) -> f64 {
        let offset = self.model.offset.rows(3 * marker, 3);
        let seen = self.table.seen[marker] as f64;
        let squares = self.table.squares[marker] - 2.0 * offset.dot(&self.table.sums.rows(3 * marker, 3)) + seen * offset.norm_squared();
        squares / self.model.marker_noise[marker] + seen * self.normalisation(marker)
    }

    /// What the bones of a frame say about it.
    fn speak(&self, t: usize) -> Option<BoneEvidence> {
        let group = &self.table.pattern(t).spoken;
        if group.bones.is_empty() {
            return None;
        }
        let place = self.place(t, &self.anchors);
        let system = bones::linearise(group, &self.bones, &place, &self.centre);
        let anchor: Vec<f64> = group.markers.iter().flat_map(|&i| place[3 * i..3 * i + 3].iter().copied()).collect();
        bones::integrate(group, system, &self.model, self.damping[t], &anchor)
    }
}

/// L of the frames of a pattern.
fn matrix(pattern: &Pattern, complete: &DMatrix<f64>, each: &[DMatrix<f64>]) -> DMatrix<f64> {
    // sum what is there or take away what is not, whichever is shorter and so more exact
    if 2 * pattern.missing.len() > each.len() {
        let mut sum = DMatrix::zeros(complete.nrows(), complete.ncols());
        for (_, own) in each.iter().enumerate().filter(|(i, _)| pattern.missing.binary_search(i).is_err()) {
            sum += own;
        }
        sum
    } else {
        pattern.missing.iter().fold(complete.clone(), |rest, &i| rest - &each[i])
    }
}
