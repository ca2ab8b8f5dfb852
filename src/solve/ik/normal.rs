//! The normal equations of one step, and their solution.

use super::block::Block;
use super::pose::Posed;
use super::tree::Tree;

/// `JᵀJ` and `Jᵀr` over all terms (equation 5).
#[derive(Clone, Debug)]
pub struct Normal {
    size: usize,
    /// What the points of each part say.
    pub blocks: Vec<Block>,
    behind: Vec<Block>,
    /// The lower triangle, column by column: entry `(row, column)` at `column * size + row`.
    matrix: Vec<f64>,
    gradient: Vec<f64>,
    factor: Vec<f64>,
}

impl Normal {
    /// Nothing is known yet.
    pub fn new(tree: &Tree) -> Self {
        let size = tree.freedom();
        Self {
            size,
            blocks: vec![Block::default(); tree.joints()],
            behind: vec![Block::default(); tree.joints()],
            matrix: vec![0.0; size * size],
            gradient: vec![0.0; size],
            factor: vec![0.0; size * size],
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.blocks.fill(Block::default());
        self.matrix.fill(0.0);
        self.gradient.fill(0.0);
    }

    /// Number of degrees of freedom.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Adds a term of one residual whose gradient is 0 but for the degrees of freedom from `first` on.
    pub fn add(&mut self, first: usize, gradient: &[f64], weight: f64, residual: f64) {
        for (a, ga) in gradient.iter().enumerate() {
            self.gradient[first + a] += weight * ga * residual;
            for (b, gb) in gradient.iter().enumerate().skip(a) {
                self.matrix[(first + a) * self.size + first + b] += weight * ga * gb;
            }
        }
    }

    /// Adds to one entry of the matrix; `row >= column`.
    pub fn add_entry(&mut self, row: usize, column: usize, value: f64) {
        self.matrix[column * self.size + row] += value;
    }

    /// Adds to one entry of `Jᵀr`.
    pub fn add_gradient(&mut self, row: usize, value: f64) {
        self.gradient[row] += value;
    }

    /// Turns what parts say into what degrees of freedom say; the blocks are empty afterwards.
    pub fn gather(&mut self, tree: &Tree, posed: &Posed) {
        std::mem::swap(&mut self.behind, &mut self.blocks);
        self.blocks.fill(Block::default());
        for joint in (0..tree.joints()).rev() {
            if let Some(parent) = tree.links[joint].parent {
                let block = self.behind[joint];
                self.behind[parent].add(&block);
            }
        }
        for (row, &joint) in tree.owners.iter().enumerate() {
            let block = &self.behind[joint];
            let along = block.times(&posed.twists[row]);
            self.gradient[row] += block.residual(&posed.twists[row]);
            for &column in tree.chains[joint].iter().take_while(|&&column| column <= row) {
                let other = &posed.twists[column];
                self.matrix[column * self.size + row] += other.turn.dot(&along.turn) + other.shift.dot(&along.shift);
            }
        }
    }

    /// An entry of the diagonal.
    pub fn diagonal(&self, at: usize) -> f64 {
        self.matrix[at * self.size + at]
    }

    /// An entry of the symmetric matrix.
    pub fn entry(&self, row: usize, column: usize) -> f64 {
        self.matrix[row.min(column) * self.size + row.max(column)]
    }

    /// The lower triangle, column by column.
    pub fn matrix(&self) -> &[f64] {
        &self.matrix
    }

    /// `Jᵀr`
    pub fn gradient(&self) -> &[f64] {
        &self.gradient
    }

    /// The step `-(JᵀJ + damping)⁻¹ Jᵀr`, where `damping` is what is added to an entry of the diagonal, given that entry.
    /// False if the matrix is not positive definite, or a number is not finite.
    pub fn step(&mut self, damping: impl Fn(f64) -> f64, step: &mut [f64]) -> bool {
        self.factor.copy_from_slice(&self.matrix);
        for at in 0..self.size {
            self.factor[at * self.size + at] += damping(self.diagonal(at));
        }
        for (to, from) in step.iter_mut().zip(&self.gradient) {
            *to = -from;
        }
        cholesky(&mut self.factor, self.size) && cholesky_solve(&self.factor, step)
    }
}

/// Cholesky's factor of a lower triangle, in place, column by column. False if the matrix is not positive definite.
fn cholesky(matrix: &mut [f64], size: usize) -> bool {
    pulp::Arch::new().dispatch(|| factorise(matrix, size))
}

/// Solves with a factor, in place. False if a number is not finite.
fn cholesky_solve(factor: &[f64], x: &mut [f64]) -> bool {
    pulp::Arch::new().dispatch(|| solve(factor, x))
}

#[inline(always)]
fn factorise(matrix: &mut [f64], size: usize) -> bool {
    for at in 0..size {
        let (done, rest) = matrix.split_at_mut(at * size);
        let column = &mut rest[at..size];
        for earlier in done.chunks_exact(size) {
            let earlier = &earlier[at..size];
            let factor = earlier[0];
            if factor != 0.0 {
                for (to, from) in column.iter_mut().zip(earlier) {
                    *to -= factor * from;
                }
            }
        }
        let pivot = column[0];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        let scale = 1.0 / pivot.sqrt();
        for value in column {
            *value *= scale;
        }
    }
    true
}

#[inline(always)]
fn solve(factor: &[f64], x: &mut [f64]) -> bool {
    let size = x.len();
    for at in 0..size {
        let column = &factor[at * size..(at + 1) * size];
        let value = x[at] / column[at];
        x[at] = value;
        for (to, from) in x[at + 1..].iter_mut().zip(&column[at + 1..]) {
            *to -= value * from;
        }
    }
    for at in (0..size).rev() {
        let column = &factor[at * size..(at + 1) * size];
        let sum: f64 = x[at + 1..].iter().zip(&column[at + 1..]).map(|(x, l)| x * l).sum();
        x[at] = (x[at] - sum) / column[at];
    }
    x.iter().all(|x| x.is_finite())
}
