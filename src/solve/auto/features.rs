//! What experts look at: where the neighbours of a marker are in the local frame, how they move, and how near the pose is to poses seen before.

use super::frame::Pose;
use super::tracks::Tracks;
use nalgebra::DMatrix;

/// What an expert makes of its neighbours' local coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// The coordinates.
    Linear,
    /// Also their velocity and acceleration over this many frames at 120 Hz.
    Moving(usize),
    /// Also bumps around this many poses of the take.
    Bent(usize),
}

/// An expert: what it looks at and how much it may use it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spec {
    /// What it makes of them.
    pub kind: Kind,
    /// How many neighbours it looks at, most rigid first.
    pub neighbours: usize,
    /// Standard deviation of its coefficients before anything was seen.
    pub prior: f64,
}

/// Local coordinates of the neighbours in the frames that somebody needs.
pub struct Local {
    /// Row of each frame of the take; `u32::MAX` if nobody needs it.
    row_of: Vec<u32>,
    frames: usize,
    /// 3 neighbours × rows, minus the means.
    coordinates: DMatrix<f64>,
    poses: Vec<Pose>,
}

impl Local {
    /// The frames of `wanted` (ascending, no doubles) with their poses; means are those over `learn`.
    pub fn new(tracks: &Tracks, neighbours: &[usize], wanted: &[usize], poses: Vec<Pose>, learn: &[usize]) -> Self {
        let mut row_of = vec![u32::MAX; tracks.frames];
        let mut coordinates = DMatrix::zeros(3 * neighbours.len(), wanted.len());
        for (row, (&t, pose)) in wanted.iter().zip(&poses).enumerate() {
            row_of[t] = row as u32;
            let mut column = coordinates.column_mut(row);
            for (k, &j) in neighbours.iter().enumerate() {
                let x = pose.to_local(tracks.place(t, j));
                for axis in 0..3 {
                    column[3 * k + axis] = x[axis];
                }
            }
        }
        let mut mean = nalgebra::DVector::zeros(3 * neighbours.len());
        for &t in learn {
            mean += coordinates.column(row_of[t] as usize);
        }
        mean /= learn.len().max(1) as f64;
        for mut column in coordinates.column_iter_mut() {
            column -= &mean;
        }
        Self { row_of, frames: tracks.frames, coordinates, poses }
    }

    fn row(&self, t: usize) -> usize {
        self.row_of[t] as usize
    }

    /// The pose in a frame that was wanted.
    pub fn pose(&self, t: usize) -> &Pose {
        &self.poses[self.row(t)]
    }

    fn at(&self, t: usize, inputs: usize) -> &[f64] {
        let height = self.coordinates.nrows();
        &self.coordinates.as_slice()[self.row(t) * height..][..inputs]
    }
}

/// Features of one kind, ready to be computed for any frame.
pub struct Features<'a> {
    local: &'a Local,
    kind: Kind,
    /// Local coordinates that take part.
    inputs: usize,
    lag: usize,
    bumps: Bumps,
}

/// Bumps around poses of the take.
#[derive(Default)]
struct Bumps {
    /// inputs × bumps.
    centres: DMatrix<f64>,
    /// Squared width, mm².
    width: f64,
    /// Mean of each over what is learned from.
    means: Vec<f64>,
}

/// Poses among which the centres of bumps are chosen.
const POSES: usize = 200;

/// What a bump counts against a coordinate of its width.
const BUMP: f64 = 0.3;

impl<'a> Features<'a> {
    /// `scale` is the rate over 120 Hz.
    pub fn new(local: &'a Local, kind: Kind, neighbours: usize, learn: &[usize], scale: f64) -> Self {
        let inputs = 3 * neighbours;
        let lag = if let Kind::Moving(lag) = kind { ((lag as f64 * scale).round() as usize).max(1) } else { 0 };
        let mut features = Self { local, kind, inputs, lag, bumps: Bumps::default() };
        if let Kind::Bent(count) = kind {
            features.bumps = features.find_bumps(count, learn);
        }
        features
    }

    /// The frames that have to be known for the features of frame `t`.
    pub fn reach(kind: Kind, t: usize, frames: usize, scale: f64) -> [usize; 3] {
        match kind {
            Kind::Moving(lag) => {
                let lag = ((lag as f64 * scale).round() as usize).max(1);
                [t.saturating_sub(lag), t, (t + lag).min(frames - 1)]
            }
            _ => [t; 3],
        }
    }

    /// Number of features, the constant counted.
    pub fn count(&self) -> usize {
        1 + match self.kind {
            Kind::Linear => self.inputs,
            Kind::Moving(_) => 3 * self.inputs,
            Kind::Bent(_) => self.inputs + self.bumps.centres.ncols(),
        }
    }

    /// Farthest-point centres among poses that are learned from.
    fn find_bumps(&self, count: usize, learn: &[usize]) -> Bumps {
        let some: Vec<usize> = spread(learn.len(), POSES).into_iter().map(|k| learn[k]).collect();
        let rows: Vec<&[f64]> = some.iter().map(|&t| self.local.at(t, self.inputs)).collect();
        let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>();
        let Some(&first) = rows.first() else { return Bumps::default() };
        let mut nearest: Vec<f64> = rows.iter().map(|r| apart(r, first)).collect();
        let mut centres = vec![first];
        let mut distances = nearest.clone();
        while centres.len() < count.min(rows.len()) {
            let far = (0..rows.len()).fold(0, |best, k| if nearest[k] > nearest[best] { k } else { best });
            centres.push(rows[far]);
            for (near, row) in nearest.iter_mut().zip(&rows) {
                let d = apart(row, rows[far]);
                distances.push(d);
                *near = near.min(d);
            }
        }
        distances.sort_by(f64::total_cmp);
        let width = distances[distances.len() / 2] + 1e-9;
        let centres = DMatrix::from_iterator(self.inputs, centres.len(), centres.iter().flat_map(|c| c.iter().copied()));
        let mut bumps = Bumps { means: vec![0.0; centres.ncols()], centres, width };
        let mut sums = vec![0.0; bumps.means.len()];
        let mut values = vec![0.0; bumps.means.len()];
        for row in &rows {
            bumps.fill(row, &mut values);
            for (sum, value) in sums.iter_mut().zip(&values) {
                *sum += value;
            }
        }
        bumps.means = sums.iter().map(|s| s / rows.len() as f64).collect();
        bumps
    }

    /// Writes the features of frame `t`.
    pub fn fill(&self, t: usize, out: &mut [f64]) {
        let (head, rest) = out.split_at_mut(1);
        head[0] = 1.0;
        let own = self.local.at(t, self.inputs);
        rest[..self.inputs].copy_from_slice(own);
        match self.kind {
            Kind::Linear => {}
            Kind::Moving(_) => {
                let before = self.local.at(t.saturating_sub(self.lag), self.inputs);
                let after = self.local.at((t + self.lag).min(self.local.frames - 1), self.inputs);
                let (velocity, acceleration) = rest[self.inputs..3 * self.inputs].split_at_mut(self.inputs);
                for k in 0..self.inputs {
                    velocity[k] = 0.5 * (after[k] - before[k]);
                    acceleration[k] = after[k] + before[k] - 2.0 * own[k];
                }
            }
            Kind::Bent(_) => self.bumps.fill(own, &mut rest[self.inputs..]),
        }
    }

    /// The features of some frames: features × frames.
    pub fn table(&self, frames: &[usize]) -> DMatrix<f64> {
        let mut table = DMatrix::zeros(self.count(), frames.len());
        let count = self.count();
        for (&t, column) in frames.iter().zip(table.as_mut_slice().chunks_exact_mut(count)) {
            self.fill(t, column);
        }
        table
    }
}

impl Bumps {
    fn fill(&self, own: &[f64], out: &mut [f64]) {
        let size = BUMP * self.width.sqrt();
        for ((centre, mean), out) in self.centres.as_slice().chunks_exact(own.len().max(1)).zip(&self.means).zip(out) {
            let apart: f64 = own.iter().zip(centre).map(|(x, y)| (x - y) * (x - y)).sum();
            *out = size * ((-0.5 * apart / self.width).exp() - mean);
        }
    }
}

/// At most `most` places evenly over `0..count`.
pub fn spread(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    (0..most).map(|k| k * (count - 1) / (most - 1).max(1)).collect()
}
