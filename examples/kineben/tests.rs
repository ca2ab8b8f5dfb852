//! Bounds are about a quarter above what was measured: `docs/kineben.md` has the whole sequences, these are their beginnings.
#![allow(clippy::unwrap_used)]

use super::score::{follow, score};
use super::variants::{ALL, Variant};
use mocap_repair::solve::track::{Method, Settings};

/// The beginning of a sequence, tracked by a method, has its joints this near to the truth, and no frame lost.
#[track_caller]
fn holds(name: &str, frames: usize, mean_cm: f64, worst_cm: f64) {
    let variant = ALL.iter().find(|variant| variant.name == name).unwrap();
    let sequence = Variant { frames, ..*variant }.sequence();
    let found = score(&sequence.body.tree, &sequence.joints, &follow(&sequence, Settings::of(Method::Planes)));
    assert!(found.mean_cm < mean_cm && found.worst_cm < worst_cm && found.lost == 0.0, "{name}: {found:?}");
}

#[test]
fn a_walk() {
    holds("walk", 60, 0.36, 1.5);
}

#[test]
fn a_walk_of_another_body() {
    holds("walk, another body", 60, 0.38, 1.4);
}

#[test]
fn a_walk_with_noise_holes_and_outliers() {
    holds("walk, 10 mm, holes, outliers", 60, 0.5, 2.3);
}

#[test]
fn a_walk_at_half_the_rate() {
    holds("walk, 10 mm, holes, outliers, 15 Hz", 40, 0.55, 3.2);
}

/// Until the landing of the jump.
#[test]
fn gymnastics_with_noise_holes_and_outliers() {
    holds("gym, 10 mm, holes, outliers", 100, 0.62, 3.4);
}

#[test]
fn gymnastics_in_hulls_of_8_cameras() {
    holds("gym, hull of 8 cameras", 100, 0.57, 5.1);
}

#[test]
fn gymnastics_in_hulls_of_4_cameras() {
    holds("gym, hull of 4 cameras", 100, 0.95, 22.7);
}

#[test]
fn gymnastics_before_a_depth_camera() {
    holds("gym, one depth camera", 100, 0.56, 2.8);
}

#[test]
fn gymnastics_at_half_the_rate() {
    holds("gym, 15 Hz", 75, 0.64, 9.0);
}

/// The report's own method is what it was measured to be elsewhere, neither worse nor much better.
#[test]
fn the_report_is_as_good_as_it_is() {
    let variant = Variant { frames: 60, ..ALL[0] };
    let sequence = variant.sequence();
    let found = score(&sequence.body.tree, &sequence.joints, &follow(&sequence, Settings::of(Method::Report)));
    assert!((0.70..1.17).contains(&found.mean_cm), "{found:?}");
}
