//! Move, turn or reorder a take, and its repair moves along.
//!
//! The model's noise is the same along every axis and its coordinates are the body's own, so nothing in it knows where north is.
//! What remains are the roundings of other numbers, which rounds of EM let grow, and one thing more:
//! EM starts from principal components that a fixed number of iterations has nearly found, from a start that knows the order of the coordinates
//! and their axes, so a turned or reordered take starts a little elsewhere.
//! Units are no law: what is small or stiff is decided in millimetres.

use crate::{Hole, WALKERS, actors_take, cases, hidden, holes, remade, repaired, walk_of};
use formats::{Take, TakeBuilder};
use mocap_repair::solve::{Method, Settings};
use proptest::prelude::*;
use std::sync::Arc;

/// How far a filled sample may be from where it should have moved to, in mm: by (moving, turning or reordering).
fn tolerances_mm(method: Method) -> (f64, f64) {
    match method {
        // without a body
        Method::Linear | Method::Spline | Method::Skeleton => (1e-8, 1e-8),
        Method::Msvd | Method::Lds | Method::BoleroHc | Method::BoleroSc | Method::Auto => (1e-4, 0.05),
    }
}

/// The same take with labels that say nothing, so that the body has to be found from how the markers move.
fn nameless(take: &Take) -> Take {
    let mut other = TakeBuilder::new(crate::markers(take.markers.len()), take.frames(), take.rate_hz).up(take.up);
    for frame in 0..take.frames() {
        for marker in 0..take.markers.len() {
            if let Some(p) = take.position_mm(frame, marker) {
                other.set(frame, marker, p, take.origin(frame, marker));
            }
        }
    }
    other.build()
}

/// A way to make another take of the same motion: which column comes where, and how positions change.
struct Move {
    columns: Vec<usize>,
    angle: f64,
    shift_mm: [f64; 3],
}

impl Move {
    /// About the vertical, then away.
    fn place(&self, p: [f64; 3]) -> [f64; 3] {
        let (sine, cosine) = self.angle.sin_cos();
        let turned = [cosine * p[0] - sine * p[1], sine * p[0] + cosine * p[1], p[2]];
        std::array::from_fn(|axis| turned[axis] + self.shift_mm[axis])
    }

    /// Asserts that the repair of the moved take is the moved repair.
    fn check(&self, take: &Take, method: Method, rounds: usize, tolerance_mm: f64) {
        let settings = Settings::default();
        let place = |p| self.place(p);
        let expected = remade(&repaired(take, method, &settings, rounds, false).take, &self.columns, place);
        let found = repaired(&remade(take, &self.columns, place), method, &settings, rounds, false).take;
        for frame in 0..take.frames() {
            for marker in 0..take.markers.len() {
                assert_eq!(found.origin(frame, marker), expected.origin(frame, marker));
                if let (Some(p), Some(q)) = (found.position_mm(frame, marker), expected.position_mm(frame, marker)) {
                    let off = (0..3).map(|axis| (p[axis] - q[axis]).powi(2)).sum::<f64>().sqrt();
                    let name = found.display_label(marker);
                    assert!(off <= tolerance_mm, "{}, {rounds} rounds: {name} in frame {frame} is off by {off} mm", method.name());
                }
            }
        }
    }
}

/// A walk with holes, with and without labels that say where the trunk is.
fn takes() -> impl Strategy<Value = Take> {
    (1..100_u64, holes(10, 25), any::<bool>()).prop_map(|(seed, holes, named): (u64, Vec<Hole>, bool)| {
        let take = hidden(&walk_of(&WALKERS, 100, seed), &holes);
        if named { take } else { nameless(&take) }
    })
}

fn in_order() -> Vec<usize> {
    (0..WALKERS.len()).collect()
}

/// A body that wears markers is found wherever it is, and what it fills moves along.
#[test]
fn a_body_moves_along_with_what_it_wears() {
    let (whole, wearer) = actors_take(90, 30.0);
    let holes = [(3, 0.2, 20), (17, 0.5, 25), (18, 0.5, 25), (30, 0.7, 9)].map(|(marker, at, frames)| Hole { marker, at, frames });
    let take = hidden(&whole, &holes);
    let in_order: Vec<usize> = (0..take.markers.len()).collect();
    let settings = Settings { wearer: Some(Arc::new(wearer)), ..Settings::default() };
    for (angle, shift_mm, tolerance_mm) in [(0.0, [5000.0, -800.0, 1000.0], 0.01), (2.0, [0.0; 3], 0.5)] {
        let moved = Move { columns: in_order.clone(), angle, shift_mm };
        let place = |p| moved.place(p);
        let expected = repaired(&take, Method::Skeleton, &settings, 1, false).take;
        let found = repaired(&remade(&take, &in_order, place), Method::Skeleton, &settings, 1, false).take;
        for (frame, marker) in crate::missing(&take) {
            let (p, q) = (found.position_mm(frame, marker).unwrap(), place(expected.position_mm(frame, marker).unwrap()));
            let off = (0..3).map(|axis| (p[axis] - q[axis]).powi(2)).sum::<f64>().sqrt();
            assert!(off <= tolerance_mm, "marker {marker} in frame {frame} is off by {off} mm");
        }
    }
}

/// Where markers of a limb are hidden for long, a body knows more than curves do.
#[test]
fn a_body_fills_long_gaps_better_than_splines() {
    let (whole, wearer) = actors_take(150, 30.0);
    let holes = [(8, 0.1, 45), (15, 0.2, 30), (16, 0.2, 30), (24, 0.5, 40), (33, 0.6, 45), (38, 0.3, 60)];
    let take = hidden(&whole, &holes.map(|(marker, at, frames)| Hole { marker, at, frames }));
    let settings = Settings { wearer: Some(Arc::new(wearer)), ..Settings::default() };
    let missing = crate::missing(&take);
    let rms_mm = |method: Method| {
        let filled = repaired(&take, method, &settings, 1, false).take;
        let square = |&(frame, marker): &(usize, usize)| {
            let [p, q] = [&filled, &whole].map(|take| take.position_mm(frame, marker).unwrap());
            (0..3).map(|axis| (p[axis] - q[axis]).powi(2)).sum::<f64>()
        };
        (missing.iter().map(square).sum::<f64>() / missing.len() as f64).sqrt()
    };
    let (skeleton, spline) = (rms_mm(Method::Skeleton), rms_mm(Method::Spline));
    assert!(skeleton < 20.0 && skeleton < 0.25 * spline, "skeleton {skeleton} mm, spline {spline} mm");
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn a_repair_moves_with_its_take(take in takes(), metres in prop::array::uniform3(-60..60_i32), rounds in 1..12_usize) {
        let moved = Move { columns: in_order(), angle: 0.0, shift_mm: metres.map(|m| 1000.0 * f64::from(m)) };
        for method in Method::ALL {
            moved.check(&take, method, rounds, tolerances_mm(method).0);
        }
    }

    #[test]
    fn a_repair_turns_with_its_take(take in takes(), angle in 0.0..std::f64::consts::TAU, rounds in 1..12_usize) {
        let turned = Move { columns: in_order(), angle, shift_mm: [0.0; 3] };
        for method in Method::ALL {
            turned.check(&take, method, rounds, tolerances_mm(method).1);
        }
    }

    #[test]
    fn a_repair_does_not_depend_on_the_order_of_the_markers(take in takes(), columns in Just(in_order()).prop_shuffle(), rounds in 1..12_usize) {
        let reordered = Move { columns, angle: 0.0, shift_mm: [0.0; 3] };
        for method in Method::ALL {
            reordered.check(&take, method, rounds, tolerances_mm(method).1);
        }
    }
}

/// Nothing says which axis points up: then it is found, from the same numbers wherever the take was made.
#[test]
fn a_take_without_an_up_moves_along_as_well() {
    let take = hidden(&walk_of(&WALKERS, 100, 3), &[Hole { marker: 7, at: 0.4, frames: 20 }, Hole { marker: 2, at: 0.2, frames: 30 }]);
    let take = TakeBuilder::from(take).up(None).build();
    let moved = Move { columns: in_order(), angle: 0.0, shift_mm: [25_000.0, -8_000.0, 2_000.0] };
    for method in Method::ALL {
        moved.check(&take, method, 5, tolerances_mm(method).0);
    }
}
