//! The bone step: from what the model expects of the missing samples to the fill.
//!
//! By default over whole gaps ([`band`]), or as printed, each frame alone ([`frame`]).
//! In the exact E-step bones have already spoken to the states; here the markers themselves are put where bones and the samples at both edges want them.

pub mod band;
pub mod frame;
pub mod residual;

use super::bones::{Group, LocalBone};
use super::model::Model;
use super::smoother::Smoothed;
use super::table::Table;
use super::{Constraint, EStep, Lds};
use crate::solve::{Problem, forest};
use band::{Block, End, Episode, Neighbour, Tie, Time, Unknown, Vectors};
use frame::Place;
use nalgebra::{DMatrix, Vector3};
use rayon::prelude::*;

/// How the bone step goes about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoneStep {
    /// All frames of a gap together, joined to what was seen on both sides.
    Coupled,
    /// As printed, each frame alone: Gauss-Newton for soft constraints, Newton on the Karush-Kuhn-Tucker system (Eq. 7) for hard ones.
    Frame,
    /// As printed, with the adaptive gradient descent of Algorithm 2 for soft constraints.
    Gradient,
}

/// The most steps of a soft bone step that is carried to its end.
const MOST_STEPS: usize = 60;

/// Gaps that bones connect, as far as the take alone decides it.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// The first frame.
    first: usize,
    /// For each frame, its missing samples in the problem's list.
    samples: Vec<Vec<usize>>,
    /// For each frame, the bones at them.
    bones: Vec<Vec<usize>>,
}

/// Sorts the missing samples into episodes. `hard`: bones between missing markers count even if none of these is tied to one that was seen.
pub(super) fn plan(problem: &Problem, table: &Table, hard: bool) -> Vec<Plan> {
    // gaps, and what connects them
    let mut gap_of = vec![0usize; problem.missing.len()];
    let mut trees: Vec<usize> = Vec::new();
    let mut open: Vec<Option<usize>> = vec![None; problem.markers()];
    let groups_of = |t: usize| -> &[Group] { if hard { &table.pattern(t).groups } else { &table.pattern(t).held } };
    for t in 0..problem.frames() {
        let mut present = vec![None; problem.markers()];
        for k in problem.missing_in(t) {
            let i = problem.missing[k].1;
            let gap = open[i].unwrap_or_else(|| {
                trees.push(trees.len());
                trees.len() - 1
            });
            gap_of[k] = gap;
            present[i] = Some(gap);
        }
        open = present;
        for group in groups_of(t) {
            let gaps: Vec<usize> = group.markers.iter().filter_map(|&i| open[i]).collect();
            for pair in gaps.windows(2) {
                let (a, b) = (forest::root(&mut trees, pair[0]), forest::root(&mut trees, pair[1]));
                trees[a.max(b)] = a.min(b);
            }
        }
    }
    // episodes in the order of their first gap
    let mut number: Vec<Option<usize>> = vec![None; trees.len()];
    let mut plans: Vec<Plan> = Vec::new();
    for t in 0..problem.frames() {
        for k in problem.missing_in(t) {
            let tree = forest::root(&mut trees, gap_of[k]);
            let at = *number[tree].get_or_insert_with(|| {
                plans.push(Plan { first: t, samples: Vec::new(), bones: Vec::new() });
                plans.len() - 1
            });
            let own = &mut plans[at];
            while own.samples.len() <= t - own.first {
                own.samples.push(Vec::new());
                own.bones.push(Vec::new());
            }
            own.samples[t - own.first].push(k);
        }
        let at = problem.missing_in(t);
        for group in groups_of(t) {
            let Some(k) = at.clone().find(|&k| problem.missing[k].1 == group.markers[0]) else { continue };
            if let Some(at) = number[forest::root(&mut trees, gap_of[k])] {
                let own = &mut plans[at];
                own.bones[t - own.first].extend(&group.bones);
            }
        }
    }
    plans
}

/// What is known about the residual of a marker or the length of a bone.
#[derive(Clone, Copy, Debug)]
struct Process {
    /// m².
    variance: f64,
    /// From frame to frame.
    correlation: f64,
    /// Longer ones are ghosts, m.
    longest: f64,
}

impl Lds<'_> {
    /// Replaces the fill: what the exact E-step expects, until [`Lds::conclude_fill`]; what the bone step makes of the model's expectations in the imputing one.
    pub(super) fn fill(&mut self, smoothed: &Smoothed) {
        if self.options.e_step == EStep::Exact {
            // nothing depends on the fill, so bones can wait for the last round
            self.fill.clone_from(&self.expected);
        } else {
            let model = self.model.clone();
            self.step_bones(&model, &smoothed.means);
        }
    }

    /// The bone step, given the expected states (H × T) and the parameters that go with them.
    pub(super) fn step_bones(&mut self, model: &Model, states: &DMatrix<f64>) {
        let plain: Vec<Vector3<f64>> = self
            .problem
            .missing
            .par_iter()
            .map(|&(t, i)| model.emission.fixed_rows::<3>(3 * i) * states.column(t) + model.offset.fixed_rows::<3>(3 * i))
            .collect();
        match (self.options.constraint, self.options.step) {
            (Constraint::None, _) => {
                for (fill, plain) in self.fill.iter_mut().zip(plain) {
                    *fill = plain.into();
                }
            }
            (_, BoneStep::Coupled) => self.fill_episodes(model, states, &plain),
            (_, BoneStep::Frame | BoneStep::Gradient) => self.fill_frames(&plain),
        }
    }

    /// Whole gaps at once.
    fn fill_episodes(&mut self, model: &Model, states: &DMatrix<f64>, plain: &[Vector3<f64>]) {
        let markers: Vec<Option<Process>> =
            (0..self.problem.markers()).into_par_iter().map(|i| self.marker_process(i, model, states)).collect();
        let bones: Vec<Process> = self.bones.par_iter().map(|bone| self.bone_process(bone)).collect();
        let hard = self.options.constraint == Constraint::Hard;
        let moved: Vec<Vectors> = self
            .plans
            .par_iter()
            .map(|plan| {
                let episode = self.episode(plan, plain, &markers, &bones, &|t, i| self.left_over(t, i, model, states));
                let start = plan.samples.iter().map(|own| own.iter().map(|&k| self.whole(k, self.fill[k])).collect()).collect();
                if hard { episode.hard(start).0 } else { episode.soft(start, MOST_STEPS) }
            })
            .collect();
        for (plan, moved) in self.plans.iter().zip(moved) {
            for (&k, x) in plan.samples.iter().flatten().zip(moved.iter().flatten()) {
                let i = self.problem.missing[k].1;
                self.fill[k] = std::array::from_fn(|axis| x[axis] - self.table.centre[3 * i + axis]);
            }
        }
    }

    /// A position of the table in the body's coordinates, m.
    fn whole(&self, sample: usize, x: [f64; 3]) -> Vector3<f64> {
        let i = self.problem.missing[sample].1;
        Vector3::from_fn(|axis, _| x[axis] + self.table.centre[3 * i + axis])
    }

    /// What the model leaves of a marker in a frame in which it was seen, m.
    fn left_over(&self, t: usize, i: usize, model: &Model, states: &DMatrix<f64>) -> Vector3<f64> {
        let seen: Vector3<f64> = self.table.values.fixed_view::<3, 1>(3 * i, t).into_owned();
        seen - model.offset.fixed_rows::<3>(3 * i) - model.emission.fixed_rows::<3>(3 * i) * states.column(t)
    }

    /// What is known about a marker's residual; none if it has no gap.
    fn marker_process(&self, i: usize, model: &Model, states: &DMatrix<f64>) -> Option<Process> {
        if self.table.missing_of[i].is_empty() {
            return None;
        }
        let found: Vec<Option<Vector3<f64>>> =
            (0..self.problem.frames()).map(|t| self.problem.observed(t, i).then(|| self.left_over(t, i, model, states))).collect();
        let correlation = residual::correlation(&found, self.problem.rate_hz);
        Some(Process { variance: model.marker_noise[i], correlation, longest: residual::longest(&found) })
    }

    /// What is known about the length of a bone.
    fn bone_process(&self, bone: &LocalBone) -> Process {
        let length = bone.squared_length.sqrt();
        let lengths: Vec<Option<f64>> = (0..self.problem.frames()).map(|t| self.length_seen(t, bone)).collect();
        // a bone may have been stated longer or shorter than it was seen: what matters is how its length varies
        let mean = lengths.iter().flatten().sum::<f64>() / lengths.iter().flatten().count().max(1) as f64;
        let found: Vec<Option<Vector3<f64>>> = lengths.iter().map(|l| l.map(|l| Vector3::new(l - mean, 0.0, 0.0))).collect();
        let spread = 1.0 / (2.0 * length * bone.weight);
        let correlation = residual::correlation(&found, self.problem.rate_hz);
        Process { variance: spread * spread, correlation, longest: residual::LONGEST * spread }
    }

    /// The length of a bone in a frame in which both ends were seen, m.
    fn length_seen(&self, t: usize, bone: &LocalBone) -> Option<f64> {
        let at = |i: usize, axis: usize| self.table.values[(3 * i + axis, t)] + self.table.centre[3 * i + axis];
        let both = self.problem.observed(t, bone.a) && self.problem.observed(t, bone.b);
        both.then(|| (0..3).map(|axis| (at(bone.a, axis) - at(bone.b, axis)).powi(2)).sum::<f64>().sqrt())
    }

    /// An episode in numbers. `left_over` is what the model leaves of a marker in a frame in which it was seen, m.
    fn episode(
        &self,
        plan: &Plan,
        plain: &[Vector3<f64>],
        markers: &[Option<Process>],
        bones: &[Process],
        left_over: &dyn Fn(usize, usize) -> Vector3<f64>,
    ) -> Episode {
        let (problem, centre) = (self.problem, &self.table.centre);
        let frames = problem.frames();
        let mut blocks: Vec<Block> = Vec::with_capacity(plan.samples.len());
        for (at, (samples, own)) in plan.samples.iter().zip(&plan.bones).enumerate() {
            let t = plan.first + at;
            let mut block = Block::default();
            for &k in samples {
                let i = problem.missing[k].1;
                let Some(process) = &markers[i] else { continue };
                let seen = |t: usize| {
                    let off = left_over(t, i);
                    Neighbour::Known(off * (process.longest / off.norm().max(process.longest)))
                };
                let slot = |at: usize| {
                    plan.samples[at].iter().position(|&l| problem.missing[l].1 == i).map_or(Neighbour::None, Neighbour::Unknown)
                };
                let before = match t.checked_sub(1) {
                    None => Neighbour::None,
                    Some(before) if problem.observed(before, i) => seen(before),
                    Some(_) => slot(at - 1),
                };
                let after = match t + 1 {
                    after if after == frames => Neighbour::None,
                    after if problem.observed(after, i) => seen(after),
                    _ => slot(at + 1),
                };
                let time = Time::new(process.variance, process.correlation, before, after);
                block.unknowns.push(Unknown { sample: k, expected: self.whole(k, plain[k].into()), time });
            }
            let end = |marker: usize| {
                let free = samples.iter().position(|&k| problem.missing[k].1 == marker);
                let fixed = || Vector3::from_fn(|axis, _| self.table.values[(3 * marker + axis, t)] + centre[3 * marker + axis]);
                free.map_or_else(|| End::Fixed(fixed()), End::Free)
            };
            for &k in own {
                let (bone, process) = (&self.bones[k], &bones[k]);
                let length = bone.squared_length.sqrt();
                let beside = |t: Option<usize>, at: Option<usize>| {
                    let Some(t) = t.filter(|&t| t < frames) else { return Neighbour::None };
                    if let Some(seen) = self.length_seen(t, bone) {
                        return Neighbour::Known((seen - length).clamp(-process.longest, process.longest));
                    }
                    let slot = at.and_then(|at| plan.bones.get(at)).and_then(|bones| bones.iter().position(|&other| other == k));
                    slot.map_or(Neighbour::None, Neighbour::Unknown)
                };
                let time = Time::new(
                    process.variance,
                    process.correlation,
                    beside(t.checked_sub(1), at.checked_sub(1)),
                    beside(Some(t + 1), Some(at + 1)),
                );
                block.ties.push(Tie { ends: [end(bone.a), end(bone.b)], length, time });
            }
            blocks.push(block);
        }
        Episode { blocks }
    }

    /// Each frame alone.
    fn fill_frames(&mut self, plain: &[Vector3<f64>]) {
        let plain: Vec<[f64; 3]> = plain.iter().map(|&x| x.into()).collect();
        let incomplete: Vec<usize> = (0..self.problem.frames()).filter(|&t| !self.problem.missing_in(t).is_empty()).collect();
        let columns: Vec<Vec<f64>> = incomplete.par_iter().map(|&t| self.fill_frame(t, &plain)).collect();
        for (&t, column) in incomplete.iter().zip(columns) {
            for k in self.problem.missing_in(t) {
                let i = self.problem.missing[k].1;
                self.fill[k] = std::array::from_fn(|axis| column[3 * i + axis] + self.model.offset[3 * i + axis]);
            }
        }
    }

    /// One frame, relative to d, m.
    fn fill_frame(&self, t: usize, plain: &[[f64; 3]]) -> Vec<f64> {
        let pattern = self.table.pattern(t);
        let mut column = self.place(t, &self.fill);
        let expected = self.place(t, plain);
        for &i in pattern.missing.iter().filter(|&&i| self.incidence[i].is_empty()) {
            column[3 * i..3 * i + 3].copy_from_slice(&expected[3 * i..3 * i + 3]);
        }
        for group in &pattern.groups {
            let place =
                Place { group, bones: &self.bones, centre: &self.centre, expected: &expected, marker_noise: &self.model.marker_noise };
            match (self.options.constraint, self.options.step) {
                (Constraint::Hard, _) => place.constrain(&mut column),
                (_, BoneStep::Gradient) => place.descend(&mut column),
                _ => place.settle(&mut column),
            }
        }
        column
    }
}
