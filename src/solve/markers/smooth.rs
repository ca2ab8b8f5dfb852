//! All frames at once: Gauss-Newton on markers, limits and accelerations.
//!
//! Done in windows that overlap, each on a core of its own. What a frame is told by another fades within a few frames, so a window's inner frames
//! do not notice its edges; memory depends on the window, not on the take; and the result does not depend on the number of cores.

use super::band::Band;
use super::{Seen, Told};
use crate::solve::ik::terms::{At, Limits, Marker};
use crate::solve::ik::{Motion, Normal, Pose, Posed, State, Term, Tree};
use rayon::prelude::*;
use std::ops::Range;

/// Frames of a window that are kept.
const INNER: usize = 384;
/// Frames on either side that are solved with them.
const MARGIN: usize = 48;
/// A step that turns nothing by more than this is the last, radians.
const SMALL: f64 = 0.35;
/// Steps that make the energy of markers so many times as large as it was ...
const AWAY_TIMES: f64 = 4.0;
/// ... and besides by so much a sample are taken back.
const AWAY: f64 = 4.0;
/// No joint turns farther in one step, radians.
const LONGEST: f64 = 0.5;
/// The weight of speeds of what is not told of, against that of accelerations: both are of the usual size then.
const SLOW: f64 = 0.3;
/// The weight of its differences from the mean pose, likewise.
const PULL: f64 = 1.0;
/// Accelerations and speeds of joints of which too little is told to measure them, radians per frame ...
const UNKNOWN_TURN: f64 = 0.02;
/// ... and cm per frame.
const UNKNOWN_SHIFT_CM: f64 = 0.5;
/// As many frames tell what is usual.
const ENOUGH: usize = 5;
/// Frames on either side that tell how fast a joint is for a while.
const AROUND: usize = 3;
/// Accelerations below this are noise, radians or centimetres per frame².
const LEAST: f64 = 1e-3;
/// Poses that tell what is usual, at most.
const MOST_LOOKED_AT: usize = 1024;
/// Times that a mean state is shifted.
const MEANS: usize = 3;
/// Joints are believed to turn at least by so much, radians.
const LEAST_SPREAD: f64 = 0.1;
/// Keeps what nobody sees and nothing holds where it is.
const STILL: f64 = 1e-6;

/// What is solved.
#[derive(Clone, Copy, Debug)]
pub(super) struct Task<'a> {
    pub tree: &'a Tree,
    pub limits: Option<&'a Limits>,
    pub markers: &'a [Marker],
    pub seen: &'a Seen,
    /// Which joints they tell of.
    pub told: &'a Told,
    /// For each marker, what its weights are multiplied by.
    pub trust: &'a [f64],
}

/// What a step found before it, and how far it went.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Stepped {
    /// The sum of squared distances of markers, times their weights.
    pub energy: f64,
    /// The sum of squared distances, cm².
    pub squares: f64,
    pub samples: usize,
    /// The largest change of any angle, radians.
    pub largest: f64,
}

impl Stepped {
    pub fn add(&mut self, weight: f64, square: f64) {
        self.energy += weight * square;
        self.squares += square;
        self.samples += 1;
    }

    /// The same step in other frames.
    fn join(&mut self, other: &Self) {
        self.energy += other.energy;
        self.squares += other.squares;
        self.samples += other.samples;
        self.largest = self.largest.max(other.largest);
    }
}

/// Steps until they are small. `strength` is the weight of accelerations of the usual size, against squared centimetres.
pub(super) fn smooth(task: &Task<'_>, poses: &[Pose], strength: f64, most: usize) -> (Vec<Pose>, Vec<Stepped>) {
    let frames = poses.len();
    if frames < 3 {
        return (poses.to_vec(), Vec::new());
    }
    let usual = Usual::new(task, poses);
    let windows: Vec<(Vec<Pose>, Vec<Stepped>)> = (0..frames.div_ceil(INNER))
        .into_par_iter()
        .map_init(
            || Memory {
                normal: Normal::new(task.tree),
                posed: Posed::new(task.tree),
                band: Band::default(),
                speeds: Vec::new(),
                squares: Vec::new(),
            },
            |memory, window| {
                let (first, last) = (window * INNER, ((window + 1) * INNER).min(frames));
                let (from, to) = (first.saturating_sub(MARGIN), (last + MARGIN).min(frames));
                let mut own = poses[from..to].to_vec();
                let inner = first - from..last - from;
                let mut steps: Vec<Stepped> = Vec::with_capacity(most);
                while steps.len() < most && steps.last().is_none_or(|step| step.largest >= SMALL) {
                    let Some(stepped) = step(task, from, &mut own, &inner, &usual, strength, memory) else { break };
                    let first = *steps.first().unwrap_or(&stepped);
                    steps.push(stepped);
                    if stepped.energy > first.energy * AWAY_TIMES + AWAY * stepped.samples as f64 {
                        // too few markers hold the body: the steps lead away from them
                        own.clone_from_slice(&poses[from..to]);
                        break;
                    }
                }
                (own.drain(inner).collect(), steps)
            },
        )
        .collect();
    let count = windows.iter().map(|(_, steps)| steps.len()).max().unwrap_or(0);
    let mut steps = vec![Stepped::default(); count];
    for (_, own) in &windows {
        for (at, step) in steps.iter_mut().enumerate() {
            match (own.get(at), own.last()) {
                (Some(found), _) => step.join(found),
                // a window that had settled is as its last step found it, nearly
                (None, Some(found)) => step.join(&Stepped { largest: 0.0, ..*found }),
                (None, None) => {}
            }
        }
    }
    (windows.into_iter().flat_map(|(poses, _)| poses).collect(), steps)
}

struct Memory {
    normal: Normal,
    posed: Posed,
    band: Band,
    speeds: Vec<f64>,
    squares: Vec<f64>,
}

/// A step of the frames from `first` on; what it finds is told of those in `inner`. `None` if there is no step.
fn step(
    task: &Task<'_>,
    first: usize,
    poses: &mut [Pose],
    inner: &Range<usize>,
    usual: &Usual,
    strength: f64,
    memory: &mut Memory,
) -> Option<Stepped> {
    let mut found = Stepped::default();
    let Memory { normal, posed, band, speeds, squares } = memory;
    let tree = task.tree;
    let (n, frames) = (tree.freedom(), poses.len());
    band.clear(n, frames);
    for (frame, pose) in poses.iter().enumerate() {
        posed.set(tree, pose);
        normal.clear();
        for (marker, x, weight) in task.seen.frame(first + frame) {
            let part = task.markers[marker].part;
            let place = posed.parts[part].point(&task.markers[marker].place());
            let off = place - x;
            if inner.contains(&frame) {
                found.add(weight, off.norm_squared());
            }
            normal.blocks[part].point(&place, weight * task.trust[marker], &off);
        }
        if let Some(limits) = task.limits {
            limits.add(&At { tree, pose, posed }, normal);
        }
        normal.gather(tree, posed);
        band.set(frame, normal.matrix());
        for (dof, gradient) in normal.gradient().iter().enumerate() {
            band.couple(frame, dof, 0, STILL);
            band.right[frame * n + dof] = -gradient;
        }
    }
    find_speeds(tree, poses, speeds);
    let joints = tree.joints();
    squares.clear();
    for frame in 1..frames.max(1) - 1 {
        squares.extend((0..joints).map(|joint| square(tree, speeds, frame, joint)));
    }
    for frame in 1..frames.max(1) - 1 {
        for (joint, usual) in usual.accelerations.iter().enumerate() {
            // a heavy tail: where a joint is much faster than usual for a while, that is no noise
            let weight = strength / (usual * usual + around(squares, joints, frame - 1, joint));
            for dof in tree.own(joint) {
                let acceleration = speeds[frame * n + dof] - speeds[(frame - 1) * n + dof];
                for (at, factor) in [(frame - 1, 1.0), (frame, -2.0), (frame + 1, 1.0)] {
                    band.couple(at, dof, 0, weight * factor * factor);
                    band.right[at * n + dof] -= weight * factor * acceleration;
                }
                band.couple(frame - 1, dof, 1, -2.0 * weight);
                band.couple(frame, dof, 1, -2.0 * weight);
                band.couple(frame - 1, dof, 2, weight);
            }
        }
    }
    come_to_rest(task, first, poses, usual, strength, speeds, band);
    if !band.solve() {
        return None;
    }
    found.largest = 0.0;
    for (pose, step) in poses.iter_mut().zip(band.right.chunks_exact_mut(n)) {
        for (joint, link) in tree.links.iter().enumerate().filter(|(_, link)| link.motion != Motion::Translate) {
            let own = &mut step[link.first..][..tree.own(joint).len()];
            found.largest = own.iter().fold(found.largest, |largest, x| f64::max(largest, x.abs()));
            // far away from here the equations do not hold
            let length = own.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length > LONGEST {
                for x in own {
                    *x *= LONGEST / length;
                }
            }
        }
        pose.update(tree, step, 1.0);
    }
    Some(found)
}

/// What is not told of comes to rest, and goes to where its joint is in the mean: else it would go on turning for ever.
fn come_to_rest(task: &Task<'_>, first: usize, poses: &[Pose], usual: &Usual, strength: f64, speeds: &[f64], band: &mut Band) {
    let tree = task.tree;
    let n = tree.freedom();
    let mut off = [0.0; 3];
    for joint in 0..tree.joints() {
        let own = tree.own(joint);
        let off = &mut off[..own.len()];
        let (within, whole) = (tree.turns_within(joint), Some(joint) == tree.whole());
        let resting = strength * SLOW / usual.speeds[joint].powi(2);
        let pulling = strength * PULL / usual.spreads[joint].powi(2);
        for (frame, pose) in poses.iter().enumerate() {
            let told = if whole { task.told.firmly(first + frame, joint) } else { task.told.of(first + frame, joint) };
            if told {
                continue;
            }
            if within {
                pose.0[joint].since(&usual.rest.0[joint], off);
                for (dof, off) in own.clone().zip(&*off) {
                    band.couple(frame, dof, 0, pulling);
                    band.right[frame * n + dof] -= pulling * off;
                }
            }
            for from in [frame.checked_sub(1), Some(frame)].into_iter().flatten().filter(|from| from + 1 < poses.len()) {
                for dof in own.clone() {
                    let speed = speeds[from * n + dof];
                    band.couple(from, dof, 0, resting);
                    band.couple(from + 1, dof, 0, resting);
                    band.couple(from, dof, 1, -resting);
                    band.right[from * n + dof] += resting * speed;
                    band.right[(from + 1) * n + dof] -= resting * speed;
                }
            }
        }
    }
}

/// What leads from each frame to the next.
fn find_speeds(tree: &Tree, poses: &[Pose], speeds: &mut Vec<f64>) {
    let n = tree.freedom();
    speeds.clear();
    speeds.resize(poses.len().saturating_sub(1) * n, 0.0);
    for (speed, pair) in speeds.chunks_exact_mut(n).zip(poses.windows(2)) {
        pair[1].since(tree, &pair[0], speed);
    }
}

/// The mean square of the acceleration of a joint's degrees of freedom.
fn square(tree: &Tree, speeds: &[f64], frame: usize, joint: usize) -> f64 {
    let n = tree.freedom();
    let own = tree.own(joint);
    let count = own.len() as f64;
    own.map(|dof| (speeds[frame * n + dof] - speeds[(frame - 1) * n + dof]).powi(2)).sum::<f64>() / count
}

/// The median of a joint's squares around a frame: one frame that is off shows in the accelerations of three.
fn around(squares: &[f64], joints: usize, at: usize, joint: usize) -> f64 {
    let frames = squares.len() / joints;
    let mut sorted = [0.0; 2 * AROUND + 1];
    let (first, last) = (at.saturating_sub(AROUND), (at + AROUND + 1).min(frames));
    let sorted = &mut sorted[..last - first];
    for (to, frame) in sorted.iter_mut().zip(first..last) {
        *to = squares[frame * joints + joint];
    }
    let middle = sorted.len() / 2;
    *sorted.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// What is usual for each joint, in the frames in which it is told of.
struct Usual {
    /// The median of its accelerations.
    accelerations: Vec<f64>,
    /// The root mean square of its speeds.
    speeds: Vec<f64>,
    /// Its mean state.
    rest: Pose,
    /// The root mean square of its differences from that.
    spreads: Vec<f64>,
}

impl Usual {
    fn new(task: &Task<'_>, poses: &[Pose]) -> Self {
        let (tree, told) = (task.tree, task.told);
        let n = tree.freedom();
        let mut speeds = Vec::new();
        find_speeds(tree, poses, &mut speeds);
        let every = poses.len().div_ceil(MOST_LOOKED_AT);
        let of_joint = |joint: usize| {
            let width = tree.own(joint).len() as f64;
            let measure = |known: &dyn Fn(usize) -> bool| {
                let inner = (1..poses.len() - 1).filter(|&frame| known(frame - 1) && known(frame) && known(frame + 1));
                let mut sizes: Vec<f64> = inner.map(|frame| square(tree, &speeds, frame, joint).sqrt()).collect();
                if sizes.len() < ENOUGH {
                    return None;
                }
                let middle = sizes.len() / 2;
                let acceleration = sizes.select_nth_unstable_by(middle, f64::total_cmp).1.max(LEAST);
                let (mut squares, mut count) = (0.0, 0.0);
                for frame in (1..poses.len()).filter(|&frame| known(frame - 1) && known(frame)) {
                    squares += tree.own(joint).map(|dof| speeds[(frame - 1) * n + dof].powi(2)).sum::<f64>() / width;
                    count += 1.0;
                }
                Some((acceleration, f64::sqrt(squares / count).max(acceleration)))
            };
            let found = measure(&|frame| told.firmly(frame, joint));
            // how the body turns as a whole is not seen from markers that do not tell it
            let found = if Some(joint) == tree.whole() { found } else { found.or_else(|| measure(&|frame| told.of(frame, joint))) };
            let unknown = if tree.links[joint].motion == Motion::Translate { UNKNOWN_SHIFT_CM } else { UNKNOWN_TURN };
            let (acceleration, speed) = found.unwrap_or((unknown, unknown));
            let known = (0..poses.len()).step_by(every).filter(|&frame| told.of(frame, joint));
            let (rest, spread) = rest(tree, joint, &known.map(|frame| &poses[frame]));
            (acceleration, speed, rest, spread)
        };
        let all: Vec<(f64, f64, State, f64)> = (0..tree.joints()).into_par_iter().map(of_joint).collect();
        Self {
            accelerations: all.iter().map(|x| x.0).collect(),
            speeds: all.iter().map(|x| x.1).collect(),
            rest: Pose(all.iter().map(|x| x.2).collect()),
            spreads: all.iter().map(|x| x.3).collect(),
        }
    }
}

/// The mean of a joint's states, and the root mean square of the differences from it.
fn rest<'a>(tree: &Tree, joint: usize, poses: &(impl Iterator<Item = &'a Pose> + Clone)) -> (State, f64) {
    let mut mean = Pose::reference(tree).0[joint];
    let mut off = [0.0; 3];
    let width = tree.own(joint).len();
    let off = &mut off[..width];
    let mut spread = 0.0;
    for _ in 0..MEANS {
        let (mut sum, mut squares, mut count) = ([0.0; 3], 0.0, 0.0);
        for pose in poses.clone() {
            pose.0[joint].since(&mean, off);
            for (to, from) in sum.iter_mut().zip(&*off) {
                *to += from;
            }
            squares += off.iter().map(|x| x * x).sum::<f64>() / width as f64;
            count += 1.0;
        }
        if count == 0.0 {
            break;
        }
        let shift = sum.map(|x| x / count);
        spread = squares / count - shift.iter().map(|x| x * x).sum::<f64>() / width as f64;
        mean = mean.updated(&shift[..width]);
    }
    (mean, spread.max(0.0).sqrt().max(LEAST_SPREAD))
}
