//! Products over all frames, in blocks of frames: on all cores, with the same sums whatever their number.

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut};
use rayon::prelude::*;

/// Frames of a block: enough for the library's kernels to run at full speed, few enough for short takes to keep several cores busy.
const BLOCK: usize = 256;

/// `a bᵀ` for tables with one column per frame: rows of `a` × rows of `b`.
pub fn outer(a: DMatrixView<'_, f64>, b: DMatrixView<'_, f64>) -> DMatrix<f64> {
    let (rows, columns, frames) = (a.nrows(), b.nrows(), a.ncols());
    let starts: Vec<usize> = (0..frames).step_by(BLOCK).collect();
    let parts: Vec<DMatrix<f64>> = starts
        .par_iter()
        .map(|&from| {
            let count = BLOCK.min(frames - from);
            a.columns(from, count) * b.columns(from, count).transpose()
        })
        .collect();
    parts.iter().fold(DMatrix::zeros(rows, columns), |sum, part| sum + part)
}

/// `aᵀ b` for a matrix `a` and a table `b` with one column per frame: columns of `a` × frames.
pub fn project(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let (rows, frames) = (a.ncols(), b.ncols());
    let turned = a.transpose();
    let mut out = DMatrix::zeros(rows, frames);
    if rows > 0 {
        out.as_mut_slice().par_chunks_mut(rows * BLOCK).enumerate().for_each(|(block, part)| {
            let count = part.len() / rows;
            DMatrixViewMut::from_slice(part, rows, count).gemm(1.0, &turned, &b.columns(block * BLOCK, count), 0.0);
        });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_change_nothing_but_the_last_bits() {
        for frames in [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 7] {
            let a = DMatrix::from_fn(5, frames, |r, c| ((r * 31 + c * 17) as f64 * 0.1).sin());
            let b = DMatrix::from_fn(3, frames, |r, c| ((r * 13 + c * 7) as f64 * 0.2).cos());
            assert!((outer(a.as_view(), b.as_view()) - &a * b.transpose()).amax() < 1e-10, "{frames}");
            let g = DMatrix::from_fn(5, 2, |r, c| (r as f64 - 2.0 * c as f64) * 0.3);
            let off = project(&g, &a) - g.transpose() * &a;
            assert!(off.iter().all(|x| x.abs() < 1e-12), "{frames}");
        }
    }
}
