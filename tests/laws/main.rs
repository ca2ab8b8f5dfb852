//! What holds for every take, tried on takes that nobody chose.
//!
//! | file | laws |
//! | --- | --- |
//! | [`filling`] | what was seen is never touched, gaps are filled whole, no take makes a solver panic |
//! | [`moving`] | move, turn or reorder a take, and its repair moves along |
//! | [`suspects`] | move, turn or reorder a take, and what is suspect in it moves along |
//! | [`formats`] | a created file opens as the take that it was made from |
//! | [`files`] | from file to file: every byte that is not a filled sample stays, and the same request gives the same bytes |
//!
//! Cases come from fixed seeds, so a run that fails fails again.
#![allow(clippy::unwrap_used)] // a test that gets no value has failed

mod files;
mod filling;
mod formats;
mod moving;
mod suspects;

use ::formats::{Marker, Origin, Take, TakeBuilder};
use mocap_repair::demo::actor::{Actor, MarkerOptions, Motion};
use mocap_repair::demo::walk;
use mocap_repair::gaps::{Open, Policy, gaps};
use mocap_repair::solve::ik::terms::Marker as WornMarker;
use mocap_repair::solve::ik::{Tree, Vec3};
use mocap_repair::solve::lds::em::Noise;
use mocap_repair::solve::lds::step::BoneStep;
use mocap_repair::solve::lds::{EStep, Hidden, Init, Start};
use mocap_repair::solve::skeleton::Wearer;
use mocap_repair::solve::{Gap, Limits, Method, Problem, Settings};
use mocap_repair::{bones, fills};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::sync::{Arc, OnceLock};

/// Few cases, always the same, and nothing left on the disk.
fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, rng_seed: RngSeed::Fixed(41), failure_persistence: None, ..ProptestConfig::default() }
}

/// Trunk and legs of the demonstration's walker.
const WALKERS: [&str; 14] = ["C7", "CLAV", "LFWT", "RFWT", "LBWT", "RBWT", "LTHI", "LKNE", "LSHN", "LANK", "LTOE", "RKNE", "RANK", "RTOE"];

/// A walk of which only these markers are left, in this order.
fn walk_of(markers: &[&str], frames: usize, seed: u64) -> Take {
    let whole = walk(frames, 120.0, seed);
    let columns: Vec<usize> = markers.iter().map(|name| whole.markers.iter().position(|m| m.name() == *name).unwrap()).collect();
    remade(&whole, &columns, |p| p)
}

/// The take with these of its columns, in this order, and every position put elsewhere.
fn remade(take: &Take, columns: &[usize], place: impl Fn([f64; 3]) -> [f64; 3]) -> Take {
    let markers = columns.iter().map(|&m| take.markers[m].clone()).collect();
    let mut other = TakeBuilder::new(markers, take.frames(), take.rate_hz).first_frame(take.first_frame).unit(take.unit).up(take.up);
    for frame in 0..take.frames() {
        for (column, &m) in columns.iter().enumerate() {
            if let Some(p) = take.position_mm(frame, m) {
                other.set(frame, column, place(p), take.origin(frame, m));
            }
        }
    }
    other.build()
}

/// What to hide of a take: of a marker (modulo their number) some frames, from a place given as a share of the take.
#[derive(Clone, Copy, Debug)]
struct Hole {
    marker: usize,
    at: f64,
    frames: usize,
}

/// Up to `most` holes of up to `longest` frames.
fn holes(most: usize, longest: usize) -> impl Strategy<Value = Vec<Hole>> {
    prop::collection::vec((0..1000_usize, 0.0..1.0, 1..=longest).prop_map(|(marker, at, frames)| Hole { marker, at, frames }), 1..=most)
}

/// The take with holes, between a first and a last frame that stay.
fn hidden(take: &Take, holes: &[Hole]) -> Take {
    let mut other = TakeBuilder::from(take.clone());
    for hole in holes {
        let first = 1 + (hole.at * (take.frames() - 2) as f64) as usize;
        for frame in first..(first + hole.frames).min(take.frames() - 1) {
            other.hide(frame, hole.marker % take.markers.len());
        }
    }
    other.build()
}

/// A take after its repair, its gaps, and which of them were filled.
struct Repaired {
    take: Take,
    gaps: Vec<Gap>,
    decisions: Vec<Result<(), Open>>,
}

/// Repairs a take in memory with so many rounds of EM, which do not end early: the way of `repair` between opening and writing.
fn repaired(take: &Take, method: Method, settings: &Settings, rounds: usize, extrapolate: bool) -> Repaired {
    let every = vec![true; take.markers.len()];
    let policy = Policy { extrapolate, ..Policy::default() };
    let gaps = gaps(take);
    let mut decisions: Vec<_> = gaps.iter().map(|gap| policy.decide(gap, take, true)).collect();
    let problem = Problem::new(take, &every, &bones::find(take, &every));
    let mut filled = take.clone();
    if problem.markers() > 0 {
        let limits = Limits { steps: rounds as u32, tolerance: 0.0, still_mm: 0.0, interrupt: None, meter: None };
        let solved = method.solve(&problem, settings, &limits, &mut ());
        fills::fill(&mut filled, &problem, &solved.estimate, &gaps, &mut decisions, None);
    }
    Repaired { take: filled, gaps, decisions }
}

/// The settings under which a method is tried: the usual ones, and for bones and EM the paper's way, too.
fn settings(method: Method) -> Vec<Settings> {
    let usual = Settings::default();
    let paper = Settings { hidden: Hidden::Count(5), e_step: EStep::Imputing, ..usual.clone() };
    match method {
        Method::Linear | Method::Spline | Method::Auto => vec![usual],
        // whatever the body is
        Method::Skeleton => vec![usual.clone(), Settings { wearer: Some(anybody()), ..usual }],
        Method::Msvd => vec![usual.clone(), Settings { start: Start::Zero, hidden: Hidden::Energy(0.95), ..usual }],
        Method::Lds => vec![usual, paper],
        Method::BoleroHc => vec![usual, Settings { step: BoneStep::Frame, ..paper }],
        Method::BoleroSc => vec![
            usual.clone(),
            Settings { lambda: Some(1e4), ..paper.clone() },
            Settings { step: BoneStep::Frame, noise: Noise::Isotropic, init: Init::Random(3), start: Start::Interpolate, ..paper },
            Settings { step: BoneStep::Gradient, ..usual },
        ],
    }
}

/// A walk of the synthetic actor, in mm and with nothing hidden, and the actor's body with the markers that it wears.
fn actors_take(frames: usize, rate_hz: f64) -> (Take, Wearer) {
    let actor = Actor::new(5);
    let map = actor.marker_map();
    let mut take = TakeBuilder::new(map.iter().map(|m| Marker::new(m.name.clone())).collect(), frames, rate_hz);
    for (frame, row) in actor.markers(&actor.poses(Motion::Walk, frames, rate_hz), &MarkerOptions::default()).iter().enumerate() {
        for (marker, place) in row.iter().enumerate() {
            take.set(frame, marker, place.unwrap().map(|x| x * 10.0), Origin::Measured);
        }
    }
    let at = |vertex: usize| Vec3::from(actor.mesh.vertices[vertex]);
    let worn = |m: &mocap_repair::demo::actor::SkinMarker| WornMarker { part: m.joint, vertex: at(m.vertex), offset: Vec3::zeros() };
    let markers = map.iter().enumerate().map(|(column, m)| (column, worn(m), 1.0)).collect();
    let names = actor.skeleton.joints.iter().map(|joint| joint.name.clone()).collect();
    let from_take = nalgebra::Matrix3::identity();
    (take.build(), Wearer { tree: Tree::new(&actor.skeleton, 1.0), names, limits: None, markers, from_take })
}

/// A body that is none of those who are recorded.
fn anybody() -> Arc<Wearer> {
    static BODY: OnceLock<Arc<Wearer>> = OnceLock::new();
    BODY.get_or_init(|| Arc::new(actors_take(1, 30.0).1)).clone()
}

/// What is missing of a take, by frame and marker.
fn missing(take: &Take) -> Vec<(usize, usize)> {
    let all = (0..take.frames()).flat_map(|frame| (0..take.markers.len()).map(move |marker| (frame, marker)));
    all.filter(|&(frame, marker)| take.origin(frame, marker) == Origin::Missing).collect()
}

/// Labels for markers of which nothing else is known.
fn markers(count: usize) -> Vec<Marker> {
    (0..count).map(|i| Marker::new(format!("M{i}"))).collect()
}

/// Origin and bits of every sample that `take` knows, as `other` has them.
fn same_where_known(take: &Take, other: &Take) -> bool {
    let bits = |p: Option<[f64; 3]>| p.map(|p| p.map(f64::to_bits));
    (0..take.frames()).all(|f| {
        (0..take.markers.len())
            .filter(|&m| take.origin(f, m) != Origin::Missing)
            .all(|m| take.origin(f, m) == other.origin(f, m) && bits(take.position_mm(f, m)) == bits(other.position_mm(f, m)))
    })
}
