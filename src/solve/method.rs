//! The methods that can be chosen, and the solvers they stand for.

use super::auto::{Auto, Explanation, Recipe, Stiffness};
use super::interpolate::{Curve, Interpolate};
use super::lds::em::Noise;
use super::lds::step::BoneStep;
use super::lds::{Constraint, EStep, Hidden, Init, Lds, Options, Start};
use super::msvd::Msvd;
use super::skeleton::{Skeleton, Wearer};
use super::{Estimate, Limits, Observer, Outcome, Problem, Solver, Stop, run};
use std::sync::Arc;

/// A way to fill gaps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Straight lines.
    Linear,
    /// Natural cubic splines.
    Spline,
    /// Singular value decomposition with missing values.
    Msvd,
    /// A linear dynamical system learned by EM (DynaMMo).
    Lds,
    /// The same with hard bone constraints (BoLeRO-HC).
    BoleroHc,
    /// The same with soft bone constraints (BoLeRO-SC).
    BoleroSc,
    /// The pose of a skeleton whose parts carry the markers.
    Skeleton,
    /// Experts of many kinds, chosen and weighed for every gap by evidence from the take itself.
    #[default]
    Auto,
}

/// What can be set about the methods.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Dimension of the hidden state; rank of `msvd`.
    pub hidden: Hidden,
    /// The paper's λ in 1/m⁴; `None` weighs each bone by the spread that it shows.
    pub lambda: Option<f64>,
    /// How missing entries enter the E-step.
    pub e_step: EStep,
    /// What is free about the noise.
    pub noise: Noise,
    /// The first fill.
    pub start: Start,
    /// The first parameters.
    pub init: Init,
    /// How the fill is made to keep the bones.
    pub step: BoneStep,
    /// True to learn a constant term, which the paper's model lacks.
    pub constant: bool,
    /// What `auto` is made of.
    pub recipe: Recipe,
    /// What bones demand of `auto`.
    pub stiffness: Stiffness,
    /// The body that wears the markers; see [`Method::needs_body`].
    pub wearer: Option<Arc<Wearer>>,
}

impl Default for Settings {
    fn default() -> Self {
        let Options { hidden, e_step, noise, start, init, step, constant, .. } = Options::default();
        Self {
            hidden,
            lambda: None,
            e_step,
            noise,
            start,
            init,
            step,
            constant,
            recipe: Recipe::default(),
            stiffness: Stiffness::Soft,
            wearer: None,
        }
    }
}

impl Settings {
    /// Those of the EM solver.
    fn options(&self, constraint: Constraint) -> Options {
        let &Self { hidden, e_step, noise, start, init, step, constant, .. } = self;
        Options { hidden, constraint, e_step, noise, start, init, step, constant }
    }
}

impl Method {
    /// All methods, simplest first.
    pub const ALL: [Self; 8] =
        [Self::Linear, Self::Spline, Self::Msvd, Self::Lds, Self::BoleroHc, Self::BoleroSc, Self::Skeleton, Self::Auto];

    /// True if the method fills from [`Settings::wearer`]; without one it draws splines.
    pub fn needs_body(self) -> bool {
        self == Self::Skeleton
    }

    /// The name on the command line and in every record.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Spline => "spline",
            Self::Msvd => "msvd",
            Self::Lds => "lds",
            Self::BoleroHc => "bolero-hc",
            Self::BoleroSc => "bolero-sc",
            Self::Skeleton => "skeleton",
            Self::Auto => "auto",
        }
    }

    /// The method of this name.
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// The model with which the method begins; for all but `auto` that is all there is.
    pub fn solver<'a>(self, problem: &'a Problem, settings: &Settings) -> Box<dyn Solver + 'a> {
        let lds = |constraint| Box::new(Lds::new(problem, settings.options(constraint)));
        match self {
            Self::Linear => Box::new(Interpolate::new(problem, Curve::Linear)),
            Self::Spline => Box::new(Interpolate::new(problem, Curve::Spline)),
            Self::Msvd => Box::new(Msvd::new(problem, settings.hidden, settings.start)),
            Self::Lds => lds(Constraint::None),
            Self::BoleroHc => lds(Constraint::Hard),
            Self::Skeleton => Box::new(Skeleton::new(problem, settings.wearer.clone())),
            Self::BoleroSc | Self::Auto => lds(settings.lambda.map_or(Constraint::Spread, Constraint::Lambda)),
        }
    }

    /// Solves `problem` from beginning to end, stage by stage.
    pub fn solve(self, problem: &Problem, settings: &Settings, limits: &Limits<'_>, observer: &mut dyn Observer) -> Solved {
        observer.phase("preparing the model");
        let mut first = self.solver(problem, settings);
        let begin = if self == Self::Auto { Auto::body_limits(limits) } else { *limits };
        let outcome = run(first.as_mut(), problem, 0, &begin, observer);
        let mut solved = Solved { stages: vec![Stage { method: first.name(), outcome }], ..Solved::default() };
        if self == Self::Auto && solved.goes_on() {
            observer.phase("judging the model on simulated gaps");
            let mut auto = Auto::new(problem, settings.recipe, settings.stiffness).counting(limits.meter).with_body(
                first.estimate(),
                &begin,
                &|judged| self.solver(judged, settings),
            );
            let outcome = run(&mut auto, problem, 1, &Limits { steps: settings.recipe.sweeps, ..*limits }, observer);
            solved.stages.push(Stage { method: auto.name(), outcome });
            solved.estimate = auto.estimate().clone();
            solved.explanations = auto.explanations();
        } else {
            solved.estimate = first.estimate().clone();
            solved.explanations = first.explanations();
        }
        solved
    }
}

/// How one model of a method ended.
#[derive(Debug)]
pub struct Stage {
    /// The model's own name.
    pub method: &'static str,
    /// How it ended.
    pub outcome: Outcome,
}

/// What a method found.
#[derive(Debug, Default)]
pub struct Solved {
    /// The fill.
    pub estimate: Estimate,
    /// Its models, in order.
    pub stages: Vec<Stage>,
    /// Why each gap was filled as it was, from methods that can say.
    pub explanations: Vec<Explanation>,
}

impl Solved {
    /// How the last model ended: that is how the method ended.
    pub fn outcome(&self) -> Option<&Outcome> {
        self.stages.last().map(|stage| &stage.outcome)
    }

    /// True unless the last model broke down or was interrupted.
    fn goes_on(&self) -> bool {
        self.outcome().is_none_or(|outcome| !matches!(outcome.stop, Stop::Failed | Stop::Interrupted))
    }
}
