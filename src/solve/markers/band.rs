//! A symmetric band of frames: every frame is coupled to itself, and its degrees of freedom each to their own in the two frames that follow.

/// The matrix column by column, each with the entries from the diagonal down to two frames below it (Cholesky's factor has no others) and a few zeros.
/// It is used again and again without giving back its memory.
#[derive(Clone, Debug, Default)]
pub struct Band {
    /// Degrees of freedom of a frame.
    size: usize,
    columns: Vec<f64>,
    /// The right side, and after [`solve`](Self::solve) the solution: a row of numbers for each frame.
    pub right: Vec<f64>,
}

impl Band {
    /// All zero.
    pub fn clear(&mut self, size: usize, frames: usize) {
        self.size = size;
        self.columns.clear();
        self.columns.resize(frames * size * (2 * size + GROUP), 0.0);
        self.right.clear();
        self.right.resize(frames * size, 0.0);
    }

    fn column(&mut self, frame: usize, dof: usize) -> &mut [f64] {
        let stride = 2 * self.size + GROUP;
        &mut self.columns[(frame * self.size + dof) * stride..][..=2 * self.size]
    }

    /// Sets the block of a frame: a lower triangle, column by column, `size × size`.
    pub fn set(&mut self, frame: usize, block: &[f64]) {
        let n = self.size;
        for dof in 0..n {
            self.column(frame, dof)[..n - dof].copy_from_slice(&block[dof * n + dof..(dof + 1) * n]);
        }
    }

    /// Adds to the coupling of a degree of freedom of a frame with its own `later` frames later: 0, 1 or 2.
    pub fn couple(&mut self, frame: usize, dof: usize, later: usize, value: f64) {
        let n = self.size;
        self.column(frame, dof)[later * n] += value;
    }

    /// Solves. The matrix is used up. False if it is not positive definite.
    pub fn solve(&mut self) -> bool {
        let length = 2 * self.size + 1;
        pulp::Arch::new().dispatch(Eliminate { columns: &mut self.columns, right: &mut self.right, length })
            && self.right.iter().all(|x| x.is_finite())
    }
}

/// A closure would not always be inlined into what is compiled for the machine's vector instructions.
struct Eliminate<'a> {
    columns: &'a mut [f64],
    right: &'a mut [f64],
    length: usize,
}

impl pulp::NullaryFnOnce for Eliminate<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        eliminate(self.columns, self.right, self.length)
    }
}

/// Columns that are taken off another at once, so that it is loaded and stored once for all of them.
const GROUP: usize = 8;

/// Cholesky's factor, column by column: from each are taken those before it, the nearest first. Then the right side, down and up again.
#[inline(always)]
fn eliminate(columns: &mut [f64], right: &mut [f64], length: usize) -> bool {
    let stride = length + GROUP - 1;
    for at in 0..right.len() {
        let (done, rest) = columns.split_at_mut(at * stride);
        let column = &mut rest[..length];
        let reach = at.min(length - 1);
        for group in 0..reach / GROUP {
            let nearest = group * GROUP + 1;
            let count = length - nearest;
            // those that are farther away end sooner; behind their ends are zeros
            let others: [&[f64]; GROUP] = std::array::from_fn(|k| &done[(at - nearest - k) * stride + nearest + k..][..count]);
            let f: [f64; GROUP] = std::array::from_fn(|k| others[k][0]);
            let [a, b, c, d, e, g, h, i] = others;
            for (row, to) in column[..count].iter_mut().enumerate() {
                let near = (f[0] * a[row] + f[1] * b[row]) + (f[2] * c[row] + f[3] * d[row]);
                let far = (f[4] * e[row] + f[5] * g[row]) + (f[6] * h[row] + f[7] * i[row]);
                *to -= near + far;
            }
        }
        for distance in reach / GROUP * GROUP + 1..=reach {
            let other = &done[(at - distance) * stride + distance..(at - distance) * stride + length];
            let factor = other[0];
            for (to, from) in column.iter_mut().zip(other) {
                *to -= factor * from;
            }
        }
        if !(column[0] > 0.0 && column[0].is_finite()) {
            return false;
        }
        let scale = 1.0 / column[0].sqrt();
        for value in column.iter_mut() {
            *value *= scale;
        }
        let (own, others) = right[at..].split_at_mut(1);
        own[0] *= scale;
        let value = own[0];
        for (x, l) in others.iter_mut().zip(&column[1..]) {
            *x -= value * l;
        }
    }
    for at in (0..right.len()).rev() {
        let column = &columns[at * stride..][..length];
        let (own, others) = right[at..].split_at_mut(1);
        let count = others.len().min(length - 1);
        let mut sums = [0.0; 4];
        let (fours, rest) = column[1..=count].as_chunks::<4>();
        let (xs, rest_xs) = others[..count].as_chunks::<4>();
        for (l, x) in fours.iter().zip(xs) {
            for k in 0..4 {
                sums[k] += l[k] * x[k];
            }
        }
        let rest: f64 = rest.iter().zip(rest_xs).map(|(l, x)| l * x).sum();
        own[0] = (own[0] - ((sums[0] + sums[1]) + (sums[2] + sums[3]) + rest)) / column[0];
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Random, Stream};
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn the_band_is_solved_like_any_matrix() {
        let mut random = Random::new(1, Stream::Noise);
        let mut band = Band::default();
        for (n, frames) in [(1, 1), (2, 3), (3, 5), (3, 6), (4, 7), (5, 20), (2, 41)] {
            band.clear(n, frames);
            let mut full = DMatrix::<f64>::zeros(n * frames, n * frames);
            for frame in 0..frames {
                let root = DMatrix::from_fn(n, n, |_, _| random.between(-1.0, 1.0));
                let own = &root * root.transpose() + DMatrix::identity(n, n) * 3.0;
                band.set(frame, own.as_slice());
                full.view_mut((frame * n, frame * n), (n, n)).copy_from(&own);
            }
            for frame in 0..frames {
                for dof in 0..n {
                    for later in (1..=2).filter(|later| frame + later < frames) {
                        let value = random.between(-0.7, 0.7);
                        band.couple(frame, dof, later, value);
                        full[((frame + later) * n + dof, frame * n + dof)] = value;
                        full[(frame * n + dof, (frame + later) * n + dof)] = value;
                    }
                }
            }
            let right = DVector::from_fn(n * frames, |_, _| random.between(-1.0, 1.0));
            band.right.copy_from_slice(right.as_slice());
            assert!(band.solve(), "{n} {frames}");
            let off = (&full * DVector::from_column_slice(&band.right) - right).amax();
            assert!(off < 1e-10, "{n} degrees of freedom, {frames} frames: off by {off}");
        }
    }
}
