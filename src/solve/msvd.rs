//! `msvd`: singular value decomposition with missing values, by EM (Srebro and Jaakkola, 2003): fill, decompose, keep the first `rank` directions, fill with what they say, and again.
//!
//! It knows poses but no time: each frame is a point near a subspace. In body-local coordinates, like all models here; the centre is learned with the subspace.
//! What it lowers is the squared distance between the observed samples and the subspace; the missing ones follow.

use super::body::BodyFrames;
use super::lds::model::components;
use super::lds::product::outer;
use super::lds::start::interpolated;
use super::lds::table::Table;
use super::lds::{Hidden, Start};
use super::{Estimate, Problem, Progress, SolveError, Solver};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// A round that moves no missing sample farther than this is the last, mm.
const STILL_MM: f64 = 0.05;

/// The solver.
pub struct Msvd<'a> {
    problem: &'a Problem,
    hidden: Hidden,
    body: BodyFrames,
    table: Table,
    /// The table with its holes filled; coordinates of the table, m × T.
    filled: DMatrix<f64>,
    estimate: Estimate,
}

impl<'a> Msvd<'a> {
    /// A solver that keeps as many directions as `hidden` says; `start` is the first fill, straight lines unless it is zero.
    pub fn new(problem: &'a Problem, hidden: Hidden, start: Start) -> Self {
        let body = BodyFrames::find(problem);
        let table = Table::new(problem, &body, &[], &vec![Vec::new(); problem.markers()], true);
        let filled = if start == Start::Zero { table.values.clone() } else { interpolated(problem, &table.values) };
        let hidden = match hidden {
            // with every direction kept nothing would ever move
            Hidden::Count(count) => {
                Hidden::Count(count.min((3 * problem.markers()).saturating_sub(1)).min(problem.frames().saturating_sub(1)).max(1))
            }
            energy @ Hidden::Energy(_) => energy,
        };
        let mut msvd = Self { problem, hidden, body, table, filled, estimate: Estimate::open(problem.missing.len()) };
        msvd.publish();
        msvd
    }

    /// Copies the fill into the estimate; returns the largest and the root mean square move, mm.
    fn publish(&mut self) -> (f64, f64) {
        let (mut largest, mut squares) = (0.0f64, 0.0);
        for (k, &(t, i)) in self.problem.missing.iter().enumerate() {
            let local = std::array::from_fn(|axis| (self.filled[(3 * i + axis, t)] + self.table.centre[3 * i + axis]) * 1000.0);
            let world = self.body.to_world(t, local);
            let moved: f64 = world.iter().zip(self.estimate.positions_mm[k]).map(|(a, b)| (a - b).powi(2)).sum();
            if moved.is_finite() {
                largest = largest.max(moved.sqrt());
                squares += moved;
            }
            self.estimate.positions_mm[k] = world;
        }
        (largest, (squares / self.problem.missing.len().max(1) as f64).sqrt())
    }
}

impl Solver for Msvd<'_> {
    fn name(&self) -> &'static str {
        "msvd"
    }

    fn step(&mut self) -> Result<Progress, SolveError> {
        let (problem, frames) = (self.problem, self.problem.frames());
        let mean: DVector<f64> = self.filled.column_sum() / frames.max(1) as f64;
        let mut square = outer(self.filled.as_view(), self.filled.as_view());
        square.ger(-(frames as f64), &mean, &mean, 1.0);
        if !square.iter().all(|x| x.is_finite()) {
            return Err(SolveError::Numerical("the moment matrix of the positions is not finite".into()));
        }
        let basis = components(&square, self.hidden);
        let turned = basis.transpose();
        // what the subspace says about every frame, and how far it is from what was seen
        let incomplete: Vec<usize> = (0..frames).filter(|&t| self.table.pattern_of[t] != 0).collect();
        let said: Vec<DVector<f64>> =
            incomplete.par_iter().map(|&t| &mean + &basis * (&turned * (self.filled.column(t) - &mean))).collect();
        // in complete frames the distance is what the basis does not hold
        let mut off = square.trace() - basis.dot(&(&square * &basis));
        let mut count: usize = self.table.seen.iter().sum();
        for (&t, said) in incomplete.iter().zip(&said) {
            for k in problem.missing_in(t) {
                let i = problem.missing[k].1;
                let mut hole = self.filled.view_mut((3 * i, t), (3, 1));
                off -= (&hole - said.rows(3 * i, 3)).norm_squared();
                hole.copy_from(&said.rows(3 * i, 3));
            }
        }
        count = count.max(1);
        let (largest_move_mm, rms_move_mm) = self.publish();
        Ok(Progress {
            log_likelihood: None,
            rms_residual_mm: Some((off.max(0.0) / count as f64).sqrt() * 1000.0),
            largest_move_mm,
            rms_move_mm,
            done: problem.missing.is_empty() || largest_move_mm < STILL_MM,
        })
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }
}
