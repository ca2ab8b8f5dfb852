//! Faults put into a walk on purpose, one of each kind.

#![allow(clippy::unwrap_used)] // a test may fail

use super::*;
use crate::bones;
use crate::demo::{hide, walk};
use formats::{Marker, Origin, TakeBuilder};

fn column(take: &Take, name: &str) -> usize {
    take.markers.iter().position(|m| m.name() == name).unwrap()
}

fn looked(take: &Take) -> Vec<Suspect> {
    find(take, &bones::find(take, &vec![true; take.markers.len()]))
}

/// The take with some samples of a marker put elsewhere.
fn moved(take: &Take, name: &str, frames: std::ops::Range<usize>, by_mm: [f64; 3]) -> Take {
    let marker = column(take, name);
    let mut other = TakeBuilder::from(take.clone());
    for frame in frames {
        let p = take.position_mm(frame, marker).unwrap();
        other.set(frame, marker, std::array::from_fn(|k| p[k] + by_mm[k]), Origin::Measured);
    }
    other.build()
}

/// The take with two labels exchanged.
fn swapped(take: &Take, a: &str, b: &str, frames: std::ops::Range<usize>) -> Take {
    let (a, b) = (column(take, a), column(take, b));
    let mut other = TakeBuilder::from(take.clone());
    for frame in frames {
        if let (Some(p), Some(q)) = (take.position_mm(frame, a), take.position_mm(frame, b)) {
            other.set(frame, a, q, Origin::Measured);
            other.set(frame, b, p, Origin::Measured);
        }
    }
    other.build()
}

fn told(take: &Take) -> Vec<String> {
    looked(take).iter().map(|s| s.sentence(take)).collect()
}

#[test]
fn a_clean_walk_has_none() {
    for (rate_hz, seed) in [(120.0, 1), (120.0, 2), (60.0, 3), (30.0, 4), (500.0, 5)] {
        assert_eq!(told(&walk(600, rate_hz, seed)), [""; 0], "{rate_hz} Hz");
    }
}

#[test]
fn a_take_of_nothing_has_none() {
    for frames in [0, 1, 11, 40] {
        assert_eq!(looked(&TakeBuilder::new(vec![Marker::new("A"), Marker::new("B")], frames, 100.0).build()), []);
        assert_eq!(looked(&TakeBuilder::new(Vec::new(), frames, 100.0).build()), []);
    }
}

#[test]
fn spikes_and_excursions() {
    let take = walk(400, 120.0, 1);
    let found = told(&moved(&take, "LWRA", 200..201, [0.0, 0.0, 60.0]));
    assert_eq!(found, ["LWRA is up to 60 mm off its path and comes back, frame 201"]);
    let found = told(&moved(&take, "RKNE", 150..154, [30.0, -40.0, 0.0]));
    assert_eq!(found, ["RKNE is up to 50 mm off its path and comes back, frames 151 to 154"]);
    let found = looked(&moved(&take, "C7", 100..160, [0.0, 80.0, 0.0]));
    assert_eq!(found.iter().map(|s| (s.kind, s.start, s.end)).collect::<Vec<_>>(), [(Kind::Excursion, 100, 160)]);
}

#[test]
fn what_stays_off_is_a_jump() {
    let take = walk(400, 120.0, 2);
    for (frames, expected) in [(0..60, (0, 60)), (330..400, (330, 400))] {
        let found = looked(&moved(&take, "STRN", frames, [0.0, 0.0, 150.0]));
        assert_eq!(found.iter().map(|s| (s.kind, (s.start, s.end))).collect::<Vec<_>>(), [(Kind::Jump, expected)]);
    }
}

#[test]
fn ghosts_beside_gaps_and_ends() {
    let take = hide(&walk(400, 120.0, 3), "LFWT", 200..240);
    for frames in [198..200, 240..241, 0..2, 399..400] {
        let found = looked(&moved(&take, "LFWT", frames.clone(), [40.0, 0.0, 0.0]));
        assert_eq!(found.iter().map(|s| (s.kind, s.start..s.end)).collect::<Vec<_>>(), [(Kind::Ghost, frames)]);
    }
}

#[test]
fn swaps_with_and_without_gaps() {
    let take = walk(500, 120.0, 4);
    let pairs = |take: &Take| looked(take).iter().map(|s| (s.kind, s.marker, s.with, s.start..s.end)).collect::<Vec<_>>();
    for (a, b, frames) in [("LKNE", "RKNE", 200..260), ("LTHI", "RTHI", 100..103), ("LWRA", "LFIN", 300..500)] {
        let (x, y) = (column(&take, a).min(column(&take, b)), column(&take, a).max(column(&take, b)));
        let expected = [(Kind::Swap, x, Some(y), frames.clone()), (Kind::Swap, y, Some(x), frames.clone())];
        assert_eq!(pairs(&swapped(&take, a, b, frames.clone())), expected, "{a} {b}");
        if frames.len() > 10 && frames.end < 500 {
            let mut gaps = swapped(&take, a, b, frames.clone());
            for around in [frames.start - 15..frames.start, frames.end..frames.end + 20] {
                gaps = hide(&hide(&gaps, a, around.clone()), b, around);
            }
            assert_eq!(pairs(&gaps), expected, "{a} {b} between gaps");
        }
    }
    // swapped for most of the take: the rest is
    let found = pairs(&swapped(&take, "LKNE", "RKNE", 120..500));
    assert!(found.iter().all(|(kind, .., frames)| (*kind, frames.clone()) == (Kind::Swap, 0..120)), "{found:?}");
    assert_eq!(found.len(), 2);
}

/// Nobody named them, so nobody misses them.
#[test]
fn numbered_trajectories_are_left_alone() {
    let take = moved(&walk(300, 120.0, 5), "LWRA", 100..102, [0.0, 0.0, 90.0]);
    let mut markers = take.markers.clone();
    markers[column(&take, "LWRA")] = Marker::new("*12");
    let mut other = TakeBuilder::new(markers, take.frames(), take.rate_hz);
    for (frame, marker) in (0..take.frames()).flat_map(|f| (0..take.markers.len()).map(move |m| (f, m))) {
        other.set(frame, marker, take.position_mm(frame, marker).unwrap(), Origin::Measured);
    }
    assert_eq!(told(&other.build()), [""; 0]);
    assert_eq!(looked(&take).len(), 1);
}

#[test]
fn a_summary_names_the_largest() {
    let mut take = walk(600, 120.0, 1);
    for (at, mm) in [(100, 30.0), (200, 90.0), (300, 60.0), (400, 50.0)] {
        take = moved(&take, "LWRA", at..at + 1, [mm, 0.0, 0.0]);
    }
    take = swapped(&take, "LKNE", "RKNE", 450..500);
    let reports = SuspectReport::all(&looked(&take), &take, Treatment::Told);
    assert_eq!(summary(&reports), ["4 spikes (LWRA, 201; LWRA, 301; LWRA, 401; ...)", "1 swap (LKNE/RKNE, 451 to 500)"]);
    let lines = text(&reports, false);
    assert_eq!((lines[0].0, lines.len()), ("suspect", 3));
    let dropped = text(&SuspectReport::all(&looked(&take), &take, Treatment::Dropped), false);
    assert_eq!((dropped[0].0, dropped.len()), ("dropped", 6), "never silently: one by one");
}
