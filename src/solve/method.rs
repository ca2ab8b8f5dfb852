//! The methods that can be chosen, and the solvers they stand for.

use super::interpolate::{Curve, Interpolate};
use super::lds::em::Noise;
use super::lds::step::BoneStep;
use super::lds::{Constraint, EStep, Hidden, Init, Lds, Options, Start};
use super::msvd::Msvd;
use super::{Problem, Solver};

/// A way to fill gaps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
}

/// What can be set about the methods.
#[derive(Clone, Copy, Debug, PartialEq)]
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
}

impl Default for Settings {
    fn default() -> Self {
        let Options { hidden, e_step, noise, start, init, step, constant, .. } = Options::default();
        Self { hidden, lambda: None, e_step, noise, start, init, step, constant }
    }
}

impl Settings {
    /// Those of the EM solver.
    fn options(&self, constraint: Constraint) -> Options {
        let Self { hidden, e_step, noise, start, init, step, constant, .. } = *self;
        Options { hidden, constraint, e_step, noise, start, init, step, constant }
    }
}

impl Method {
    /// All methods, simplest first.
    pub const ALL: [Self; 6] = [Self::Linear, Self::Spline, Self::Msvd, Self::Lds, Self::BoleroHc, Self::BoleroSc];

    /// The name on the command line and in every record.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Spline => "spline",
            Self::Msvd => "msvd",
            Self::Lds => "lds",
            Self::BoleroHc => "bolero-hc",
            Self::BoleroSc => "bolero-sc",
        }
    }

    /// The method of this name.
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// A solver for `problem`.
    pub fn solver<'a>(self, problem: &'a Problem, settings: &Settings) -> Box<dyn Solver + 'a> {
        let lds = |constraint| Box::new(Lds::new(problem, settings.options(constraint)));
        match self {
            Self::Linear => Box::new(Interpolate::new(problem, Curve::Linear)),
            Self::Spline => Box::new(Interpolate::new(problem, Curve::Spline)),
            Self::Msvd => Box::new(Msvd::new(problem, settings.hidden, settings.start)),
            Self::Lds => lds(Constraint::None),
            Self::BoleroHc => lds(Constraint::Hard),
            Self::BoleroSc => lds(settings.lambda.map_or(Constraint::Spread, Constraint::Lambda)),
        }
    }
}
