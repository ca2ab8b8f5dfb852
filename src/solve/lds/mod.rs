//! Linear dynamical systems learned by EM: `lds` (DynaMMo) and, with bones, `bolero-sc` (soft constraints).
//!
//! One [`step`](crate::solve::Solver::step) is one round: E-step (`kalman.rs`, fed by this file and `bones.rs`), estimate of the missing samples, M-step (`em.rs`).
//! Everything happens in body-local coordinates (`../body.rs`), in metres, with each column centred on the mean of what was seen of it.
//!
//! Two E-steps exist.
//! *Exact*: missing entries are missing; bones are evidence in the frames where one of their ends is missing.
//! *Imputing*, as the paper prints it: the current fill counts as data, and the bones act on the fill in a step of their own.

pub mod bones;
pub mod em;
mod expect;
pub mod join;
pub mod kalman;
pub mod model;
mod start;

use super::body::BodyFrames;
use super::{Estimate, Problem, Progress, SolveError, Solver};
use bones::{BoneEvidence, LocalBone};
use kalman::Evidence;
use model::Model;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// How the missing entries enter the E-step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EStep {
    /// As missing.
    Exact,
    /// With their present fill, as if it were measured.
    Imputing,
}

/// How much bones weigh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Penalty {
    /// Not at all: `lds`.
    None,
    /// By the spread that each bone really shows: λ = 1 / (2 d s)², which lets the length vary with standard deviation s.
    Spread,
    /// The paper's λ, 1/m⁴, the same for all.
    Lambda(f64),
}

/// What to solve, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// H; reduced where the take has fewer frames or columns.
    pub hidden: usize,
    /// Weight of the bones.
    pub penalty: Penalty,
    /// Which E-step.
    pub e_step: EStep,
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
    /// Where each column is measured from, m: at first the mean of what was seen of it, then what the M-step learns.
    centre: Vec<f64>,
    /// Observed entries, 0 where missing; m × T.
    observed: DMatrix<f64>,
    /// The same with the present expectations of the missing ones.
    filled: DMatrix<f64>,
    model: Model,
    bones: Vec<LocalBone>,
    incidence: Vec<Vec<usize>>,
    /// Where the bones of each missing sample are linearised, centred, m.
    anchors: Vec<[f64; 3]>,
    /// How far the last E-step moved each missing sample from its anchor, m.
    steps: Vec<[f64; 3]>,
    /// μ of each frame, 1/m².
    damping: Vec<f64>,
    /// The least μ of each frame; it rises with every bad step, so that no frame swings for ever.
    least_damping: Vec<f64>,
    /// The frames that enclose each missing sample.
    edges: Vec<(Option<usize>, Option<usize>)>,
    estimate: Estimate,
}

impl<'a> Lds<'a> {
    /// Sets everything up: body frames, table, start.
    pub fn new(problem: &'a Problem, options: Options) -> Self {
        let body = BodyFrames::find(problem);
        let (frames, markers) = (problem.frames(), problem.markers());
        let mut observed = DMatrix::zeros(3 * markers, frames);
        let mut centre = vec![0.0; 3 * markers];
        let mut counts = vec![0usize; markers];
        for t in 0..frames {
            for i in 0..markers {
                if let Some(p) = problem.position_mm(t, i) {
                    let local = body.to_local(t, p);
                    for axis in 0..3 {
                        observed[(3 * i + axis, t)] = local[axis] / 1000.0;
                        centre[3 * i + axis] += local[axis] / 1000.0;
                    }
                    counts[i] += 1;
                }
            }
        }
        for (k, sum) in centre.iter_mut().enumerate() {
            *sum /= counts[k / 3].max(1) as f64;
        }
        for t in 0..frames {
            for i in 0..markers {
                for k in 3 * i..3 * i + 3 {
                    if problem.observed(t, i) {
                        observed[(k, t)] -= centre[k];
                    } else {
                        observed[(k, t)] = 0.0;
                    }
                }
            }
        }
        let hidden = options.hidden.min(3 * markers).min(frames.max(1)).max(1);
        let (model, states) = start::start(problem, &observed, hidden);
        let mut filled = observed.clone();
        let expected = &model.emission * states;
        for &(t, i) in &problem.missing {
            filled.view_mut((3 * i, t), (3, 1)).copy_from(&expected.view((3 * i, t), (3, 1)));
        }
        let bones: Vec<LocalBone> = if options.penalty == Penalty::None {
            Vec::new()
        } else {
            problem
                .bones
                .iter()
                .filter(|bone| bone.length_mm > 0.0)
                .map(|bone| {
                    let length = bone.length_mm / 1000.0;
                    let weight = match options.penalty {
                        Penalty::Lambda(lambda) => lambda.sqrt(),
                        _ => 1.0 / (2.0 * length * bone.spread_mm.hypot(LEAST_SPREAD_MM) / 1000.0),
                    };
                    LocalBone { a: bone.a, b: bone.b, squared_length: length * length, weight }
                })
                .collect()
        };
        let incidence = bones::incidence(&bones, markers);
        let mut lds = Self {
            problem,
            options,
            frames: body,
            centre,
            observed,
            filled,
            model,
            bones,
            incidence,
            anchors: Vec::new(),
            steps: vec![[0.0; 3]; problem.missing.len()],
            damping: vec![0.0; frames],
            least_damping: vec![0.0; frames],
            edges: join::edges(problem),
            estimate: Estimate::open(problem.missing.len()),
        };
        lds.anchors = problem.missing.iter().map(|&(t, i)| lds.filled_at(t, i)).collect();
        for k in 0..problem.missing.len() {
            lds.publish(k, [0.0; 3], f64::NAN);
        }
        lds
    }

    /// The parameters as they are now.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Where the bones of each missing sample are linearised in the next round, less the centre, m.
    pub fn anchors(&self) -> &[[f64; 3]] {
        &self.anchors
    }

    /// μ of each frame in the next round, 1/m².
    pub fn damping(&self) -> &[f64] {
        &self.damping
    }

    /// What positions are measured from now, per column of the problem's coordinates (3 × markers), m.
    pub fn centre(&self) -> &[f64] {
        &self.centre
    }

    /// Copies the present position of a missing sample, with its correction, into the estimate; returns how far it moved, mm.
    fn publish(&mut self, k: usize, correction: [f64; 3], variance: f64) -> f64 {
        let (t, i) = self.problem.missing[k];
        let local: [f64; 3] =
            std::array::from_fn(|axis| (self.filled[(3 * i + axis, t)] + correction[axis] + self.centre[3 * i + axis]) * 1000.0);
        let world = self.frames.to_world(t, local);
        let before = self.estimate.positions_mm[k];
        self.estimate.positions_mm[k] = world;
        self.estimate.sigma_mm[k] = variance.sqrt() * 1000.0;
        let moved: f64 = (0..3).map(|axis| (world[axis] - before[axis]).powi(2)).sum();
        if moved.is_finite() { moved.sqrt() } else { 0.0 }
    }

    /// The present expectation of a missing sample, centred, m.
    fn filled_at(&self, t: usize, i: usize) -> [f64; 3] {
        std::array::from_fn(|axis| self.filled[(3 * i + axis, t)])
    }

    /// Where the bones of a frame are linearised: what was seen, and the anchors of what was not; centred, m.
    fn place(&self, t: usize) -> Vec<f64> {
        let mut place: Vec<f64> = self.observed.column(t).iter().copied().collect();
        for k in self.problem.missing_in(t) {
            let i = self.problem.missing[k].1;
            place[3 * i..3 * i + 3].copy_from_slice(&self.anchors[k]);
        }
        place
    }

    /// What the bones of a frame cost at the anchors, now, and now by the linearisation; and how many they are.
    fn costs(&self, t: usize, said: &[BoneEvidence]) -> (f64, f64, f64, usize) {
        let (mut was, mut is, mut promised, mut rows) = (0.0, 0.0, 0.0, 0usize);
        if !said.is_empty() {
            let before = self.place(t);
            let now: Vec<f64> = self.filled.column(t).iter().copied().collect();
            for said in said {
                was += bones::cost(&said.group, &self.bones, &before, &self.centre);
                is += bones::cost(&said.group, &self.bones, &now, &self.centre);
                promised += said.linear_cost(&now);
                rows += said.group.bones.len();
            }
        }
        (was, is, promised, rows)
    }

    /// After an E-step: frames in which the linearisation held move their anchors to the new expectations and lose damping,
    /// the others keep their anchors and are damped more.
    fn judge(&mut self, spoken: &[Vec<BoneEvidence>]) {
        let costs: Vec<(f64, f64, f64, usize)> = spoken.par_iter().enumerate().map(|(t, said)| self.costs(t, said)).collect();
        for (t, (was, is, promised, rows)) in costs.into_iter().enumerate().filter(|&(_, (.., rows))| rows > 0) {
            // a sample that turns back on itself is swinging, whatever the bones say
            let mut swings = false;
            for k in self.problem.missing_in(t) {
                let now = self.filled_at(t, self.problem.missing[k].1);
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
                let now = self.filled_at(t, self.problem.missing[k].1);
                for (anchor, now) in self.anchors[k].iter_mut().zip(now) {
                    *anchor += share * (now - *anchor);
                }
            }
        }
    }

    /// What the frames say, given the present parameters; and what the bones say about their markers, per frame.
    fn evidence(&self) -> (Evidence, Vec<Vec<BoneEvidence>>) {
        let problem = self.problem;
        let (markers, frames) = (problem.markers(), problem.frames());
        let exact = self.options.e_step == EStep::Exact;
        let model = &self.model;
        let table = if exact { &self.observed } else { &self.filled };
        let mut weighted = model.emission.clone(); // Σ⁻¹ G
        for (k, mut row) in weighted.row_iter_mut().enumerate() {
            row.scale_mut(1.0 / model.marker_noise[k / 3]);
        }
        let complete = model.emission.tr_mul(&weighted);
        let mut vectors = weighted.tr_mul(table);
        let log_tau = std::f64::consts::TAU.ln();
        let constants_of: Vec<f64> = model.marker_noise.iter().map(|r| 3.0 * (r.ln() + log_tau)).collect();
        let every: f64 = constants_of.iter().sum();
        let mut constants: Vec<f64> = (0..frames)
            .map(|t| {
                let squares: f64 = (0..markers).map(|i| table.view((3 * i, t), (3, 1)).norm_squared() / model.marker_noise[i]).sum();
                squares + every
            })
            .collect();
        let mut partial: Vec<Option<DMatrix<f64>>> = vec![None; frames];
        let mut spoken: Vec<Vec<BoneEvidence>> = vec![Vec::new(); frames];
        if exact {
            let each: Vec<DMatrix<f64>> = (0..markers).map(|i| model.emission.rows(3 * i, 3).tr_mul(&weighted.rows(3 * i, 3))).collect();
            let incomplete: Vec<usize> = (0..frames).filter(|&t| !problem.missing_in(t).is_empty()).collect();
            let told: Vec<(DMatrix<f64>, f64, Vec<BoneEvidence>)> =
                incomplete.par_iter().map(|&t| self.tell(t, &complete, &each, &constants_of)).collect();
            for (&t, (matrix, constant, said)) in incomplete.iter().zip(told) {
                constants[t] += constant;
                for group in &said {
                    let mut vector = vectors.column_mut(t);
                    vector += &group.vector;
                }
                partial[t] = Some(matrix);
                spoken[t] = said;
            }
        }
        (Evidence { complete, partial, vectors, constants }, spoken)
    }

    /// What a frame with missing markers says: its L, what changes about its c, and what its bones say.
    fn tell(
        &self,
        t: usize,
        complete: &DMatrix<f64>,
        each: &[DMatrix<f64>],
        constants_of: &[f64],
    ) -> (DMatrix<f64>, f64, Vec<BoneEvidence>) {
        let (problem, model) = (self.problem, &self.model);
        let missing: Vec<usize> = problem.missing[problem.missing_in(t)].iter().map(|&(_, i)| i).collect();
        // sum what is there or take away what is not, whichever is shorter and so more exact
        let mut matrix = if 2 * missing.len() > problem.markers() {
            let mut sum = DMatrix::zeros(model.hidden(), model.hidden());
            for i in (0..problem.markers()).filter(|&i| problem.observed(t, i)) {
                sum += &each[i];
            }
            sum
        } else {
            let mut rest = complete.clone();
            for &i in &missing {
                rest -= &each[i];
            }
            rest
        };
        let mut constant = -missing.iter().map(|&i| constants_of[i]).sum::<f64>();
        let mut spoken = Vec::new();
        if !self.bones.is_empty() {
            let place = self.place(t);
            for group in bones::groups(&missing, &self.bones, &self.incidence).into_iter().filter(|g| g.held(&self.bones)) {
                let system = bones::linearise(&group, &self.bones, &place, &self.centre);
                let anchor: Vec<f64> = group.markers.iter().flat_map(|&i| place[3 * i..3 * i + 3].iter().copied()).collect();
                if let Some(said) = bones::integrate(&group, system, model, self.damping[t], &anchor) {
                    matrix += &said.matrix;
                    constant += said.constant;
                    spoken.push(said);
                }
            }
        }
        (matrix, constant, spoken)
    }

    /// The bone step of the imputing EM: each frame's missing markers from E[z], the noise and the bones (Eq. 11).
    fn impute(&mut self, expected: &DMatrix<f64>) {
        let problem = self.problem;
        for &(t, i) in &problem.missing {
            if self.bones.is_empty() {
                self.filled.view_mut((3 * i, t), (3, 1)).copy_from(&expected.view((3 * i, t), (3, 1)));
            }
        }
        if self.bones.is_empty() {
            return;
        }
        for t in 0..problem.frames() {
            let missing: Vec<usize> = problem.missing[problem.missing_in(t)].iter().map(|&(_, i)| i).collect();
            for &i in missing.iter().filter(|&&i| self.incidence[i].is_empty()) {
                self.filled.view_mut((3 * i, t), (3, 1)).copy_from(&expected.view((3 * i, t), (3, 1)));
            }
            for group in bones::groups(&missing, &self.bones, &self.incidence) {
                let mut column: Vec<f64> = self.filled.column(t).iter().copied().collect();
                bones::settle(&group, &self.bones, &mut column, &self.centre, expected.column(t).as_slice(), &self.model.marker_noise);
                self.filled.column_mut(t).copy_from_slice(&column);
            }
        }
    }

    /// Moves the centre of each column by what the M-step found, so that the model needs no constant term.
    fn recentre(&mut self, offset: &DVector<f64>) {
        let problem = self.problem;
        for (centre, offset) in self.centre.iter_mut().zip(offset) {
            *centre += offset;
        }
        for t in 0..problem.frames() {
            let mut column = self.filled.column_mut(t);
            column -= offset;
            let mut column = self.observed.column_mut(t);
            column -= offset;
            for k in problem.missing_in(t) {
                let i = problem.missing[k].1;
                column.rows_mut(3 * i, 3).fill(0.0);
                for (axis, anchor) in self.anchors[k].iter_mut().enumerate() {
                    *anchor -= offset[3 * i + axis];
                }
            }
        }
    }

    /// Root mean square 3-D distance between the observed samples and the model, mm.
    fn residual_mm(&self, expected: &DMatrix<f64>) -> f64 {
        let (mut sum, mut count) = (0.0, 0usize);
        for t in 0..self.problem.frames() {
            for i in 0..self.problem.markers() {
                if self.problem.observed(t, i) {
                    sum += (self.observed.view((3 * i, t), (3, 1)) - expected.view((3 * i, t), (3, 1))).norm_squared();
                    count += 1;
                }
            }
        }
        (sum / count.max(1) as f64).sqrt() * 1000.0
    }
}

impl Solver for Lds<'_> {
    fn name(&self) -> &'static str {
        if self.options.penalty == Penalty::None { "lds" } else { "bolero-sc" }
    }

    fn step(&mut self) -> Result<Progress, SolveError> {
        let (evidence, spoken) = self.evidence();
        let smoothed = kalman::smooth(&self.model, &evidence)?;
        drop(evidence);
        let mut expected = &self.model.emission * &smoothed.means;
        let rms_residual_mm = self.residual_mm(&expected);
        let samples = self.problem.missing.len();
        let (open, variances) = if self.options.e_step == EStep::Exact {
            let open = self.expect(&smoothed, &expected, &spoken);
            self.judge(&spoken);
            open
        } else {
            let none = em::Open {
                cross: DMatrix::zeros(3 * self.problem.markers(), self.model.hidden()),
                trace: vec![0.0; self.problem.markers()],
            };
            (none, vec![f64::NAN; samples])
        };
        let offset = em::maximise(&mut self.model, &smoothed, &self.filled, &open)?;
        let mut variances = variances;
        if self.options.e_step == EStep::Imputing {
            self.recentre(&offset);
            expected = &self.model.emission * &smoothed.means;
            self.impute(&expected);
            for (k, &(t, i)) in self.problem.missing.iter().enumerate() {
                let emission = self.model.emission.rows(3 * i, 3);
                variances[k] = (emission * &smoothed.covariances[t]).dot(&emission) + 3.0 * self.model.marker_noise[i];
            }
        }
        let corrections = self.corrections(&expected);
        let (mut largest_move_mm, mut squares) = (0.0f64, 0.0);
        for (k, (&variance, correction)) in variances.iter().zip(corrections).enumerate() {
            let moved = self.publish(k, correction, variance);
            largest_move_mm = largest_move_mm.max(moved);
            squares += moved * moved;
        }
        if self.options.e_step == EStep::Exact {
            self.recentre(&offset); // what was published belongs to the old centre
        }
        Ok(Progress {
            log_likelihood: Some(smoothed.log_likelihood),
            rms_residual_mm: Some(rms_residual_mm),
            largest_move_mm,
            rms_move_mm: (squares / samples.max(1) as f64).sqrt(),
            done: samples == 0,
        })
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }
}
