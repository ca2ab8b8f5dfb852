//! From frame to frame.

use super::body::Body;
use super::coverage::{Beside, coverage};
use super::expect::{Cloud, Expectation, Mixture};
use super::nearest::{Boxes, Nearest};
use super::record::{Round, Tracked, Way};
use super::settings::{Method, Settings};
use crate::solve::ik::terms::{At, Limits, Planes, Points, Pull};
use crate::solve::ik::{Normal, Pose, Posed, Term};
use std::sync::Arc;

/// A part of the surface is covered where points of the cloud are nearer than this, cm.
const BESIDE_CM: f64 = 3.0;
/// The weight of limits where the data say nothing.
const LEAST_LIMIT: f64 = 1e3;
/// The largest sigma that residuals may lead to, cm.
const LARGEST_SIGMA_CM: f64 = 8.0;

/// Follows a body through a sequence of clouds. What was pushed comes out in the same order, sometimes later.
pub struct Tracker<'a> {
    body: &'a Body,
    nearest: Box<dyn Nearest + 'a>,
    limits: Option<Limits>,
    settings: Settings,
    /// The pose of the last frame, and that of the frame before.
    last: Pose,
    before: Option<Pose>,
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
        Self { body, nearest, limits: limits.cloned(), settings, last: start, before: None, fit }
    }

    /// The next frame; `None` if there is no cloud of it. Returns the frames that are done.
    pub fn push(&mut self, cloud: Option<Cloud>) -> Vec<Tracked> {
        let tracked = match cloud.filter(|cloud| !cloud.points.is_empty()) {
            Some(cloud) => self.frame(Arc::new(cloud)),
            None => self.predicted(),
        };
        self.before = Some(std::mem::replace(&mut self.last, tracked.pose.clone()));
        vec![tracked]
    }

    /// The frames that are still kept back.
    pub fn finish(&mut self) -> Vec<Tracked> {
        Vec::new()
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

    /// A frame without a cloud.
    fn predicted(&mut self) -> Tracked {
        let pose = self.expected();
        self.fit.posed.set(&self.body.tree, &pose);
        let joints = self.body.tree.joints();
        Tracked {
            pose,
            parts: self.fit.posed.parts.clone(),
            centres: self.fit.posed.centres.clone(),
            rounds: Vec::new(),
            way: Way::Predicted,
            inliers: 0.0,
            coverage: vec![0.0; joints],
            residual_cm: vec![f64::NAN; joints],
            lost: vec![false; joints],
            cloud: None,
        }
    }

    fn frame(&mut self, cloud: Arc<Cloud>) -> Tracked {
        let expected = self.expected();
        let mut pose = expected.clone();
        let rounds = self.rounds(&mut pose, &expected, &cloud);
        let (body, posed) = (self.body, &self.fit.posed);
        let beside = Beside::new(&cloud, body.posed(&posed.parts), BESIDE_CM);
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
            cloud: Some(cloud),
        }
    }

    /// The rounds of EM of one frame. Afterwards the forward kinematics are those of the pose.
    fn rounds(&mut self, pose: &mut Pose, expected: &Pose, cloud: &Cloud) -> Vec<Round> {
        let settings = &self.settings;
        let (body, tree) = (self.body, &self.body.tree);
        let Fit { posed, normal, expectation, step } = &mut self.fit;
        let mut pull = Pull { towards: expected.clone(), weights: vec![0.0; tree.freedom()] };
        let mut rounds = Vec::with_capacity(settings.rounds as usize);
        let mut sigma_cm = settings.sigma0_cm;
        expectation.forget(body, cloud);
        posed.set(tree, pose);
        for round in 0..settings.rounds {
            if settings.method == Method::Planes {
                let way = f64::from(round) / f64::from(settings.rounds.max(2) - 1);
                sigma_cm = settings.sigma0_cm * (settings.sigma_end_cm / settings.sigma0_cm).powf(way);
            }
            let mixture = Mixture {
                sigma_cm,
                outlier: settings.outlier,
                cosine: settings.cosine,
                spacing_cm: settings.spacing_cm,
                reach: settings.reach,
            };
            expectation.step(body, self.nearest.as_ref(), cloud, &posed.parts, &mixture);
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
            let moved = before.iter().zip(&posed.centres).map(|(a, b)| (a - b).norm());
            rounds.push(Round {
                log_likelihood: found.log_likelihood,
                sigma_cm,
                inliers: found.inliers,
                moved_cm: moved.fold(0.0, f64::max),
                mass: found.mass.clone(),
                residual_cm: found.squares.iter().zip(&found.mass).map(|(square, mass)| (square / mass).sqrt()).collect(),
            });
            if settings.method == Method::Report {
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
