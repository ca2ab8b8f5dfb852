//! The bone step over whole gaps: neighbouring frames coupled, residuals at both edges taken into account.
//!
//! The paper's bone step (Eq. 11) solves each frame alone: what is left between the model and a marker is taken for white noise,
//! so the fill jumps at the edges of a gap by whatever the model is off there, and from frame to frame by whatever the bones make of it.
//! That residual `e = x - (G E[z] + d)` is not white: where the model is 10 mm off in one frame, it is so in the next.
//! Nor is the length of a bone between skin markers: where it is 4 mm too long before a gap, it is so after the first frame of it.
//! Here both are first-order autoregressive processes with the variance and the correlation ρ per frame that the marker, or the bone, shows where it was seen;
//! both are known in the last frame before a gap and in the first one after. So what is minimised over all missing samples of an episode is
//!
//! `½ Σ (eₜ - ρ eₜ₋₁)² / (r (1 - ρ²)) + ½ Σ (cₜ - ρ cₜ₋₁)² / (s² (1 - ρ²))`, `c = ‖xᵢ - xⱼ‖ - d`
//!
//! with the spread s = 1 / (2 d √λ) of each bone. For ρ = 0 that is Eq. 11, frame by frame, with the length instead of its square.
//! Without the second ρ three hundred frames of a bone that is a little too long would outvote everything else three hundred times.
//! The Gauss-Newton matrix is block tridiagonal, one block per frame, and is solved by elimination; steps are damped (Levenberg and Marquardt) until they help.
//!
//! Hard constraints are the same problem with multipliers (the method of multipliers, Hestenes 1969 and Powell 1969): `½ (k c + u)²` for each bone and frame,
//! with u raised by what is left after each solution. It ends in exact lengths where these can be met, and where they contradict each other, in the least squares of the ones given up, weighed by their own spreads, the others kept:
//! every matrix on the way is positive definite, whatever the bones say.

use crate::solve::kernel::invert;
use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;

/// One end of a bone.
#[derive(Clone, Copy, Debug)]
pub enum End {
    /// An unknown of the frame, by its place in [`Block::unknowns`].
    Free(usize),
    /// A marker that was seen, where it was seen, m.
    Fixed(Vector3<f64>),
}

/// A bone in one frame.
#[derive(Clone, Copy, Debug)]
pub struct Tie {
    /// Its ends; at least one of them is free.
    pub ends: [End; 2],
    /// d, m.
    pub length: f64,
    /// What of its length is known from its neighbours in time.
    pub time: Time<f64>,
}

/// The part of a first-order autoregressive process that concerns one frame: `½ own xₜ² - link xₜ xₜ₋₁ - pull xₜ`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Time<T> {
    /// The same process in the block before, if it is unknown there.
    pub before: Option<usize>,
    /// Precision given the neighbours in time, 1/m².
    pub own: f64,
    /// What ties it to the frame before, 1/m².
    pub link: f64,
    /// Precision times what known neighbours make one expect, 1/m.
    pub pull: T,
}

/// A frame next to one in which a process is unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Neighbour<T> {
    /// There is none, or nothing is known about the process there.
    None,
    /// It is known there, m.
    Known(T),
    /// It is unknown there, too, and has this place in that frame's block.
    Unknown(usize),
}

impl<T: Copy + Default + PartialEq + std::ops::AddAssign + std::ops::Mul<f64, Output = T>> Time<T> {
    /// One frame of a process of this variance (m²) and correlation from frame to frame.
    pub fn new(variance: f64, correlation: f64, before: Neighbour<T>, after: Neighbour<T>) -> Self {
        let fresh = 1.0 / (variance * (1.0 - correlation * correlation)); // precision of what a frame adds
        let mut time = Self { own: if before == Neighbour::None { 1.0 / variance } else { fresh }, ..Self::default() };
        match before {
            Neighbour::Known(x) => time.pull += x * (correlation * fresh),
            Neighbour::Unknown(at) => (time.before, time.link) = (Some(at), correlation * fresh),
            Neighbour::None => {}
        }
        if after != Neighbour::None {
            time.own += correlation * correlation * fresh;
        }
        if let Neighbour::Known(x) = after {
            time.pull += x * (correlation * fresh);
        }
        time
    }
}

/// One missing sample.
#[derive(Clone, Copy, Debug)]
pub struct Unknown {
    /// Its place in the problem's list of missing samples.
    pub sample: usize,
    /// What the model expects of it, in the coordinates of the bones, m.
    pub expected: Vector3<f64>,
    /// What of its residual is known from its neighbours in time.
    pub time: Time<Vector3<f64>>,
}

/// The missing samples of one frame that belong together, and the bones at them.
#[derive(Clone, Debug, Default)]
pub struct Block {
    /// Missing samples.
    pub unknowns: Vec<Unknown>,
    /// Bones at them.
    pub ties: Vec<Tie>,
}

/// Missing samples that bones or time connect, frame by frame without a frame left out.
#[derive(Clone, Debug, Default)]
pub struct Episode {
    /// One block per frame.
    pub blocks: Vec<Block>,
}

/// A bone length counts as met when it is off by less than this, m. A tenth of a hundredth of a millimetre: positions are rounded afterwards.
pub const MET_M: f64 = 1e-6;

/// Hard bones are held this many times as stiffly as their spread says: the farther the multipliers have to go, the less exact the numbers.
const HARD: f64 = 20.0;

/// Rounds of the method of multipliers; each leaves a small share of the violation where the bones can be met.
const ROUNDS: usize = 40;

/// After this many rounds a bone whose violation a round did not lessen to four fifths counts as impossible to meet.
const TRIED: usize = 5;

/// Soft bones are settled when a step gains less than this for each missing sample, in nats: nobody could tell the difference from the data.
const SETTLED: f64 = 1e-7;

/// Steps that move nothing farther than this are the last in any case, m.
const STILL_M: f64 = 1e-7;

/// One vector for each unknown, block by block, m.
pub type Vectors = Vec<Vec<Vector3<f64>>>;

impl Episode {
    /// The least with soft bones, from `start` (positions), in at most `steps` steps. Returns positions.
    pub fn soft(&self, start: Vectors, steps: usize) -> Vectors {
        let mut residuals = self.residuals(start);
        let unknowns: usize = self.blocks.iter().map(|block| block.unknowns.len()).sum();
        self.descend(&mut residuals, steps, SETTLED * unknowns as f64);
        self.positions(residuals)
    }

    /// Meets the bones exactly, or as well as they can be met, from `start` (positions). What their lengths did before and after does not count.
    /// Returns the positions and the largest violation (m).
    pub fn hard(&self, start: Vectors) -> (Vectors, f64) {
        let mut held = self.clone();
        let stiffness: Vec<Vec<f64>> = self.blocks.iter().map(|b| b.ties.iter().map(|tie| HARD * tie.time.own.sqrt()).collect()).collect();
        for (block, stiffness) in held.blocks.iter_mut().zip(&stiffness) {
            for (tie, k) in block.ties.iter_mut().zip(stiffness) {
                tie.time = Time { own: k * k, ..Time::default() };
            }
        }
        let mut residuals = self.residuals(start);
        // each bone's last violation; none once it was given up
        let mut last: Vec<Vec<Option<f64>>> = self.blocks.iter().map(|b| vec![Some(f64::INFINITY); b.ties.len()]).collect();
        let mut worst = f64::INFINITY;
        for round in 0..ROUNDS {
            held.descend(&mut residuals, 20, 0.0);
            let off = held.off(&residuals);
            worst = off.iter().flatten().fold(0.0, |most: f64, off| most.max(off.abs()));
            let mut open = false; // is there a bone that more rounds would help?
            for ((block, off), last) in held.blocks.iter_mut().zip(&off).zip(&mut last) {
                for ((tie, off), last) in block.ties.iter_mut().zip(off).zip(last) {
                    let Some(before) = *last else { continue };
                    if off.abs() < MET_M {
                        continue;
                    }
                    open = true;
                    if round >= TRIED && off.abs() > 0.8 * before {
                        // it contradicts the others: from here on a stiff spring, that is least squares
                        (*last, tie.time.pull) = (None, 0.0);
                    } else {
                        *last = Some(off.abs());
                        tie.time.pull -= tie.time.own * off; // u rises by k c
                    }
                }
            }
            if !open {
                break;
            }
        }
        (self.positions(residuals), worst)
    }

    fn residuals(&self, mut positions: Vectors) -> Vectors {
        for (block, own) in self.blocks.iter().zip(&mut positions) {
            for (unknown, x) in block.unknowns.iter().zip(own) {
                *x -= unknown.expected;
            }
        }
        positions
    }

    fn positions(&self, mut residuals: Vectors) -> Vectors {
        for (block, own) in self.blocks.iter().zip(&mut residuals) {
            for (unknown, x) in block.unknowns.iter().zip(own) {
                *x += unknown.expected;
            }
        }
        residuals
    }

    /// How much every bone is too long, block by block, m.
    fn off(&self, residuals: &Vectors) -> Vec<Vec<f64>> {
        self.blocks.iter().zip(residuals).map(|(block, own)| block.ties.iter().map(|tie| block.off(tie, own)).collect()).collect()
    }

    /// What is minimised, short of a constant, at residuals of the unknowns.
    pub fn cost(&self, residuals: &Vectors) -> f64 {
        let off = self.off(residuals);
        let mut sum = 0.0;
        for (t, block) in self.blocks.iter().enumerate() {
            for (unknown, e) in block.unknowns.iter().zip(&residuals[t]) {
                let time = &unknown.time;
                sum += 0.5 * time.own * e.norm_squared() - time.pull.dot(e);
                sum -= time.before.map_or(0.0, |b| time.link * e.dot(&residuals[t - 1][b]));
            }
            for (tie, c) in block.ties.iter().zip(&off[t]) {
                let time = &tie.time;
                sum += 0.5 * time.own * c * c - time.pull * c;
                sum -= time.before.map_or(0.0, |b| time.link * c * off[t - 1][b]);
            }
        }
        sum
    }

    /// Damped Gauss-Newton steps until they stand still, or gain less than `settled` nats.
    fn descend(&self, residuals: &mut Vectors, steps: usize, settled: f64) {
        let mut cost = self.cost(residuals);
        let mut damping = 0.0;
        for _ in 0..steps {
            let Some(step) = self.step(residuals, damping) else {
                damping = if damping == 0.0 { 1.0 } else { 8.0 * damping };
                if damping > 1e12 {
                    return;
                }
                continue;
            };
            let mut next = residuals.clone();
            let mut farthest = 0.0f64;
            for (own, step) in next.iter_mut().flatten().zip(step.iter().flatten()) {
                *own += step;
                farthest = farthest.max(step.amax());
            }
            let now = self.cost(&next);
            if now <= cost {
                let gained = cost - now;
                *residuals = next;
                cost = now;
                damping = if damping < 0.1 { 0.0 } else { damping / 8.0 };
                if farthest < STILL_M || gained < settled {
                    return;
                }
            } else {
                if farthest < STILL_M || damping > 1e12 {
                    return;
                }
                damping = if damping == 0.0 { 0.1 } else { 8.0 * damping };
            }
        }
    }

    /// One step: the block tridiagonal system of the linearised problem, eliminated from both ends at once and substituted back from the middle.
    /// `damping` holds each unknown by that many times its own precision. None if a block cannot be inverted.
    fn step(&self, residuals: &Vectors, damping: f64) -> Option<Vectors> {
        let count = self.blocks.len();
        let off = self.off(residuals);
        let slopes: Vec<Vec<Vector3<f64>>> =
            self.blocks.iter().zip(residuals).map(|(block, own)| block.ties.iter().map(|tie| block.slope(tie, own)).collect()).collect();
        let mut systems: Vec<System> =
            (0..count).into_par_iter().with_min_len(32).map(|t| self.system(t, residuals, &off, &slopes, damping)).collect();
        let middle = count / 2;
        let (left, rest) = systems.split_at_mut(middle);
        let (centre, right) = rest.split_first_mut()?;
        let (from_left, from_right) = rayon::join(|| eliminate_up(left), || eliminate_down(right));
        from_left.and(from_right)?;
        if let Some(before) = left.last() {
            let carried = &centre.coupling * &before.matrix;
            centre.matrix.gemm(-1.0, &carried, &centre.coupling.transpose(), 1.0);
            centre.right.gemv(-1.0, &carried, &before.right, 1.0);
        }
        if let Some(after) = right.first() {
            let turned = after.coupling.transpose();
            let carried = &turned * &after.matrix;
            centre.matrix.gemm(-1.0, &carried, &after.coupling, 1.0);
            centre.right.gemv(-1.0, &carried, &after.right, 1.0);
        }
        centre.invert()?;
        let found = &centre.matrix * &centre.right;
        let coupling = &centre.coupling;
        let (below, above) = rayon::join(
            || {
                let mut steps = Vec::with_capacity(left.len());
                let (mut next, mut coupling) = (found.clone(), coupling);
                for system in left.iter().rev() {
                    let mut right = system.right.clone();
                    right.gemv_tr(-1.0, coupling, &next, 1.0);
                    next = &system.matrix * right;
                    coupling = &system.coupling;
                    steps.push(vectors(&next));
                }
                steps
            },
            || {
                let mut steps = Vec::with_capacity(right.len());
                let mut before = found.clone();
                for system in right.iter() {
                    let mut right = system.right.clone();
                    right.gemv(-1.0, &system.coupling, &before, 1.0);
                    before = &system.matrix * right;
                    steps.push(vectors(&before));
                }
                steps
            },
        );
        Some(below.into_iter().rev().chain([vectors(&found)]).chain(above).collect())
    }

    /// The rows of one block.
    fn system(&self, t: usize, residuals: &Vectors, off: &[Vec<f64>], slopes: &[Vec<Vector3<f64>>], damping: f64) -> System {
        let block = &self.blocks[t];
        let before = t.checked_sub(1).map(|t| &self.blocks[t]);
        let n = 3 * block.unknowns.len();
        let mut matrix = DMatrix::zeros(n, n);
        let mut right = DVector::zeros(n);
        let mut coupling = DMatrix::zeros(n, before.map_or(0, |block| 3 * block.unknowns.len()));
        for (u, (unknown, e)) in block.unknowns.iter().zip(&residuals[t]).enumerate() {
            let time = &unknown.time;
            let mut pull = time.pull - e * time.own;
            if let Some(b) = time.before {
                pull += residuals[t - 1][b] * time.link;
            }
            for axis in 0..3 {
                matrix[(3 * u + axis, 3 * u + axis)] = time.own * (1.0 + damping);
                right[3 * u + axis] += pull[axis];
                if let Some(b) = time.before {
                    coupling[(3 * u + axis, 3 * b + axis)] = -time.link;
                }
            }
        }
        let pull_of =
            |tie: &Tie, c: &f64| tie.time.pull - tie.time.own * c + tie.time.before.map_or(0.0, |b| tie.time.link * off[t - 1][b]);
        let mut pulls: Vec<f64> = block.ties.iter().zip(&off[t]).map(|(tie, c)| pull_of(tie, c)).collect();
        // and what the block after wants of this one
        if let Some(next) = self.blocks.get(t + 1) {
            for (unknown, e) in next.unknowns.iter().zip(&residuals[t + 1]) {
                if let Some(b) = unknown.time.before {
                    for axis in 0..3 {
                        right[3 * b + axis] += unknown.time.link * e[axis];
                    }
                }
            }
            for (tie, c) in next.ties.iter().zip(&off[t + 1]) {
                if let Some(b) = tie.time.before {
                    pulls[b] += tie.time.link * c;
                }
            }
        }
        for (k, tie) in block.ties.iter().enumerate() {
            let slope = &slopes[t][k];
            let earlier = before.and_then(|block| tie.time.before.map(|b| (&block.ties[b], slopes[t - 1][b])));
            for (p, sign_p) in tie.free() {
                let own = slope * sign_p;
                let mut pulled = right.fixed_rows_mut::<3>(3 * p);
                pulled += own * pulls[k];
                for (q, sign_q) in tie.free() {
                    let mut entry = matrix.fixed_view_mut::<3, 3>(3 * p, 3 * q);
                    entry += own * (slope * (sign_q * tie.time.own)).transpose();
                }
                if let Some((earlier, then)) = &earlier {
                    for (q, sign_q) in earlier.free() {
                        let mut entry = coupling.fixed_view_mut::<3, 3>(3 * p, 3 * q);
                        entry -= own * (then * (sign_q * tie.time.link)).transpose();
                    }
                }
            }
        }
        System { matrix, right, coupling }
    }
}

/// One block of the linear system. Elimination replaces the matrix by the inverse of what it has become.
struct System {
    matrix: DMatrix<f64>,
    /// Minus the slope of the cost.
    right: DVector<f64>,
    /// To the block before: rows of this one, columns of that.
    coupling: DMatrix<f64>,
}

impl System {
    fn invert(&mut self) -> Option<()> {
        let n = self.matrix.nrows();
        let (mut factor, mut inverse) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        invert(&self.matrix, &mut factor, &mut inverse)?;
        self.matrix = inverse;
        Some(())
    }
}

/// Eliminates blocks upwards. None if one cannot be inverted.
fn eliminate_up(systems: &mut [System]) -> Option<()> {
    for at in 0..systems.len() {
        let (done, rest) = systems.split_at_mut(at);
        if let Some(before) = done.last() {
            let own = &mut rest[0];
            let carried = &own.coupling * &before.matrix;
            own.matrix.gemm(-1.0, &carried, &own.coupling.transpose(), 1.0);
            own.right.gemv(-1.0, &carried, &before.right, 1.0);
        }
        rest[0].invert()?;
    }
    Some(())
}

/// The same downwards.
fn eliminate_down(systems: &mut [System]) -> Option<()> {
    for at in (0..systems.len()).rev() {
        let (rest, done) = systems.split_at_mut(at + 1);
        if let Some(after) = done.first() {
            let turned = after.coupling.transpose();
            let carried = &turned * &after.matrix;
            rest[at].matrix.gemm(-1.0, &carried, &after.coupling, 1.0);
            rest[at].right.gemv(-1.0, &carried, &after.right, 1.0);
        }
        rest[at].invert()?;
    }
    Some(())
}

/// A vector of coordinates, three by three.
fn vectors(x: &DVector<f64>) -> Vec<Vector3<f64>> {
    x.as_slice().chunks_exact(3).map(Vector3::from_column_slice).collect()
}

impl Tie {
    /// The free ends, with the sign of the slope of the length there.
    fn free(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.ends.iter().zip([1.0, -1.0]).filter_map(|(end, sign)| match end {
            End::Free(u) => Some((*u, sign)),
            End::Fixed(_) => None,
        })
    }
}

impl Block {
    /// From the second end of a bone to its first, at these residuals, m.
    fn along(&self, tie: &Tie, residuals: &[Vector3<f64>]) -> Vector3<f64> {
        let at = |end: End| match end {
            End::Free(u) => self.unknowns[u].expected + residuals[u],
            End::Fixed(x) => x,
        };
        at(tie.ends[0]) - at(tie.ends[1])
    }

    /// How much too long a bone is, m.
    pub fn off(&self, tie: &Tie, residuals: &[Vector3<f64>]) -> f64 {
        self.along(tie, residuals).norm() - tie.length
    }

    /// The slope of a bone's length along its first end. Two markers in one place have no direction: there it is 0.
    fn slope(&self, tie: &Tie, residuals: &[Vector3<f64>]) -> Vector3<f64> {
        let along = self.along(tie, residuals);
        let length = along.norm();
        if length < 1e-6 { Vector3::zeros() } else { along / length }
    }
}
