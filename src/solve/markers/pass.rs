//! Frame by frame.

use super::begin::placed;
use super::smooth::{Stepped, Task, smooth};
use crate::solve::ik::gauss_newton::Rules;
use crate::solve::ik::terms::{At, Limits, Marker, Markers};
use crate::solve::ik::{GaussNewton, Pose, Posed, Term, Tree, Vec3};
use rayon::prelude::*;

/// Where markers were seen.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Number of frames.
    pub frames: usize,
    /// Number of markers.
    pub markers: usize,
    /// For each frame and marker its place, cm; NaN where it was not seen.
    pub places: Vec<Vec3>,
    /// For each frame and marker, the weight of its squared distance, 1/cm².
    pub weights: Vec<f64>,
}

impl Seen {
    /// The markers of a frame that were seen and count.
    pub fn frame(&self, frame: usize) -> impl Iterator<Item = (usize, &Vec3, f64)> {
        let range = frame * self.markers..(frame + 1) * self.markers;
        let weights = self.weights[range.clone()].iter();
        self.places[range]
            .iter()
            .zip(weights)
            .enumerate()
            .filter(|(_, (x, w))| x.x.is_finite() && **w > 0.0)
            .map(|(at, (x, w))| (at, x, *w))
    }
}

/// How motions are solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The weight of accelerations, against squared centimetres: 0 leaves every frame by itself.
    pub smooth: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { smooth: 0.4 }
    }
}

/// A motion.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The pose of every frame.
    pub poses: Vec<Pose>,
    /// How it came about, in order.
    pub rounds: Vec<Round>,
}

/// What a round is there for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Every frame by itself.
    Frames,
    /// All frames, with accelerations held strongly.
    Settling,
    /// All frames, once it is known which markers can be trusted.
    Trusting,
}

impl Stage {
    /// One word, for records.
    pub fn word(self) -> &'static str {
        match self {
            Self::Frames => "frames",
            Self::Settling => "settling",
            Self::Trusting => "trusting",
        }
    }
}

/// What a pass over all frames came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// What it was there for.
    pub stage: Stage,
    /// The sum of the squared distances of markers from their places, times their weights, after it.
    pub energy: f64,
    /// The root mean square of the distances, cm; NaN if nothing was seen.
    pub rms_cm: f64,
    /// The largest change of a degree of freedom, radians or cm; NaN for the first one, which had nothing to change.
    pub largest_change: f64,
}

/// How strongly a step is held back, for what markers do not say.
const HOLD: f64 = 25.0;
/// The weight of limits.
pub(super) const LIMIT: f64 = 1e3;

/// Solves for the motion in which `markers` are where they were seen.
pub fn solve(tree: &Tree, limits: Option<&Limits>, markers: &[Marker], seen: &Seen, settings: &Settings) -> Solution {
    let limits = limits.map(|limits| {
        let mut limits = limits.clone();
        for (.., weight) in &mut limits.bounds {
            *weight = LIMIT;
        }
        limits
    });
    let mut poses = pass(tree, limits.as_ref(), markers, seen);
    // what each step found before it is what the round before it came to
    let mut found: Vec<(Stage, Stepped)> = Vec::new();
    if settings.smooth > 0.0 {
        let mut task = Task { tree, limits: limits.as_ref(), markers, seen, trust: &vec![1.0; seen.markers] };
        let mut steps;
        (poses, steps) = smooth(&task, &poses, SETTLING * settings.smooth, 6);
        found.extend(steps.drain(..).map(|step| (Stage::Settling, step)));
        let trust = trust(tree, markers, seen, &poses);
        task.trust = &trust;
        (poses, steps) = smooth(&task, &poses, TRUSTING * settings.smooth, 4);
        found.extend(steps.drain(..).map(|step| (Stage::Trusting, step)));
    }
    let last = last(tree, markers, seen, &poses);
    let befores = found.iter().map(|(_, step)| step).chain([&last]);
    let stages = [(Stage::Frames, f64::NAN)].into_iter().chain(found.iter().map(|(stage, step)| (*stage, step.largest)));
    let round = |((stage, largest_change), step): ((Stage, f64), &Stepped)| {
        let rms_cm = (step.squares / step.samples as f64).sqrt();
        Round { stage, energy: step.energy, rms_cm, largest_change }
    };
    let rounds = stages.zip(befores).map(round).collect();
    Solution { poses, rounds }
}

/// What is left of the markers in the end.
fn last(tree: &Tree, markers: &[Marker], seen: &Seen, poses: &[Pose]) -> Stepped {
    let mut posed = Posed::new(tree);
    let mut left = Stepped::default();
    for (frame, pose) in poses.iter().enumerate() {
        posed.set(tree, pose);
        for (at, x, weight) in seen.frame(frame) {
            left.add(weight, (posed.parts[markers[at].part].point(&markers[at].place()) - x).norm_squared());
        }
    }
    left
}

/// Frames of one task: it follows from the take, so that poses do not depend on the number of cores.
fn chunk(frames: usize) -> usize {
    (frames / 4).clamp(32, 256)
}

/// Every frame by itself, starting where the one before ended.
fn pass(tree: &Tree, limits: Option<&Limits>, markers: &[Marker], seen: &Seen) -> Vec<Pose> {
    let frames: Vec<usize> = (0..seen.frames).collect();
    let size = chunk(seen.frames);
    // All chunks at once, each from the reference pose ...
    let mut chunks: Vec<Vec<Pose>> = frames
        .par_chunks(size)
        .map_init(
            || Frame::new(tree, limits, markers),
            |frame, chunk| {
                let mut poses: Vec<Pose> = Vec::with_capacity(chunk.len());
                for &at in chunk {
                    let pose = poses.last().cloned();
                    poses.push(frame.solve(seen, at, pose).0);
                }
                poses
            },
        )
        .collect();
    // ... and once more where the end of the chunk before would have been a better start.
    let mut frame = Frame::new(tree, limits, markers);
    for chunk in 1..chunks.len() {
        let mut last = chunks[chunk - 1].last().cloned();
        for at in 0..chunks[chunk].len() {
            let own = frame.energy(seen, chunk * size + at, &chunks[chunk][at]);
            let (pose, energy) = frame.solve(seen, chunk * size + at, last.take());
            if own <= CLEARLY * energy || (own - energy).abs() <= SAME * energy {
                break;
            }
            chunks[chunk][at].clone_from(&pose);
            last = Some(pose);
        }
    }
    chunks.into_iter().flatten().collect()
}

/// Energies that differ by less than this share are those of one pose.
const SAME: f64 = 0.01;
/// A pose whose energy is below this share of another's is clearly better.
const CLEARLY: f64 = 0.8;

/// Solves frames by themselves, in the same memory.
struct Frame<'a> {
    tree: &'a Tree,
    limits: Option<&'a Limits>,
    markers: &'a [Marker],
    solver: GaussNewton,
    seen: Markers,
    posed: Posed,
}

impl<'a> Frame<'a> {
    fn new(tree: &'a Tree, limits: Option<&'a Limits>, markers: &'a [Marker]) -> Self {
        Self { tree, limits, markers, solver: GaussNewton::new(tree), seen: Markers::default(), posed: Posed::new(tree) }
    }

    fn look(&mut self, seen: &Seen, frame: usize) {
        self.seen.seen.clear();
        self.seen.seen.extend(seen.frame(frame).map(|(at, x, weight)| (self.markers[at], *x, weight)));
    }

    /// The pose and its energy.
    fn solve(&mut self, seen: &Seen, frame: usize, before: Option<Pose>) -> (Pose, f64) {
        self.look(seen, frame);
        let (mut pose, rules) = match before {
            // what markers do not say stays where it was
            Some(pose) => (pose, Rules { iterations: 4, damping: HOLD, tolerance: 1e-3, ..Rules::default() }),
            None => (
                placed(self.tree, &self.seen.seen.iter().map(|(marker, x, _)| (marker.place(), *x)).collect::<Vec<_>>()),
                Rules { iterations: 60, marquardt: 1e-3, ..Rules::default() },
            ),
        };
        let solved = match self.limits {
            Some(limits) => self.solver.solve(self.tree, &[&self.seen, limits], &mut pose, &rules),
            None => self.solver.solve(self.tree, &[&self.seen], &mut pose, &rules),
        };
        (pose, solved.energy)
    }

    fn energy(&mut self, seen: &Seen, frame: usize, pose: &Pose) -> f64 {
        self.look(seen, frame);
        self.posed.set(self.tree, pose);
        let at = At { tree: self.tree, pose, posed: &self.posed };
        self.seen.energy(&at) + self.limits.map_or(0.0, |limits| limits.energy(&at))
    }
}

/// How strongly accelerations are held at first: what markers do not hold is carried to where its neighbours in time are.
const SETTLING: f64 = 30.0;
/// The same once it is known which markers can be trusted.
const TRUSTING: f64 = 0.25;
/// The variance that every marker has, against the mean of all.
const COMMON: f64 = 0.5;

/// What the weight of each marker should be multiplied by: skin moves more here than there.
fn trust(tree: &Tree, markers: &[Marker], seen: &Seen, poses: &[Pose]) -> Vec<f64> {
    let mut posed = Posed::new(tree);
    let mut sums = vec![(0.0, 0.0); seen.markers];
    for (frame, pose) in poses.iter().enumerate() {
        posed.set(tree, pose);
        for (at, x, _) in seen.frame(frame) {
            let off = posed.parts[markers[at].part].point(&markers[at].place()) - x;
            sums[at].0 += off.norm_squared();
            sums[at].1 += 1.0;
        }
    }
    let variances: Vec<f64> = sums.iter().map(|(sum, count)| if *count > 0.0 { sum / count } else { 0.0 }).collect();
    let mean = (variances.iter().sum::<f64>() / seen.markers.max(1) as f64).max(1e-12);
    variances.iter().map(|variance| mean * (1.0 + COMMON) / (variance + COMMON * mean)).collect()
}
