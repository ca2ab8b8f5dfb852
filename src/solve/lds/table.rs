//! The take as the solver sees it: body-local, in metres, less a fixed centre; and what of it is missing where.

use super::bones::{Group, LocalBone, groups};
use crate::solve::Problem;
use crate::solve::body::BodyFrames;
use nalgebra::{DMatrix, DVector};
use std::collections::HashMap;

/// Frames in which the same markers are missing say the same about the model.
#[derive(Clone, Debug, Default)]
pub struct Pattern {
    /// Columns of the problem that are missing, ascending.
    pub missing: Vec<usize>,
    /// Groups of missing markers that bones connect, as far as they have something to say ([`Group::held`]).
    pub held: Vec<Group>,
    /// All such groups.
    pub groups: Vec<Group>,
    /// All of `held` in one: their bones speak about the states together.
    pub spoken: Group,
}

/// Positions with holes.
pub struct Table {
    /// Coordinates less `centre`, 0 where missing; m × T, in m.
    pub values: DMatrix<f64>,
    /// What each coordinate is measured from: the mean of what was seen of it, m.
    pub centre: Vec<f64>,
    /// Σ of each coordinate over the frames in which it was seen, m.
    pub sums: DVector<f64>,
    /// Σ of the squared norm of each marker over the frames in which it was seen, m².
    pub squares: Vec<f64>,
    /// Number of frames in which each marker was seen.
    pub seen: Vec<usize>,
    /// For each marker, its entries in the problem's list of missing samples.
    pub missing_of: Vec<Vec<usize>>,
    /// What can be missing; the first pattern is nothing.
    pub patterns: Vec<Pattern>,
    /// For each frame, its pattern.
    pub pattern_of: Vec<u32>,
}

impl Table {
    /// Turns the problem into the body's coordinates, measured from the mean of each if `centred`. `bones` and `incidence` (bones at each marker) make the groups.
    pub fn new(problem: &Problem, body: &BodyFrames, bones: &[LocalBone], incidence: &[Vec<usize>], centred: bool) -> Self {
        let (frames, markers) = (problem.frames(), problem.markers());
        let mut values = DMatrix::zeros(3 * markers, frames);
        let mut centre = vec![0.0; 3 * markers];
        let mut seen = vec![0usize; markers];
        for (t, mut column) in values.column_iter_mut().enumerate() {
            for i in 0..markers {
                if let Some(p) = problem.position_mm(t, i) {
                    let local = body.to_local(t, p);
                    for axis in 0..3 {
                        column[3 * i + axis] = local[axis] / 1000.0;
                        centre[3 * i + axis] += local[axis] / 1000.0;
                    }
                    seen[i] += 1;
                }
            }
        }
        for (k, sum) in centre.iter_mut().enumerate() {
            *sum = if centred { *sum / seen[k / 3].max(1) as f64 } else { 0.0 };
        }
        let mut sums = DVector::zeros(3 * markers);
        let mut squares = vec![0.0; markers];
        let mut missing_of = vec![Vec::new(); markers];
        let mut patterns = vec![Pattern::default()];
        let mut known: HashMap<Vec<usize>, u32> = HashMap::new();
        let mut pattern_of = vec![0; frames];
        for (t, mut column) in values.column_iter_mut().enumerate() {
            for i in (0..markers).filter(|&i| problem.observed(t, i)) {
                for k in 3 * i..3 * i + 3 {
                    column[k] -= centre[k];
                    sums[k] += column[k];
                    squares[i] += column[k] * column[k];
                }
            }
            let range = problem.missing_in(t);
            if range.is_empty() {
                continue;
            }
            let missing: Vec<usize> = problem.missing[range.clone()].iter().map(|&(_, i)| i).collect();
            for (k, &i) in range.zip(&missing) {
                missing_of[i].push(k);
            }
            pattern_of[t] = *known.entry(missing).or_insert_with_key(|missing| {
                let groups = groups(missing, bones, incidence);
                let held: Vec<Group> = groups.iter().filter(|g| g.held(bones)).cloned().collect();
                let mut spoken = Group {
                    markers: held.iter().flat_map(|g| g.markers.iter().copied()).collect(),
                    bones: held.iter().flat_map(|g| g.bones.iter().copied()).collect(),
                };
                spoken.markers.sort_unstable();
                patterns.push(Pattern { missing: missing.clone(), held, groups, spoken });
                patterns.len() as u32 - 1
            });
        }
        Self { values, centre, sums, squares, seen, missing_of, patterns, pattern_of }
    }

    /// What is missing in a frame.
    pub fn pattern(&self, frame: usize) -> &Pattern {
        &self.patterns[self.pattern_of[frame] as usize]
    }
}
