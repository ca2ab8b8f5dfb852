//! From frame to frame.

use super::body::Body;
use super::coverage::{Beside, coverage};
use super::expect::{Cloud, Expectation, Mixture};
use super::nearest::{Boxes, Nearest};
use super::record::{Round, Tracked, Way};
use super::search::{Cost, Limb, cost, left_over, limbs, reach};
use super::settings::{Method, Settings};
use super::usual::{Usual, nowhere};
use crate::solve::ik::terms::{At, Limits, Planes, Points, Pull};
use crate::solve::ik::{Normal, Pose, Posed, State, Term, Vec3};
use std::sync::Arc;

/// A part of the surface is covered where points of the cloud are nearer than this, cm.
const BESIDE_CM: f64 = 3.0;
/// The weight of limits where the data say nothing.
const LEAST_LIMIT: f64 = 1e3;
/// The largest sigma that residuals may lead to with [`Method::Report`], cm.
const LARGEST_SIGMA_CM: f64 = 8.0;
/// Sigma falls at least to this share of itself from round to round, and to how far joints still move.
const SHRINK: f64 = 0.7;
/// A round that moves no joint farther than this is the last, cm.
const STILL_CM: f64 = 0.06;
/// While sigma is larger than this, about [`COARSE_POINTS`] points are enough, cm.
const COARSE_CM: f64 = 1.5;
/// How many.
const COARSE_POINTS: usize = 700;
/// Sigma at the beginning where a body that was lost is looked for, cm.
const WIDE_CM: f64 = 14.0;
/// Sigma at the beginning where a limb has been laid on points that nothing explains, cm.
const REACH_CM: f64 = 3.0;
/// How many ways to lay a limb are followed up.
const TRIED: usize = 4;
/// How often all missing limbs are gone through.
const SEARCHES: usize = 2;
/// A search that found nothing is repeated after twice as many frames as before, at most this many.
const MOST_REST: usize = 3;
/// Frames in which something is lost wait for a frame in which it is found, at most this many ...
const HELD: usize = 60;
/// ... with this many points in all.
const HELD_POINTS: usize = 1_000_000;
/// The first frames wait for each other: if one of them is somewhere else than expected, it may know better than those before it.
const FIRST: usize = 10;
/// Somewhere else is this far, cm.
const JUMP_CM: f64 = 12.0;
/// So many frames in a row have to be nowhere near before a body is looked for where the points are: what comes near by itself is found more surely.
const NOWHERE: usize = 3;
/// A body is looked for where the points are if their middle is this far from its own, cm.
const ELSEWHERE_CM: f64 = 20.0;
/// Normals are judged by a cloud if this share of it is where the body is.
const TELLING: f64 = 0.3;
/// Another explanation of a cloud is taken if its cost is below this share of the present one's.
const CLEARLY: f64 = 0.93;

/// Follows a body through a sequence of clouds. What was pushed comes out in the same order, sometimes later.
pub struct Tracker<'a> {
    body: &'a Body,
    nearest: Box<dyn Nearest + 'a>,
    limits: Option<Limits>,
    settings: Settings,
    /// The pose of the last frame, and that of the frame before.
    last: Pose,
    before: Option<Pose>,
    /// Frames without a cloud since then.
    dark: usize,
    /// Frames that wait because something is lost in them, or nothing yet.
    held: Vec<Tracked>,
    /// What was lost in the last frame.
    lost: Vec<bool>,
    /// Clouds so far, and whether some joint was far from where it was expected in the last one.
    clouds: usize,
    jumped: bool,
    /// Frames in a row that the body was nowhere near.
    nowhere: usize,
    /// True if the normals of the clouds point inwards; absent as long as no cloud has told.
    turned: Option<bool>,
    /// Limbs that were missing when a search last found nothing; frames until the next one, and until the one after that.
    sought: Vec<bool>,
    rest: usize,
    patience: usize,
    limbs: Vec<Limb>,
    usual: Usual,
    fit: Fit,
}

/// The memory of fits.
struct Fit {
    posed: Posed,
    normal: Normal,
    expectation: Expectation,
    step: Vec<f64>,
}

impl<'a> Tracker<'a> {
    /// Begins at `start`, which is the pose of the frame before the first.
    pub fn new(body: &'a Body, limits: Option<&Limits>, start: Pose, settings: Settings) -> Self {
        Self::with(body, Box::new(Boxes::new(body)), limits, start, settings)
    }

    /// The same with another way to find nearest vertices.
    pub fn with(body: &'a Body, nearest: Box<dyn Nearest + 'a>, limits: Option<&Limits>, start: Pose, settings: Settings) -> Self {
        let tree = &body.tree;
        let fit = Fit {
            posed: Posed::new(tree),
            normal: Normal::new(tree),
            expectation: Expectation::default(),
            step: vec![0.0; tree.freedom()],
        };
        Self {
            body,
            nearest,
            limits: limits.cloned(),
            settings,
            last: start,
            before: None,
            dark: 0,
            held: Vec::new(),
            lost: vec![false; tree.joints()],
            clouds: 0,
            jumped: false,
            nowhere: 0,
            turned: None,
            sought: Vec::new(),
            rest: 0,
            patience: 0,
            limbs: limbs(body),
            usual: Usual::default(),
            fit,
        }
    }

    /// The next frame; `None` if there is no cloud of it. Returns the frames that are done, in order. Some wait for later ones, which say more about
    /// them than earlier ones do: frames without a cloud for the next one that has one, and frames in which something is lost until it is found.
    pub fn push(&mut self, cloud: Option<Cloud>) -> Vec<Tracked> {
        let Some(mut cloud) = cloud.filter(|cloud| !cloud.points.is_empty()) else {
            self.dark += 1;
            return Vec::new();
        };
        if self.turned.is_none() {
            self.turned = self.inwards(&cloud);
        }
        if self.turned == Some(true) {
            for normal in &mut cloud.normals {
                *normal = -*normal;
            }
        }
        let dark = std::mem::take(&mut self.dark);
        if dark > 0 {
            // nobody knows how the motion went on
            self.before = None;
        }
        let sigma_cm = (self.settings.sigma0_cm * (dark + 1) as f64).min(WIDE_CM.max(self.settings.sigma0_cm));
        self.clouds += 1;
        let tracked = self.frame(&Arc::new(cloud), sigma_cm);
        let mut motion = vec![0.0; self.body.tree.freedom()];
        tracked.pose.since(&self.body.tree, &self.last, &mut motion);
        for frame in 1..=dark {
            let between = self.between(&motion, frame as f64 / (dark + 1) as f64, &tracked.lost);
            self.held.push(between);
        }
        let last = std::mem::replace(&mut self.last, tracked.pose.clone());
        self.before = (dark == 0).then_some(last);
        self.held.push(tracked);
        if self.settings.method == Method::Planes {
            self.go_back();
        }
        self.release()
    }

    /// The frames that are still kept back: those without a cloud at the end stay where the body was last.
    pub fn finish(&mut self) -> Vec<Tracked> {
        let still = vec![0.0; self.body.tree.freedom()];
        let lost = self.held.last().map_or_else(|| self.lost.clone(), |last| last.lost.clone());
        let dark = (0..std::mem::take(&mut self.dark)).map(|_| self.between(&still, 0.0, &lost));
        let dark: Vec<Tracked> = dark.collect();
        self.held.drain(..).chain(dark).collect()
    }

    /// True if the normals of the clouds point inwards. They are turned around before a frame is followed.
    pub fn turned(&self) -> bool {
        self.turned == Some(true)
    }

    /// Whether normals of a cloud point inwards: whether the body where it was explains clearly more of it that way. `None` if that tells nothing.
    fn inwards(&mut self, cloud: &Cloud) -> Option<bool> {
        self.fit.posed.set(&self.body.tree, &self.last);
        let explained = |cloud: &Cloud| {
            let left = left_over(self.body, self.nearest.as_ref(), cloud, &self.fit.posed.parts, self.settings.cosine, |_| true);
            1.0 - left.points.len() as f64 / cloud.points.len() as f64
        };
        let turned = Cloud { points: cloud.points.clone(), normals: cloud.normals.iter().map(|normal| -normal).collect() };
        let (as_it_is, turned) = (explained(cloud), explained(&turned));
        (as_it_is.max(turned) > TELLING).then_some(turned > 2.0 * as_it_is)
    }

    /// Takes from the frames that wait those that have no reason to, or would be too many.
    fn release(&mut self) -> Vec<Tracked> {
        let wait = self.clouds < FIRST || self.held.last().is_some_and(|last| last.lost.contains(&true));
        let done = if self.settings.method == Method::Planes && wait {
            let points = |frame: &Tracked| frame.cloud.as_ref().map_or(0, |cloud| cloud.points.len());
            let mut room = HELD_POINTS;
            let kept = self.held.iter().rev().take(HELD).take_while(|frame| {
                let fits = points(frame) <= room;
                room = room.saturating_sub(points(frame));
                fits
            });
            self.held.len() - kept.count()
        } else {
            self.held.len()
        };
        self.lost = self.held.last().map_or_else(|| self.lost.clone(), |last| last.lost.clone());
        self.held.drain(..done).collect()
    }

    /// Where the last frame has found what was lost in those before it, they are followed backwards from there, as long as that explains them better.
    fn go_back(&mut self) {
        let Some((now, earlier)) = self.held.split_last() else { return };
        let jumped = self.jumped && self.clouds <= FIRST;
        let found = |frame: &Tracked| jumped || frame.lost.iter().zip(&now.lost).any(|(then, now)| *then && !*now);
        let from = earlier.iter().rposition(|frame| !found(frame) || frame.cloud.is_none()).map_or(0, |at| at + 1);
        let (last, before) = (self.last.clone(), self.before.take());
        let mut back = earlier.len();
        while back > from {
            let Some(cloud) = self.held[back - 1].cloud.clone() else { break };
            let expected = self.expected();
            let mut other = self.follow(expected.clone(), &expected, &cloud, self.settings.sigma0_cm);
            if !self.cost(&other, &cloud).below(1.0, &self.cost(&self.held[back - 1], &cloud)) {
                break;
            }
            back -= 1;
            other.lost = self.usual.lost(&other, &self.limbs);
            self.before = Some(std::mem::replace(&mut self.last, other.pose.clone()));
            self.held[back] = Tracked { way: Way::Searched, ..other };
        }
        self.last = last;
        self.before = before;
        if back + 1 < self.held.len() {
            self.before = Some(self.held[self.held.len() - 2].pose.clone());
        }
    }

    /// Where motion leads.
    fn expected(&self) -> Pose {
        let tree = &self.body.tree;
        let mut pose = self.last.clone();
        if let Some(before) = &self.before {
            let mut motion = vec![0.0; tree.freedom()];
            self.last.since(tree, before, &mut motion);
            pose.update(tree, &motion, self.settings.prediction);
        }
        pose
    }

    /// A frame without a cloud: a share of the motion from the last frame to the next one.
    fn between(&mut self, motion: &[f64], share: f64, lost: &[bool]) -> Tracked {
        let mut pose = self.last.clone();
        pose.update(&self.body.tree, motion, share);
        self.fit.posed.set(&self.body.tree, &pose);
        let joints = self.body.tree.joints();
        Tracked {
            pose,
            parts: self.fit.posed.parts.clone(),
            centres: self.fit.posed.centres.clone(),
            rounds: Vec::new(),
            way: Way::Predicted,
            inliers: 0.0,
            coverage: vec![f64::NAN; joints],
            residual_cm: vec![f64::NAN; joints],
            lost: lost.to_vec(),
            cloud: None,
        }
    }

    fn frame(&mut self, cloud: &Arc<Cloud>, sigma0_cm: f64) -> Tracked {
        let expected = self.expected();
        let pose = expected.clone();
        let mut tracked = self.follow(pose, &expected, cloud, sigma0_cm);
        let first = self.usual.is_empty();
        if first {
            self.usual.begin(&tracked);
        }
        if self.settings.method == Method::Planes && self.usual.troubled(&tracked, &self.limbs) {
            if self.worth_a_search(&tracked) {
                tracked = self.search(tracked, &expected, cloud);
                self.patience = if tracked.way == Way::Searched { 0 } else { (2 * self.patience + 1).min(MOST_REST) };
                self.rest = self.patience;
            }
        } else {
            (self.rest, self.patience) = (0, 0);
        }
        if first {
            self.usual.begin(&tracked);
        }
        self.fit.posed.set(&self.body.tree, &expected);
        let far = self.fit.posed.centres.iter().zip(&tracked.centres).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        self.jumped = far > JUMP_CM;
        self.nowhere = if nowhere(&tracked) { self.nowhere + 1 } else { 0 };
        tracked.lost = self.usual.lost(&tracked, &self.limbs);
        self.usual.learn(&tracked);
        tracked
    }

    /// The pose that EM leads to from `pose`.
    fn follow(&mut self, mut pose: Pose, expected: &Pose, cloud: &Arc<Cloud>, sigma0_cm: f64) -> Tracked {
        let rounds = self.rounds(&mut pose, expected, cloud, sigma0_cm);
        let (body, posed) = (self.body, &self.fit.posed);
        let beside = Beside::new(cloud, body.posed(&posed.parts), BESIDE_CM);
        let last = rounds.last();
        Tracked {
            parts: posed.parts.clone(),
            centres: posed.centres.clone(),
            way: Way::Tracked,
            inliers: last.map_or(0.0, |round| round.inliers),
            coverage: coverage(body, &posed.parts, &beside, self.settings.cosine, BESIDE_CM),
            residual_cm: last.map_or_else(Vec::new, |round| round.residual_cm.clone()),
            lost: vec![false; body.tree.joints()],
            rounds,
            pose,
            cloud: Some(Arc::clone(cloud)),
        }
    }

    /// What a tracked frame costs.
    fn cost(&self, tracked: &Tracked, cloud: &Cloud) -> Cost {
        let beside = Beside::new(cloud, self.body.posed(&tracked.parts), 5.0);
        cost(self.body, self.nearest.as_ref(), cloud, &beside, &tracked.parts, self.settings.cosine)
    }

    /// False as long as the same limbs are missing as in the last search, and that was not long ago: what nobody sees is not found by looking again.
    fn worth_a_search(&mut self, tracked: &Tracked) -> bool {
        let missing: Vec<bool> = self.limbs.iter().map(|limb| self.usual.missing(tracked, limb)).collect();
        let more = missing.iter().enumerate().any(|(limb, missing)| *missing && self.sought.get(limb) != Some(&true));
        self.rest = self.rest.saturating_sub(1);
        let worth = self.rest == 0 || more;
        if worth {
            self.sought = missing;
        }
        worth
    }

    /// Tries other ways to explain a cloud that was not explained well.
    fn search(&mut self, tracked: Tracked, expected: &Pose, cloud: &Arc<Cloud>) -> Tracked {
        let mut best = (self.cost(&tracked, cloud), tracked);
        let last = self.last.clone();
        let moved = if self.nowhere >= NOWHERE { self.where_points_are(&last, cloud).map(|pose| (pose, WIDE_CM)) } else { None };
        let starts = [(expected.clone(), WIDE_CM), (last.clone(), WIDE_CM), (last, self.settings.sigma0_cm)];
        for (start, sigma_cm) in starts.into_iter().chain(moved) {
            let other = self.follow(start.clone(), &start, cloud, sigma_cm);
            self.take(&mut best, other, cloud);
        }
        for _ in 0..SEARCHES {
            let missing: Vec<Limb> = self.limbs.iter().filter(|limb| self.usual.missing(&best.1, limb)).cloned().collect();
            let mut better = false;
            for limb in &missing {
                let others = |part: usize| !missing.iter().any(|limb| limb.joints.contains(&part));
                let cosine = self.settings.cosine;
                let left = left_over(self.body, self.nearest.as_ref(), cloud, &best.1.parts, cosine, others);
                for start in reach(self.body, limb, &best.1.pose, &left, self.limits.as_ref(), cosine, TRIED) {
                    let other = self.follow(start.clone(), &start, cloud, REACH_CM);
                    better |= self.take(&mut best, other, cloud);
                }
            }
            if !better {
                break;
            }
        }
        best.1
    }

    /// A pose shifted to where the middle of the points is, if that is elsewhere and the root shifts.
    fn where_points_are(&mut self, pose: &Pose, cloud: &Cloud) -> Option<Pose> {
        let State::Shift(shift) = *pose.0.first()? else { return None };
        self.fit.posed.set(&self.body.tree, pose);
        let off = middle(cloud.points.iter().copied()) - middle(self.body.posed(&self.fit.posed.parts));
        (off.norm() > ELSEWHERE_CM).then(|| {
            let mut pose = pose.clone();
            pose.0[0] = State::Shift(shift + off);
            pose
        })
    }

    /// Takes another explanation if it is clearly better.
    fn take(&self, best: &mut (Cost, Tracked), other: Tracked, cloud: &Cloud) -> bool {
        let cost = self.cost(&other, cloud);
        let better = cost.below(CLEARLY, &best.0);
        if better {
            *best = (cost, Tracked { way: Way::Searched, ..other });
        }
        better
    }

    /// The rounds of EM of one frame. Afterwards the forward kinematics are those of the pose.
    fn rounds(&mut self, pose: &mut Pose, expected: &Pose, cloud: &Cloud, sigma0_cm: f64) -> Vec<Round> {
        let settings = &self.settings;
        let (body, tree) = (self.body, &self.body.tree);
        let Fit { posed, normal, expectation, step } = &mut self.fit;
        let mut pull = Pull { towards: expected.clone(), weights: vec![0.0; tree.freedom()] };
        let mut rounds = Vec::with_capacity(settings.rounds as usize);
        let mut sigma_cm = sigma0_cm;
        expectation.forget(body, cloud);
        posed.set(tree, pose);
        for _ in 0..settings.rounds {
            // while sigma is large, a part of the points tells as much as all of them
            let coarse = settings.method == Method::Planes && sigma_cm > COARSE_CM;
            let every = if coarse { (cloud.points.len() / COARSE_POINTS).max(1) } else { 1 };
            let mixture = Mixture {
                sigma_cm,
                outlier: settings.outlier,
                cosine: settings.cosine,
                spacing_cm: settings.spacing_cm,
                reach: settings.reach,
            };
            expectation.step(body, self.nearest.as_ref(), cloud, &posed.parts, &mixture, every);
            let found = &expectation.found;
            let at = At { tree, pose, posed };
            normal.clear();
            match settings.method {
                Method::Planes => Planes { pairs: &found.pairs, along: settings.along }.add(&at, normal),
                Method::Report => Points { pairs: &found.pairs }.add(&at, normal),
            }
            normal.gather(tree, posed);
            if settings.pull > 0.0 {
                for (dof, weight) in pull.weights.iter_mut().enumerate() {
                    *weight = settings.pull * normal.diagonal(dof);
                }
            }
            if let Some(limits) = &mut self.limits {
                if settings.method == Method::Planes {
                    limits.weigh(tree, normal, settings.limit, LEAST_LIMIT);
                }
                limits.add(&at, normal);
            }
            if settings.pull > 0.0 {
                pull.add(&at, normal);
            }
            // what cannot be solved is left as it is: the next round sees it with another sigma
            if normal.step(|_| settings.damping, step) {
                pose.update(tree, step, 1.0);
            }
            let before = posed.centres.clone();
            posed.set(tree, pose);
            let moved_cm = before.iter().zip(&posed.centres).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            rounds.push(Round {
                log_likelihood: found.log_likelihood,
                sigma_cm,
                inliers: found.inliers,
                moved_cm,
                mass: found.mass.clone(),
                residual_cm: found.squares.iter().zip(&found.mass).map(|(square, mass)| (square / mass).sqrt()).collect(),
            });
            if settings.method == Method::Planes {
                if sigma_cm <= settings.sigma_end_cm && moved_cm < STILL_CM {
                    break;
                }
                sigma_cm = moved_cm.min(sigma_cm * SHRINK).max(settings.sigma_end_cm);
            } else {
                let (mut sum, mut weight) = (0.0, 0.0);
                for pair in &found.pairs {
                    let off = posed.parts[pair.part as usize].point(&pair.vertex) - pair.point;
                    sum += pair.weight * off.norm_squared();
                    weight += pair.weight;
                }
                if weight > 0.0 {
                    sigma_cm = (sum / (3.0 * weight)).sqrt().clamp(settings.sigma_end_cm, LARGEST_SIGMA_CM);
                }
            }
        }
        rounds
    }
}

/// The middle of points: the median of each coordinate, which some that are far away do not move.
pub fn middle(points: impl Iterator<Item = Vec3>) -> Vec3 {
    let points: Vec<Vec3> = points.collect();
    Vec3::from_fn(|k, _| {
        let mut list: Vec<f64> = points.iter().map(|x| x[k]).collect();
        let half = list.len() / 2;
        if list.is_empty() { 0.0 } else { *list.select_nth_unstable_by(half, f64::total_cmp).1 }
    })
}
