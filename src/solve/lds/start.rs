//! Where EM starts.

use super::model::Model;
use super::table::Table;
use super::{Hidden, Init, Options, Start};
use crate::random::{Random, Stream};
use crate::solve::Problem;
use nalgebra::{DMatrix, DVector, Vector3};

/// The first parameters, and the first fill in the coordinates of the table, m.
///
/// Principal components are those of the complete frames if there are enough of them, else of the table filled for a start.
pub fn start(problem: &Problem, table: &Table, options: &Options) -> (Model, Vec<[f64; 3]>) {
    let frames = problem.frames();
    let complete: Vec<usize> = (0..frames).filter(|&t| table.pattern_of[t] == 0).collect();
    let enough = match options.hidden {
        Hidden::Count(count) => 4 * count,
        Hidden::Energy(_) => 64,
    };
    let zero = options.start == Start::Zero;
    let lines = (!zero).then(|| interpolated(problem, &table.values)); // the mean of what was seen is the table's 0
    let filled = lines.as_ref().unwrap_or(&table.values);
    let whole = if complete.len() > enough { table.values.select_columns(&complete) } else { filled.clone() };
    let (model, states) = match (options.init, options.hidden) {
        (Init::Random(seed), Hidden::Count(hidden)) => (random(3 * problem.markers(), hidden, seed), None),
        (Init::Random(seed), energy @ Hidden::Energy(_)) => {
            let (model, _) = Model::from_components(&whole, table, energy);
            (random(3 * problem.markers(), model.hidden(), seed), None)
        }
        (Init::Components, hidden) => {
            let (model, states) = Model::from_components(&whole, table, hidden);
            (model, Some(states))
        }
    };
    let place = |&(t, i): &(usize, usize)| -> [f64; 3] {
        match &states {
            Some(states) if options.start == Start::Model => {
                let place: Vector3<f64> = model.emission.fixed_rows::<3>(3 * i) * states.column(t);
                place.into()
            }
            _ => std::array::from_fn(|axis| filled[(3 * i + axis, t)]),
        }
    };
    let fill = problem.missing.iter().map(place).collect();
    (model, fill)
}

/// Random parameters, as in the authors' program: F and G are the identity plus normal numbers, μ₀ is normal, and all covariances are 1.
fn random(m: usize, hidden: usize, seed: u64) -> Model {
    let mut random = Random::new(seed, Stream::Start);
    let mut normals = |rows: usize, columns: usize| DMatrix::from_fn(rows, columns, |_, _| random.normal());
    let identity = DMatrix::identity(hidden, hidden);
    Model {
        transition: normals(hidden, hidden) + &identity,
        emission: normals(m, hidden) + DMatrix::identity(m, hidden),
        initial_mean: DVector::from_column_slice(normals(hidden, 1).as_slice()),
        offset: DVector::zeros(m),
        state_noise: identity.clone(),
        initial_covariance: identity,
        marker_noise: vec![1.0; m / 3],
    }
}

/// The table with its holes interpolated linearly and held at the ends; a start, never a result.
pub(in crate::solve) fn interpolated(problem: &Problem, observed: &DMatrix<f64>) -> DMatrix<f64> {
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
