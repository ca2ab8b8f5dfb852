//! The bone steps as the paper prints them: each frame alone.
//!
//! `positions`, `expected` (x⁻ = G E[z]) are one frame, relative to `centre`, m; positions hold the start and receive the result.

use super::band::{Block, End, Episode, MET_M, Tie, Time, Unknown};
use crate::solve::lds::bones::{Group, LocalBone, tangents};
use nalgebra::{DMatrix, DVector, Vector3};

/// What a bone step works on: the missing markers of a group in one frame.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// Whom it is about.
    pub group: &'a Group,
    /// All bones.
    pub bones: &'a [LocalBone],
    /// What positions are relative to, m.
    pub centre: &'a [f64],
    /// Where the model expects the markers of the frame, m.
    pub expected: &'a [f64],
    /// r of each marker, m².
    pub marker_noise: &'a [f64],
}

impl Place<'_> {
    /// Number of unknown coordinates.
    fn unknowns(&self) -> usize {
        3 * self.group.markers.len()
    }

    /// Where unknown `k` stands in a frame.
    fn at(&self, k: usize) -> usize {
        3 * self.group.markers[k / 3] + k % 3
    }

    /// 1 / r of unknown `k`.
    fn precision(&self, k: usize) -> f64 {
        1.0 / self.marker_noise[self.group.markers[k / 3]]
    }

    /// From the second end of a bone to the first, m.
    fn along(&self, bone: &LocalBone, positions: &[f64]) -> [f64; 3] {
        let at = |marker: usize, axis: usize| positions[3 * marker + axis] + self.centre[3 * marker + axis];
        std::array::from_fn(|axis| at(bone.a, axis) - at(bone.b, axis))
    }

    /// ‖xᵢ - xⱼ‖² - d² of a bone, m².
    fn off(&self, bone: &LocalBone, positions: &[f64]) -> f64 {
        self.along(bone, positions).iter().map(|x| x * x).sum::<f64>() - bone.squared_length
    }

    /// The largest violation of a length in the group, m.
    pub fn worst(&self, positions: &[f64]) -> f64 {
        let off =
            |bone: &LocalBone| (self.along(bone, positions).iter().map(|x| x * x).sum::<f64>().sqrt() - bone.squared_length.sqrt()).abs();
        self.group.bones.iter().map(|&k| off(&self.bones[k])).fold(0.0, f64::max)
    }

    /// f of Eq. 11 without its constant part.
    pub fn penalty(&self, positions: &[f64]) -> f64 {
        let apart: f64 = (0..self.unknowns())
            .map(|k| {
                let away = positions[self.at(k)] - self.expected[self.at(k)];
                0.5 * away * away * self.precision(k)
            })
            .sum();
        let bent: f64 = self.group.bones.iter().map(|&k| &self.bones[k]).map(|b| 0.5 * (b.weight * self.off(b, positions)).powi(2)).sum();
        apart + bent
    }

    /// Eq. 10: the slope of f along the unknowns.
    pub fn gradient(&self, positions: &[f64]) -> DVector<f64> {
        let mut slope = DVector::from_fn(self.unknowns(), |k, _| (positions[self.at(k)] - self.expected[self.at(k)]) * self.precision(k));
        for bone in self.group.bones.iter().map(|&k| &self.bones[k]) {
            let pull = 2.0 * bone.weight * bone.weight * self.off(bone, positions);
            self.add_along(bone, positions, pull, slope.as_mut_slice());
        }
        slope
    }

    /// Adds `share` times the slope of ½ (‖xᵢ - xⱼ‖² - d²) to the rows of the bone's missing ends (Eq. 37: + at i, - at j).
    fn add_along(&self, bone: &LocalBone, positions: &[f64], share: f64, slope: &mut [f64]) {
        let along = self.along(bone, positions);
        for (marker, sign) in [(bone.a, 1.0), (bone.b, -1.0)] {
            if let Ok(slot) = self.group.markers.binary_search(&marker) {
                for (axis, along) in along.iter().enumerate() {
                    slope[3 * slot + axis] += share * sign * along;
                }
            }
        }
    }

    /// The least of f by Gauss-Newton steps with halving: the same minimum as the paper's gradient steps (Eq. 9, 12), in about ten steps instead of a hundred.
    pub fn settle(&self, positions: &mut [f64]) {
        let mut value = self.penalty(positions);
        for _ in 0..20 {
            // the squares themselves: steps towards the least of something else would not end at the least of f
            let (jacobian, right) = tangents(self.group, self.bones, positions, self.centre, &|bone, squared| {
                ((squared - bone.squared_length) * bone.weight, 2.0 * bone.weight)
            });
            let mut normal = jacobian.tr_mul(&jacobian);
            let mut right = jacobian.tr_mul(&right);
            for k in 0..self.unknowns() {
                normal[(k, k)] += self.precision(k);
                right[k] += self.expected[self.at(k)] * self.precision(k);
            }
            let Some(target) = normal.cholesky().map(|c| c.solve(&right)) else { return };
            let before: Vec<f64> = (0..self.unknowns()).map(|k| positions[self.at(k)]).collect();
            let mut share = 1.0;
            let mut moved = 0.0f64;
            loop {
                for k in 0..self.unknowns() {
                    positions[self.at(k)] = before[k] + share * (target[k] - before[k]);
                }
                let now = self.penalty(positions);
                if now <= value {
                    moved = (0..self.unknowns()).fold(0.0, |most: f64, k| most.max((share * (target[k] - before[k])).abs()));
                    value = now;
                    break;
                }
                share *= 0.5;
                if share < 1e-3 {
                    for k in 0..self.unknowns() {
                        positions[self.at(k)] = before[k];
                    }
                    break;
                }
            }
            if moved < 1e-6 {
                return;
            }
        }
    }

    /// The G-step of Algorithm 2 as printed: steps down the gradient (Eq. 9, 10), twice as long after each that lowered f, half as long after each that did not.
    pub fn descend(&self, positions: &mut [f64]) {
        let mut value = self.penalty(positions);
        let mut pace = 1.0;
        for _ in 0..1000 {
            let slope = self.gradient(positions);
            let before: Vec<f64> = (0..self.unknowns()).map(|k| positions[self.at(k)]).collect();
            for k in 0..self.unknowns() {
                positions[self.at(k)] = before[k] - pace * slope[k];
            }
            let now = self.penalty(positions);
            if now < value {
                let gained = value - now;
                value = now;
                if pace * slope.amax() < 1e-6 && gained < 1e-6 * value.max(1.0) {
                    return;
                }
                pace *= 2.0;
            } else {
                for k in 0..self.unknowns() {
                    positions[self.at(k)] = before[k];
                }
                pace *= 0.5;
                if pace * slope.amax() < 1e-12 {
                    return;
                }
            }
        }
    }

    /// Slope of the Lagrangian (Eq. 37) and its second derivatives (Eq. 38), unknowns first, then one multiplier per active constraint.
    ///
    /// Both are scaled, rows and columns alike, to the units of the noise: x in √r, η so that a constraint moves by about one when x does.
    pub fn lagrangian(&self, positions: &[f64], multipliers: &[f64], scale: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
        let (n, rows) = (self.unknowns(), self.group.bones.len());
        let mut slope = DVector::zeros(n + rows);
        let mut matrix = DMatrix::zeros(n + rows, n + rows);
        for k in 0..n {
            slope[k] = (positions[self.at(k)] - self.expected[self.at(k)]) * self.precision(k);
            matrix[(k, k)] = self.precision(k);
        }
        for (row, bone) in self.group.bones.iter().map(|&k| &self.bones[k]).enumerate() {
            let mut along = vec![0.0; n];
            self.add_along(bone, positions, 2.0, &mut along);
            slope[n + row] = self.off(bone, positions);
            for (k, along) in along.iter().enumerate() {
                slope[k] += multipliers[row] * along;
                matrix[(k, n + row)] = *along;
                matrix[(n + row, k)] = *along;
            }
            // 2 η on the diagonal of both ends, -2 η between them
            let slots = [bone.a, bone.b].map(|marker| self.group.markers.binary_search(&marker).ok());
            for (p, one) in slots.iter().enumerate() {
                for (q, other) in slots.iter().enumerate() {
                    if let (Some(one), Some(other)) = (one, other) {
                        for axis in 0..3 {
                            matrix[(3 * one + axis, 3 * other + axis)] += if p == q { 2.0 } else { -2.0 } * multipliers[row];
                        }
                    }
                }
            }
        }
        for (k, s) in scale.iter().enumerate() {
            slope[k] *= s;
            matrix.row_mut(k).scale_mut(*s);
            matrix.column_mut(k).scale_mut(*s);
        }
        (slope, matrix)
    }

    /// The scale of each unknown and each multiplier.
    pub fn scale(&self) -> Vec<f64> {
        let noise = |k: usize| 1.0 / self.precision(k).sqrt();
        let typical = (0..self.unknowns()).map(noise).sum::<f64>() / self.unknowns().max(1) as f64;
        let constraint = |&k: &usize| 1.0 / (2.0 * self.bones[k].squared_length.sqrt() * typical);
        (0..self.unknowns()).map(noise).chain(self.group.bones.iter().map(constraint)).collect()
    }

    /// The N-step of Algorithm 1: steps of half of Newton's on the Karush-Kuhn-Tucker system (Eq. 7), multipliers from 0.
    ///
    /// The matrix is indefinite, and singular where constraints repeat each other or ask for more than a marker has freedoms;
    /// then the step is the shortest of those that solve the system best. Returns the largest violation that is left, m:
    /// not small if the constraints contradict each other or Newton was led astray, which nothing in the printed algorithm keeps it from.
    pub fn newton(&self, positions: &mut [f64]) -> f64 {
        let n = self.unknowns();
        let scale = self.scale();
        let mut multipliers = vec![0.0; self.group.bones.len()];
        let start: Vec<f64> = (0..n).map(|k| positions[self.at(k)]).collect();
        let first = self.worst(positions);
        for _ in 0..60 {
            let (slope, matrix) = self.lagrangian(positions, &multipliers, &scale);
            let Some(step) = solve_safely(&matrix, &slope) else { break };
            let mut farthest = 0.0f64;
            for k in 0..n {
                let step = 0.5 * scale[k] * step[k];
                positions[self.at(k)] -= step;
                farthest = farthest.max(step.abs());
            }
            for (row, multiplier) in multipliers.iter_mut().enumerate() {
                *multiplier -= 0.5 * scale[n + row] * step[n + row];
            }
            if farthest < 1e-9 {
                break;
            }
        }
        let worst = self.worst(positions);
        if worst.is_finite() && worst <= first.max(1e-3) {
            return worst;
        }
        for k in 0..n {
            positions[self.at(k)] = start[k];
        }
        first
    }
}

impl Place<'_> {
    /// Hard constraints in one frame: Newton as printed, and where that does not end in exact lengths, the method of multipliers ([`super::band`]),
    /// which always ends; whichever violates them less.
    pub fn constrain(&self, positions: &mut [f64]) {
        let start = positions.to_vec();
        let worst = self.newton(positions);
        if worst < MET_M {
            return;
        }
        let whole =
            |positions: &[f64], marker: usize| Vector3::from_fn(|axis, _| positions[3 * marker + axis] + self.centre[3 * marker + axis]);
        let unknowns = self.group.markers.iter().map(|&i| Unknown {
            sample: i,
            expected: whole(self.expected, i),
            time: Time { own: 1.0 / self.marker_noise[i], ..Time::default() },
        });
        let end =
            |marker: usize| self.group.markers.binary_search(&marker).map_or_else(|_| End::Fixed(whole(positions, marker)), End::Free);
        let ties = self.group.bones.iter().map(|&k| &self.bones[k]).map(|bone| {
            let length = bone.squared_length.sqrt();
            let stiffness = 2.0 * length * bone.weight;
            Tie { ends: [end(bone.a), end(bone.b)], length, time: Time { own: stiffness * stiffness, ..Time::default() } }
        });
        let episode = Episode { blocks: vec![Block { unknowns: unknowns.collect(), ties: ties.collect() }] };
        let (found, safe) = episode.hard(vec![self.group.markers.iter().map(|&i| whole(&start, i)).collect()]);
        if worst.is_nan() || safe < worst {
            for (&marker, x) in self.group.markers.iter().zip(&found[0]) {
                for axis in 0..3 {
                    positions[3 * marker + axis] = x[axis] - self.centre[3 * marker + axis];
                }
            }
        }
    }
}

/// Solves a symmetric system that may be singular: by elimination if that gives an answer, else the shortest of the best answers.
/// None if the numbers are not finite.
fn solve_safely(matrix: &DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let eliminated = matrix.clone().lu().solve(right);
    if let Some(x) = eliminated
        && x.iter().all(|x| x.is_finite())
        && (matrix * &x - right).norm() <= 1e-9 * right.norm()
        && x.norm() <= 1e8 * right.norm()
    {
        return Some(x);
    }
    if !matrix.iter().chain(right.iter()).all(|x| x.is_finite()) {
        return None;
    }
    let parts = matrix.clone().try_svd(true, true, 1e-14, 1000)?;
    let largest = parts.singular_values.iter().fold(0.0f64, |most, s| most.max(*s));
    parts.solve(right, 1e-10 * largest).ok()
}
