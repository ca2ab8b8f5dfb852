//! What was seen is never touched, gaps are filled whole, and no take makes a solver panic.

use crate::{Repaired, WALKERS, cases, hidden, holes, markers, repaired, same_where_known, settings, walk_of};
use formats::{Origin, Take, TakeBuilder};
use mocap_repair::demo::{hide, walk};
use mocap_repair::gaps::Open;
use mocap_repair::solve::auto::LEAST_SEEN;
use mocap_repair::solve::{Method, Settings};
use proptest::prelude::*;

/// Every filled gap is finite and marked as repaired, every other one is as open as it was.
#[track_caller]
fn whole_or_open(before: &Take, after: &Repaired, what: &str) {
    assert!(same_where_known(before, &after.take), "{what}: something that was seen is not what it was");
    for (gap, decision) in after.gaps.iter().zip(&after.decisions) {
        for frame in gap.start..gap.end {
            let position = after.take.position_mm(frame, gap.marker);
            match decision {
                Ok(()) => {
                    assert_eq!(after.take.origin(frame, gap.marker), Origin::Repaired, "{what}: {gap:?}");
                    assert!(position.is_some_and(|p| p.iter().all(|x| x.is_finite())), "{what}: {gap:?} at {frame}: {position:?}");
                }
                Err(_) => assert_eq!(position, None, "{what}: {gap:?} is open"),
            }
        }
    }
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn what_was_seen_stays_and_gaps_between_are_filled(seed in 1..100_u64, frames in 20..80_usize, holes in holes(12, 25)) {
        let take = hidden(&walk_of(&WALKERS, frames, seed), &holes);
        for method in Method::ALL {
            for settings in settings(method) {
                let after = repaired(&take, method, &settings, 3, false);
                let what = format!("{} with {settings:?}", method.name());
                whole_or_open(&take, &after, &what);
                prop_assert!(!after.gaps.is_empty() && after.decisions.iter().all(Result::is_ok), "{}: {:?}", what, after.decisions);
                // and a repaired take has nothing left to repair
                let again = repaired(&after.take, method, &settings, 3, false);
                prop_assert!(again.gaps.is_empty() && same_where_known(&after.take, &again.take), "{}", what);
            }
        }
    }

    #[test]
    fn a_take_without_gaps_is_a_fixed_point(seed in 1..100_u64, frames in 1..40_usize, extrapolate in any::<bool>()) {
        let take = walk_of(&WALKERS, frames, seed);
        for method in Method::ALL {
            for settings in settings(method) {
                let after = repaired(&take, method, &settings, 3, extrapolate);
                prop_assert!(after.gaps.is_empty() && same_where_known(&take, &after.take), "{}", method.name());
            }
        }
    }

    /// The one door through which a take changes.
    #[test]
    fn filling_a_take_opens_missing_samples_only(
        known in prop::collection::vec(0..3_u8, 12),
        fills in prop::collection::vec((0..5_usize, 0..4_usize, prop::array::uniform3(prop_oneof![9 => -1e4..1e4_f64, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)])), 0..30),
    ) {
        let mut take = TakeBuilder::new(markers(3), 4, 100.0);
        for (k, known) in known.iter().enumerate().filter(|(_, known)| **known > 0) {
            let origin = if *known == 1 { Origin::Measured } else { Origin::Derived };
            take.set(k / 3, k % 3, [k as f64, -0.0, 1e-300], origin);
        }
        let before = take.build();
        let mut after = before.clone();
        for (frame, marker, position) in fills {
            let missing = frame < 4 && marker < 3 && after.origin(frame, marker) == Origin::Missing;
            let finite = position.iter().all(|x| x.is_finite());
            prop_assert_eq!(after.fill(frame, marker, position), missing && finite);
            if missing && finite {
                prop_assert_eq!((after.origin(frame, marker), after.position_mm(frame, marker)), (Origin::Repaired, Some(position)));
            }
        }
        prop_assert!(same_where_known(&before, &after));
        prop_assert_eq!((before.frames(), before.markers), (after.frames(), after.markers));
    }
}

proptest! {
    #![proptest_config(cases(96))]

    /// One to five frames of one to three markers, in every state of decay, somewhere in space, on one line, or all in one place.
    #[test]
    fn the_smallest_takes_are_filled_or_left_open(
        frames in 1..=5_usize,
        count in 1..=3_usize,
        seen in any::<u16>(),
        shape in 0..3_u8,
        places in prop::collection::vec(prop::array::uniform3(-1000.0..1000.0), 15),
    ) {
        let mut take = TakeBuilder::new(markers(count), frames, 100.0);
        for k in (0..frames * count).filter(|k| seen >> k & 1 == 1) {
            let place = match shape {
                0 => places[k],
                1 => [k as f64 * 10.0, 0.0, 0.0],
                _ => [500.0; 3],
            };
            take.set(k / count, k % count, place, Origin::Measured);
        }
        let take = take.build();
        for method in Method::ALL {
            for settings in settings(method) {
                let after = repaired(&take, method, &settings, 4, true);
                whole_or_open(&take, &after, method.name());
                for (gap, decision) in after.gaps.iter().zip(&after.decisions) {
                    let never = gap.frames() == frames;
                    let expected = if never {
                        Err(Open::NeverSeen)
                    } else if method == Method::Auto && rarely_seen(&take, gap.marker) {
                        Err(Open::TooFewSeen)
                    } else {
                        Ok(())
                    };
                    prop_assert_eq!(*decision, expected, "{} {:?}", method.name(), gap);
                }
            }
        }
    }
}

/// True if a marker was seen in too few frames to predict it from.
fn rarely_seen(take: &Take, marker: usize) -> bool {
    (0..take.frames()).filter(|&frame| take.position_mm(frame, marker).is_some()).count() < LEAST_SEEN
}

/// Takes with something wrong, and how many of their gaps stay open when ends are filled as well.
fn odd_takes() -> Vec<(&'static str, Take, usize)> {
    let walked = walk(60, 120.0, 5);
    let all = |take: &Take, frames: std::ops::Range<usize>| {
        take.markers.iter().fold(take.clone(), |take, marker| hide(&take, marker.name(), frames.clone()))
    };
    let still = {
        let mut take = TakeBuilder::new(markers(5), 40, 100.0);
        for frame in 0..40 {
            for marker in (0..5).filter(|marker| frame % 7 != *marker) {
                take.set(frame, marker, [100.0 * marker as f64, 50.0 * (marker * marker) as f64, 900.0], Origin::Measured);
            }
        }
        take.build()
    };
    let far = {
        let mut take = TakeBuilder::new(markers(4), 30, 100.0);
        for frame in 0..30 {
            for marker in (0..4).filter(|marker| (frame + marker) % 5 != 0) {
                take.set(frame, marker, [1e6 + 3.0 * frame as f64, -2e6, 1e-3 * marker as f64], Origin::Measured);
            }
        }
        take.build()
    };
    vec![
        ("a black-out", all(&walked, 20..35), 0),
        ("two black-outs with one frame between them", all(&all(&walked, 10..20), 21..40), 0),
        ("nothing at the beginning", all(&walked, 0..25), 0),
        ("nothing at the end", all(&walked, 40..60), 0),
        ("one frame is all there is", all(&all(&walked, 0..30), 31..60), 0),
        ("two frames far apart", all(&all(&all(&walked, 0..3), 4..55), 56..60), 0),
        ("a marker in one frame", hide(&hide(&walked, "LKNE", 0..31), "LKNE", 32..60), 0),
        ("a marker that never appears", hide(&hide(&walked, "LKNE", 0..60), "RKNE", 10..20), 1),
        ("nothing at all", all(&walked, 0..60), 41),
        ("nobody moves", still, 0),
        ("kilometres away, all in one line", far, 0),
    ]
}

#[test]
fn odd_takes_are_filled_or_left_open() {
    let takes = odd_takes();
    let mut tried = 0;
    for (what, take, open) in &takes {
        for method in Method::ALL {
            for settings in settings(method) {
                let what = format!("{what}, {} with {settings:?}", method.name());
                let after = repaired(take, method, &settings, 8, true);
                whole_or_open(take, &after, &what);
                assert!(!after.gaps.is_empty(), "{what}: no gap");
                // the others fill whatever was seen at all; this one wants evidence
                let rare = after.gaps.iter().filter(|gap| gap.frames() < take.frames() && rarely_seen(take, gap.marker)).count();
                let open = open + if method == Method::Auto { rare } else { 0 };
                assert_eq!(after.decisions.iter().filter(|d| d.is_err()).count(), open, "{what}: {:?}", after.decisions);
                let told = after.decisions.iter().filter(|d| **d == Err(Open::TooFewSeen)).count();
                assert_eq!(told, if method == Method::Auto { rare } else { 0 }, "{what}");
                // whatever fills a gap, nobody jumps over the moon
                for gap in after.gaps.iter().zip(&after.decisions).filter(|(_, d)| d.is_ok()).map(|(gap, _)| gap) {
                    for frame in gap.start..gap.end {
                        let p = after.take.position_mm(frame, gap.marker).unwrap();
                        assert!(p.iter().all(|x| x.abs() < 1e7), "{what}: {gap:?} at {frame}: {p:?}");
                    }
                }
                tried += 1;
            }
        }
    }
    let settings: usize = Method::ALL.into_iter().map(|method| crate::settings(method).len()).sum();
    assert_eq!(tried, takes.len() * settings);
}

/// A gap that reaches an end of the take is filled only if that was asked for.
#[test]
fn ends_stay_open_unless_asked_for() {
    let take = hide(&hide(&walk(40, 120.0, 1), "LKNE", 0..5), "RKNE", 30..40);
    for method in Method::ALL {
        let after = repaired(&take, method, &Settings::default(), 2, false);
        assert_eq!(after.decisions, [Err(Open::AtEnd); 2], "{}", method.name());
        whole_or_open(&take, &after, method.name());
    }
}
