//! Solvers: numbers in, numbers out. No files, no clock, no printing.
//!
//! A take becomes a [`Problem`] in one place ([`Problem::new`]).
//! A [`Solver`] is built from a problem and takes steps; [`run`] drives it and decides when to stop; [`Observer`]s watch.
//! What a solver knows so far is its [`Estimate`]: one position and one standard deviation for every missing sample of the problem.

pub mod auto;
pub mod body;
pub(crate) mod forest;
pub mod ik;
pub mod interpolate;
mod kernel;
pub mod lds;
pub mod markers;
mod meter;
mod method;
pub mod msvd;
mod problem;
pub mod skeleton;
pub mod track;

pub use meter::Meter;
pub use method::{Method, Settings, Solved, Stage};
pub use problem::{Bone, Gap, Problem};

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What a solver knows about the missing samples, in the order of [`Problem::missing`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Position of each missing sample, in mm, in the axes of the take. NaN where the solver leaves the sample open.
    pub positions_mm: Vec<[f64; 3]>,
    /// Predicted standard deviation of the 3-D error of each sample, in mm. NaN where the solver cannot say.
    pub sigma_mm: Vec<f64>,
}

impl Estimate {
    /// An estimate that leaves all `samples` open.
    pub fn open(samples: usize) -> Self {
        Self { positions_mm: vec![[f64::NAN; 3]; samples], sigma_mm: vec![f64::NAN; samples] }
    }
}

/// What one step achieved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Log-likelihood of the observed samples under the parameters that this step began with, in nats; `None` for methods without one.
    pub log_likelihood: Option<f64>,
    /// Root mean square difference between the observed samples and the model, as a 3-D distance in mm; `None` for methods without a model.
    pub rms_residual_mm: Option<f64>,
    /// The farthest that this step moved a missing sample, in mm.
    pub largest_move_mm: f64,
    /// How far it moved them, root mean square, in mm.
    pub rms_move_mm: f64,
    /// True if another step would change nothing.
    pub done: bool,
}

/// Why a step could not be taken.
#[derive(Debug, thiserror::Error)]
pub enum SolveError {
    /// A matrix that should have been positive definite is not, or a number is not finite.
    #[error("{0}")]
    Numerical(String),
}

/// Takes steps towards an estimate of the missing samples.
pub trait Solver {
    /// The method's name, as on the command line.
    fn name(&self) -> &'static str;

    /// One round of EM, or the whole work of a method that has no rounds.
    ///
    /// # Errors
    /// The numbers broke down; the estimate is still that of the last good step.
    fn step(&mut self) -> Result<Progress, SolveError>;

    /// What is known after the last step.
    fn estimate(&self) -> &Estimate;

    /// True for a method that consists of a number of steps, after which it is complete; others take steps until they converge.
    fn counted(&self) -> bool {
        false
    }

    /// Why each gap was filled as it was, from methods that can say.
    fn explanations(&self) -> Vec<auto::Explanation> {
        Vec::new()
    }

    /// Last touches to the estimate that would cost too much in every round. [`run`] calls it once, after the last step and before observers hear of that step.
    fn conclude(&mut self) {}
}

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a> {
    /// The most steps.
    pub steps: u32,
    /// Stop when the log-likelihood changes by less than this share of itself and the missing samples move by less than [`Limits::still_mm`] (root mean square).
    pub tolerance: f64,
    /// A root mean square move that counts as none, in mm.
    pub still_mm: f64,
    /// Stop when this becomes true.
    pub interrupt: Option<&'a AtomicBool>,
    /// Count here what is done within a step.
    pub meter: Option<&'a Meter>,
}

impl Default for Limits<'_> {
    /// What the command does if nothing is said: most takes settle in 20 to 40 steps.
    fn default() -> Self {
        Self { steps: 100, tolerance: 1e-4, still_mm: 0.5, interrupt: None, meter: None }
    }
}

/// Why the loop stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The steps had become too small to matter.
    Converged,
    /// All the steps were taken that the method consists of.
    Complete,
    /// The step limit came first.
    StepLimit,
    /// Somebody asked for it.
    Interrupted,
    /// The numbers broke down.
    Failed,
}

impl Stop {
    /// True if there was nothing left to do.
    pub fn settled(self) -> bool {
        matches!(self, Self::Converged | Self::Complete)
    }

    /// One word, for logs and scripts.
    pub fn word(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Complete => "complete",
            Self::StepLimit => "step-limit",
            Self::Interrupted => "interrupted",
            Self::Failed => "failed",
        }
    }
}

/// How a run ended.
#[derive(Debug)]
pub struct Outcome {
    /// Why it stopped.
    pub stop: Stop,
    /// How many steps were taken.
    pub steps: u32,
    /// The last good step.
    pub last: Option<Progress>,
    /// What broke, if [`Stop::Failed`].
    pub error: Option<SolveError>,
}

/// What an observer is told before the first step.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// Counts the models of one repair, from 0.
    pub stage: u32,
    /// The method's name.
    pub method: &'static str,
    /// What is solved.
    pub problem: &'a Problem,
    /// The most steps that will be taken.
    pub step_limit: u32,
}

/// What an observer is told after each step.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// Counts the models of one repair, from 0.
    pub stage: u32,
    /// Counts the steps of this stage, from 0.
    pub iteration: u32,
    /// What the step achieved.
    pub progress: &'a Progress,
    /// What is solved.
    pub problem: &'a Problem,
    /// What is known now.
    pub estimate: &'a Estimate,
    /// True if this is the last step because the loop regards the solver as converged.
    pub converged: bool,
}

/// Watches a run. Called as `started`, then `stepped` any number of times, then `stopped`, for each stage.
/// An observer cannot fail the solver: one that writes keeps its first error and returns it when it is closed.
pub trait Observer {
    /// Before the first step.
    fn started(&mut self, _start: &Start<'_>) {}
    /// After each step.
    fn stepped(&mut self, _step: &Step<'_>) {}
    /// After the last step.
    fn stopped(&mut self, _outcome: &Outcome) {}
    /// Outside of stages: what is being done now, in a few words that follow "it is".
    fn phase(&mut self, _doing: &str) {}
    /// Where to count what is done within a step; `None` if nobody looks.
    fn meter(&self) -> Option<Arc<Meter>> {
        None
    }
}

impl Observer for () {}

impl<A: Observer, B: Observer> Observer for (A, B) {
    fn started(&mut self, start: &Start<'_>) {
        self.0.started(start);
        self.1.started(start);
    }
    fn stepped(&mut self, step: &Step<'_>) {
        self.0.stepped(step);
        self.1.stepped(step);
    }
    fn stopped(&mut self, outcome: &Outcome) {
        self.0.stopped(outcome);
        self.1.stopped(outcome);
    }
    fn phase(&mut self, doing: &str) {
        self.0.phase(doing);
        self.1.phase(doing);
    }
    fn meter(&self) -> Option<Arc<Meter>> {
        self.0.meter().or_else(|| self.1.meter())
    }
}

impl<O: Observer + ?Sized> Observer for &mut O {
    fn started(&mut self, start: &Start<'_>) {
        (**self).started(start);
    }
    fn stepped(&mut self, step: &Step<'_>) {
        (**self).stepped(step);
    }
    fn stopped(&mut self, outcome: &Outcome) {
        (**self).stopped(outcome);
    }
    fn phase(&mut self, doing: &str) {
        (**self).phase(doing);
    }
    fn meter(&self) -> Option<Arc<Meter>> {
        (**self).meter()
    }
}

impl<O: Observer> Observer for Option<O> {
    fn started(&mut self, start: &Start<'_>) {
        if let Some(o) = self {
            o.started(start);
        }
    }
    fn stepped(&mut self, step: &Step<'_>) {
        if let Some(o) = self {
            o.stepped(step);
        }
    }
    fn stopped(&mut self, outcome: &Outcome) {
        if let Some(o) = self {
            o.stopped(outcome);
        }
    }
    fn phase(&mut self, doing: &str) {
        if let Some(o) = self {
            o.phase(doing);
        }
    }
    fn meter(&self) -> Option<Arc<Meter>> {
        self.as_ref().and_then(Observer::meter)
    }
}

/// Drives a solver until it converges, fails, is interrupted, or has used up its steps.
pub fn run(solver: &mut dyn Solver, problem: &Problem, stage: u32, limits: &Limits<'_>, observer: &mut dyn Observer) -> Outcome {
    observer.started(&Start { stage, method: solver.name(), problem, step_limit: limits.steps });
    let mut outcome = Outcome { stop: Stop::StepLimit, steps: 0, last: None, error: None };
    let mut before: Option<f64> = None;
    while outcome.steps < limits.steps {
        if limits.interrupt.is_some_and(|i| i.load(Ordering::Relaxed)) {
            outcome.stop = Stop::Interrupted;
            break;
        }
        let progress = match solver.step() {
            Ok(progress) => progress,
            Err(error) => {
                outcome.stop = Stop::Failed;
                outcome.error = Some(error);
                break;
            }
        };
        let settled = match (before, progress.log_likelihood) {
            (Some(a), Some(b)) => (b - a).abs() <= limits.tolerance * b.abs() && progress.rms_move_mm <= limits.still_mm,
            _ => false,
        };
        let complete = progress.done && solver.counted();
        let converged = !complete && (progress.done || settled);
        if complete || converged || outcome.steps + 1 == limits.steps {
            solver.conclude();
        }
        observer.stepped(&Step { stage, iteration: outcome.steps, progress: &progress, problem, estimate: solver.estimate(), converged });
        before = progress.log_likelihood;
        outcome.steps += 1;
        outcome.last = Some(progress);
        if complete || converged {
            outcome.stop = if complete { Stop::Complete } else { Stop::Converged };
            break;
        }
    }
    observer.stopped(&outcome);
    outcome
}
