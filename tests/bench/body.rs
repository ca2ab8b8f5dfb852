//! What following a body costs: `cargo bench --bench body`.
//!
//! On the synthetic actor, who walks: clouds of 2500 points, 41 markers.
#![allow(clippy::unwrap_used)] // a benchmark may fail loudly

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use mocap_repair::demo::actor::{Actor, ActorPose, MarkerOptions, Motion, ScanOptions};
use mocap_repair::solve::ik::terms::{Limits, Marker};
use mocap_repair::solve::ik::{Pose, Posed, Tree, Vec3};
use mocap_repair::solve::markers;
use mocap_repair::solve::track::{Body, Boxes, Brute, Cloud, Expectation, Method, Mixture, Nearest, Settings, Tracker};

const RATE_HZ: f64 = 30.0;

fn points(list: &[[f64; 3]]) -> Vec<Vec3> {
    list.iter().map(|x| Vec3::from(*x)).collect()
}

/// Somebody, and what is tracked of them.
fn somebody() -> (Actor, Body, Limits) {
    let actor = Actor::new(1);
    let (vertices, normals) = (points(&actor.mesh.vertices), points(&actor.mesh.normals));
    let body = Body::new(Tree::new(&actor.skeleton, 1.0), vertices, normals, actor.mesh.faces.clone(), actor.parts.clone());
    let limits = Limits::new(&actor.limits, false, 1.0);
    (actor, body, limits)
}

fn clouds(actor: &Actor, poses: &[ActorPose]) -> Vec<Cloud> {
    let scans = poses.iter().enumerate().map(|(frame, pose)| actor.scan(pose, frame, &ScanOptions::default()));
    scans.map(|scan| Cloud { points: points(&scan.vertices), normals: points(&scan.normals) }).collect()
}

/// An E-step with the vertices of the last one as hints.
fn expect(bencher: Bencher<'_, '_>, body: &Body, nearest: &dyn Nearest, cloud: &Cloud, sigma_cm: f64) {
    let usual = Settings::default();
    let mixture = Mixture { sigma_cm, outlier: usual.outlier, cosine: usual.cosine, spacing_cm: usual.spacing_cm, reach: usual.reach };
    let parts = Posed::new(&body.tree).parts;
    let mut expectation = Expectation::default();
    expectation.forget(body, cloud);
    bencher.bench_local(|| {
        expectation.step(body, nearest, black_box(cloud), &parts, &mixture, 1);
        expectation.found.inliers
    });
}

#[divan::bench(args = [4.0, 0.7])]
fn e_step(bencher: Bencher<'_, '_>, sigma_cm: f64) {
    let (actor, body, _) = somebody();
    let cloud = clouds(&actor, &actor.poses(Motion::Walk, 1, RATE_HZ)).remove(0);
    expect(bencher, &body, &Boxes::new(&body), &cloud, sigma_cm);
}

#[divan::bench(args = [4.0, 0.7], sample_count = 10)]
fn e_step_every_vertex(bencher: Bencher<'_, '_>, sigma_cm: f64) {
    let (actor, body, _) = somebody();
    let cloud = clouds(&actor, &actor.poses(Motion::Walk, 1, RATE_HZ)).remove(0);
    expect(bencher, &body, &Brute(&body), &cloud, sigma_cm);
}

/// A frame of a walk that goes forth and back.
#[divan::bench(args = [Method::Planes, Method::Report])]
fn tracked_frame(bencher: Bencher<'_, '_>, method: Method) {
    let (actor, body, limits) = somebody();
    let clouds = clouds(&actor, &actor.poses(Motion::Walk, 40, RATE_HZ));
    let mut tracker = Tracker::new(&body, Some(&limits), Pose::reference(&body.tree), Settings::of(method));
    let mut frames = (0..clouds.len()).chain((0..clouds.len()).rev()).cycle();
    bencher.with_inputs(|| clouds[frames.next().unwrap()].clone()).bench_local_values(|cloud| tracker.push(Some(cloud)));
}

#[divan::bench]
fn trees_of_boxes(bencher: Bencher<'_, '_>) {
    let (_, body, _) = somebody();
    bencher.bench_local(|| black_box(Boxes::new(&body)));
}

/// Frames of 41 markers, each by itself or all with their accelerations.
#[divan::bench(args = [0.0, 0.4], sample_count = 20)]
fn marker_frames(bencher: Bencher<'_, '_>, smooth: f64) {
    const FRAMES: usize = 300;
    let (actor, body, limits) = somebody();
    let map = actor.marker_map();
    let markers: Vec<Marker> =
        map.iter().map(|marker| Marker { part: marker.joint, vertex: body.vertices[marker.vertex], offset: Vec3::zeros() }).collect();
    let samples = actor.markers(&actor.poses(Motion::Walk, FRAMES, RATE_HZ), &MarkerOptions { hidden: 0.1, ..MarkerOptions::default() });
    let place = |sample: &Option<[f64; 3]>| sample.map_or(Vec3::repeat(f64::NAN), Vec3::from);
    let places: Vec<Vec3> = samples.iter().flatten().map(place).collect();
    let seen = markers::Seen { frames: FRAMES, markers: map.len(), weights: vec![1.0; places.len()], places };
    let settings = markers::Settings { smooth };
    bencher
        .counter(ItemsCount::new(FRAMES))
        .bench_local(|| markers::solve(&body.tree, Some(&limits), &markers, black_box(&seen), &settings).poses.len());
}

fn main() {
    divan::main();
}
