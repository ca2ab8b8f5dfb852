//! The solvers themselves: their first round against one big Gaussian, their likelihoods, and what they learn from a system that is known.

use crate::chance::Chance;
use crate::dense::{Gaussian, Table, evidence, seen};
use crate::near;
use formats::{Marker, Origin, Take, TakeBuilder};
use mocap_repair::demo::{DemoOptions, demo, hide, walk};
use mocap_repair::solve::body::BodyFrames;
use mocap_repair::solve::lds::bones::{Group, LocalBone, groups, incidence, linearise};
use mocap_repair::solve::lds::model::Model;
use mocap_repair::solve::lds::smoother::smooth;
use mocap_repair::solve::lds::{Constraint, Hidden, Lds, Options};
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

    /// Where an entry of the table is in the world, mm.
    fn world_mm(&self, frame: usize, marker: usize, place: [f64; 3]) -> [f64; 3] {
        self.body.to_world(frame, std::array::from_fn(|axis| 1000.0 * (place[axis] + self.centre[3 * marker + axis])))
    }
}

/// Bones of a problem in the terms of the solver, m.
fn local_bones(bones: &[Bone]) -> Vec<LocalBone> {
    let local = |bone: &Bone| {
        let (length, spread) = (bone.length_mm / 1000.0, bone.spread_mm.hypot(1.0) / 1000.0);
        LocalBone { a: bone.a, b: bone.b, squared_length: length * length, weight: 1.0 / (2.0 * length * spread) }
    };
    bones.iter().map(local).collect()
}

/// True if some bone of the group has an end that is not missing.
fn reaches(group: &Group, bones: &[LocalBone], missing: &[usize]) -> bool {
    group.bones.iter().any(|&k| !(missing.contains(&bones[k].a) && missing.contains(&bones[k].b)))
}

/// Everything that a problem says under a model, as one Gaussian over all states, all coordinates and all bones.
struct Dense {
    posterior: Gaussian,
    log_likelihood: f64,
    states: usize,
    width: usize,
    /// Rows of bones in all frames, and frames whose bones were left out.
    heard: usize,
    unheard: usize,
}

impl Dense {
    /// `bones` are linearised where `anchor` puts each missing sample, all those of a frame in one system.
    fn new(model: &Model, problem: &Problem, local: &Local, bones: &[LocalBone], anchor: &dyn Fn(usize) -> [f64; 3]) -> Self {
        let (states, width) = (model.hidden() * problem.frames(), 3 * problem.markers());
        let (mut at, mut values) = seen(model, &local.table);
        let mut all = Gaussian::system(model, problem.frames());
        let (mut log_scale, mut heard, mut unheard) = (0.0, 0, 0);
        for t in 0..problem.frames() {
            let missing: Vec<usize> = problem.missing[problem.missing_in(t)].iter().map(|&(_, i)| i).collect();
            let own: Vec<LocalBone> = bones.iter().copied().filter(|b| missing.contains(&b.a) || missing.contains(&b.b)).collect();
            if own.is_empty() {
                continue;
            }
            // the solver does not listen to bones of markers that no chain of bones ties to one that was seen
            let tied = groups(&missing, &own, &incidence(&own, problem.markers()));
            let heard_bones: Vec<usize> = tied.iter().filter(|g| reaches(g, &own, &missing)).flat_map(|g| g.bones.clone()).collect();
            if heard_bones.len() < own.len() {
                unheard += 1;
            }
            let own: Vec<LocalBone> = heard_bones.iter().map(|&k| own[k]).collect();
            if own.is_empty() {
                continue;
            }
            heard += own.len();
            let mut place: Vec<f64> = local.table.column(t).iter().copied().collect();
            for k in problem.missing_in(t) {
                let i = problem.missing[k].1;
                place[3 * i..3 * i + 3].copy_from_slice(&anchor(k));
            }
            let group = Group { markers: missing, bones: (0..own.len()).collect() };
            let system = linearise(&group, &own, &place, &local.centre);
            let (jacobian, right) = system.dense(group.markers.len());
            let mut reach = DMatrix::zeros(own.len(), all.mean.len());
            for (slot, &i) in group.markers.iter().enumerate() {
                reach.columns_mut(states + t * width + 3 * i, 3).copy_from(&jacobian.columns(3 * slot, 3));
            }
            at.extend(all.mean.len()..all.mean.len() + own.len());
            values.extend(right.iter());
            all = all.extend(&reach, &DMatrix::identity(own.len(), own.len()));
            log_scale += system.log_scale;
        }
        let (posterior, log_density) = all.given(&at, &values);
        Self { posterior, log_likelihood: log_density - log_scale, states, width, heard, unheard }
    }

    /// Expectation (centred, m) and standard deviation (mm) of a sample.
    fn sample(&self, t: usize, i: usize) -> ([f64; 3], f64) {
        let from = self.states + t * self.width + 3 * i;
        let variance = self.posterior.covariance.view((from, from), (3, 3)).trace();
        (std::array::from_fn(|axis| self.posterior.mean[from + axis]), 1000.0 * variance.sqrt())
    }
}

/// Two rounds of EM from a fresh start, the second one with bones, if there are any. The first one ignores them.
/// Returns how many bones were heard in all frames together, and in how many frames they were not.
fn two_rounds(seed: u64, markers: usize, frames: usize, share: f64, bones: &[Bone]) -> (usize, usize) {
    let mut chance = Chance::new(seed);
    let take = scatter(&swing(&mut chance, markers, frames), &mut chance, share);
    let problem = Problem::new(&take, &vec![true; markers], bones);
    assert!(!problem.missing.is_empty());
    let local = Local::new(&problem);
    let constraint = if bones.is_empty() { Constraint::None } else { Constraint::Spread };
    let mut solver = Lds::new(&problem, Options { hidden: Hidden::Count(3), constraint, ..Options::default() });
    let mut anchors = solver.anchors().to_vec(); // the start's; afterwards they must be what the round before expected
    let mut counts = (0, 0);
    for round in 0..2 {
        let model = solver.model().clone();
        let progress = solver.step().unwrap();
        let spoken = local_bones(bones);
        let dense = Dense::new(&model, &problem, &local, &spoken, &|k| anchors[k]);
        let case = format!("{markers} markers, {} missing, {} bones, round {round}", problem.missing.len(), bones.len());
        near(&format!("{case}: log-likelihood"), progress.log_likelihood.unwrap(), dense.log_likelihood, 1e-7);
        for (k, &(t, i)) in problem.missing.iter().enumerate() {
            let (place, sigma_mm) = dense.sample(t, i);
            let off = solver.expected()[k].iter().zip(place).map(|(p, q)| (p - q).abs()).fold(0.0, f64::max);
            assert!(off < 1e-7, "{case}: marker {i} in frame {t} is expected {off} m away");
            let estimate = solver.estimate();
            if bones.is_empty() {
                // nothing comes after the expectation
                let right = local.world_mm(t, i, place);
                let off = estimate.positions_mm[k].iter().zip(right).map(|(p, q)| (p - q).abs()).fold(0.0, f64::max);
                assert!(off < 1e-4, "{case}: marker {i} in frame {t} is off by {off} mm");
            }
            let own = estimate.sigma_mm[k];
            assert!((own / sigma_mm - 1.0).abs() < 1e-6, "{case}: sigma of marker {i} in frame {t} is {own}, should be {sigma_mm}");
            anchors[k] = place;
        }
        counts = (dense.heard, dense.unheard);
        // a damped round is another function; that damping leaves the solution alone is shown with single groups
        if solver.damping().iter().any(|&damping| damping > 0.0) {
            break;
        }
    }
    counts
}

#[test]
fn rounds_without_bones_are_one_gaussian() {
    assert_eq!(two_rounds(1, 2, 20, 0.3, &[]), (0, 0));
    assert_eq!(two_rounds(2, 4, 15, 0.2, &[]), (0, 0));
    assert_eq!(two_rounds(3, 5, 12, 0.6, &[]), (0, 0)); // frames of which nothing was seen, or next to nothing
}

#[test]
fn rounds_with_bones_are_one_gaussian() {
    let bone = |a, b| Bone { a, b, length_mm: 700.0, spread_mm: 6.0 };
    let (heard, _) = two_rounds(4, 5, 16, 0.15, &[bone(0, 1), bone(1, 2)]);
    assert!(heard >= 5, "{heard}");
    let (heard, _) = two_rounds(5, 6, 14, 0.2, &[bone(0, 1), bone(1, 2), bone(2, 3), bone(0, 2)]);
    assert!(heard > 10, "{heard}");
    // marker 4 has no bone; often the missing ones fall into two groups, and sometimes too few are seen
    let (heard, unheard) = two_rounds(6, 8, 12, 0.4, &[bone(0, 1), bone(0, 2), bone(1, 2), bone(3, 5), bone(5, 6), bone(6, 7)]);
    assert!(heard > 20 && unheard > 1, "{heard}, {unheard}");
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
        let limits = Limits { steps: 40, tolerance: 0.0, still_mm: -1.0, interrupt: None, meter: None };
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
        offset: DVector::zeros(6),
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
    let mut solver = Lds::new(&problem, Options { hidden: Hidden::Count(2), ..Options::default() });
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
    let known = &made.emission * smooth(&made, evidence(&made, &table)).unwrap().means;
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
