//! Bones as evidence, frame by frame.

use crate::chance::Chance;
use crate::dense::Gaussian;
use crate::{all_near, near};
use mocap_repair::solve::lds::bones::{Group, LocalBone, groups, incidence, integrate, linearise};
use mocap_repair::solve::lds::model::Model;
use mocap_repair::solve::lds::step::frame::Place;
use nalgebra::{DMatrix, DVector};

/// One frame of seven markers, of which 1, 2, 4 and 5 are missing: a chain 0 - 1 - 2 - 3 with a cross piece 1 - 3, a pair 4 - 5 that hangs at 6,
/// and lengths that the present positions miss by some centimetres. Lengths are in m.
struct Frame {
    missing: Vec<usize>,
    bones: Vec<LocalBone>,
    positions: Vec<f64>,
    centre: Vec<f64>,
    expected: Vec<f64>,
    noise: Vec<f64>,
}

const MARKERS: usize = 7;

impl Frame {
    fn new(chance: &mut Chance) -> Self {
        let truth: Vec<f64> = (0..3 * MARKERS).map(|k| 0.25 * (k / 3) as f64 + 0.15 * chance.normal()).collect();
        let centre: Vec<f64> = truth.iter().map(|x| x + 0.1 * chance.normal()).collect();
        let missing = vec![1, 2, 4, 5];
        let bones = [(0, 1), (1, 2), (2, 3), (1, 3), (4, 5), (5, 6)].map(|(a, b)| {
            let squared_length = (0..3).map(|axis| (truth[3 * a + axis] - truth[3 * b + axis]).powi(2)).sum::<f64>();
            let spread = chance.between(0.002, 0.01);
            LocalBone { a, b, squared_length, weight: 1.0 / (2.0 * squared_length.sqrt() * spread) }
        });
        let positions = (0..3 * MARKERS)
            .map(|k| truth[k] - centre[k] + if missing.contains(&(k / 3)) { 0.03 * chance.normal() } else { 0.0 })
            .collect();
        let expected = (0..3 * MARKERS).map(|k| truth[k] - centre[k] + 0.02 * chance.normal()).collect();
        let noise = (0..MARKERS).map(|_| chance.between(0.005, 0.02).powi(2)).collect();
        Self { missing, bones: bones.to_vec(), positions, centre, expected, noise }
    }

    fn groups(&self) -> Vec<Group> {
        groups(&self.missing, &self.bones, &incidence(&self.bones, MARKERS))
    }

    /// Length of a bone at `positions`, m.
    fn length(&self, bone: &LocalBone, positions: &[f64]) -> f64 {
        let at = |marker: usize, axis: usize| positions[3 * marker + axis] + self.centre[3 * marker + axis];
        (0..3).map(|axis| (at(bone.a, axis) - at(bone.b, axis)).powi(2)).sum::<f64>().sqrt()
    }

    fn place<'a>(&'a self, group: &'a Group) -> Place<'a> {
        Place { group, bones: &self.bones, centre: &self.centre, expected: &self.expected, marker_noise: &self.noise }
    }

    fn penalty(&self, group: &Group, positions: &[f64]) -> f64 {
        self.place(group).penalty(positions)
    }

    /// Slope of the penalty along every coordinate of the group's markers, by differences.
    fn slope(&self, group: &Group, positions: &[f64]) -> DVector<f64> {
        let step = 1e-6;
        DVector::from_iterator(
            3 * group.markers.len(),
            coordinates(group).map(|k| {
                let at = |sign: f64| {
                    let mut moved = positions.to_vec();
                    moved[k] += sign * step;
                    self.penalty(group, &moved)
                };
                (at(1.0) - at(-1.0)) / (2.0 * step)
            }),
        )
    }

    /// The least penalty near `start` as gradient descent finds it, which knows nothing of bones.
    fn descended(&self, group: &Group, start: &[f64]) -> f64 {
        let mut positions = start.to_vec();
        let mut value = self.penalty(group, &positions);
        let mut pace = 1e-6;
        for _ in 0..4000 {
            let slope = self.slope(group, &positions);
            let step = |pace: f64| {
                let mut moved = positions.clone();
                for (k, s) in coordinates(group).zip(&slope) {
                    moved[k] -= pace * s;
                }
                moved
            };
            // Armijo's condition
            while pace > 1e-14 && self.penalty(group, &step(pace)) > value - 0.3 * pace * slope.norm_squared() {
                pace *= 0.5;
            }
            positions = step(pace);
            value = self.penalty(group, &positions);
            pace *= 2.0;
        }
        value
    }
}

/// Indices of the coordinates of a group's markers.
fn coordinates(group: &Group) -> impl Iterator<Item = usize> + '_ {
    group.markers.iter().flat_map(|&marker| 3 * marker..3 * marker + 3)
}

#[test]
fn groups_are_what_bones_between_missing_markers_connect() {
    let frame = Frame::new(&mut Chance::new(1));
    let found: Vec<_> = frame.groups().into_iter().map(|g| (g.markers, g.bones)).collect();
    assert_eq!(found, [(vec![1, 2], vec![0, 1, 2, 3]), (vec![4, 5], vec![4, 5])]);
    // seen markers do not connect, and markers without bones are in no group
    let bones = [(0, 1), (1, 2)].map(|(a, b)| LocalBone { a, b, squared_length: 1.0, weight: 1.0 });
    let found: Vec<_> = groups(&[0, 2, 3], &bones, &incidence(&bones, 4)).into_iter().map(|g| (g.markers, g.bones)).collect();
    assert_eq!(found, [(vec![0], vec![0]), (vec![2], vec![1])]);
}

/// The rows are the lengths in units of each bone's spread, so the Jacobian is their slope and the right side puts the tangent through the present positions.
#[test]
fn linearised_bones_are_the_tangents_of_the_lengths() {
    for seed in 1..=6 {
        let frame = Frame::new(&mut Chance::new(seed));
        for group in frame.groups() {
            let system = linearise(&group, &frame.bones, &frame.positions, &frame.centre);
            let (jacobian, right) = system.dense(group.markers.len());
            let residual = |positions: &[f64]| {
                let rows = group.bones.iter().map(|&k| &frame.bones[k]).map(|bone| {
                    let length = bone.squared_length.sqrt();
                    2.0 * length * bone.weight * (frame.length(bone, positions) - length)
                });
                DVector::from_iterator(group.bones.len(), rows)
            };
            let step = 1e-6;
            for (column, k) in coordinates(&group).enumerate() {
                let at = |sign: f64| {
                    let mut moved = frame.positions.clone();
                    moved[k] += sign * step;
                    residual(&moved)
                };
                let slope = (at(1.0) - at(-1.0)) / (2.0 * step);
                all_near(&format!("seed {seed}, coordinate {k}"), jacobian.column(column).iter(), &slope, 1e-7);
            }
            let here = DVector::from_iterator(3 * group.markers.len(), coordinates(&group).map(|k| frame.positions[k]));
            let off = &jacobian * here - &right;
            all_near(&format!("seed {seed}: residual"), &off, &residual(&frame.positions), 1e-12);
            let log_scale: f64 =
                group.bones.iter().map(|&k| -(2.0 * frame.bones[k].squared_length.sqrt() * frame.bones[k].weight).ln()).sum();
            near("scale", system.log_scale, log_scale, 1e-12);
        }
    }
}

/// Also with damping, which is what an observation of the markers at their present positions with variance 1/μ would do, short of its normalisation.
#[test]
fn integrated_bones_are_those_of_one_gaussian_over_states_markers_and_bones() {
    let mut compared = 0;
    for (seed, damping) in (1..=15).zip([0.0_f64, 2e3, 1e5].into_iter().cycle()) {
        let mut chance = Chance::new(seed);
        let frame = Frame::new(&mut chance);
        let hidden = 1 + seed as usize % 4;
        let model = Model {
            marker_noise: frame.noise.clone(),
            emission: chance.normals(3 * MARKERS, hidden) * 0.05,
            ..chance.model(hidden, MARKERS)
        };
        let prior = Gaussian { mean: chance.normal_vector(hidden), covariance: chance.covariance(hidden, 0.3) };
        for group in frame.groups() {
            let system = linearise(&group, &frame.bones, &frame.positions, &frame.centre);
            let (jacobian, right) = system.dense(group.markers.len());
            let (unknowns, rows) = (3 * group.markers.len(), group.bones.len());
            let rows_of: Vec<usize> = coordinates(&group).collect();
            let anchor: Vec<f64> = rows_of.iter().map(|&k| frame.positions[k]).collect();

            // z, below it x = G z + noise, below it w = J x + unit noise and v = √μ x + unit noise; it turned out that w = r, v = √μ x₀
            let emission = model.emission.select_rows(&rows_of);
            let noise = DVector::from_iterator(unknowns, rows_of.iter().map(|k| model.marker_noise[k / 3]));
            let mut reach = DMatrix::zeros(rows + unknowns, hidden + unknowns);
            reach.view_mut((0, hidden), (rows, unknowns)).copy_from(&jacobian);
            reach.view_mut((rows, hidden), (unknowns, unknowns)).fill_diagonal(damping.sqrt());
            let told = rows + unknowns;
            let all = prior.extend(&emission, &DMatrix::from_diagonal(&noise)).extend(&reach, &DMatrix::identity(told, told));
            let at: Vec<usize> = (hidden + unknowns..hidden + unknowns + told).collect();
            let values: Vec<f64> = right.iter().copied().chain(anchor.iter().map(|x| damping.sqrt() * x)).collect();
            let (expected, log_density) = all.given(&at, &values);
            let log_evidence = log_density - system.log_scale + 0.5 * unknowns as f64 * std::f64::consts::TAU.ln();

            // the same through L, b, c
            let found = integrate(&group, system, &model, damping, &anchor).unwrap();
            let case = format!("seed {seed}, damping {damping}, markers {:?}", group.markers);
            let inverse = prior.covariance.clone().try_inverse().unwrap();
            let covariance = (&inverse + &found.matrix).try_inverse().unwrap();
            let pulled = &inverse * &prior.mean + &found.vector;
            let mean = &covariance * &pulled;
            all_near(&format!("{case}: mean of z"), &mean, expected.mean.rows(0, hidden).iter(), 1e-9);
            all_near(
                &format!("{case}: covariance of z"),
                &covariance,
                &expected.covariance.view((0, 0), (hidden, hidden)).into_owned(),
                1e-9,
            );
            let exponent = prior.mean.dot(&(&inverse * &prior.mean)) + found.constant - pulled.dot(&mean);
            let determinants = prior.covariance.determinant().ln() - covariance.determinant().ln();
            near(&format!("{case}: evidence"), -0.5 * (exponent + determinants), log_evidence, 1e-9);

            // and the markers through A, k and what is left
            let gain = found.gain.transpose();
            let carried = &gain * &covariance;
            let place = &gain * &mean + DVector::from_column_slice(&found.offset);
            all_near(&format!("{case}: mean of x"), &place, expected.mean.rows(hidden, unknowns).iter(), 1e-9);
            all_near(
                &format!("{case}: Cov[x, z]"),
                &carried,
                &expected.covariance.view((hidden, 0), (unknowns, hidden)).into_owned(),
                1e-9,
            );
            for (slot, rest) in found.rest.iter().enumerate() {
                let trace = expected.covariance.view((hidden + 3 * slot, hidden + 3 * slot), (3, 3)).trace();
                let own = carried.rows(3 * slot, 3).dot(&gain.rows(3 * slot, 3)) + rest;
                assert!((own / trace - 1.0).abs() < 1e-7, "{case}: variance of marker {slot}: found {own}, expected {trace}");
            }
            compared += 1;
        }
    }
    assert_eq!(compared, 30);
}

#[test]
fn the_gradient_is_the_slope_of_the_penalty() {
    for seed in 1..=6 {
        let frame = Frame::new(&mut Chance::new(seed));
        for group in frame.groups() {
            let found = frame.place(&group).gradient(&frame.positions);
            all_near(&format!("seed {seed}"), &found, &frame.slope(&group, &frame.positions), 1e-7);
        }
    }
}

#[test]
fn the_bone_step_ends_where_the_penalty_is_least() {
    let mut settled = 0;
    for (seed, gradient) in (1..=6).flat_map(|seed| [(seed, false), (seed, true)]) {
        let mut chance = Chance::new(seed);
        let frame = Frame::new(&mut chance);
        for group in frame.groups() {
            let mut found = frame.positions.clone();
            if gradient {
                frame.place(&group).descend(&mut found);
            } else {
                frame.place(&group).settle(&mut found);
            }
            let case = format!("seed {seed}, gradient {gradient}, markers {:?}", group.markers);
            for k in (0..3 * MARKERS).filter(|k| !group.markers.contains(&(k / 3))) {
                assert_eq!(found[k], frame.positions[k], "{case}: moved a marker that is not its own");
            }
            let (before, value) = (frame.penalty(&group, &frame.positions), frame.penalty(&group, &found));
            assert!(value <= before, "{case}: the penalty rises from {before} to {value}");
            // what is left of the slope would lower the penalty by next to nothing: a Newton step gains at most |slope|² noise / 2
            let slope = frame.slope(&group, &found);
            let gain: f64 = coordinates(&group).zip(&slope).map(|(k, s)| 0.5 * s * s * frame.noise[k / 3]).sum();
            let allowed = if gradient { 0.1 } else { 1e-4 };
            assert!(gain < allowed, "{case}: {gain} to be gained from {value}");
            for _ in 0..3 {
                let start: Vec<f64> = found.iter().map(|x| x + 0.005 * chance.normal()).collect();
                let start: Vec<f64> =
                    (0..3 * MARKERS).map(|k| if group.markers.contains(&(k / 3)) { start[k] } else { found[k] }).collect();
                let least = frame.descended(&group, &start);
                assert!(value <= least + allowed, "{case}: settled at {value}, gradient descent found {least}");
            }
            settled += 1;
        }
    }
    assert_eq!(settled, 24);
}

/// Eq. 37 is the slope of the Lagrangian, Eq. 38 the slope of that, both by differences.
#[test]
fn the_karush_kuhn_tucker_system_is_that_of_the_lagrangian() {
    for seed in 1..=6 {
        let mut chance = Chance::new(seed);
        let frame = Frame::new(&mut chance);
        for group in frame.groups() {
            let place = frame.place(&group);
            let n = 3 * group.markers.len();
            let all = n + group.bones.len();
            let plain = vec![1.0; all]; // no scaling
            let multipliers: Vec<f64> = (0..group.bones.len()).map(|_| 1e3 * chance.normal()).collect();
            let (slope, matrix) = place.lagrangian(&frame.positions, &multipliers, &plain);
            let at = |moves: &[(usize, f64)]| {
                let (mut positions, mut multipliers) = (frame.positions.clone(), multipliers.clone());
                for &(k, step) in moves {
                    match k.checked_sub(n) {
                        None => positions[3 * group.markers[k / 3] + k % 3] += step,
                        Some(row) => multipliers[row] += step,
                    }
                }
                (positions, multipliers)
            };
            let value = |moves: &[(usize, f64)]| {
                let (positions, multipliers) = at(moves);
                let apart: f64 = coordinates(&group).map(|k| 0.5 * (positions[k] - frame.expected[k]).powi(2) / frame.noise[k / 3]).sum();
                let bent = group
                    .bones
                    .iter()
                    .zip(&multipliers)
                    .map(|(&k, eta)| eta * (frame.length(&frame.bones[k], &positions).powi(2) - frame.bones[k].squared_length));
                apart + bent.sum::<f64>()
            };
            let step = |k: usize| if k < n { 1e-6 } else { 1e-1 };
            let differences = DVector::from_fn(all, |k, _| (value(&[(k, step(k))]) - value(&[(k, -step(k))])) / (2.0 * step(k)));
            all_near(&format!("seed {seed}: slope"), &slope, &differences, 1e-6);
            let second = DMatrix::from_fn(all, all, |r, c| {
                let slope = |sign: f64| {
                    let (positions, multipliers) = at(&[(c, sign * step(c))]);
                    place.lagrangian(&positions, &multipliers, &plain).0[r]
                };
                (slope(1.0) - slope(-1.0)) / (2.0 * step(c))
            });
            all_near(&format!("seed {seed}: second derivatives"), &matrix, &second, 1e-6);
        }
    }
}

/// Where the lengths can be met, Newton meets them, and what is left of the pull towards the expectation is a combination of the bones' own directions.
#[test]
fn hard_bones_are_met_where_the_expectation_is_nearest() {
    let mut met = 0;
    for seed in 1..=12 {
        let mut chance = Chance::new(seed);
        let frame = Frame::new(&mut chance);
        for group in frame.groups() {
            let place = frame.place(&group);
            let mut found = frame.positions.clone();
            place.constrain(&mut found);
            assert!(found.iter().all(|x| x.is_finite()));
            assert!(place.worst(&found) < 1e-5, "seed {seed}: off by {} m", place.worst(&found));
            let (n, rows) = (3 * group.markers.len(), group.bones.len());
            let (slope, matrix) = place.lagrangian(&found, &vec![0.0; rows], &vec![1.0; n + rows]);
            let directions = matrix.view((0, n), (n, rows)).into_owned();
            let pull = slope.rows(0, n).into_owned();
            let left = &pull - &directions * directions.clone().svd(true, true).solve(&pull, 1e-9).unwrap();
            // in units of the noise: a thousandth of a standard deviation
            let typical = frame.noise.iter().sum::<f64>().sqrt() / (MARKERS as f64).sqrt();
            assert!(left.norm() * typical < 2e-2, "seed {seed}: {} of {} is left", left.norm() * typical, pull.norm() * typical);
            met += 1;
        }
    }
    assert_eq!(met, 24);
}
