//! `skeleton`: gaps are filled from the part of the body that carries the marker.
//!
//! The pose of every frame is solved for with what is seen ([`super::markers`]). Seen from its part, a marker stays about where it sits: what it moves
//! there is its skin. That is a process without trend whose past is forgotten at a rate of the marker's own (Ornstein-Uhlenbeck), so between the edges of
//! a gap it is known best from those two samples, and the fill joins what was seen on both sides.
//!
//! How sure that is, is measured: as many samples are hidden a second time, in gaps of the same kinds, and filled, and the errors are compared with
//! what the process promises. A pose knows a part the less, the fewer of its markers are seen, so that is done by their number.
//!
//! Where nothing tells of a part, how far its joints turn elsewhere in the take within the time since they were seen tells how far off it may be.
//!
//! Markers that the body does not wear are filled by splines.

use super::auto::Explanation;
use super::ik::terms::{Limits, Marker};
use super::ik::{Motion, Pose, Posed, Tree, Vec3};
use super::interpolate::{Curve, Interpolate};
use super::markers::{Seen, Settings, Solution, Told, solve};
use super::{Estimate, Gap, Problem, Progress, SolveError, Solver};
use crate::runs::runs;
use nalgebra::Matrix3;
use std::sync::Arc;

/// A body, and where it wears markers. Lengths are in cm.
#[derive(Clone, Debug, PartialEq)]
pub struct Wearer {
    /// The skeleton.
    pub tree: Tree,
    /// Names of its joints.
    pub names: Vec<String>,
    /// How far its joints move.
    pub limits: Option<Limits>,
    /// Columns of the take, where their markers sit, and the factors of their weights.
    pub markers: Vec<(usize, Marker, f64)>,
    /// What brings a place in the take to the axes and the unit of the body: a rotation times a factor.
    pub from_take: Matrix3<f64>,
}

/// What a marker does on its part is looked at over this time, s.
const LAG_SECS: f64 = 0.1;
/// A correlation over one frame is at least this, and at most 1 less this.
const LEAST: f64 = 1e-4;
/// What is taken for the correlation over [`LAG_SECS`] where too little was seen to measure it.
const USUAL_CORRELATION: f64 = 0.7;
/// Fewer pairs of samples than this measure nothing.
const LEAST_PAIRS: usize = 20;
/// Numbers of seen markers of a part that are told apart: none, one, and more.
const CLASSES: usize = 3;
/// Standard deviation of a 3-D error that every fill has, cm: that of a good camera system.
const FLOOR_CM: f64 = 0.03;

/// Fills all gaps in one step.
pub struct Skeleton<'a> {
    problem: &'a Problem,
    wearer: Option<Arc<Wearer>>,
    estimate: Estimate,
    why: Vec<Explanation>,
}

impl<'a> Skeleton<'a> {
    /// Nothing is computed before the first step.
    pub fn new(problem: &'a Problem, wearer: Option<Arc<Wearer>>) -> Self {
        Self { problem, wearer, estimate: Estimate::open(problem.missing.len()), why: Vec::new() }
    }
}

impl Solver for Skeleton<'_> {
    fn name(&self) -> &'static str {
        "skeleton"
    }

    fn step(&mut self) -> Result<Progress, SolveError> {
        let problem = self.problem;
        let mut curves = Interpolate::new(problem, Curve::Spline);
        let mut progress = curves.step()?;
        self.estimate.clone_from(curves.estimate());
        let Some(wearer) = &self.wearer else { return Ok(progress) };
        let worn = Worn::new(problem, wearer);
        if worn.columns.is_empty() || problem.frames() == 0 {
            return Ok(progress);
        }
        let seen = worn.seen(problem);
        let Judged { scale, gaps, frames } = worn.judged(problem, &seen);
        let solution = worn.solve(&seen);
        let unseen = Unseen::new(&worn, &seen, &solution.poses);
        // a factor scales every direction alike
        let factor = wearer.from_take.column(0).norm();
        let to_take = wearer.from_take.transpose() / (factor * factor);
        progress.rms_residual_mm = solution.rounds.last().map(|round| round.rms_cm * 10.0);
        let skin = Skin::new(&worn, &seen, &solution, problem.rate_hz);
        skin.fill(&seen, &solution, |frame, at, fill| {
            if let Ok(k) = problem.missing.binary_search(&(frame, worn.columns[at])) {
                self.estimate.positions_mm[k] = (to_take * fill.place * 10.0).into();
                let variance = fill.variance * scale[fill.class] + FLOOR_CM * FLOOR_CM + unseen.variance(frame, at);
                self.estimate.sigma_mm[k] = variance.sqrt() * 10.0 / factor;
            }
        });
        if self.estimate.positions_mm.iter().flatten().any(|x| x.is_infinite()) {
            return Err(SolveError::Numerical("the pose is not finite".to_owned()));
        }
        self.why = worn.gaps(problem).map(|(at, gap)| worn.why(problem, &self.estimate, at, gap, (gaps, frames))).collect();
        Ok(progress)
    }

    fn counted(&self) -> bool {
        true
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    fn explanations(&self) -> Vec<Explanation> {
        self.why.clone()
    }
}

/// What samples that were hidden a second time say.
struct Judged {
    /// For each class, what the variances that the process promises are to be multiplied by.
    scale: [f64; CLASSES],
    /// In how many gaps they were, and how long those are in the middle; 0 if they are too few to say anything.
    gaps: usize,
    frames: usize,
}

/// The markers of a problem that a body wears.
struct Worn<'a> {
    wearer: &'a Wearer,
    /// For each of them, its column of the problem.
    columns: Vec<usize>,
    markers: Vec<Marker>,
    weights: Vec<f64>,
}

impl<'a> Worn<'a> {
    fn new(problem: &Problem, wearer: &'a Wearer) -> Self {
        let mut worn = Self { wearer, columns: Vec::new(), markers: Vec::new(), weights: Vec::new() };
        for (column, of_take) in problem.columns.iter().enumerate() {
            if let Some((_, marker, weight)) = wearer.markers.iter().find(|(at, ..)| at == of_take) {
                worn.columns.push(column);
                worn.markers.push(*marker);
                worn.weights.push(*weight);
            }
        }
        worn
    }

    fn seen(&self, problem: &Problem) -> Seen {
        let from_take = self.wearer.from_take;
        let place = |frame: usize, column: usize| {
            problem.position_mm(frame, column).map_or(Vec3::repeat(f64::NAN), |x| from_take * Vec3::from(x) / 10.0)
        };
        Seen {
            frames: problem.frames(),
            markers: self.columns.len(),
            places: (0..problem.frames()).flat_map(|frame| self.columns.iter().map(move |&column| place(frame, column))).collect(),
            weights: (0..problem.frames()).flat_map(|_| self.weights.iter().copied()).collect(),
        }
    }

    fn solve(&self, seen: &Seen) -> Solution {
        solve(&self.wearer.tree, self.wearer.limits.as_ref(), &self.markers, seen, &Settings::default())
    }

    /// Judges fills by samples that are hidden where others are missing in another half of the take.
    fn judged(&self, problem: &Problem, seen: &Seen) -> Judged {
        let (frames, markers) = (seen.frames, seen.markers);
        let mut poorer = seen.clone();
        for frame in 0..frames {
            let other = (frame + frames / 2) % frames;
            for at in 0..markers {
                if seen.places[other * markers + at].x.is_nan() {
                    poorer.places[frame * markers + at] = Vec3::repeat(f64::NAN);
                }
            }
        }
        let solution = self.solve(&poorer);
        let told = Told::new(&self.wearer.tree, &self.markers, &poorer);
        let (mut sums, mut counts) = ([(0.0, 0.0); CLASSES], [0_usize; CLASSES]);
        Skin::new(self, &poorer, &solution, problem.rate_hz).fill(&poorer, &solution, |frame, at, fill| {
            let truth = seen.places[frame * markers + at];
            // what nothing tells of has a variance of its own
            let known = told.of(frame, self.markers[at].part);
            if truth.x.is_finite() && fill.variance > 0.0 && known {
                sums[fill.class].0 += (fill.place - truth).norm_squared();
                sums[fill.class].1 += fill.variance;
                counts[fill.class] += 1;
            }
        });
        let all = sums.iter().fold((0.0, 0.0), |all: (f64, f64), sum| (all.0 + sum.0, all.1 + sum.1));
        let pooled = if counts.iter().sum::<usize>() >= LEAST_PAIRS { (all.0 / all.1).max(1.0) } else { 1.0 };
        let mut least = 0.0_f64;
        // fewer markers never make a fill surer
        let mut scale = [pooled; CLASSES];
        for class in (0..CLASSES).rev() {
            if counts[class] >= LEAST_PAIRS {
                scale[class] = sums[class].0 / sums[class].1;
            }
            least = least.max(scale[class]);
            scale[class] = least;
        }
        let hidden = |frame: usize, at: usize| {
            let [was, is] = [seen, &poorer].map(|all| all.places[frame * markers + at].x.is_finite());
            was && !is
        };
        let mut lengths: Vec<usize> =
            (0..markers).flat_map(|at| runs(frames, |frame| hidden(frame, at))).map(|(start, end)| end - start).collect();
        lengths.sort_unstable();
        if counts.iter().sum::<usize>() < LEAST_PAIRS {
            lengths.clear();
        }
        Judged { scale, gaps: lengths.len(), frames: lengths.get(lengths.len() / 2).copied().unwrap_or_default() }
    }

    /// The gaps of the markers, each with the place of its marker among them.
    fn gaps(&self, problem: &Problem) -> impl Iterator<Item = (usize, Gap)> {
        self.columns.iter().enumerate().flat_map(|(at, &marker)| {
            runs(problem.frames(), |frame| !problem.observed(frame, marker))
                .into_iter()
                .map(move |(start, end)| (at, Gap { marker, start, end }))
        })
    }

    /// Why a gap was filled as it was: from the pose of its part, which the markers tell that were seen meanwhile on that part, or on the nearest that has any.
    fn why(
        &self,
        problem: &Problem,
        estimate: &Estimate,
        at: usize,
        gap: Gap,
        (simulated, simulated_frames): (usize, usize),
    ) -> Explanation {
        let part = self.markers[at].part;
        let seen = |column: usize| (gap.start..gap.end).filter(|&frame| problem.observed(frame, column)).count();
        let mut others: Vec<(usize, usize, usize)> = self
            .columns
            .iter()
            .zip(&self.markers)
            .zip(&self.weights)
            .map(|((&column, marker), weight)| (self.apart(part, marker.part), if *weight > 0.0 { seen(column) } else { 0 }, column))
            .filter(|&(_, frames, _)| frames > 0)
            .collect();
        // the nearest first, and of these whoever was seen longest
        others.sort_by_key(|&(apart, frames, column)| (apart, usize::MAX - frames, column));
        let farthest = others.first().map_or(0, |&(apart, ..)| apart.max(1));
        let sigmas = (gap.start..gap.end)
            .filter_map(|frame| problem.missing.binary_search(&(frame, gap.marker)).ok())
            .map(|k| estimate.sigma_mm[k].powi(2));
        let pose = self.wearer.names.get(part).map_or_else(|| format!("pose of part {part}"), |name| format!("pose of {name}"));
        Explanation {
            gap,
            neighbours: others.into_iter().filter(|&(apart, ..)| apart <= farthest).map(|(.., column)| column).collect(),
            experts: vec![(pose, 1.0, f64::NAN)],
            simulated,
            simulated_frames,
            predicted_mm: (sigmas.sum::<f64>() / gap.frames() as f64).sqrt(),
        }
    }

    /// How many joints are between two parts.
    fn apart(&self, a: usize, b: usize) -> usize {
        let (mut a, mut b, mut steps) = (a, b, 0);
        while a != b {
            // parents come first, so the later one of two is not above the other
            let up = if a > b { &mut a } else { &mut b };
            *up = self.wearer.tree.links[*up].parent.unwrap_or(0);
            steps += 1;
        }
        steps
    }
}

/// A sample that was not seen.
struct Fill {
    /// Where it was, cm.
    place: Vec3,
    /// The variance that the process promises, cm².
    variance: f64,
    /// How many markers of its part were seen.
    class: usize,
}

/// How far off markers may be whose parts nothing tells of.
struct Unseen<'a> {
    worn: &'a Worn<'a>,
    told: Told,
    /// Where the joints are in every frame, and where the markers of the body are, cm; empty if everything is told of.
    centres: Vec<Vec3>,
    places: Vec<Vec3>,
    /// For each joint, by the frames since it was told of: how far it turns until then (or shifts, cm), mean square, ...
    since: Vec<Vec<f64>>,
    /// ... and how far it is then from halfway between where it was and where it will be after as many frames again.
    between: Vec<Vec<f64>>,
    /// For each frame and joint, how many frames before and after it are not told of, itself included; `None` to the end of the take.
    around: Vec<[Option<usize>; 2]>,
}

/// Pairs of frames that are compared, at most.
const COMPARED: usize = 256;
/// What is taken for the mean square of turns where nothing can be compared, radians² ...
const UNKNOWN_TURN: f64 = 0.5;
/// ... and of shifts, cm².
const UNKNOWN_SHIFT: f64 = 2500.0;

impl<'a> Unseen<'a> {
    fn new(worn: &'a Worn<'a>, seen: &Seen, poses: &[Pose]) -> Self {
        let tree = &worn.wearer.tree;
        let (frames, joints) = (seen.frames, tree.joints());
        let told = Told::new(tree, &worn.markers, seen);
        let mut unseen =
            Self { worn, told, centres: Vec::new(), places: Vec::new(), since: Vec::new(), between: Vec::new(), around: Vec::new() };
        let told = &unseen.told;
        if (0..frames).all(|frame| (0..joints).all(|joint| told.of(frame, joint))) {
            return unseen;
        }
        let mut posed = Posed::new(tree);
        for pose in poses {
            posed.set(tree, pose);
            unseen.centres.extend(&posed.centres);
            unseen.places.extend(worn.markers.iter().map(|marker| posed.parts[marker.part].point(&marker.place())));
        }
        let mut around = vec![[None; 2]; frames * joints];
        for joint in 0..joints {
            for (side, backwards) in [(0, false), (1, true)] {
                let mut count = None;
                for step in 0..frames {
                    let frame = if backwards { frames - 1 - step } else { step };
                    count = if told.of(frame, joint) { Some(0) } else { count.map(|count| count + 1) };
                    around[frame * joints + joint][side] = count;
                }
            }
        }
        let longest = (0..joints).map(|joint| {
            let of_joint = (0..frames).map(|frame| match around[frame * joints + joint] {
                [Some(before), Some(after)] => before.min(after),
                [one, other] => one.or(other).unwrap_or(0),
            });
            of_joint.max().unwrap_or(0)
        });
        for (joint, longest) in longest.collect::<Vec<_>>().into_iter().enumerate() {
            let known = |frame: usize| frame < frames && told.of(frame, joint);
            let mut update = [0.0; 3];
            let update = &mut update[..tree.own(joint).len()];
            let unknown = if tree.links[joint].motion == Motion::Translate { UNKNOWN_SHIFT } else { UNKNOWN_TURN };
            let (mut since, mut between) = (vec![0.0], vec![0.0]);
            for lag in 1..=longest {
                let mean = |squares: Vec<f64>, before: f64| {
                    let count = squares.len() as f64;
                    // what cannot be compared is no surer than after a shorter time
                    if squares.is_empty() { before.max(unknown) } else { before.max(squares.iter().sum::<f64>() / count) }
                };
                let every = frames.div_ceil(COMPARED);
                let (mut one, mut two) = (Vec::new(), Vec::new());
                for frame in (0..frames).step_by(every).filter(|&frame| known(frame) && known(frame + lag)) {
                    let (first, middle) = (poses[frame].0[joint], poses[frame + lag].0[joint]);
                    middle.since(&first, update);
                    one.push(update.iter().map(|x| x * x).sum());
                    if known(frame + 2 * lag) {
                        poses[frame + 2 * lag].0[joint].since(&first, update);
                        for x in update.iter_mut() {
                            *x *= 0.5;
                        }
                        let halfway = first.updated(update);
                        middle.since(&halfway, update);
                        two.push(update.iter().map(|x| x * x).sum());
                    }
                }
                since.push(mean(one, since[lag - 1]));
                // at most what is known from one side
                between.push(if two.is_empty() { since[lag] } else { mean(two, between[lag - 1]).min(since[lag]) });
            }
            unseen.since.push(since);
            unseen.between.push(between);
        }
        unseen.around = around;
        unseen
    }

    /// The variance of the 3-D distance of a marker, cm²: turns of all joints between it and what is told of, each with its lever.
    fn variance(&self, frame: usize, at: usize) -> f64 {
        let tree = &self.worn.wearer.tree;
        let joints = tree.joints();
        let mut variance = 0.0;
        let mut joint = Some(self.worn.markers[at].part);
        while let Some(one) = joint.filter(|&one| !self.centres.is_empty() && !self.told.of(frame, one)) {
            let turn = match self.around[frame * joints + one] {
                // halfway is a good guess where motion is as it is elsewhere, and a limb may be unseen because it is not
                [Some(before), Some(after)] => (self.between[one][before.min(after)] * self.since[one][before.min(after)]).sqrt(),
                [Some(side), None] | [None, Some(side)] => self.since[one][side],
                [None, None] if tree.links[one].motion == Motion::Translate => UNKNOWN_SHIFT,
                [None, None] => UNKNOWN_TURN,
            };
            let lever = (self.places[frame * self.worn.markers.len() + at] - self.centres[frame * joints + one]).norm_squared();
            variance += match tree.links[one].motion {
                Motion::Translate => turn,
                Motion::Revolute(_) => turn * lever,
                // a third of the turns is about the lever itself
                Motion::Ball => turn * lever * 2.0 / 3.0,
            };
            joint = tree.links[one].parent;
        }
        variance
    }
}

/// What markers do on their parts.
struct Skin<'a> {
    worn: &'a Worn<'a>,
    /// For each frame and marker, where it was seen in the axes of its part, cm; NaN where it was not.
    local: Vec<Vec3>,
    /// For each marker, its mean place there.
    means: Vec<Vec3>,
    /// For each marker, the variance of its 3-D distance from that, cm².
    variances: Vec<f64>,
    /// For each marker, the correlation from one frame to the next.
    correlations: Vec<f64>,
}

impl<'a> Skin<'a> {
    fn new(worn: &'a Worn<'a>, seen: &Seen, solution: &Solution, rate_hz: f64) -> Self {
        let (frames, markers) = (seen.frames, seen.markers);
        let mut local = vec![Vec3::repeat(f64::NAN); seen.places.len()];
        let mut posed = Posed::new(&worn.wearer.tree);
        for (frame, pose) in solution.poses.iter().enumerate() {
            posed.set(&worn.wearer.tree, pose);
            for (at, x, _) in seen.frame(frame) {
                local[frame * markers + at] = posed.parts[worn.markers[at].part].back(x);
            }
        }
        let lag = ((LAG_SECS * rate_hz).round() as usize).clamp(1, frames.max(2) - 1);
        let mut skin = Self { worn, local, means: Vec::new(), variances: Vec::new(), correlations: Vec::new() };
        for (at, marker) in worn.markers.iter().enumerate() {
            let place = |frame: usize| Some(skin.local[frame * markers + at]).filter(|x| x.x.is_finite());
            let known: Vec<Vec3> = (0..frames).filter_map(place).collect();
            let count = known.len() as f64;
            let mean = if known.is_empty() { marker.place() } else { known.iter().sum::<Vec3>() / count };
            let variance = if known.len() < 2 { 1.0 } else { known.iter().map(|x| (x - mean).norm_squared()).sum::<f64>() / count };
            let pairs: Vec<f64> = (lag..frames)
                .filter_map(|frame| Some((place(frame - lag)?, place(frame)?)))
                .map(|(before, after)| (before - mean).dot(&(after - mean)))
                .collect();
            let measured = pairs.iter().sum::<f64>() / pairs.len() as f64 / variance;
            let over_lag = if pairs.len() >= LEAST_PAIRS && measured.is_finite() { measured } else { USUAL_CORRELATION };
            skin.means.push(mean);
            skin.variances.push(variance);
            skin.correlations.push(over_lag.clamp(LEAST, 1.0).powf(1.0 / lag as f64).clamp(LEAST, 1.0 - LEAST));
        }
        skin
    }

    /// Tells of every sample that was not seen, by frame and marker.
    fn fill(&self, seen: &Seen, solution: &Solution, mut tell: impl FnMut(usize, usize, Fill)) {
        let markers = seen.markers;
        // the next frame in which each marker is seen, from every frame on: found from behind
        let mut after: Vec<Vec<Option<usize>>> = vec![vec![None; markers]; seen.frames + 1];
        for frame in (0..seen.frames).rev() {
            let (now, later) = after.split_at_mut(frame + 1);
            for at in 0..markers {
                now[frame][at] = if seen.places[frame * markers + at].x.is_finite() { Some(frame) } else { later[0][at] };
            }
        }
        let mut before: Vec<Option<usize>> = vec![None; markers];
        let mut posed = Posed::new(&self.worn.wearer.tree);
        let mut count = vec![0_usize; self.worn.wearer.tree.joints()];
        for (frame, pose) in solution.poses.iter().enumerate() {
            posed.set(&self.worn.wearer.tree, pose);
            count.fill(0);
            for (at, ..) in seen.frame(frame) {
                count[self.worn.markers[at].part] += 1;
                before[at] = Some(frame);
            }
            for at in 0..markers {
                if seen.places[frame * markers + at].x.is_finite() {
                    continue;
                }
                let (local, variance) = self.between(at, frame, before[at], after[frame][at]);
                let part = self.worn.markers[at].part;
                tell(frame, at, Fill { place: posed.parts[part].point(&local), variance, class: count[part].min(CLASSES - 1) });
            }
        }
    }

    /// Where a marker is on its part and the variance of that, given where it was seen last and next: the mean of a stationary Gaussian process whose
    /// correlation falls exponentially. Such a process forgets everything but the nearest sample on either side.
    fn between(&self, at: usize, frame: usize, before: Option<usize>, after: Option<usize>) -> (Vec3, f64) {
        let markers = self.means.len();
        let correlation = |edge: Option<usize>| edge.map_or(0.0, |edge| self.correlations[at].powf(edge.abs_diff(frame) as f64));
        let off = |edge: Option<usize>| edge.map_or(Vec3::zeros(), |edge| self.local[edge * markers + at] - self.means[at]);
        let (left, right) = (correlation(before), correlation(after));
        let rest = 1.0 - (left * right).powi(2);
        let (from_left, from_right) = (left * (1.0 - right * right) / rest, right * (1.0 - left * left) / rest);
        let place = self.means[at] + off(before) * from_left + off(after) * from_right;
        (place, self.variances[at] * (1.0 - from_left * left - from_right * right).max(0.0))
    }
}
