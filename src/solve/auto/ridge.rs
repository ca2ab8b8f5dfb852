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
