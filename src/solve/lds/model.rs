//! The parameters of the linear dynamical system, and where EM starts from.
//!
//! Letters as in `docs/algorithm.md`: transition `F` (H × H), emission `G` (m × H), state noise `Λ` (H × H), observation noise `Σ`
//! (diagonal, one variance per marker), initial mean `μ₀` (H) and covariance `Γ` (H × H).
//! m = 3 × markers; lengths are metres in body-local coordinates, centred on each column's mean.

use super::Hidden;
use super::product::{outer, project};
use super::table::Table;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Parameters Θ of Eq. 1-4, and the constant term `d` of `x = G z + d` that Eq. 3 lacks.
#[derive(Clone, Debug)]
pub struct Model {
    /// F, H × H.
    pub transition: DMatrix<f64>,
    /// G, m × H.
    pub emission: DMatrix<f64>,
    /// d, m: what is expected of each coordinate when the state is 0, in the coordinates of the table.
    pub offset: DVector<f64>,
    /// Λ, H × H.
    pub state_noise: DMatrix<f64>,
    /// The diagonal of Σ, one variance per marker, shared by its three coordinates, in m².
    pub marker_noise: Vec<f64>,
    /// μ₀, H.
    pub initial_mean: DVector<f64>,
    /// Γ, H × H.
    pub initial_covariance: DMatrix<f64>,
}

/// No marker is known better than this (0.05 mm)², in m²: keeps Σ invertible where a model explains a still marker perfectly.
pub const LEAST_MARKER_NOISE: f64 = 2.5e-9;

impl Model {
    /// H.
    pub fn hidden(&self) -> usize {
        self.transition.nrows()
    }

    /// Principal components as the start: G from the components of `whole` (m × any number of frames without holes),
    /// hidden states from projecting the *observed* entries of each frame of `table`, F and Λ from regressing each state on the one before.
    /// Returns the model and the states (H × T).
    pub(super) fn from_components(whole: &DMatrix<f64>, table: &Table, hidden: Hidden) -> (Self, DMatrix<f64>) {
        let (m, frames) = table.values.shape();
        let markers = m / 3;
        let mut emission = components(&outer(whole.as_view(), whole.as_view()), hidden);
        let hidden = emission.ncols();
        let identity = DMatrix::<f64>::identity(hidden, hidden);
        let mut states = project(&emission, &table.values);
        let each: Vec<DMatrix<f64>> = (0..markers).map(|i| emission.rows(3 * i, 3).tr_mul(&emission.rows(3 * i, 3))).collect();
        // ridge against frames that show next to nothing
        let complete = each.iter().fold(&identity * 1e-4, |sum, own| sum + own);
        let inverses: Vec<DMatrix<f64>> = table
            .patterns
            .par_iter()
            .map(|pattern| {
                let normal = pattern.missing.iter().fold(complete.clone(), |rest, &i| rest - &each[i]);
                normal.cholesky().map_or_else(|| DMatrix::zeros(hidden, hidden), |c| c.inverse())
            })
            .collect();
        for (mut state, &pattern) in states.column_iter_mut().zip(&table.pattern_of) {
            let found = &inverses[pattern as usize] * &state;
            state.copy_from(&found);
        }
        // unit variance per state: the scale of the hidden space is free, and this one conditions well
        for h in 0..hidden {
            let scale = (states.row(h).norm_squared() / frames as f64).sqrt().max(1e-6);
            states.row_mut(h).scale_mut(1.0 / scale);
            emission.column_mut(h).scale_mut(scale);
        }
        let steps = frames.saturating_sub(1);
        let (transition, state_noise) = if steps == 0 {
            (identity.clone(), identity.clone())
        } else {
            let (past, next) = (states.columns(0, steps), states.columns(1, steps));
            let square = outer(past, past);
            let normal = &square + &identity * (1e-6 * frames as f64);
            let cross = outer(next, past);
            let transition = normal.cholesky().map_or_else(|| identity.clone(), |c| c.solve(&cross.transpose()).transpose());
            let rest = outer(next, next) - &transition * cross.transpose() - &cross * transition.transpose()
                + &transition * square * transition.transpose();
            let noise = (&rest + rest.transpose()) / (2 * steps) as f64 + &identity * 1e-6;
            (transition, noise)
        };
        let marker_noise = noise_of_start(&emission, &states, table);
        let spread = outer(states.as_view(), states.as_view()) / frames.max(1) as f64;
        let model = Self {
            initial_mean: states.column(0).into_owned(),
            initial_covariance: spread + identity * 1e-3,
            transition,
            offset: DVector::zeros(m),
            emission,
            state_noise,
            marker_noise,
        };
        (model, states)
    }
}

/// How far the states miss what was seen: one variance per marker, m².
fn noise_of_start(emission: &DMatrix<f64>, states: &DMatrix<f64>, table: &Table) -> Vec<f64> {
    let frames = table.values.ncols();
    let one = |i: usize| {
        let emission = emission.fixed_rows::<3>(3 * i).into_owned();
        let own = |t: usize| (table.values.fixed_view::<3, 1>(3 * i, t) - &emission * states.column(t)).norm_squared();
        let seen = |t: &usize| table.pattern(*t).missing.binary_search(&i).is_err();
        let sum: f64 = (0..frames).filter(seen).map(own).sum();
        (sum / (3 * table.seen[i]).max(1) as f64).max(1e-7)
    };
    (0..table.seen.len()).into_par_iter().map(one).collect()
}

/// Up to this many coordinates all principal directions are computed at once; with more of them, only those that are wanted.
const ALL_AT_ONCE: usize = 192;

/// The first principal directions of a table, orthonormal, m × H, given its moments `square` (Σ x xᵀ, m × m): as many as `hidden` says.
pub(in crate::solve) fn components(square: &DMatrix<f64>, hidden: Hidden) -> DMatrix<f64> {
    let m = square.nrows();
    let mut wide = match hidden {
        _ if m <= ALL_AT_ONCE => m,
        Hidden::Count(count) => (count + 16).min(m),
        Hidden::Energy(_) => 64.min(m),
    };
    loop {
        let (values, vectors) = leading(square, wide);
        let count = match hidden {
            Hidden::Count(count) => count,
            Hidden::Energy(share) => {
                let goal = share * square.trace();
                let mut sum = 0.0;
                values
                    .iter()
                    .take_while(|v| {
                        let below = sum < goal;
                        sum += v.max(0.0);
                        below
                    })
                    .count()
                    .max(1)
            }
        };
        if count < wide || wide == m {
            return vectors.columns(0, count.min(m)).into_owned();
        }
        wide = (2 * wide).min(m);
    }
}

/// The `count` largest eigenvalues of a symmetric matrix, descending, and their eigenvectors: all of them by the library,
/// or by subspace iteration from a fixed start until the subspace stands still, with a final rotation (Rayleigh and Ritz).
fn leading(square: &DMatrix<f64>, count: usize) -> (Vec<f64>, DMatrix<f64>) {
    let m = square.nrows();
    let sorted = |matrix: DMatrix<f64>| {
        let eigen = matrix.symmetric_eigen();
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]).then(a.cmp(&b)));
        let values: Vec<f64> = order.iter().map(|&k| eigen.eigenvalues[k]).collect();
        (values, eigen.eigenvectors.select_columns(&order))
    };
    if count >= m {
        return sorted(square.clone());
    }
    // a fixed, well spread start: the same on every machine
    let mut basis =
        DMatrix::from_fn(m, count, |r, c| (((r * 7919 + c * 104_729 + 13) % 1009) as f64 / 1009.0 - 0.5) + if r == c { 1.0 } else { 0.0 });
    basis = basis.qr().q();
    let mut energy = 0.0;
    for _ in 0..200 {
        let next = square * &basis;
        let now = next.dot(&basis); // what the subspace holds of the trace
        basis = next.qr().q();
        if (now - energy).abs() <= 1e-12 * now {
            break;
        }
        energy = now;
    }
    let (values, rotation) = sorted(basis.tr_mul(&(square * &basis)));
    (values, basis * rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_leading_directions_are_those_of_all() {
        let data =
            DMatrix::from_fn(40, 90, |r, c| ((r * 7 + c * 3) as f64 * 0.37).sin() + ((r * c) as f64 * 0.11).cos() / (1.0 + r as f64));
        let square = &data * data.transpose();
        let (values, vectors) = leading(&square, 40);
        let (some, directions) = leading(&square, 12);
        for k in 0..4 {
            assert!((values[k] - some[k]).abs() < 1e-8 * values[0], "{k}: {} {}", values[k], some[k]);
            assert!((vectors.column(k).dot(&directions.column(k)).abs() - 1.0).abs() < 1e-6, "{k}");
        }
        let all: f64 = values.iter().sum();
        for share in [0.5, 0.9, 0.99] {
            let count = components(&square, Hidden::Energy(share)).ncols();
            let held: f64 = values[..count].iter().sum();
            let less: f64 = values[..count - 1].iter().sum();
            assert!(held >= share * all && less < share * all, "{share}: {count} directions hold {}", held / all);
        }
    }
}
