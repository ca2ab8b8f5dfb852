//! Frame by frame.

use super::smooth::{Task, smooth};
use crate::solve::ik::gauss_newton::Rules;
use crate::solve::ik::terms::{Limits, Marker, Markers, Pull};
use crate::solve::ik::{GaussNewton, Pose, Posed, State, Term, Tree, Vec3};
use nalgebra::{Matrix3, UnitQuaternion};

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
    /// The markers of a frame.
    pub fn frame(&self, frame: usize) -> impl Iterator<Item = (usize, &Vec3, f64)> {
        let range = frame * self.markers..(frame + 1) * self.markers;
        let weights = self.weights[range.clone()].iter();
        self.places[range].iter().zip(weights).enumerate().filter(|(_, (x, _))| x.x.is_finite()).map(|(at, (x, w))| (at, x, *w))
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
}

/// How strongly a frame is pulled towards the one before, for what its markers do not say.
const PULL: f64 = 1.0;
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
    let mut solver = GaussNewton::new(tree);
    let mut poses: Vec<Pose> = Vec::with_capacity(seen.frames);
    let mut term = Markers::default();
    for frame in 0..seen.frames {
        term.seen.clear();
        term.seen.extend(seen.frame(frame).map(|(at, x, weight)| (markers[at], *x, weight)));
        let first = poses.is_empty();
        let mut pose = match poses.last() {
            Some(last) => last.clone(),
            None => start(tree, &term),
        };
        let pull = Pull { towards: pose.clone(), weights: vec![PULL; tree.freedom()] };
        let mut terms: Vec<&dyn Term> = vec![&term];
        if let Some(limits) = &limits {
            terms.push(limits);
        }
        let rules = if first {
            Rules { iterations: 60, marquardt: 1e-3, ..Rules::default() }
        } else {
            terms.push(&pull);
            Rules { iterations: 4, damping: 0.0, tolerance: 1e-3, ..Rules::default() }
        };
        solver.solve(tree, &terms, &mut pose, &rules);
        poses.push(pose);
    }
    if settings.smooth > 0.0 {
        let mut task = Task { tree, limits: limits.as_ref(), markers, seen, trust: &vec![1.0; seen.markers] };
        poses = smooth(&task, &poses, &SETTLING.map(|strength| strength * settings.smooth));
        let trust = trust(tree, markers, seen, &poses);
        task.trust = &trust;
        poses = smooth(&task, &poses, &TRUSTING.map(|strength| strength * settings.smooth));
    }
    Solution { poses }
}

/// How strong accelerations are held at first, step by step: what markers do not hold is carried to where its neighbours in time are.
const SETTLING: [f64; 3] = [100.0, 10.0, 1.0];
/// The same once it is known which markers can be trusted.
const TRUSTING: [f64; 2] = [0.1, 0.1];
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

/// The reference pose, moved as a whole to where its markers are.
fn start(tree: &Tree, seen: &Markers) -> Pose {
    let mut pose = Pose::reference(tree);
    let count = seen.seen.len() as f64;
    if count < 3.0 {
        return pose;
    }
    let mean = |of: &dyn Fn(&(Marker, Vec3, f64)) -> Vec3| seen.seen.iter().map(of).sum::<Vec3>() / count;
    let (from, to) = (mean(&|(marker, ..)| marker.place()), mean(&|(_, x, _)| *x));
    let moments: Matrix3<f64> = seen.seen.iter().map(|(marker, x, _)| (x - to) * (marker.place() - from).transpose()).sum();
    let svd = moments.svd(true, true);
    let (Some(u), Some(v)) = (svd.u, svd.v_t) else { return pose };
    let mut flip = Matrix3::identity();
    flip[(2, 2)] = (u * v).determinant().signum();
    let rotation = UnitQuaternion::from_matrix(&(u * flip * v));
    // the first joints that shift and turn carry it
    let turning = tree.links.iter().position(|link| matches!(link.motion, crate::solve::ik::Motion::Ball));
    let shifting = tree.links.iter().position(|link| matches!(link.motion, crate::solve::ik::Motion::Translate));
    if let (Some(turning), Some(shifting)) = (turning, shifting) {
        let centre = tree.links[turning].centre;
        pose.0[turning] = State::Rotation(rotation);
        pose.0[shifting] = State::Shift(to + rotation * (centre - from) - centre);
    }
    pose
}
