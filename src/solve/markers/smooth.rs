//! All frames at once: Gauss-Newton on markers, limits and accelerations.
//!
//! Done in windows that overlap, each on a core of its own. What a frame is told by another fades within a few frames, so a window's inner frames
//! do not notice its edges; memory depends on the window, not on the take; and the result does not depend on the number of cores.

use super::Seen;
use super::band::Band;
use crate::solve::ik::terms::{At, Limits, Marker};
use crate::solve::ik::{Motion, Normal, Pose, Posed, Term, Tree};
use rayon::prelude::*;
use std::ops::Range;

/// Frames of a window that are kept.
const INNER: usize = 384;
/// Frames on either side that are solved with them.
const MARGIN: usize = 48;
/// A step that turns nothing by more than this is the last, radians.
const SMALL: f64 = 0.35;
/// Frames on either side that tell how fast a joint is for a while.
const AROUND: usize = 3;
/// Accelerations below this are noise, radians or centimetres per frame².
const LEAST: f64 = 1e-3;
/// Keeps what nobody sees and nothing holds where it is.
const STILL: f64 = 1e-6;

/// What is solved.
#[derive(Clone, Copy, Debug)]
pub(super) struct Task<'a> {
    pub tree: &'a Tree,
    pub limits: Option<&'a Limits>,
    pub markers: &'a [Marker],
    pub seen: &'a Seen,
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
    let usual = usual_accelerations(task.tree, poses);
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
                    steps.push(stepped);
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
    usual: &[f64],
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
        for (joint, usual) in usual.iter().enumerate() {
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
    if !band.solve() {
        return None;
    }
    for (pose, step) in poses.iter_mut().zip(band.right.chunks_exact(n)) {
        pose.update(tree, step, 1.0);
    }
    let turns = |step: &[f64]| {
        let turning = step.iter().zip(&tree.owners).filter(|(_, owner)| tree.links[**owner].motion != Motion::Translate);
        turning.fold(0.0, |largest, (step, _)| f64::max(largest, step.abs()))
    };
    found.largest = band.right.chunks_exact(n).map(turns).fold(0.0, f64::max);
    Some(found)
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

/// For each joint, the median of its accelerations.
fn usual_accelerations(tree: &Tree, poses: &[Pose]) -> Vec<f64> {
    let mut speeds = Vec::new();
    find_speeds(tree, poses, &mut speeds);
    let joints = (0..tree.joints()).into_par_iter().map(|joint| {
        let mut sizes: Vec<f64> = (1..poses.len() - 1).map(|frame| square(tree, &speeds, frame, joint).sqrt()).collect();
        let middle = sizes.len() / 2;
        let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        median.max(LEAST)
    });
    joints.collect()
}
