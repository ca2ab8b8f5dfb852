//! Small dense loops that the solver spends its time in: on contiguous columns of a few dozen numbers, where the library's general routines spend more on looking than on computing.
//!
//! They are compiled for the vector instructions that the machine turns out to have (`pulp` picks at run time); the order of all sums is fixed and nothing is fused,
//! so the results are the same bits on all machines.

use nalgebra::DMatrix;

/// `out = matrix x`.
#[inline(always)]
pub fn product(matrix: &DMatrix<f64>, x: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for (column, x) in matrix.as_slice().chunks_exact(out.len()).zip(x) {
        for (o, m) in out.iter_mut().zip(column) {
            *o += m * x;
        }
    }
}

/// `out -= matrix x`.
#[inline(always)]
pub fn subtract_product(matrix: &DMatrix<f64>, x: &[f64], out: &mut [f64]) {
    for (column, x) in matrix.as_slice().chunks_exact(out.len()).zip(x) {
        for (o, m) in out.iter_mut().zip(column) {
            *o -= m * x;
        }
    }
}

/// Inverts a symmetric positive definite matrix into `inverse` and returns the logarithm of its determinant.
/// `factor` is scratch of the same size.
///
/// Three triangular passes over contiguous columns (`A = L Lᵀ`, `M = L⁻¹`, `A⁻¹ = Mᵀ M`), n³/2 multiplications in all:
/// solving against an identity matrix with the library's factorisation takes 7/6 n³, and this is where the filter spends its time.
pub fn invert(matrix: &DMatrix<f64>, factor: &mut DMatrix<f64>, inverse: &mut DMatrix<f64>) -> Option<f64> {
    pulp::Arch::new().dispatch(|| invert_inline(matrix, factor, inverse))
}

#[inline(always)]
fn invert_inline(matrix: &DMatrix<f64>, factor: &mut DMatrix<f64>, inverse: &mut DMatrix<f64>) -> Option<f64> {
    let n = matrix.nrows();
    factor.copy_from(matrix);
    let l = factor.as_mut_slice();
    let mut log_determinant = 0.0;
    for j in 0..n {
        let (done, rest) = l.split_at_mut((j + 1) * n);
        let column = &mut done[j * n..];
        let pivot = column[j];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        log_determinant += pivot.ln();
        let root = pivot.sqrt();
        for x in &mut column[j..] {
            *x /= root;
        }
        for (k, other) in rest.chunks_exact_mut(n).enumerate() {
            let k = j + 1 + k;
            let share = column[k];
            for (x, y) in other[k..].iter_mut().zip(&column[k..]) {
                *x -= share * y;
            }
        }
    }
    inverse.fill(0.0);
    let m = inverse.as_mut_slice();
    for (j, column) in m.chunks_exact_mut(n).enumerate() {
        column[j] = 1.0;
        for k in j..n {
            let x = column[k] / l[k * n + k];
            column[k] = x;
            for (y, z) in column[k + 1..].iter_mut().zip(&l[k * n + k + 1..(k + 1) * n]) {
                *y -= x * z;
            }
        }
    }
    // the product goes over the rows below the diagonal; the factor is no longer needed and takes it
    for j in 0..n {
        for i in 0..=j {
            let value = dot(&m[i * n + j..(i + 1) * n], &m[j * n + j..(j + 1) * n]);
            l[j * n + i] = value;
            l[i * n + j] = value;
        }
    }
    inverse.copy_from(factor);
    log_determinant.is_finite().then_some(log_determinant)
}

/// Solves `matrix x = right` in place for a symmetric positive definite matrix, of which only the lower triangle counts; `matrix` becomes its factor.
/// False if the matrix is not positive definite.
pub fn solve(matrix: &mut DMatrix<f64>, right: &mut DMatrix<f64>) -> bool {
    pulp::Arch::new().dispatch(|| solve_inline(matrix, right))
}

#[inline(always)]
fn solve_inline(matrix: &mut DMatrix<f64>, right: &mut DMatrix<f64>) -> bool {
    let n = matrix.nrows();
    let l = matrix.as_mut_slice();
    for j in 0..n {
        let (done, rest) = l.split_at_mut((j + 1) * n);
        let column = &mut done[j * n..];
        let pivot = column[j];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        let root = pivot.sqrt();
        for x in &mut column[j..] {
            *x /= root;
        }
        for (k, other) in rest.chunks_exact_mut(n).enumerate() {
            let k = j + 1 + k;
            axpy(&mut other[k..], -column[k], &column[k..]);
        }
    }
    for x in right.as_mut_slice().chunks_exact_mut(n) {
        for j in 0..n {
            let column = &l[j * n..(j + 1) * n];
            x[j] /= column[j];
            let value = x[j];
            axpy(&mut x[j + 1..], -value, &column[j + 1..]);
        }
        for j in (0..n).rev() {
            let column = &l[j * n..(j + 1) * n];
            x[j] = (x[j] - dot(&column[j + 1..], &x[j + 1..])) / column[j];
        }
    }
    true
}

/// A dot product in four lanes, so that the compiler may use vector registers; the order of summation is fixed.
#[inline(always)]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (heads, tails) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = heads.remainder().iter().zip(tails.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in heads.zip(tails) {
        for k in 0..4 {
            lanes[k] += x[k] * y[k];
        }
    }
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + rest
}

/// `out += share x`.
#[inline(always)]
pub fn axpy(out: &mut [f64], share: f64, x: &[f64]) {
    for (o, x) in out.iter_mut().zip(x) {
        *o += share * x;
    }
}

/// `matrix += share x xᵀ`.
#[inline(always)]
pub fn add_square(matrix: &mut DMatrix<f64>, x: &[f64], share: f64) {
    for (column, &own) in matrix.as_mut_slice().chunks_exact_mut(x.len().max(1)).zip(x) {
        axpy(column, share * own, x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_is_one_and_knows_its_determinant() {
        for n in [1usize, 2, 5, 16, 19] {
            let a = DMatrix::from_fn(n, n, |r, c| ((r * 7 + c * 3) as f64 * 0.37).sin());
            let a = &a * a.transpose() + DMatrix::identity(n, n);
            let (mut factor, mut inverse) = (a.clone(), a.clone());
            let log_determinant = invert(&a, &mut factor, &mut inverse).unwrap_or(f64::NAN);
            assert!((&a * &inverse - DMatrix::<f64>::identity(n, n)).amax() < 1e-10, "{n}");
            assert!((log_determinant - a.determinant().ln()).abs() < 1e-9, "{n}");
        }
        let mut scratch = DMatrix::zeros(2, 2);
        let indefinite = DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 1.0]);
        assert_eq!(invert(&indefinite, &mut scratch.clone(), &mut scratch), None);
    }
}
