//! Linear dynamical systems learned by EM: `lds` (DynaMMo) and, with bones, `bolero-sc` (soft constraints).
//!
//! One [`step`](crate::solve::Solver::step) is one round: E-step (`smoother.rs`, fed by `evidence.rs` and `bones.rs`), estimate of the missing samples, M-step (`em.rs`).
//! Everything happens in body-local coordinates (`../body.rs`), in metres, with each column centred on the mean of what was seen of it.
//!
//! Two E-steps exist.
//! *Exact*: missing entries are missing; bones are evidence in the frames where one of their ends is missing.
//! *Imputing*, as the paper prints it: the current fill counts as data, and the bones act on the fill in a step of their own.

pub mod bones;
pub mod em;
mod evidence;
mod expect;

pub mod model;
pub(super) mod product;
pub mod smoother;
pub(super) mod start;
pub mod step;
pub(super) mod table;

use super::body::BodyFrames;
use super::{Estimate, Problem, Progress, SolveError, Solver};
use bones::{BoneEvidence, LocalBone};
use em::Noise;
use evidence::Spoken;
use model::Model;
use nalgebra::DMatrix;
use rayon::prelude::*;
use step::{BoneStep, Plan};
use table::Table;

/// How the missing entries enter the E-step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EStep {
    /// As missing.
    Exact,
    /// With their present fill, as if it were measured.
    Imputing,
}

/// How many hidden states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hidden {
    /// This many (H).
    Count(usize),
    /// As many as it takes to hold this share of the energy of the centred positions, the sum of their squares (Eq. 3; the paper means 0.95).
    Energy(f64),
}

/// What bones do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Constraint {
    /// Nothing: `lds`.
    None,
    /// They may give by the spread that each really shows: λ = 1 / (2 d s)², which lets the length vary with standard deviation s.
    Spread,
    /// The paper's λ, 1/m⁴, the same for all.
    Lambda(f64),
    /// They keep their lengths exactly (Eq. 5). In the exact E-step they still speak with their spread: that is what is known about them.
    Hard,
}

/// Where the missing samples are before the first round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Where the first model expects them.
    Model,
    /// On straight lines across the gaps.
    Interpolate,
    /// At the mean of what was seen of the marker, the zero of the centred table: "X_m ← 0" of Algorithms 1 and 2.
    Zero,
}

/// The first parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Init {
    /// From principal components.
    Components,
    /// Normal random numbers for F, G and μ₀, and 1 for all covariances (Algorithms 1 and 2), from this seed.
    Random(u64),
}

/// What to solve, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// H; reduced where the take has fewer frames or columns.
    pub hidden: Hidden,
    /// What bones do.
    pub constraint: Constraint,
    /// Which E-step.
    pub e_step: EStep,
    /// What is free about the noise.
    pub noise: Noise,
    /// The first fill.
    pub start: Start,
    /// The first parameters.
    pub init: Init,
    /// How the fill is made to keep the bones.
    pub step: BoneStep,
    /// True to measure positions from each coordinate's mean and to learn a constant term, which Eq. 3 lacks.
    pub constant: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            hidden: Hidden::Count(16),
            constraint: Constraint::None,
            e_step: EStep::Exact,
            noise: Noise::Diagonal,
            start: Start::Model,
            init: Init::Components,
            step: BoneStep::Coupled,
            constant: true,
        }
    }
}

/// The smallest spread that a bone is believed to have, in mm: shorter takes make distances look stiffer than they are.
const LEAST_SPREAD_MM: f64 = 1.0;

/// A missing sample that turns back by more than this swings, m.
const SWING_M: f64 = 0.001;

/// The EM solver.
pub struct Lds<'a> {
    problem: &'a Problem,
    options: Options,
    frames: BodyFrames,
    table: Table,
    /// What bones and their evidence are relative to: the centre of the table and the model's constant term, m.
    centre: Vec<f64>,
    /// What the exact E-step expects of each missing sample, in the coordinates of the table, m.
    expected: Vec<[f64; 3]>,
    /// What fills each missing sample: the result, and what the imputing E-step takes for measured; same coordinates.
    fill: Vec<[f64; 3]>,
    model: Model,
    bones: Vec<LocalBone>,
    incidence: Vec<Vec<usize>>,
    /// Where the bones of each missing sample are linearised, in the coordinates of the table, m.
    anchors: Vec<[f64; 3]>,
    /// How far the last E-step moved each missing sample from its anchor, m.
    steps: Vec<[f64; 3]>,
    /// μ of each frame, 1/m².
    damping: Vec<f64>,
    /// The least μ of each frame; it rises with every bad step, so that no frame swings for ever.
    least_damping: Vec<f64>,
    /// Which gaps are filled together.
    plans: Vec<Plan>,
    /// Parameters and expected states of the last exact E-step, for the bone step that concludes.
    last: Option<(Model, DMatrix<f64>)>,
    estimate: Estimate,
}

impl<'a> Lds<'a> {
    /// Sets everything up: body frames, table, start.
    pub fn new(problem: &'a Problem, options: Options) -> Self {
        let body = BodyFrames::find(problem);
        let bones = local_bones(problem, options.constraint);
        let incidence = bones::incidence(&bones, problem.markers());
        let table = Table::new(problem, &body, &bones, &incidence, options.constant);
        let hidden = match options.hidden {
            Hidden::Count(count) => Hidden::Count(count.min(3 * problem.markers()).min(problem.frames().max(1)).max(1)),
            energy @ Hidden::Energy(_) => energy,
        };
        let (model, expected) = start::start(problem, &table, &Options { hidden, ..options });
        let plans = match (options.constraint, options.step) {
            (Constraint::None, _) | (_, BoneStep::Frame | BoneStep::Gradient) => Vec::new(),
            (constraint, BoneStep::Coupled) => step::plan(problem, &table, constraint == Constraint::Hard),
        };
        let mut lds = Self {
            problem,
            options,
            frames: body,
            centre: table.centre.clone(),
            table,
            anchors: expected.clone(),
            fill: expected.clone(),
            expected,
            model,
            bones,
            incidence,
            steps: vec![[0.0; 3]; problem.missing.len()],
            damping: vec![0.0; problem.frames()],
            least_damping: vec![0.0; problem.frames()],
            plans,
            last: None,
            estimate: Estimate::open(problem.missing.len()),
        };
        lds.publish(None);
        lds
    }

    /// The parameters as they are now.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// What the coordinates of the table are measured from, per column of the problem's coordinates (3 × markers), m.
    pub fn origin(&self) -> &[f64] {
        &self.table.centre
    }

    /// What the last E-step expected of each missing sample, in the coordinates of the table, m.
    pub fn expected(&self) -> &[[f64; 3]] {
        &self.expected
    }

    /// Where the bones of each missing sample are linearised in the next round, in the coordinates of the table, m.
    pub fn anchors(&self) -> &[[f64; 3]] {
        &self.anchors
    }

    /// μ of each frame in the next round, 1/m².
    pub fn damping(&self) -> &[f64] {
        &self.damping
    }

    /// True if bones are evidence in the E-step.
    fn bones_speak(&self) -> bool {
        !self.bones.is_empty() && self.options.e_step == EStep::Exact && self.options.step == BoneStep::Coupled
    }

    /// Copies the fill into the estimate, with new variances (m²) if there are any. Returns the largest and the root mean square move, mm.
    fn publish(&mut self, variances: Option<&[f64]>) -> (f64, f64) {
        let place = |k: usize| {
            let (t, i) = self.problem.missing[k];
            self.frames.to_world(t, std::array::from_fn(|axis| (self.fill[k][axis] + self.table.centre[3 * i + axis]) * 1000.0))
        };
        let samples = self.fill.len();
        let places: Vec<[f64; 3]> = (0..samples).into_par_iter().with_min_len(256).map(place).collect();
        let (mut largest, mut squares) = (0.0f64, 0.0);
        for (place, before) in places.iter().zip(&self.estimate.positions_mm) {
            let moved: f64 = place.iter().zip(before).map(|(now, before)| (now - before).powi(2)).sum();
            if moved.is_finite() {
                largest = largest.max(moved.sqrt());
                squares += moved;
            }
        }
        self.estimate.positions_mm = places;
        if let Some(variances) = variances {
            self.estimate.sigma_mm = variances.iter().map(|v| v.sqrt() * 1000.0).collect();
        }
        (largest, (squares / samples.max(1) as f64).sqrt())
    }

    /// One frame relative to d, in m: what was seen, and `missing` (one for each missing sample of the take) for what was not.
    fn place(&self, t: usize, missing: &[[f64; 3]]) -> Vec<f64> {
        let m = self.centre.len();
        let mut place = self.table.values.as_slice()[t * m..(t + 1) * m].to_vec();
        for k in self.problem.missing_in(t) {
            let i = self.problem.missing[k].1;
            place[3 * i..3 * i + 3].copy_from_slice(&missing[k]);
        }
        for (x, d) in place.iter_mut().zip(self.model.offset.as_slice()) {
            *x -= d;
        }
        place
    }

    /// What the bones of a frame cost at the anchors, now, and now by the linearisation; and how many they are.
    fn costs(&self, t: usize, said: Option<&BoneEvidence>) -> (f64, f64, f64, usize) {
        let Some(said) = said else { return (0.0, 0.0, 0.0, 0) };
        let (before, now) = (self.place(t, &self.anchors), self.place(t, &self.expected));
        (said.cost(&before, &self.centre), said.cost(&now, &self.centre), said.linear_cost(&now), said.system.rows.len())
    }

    /// After an E-step: frames in which the linearisation held move their anchors to the new expectations and lose damping,
    /// the others keep their anchors and are damped more.
    fn judge(&mut self, spoken: &Spoken) {
        let costs: Vec<(f64, f64, f64, usize)> = spoken.par_iter().enumerate().map(|(t, said)| self.costs(t, said.as_ref())).collect();
        for (t, (was, is, promised, rows)) in costs.into_iter().enumerate().filter(|&(_, (.., rows))| rows > 0) {
            // a sample that turns back on itself is swinging, whatever the bones say
            let mut swings = false;
            for k in self.problem.missing_in(t) {
                let now = self.expected[k];
                let step: [f64; 3] = std::array::from_fn(|axis| now[axis] - self.anchors[k][axis]);
                let product = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                let (size, last) = (product(step, step), product(self.steps[k], self.steps[k]));
                swings |= size > SWING_M * SWING_M && product(step, self.steps[k]) < -0.3 * (size * last).sqrt();
                self.steps[k] = step;
            }
            let present = self.damping[t];
            let strong = 1.0 / self.problem.missing_in(t).map(|k| self.model.marker_noise[self.problem.missing[k].1]).fold(0.0, f64::max);
            let overshot = is - promised > 0.5 * rows as f64 && is > 0.5 * was;
            if overshot || swings {
                self.damping[t] = (4.0 * present).max(strong);
                self.least_damping[t] = (2.0 * self.least_damping[t]).max(strong / 16.0);
                if overshot && is > was {
                    continue; // stay, and step more carefully
                }
            } else {
                let less = present / 4.0;
                self.damping[t] = if less < strong / 16.0 { 0.0 } else { less }.max(self.least_damping[t]);
            }
            let share = if swings { 0.5 } else { 1.0 };
            for k in self.problem.missing_in(t) {
                let now = self.expected[k];
                for (anchor, now) in self.anchors[k].iter_mut().zip(now) {
                    *anchor += share * (now - *anchor);
                }
            }
        }
    }
}

/// The bones in the solver's terms.
fn local_bones(problem: &Problem, constraint: Constraint) -> Vec<LocalBone> {
    if constraint == Constraint::None {
        return Vec::new();
    }
    let weight = |bone: &super::Bone, length: f64| match constraint {
        Constraint::Lambda(lambda) => lambda.sqrt(),
        _ => 1.0 / (2.0 * length * bone.spread_mm.hypot(LEAST_SPREAD_MM) / 1000.0),
    };
    problem
        .bones
        .iter()
        .filter(|bone| bone.length_mm > 0.0)
        .map(|bone| {
            let length = bone.length_mm / 1000.0;
            LocalBone { a: bone.a, b: bone.b, squared_length: length * length, weight: weight(bone, length) }
        })
        .collect()
}

impl Solver for Lds<'_> {
    fn name(&self) -> &'static str {
        match self.options.constraint {
            Constraint::None => "lds",
            Constraint::Spread | Constraint::Lambda(_) => "bolero-sc",
            Constraint::Hard => "bolero-hc",
        }
    }

    fn step(&mut self) -> Result<Progress, SolveError> {
        let (evidence, spoken) = self.evidence();
        let smoothed = smoother::smooth(&self.model, evidence)?;
        let log_likelihood = smoothed.log_likelihood;
        let found = self.expect(&smoothed, &spoken);
        let mut variances = found.variances;
        if self.options.e_step == EStep::Exact {
            self.judge(&spoken);
            self.fill(&smoothed);
            let model = self.model.clone();
            em::maximise(&mut self.model, &smoothed, &found.moments, self.options.noise, self.options.constant)?;
            self.last = Some((model, smoothed.means));
        } else {
            em::maximise(&mut self.model, &smoothed, &found.moments, self.options.noise, self.options.constant)?;
            self.fill(&smoothed);
            for (k, &(t, i)) in self.problem.missing.iter().enumerate() {
                let emission = self.model.emission.rows(3 * i, 3);
                variances[k] = (emission * smoothed.covariance_of(t)).dot(&emission) + 3.0 * self.model.marker_noise[i];
            }
        }
        for (k, centre) in self.centre.iter_mut().enumerate() {
            *centre = self.table.centre[k] + self.model.offset[k];
        }
        spoken.into_par_iter().for_each(drop); // a hundred thousand small matrices
        let (largest_move_mm, rms_move_mm) = self.publish(Some(&variances));
        Ok(Progress {
            log_likelihood: Some(log_likelihood),
            rms_residual_mm: Some(found.rms_residual_mm),
            largest_move_mm,
            rms_move_mm,
            done: self.problem.missing.is_empty(),
        })
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    fn conclude(&mut self) {
        let Some((model, states)) = self.last.take() else { return };
        self.step_bones(&model, &states);
        self.last = Some((model, states));
        self.publish(None);
    }
}
