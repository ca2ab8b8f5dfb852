//! Frame by frame.

use super::Told;
use super::begin::placed;
use super::smooth::{Stepped, Task, smooth};
use crate::solve::ik::gauss_newton::Rules;
use crate::solve::ik::terms::{At, Limits, Marker, Markers};
use crate::solve::ik::{GaussNewton, Motion, Normal, Pose, Posed, Term, Tree, Vec3};
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
/// The same for shifts: one marker is enough to tell where the body is.
const SHIFT: f64 = 0.25;
/// A frame whose markers are so far from their places is bad, cm²: it is solved again from elsewhere.
const BAD: f64 = 9.0;
/// Frames in which too little tells of a joint are bridged if they are no more than this one after the other: nothing is lost by that, since all frames
/// are solved together afterwards.
const SHORT: usize = 12;
/// The weight of limits.
pub(super) const LIMIT: f64 = 1e3;

/// Solves for the motion in which `markers` are where they were seen.
pub fn solve(tree: &Tree, limits: Option<&Limits>, markers: &[Marker], seen: &Seen, settings: &Settings) -> Solution {
    let limits = limits.map(|limits| limits.weighing(LIMIT));
    let mut told = Told::new(tree, markers, seen);
    let mut poses = pass(tree, limits.as_ref(), markers, seen);
    told.doubt(tree, markers, seen, &poses);
    bridge(tree, &told, &mut poses);
    // what each step found before it is what the round before it came to
    let mut found: Vec<(Stage, Stepped)> = Vec::new();
    if settings.smooth > 0.0 {
        let mut task = Task { tree, limits: limits.as_ref(), markers, seen, told: &told, trust: &vec![1.0; seen.markers] };
        let mut steps;
        (poses, steps) = smooth(&task, &poses, SETTLING * settings.smooth, SETTLING_STEPS);
        found.extend(steps.drain(..).map(|step| (Stage::Settling, step)));
        let trust = trust(tree, markers, seen, &poses);
        task.trust = &trust;
        (poses, steps) = smooth(&task, &poses, TRUSTING * settings.smooth, TRUSTING_STEPS);
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
                frame.begin();
                for &at in chunk {
                    let (pose, _) = frame.solve(seen, at, poses.last().cloned());
                    poses.push(pose);
                    frame.go_back(seen, at, &mut poses);
                }
                poses
            },
        )
        .collect();
    // ... and once more where the end of the chunk before would have been a better start.
    let mut frame = Frame::new(tree, limits, markers);
    for chunk in 1..chunks.len() {
        let mut last = chunks[chunk - 1].last().cloned();
        frame.begin();
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

/// What is not told of for a while turns from where it was seen last to where it is seen next, and stays where it was at the ends of the take.
fn bridge(tree: &Tree, told: &Told, poses: &mut [Pose]) {
    let mut way = [0.0; 3];
    for joint in 0..tree.joints() {
        let way = &mut way[..tree.own(joint).len()];
        for run in told.silent(joint, SHORT) {
            let state = |frame: usize| poses.get(frame).map(|pose| pose.0[joint]);
            match (run.start.checked_sub(1).and_then(state), state(run.end)) {
                (Some(before), Some(after)) => {
                    after.since(&before, way);
                    let steps = (run.len() + 1) as f64;
                    for (step, frame) in run.enumerate() {
                        let mut part = [0.0; 3];
                        let part = &mut part[..way.len()];
                        for (to, from) in part.iter_mut().zip(&*way) {
                            *to = from * (step + 1) as f64 / steps;
                        }
                        poses[frame].0[joint] = before.updated(part);
                    }
                }
                (Some(state), None) | (None, Some(state)) => run.for_each(|frame| poses[frame].0[joint] = state),
                (None, None) => {}
            }
        }
    }
}

/// Energies that differ by less than this share are those of one pose.
const SAME: f64 = 0.01;
/// A pose whose energy is below this share of another's is clearly better.
const CLEARLY: f64 = 0.8;

/// Joints from which limbs hang on the trunk.
fn tops(tree: &Tree) -> Vec<usize> {
    (0..tree.joints()).filter(|&joint| tree.links[joint].parent.is_some_and(|parent| tree.children(parent) > 1)).collect()
}

/// Holds back turns besides: an angle moves a marker by many times its own size. It has no energy, as damping has none.
struct Stay(f64);

impl Term for Stay {
    fn residuals(&self, _: &At<'_>, _: &mut Vec<f64>) {}

    fn add(&self, at: &At<'_>, normal: &mut Normal) {
        for (dof, &owner) in at.tree.owners.iter().enumerate() {
            if at.tree.links[owner].motion != Motion::Translate {
                normal.add_entry(dof, dof, self.0 * (HOLD / SHIFT - 1.0));
            }
        }
    }

    fn energy(&self, _: &At<'_>) -> f64 {
        0.0
    }
}

/// How a frame is solved that begins where another one ended.
const FOLLOW: Rules = Rules { iterations: 4, halvings: 8, damping: SHIFT, marquardt: 0.0, tolerance: 1e-3 };

/// Solves frames by themselves, in the same memory.
struct Frame<'a> {
    tree: &'a Tree,
    limits: Option<&'a Limits>,
    markers: &'a [Marker],
    solver: GaussNewton,
    seen: Markers,
    posed: Posed,
    /// Frames up to here whose markers are far from their places, one after the other ...
    bad: usize,
    /// ... how many of them there will be when limbs are tried from elsewhere ...
    next: usize,
    /// ... and how many there were before this frame, if it is good again.
    before: usize,
}

impl<'a> Frame<'a> {
    fn new(tree: &'a Tree, limits: Option<&'a Limits>, markers: &'a [Marker]) -> Self {
        Self {
            tree,
            limits,
            markers,
            solver: GaussNewton::new(tree),
            seen: Markers::default(),
            posed: Posed::new(tree),
            bad: 0,
            next: 1,
            before: 0,
        }
    }

    fn look(&mut self, seen: &Seen, frame: usize) {
        self.seen.seen.clear();
        self.seen.seen.extend(seen.frame(frame).map(|(at, x, weight)| (self.markers[at], *x, weight)));
    }

    /// The pose and its energy. Where markers are far from it, each limb is tried from the reference pose as well.
    fn solve(&mut self, seen: &Seen, frame: usize, before: Option<Pose>) -> (Pose, f64) {
        self.look(seen, frame);
        let (mut pose, rules) = match before {
            // what markers do not say stays where it was
            Some(pose) => (pose, FOLLOW),
            None => (
                placed(self.tree, &self.seen.seen.iter().map(|(marker, x, _)| (marker.place(), *x)).collect::<Vec<_>>()),
                Rules { iterations: 60, marquardt: 1e-3, damping: 1e-3, ..Rules::default() },
            ),
        };
        let mut energy = self.descend(&mut pose, &rules);
        let most = BAD * self.seen.seen.len() as f64;
        if energy > most {
            self.bad += 1;
            if self.bad >= self.next {
                self.next = 2 * self.bad;
                energy = self.try_elsewhere(&mut pose, energy);
            }
        }
        self.before = 0;
        if energy <= most && !self.seen.seen.is_empty() {
            (self.before, self.bad, self.next) = (self.bad, 0, 1);
        }
        (pose, energy)
    }

    /// Tries each limb from the reference pose: one that was not seen for a while may have turned around.
    fn try_elsewhere(&mut self, pose: &mut Pose, mut energy: f64) -> f64 {
        let reference = Pose::reference(self.tree);
        let rules = Rules { iterations: 30, marquardt: 1e-3, damping: 1e-3, ..Rules::default() };
        for top in tops(self.tree) {
            let (mut other, limb) = (pose.clone(), self.tree.behind(top));
            for joint in (top..self.tree.joints()).filter(|&joint| limb[joint]) {
                other.0[joint] = reference.0[joint];
            }
            let there = self.descend(&mut other, &rules);
            if there < CLEARLY * energy {
                energy = there;
                *pose = other;
            }
        }
        energy
    }

    /// Forgets what frames before were like.
    fn begin(&mut self) {
        (self.bad, self.next, self.before) = (0, 1, 0);
    }

    /// Where a frame is good again, those before it are solved once more, backwards from there.
    fn go_back(&mut self, seen: &Seen, last: usize, poses: &mut [Pose]) {
        let (at, count) = (poses.len() - 1, std::mem::take(&mut self.before));
        for back in 1..=count.min(at) {
            let own = self.energy(seen, last - back, &poses[at - back]);
            let mut pose = poses[at - back + 1].clone();
            let energy = self.descend(&mut pose, &FOLLOW);
            if energy >= CLEARLY * own {
                break;
            }
            poses[at - back] = pose;
        }
    }

    fn descend(&mut self, pose: &mut Pose, rules: &Rules) -> f64 {
        let stay = Stay(rules.damping);
        match self.limits {
            Some(limits) => self.solver.solve(self.tree, &[&self.seen, limits, &stay], pose, rules).energy,
            None => self.solver.solve(self.tree, &[&self.seen, &stay], pose, rules).energy,
        }
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
/// The most steps of that: takes with few gaps need one or two.
const SETTLING_STEPS: usize = 12;
/// The same once it is known which markers can be trusted.
const TRUSTING: f64 = 0.25;
/// The most steps of that.
const TRUSTING_STEPS: usize = 8;
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
