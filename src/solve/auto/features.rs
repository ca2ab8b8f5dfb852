//! What experts look at: where the neighbours of a marker are in a local frame, how they and the frame move, and how near the pose is to poses seen before.

use super::frame::Pose;
use super::tracks::Tracks;
use nalgebra::{DMatrix, SymmetricEigen, Vector3};

/// Something that an expert looks at. Numbers of neighbours count the most rigid ones first; lags are in frames at 120 Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Part {
    /// Local coordinates of so many neighbours.
    Place(usize),
    /// Their velocity over a lag.
    Velocity(usize, usize),
    /// Their acceleration over a lag.
    Acceleration(usize, usize),
    /// All products of two of their coordinates.
    Products(usize),
    /// The directions of the frame's axes: which way is down, and where the body faces.
    Turn,
    /// How these change over a lag.
    TurnRate(usize),
    /// Velocity and acceleration of the frame's origin over a lag, in the frame.
    Drift(usize),
    /// A Gaussian process over the neighbours' coordinates, spanned by so many poses of the take.
    Near {
        /// How many neighbours.
        neighbours: usize,
        /// How many poses.
        poses: usize,
        /// True if the frame's directions count, too.
        turn: bool,
    },
    /// Bumps around so many poses, with the poses a lag before and after counting as well if there is one.
    Bumps {
        /// How many neighbours.
        neighbours: usize,
        /// How many poses.
        poses: usize,
        /// The lag; 0 for none.
        lag: usize,
    },
}

/// What a direction counts against a coordinate in mm: as if it were a marker 200 mm away.
const DIRECTION_MM: f64 = 200.0;

/// What a product counts against a coordinate; the same for what processes and bumps say, in their own widths.
const BENT: f64 = 0.3;

/// Poses among which those that span a process are chosen.
const POSES: usize = 300;

/// Eigenvalues below this share of the largest say nothing that rounding does not say as well.
const LEAST_EIGENVALUE: f64 = 1e-5;

/// Frames at this rate for a lag at 120 Hz; `scale` is the rate over 120 Hz.
pub fn lag_frames(lag: usize, scale: f64) -> usize {
    ((lag as f64 * scale).round() as usize).max(1)
}

impl Part {
    /// The same with at most so many neighbours.
    pub fn capped(self, most: usize) -> Self {
        match self {
            Self::Place(k) => Self::Place(k.min(most)),
            Self::Velocity(k, lag) => Self::Velocity(k.min(most), lag),
            Self::Acceleration(k, lag) => Self::Acceleration(k.min(most), lag),
            Self::Products(k) => Self::Products(k.min(most)),
            Self::Near { neighbours, poses, turn } => Self::Near { neighbours: neighbours.min(most), poses, turn },
            Self::Bumps { neighbours, poses, lag } => Self::Bumps { neighbours: neighbours.min(most), poses, lag },
            other => other,
        }
    }

    /// How many neighbours it looks at.
    pub fn neighbours(self) -> usize {
        match self {
            Self::Place(k) | Self::Velocity(k, _) | Self::Acceleration(k, _) | Self::Products(k) => k,
            Self::Near { neighbours, .. } | Self::Bumps { neighbours, .. } => neighbours,
            Self::Turn | Self::TurnRate(_) | Self::Drift(_) => 0,
        }
    }

    /// How far before and after a frame it looks.
    pub fn lag(self) -> usize {
        match self {
            Self::Velocity(_, lag) | Self::Acceleration(_, lag) | Self::TurnRate(lag) | Self::Drift(lag) | Self::Bumps { lag, .. } => lag,
            Self::Place(_) | Self::Products(_) | Self::Turn | Self::Near { .. } => 0,
        }
    }
}

/// Local coordinates of the neighbours in the frames that somebody needs.
pub struct Local {
    /// Row of each frame of the take; `u32::MAX` if nobody needs it.
    row_of: Vec<u32>,
    /// Rate over 120 Hz.
    scale: f64,
    /// 3 neighbours × rows, minus the means.
    coordinates: DMatrix<f64>,
    poses: Vec<Pose>,
}

impl Local {
    /// The frames of `wanted` (ascending, no doubles) with their poses; means are those over `learn`.
    pub fn new(tracks: &Tracks, neighbours: &[usize], wanted: &[usize], poses: Vec<Pose>, learn: &[usize], scale: f64) -> Self {
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
        Self { row_of, scale, coordinates, poses }
    }

    fn row(&self, t: usize) -> usize {
        self.row_of[t] as usize
    }

    /// The pose in a frame that was wanted.
    pub fn pose(&self, t: usize) -> &Pose {
        &self.poses[self.row(t)]
    }

    fn at(&self, t: usize, neighbours: usize) -> &[f64] {
        let height = self.coordinates.nrows();
        &self.coordinates.as_slice()[self.row(t) * height..][..3 * neighbours]
    }

    /// The frames a lag before and after, held at the take's ends.
    fn around(&self, t: usize, lag: usize) -> (usize, usize) {
        let lag = lag_frames(lag, self.scale);
        (t.saturating_sub(lag), (t + lag).min(self.row_of.len() - 1))
    }
}

/// Poses that span a process or carry bumps.
struct Span {
    /// inputs × poses.
    centres: DMatrix<f64>,
    /// Squared width.
    width: f64,
    /// poses × features; for bumps each pose is its own.
    mix: Option<DMatrix<f64>>,
}

/// A part that is ready to be computed for any frame.
struct Ready {
    part: Part,
    size: usize,
    span: Option<Span>,
    /// Factor on all of it.
    factor: f64,
}

/// The features of an expert, ready to be computed for any frame.
pub struct Features<'a> {
    local: &'a Local,
    parts: Vec<Ready>,
    count: usize,
    /// Mean of each feature over what is learned from; 0 for those that have none by nature.
    means: Vec<f64>,
}

impl<'a> Features<'a> {
    /// From what is seen in the frames `learn`; the second result is the features of these.
    pub fn new(local: &'a Local, parts: &[Part], learn: &[usize]) -> (Self, DMatrix<f64>) {
        let parts: Vec<Ready> = parts.iter().map(|&part| Ready::new(part, local, learn)).collect();
        let count = 1 + parts.iter().map(|p| p.size).sum::<usize>();
        let mut features = Self { local, parts, count, means: vec![0.0; count] };
        let mut table = features.table(learn);
        let mut means = vec![0.0; count];
        for column in table.as_slice().chunks_exact(count) {
            crate::solve::kernel::axpy(&mut means, 1.0 / learn.len() as f64, column);
        }
        // coordinates have no mean, and derivatives should be 0 at rest
        let mut from = 1;
        means[0] = 0.0;
        for part in &features.parts {
            if matches!(part.part, Part::Place(_) | Part::Velocity(..) | Part::Acceleration(..)) {
                means[from..from + part.size].fill(0.0);
            }
            from += part.size;
        }
        for column in table.as_mut_slice().chunks_exact_mut(count) {
            crate::solve::kernel::axpy(column, -1.0, &means);
        }
        features.means = means;
        (features, table)
    }

    /// Number of features, the constant counted.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The features of some frames: features × frames.
    pub fn table(&self, frames: &[usize]) -> DMatrix<f64> {
        let mut table = DMatrix::zeros(self.count, frames.len());
        for (&t, column) in frames.iter().zip(table.as_mut_slice().chunks_exact_mut(self.count)) {
            let (head, mut rest) = column.split_at_mut(1);
            head[0] = 1.0;
            for part in &self.parts {
                let (own, others) = rest.split_at_mut(part.size);
                part.fill(self.local, t, own);
                rest = others;
            }
            crate::solve::kernel::axpy(column, -1.0, &self.means);
        }
        table
    }
}

impl Ready {
    fn new(part: Part, local: &Local, learn: &[usize]) -> Self {
        let inputs = 3 * part.neighbours();
        let mut ready = Self { part, size: 0, span: None, factor: 1.0 };
        ready.size = match part {
            Part::Place(_) | Part::Velocity(..) | Part::Acceleration(..) => inputs,
            Part::Products(k) => {
                let squares: f64 = learn.iter().map(|&t| local.at(t, k).iter().map(|x| x * x).sum::<f64>()).sum();
                let spread = (squares / (learn.len() * inputs).max(1) as f64).sqrt();
                ready.factor = BENT / spread.max(1e-6);
                inputs * (inputs + 1) / 2
            }
            Part::Turn | Part::TurnRate(_) => 9,
            Part::Drift(_) => 6,
            Part::Near { poses, .. } | Part::Bumps { poses, .. } => {
                let span = Span::new(&ready, local, learn, poses);
                ready.factor = BENT * span.width.sqrt();
                let size = span.mix.as_ref().map_or(span.centres.ncols(), DMatrix::ncols);
                ready.span = Some(span);
                size
            }
        };
        ready
    }

    /// What a process or bumps compare poses by.
    fn inputs(&self, local: &Local, t: usize, out: &mut Vec<f64>) {
        out.clear();
        let k = self.part.neighbours();
        out.extend_from_slice(local.at(t, k));
        match self.part {
            Part::Near { turn: true, .. } => out.extend(local.pose(t).turn().iter().map(|x| x * DIRECTION_MM)),
            Part::Bumps { lag, .. } if lag > 0 => {
                let (before, after) = local.around(t, lag);
                out.extend_from_slice(local.at(after, k));
                out.extend_from_slice(local.at(before, k));
            }
            _ => {}
        }
    }

    /// Writes the features of frame `t`, means not taken off.
    fn fill(&self, local: &Local, t: usize, out: &mut [f64]) {
        let k = self.part.neighbours();
        match self.part {
            Part::Place(_) => out.copy_from_slice(local.at(t, k)),
            Part::Velocity(_, lag) => {
                let (before, after) = local.around(t, lag);
                for (x, (a, b)) in out.iter_mut().zip(local.at(after, k).iter().zip(local.at(before, k))) {
                    *x = 0.5 * (a - b);
                }
            }
            Part::Acceleration(_, lag) => {
                let (before, after) = local.around(t, lag);
                let ends = local.at(after, k).iter().zip(local.at(before, k));
                for ((x, (a, b)), own) in out.iter_mut().zip(ends).zip(local.at(t, k)) {
                    *x = a + b - 2.0 * own;
                }
            }
            Part::Products(_) => {
                let own = local.at(t, k);
                let mut rest = out;
                for (j, x) in own.iter().enumerate() {
                    let (row, others) = rest.split_at_mut(own.len() - j);
                    for (out, y) in row.iter_mut().zip(&own[j..]) {
                        *out = 2f64.sqrt() * self.factor * x * y;
                    }
                    // a mixed product stands for two entries of the square matrix, so that nothing depends on where the axes point
                    row[0] = self.factor * x * x;
                    rest = others;
                }
            }
            Part::Turn => {
                for (out, x) in out.iter_mut().zip(local.pose(t).turn().iter()) {
                    *out = DIRECTION_MM * x;
                }
            }
            Part::TurnRate(lag) => {
                let (before, after) = local.around(t, lag);
                let change = local.pose(after).turn() - local.pose(before).turn();
                for (out, x) in out.iter_mut().zip(change.iter()) {
                    *out = DIRECTION_MM * x;
                }
            }
            Part::Drift(lag) => {
                let (before, after) = local.around(t, lag);
                let own = local.pose(t);
                let (a, b): (Vector3<f64>, Vector3<f64>) = (local.pose(after).origin(), local.pose(before).origin());
                let velocity = own.direction_to_local(a - b);
                let acceleration = own.direction_to_local(a + b - 2.0 * own.origin());
                out[..3].copy_from_slice(velocity.as_slice());
                out[3..].copy_from_slice(acceleration.as_slice());
            }
            Part::Near { .. } | Part::Bumps { .. } => {
                let Some(span) = &self.span else { return };
                let mut inputs = Vec::with_capacity(span.centres.nrows());
                self.inputs(local, t, &mut inputs);
                span.fill(&inputs, self.factor, out);
            }
        }
    }
}

impl Span {
    /// Farthest-point centres among poses that are learned from.
    fn new(ready: &Ready, local: &Local, learn: &[usize], count: usize) -> Self {
        let rows: Vec<Vec<f64>> = spread(learn.len(), POSES)
            .into_iter()
            .map(|k| {
                let mut row = Vec::new();
                ready.inputs(local, learn[k], &mut row);
                row
            })
            .collect();
        let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>();
        let Some(first) = rows.first() else { return Self { centres: DMatrix::zeros(0, 0), width: 1.0, mix: None } };
        let mut chosen = vec![0];
        let mut nearest: Vec<f64> = rows.iter().map(|r| apart(r, first)).collect();
        let mut distances = nearest.clone();
        while chosen.len() < count.min(rows.len()) {
            let far = (0..rows.len()).fold(0, |best, k| if nearest[k] > nearest[best] { k } else { best });
            chosen.push(far);
            for (near, row) in nearest.iter_mut().zip(&rows) {
                let d = apart(row, &rows[far]);
                distances.push(d);
                *near = near.min(d);
            }
        }
        let middle = distances.len() / 2;
        let (_, median, _) = distances.select_nth_unstable_by(middle, f64::total_cmp);
        let width = *median + 1e-9;
        let centres = DMatrix::from_iterator(first.len(), chosen.len(), chosen.iter().flat_map(|&k| rows[k].iter().copied()));
        let mut span = Self { centres, width, mix: None };
        if matches!(ready.part, Part::Near { .. }) {
            let n = chosen.len();
            let own = DMatrix::from_fn(n, n, |a, b| (-0.5 * apart(&rows[chosen[a]], &rows[chosen[b]]) / width).exp());
            let eigen = SymmetricEigen::new(own);
            let largest = eigen.eigenvalues.max();
            let kept: Vec<usize> = (0..n).filter(|&k| eigen.eigenvalues[k] > LEAST_EIGENVALUE * largest).collect();
            span.mix = Some(DMatrix::from_fn(n, kept.len(), |r, c| eigen.eigenvectors[(r, kept[c])] / eigen.eigenvalues[kept[c]].sqrt()));
        }
        span
    }

    fn fill(&self, inputs: &[f64], factor: f64, out: &mut [f64]) {
        let bump = |centre: &[f64]| {
            let apart: f64 = squared_distance(inputs, centre);
            factor * (-0.5 * apart / self.width).exp()
        };
        let centres = self.centres.as_slice().chunks_exact(inputs.len().max(1)).map(bump);
        match &self.mix {
            None => out.iter_mut().zip(centres).for_each(|(out, x)| *out = x),
            Some(mix) => {
                let near: Vec<f64> = centres.collect();
                for (out, column) in out.iter_mut().zip(mix.as_slice().chunks_exact(near.len().max(1))) {
                    *out = crate::solve::kernel::dot(&near, column);
                }
            }
        }
    }
}

/// In four lanes, in a fixed order.
fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (heads, tails) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = heads.remainder().iter().zip(tails.remainder()).map(|(x, y)| (x - y) * (x - y)).sum();
    for (x, y) in heads.zip(tails) {
        for k in 0..4 {
            lanes[k] += (x[k] - y[k]) * (x[k] - y[k]);
        }
    }
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + rest
}

/// At most `most` places evenly over `0..count`.
pub fn spread(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    (0..most).map(|k| k * (count - 1) / (most - 1).max(1)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::problem;
    use super::*;
    use crate::random::{Random, Stream};
    use nalgebra::Rotation3;

    const FRAMES: usize = 60;

    /// Four markers in the world's frame turned by `turn`, in all frames; learned from are some.
    fn local(turn: &Rotation3<f64>, scale: f64, learn: &[usize]) -> Local {
        let mut random = Random::new(4, Stream::Gait);
        let places: Vec<Vector3<f64>> = (0..4 * FRAMES).map(|_| Vector3::from_fn(|_, _| random.between(-90.0, 90.0))).collect();
        let tracks = Tracks::new(&problem((FRAMES, 4), 120.0 * scale, |t, i| (turn * places[4 * t + i]).into(), |_, _| true));
        let all: Vec<usize> = (0..FRAMES).collect();
        Local::new(&tracks, &[2, 0, 1, 3], &all, vec![Pose::world_frame(); FRAMES], learn, scale)
    }

    /// What a ridge regression predicts depends on its features through their inner products alone.
    #[test]
    fn predictions_do_not_depend_on_where_the_axes_point() {
        let learn: Vec<usize> = (0..FRAMES).step_by(2).collect();
        let straight = local(&Rotation3::identity(), 1.0, &learn);
        let turned = local(&Rotation3::from_scaled_axis(Vector3::new(0.8, -1.1, 0.4)), 1.0, &learn);
        let near = Part::Near { neighbours: 3, poses: 12, turn: false };
        let bumps = Part::Bumps { neighbours: 3, poses: 12, lag: 8 };
        for part in [Part::Place(4), Part::Products(3), Part::Velocity(4, 8), Part::Acceleration(2, 4), near, bumps] {
            let products = |local: &Local| {
                let (features, learned) = Features::new(local, &[Part::Place(1), part], &learn);
                let table = features.table(&(0..FRAMES).collect::<Vec<_>>());
                for (k, &t) in learn.iter().enumerate() {
                    assert!((table.column(t) - learned.column(k)).amax() < 1e-9, "{part:?}: frame {t} is learned as something else");
                }
                table.transpose() * table
            };
            let (a, b) = (products(&straight), products(&turned));
            assert!((&a - &b).amax() < 1e-7 * a.amax(), "{part:?}: {}", (&a - &b).amax() / a.amax());
        }
    }

    #[test]
    fn what_spans_a_process_has_its_covariance() {
        let learn: Vec<usize> = (0..FRAMES).step_by(3).collect();
        let local = local(&Rotation3::identity(), 1.0, &learn);
        for (poses, turn) in [(20, false), (20, true), (7, false)] {
            let ready = Ready::new(Part::Near { neighbours: 2, poses, turn }, &local, &learn);
            let span = ready.span.as_ref().expect("a span");
            assert_eq!((span.centres.ncols(), ready.size), (poses, poses), "nothing is so near to anything else that it is left out");
            let inputs = |t: usize| {
                let mut out = Vec::new();
                ready.inputs(&local, t, &mut out);
                out
            };
            let features = |t: usize| {
                let mut out = vec![0.0; ready.size];
                ready.fill(&local, t, &mut out);
                out
            };
            let centre = |c: usize| learn.iter().copied().find(|&t| inputs(t) == span.centres.column(c).as_slice()).expect("a pose");
            for t in 0..FRAMES {
                for c in (0..poses).map(centre) {
                    let found: f64 = features(t).iter().zip(features(c)).map(|(a, b)| a * b).sum();
                    let apart: f64 = inputs(t).iter().zip(inputs(c)).map(|(a, b)| (a - b).powi(2)).sum();
                    let expected = BENT * BENT * span.width * (-0.5 * apart / span.width).exp();
                    assert!((found - expected).abs() < 1e-9 * span.width, "frames {t} and {c}: {found}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn lags_are_held_at_the_ends_and_follow_the_rate() {
        let learn: Vec<usize> = (0..FRAMES).collect();
        for scale in [0.25, 1.0, 2.0] {
            let local = local(&Rotation3::identity(), scale, &learn);
            let (lag, last) = ((8.0 * scale) as usize, FRAMES - 1);
            for (part, shares) in [(Part::Velocity(4, 8), [-0.5, 0.0, 0.5]), (Part::Acceleration(4, 8), [1.0, -2.0, 1.0])] {
                let ready = Ready::new(part, &local, &learn);
                for (t, before, after) in [(0, 0, lag), (1, 0, 1 + lag), (30, 30 - lag, 30 + lag), (last, last - lag, last)] {
                    let mut found = vec![0.0; 12];
                    ready.fill(&local, t, &mut found);
                    for (k, found) in found.iter().enumerate() {
                        let expected: f64 = [before, t, after].iter().zip(shares).map(|(&t, share)| share * local.at(t, 4)[k]).sum();
                        assert!((found - expected).abs() < 1e-9, "{part:?} at {scale} in frame {t}");
                    }
                }
            }
        }
    }
}
