//! Is it a person, and are those gaps?

#![allow(clippy::unwrap_used, clippy::indexing_slicing)] // a test may fail

use super::markers::MARKERS;
use super::walker::Segment;
use super::*;

/// (mean, standard deviation)
fn moments(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (mean, (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt())
}

fn distance_mm(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

fn position(take: &Take, frame: usize, name: &str) -> [f64; 3] {
    let marker = take.markers.iter().position(|m| m.label == name).expect(name);
    take.position_mm(frame, marker).expect("hidden")
}

fn bits(take: &Take) -> Vec<Option<[u64; 3]>> {
    let cell = |i: usize| take.position_mm(i / take.markers.len(), i % take.markers.len()).map(|p| p.map(f64::to_bits));
    (0..take.frames() * take.markers.len()).map(cell).collect()
}

#[test]
fn the_take_is_what_it_says() {
    let Demo { truth, gaps, .. } = demo(&DemoOptions::default());
    let labels: Vec<&str> = truth.markers.iter().map(|m| m.label.as_str()).collect();
    assert_eq!(
        labels.join(" "),
        "C7 CLAV LANK LBHD LBWT LELB LFHD LFIN LFRM LFWT LHEE LKNE LMT5 LSHN LSHO LTHI LTOE LUPA LWRA LWRB \
         RANK RBAC RBHD RBWT RELB RFHD RFIN RFRM RFWT RHEE RKNE RMT5 RSHN RSHO RTHI RTOE RUPA RWRA RWRB STRN T10"
    );
    assert_eq!(labels.len(), 41);
    for take in [&truth, &gaps] {
        assert_eq!((take.frames(), take.rate_hz, take.first_frame), (900, 120.0, 1));
        assert_eq!((take.unit, take.up), (formats::Unit::Millimetre, Some(Direction::PLUS_Z)));
        assert_eq!(take.markers, truth.markers);
    }
    assert!(bits(&truth).iter().all(Option::is_some), "the truth has no gaps");
}

/// Markers of one segment keep their distance, but not like a machine.
#[test]
fn bones_are_nearly_rigid() {
    for seed in 1..=4 {
        let take = walk(900, 120.0, seed);
        for (a, first) in MARKERS.iter().enumerate() {
            for (b, second) in MARKERS.iter().enumerate().skip(a + 1).filter(|(_, second)| second.segment == first.segment) {
                let lengths: Vec<f64> =
                    (0..900).map(|f| distance_mm(take.position_mm(f, a).unwrap(), take.position_mm(f, b).unwrap())).collect();
                let (mean, spread) = moments(&lengths);
                let pair = format!("seed {seed}, {}-{}: {mean:.1} ± {spread:.2} mm", first.name, second.name);
                assert!((30.0..600.0).contains(&mean), "{pair}");
                assert!((0.2..8.0).contains(&spread), "{pair}");
                assert!(first.segment != Segment::Head || spread < 1.5, "the skull is hard: {pair}");
            }
        }
    }
}

#[test]
fn without_skin_and_noise_segments_are_rigid() {
    let take = demo(&DemoOptions { frames: 300, noise_mm: 0.0, softness: 0.0, ..DemoOptions::default() }).truth;
    let lengths: Vec<f64> = (0..300).map(|f| distance_mm(position(&take, f, "LTHI"), position(&take, f, "LKNE"))).collect();
    assert!(moments(&lengths).1 < 1e-3, "rounding to f32 is all that is left");
}

#[test]
fn feet_stay_on_the_floor() {
    for seed in 1..=8 {
        let take = walk(1200, 120.0, seed);
        let lowest = (0..1200).flat_map(|f| (0..41).map(move |m| (f, m))).map(|(f, m)| take.position_mm(f, m).unwrap()[2]);
        let lowest = lowest.fold(f64::INFINITY, f64::min);
        assert!(lowest > -5.0, "seed {seed}: a marker is at {lowest} mm");
        for (heel, toe) in [("LHEE", "LTOE"), ("RHEE", "RTOE")] {
            let least = |name| (0..1200).map(|f| position(&take, f, name)[2]).fold(f64::INFINITY, f64::min);
            assert!((10.0..60.0).contains(&least(heel)) && (10.0..60.0).contains(&least(toe)), "seed {seed}: the foot never comes down");
            // Between two looks 25 ms apart, a standing foot does not go anywhere, and a foot stands for a third of the time.
            let still = (0..1197).filter(|&f| {
                let moved = |name| distance_mm(position(&take, f, name), position(&take, f + 3, name));
                moved(heel) < 3.0 && moved(toe) < 3.0
            });
            let share = still.count() as f64 / 1197.0;
            assert!((0.2..0.6).contains(&share), "seed {seed}: {heel} and {toe} are still for {share:.2} of the time");
        }
    }
}

#[test]
fn walking_speed_is_that_of_a_walk() {
    for seed in 1..=8 {
        let take = walk(900, 120.0, seed);
        let path: f64 = (1..900)
            .map(|f| {
                let [from, to] = [f - 1, f].map(|f| position(&take, f, "STRN"));
                (to[0] - from[0]).hypot(to[1] - from[1])
            })
            .sum();
        let speed = path / 899.0 * 120.0 / 1000.0;
        assert!((0.9..1.8).contains(&speed), "seed {seed}: {speed} m/s");
        let (start, end) = (position(&take, 0, "STRN"), position(&take, 899, "STRN"));
        assert!(distance_mm(start, end) < 0.85 * path, "seed {seed}: the path is curved");
        assert!((800.0..1700.0).contains(&start[2]), "seed {seed}: the chest is at {} mm", start[2]);
    }
}

/// Nothing jumps: without noise no marker is accelerated by more than a swinging foot is.
#[test]
fn accelerations_are_bounded() {
    for seed in 1..=8 {
        let take = demo(&DemoOptions { frames: 1200, seed, noise_mm: 0.0, gap_share: 0.0, ..DemoOptions::default() }).truth;
        for (marker, attachment) in MARKERS.iter().enumerate() {
            let limit = if matches!(attachment.segment, Segment::Foot(_) | Segment::Shank(_) | Segment::Thigh(_)) { 80.0 } else { 25.0 };
            for frame in 1..1199 {
                let [a, b, c] = [frame - 1, frame, frame + 1].map(|f| take.position_mm(f, marker).unwrap());
                let second: [f64; 3] = std::array::from_fn(|axis| a[axis] - 2.0 * b[axis] + c[axis]);
                let acceleration = distance_mm(second, [0.0; 3]) * 120.0 * 120.0 / 1000.0;
                assert!(acceleration < limit, "seed {seed}: {} at frame {frame}: {acceleration:.0} m/s²", attachment.name);
            }
        }
    }
}

#[test]
fn strides_vary() {
    let walker = Walker::new(1);
    // Times at which the phase passes whole numbers.
    let strikes: Vec<f64> =
        (0..30_000).map(|i| f64::from(i) * 0.001).filter(|&t| walker.phase(t).floor() != walker.phase(t - 0.001).floor()).collect();
    let strides: Vec<f64> = strikes.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let (mean, spread) = moments(&strides);
    assert!((mean - 1.1).abs() < 0.03 && (0.005..0.06).contains(&spread), "{mean} ± {spread} s");
}

#[test]
fn gaps_hide_a_tenth_and_nothing_else() {
    for seed in 1..=12 {
        for frames in [600, 900, 2000] {
            let Demo { truth, gaps, hidden } = demo(&DemoOptions { frames, seed, ..DemoOptions::default() });
            let (whole, seen) = (bits(&truth), bits(&gaps));
            let missing = seen.iter().filter(|cell| cell.is_none()).count();
            let share = missing as f64 / seen.len() as f64;
            assert!((0.08..0.12).contains(&share), "seed {seed}, {frames} frames: {share}");
            assert!(whole.iter().zip(&seen).all(|(truth, seen)| seen.is_none() || seen == truth), "seed {seed}: bit for bit");
            assert_eq!(hidden.iter().map(Gap::frames).sum::<usize>(), missing, "the list of gaps is complete");
            for gap in &hidden {
                assert!(gap.start >= 10 && gap.end + 10 <= frames && gap.frames() <= 250, "seed {seed}: {gap:?}");
                assert!(gaps.position_mm(gap.start - 1, gap.marker).is_some() && gaps.position_mm(gap.end, gap.marker).is_some());
                assert!((gap.start..gap.end).all(|f| gaps.origin(f, gap.marker) == Origin::Missing));
            }
            let black = (0..frames).filter(|&f| (0..41).all(|m| gaps.position_mm(f, m).is_none())).count();
            assert_eq!(black, 12, "seed {seed}: frames without any marker");
        }
    }
}

/// The kinds of gaps that the module promises are all there.
#[test]
fn gaps_come_in_all_kinds() {
    let Demo { gaps, hidden, .. } = demo(&DemoOptions::default());
    let together = |names: &[&str], frames: usize| {
        hidden.iter().any(|gap| {
            gap.frames() == frames
                && names.iter().all(|name| {
                    let marker = gaps.markers.iter().position(|m| m.label == *name).unwrap();
                    hidden.contains(&Gap { marker, ..*gap })
                })
        })
    };
    assert!(together(&["RKNE", "RSHN"], 65));
    assert!(together(&["LFRM", "LWRA", "LWRB", "LFIN"], 60));
    assert!((18..48).any(|frames| together(&["LFWT", "RFWT"], frames)), "hips");
    assert!(hidden.iter().any(|gap| gap.frames() >= 120), "a long one");
    assert!(hidden.iter().filter(|gap| gap.frames() < 40 && gap.frames() != 12).count() >= 5, "short ones");
}

#[test]
fn a_seed_is_a_take() {
    let make = |seed| demo(&DemoOptions { frames: 400, seed, ..DemoOptions::default() });
    let (one, again, two) = (make(1), make(1), make(2));
    assert_eq!((bits(&one.truth), bits(&one.gaps), &one.hidden), (bits(&again.truth), bits(&again.gaps), &again.hidden));
    assert_ne!(one.hidden, two.hidden);
    assert_ne!(bits(&one.truth), bits(&two.truth));
    assert_eq!(bits(&one.truth), bits(&walk(400, 120.0, 1)), "walk is the truth of demo");
    assert_eq!(bits(&one.truth)[..41 * 100], bits(&walk(100, 120.0, 1)), "a shorter take is the start of a longer one");
}

/// Short takes are not worth a panic.
#[test]
fn takes_of_any_length() {
    for frames in [0, 1, 2, 19, 20, 21, 30, 59, 100] {
        let made = demo(&DemoOptions { frames, ..DemoOptions::default() });
        assert_eq!(made.gaps.frames(), frames);
        assert!(made.hidden.iter().all(|gap| gap.start >= 10 && gap.end + 10 <= frames));
    }
    assert!(demo(&DemoOptions { gap_share: 0.0, ..DemoOptions::default() }).hidden.is_empty());
}

#[test]
fn hide_hides() {
    let take = walk(100, 120.0, 1);
    let hidden = hide(&take, "LKNE", 40..90);
    let knee = take.markers.iter().position(|m| m.label == "LKNE").unwrap();
    for frame in 0..100 {
        for marker in 0..41 {
            let expected = if marker == knee && (40..90).contains(&frame) { None } else { take.position_mm(frame, marker) };
            assert_eq!(hidden.position_mm(frame, marker), expected);
        }
    }
}

#[test]
#[should_panic(expected = "no marker of that name")]
fn hide_does_not_overlook_a_misspelt_marker() {
    let _ = hide(&walk(10, 120.0, 1), "KNEE", 2..3);
}
