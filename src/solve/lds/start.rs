//! Where EM starts: principal components of what is whole.

use super::model::Model;
use crate::solve::Problem;
use nalgebra::DMatrix;

/// The start: components of the complete frames if there are enough of them, else of the linearly interpolated table.
pub fn start(problem: &Problem, observed: &DMatrix<f64>, hidden: usize) -> (Model, DMatrix<f64>) {
    let frames = problem.frames();
    let complete = (0..frames).filter(|&t| problem.missing_in(t).is_empty()).count();
    let whole = if complete > 4 * hidden {
        observed.select_columns(&(0..frames).filter(|&t| problem.missing_in(t).is_empty()).collect::<Vec<_>>())
    } else {
        interpolated(problem, observed)
    };
    Model::from_components(&whole, observed, &|t, i| problem.observed(t, i), hidden)
}

/// The table with its holes interpolated linearly and held at the ends; a start, never a result.
fn interpolated(problem: &Problem, observed: &DMatrix<f64>) -> DMatrix<f64> {
    let mut table = observed.clone();
    let mut last: Vec<Option<usize>> = vec![None; problem.markers()];
    for t in 0..problem.frames() {
        for (i, last) in last.iter_mut().enumerate() {
            if !problem.observed(t, i) {
                continue;
            }
            let from = last.map_or(0, |l| l + 1);
            for k in 3 * i..3 * i + 3 {
                for gap in from..t {
                    table[(k, gap)] = last.map_or(observed[(k, t)], |l| {
                        let share = (gap - l) as f64 / (t - l) as f64;
                        observed[(k, l)] * (1.0 - share) + observed[(k, t)] * share
                    });
                }
            }
            *last = Some(t);
        }
    }
    for (i, last) in last.iter().enumerate() {
        if let Some(l) = *last {
            for k in 3 * i..3 * i + 3 {
                for gap in l + 1..problem.frames() {
                    table[(k, gap)] = observed[(k, l)];
                }
            }
        }
    }
    table
}
