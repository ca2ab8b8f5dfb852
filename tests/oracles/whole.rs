//! The solvers themselves: their first round against one big Gaussian, their likelihoods, and what they learn from a system that is known.

use crate::chance::Chance;
use crate::dense::{Gaussian, Table, evidence, seen};
use crate::near;
use formats::{Marker, Origin, Take, TakeBuilder};
use mocap_repair::demo::{DemoOptions, demo, hide, walk};
use mocap_repair::solve::body::BodyFrames;
use mocap_repair::solve::lds::bones::{Group, LocalBone, linearise};
use mocap_repair::solve::lds::kalman::smooth;
use mocap_repair::solve::lds::model::Model;
use mocap_repair::solve::lds::{EStep, Lds, Options, Penalty};
use mocap_repair::solve::{Bone, Limits, Method, Observer, Problem, Settings, Solver, Step, Stop, run};
use nalgebra::{DMatrix, DVector};

/// Markers called M0, M1, ... that swing by decimetres around places of their own, in mm.
fn swing(chance: &mut Chance, markers: usize, frames: usize) -> Take {
    let mut take = TakeBuilder::new((0..markers).map(|i| Marker::new(format!("M{i}"))).collect(), frames, 50.0);
    for i in 0..markers {
        let place: [f64; 3] = std::array::from_fn(|axis| if axis == 2 { 700.0 * i as f64 } else { 300.0 * chance.normal() });
        let (pace, start) = (chance.between(0.2, 0.5), chance.between(0.0, 6.0));
        let along: [f64; 3] = std::array::from_fn(|_| 100.0 * chance.normal());
        for t in 0..frames {
            let swung = (pace * t as f64 + start).sin();
            take.set(t, i, std::array::from_fn(|axis| place[axis] + along[axis] * swung + 15.0 * chance.normal()), Origin::Measured);
        }
    }
    take.build()
}

/// The take without the samples that chance hides; the first frame stays whole.
fn scatter(take: &Take, chance: &mut Chance, share: f64) -> Take {
    let mut holes = TakeBuilder::from(take.clone());
    for t in 1..take.frames() {
        for i in 0..take.markers.len() {
            if chance.happens(share) {
                holes.hide(t, i);
            }
        }
    }
    holes.build()
}

/// A problem as a table in the coordinates of the solver: body-local, in metres, less the mean of what was seen of each coordinate.
struct Local {
    table: Table,
    centre: Vec<f64>,
    body: BodyFrames,
}

impl Local {
    fn new(problem: &Problem) -> Self {
        let body = BodyFrames::find(problem);
        let mut table = DMatrix::from_element(3 * problem.markers(), problem.frames(), f64::NAN);
        for t in 0..problem.frames() {
            for i in 0..problem.markers() {
                if let Some(p) = problem.position_mm(t, i) {
                    table.view_mut((3 * i, t), (3, 1)).copy_from_slice(&body.to_local(t, p).map(|x| x / 1000.0));
                }
            }
        }
        let mut centre = Vec::new();
        for mut row in table.row_iter_mut() {
            let known: Vec<f64> = row.iter().copied().filter(|x| !x.is_nan()).collect();
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            row.add_scalar_mut(-mean);
            centre.push(mean);
        }
        Self { table, centre, body }
    }

    /// Where a world position (mm) is in the table.
    fn place(&self, frame: usize, marker: usize, world_mm: [f64; 3]) -> [f64; 3] {
        let local = self.body.to_local(frame, world_mm);
        std::array::from_fn(|axis| local[axis] / 1000.0 - self.centre[3 * marker + axis])
    }

    /// Where an entry of the table is in the world, mm.
    fn world_mm(&self, frame: usize, marker: usize, place: [f64; 3]) -> [f64; 3] {
        self.body.to_world(frame, std::array::from_fn(|axis| 1000.0 * (place[axis] + self.centre[3 * marker + axis])))
    }
}

/// One round of EM from a fresh start against one Gaussian over all states, all coordinates and all bones.
fn first_round(seed: u64, markers: usize, frames: usize, share: f64, bones: &[Bone]) {
    let mut chance = Chance::new(seed);
    let take = scatter(&swing(&mut chance, markers, frames), &mut chance, share);
    let problem = Problem::new(&take, &vec![true; markers], bones);
    assert!(!problem.missing.is_empty());
    let local = Local::new(&problem);
    let penalty = if bones.is_empty() { Penalty::None } else { Penalty::Spread };
    let mut solver = Lds::new(&problem, Options { hidden: 3, penalty, e_step: EStep::Exact });
    let model = solver.model().clone();
    let start = solver.estimate().clone();
    let progress = solver.step().unwrap();

    let states = model.hidden() * frames;
    let entry = |t: usize, i: usize| states + t * 3 * markers + 3 * i;
    let (mut at, mut values) = seen(&model, &local.table);
    let mut all = Gaussian::system(&model, frames);
    let mut log_scale = 0.0;
    // the bones of a frame, linearised where its missing markers are at the start
    for t in (0..frames).filter(|&t| !bones.is_empty() && !problem.missing_in(t).is_empty()) {
        let mut place: Vec<f64> = local.table.column(t).iter().copied().collect();
        for k in problem.missing_in(t) {
            let i = problem.missing[k].1;
            place[3 * i..3 * i + 3].copy_from_slice(&local.place(t, i, start.positions_mm[k]));
        }
        let missing: Vec<usize> = problem.missing[problem.missing_in(t)].iter().map(|&(_, i)| i).collect();
        let own: Vec<LocalBone> = bones
            .iter()
            .filter(|bone| missing.contains(&bone.a) || missing.contains(&bone.b))
            .map(|bone| LocalBone {
                a: bone.a,
                b: bone.b,
                squared_length: (bone.length_mm / 1000.0).powi(2),
                weight: 1.0 / (2.0 * bone.length_mm / 1000.0 * bone.spread_mm.hypot(1.0) / 1000.0),
            })
            .collect();
        let group = Group { markers: missing, bones: (0..own.len()).collect() };
        let system = linearise(&group, &own, &place, &local.centre);
        let mut reach = DMatrix::zeros(own.len(), all.mean.len());
        for (slot, &i) in group.markers.iter().enumerate() {
            reach.columns_mut(entry(t, i), 3).copy_from(&system.jacobian.columns(3 * slot, 3));
        }
        at.extend(all.mean.len()..all.mean.len() + own.len());
        values.extend(system.right.iter());
        all = all.extend(&reach, &DMatrix::identity(own.len(), own.len()));
        log_scale += system.log_scale;
    }
    let (expected, log_density) = all.given(&at, &values);

    let case = format!("{markers} markers, {frames} frames, {} missing, {} bones", problem.missing.len(), bones.len());
    near(&format!("{case}: log-likelihood"), progress.log_likelihood.unwrap(), log_density - log_scale, 1e-7);
    let estimate = solver.estimate();
    for (k, &(t, i)) in problem.missing.iter().enumerate() {
        let from = entry(t, i);
        let right = local.world_mm(t, i, std::array::from_fn(|axis| expected.mean[from + axis]));
        for axis in 0..3 {
            let off = (estimate.positions_mm[k][axis] - right[axis]).abs();
            assert!(off < 1e-5, "{case}: marker {i} in frame {t} is off by {off} mm");
        }
        let sigma_mm = 1000.0 * expected.covariance.view((from, from), (3, 3)).trace().sqrt();
        assert!(
            (estimate.sigma_mm[k] / sigma_mm - 1.0).abs() < 1e-6,
            "{case}: sigma of marker {i} in frame {t}: {} {sigma_mm}",
            estimate.sigma_mm[k]
        );
    }
}

#[test]
fn the_first_round_without_bones_is_one_gaussian() {
    first_round(1, 2, 20, 0.3, &[]);
    first_round(2, 4, 15, 0.2, &[]);
    first_round(3, 5, 12, 0.6, &[]); // black-outs, and frames of which next to nothing was seen
}

#[test]
fn the_first_round_with_bones_is_one_gaussian() {
    let bone = |a, b| Bone { a, b, length_mm: 700.0, spread_mm: 6.0 };
    first_round(4, 2, 20, 0.3, &[bone(0, 1)]);
    first_round(5, 4, 15, 0.3, &[bone(0, 1), bone(1, 2), bone(2, 3)]);
    // marker 4 has no bone, and in most frames the missing ones fall into two groups
    first_round(6, 6, 12, 0.6, &[bone(0, 1), bone(0, 2), bone(1, 2), bone(3, 5)]);
}

/// Keeps what a solver claimed.
#[derive(Default)]
struct Claims(Vec<f64>);

impl Observer for Claims {
    fn stepped(&mut self, step: &Step<'_>) {
        self.0.extend(step.progress.log_likelihood);
    }
}

#[test]
fn the_likelihood_never_falls_without_bones() {
    let made = demo(&DemoOptions { frames: 240, ..DemoOptions::default() });
    assert!(made.hidden.len() > 10);
    let walked = walk(150, 120.0, 2);
    let few = {
        let mut take = TakeBuilder::new(walked.markers[..4].to_vec(), walked.frames(), walked.rate_hz);
        for t in 0..walked.frames() {
            for i in 0..4 {
                take.set(t, i, walked.position_mm(t, i).unwrap(), Origin::Measured);
            }
        }
        scatter(&take.build(), &mut Chance::new(4), 0.2)
    };
    let dark = walked.markers.iter().fold(walked.clone(), |take, marker| hide(&take, marker.name(), 60..80));
    for (what, take) in [
        ("the demo", &made.gaps),
        ("scattered holes", &scatter(&walked, &mut Chance::new(3), 0.1)),
        ("a black-out", &dark),
        ("four markers", &few),
    ] {
        let problem = Problem::new(take, &vec![true; take.markers.len()], &[]);
        let mut solver = Method::Lds.solver(&problem, &Settings::default());
        let limits = Limits { steps: 40, tolerance: 0.0, still_mm: -1.0, interrupt: None };
        let mut claims = Claims::default();
        let outcome = run(solver.as_mut(), &problem, 0, &limits, &mut claims);
        assert_eq!((outcome.stop, outcome.steps, claims.0.len()), (Stop::StepLimit, 40, 40), "{what}");
        for (round, pair) in claims.0.windows(2).enumerate() {
            assert!(pair[1] >= pair[0] - 1e-9 * pair[0].abs(), "{what}: round {} falls from {} to {}", round + 1, pair[0], pair[1]);
        }
        assert!(claims.0[39] > claims.0[0] + 1.0, "{what}: nothing was learned");
    }
}

/// Turn of the hidden swing per frame, in radians, and what it keeps of its size.
const TURN: f64 = 0.25;
const KEPT: f64 = 0.98;

/// Two markers driven by a hidden swing with a stir in every frame, in the world's axes because two markers make no body; and their places at rest, in mm.
fn known_system(chance: &mut Chance) -> (Model, [[f64; 3]; 2]) {
    let identity = DMatrix::identity(2, 2);
    let model = Model {
        transition: DMatrix::from_row_slice(2, 2, &[TURN.cos(), -TURN.sin(), TURN.sin(), TURN.cos()]) * KEPT,
        emission: chance.normals(6, 2) * 0.07, // m per unit of the state
        state_noise: &identity * 0.15_f64.powi(2),
        marker_noise: vec![0.012_f64.powi(2), 0.02_f64.powi(2)],
        initial_mean: DVector::zeros(2),
        initial_covariance: identity * 0.5,
    };
    (model, [[500.0, -200.0, 900.0], [500.0, -200.0, 1200.0]])
}

#[test]
fn em_finds_the_system_that_made_the_data() {
    const FRAMES: usize = 400;
    let mut chance = Chance::new(11);
    let (made, places) = known_system(&mut chance);
    let mut state = chance.normal_vector(2) * 0.7;
    let mut truth = TakeBuilder::new(["A", "B"].map(Marker::new).to_vec(), FRAMES, 100.0);
    for t in 0..FRAMES {
        let clean = &made.emission * &state;
        for (i, place) in places.iter().enumerate() {
            let seen = |axis: usize| place[axis] + 1000.0 * (clean[3 * i + axis] + made.marker_noise[i].sqrt() * chance.normal());
            truth.set(t, i, [0, 1, 2].map(seen), Origin::Measured);
        }
        state = &made.transition * state + chance.normal_vector(2) * made.state_noise[(0, 0)].sqrt();
    }
    let truth = truth.build();
    let take = scatter(&truth, &mut chance, 0.1);
    let problem = Problem::new(&take, &[true; 2], &[]);
    let mut solver = Lds::new(&problem, Options { hidden: 2, penalty: Penalty::None, e_step: EStep::Exact });
    for _ in 0..60 {
        solver.step().unwrap();
    }
    let found = solver.model();

    // the hidden axes are free, but not how fast the swing turns and fades, nor how far a stir throws the markers
    for value in found.transition.complex_eigenvalues().iter() {
        assert!((value.norm() - KEPT).abs() < 0.02, "keeps {} per frame", value.norm());
        assert!((value.arg().abs() - TURN).abs() < 0.02, "turns by {}", value.arg());
    }
    let thrown = |model: &Model| (&model.emission * &model.state_noise * model.emission.transpose()).trace().sqrt();
    assert!((thrown(found) / thrown(&made) - 1.0).abs() < 0.1, "throws by {} m, should be {}", thrown(found), thrown(&made));
    for (i, (noise, right)) in found.marker_noise.iter().zip(&made.marker_noise).enumerate() {
        assert!(((noise / right).sqrt() - 1.0).abs() < 0.1, "noise of marker {i}: {} m, should be {}", noise.sqrt(), right.sqrt());
    }

    // the held-out samples are missed hardly farther than by somebody who knows the system, and as far as the solver says
    let mut table = DMatrix::from_element(6, FRAMES, f64::NAN);
    for t in 0..FRAMES {
        for i in (0..2).filter(|&i| problem.observed(t, i)) {
            let p = take.position_mm(t, i).unwrap();
            table.view_mut((3 * i, t), (3, 1)).copy_from_slice(&[0, 1, 2].map(|axis| (p[axis] - places[i][axis]) / 1000.0));
        }
    }
    let known = &made.emission * smooth(&made, &evidence(&made, &table)).unwrap().means;
    let (mut own, mut others, mut surprise) = (0.0, 0.0, 0.0);
    let estimate = solver.estimate();
    for (k, &(t, i)) in problem.missing.iter().enumerate() {
        let right = truth.position_mm(t, i).unwrap();
        let off = |p: [f64; 3]| (0..3).map(|axis| (p[axis] - right[axis]).powi(2)).sum::<f64>();
        own += off(estimate.positions_mm[k]);
        others += off([0, 1, 2].map(|axis| places[i][axis] + 1000.0 * known[(3 * i + axis, t)]));
        surprise += off(estimate.positions_mm[k]) / estimate.sigma_mm[k].powi(2);
    }
    let samples = problem.missing.len();
    assert!(samples > 60, "{samples}");
    assert!(
        own < 1.1 * others,
        "missed by {} mm, by {} mm knowing the system",
        (own / samples as f64).sqrt(),
        (others / samples as f64).sqrt()
    );
    let surprise = surprise / samples as f64;
    assert!((surprise - 1.0).abs() < 0.25, "squared errors are {surprise} times what the solver says");
}
