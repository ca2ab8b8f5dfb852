//! Ridge regressions that are learned from all rows, and again without the rows of each block.

use nalgebra::{DMatrix, DMatrixView};

/// Sums of products of features (and targets below them), over all rows and over the hidden rows of each block.
pub struct Sums {
    /// Features.
    features: usize,
    /// Rows.
    rows: usize,
    /// (features + 3) × (features + 3).
    all: DMatrix<f64>,
    /// The same over hidden rows.
    hidden: Vec<(usize, DMatrix<f64>)>,
}

/// What a ridge regression found: features × 3, from all rows and without each block.
pub struct Fit {
    /// From all rows.
    pub all: DMatrix<f64>,
    /// Without the hidden rows of each block.
    pub without: Vec<DMatrix<f64>>,
}

impl Sums {
    /// `table` is (features + 3) × rows, the targets in its last three rows; `hidden` are ranges of rows.
    pub fn new(table: &DMatrix<f64>, hidden: &[std::ops::Range<usize>]) -> Self {
        let square = |part: DMatrixView<'_, f64>| part * part.transpose();
        let all = square(table.as_view());
        let hidden = hidden.iter().map(|r| (r.len(), square(table.columns(r.start, r.len()).as_view()))).collect();
        Self { features: table.nrows() - 3, rows: table.ncols(), all, hidden }
    }

    /// With the first `features` features; `noise` is the variance of the noise of each of them, `prior` the standard deviation that its coefficient has.
    /// The first feature is the constant and is left free.
    pub fn fit(&self, features: usize, prior: f64, noise: &[f64], thinned: f64) -> Option<Fit> {
        let (rows, at) = (self.rows as f64, self.features);
        let squares = self.all.view((0, 0), (features, features));
        let cross = self.all.view((0, at), (features, 3));
        let trace: f64 = squares.trace();
        let loose = 0.02 * trace / features as f64;
        let rough = solve(squares, None, cross, None, |k| if k == 0 { 1e-6 * rows } else { loose } + 1e-9)?;
        let total: f64 = (0..3).map(|c| self.all[(at + c, at + c)]).sum();
        let left = total - 2.0 * rough.dot(&cross) + rough.dot(&(squares * &rough));
        let variance = (left / (3.0 * rows)).max(1e-4);
        let penalty = |k: usize| if k == 0 { 1e-6 * rows } else { thinned * variance / (prior * prior) + noise[k - 1] * rows };
        let all = solve(squares, None, cross, None, penalty)?;
        let without = self
            .hidden
            .iter()
            .map(|(_, sums)| {
                let (less, less_cross) = (sums.view((0, 0), (features, features)), sums.view((0, at), (features, 3)));
                solve(squares, Some(less), cross, Some(less_cross), penalty)
            })
            .collect::<Option<Vec<_>>>()?;
        Some(Fit { all, without })
    }
}

/// Solves `(squares - less + penalty) x = cross - less_cross`.
fn solve(
    squares: DMatrixView<'_, f64>,
    less: Option<DMatrixView<'_, f64>>,
    cross: DMatrixView<'_, f64>,
    less_cross: Option<DMatrixView<'_, f64>>,
    penalty: impl Fn(usize) -> f64,
) -> Option<DMatrix<f64>> {
    let mut matrix = squares.into_owned();
    if let Some(less) = less {
        matrix -= less;
    }
    for k in 0..matrix.nrows() {
        matrix[(k, k)] += penalty(k);
    }
    let mut right = cross.into_owned();
    if let Some(less) = less_cross {
        right -= less;
    }
    crate::solve::kernel::solve(&mut matrix, &mut right).then_some(right)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Random, Stream};

    /// A ridge regression with this penalty on some rows of the table, from scratch: features × 3.
    fn dense(table: &DMatrix<f64>, used: usize, at: usize, rows: &[usize], penalty: &dyn Fn(usize) -> f64) -> DMatrix<f64> {
        let x = DMatrix::from_fn(rows.len(), used, |r, k| table[(k, rows[r])]);
        let y = DMatrix::from_fn(rows.len(), 3, |r, axis| table[(at + axis, rows[r])]);
        let squares = x.transpose() * &x + DMatrix::from_fn(used, used, |a, b| if a == b { penalty(a) } else { 0.0 });
        squares.lu().solve(&(x.transpose() * y)).expect("the penalty makes it regular")
    }

    #[test]
    fn a_fit_without_a_block_is_one_that_never_saw_it() {
        let mut random = Random::new(3, Stream::Start);
        let (features, rows) = (9, 120);
        let mut table = DMatrix::from_fn(features + 3, rows, |k, _| if k == 0 { 1.0 } else { 20.0 * random.between(-1.0, 1.0) });
        for row in 0..rows {
            for axis in 0..3 {
                let said = 0.7 * table[(1 + axis, row)] - 0.4 * table[(5, row)] + 3.0 * axis as f64;
                table[(features + axis, row)] = said + random.between(-1.0, 1.0);
            }
        }
        let hidden = [0..30, 25..26, 60..60, 90..120];
        let sums = Sums::new(&table, &hidden);
        for (used, prior, thinned) in [(9, 0.3, 1.0), (4, 0.05, 7.0), (1, 1.0, 1.0)] {
            let noise: Vec<f64> = (1..used).map(|k| 2.0 * (k % 3) as f64).collect();
            let fit = sums.fit(used, prior, &noise, thinned).expect("a fit");
            let everything: Vec<usize> = (0..rows).collect();
            // what is left by a rough fit says how noisy the targets are
            let squares = |k: usize| table.row(k).norm_squared();
            let loose = 0.02 * (0..used).map(squares).sum::<f64>() / used as f64;
            let rough = dense(&table, used, features, &everything, &|k| if k == 0 { 1e-6 * rows as f64 } else { loose } + 1e-9);
            let left = table.rows(features, 3) - rough.transpose() * table.rows(0, used);
            let variance = left.norm_squared() / (3 * rows) as f64;
            let penalty = |k: usize| match k {
                0 => 1e-6 * rows as f64,
                k => thinned * variance / (prior * prior) + noise[k - 1] * rows as f64,
            };
            let near = |what: &str, found: &DMatrix<f64>, rows: &[usize]| {
                let expected = dense(&table, used, features, rows, &penalty);
                assert!((found - &expected).amax() < 1e-9 * expected.amax(), "{used} features, {what}: {found} and {expected}");
            };
            near("all rows", &fit.all, &everything);
            assert_eq!(fit.without.len(), hidden.len());
            for (found, hidden) in fit.without.iter().zip(&hidden) {
                let rows: Vec<usize> = everything.iter().copied().filter(|row| !hidden.contains(row)).collect();
                near(&format!("without {hidden:?}"), found, &rows);
            }
        }
    }
}
