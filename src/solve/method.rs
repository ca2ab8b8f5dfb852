//! The methods that can be chosen, and the solvers they stand for.

use super::interpolate::{Curve, Interpolate};
use super::lds::{EStep, Lds, Options, Penalty};
use super::{Problem, Solver};

/// A way to fill gaps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Straight lines.
    Linear,
    /// Natural cubic splines.
    Spline,
    /// A linear dynamical system learned by EM (DynaMMo).
    Lds,
    /// The same with soft bone constraints (BoLeRO-SC).
    BoleroSc,
}

/// What can be set about the methods.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Dimension of the hidden state.
    pub hidden: usize,
    /// The paper's λ in 1/m⁴; `None` weighs each bone by the spread that it shows.
    pub lambda: Option<f64>,
    /// True for the paper's E-step, which believes the present fill.
    pub impute: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { hidden: 16, lambda: None, impute: false }
    }
}

impl Method {
    /// All methods, simplest first.
    pub const ALL: [Self; 4] = [Self::Linear, Self::Spline, Self::Lds, Self::BoleroSc];

    /// The name on the command line and in every record.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Spline => "spline",
            Self::Lds => "lds",
            Self::BoleroSc => "bolero-sc",
        }
    }

    /// The method of this name.
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// A solver for `problem`.
    pub fn solver<'a>(self, problem: &'a Problem, settings: &Settings) -> Box<dyn Solver + 'a> {
        let e_step = if settings.impute { EStep::Imputing } else { EStep::Exact };
        let penalty = match (self, settings.lambda) {
            (Self::BoleroSc, Some(lambda)) => Penalty::Lambda(lambda),
            (Self::BoleroSc, None) => Penalty::Spread,
            _ => Penalty::None,
        };
        match self {
            Self::Linear => Box::new(Interpolate::new(problem, Curve::Linear)),
            Self::Spline => Box::new(Interpolate::new(problem, Curve::Spline)),
            Self::Lds | Self::BoleroSc => Box::new(Lds::new(problem, Options { hidden: settings.hidden, penalty, e_step })),
        }
    }
}
