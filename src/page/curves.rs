//! Watches the solver and keeps what the page plots of it.

use crate::log::BoneResiduals;
use crate::solve::{Observer, Outcome, Start, Step};
use serde::Serialize;

/// One iteration of a model that has a likelihood.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Iteration {
    /// Log-likelihood of the observed samples, in nats.
    pub log_likelihood: f64,
    /// Root mean square distance between the observed samples and the model, in mm; `None` if the method cannot say.
    pub rms_residual_mm: Option<f64>,
    /// The farthest that the iteration moved a missing sample, in mm.
    pub largest_move_mm: f64,
    /// Root mean square residual of every bone, in µm, in the order of [`Curves::bones`].
    pub bones_um: Vec<u32>,
}

/// How one model came to its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// Counts the models of one repair, from 0.
    pub stage: u32,
    /// The model's name.
    pub method: String,
    /// Its iterations; none if it has no likelihood.
    pub iterations: Vec<Iteration>,
}

/// The iterations of one repair.
#[derive(Debug, Default)]
pub struct Curves {
    /// Model by model, those without a likelihood left out.
    pub curves: Vec<Curve>,
    /// Labels of the bones, as the log has them.
    pub bones: Vec<String>,
    residuals: Option<BoneResiduals>,
    method: &'static str,
}

/// Rounds a residual in mm.
pub(super) fn micrometres(mm: f64) -> u32 {
    (mm * 1000.0).round() as u32
}

impl Observer for Curves {
    fn started(&mut self, start: &Start<'_>) {
        self.residuals = None;
        self.method = start.method;
    }

    fn stepped(&mut self, step: &Step<'_>) {
        // as in the log: without a likelihood there is nothing to plot
        let Some(log_likelihood) = step.progress.log_likelihood else { return };
        let residuals = self.residuals.get_or_insert_with(|| BoneResiduals::new(step.problem));
        let of_bones: Vec<_> = residuals.of(step.problem, step.estimate).collect();
        if self.bones.is_empty() {
            self.bones = of_bones.iter().map(|r| r.label.to_owned()).collect();
        }
        let iteration = Iteration {
            log_likelihood,
            rms_residual_mm: step.progress.rms_residual_mm.filter(|x| x.is_finite()),
            largest_move_mm: step.progress.largest_move_mm,
            bones_um: of_bones.iter().map(|r| micrometres(r.rms_mm)).collect(),
        };
        match self.curves.last_mut() {
            Some(curve) if curve.stage == step.stage => curve.iterations.push(iteration),
            _ => self.curves.push(Curve { stage: step.stage, method: self.method.to_owned(), iterations: vec![iteration] }),
        }
    }

    fn stopped(&mut self, _: &Outcome) {
        self.residuals = None;
    }
}
