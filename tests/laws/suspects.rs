//! Move, turn or reorder a take, and what is suspect in it moves along.

use crate::{Hole, WALKERS, cases, hidden, holes, remade, walk_of};
use formats::{Origin, Take, TakeBuilder};
use mocap_repair::bones;
use mocap_repair::suspects::{Kind, Suspect, find};
use proptest::prelude::*;

/// A sample that is put elsewhere, for some frames from a place given as a share of the take.
#[derive(Clone, Copy, Debug)]
struct Push {
    marker: usize,
    at: f64,
    frames: usize,
    by_mm: [i32; 3],
}

fn pushes() -> impl Strategy<Value = Vec<Push>> {
    let push = (0..1000_usize, 0.0..1.0, 1..30_usize, prop::array::uniform3(-150..150_i32));
    prop::collection::vec(push.prop_map(|(marker, at, frames, by_mm)| Push { marker, at, frames, by_mm }), 1..6)
}

/// A walk with holes and faults.
fn takes() -> impl Strategy<Value = Take> {
    (1..100_u64, holes(6, 25), pushes()).prop_map(|(seed, holes, pushes): (u64, Vec<Hole>, Vec<Push>)| {
        let take = hidden(&walk_of(&WALKERS, 150, seed), &holes);
        let mut other = TakeBuilder::from(take.clone());
        for push in pushes {
            let marker = push.marker % take.markers.len();
            let first = (push.at * take.frames() as f64) as usize;
            for frame in first..(first + push.frames).min(take.frames()) {
                if let Some(p) = take.position_mm(frame, marker) {
                    other.set(frame, marker, std::array::from_fn(|k| p[k] + f64::from(push.by_mm[k])), Origin::Measured);
                }
            }
        }
        other.build()
    })
}

fn found(take: &Take) -> Vec<Suspect> {
    find(take, &bones::find(take, &vec![true; take.markers.len()]))
}

/// What is found, by the columns of the first take, without the last digits.
fn named(take: &Take, columns: &[usize]) -> Vec<(usize, usize, usize, Kind, Option<usize>, i64)> {
    let name = |s: &Suspect| (s.start, s.end, columns[s.marker], s.kind, s.with.map(|m| columns[m]), (s.size_mm * 100.0).round() as i64);
    let mut named: Vec<_> = found(take).iter().map(name).collect();
    named.sort_unstable();
    named
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn suspects_move_turn_and_are_reordered(
        take in takes(),
        angle in 0.0..std::f64::consts::TAU,
        metres in prop::array::uniform3(-20..20_i32),
        columns in Just((0..WALKERS.len()).collect::<Vec<_>>()).prop_shuffle(),
    ) {
        let (sine, cosine) = angle.sin_cos();
        let place = |p: [f64; 3]| {
            let turned = [cosine * p[0] - sine * p[1], p[2], -(sine * p[0] + cosine * p[1])];
            std::array::from_fn(|k| turned[k] + 1000.0 * f64::from(metres[k]))
        };
        let own: Vec<usize> = (0..WALKERS.len()).collect();
        prop_assert_eq!(named(&remade(&take, &columns, place), &columns), named(&take, &own));
    }

    /// Suspects are stretches of samples that are there, in order, and none is named twice.
    #[test]
    fn suspects_are_stretches_of_the_take(take in takes()) {
        let suspects = found(&take);
        prop_assert!(suspects.is_sorted_by_key(|s| (s.start, s.marker)));
        for (at, s) in suspects.iter().enumerate() {
            prop_assert!(s.start < s.end && s.end <= take.frames() && s.marker < take.markers.len() && s.size_mm.is_finite());
            prop_assert!(s.samples(&take).count() > 0 && (s.kind == Kind::Swap) == s.with.is_some());
            prop_assert!(!suspects[..at].iter().any(|o| o.marker == s.marker && o.start < s.end && s.start < o.end), "{:?}", suspects);
        }
        prop_assert_eq!(&suspects, &found(&take));
    }
}
