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
pub mod kalman;
pub mod model;

use super::body::BodyFrames;
use super::{Estimate, Problem, Progress, SolveError, Solver};
use bones::{BoneEvidence, LocalBone};
use kalman::Evidence;
use model::Model;
use nalgebra::DMatrix;

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

/// The EM solver.
pub struct Lds<'a> {
    problem: &'a Problem,
    options: Options,
    frames: BodyFrames,
    /// Mean of what was seen of each column, m.
    centre: Vec<f64>,
    /// Observed entries, 0 where missing; m × T.
    observed: DMatrix<f64>,
    /// The same with the present expectations of the missing ones.
    filled: DMatrix<f64>,
    model: Model,
    bones: Vec<LocalBone>,
    incidence: Vec<Vec<usize>>,
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
        let (model, states) = start(problem, &observed, hidden);
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
            estimate: Estimate::open(problem.missing.len()),
        };
        for k in 0..problem.missing.len() {
            lds.publish(k, f64::NAN);
        }
        lds
    }

    /// The parameters as they are now.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Copies the present position of a missing sample into the estimate; returns how far it moved, mm.
    fn publish(&mut self, k: usize, variance: f64) -> f64 {
        let (t, i) = self.problem.missing[k];
        let local: [f64; 3] = std::array::from_fn(|axis| (self.filled[(3 * i + axis, t)] + self.centre[3 * i + axis]) * 1000.0);
        let world = self.frames.to_world(t, local);
        let before = self.estimate.positions_mm[k];
        self.estimate.positions_mm[k] = world;
        self.estimate.sigma_mm[k] = variance.sqrt() * 1000.0;
        let moved: f64 = (0..3).map(|axis| (world[axis] - before[axis]).powi(2)).sum();
        if moved.is_finite() { moved.sqrt() } else { 0.0 }
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
            let each: Vec<DMatrix<f64>> =
                (0..markers).map(|i| model.emission.rows(3 * i, 3).tr_mul(&weighted.rows(3 * i, 3))).collect();
            for t in 0..frames {
                let range = problem.missing_in(t);
                if range.is_empty() {
                    continue;
                }
                let missing: Vec<usize> = problem.missing[range].iter().map(|&(_, i)| i).collect();
                let hidden = model.hidden();
                // sum what is there or take away what is not, whichever is shorter and so more exact
                let mut matrix = if 2 * missing.len() > markers {
                    let mut sum = DMatrix::zeros(hidden, hidden);
                    for i in (0..markers).filter(|&i| problem.observed(t, i)) {
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
                constants[t] -= missing.iter().map(|&i| constants_of[i]).sum::<f64>();
                if !self.bones.is_empty() {
                    let column = self.filled.column(t);
                    for group in bones::groups(&missing, &self.bones, &self.incidence) {
                        let system = bones::linearise(&group, &self.bones, column.as_slice(), &self.centre);
                        if let Some(said) = bones::integrate(&group, &system, model) {
                            matrix += &said.matrix;
                            let mut vector = vectors.column_mut(t);
                            vector += &said.vector;
                            constants[t] += said.constant;
                            spoken[t].push(said);
                        }
                    }
                }
                partial[t] = Some(matrix);
            }
        }
        (Evidence { complete, partial, vectors, constants }, spoken)
    }

    /// Replaces the expectations of the missing samples and sums up what is still open about them.
    /// Returns it with the variance of each sample (trace, m²).
    fn expect(&mut self, smoothed: &kalman::Smoothed, expected: &DMatrix<f64>, spoken: &[Vec<BoneEvidence>]) -> (em::Open, Vec<f64>) {
        let problem = self.problem;
        let (markers, hidden) = (problem.markers(), self.model.hidden());
        let mut cross = DMatrix::zeros(3 * markers, hidden);
        let mut trace = vec![0.0; markers];
        let mut variances = vec![0.0; problem.missing.len()];
        let mut spread_sums: Vec<Option<DMatrix<f64>>> = vec![None; markers];
        for t in 0..problem.frames() {
            let range = problem.missing_in(t);
            if range.is_empty() {
                continue;
            }
            let covariance = &smoothed.covariances[t];
            let mut told = vec![false; range.len()];
            let missing = &problem.missing[range.clone()];
            for said in &spoken[t] {
                let carried = &said.gain * covariance; // A V̂
                let place = &said.gain * smoothed.means.column(t) + &said.offset;
                for (slot, &i) in said.markers.iter().enumerate() {
                    let rows = (3 * slot, 3);
                    let open = carried.rows(rows.0, rows.1).dot(&said.gain.rows(rows.0, rows.1)) + said.rest[slot];
                    let mut block = cross.rows_mut(3 * i, 3);
                    block += carried.rows(rows.0, rows.1);
                    trace[i] += open;
                    self.filled.view_mut((3 * i, t), (3, 1)).copy_from(&place.rows(rows.0, rows.1));
                    if let Ok(k) = missing.binary_search(&(t, i)) {
                        told[k] = true;
                        variances[range.start + k] = open;
                    }
                }
            }
            for (k, &(_, i)) in missing.iter().enumerate().filter(|&(k, _)| !told[k]) {
                self.filled.view_mut((3 * i, t), (3, 1)).copy_from(&expected.view((3 * i, t), (3, 1)));
                let emission = self.model.emission.rows(3 * i, 3);
                let open = (emission * covariance).dot(&emission) + 3.0 * self.model.marker_noise[i];
                trace[i] += open;
                variances[range.start + k] = open;
                match &mut spread_sums[i] {
                    Some(sum) => *sum += covariance,
                    empty => *empty = Some(covariance.clone()),
                }
            }
        }
        for (i, sum) in spread_sums.iter().enumerate() {
            if let Some(sum) = sum {
                let block = self.model.emission.rows(3 * i, 3) * sum;
                let mut rows = cross.rows_mut(3 * i, 3);
                rows += block;
            }
        }
        (em::Open { cross, trace }, variances)
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
                bones::settle(
                    &group,
                    &self.bones,
                    &mut column,
                    &self.centre,
                    expected.column(t).as_slice(),
                    &self.model.marker_noise,
                );
                self.filled.column_mut(t).copy_from_slice(&column);
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

/// The start: components of the complete frames if there are enough of them, else of the linearly interpolated table.
fn start(problem: &Problem, observed: &DMatrix<f64>, hidden: usize) -> (Model, DMatrix<f64>) {
    let frames = problem.frames();
    let complete = (0..frames).filter(|&t| problem.missing_in(t).is_empty()).count();
    let whole = if complete > 4 * hidden {
        observed.select_columns(&(0..frames).filter(|&t| problem.missing_in(t).is_empty()).collect::<Vec<_>>())
    } else {
        interpolated(problem, observed)
    };
    Model::from_components(&whole, observed, &|t, i| problem.observed(t, i), hidden)
}

/// The table with its holes interpolated linearly and held at the ends; a start, never a result.
fn interpolated(problem: &Problem, observed: &DMatrix<f64>) -> DMatrix<f64> {
    let mut table = observed.clone();
    let mut last: Vec<Option<usize>> = vec![None; problem.markers()];
    for t in 0..problem.frames() {
        for (i, last) in last.iter_mut().enumerate() {
            if !problem.observed(t, i) {
                continue;
            }
            let from = last.map_or(0, |l| l + 1);
            for k in 3 * i..3 * i + 3 {
                for gap in from..t {
                    table[(k, gap)] = last.map_or(observed[(k, t)], |l| {
                        let share = (gap - l) as f64 / (t - l) as f64;
                        observed[(k, l)] * (1.0 - share) + observed[(k, t)] * share
                    });
                }
            }
            *last = Some(t);
        }
    }
    for (i, last) in last.iter().enumerate() {
        if let Some(l) = *last {
            for k in 3 * i..3 * i + 3 {
                for gap in l + 1..problem.frames() {
                    table[(k, gap)] = observed[(k, l)];
                }
            }
        }
    }
    table
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
            self.expect(&smoothed, &expected, &spoken)
        } else {
            let none = em::Open {
                cross: DMatrix::zeros(3 * self.problem.markers(), self.model.hidden()),
                trace: vec![0.0; self.problem.markers()],
            };
            (none, vec![f64::NAN; samples])
        };
        em::maximise(&mut self.model, &smoothed, &self.filled, &open)?;
        let mut variances = variances;
        if self.options.e_step == EStep::Imputing {
            expected = &self.model.emission * &smoothed.means;
            self.impute(&expected);
            for (k, &(t, i)) in self.problem.missing.iter().enumerate() {
                let emission = self.model.emission.rows(3 * i, 3);
                variances[k] = (emission * &smoothed.covariances[t]).dot(&emission) + 3.0 * self.model.marker_noise[i];
            }
        }
        let mut largest_move_mm = 0.0f64;
        for (k, &variance) in variances.iter().enumerate() {
            largest_move_mm = largest_move_mm.max(self.publish(k, variance));
        }
        Ok(Progress {
            log_likelihood: Some(smoothed.log_likelihood),
            rms_residual_mm: Some(rms_residual_mm),
            largest_move_mm,
            done: samples == 0,
        })
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }
}
