//! Synthetic actors wear markers of which some are hidden, and their joints are known.
#![allow(clippy::unwrap_used)]

use super::{Known, Seen, Settings, calibrate, solve};
use crate::demo::actor::{Actor, MarkerOptions, Motion};
use crate::random::{Random, Stream};
use crate::solve::ik::terms::{Limits, Marker};
use crate::solve::ik::{Posed, Tree, Vec3};
use crate::solve::track::Body;

/// An actor's take, and the truth.
struct Worn {
    tree: Tree,
    limits: Limits,
    names: Vec<String>,
    markers: Vec<Marker>,
    seen: Seen,
    /// For each frame the places of the joints, cm.
    truth: Vec<Vec<[f64; 3]>>,
}

/// What came of a take.
struct Came {
    /// For each frame and joint, how far it is from the truth, cm.
    off: Vec<Vec<f64>>,
    /// Root mean square distance of markers from their places, cm.
    rms_cm: f64,
}

impl Worn {
    fn new(seed: u64, motion: Motion, frames: usize, rate_hz: f64) -> Self {
        let actor = Actor::new(seed);
        let poses = actor.poses(motion, frames, rate_hz);
        let at = |vertex: usize| Vec3::from(actor.mesh.vertices[vertex]);
        let marker = |m: crate::demo::actor::SkinMarker| Marker { part: m.joint, vertex: at(m.vertex), offset: Vec3::zeros() };
        let markers: Vec<Marker> = actor.marker_map().into_iter().map(marker).collect();
        let places = actor.markers(&poses, &MarkerOptions::default()).into_iter().flatten();
        let places: Vec<Vec3> = places.map(|x| x.map_or(Vec3::repeat(f64::NAN), Vec3::from)).collect();
        Self {
            tree: Tree::new(&actor.skeleton, 1.0),
            limits: Limits::new(&actor.limits, false, 1.0),
            names: actor.skeleton.joints.iter().map(|joint| joint.name.clone()).collect(),
            seen: Seen { frames, markers: markers.len(), weights: vec![1.0; places.len()], places },
            truth: poses.iter().map(|pose| actor.joints(pose)).collect(),
            markers,
        }
    }

    /// For each joint, whether it is that one or hangs on it.
    fn limb(&self, name: &str) -> Vec<bool> {
        self.tree.behind(self.names.iter().position(|joint| joint == name).unwrap_or_default())
    }

    /// Solves without the samples of frames and markers that are hidden.
    fn without(&self, mut hidden: impl FnMut(usize, usize) -> bool) -> Came {
        let mut seen = self.seen.clone();
        for frame in 0..seen.frames {
            for at in (0..seen.markers).filter(|&at| hidden(frame, at)) {
                seen.places[frame * seen.markers + at] = Vec3::repeat(f64::NAN);
            }
        }
        let solution = solve(&self.tree, Some(&self.limits), &self.markers, &seen, &Settings::default());
        let mut posed = Posed::new(&self.tree);
        let off = solution.poses.iter().zip(&self.truth).map(|(pose, truth)| {
            posed.set(&self.tree, pose);
            posed.centres.iter().zip(truth).skip(1).map(|(x, truth)| (x - Vec3::from(*truth)).norm()).collect()
        });
        Came { off: off.collect(), rms_cm: solution.rounds.last().map_or(f64::NAN, |round| round.rms_cm) }
    }
}

impl Came {
    /// The mean and the largest distance of the joints that `counts` says, cm.
    fn of(&self, counts: impl Fn(usize, usize) -> bool) -> (f64, f64) {
        let of_frame = |(frame, row): (usize, &Vec<f64>)| {
            let row = row.iter().enumerate().filter(|(joint, _)| counts(frame, joint + 1)).map(|(_, off)| *off);
            row.collect::<Vec<_>>()
        };
        let all: Vec<f64> = self.off.iter().enumerate().flat_map(of_frame).collect();
        (all.iter().sum::<f64>() / all.len() as f64, all.iter().fold(0.0, |a, b| f64::max(a, *b)))
    }
}

/// A second without any marker on a limb, in frames from `from` on; the limb must not be farther off than `most_cm`, and nothing else be worse for it.
#[track_caller]
fn unseen(worn: &Worn, name: &str, frames: std::ops::Range<usize>, most_cm: f64) {
    let limb = worn.limb(name);
    let came = worn.without(|frame, at| limb[worn.markers[at].part] && frames.contains(&frame));
    let (_, most) = came.of(|frame, joint| limb[joint] && frames.contains(&frame));
    assert!(most < most_cm, "{name} {frames:?}: {most} cm");
    let (_, rest) = came.of(|frame, joint| !(limb[joint] && frames.contains(&frame)));
    assert!(rest < 3.0, "{name} {frames:?}: {rest} cm where it was seen");
}

#[test]
fn a_limb_that_is_unseen_at_an_end_stays_near_the_body() {
    let worn = Worn::new(5, Motion::Walk, 120, 30.0);
    // legs swing by 100 cm, arms by 60 cm
    for name in ["l_uarm", "r_thigh", "head"] {
        unseen(&worn, name, 0..30, 55.0);
        unseen(&worn, name, 90..120, 55.0);
    }
    let worn = Worn::new(9, Motion::Gym, 252, 30.0);
    unseen(&worn, "r_thigh", 0..30, 90.0);
    unseen(&worn, "r_thigh", 222..252, 90.0);
}

#[test]
fn a_limb_that_is_unseen_where_windows_meet_is_no_worse_than_elsewhere() {
    let worn = Worn::new(5, Motion::Walk, 560, 60.0);
    for (name, most_cm) in [("l_uarm", 35.0), ("r_thigh", 60.0)] {
        for frames in [354..414, 280..490] {
            unseen(&worn, name, frames, most_cm);
        }
    }
}

#[test]
fn a_limb_that_comes_back_is_found_whatever_it_did() {
    let worn = Worn::new(6, Motion::Gym, 560, 60.0);
    for frames in [340..400, 300..420] {
        unseen(&worn, "r_thigh", frames, 150.0);
    }
}

#[test]
fn samples_that_are_missing_at_random() {
    for (worn, most_cm) in [(Worn::new(9, Motion::Gym, 252, 30.0), 3.5), (Worn::new(5, Motion::Walk, 120, 30.0), 3.5)] {
        for seed in 0..6 {
            let mut random = Random::new(seed, Stream::Gaps);
            let came = worn.without(|_, _| random.between(0.0, 1.0) < 0.3);
            let (mean, most) = came.of(|_, _| true);
            assert!(mean < 0.5 && most < most_cm, "seed {seed}: mean {mean} cm, at most {most} cm");
        }
    }
}

#[test]
fn few_markers_are_met_all_the_same() {
    let worn = Worn::new(5, Motion::Walk, 120, 30.0);
    for (share, mean_cm) in [(0.85, 3.0), (0.95, 12.0)] {
        let mut random = Random::new(3, Stream::Gaps);
        let came = worn.without(|_, _| random.between(0.0, 1.0) < share);
        let (mean, _) = came.of(|_, _| true);
        assert!(mean < mean_cm && came.rms_cm < 3.0, "{share}: mean {mean} cm, markers {} cm", came.rms_cm);
    }
    for at in [0, 40] {
        let came = worn.without(|_, other| other != at);
        assert!(came.rms_cm < 0.1, "marker {at} alone: {} cm", came.rms_cm);
    }
}

/// The actor's body, and what is known of markers if only their joints are told.
fn told_by_joint(seed: u64) -> (Actor, Body, Vec<Known>) {
    let actor = Actor::new(seed);
    let vertices = actor.mesh.vertices.iter().map(|x| Vec3::from(*x)).collect();
    let body = Body::new(Tree::new(&actor.skeleton, 1.0), vertices, Vec::new(), Vec::new(), actor.parts.clone());
    let known = actor.marker_map().into_iter().map(|m| Known { part: Some(m.joint), ..Known::default() }).collect();
    (actor, body, known)
}

#[test]
fn calibration_finds_sizes_places_and_bones() {
    let worn = Worn::new(5, Motion::Walk, 120, 30.0);
    let (actor, body, known) = told_by_joint(5);
    let map = actor.marker_map();
    for size in [1.0, 0.92] {
        // the rig is smaller or larger than the actor
        let found = calibrate(&body.scaled(1.0 / size), Some(&worn.limits), &worn.seen, &known).unwrap();
        assert!((found.size - size).abs() < 0.035 && !found.at_edge, "{size}: {}", found.size);
        assert!(found.rms_cm < 1.2, "{size}: {} cm", found.rms_cm);
        let off = found.markers.iter().zip(&map).map(|(marker, m)| {
            let marker = marker.as_ref().unwrap();
            assert_eq!(marker.part, m.joint);
            let centre = |body: &Body| body.tree.links[m.joint].centre;
            let was = Vec3::from(actor.mesh.vertices[m.vertex]) - centre(&body);
            (marker.place() - centre(&found.body) - was).norm()
        });
        let off: Vec<f64> = off.collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        assert!(mean < 2.5, "{size}: offsets are {mean} cm off on average, {off:.1?}");
        for (joint, link) in body.tree.links.iter().enumerate() {
            let Some(parent) = link.parent else { continue };
            let bone = |body: &Body| (body.tree.links[joint].centre - body.tree.links[parent].centre).norm();
            let (was, is) = (bone(&body), bone(&found.body));
            assert!((is - was).abs() < 0.1 * was + 0.5, "{size}: {} is {is} cm long and was {was} cm", worn.names[joint]);
        }
    }
}

#[test]
fn a_size_that_nobody_tried_is_told() {
    let worn = Worn::new(5, Motion::Walk, 60, 30.0);
    let (_, body, known) = told_by_joint(5);
    let found = calibrate(&body.scaled(0.7), Some(&worn.limits), &worn.seen, &known).unwrap();
    assert!(found.at_edge, "{}", found.size);
}

#[test]
fn places_that_are_known_are_kept() {
    let worn = Worn::new(5, Motion::Walk, 60, 30.0);
    let (_, body, mut known) = told_by_joint(5);
    for (known, marker) in known.iter_mut().zip(&worn.markers) {
        known.place = Some(marker.place());
    }
    let found = calibrate(&body, Some(&worn.limits), &worn.seen, &known).unwrap();
    assert!(found.size == 1.0 && found.rms_cm < 0.8, "{} {}", found.size, found.rms_cm);
    let scales = found.scales.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), x| (a.min(*x), b.max(*x)));
    assert!(scales.0 > 0.93 && scales.1 < 1.07, "{scales:?}");
}
