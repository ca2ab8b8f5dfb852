//! Samples that no body makes: told always, dropped if asked to.

use crate::lab::{Lab, missing};
use formats::{Notes, Origin, Take, TakeBuilder};
use std::ops::Range;

/// The samples of the demonstration take that are wrong in `odd.*`: marker and frames from 0.
const SPIKE: (&str, Range<usize>) = ("LWRA", 60..62);
const GHOST: (&str, Range<usize>) = ("C7", 0..2);
const SWAP: (&str, &str, Range<usize>) = ("LTHI", "RTHI", 90..110);

fn column(take: &Take, name: &str) -> usize {
    take.markers.iter().position(|m| m.name() == name).unwrap()
}

/// A lab with `odd.c3d` and `odd.csv`: the demonstration without gaps, with a spike, a ghost in its first frames, and two labels exchanged.
fn odd() -> (Lab, Take) {
    let lab = Lab::new();
    let truth = lab.take("walk-truth.c3d");
    let mut odd = TakeBuilder::from(truth.clone());
    for (name, frames) in [SPIKE, GHOST] {
        for frame in frames {
            let [x, y, z] = truth.position_mm(frame, column(&truth, name)).unwrap();
            odd.set(frame, column(&truth, name), [x, y, z + 80.0], Origin::Measured);
        }
    }
    let (a, b) = (column(&truth, SWAP.0), column(&truth, SWAP.1));
    for frame in SWAP.2 {
        odd.set(frame, a, truth.position_mm(frame, b).unwrap(), Origin::Measured);
        odd.set(frame, b, truth.position_mm(frame, a).unwrap(), Origin::Measured);
    }
    let odd = odd.build();
    for name in ["odd.c3d", "odd.csv", "odd.trc"] {
        let format = formats::by_extension(&name[4..]).unwrap();
        let mut bytes = Vec::new();
        format.create(&odd, &mut bytes, &Notes::new()).unwrap();
        lab.write(name, bytes);
    }
    (lab, truth)
}

/// Wrong samples as (frame, column).
fn wrong(take: &Take) -> Vec<(usize, usize)> {
    let mut all: Vec<(usize, usize)> = Vec::new();
    for (name, frames) in [SPIKE, GHOST, (SWAP.0, SWAP.2), (SWAP.1, SWAP.2)] {
        all.extend(frames.map(|frame| (frame, column(take, name))));
    }
    all.sort_unstable();
    all
}

#[test]
fn suspects_of_markers_with_one_label_are_told_apart() {
    let (lab, truth) = odd();
    let mut twins = lab.take("odd.c3d");
    // the first marker gets the label of the one with the spike, which is another column
    let column = column(&truth, SPIKE.0);
    assert_ne!(column, 0);
    twins.markers[0].label = twins.markers[column].label.clone();
    lab.create("twins.c3d", &twins);
    let ran = lab.run(&["twins.c3d", "-o", "out.c3d", "--json", "--report", "out.html"]);
    let spikes: Vec<_> = ran.messages().into_iter().filter(|m| m["message_type"] == "suspect" && m["kind"] == "spike").collect();
    assert_eq!(spikes.iter().map(|m| m["column"].as_u64()).collect::<Vec<_>>(), [Some(column as u64)], "{ran:?}");
}

#[test]
fn suspects_are_told_and_nothing_is_changed() {
    let (lab, truth) = odd();
    let before = lab.read("odd.c3d");
    let ran = lab.run(&["odd.c3d", "-o", "same.c3d"]).with_code(0);
    for told in ["suspect    1 spike (LWRA, 61 to 62)", "1 ghost (C7, 1 to 2)", "1 swap (LTHI/RTHI, 91 to 110)", "--drop-outliers"] {
        assert!(ran.out.contains(told), "{told}: {}", ran.out);
    }
    assert_eq!(lab.read("same.c3d"), before, "suspects are as they were measured");

    let messages = lab.run(&["odd.c3d", "-o", "same.c3d", "--force", "--json"]).with_code(0).messages();
    let suspects: Vec<_> = messages.iter().filter(|m| m["message_type"] == "suspect").collect();
    assert_eq!(suspects.len(), 4);
    assert!(suspects.iter().all(|s| s["dropped"] == false));
    let summary = messages.last().unwrap();
    assert_eq!((&summary["suspects"], &summary["samples_suspect"], &summary["samples_dropped"]), (&4.into(), &44.into(), &0.into()));

    let ran = lab.run(&["inspect", "odd.c3d"]).with_code(0);
    assert!(ran.out.contains("swap: LTHI has changed places with RTHI"), "{}", ran.out);
    let inspected = &lab.run(&["inspect", "odd.c3d", "--json"]).with_code(0).messages()[0];
    assert_eq!(inspected["suspects"].as_array().map(Vec::len), Some(4));
    // none where there are none
    let clean = lab.run(&["walk-gaps.c3d", "-o", "walk.c3d", "--method", "spline"]);
    assert!(!clean.out.contains("suspect"), "{}", clean.out);
    assert_eq!(truth.frames(), 150);
}

#[test]
fn outliers_are_dropped_and_filled_one_by_one() {
    let (lab, truth) = odd();
    for input in ["odd.c3d", "odd.csv", "odd.trc"] {
        let output = format!("clean-{input}");
        let ran =
            lab.run(&[input, "-o", &output, "--drop-outliers", "--extrapolate", "--fills", "fills.csv", "--json", "--force", "--no-log"]);
        let messages = ran.messages();
        let suspects: Vec<_> = messages.iter().filter(|m| m["message_type"] == "suspect").collect();
        assert_eq!(suspects.len(), 4, "{input}");
        assert!(suspects.iter().all(|s| s["dropped"] == true));
        assert_eq!((&messages.last().unwrap()["samples_dropped"], &messages.last().unwrap()["samples_filled"]), (&44.into(), &44.into()));

        let (odd, clean) = (lab.take(input), lab.take(&output));
        let wrong = wrong(&truth);
        for (frame, marker) in (0..truth.frames()).flat_map(|f| (0..truth.markers.len()).map(move |m| (f, m))) {
            let (is, was) = (clean.position_mm(frame, marker).unwrap(), truth.position_mm(frame, marker).unwrap());
            if wrong.binary_search(&(frame, marker)).is_ok() {
                let off = (0..3).map(|k| (is[k] - was[k]).powi(2)).sum::<f64>().sqrt();
                assert!(off < 25.0, "{input}: frame {frame}, marker {marker} is off by {off} mm");
                if input == "odd.c3d" {
                    assert_eq!(clean.origin(frame, marker), Origin::Derived, "the file says that it was filled");
                }
            } else {
                assert_eq!(Some(is), odd.position_mm(frame, marker), "{input}: frame {frame}, marker {marker}");
            }
        }
        assert_eq!(lab.text("fills.csv").lines().count(), 1 + wrong.len());
    }
    let ran = lab.run(&["odd.c3d", "-o", "told.c3d", "--drop-outliers", "--extrapolate", "--method", "spline"]).with_code(0);
    for told in [
        "dropped    C7 is up to 80 mm off its path beside a gap, frames 1 to 2",
        "LWRA is up to 80 mm off",
        "RTHI has changed places with LTHI",
    ] {
        assert!(ran.sentences().contains(told), "{told}: {}", ran.out);
    }
}

#[test]
fn what_is_dropped_and_not_filled_stays_as_it_was() {
    let (lab, truth) = odd();
    // the ghost is at the take's first frame, which is not filled unasked; the swap is longer than allowed
    let ran = lab.run(&["odd.c3d", "-o", "part.c3d", "--drop-outliers", "--max-gap", "5", "--method", "spline"]).with_code(3);
    assert!(ran.sentences().contains("42 samples that are stated missing or dropped stay open, and the file still holds"), "{}", ran.out);
    let (odd, part) = (lab.take("odd.c3d"), lab.take("part.c3d"));
    for (frame, marker) in wrong(&truth) {
        let filled = marker == column(&truth, SPIKE.0);
        assert_eq!(part.position_mm(frame, marker) == odd.position_mm(frame, marker), !filled, "frame {frame}, marker {marker}");
    }
    // a new file is made from what is known
    lab.run(&["odd.c3d", "-o", "part.csv", "--drop-outliers", "--max-gap", "5", "--method", "spline", "--no-log"]).with_code(3);
    assert_eq!(missing(&lab.take("part.csv")).len(), 42);
    // in place, with the original kept; and a dry run tells what it would do
    let ran = lab.run(&["odd.c3d", "--dry-run", "--drop-outliers"]);
    assert!(ran.out.contains("would drop") && ran.code == 3, "{}", ran.out);
    let before = lab.read("odd.c3d");
    lab.run(&["odd.c3d", "--in-place", "--drop-outliers", "--extrapolate", "--method", "spline", "--no-log"]).with_code(0);
    assert_eq!(lab.read("odd.c3d.orig"), before);
    assert_ne!(lab.read("odd.c3d"), before);
}

#[test]
fn ignored_outliers_stay_and_fills_do_without_them() {
    let (lab, truth) = odd();
    // a gap of the other wrist marker while the first one is off, and of a knee while the thighs are exchanged
    let gaps = ["--missing", "LWRB:50-70", "--missing", "LKNE:85-115"];
    let error = |output: &str| {
        let take = lab.take(output);
        let mut squares = 0.0;
        for (name, frames) in [("LWRB", 49..70), ("LKNE", 84..115)] {
            let marker = column(&take, name);
            for frame in frames {
                let (is, was) = (take.position_mm(frame, marker).unwrap(), truth.position_mm(frame, marker).unwrap());
                squares += (0..3).map(|k| (is[k] - was[k]).powi(2)).sum::<f64>();
            }
        }
        f64::sqrt(squares / 52.0)
    };
    let odd_take = lab.take("odd.c3d");
    lab.run(&[&["odd.c3d", "-o", "leaning.c3d"][..], &gaps].concat()).with_code(0);
    let ran = lab.run(&[&["odd.c3d", "-o", "free.c3d", "--ignore-outliers"][..], &gaps].concat()).with_code(0);
    assert!(ran.out.contains("nothing was filled from them"), "{}", ran.out);
    let free = lab.take("free.c3d");
    for (frame, marker) in wrong(&truth) {
        assert_eq!(free.position_mm(frame, marker), odd_take.position_mm(frame, marker), "they stay as they were measured");
    }
    assert!(error("free.c3d") < 5.0 && 3.0 * error("free.c3d") < error("leaning.c3d"), "{} {}", error("free.c3d"), error("leaning.c3d"));
    assert!(lab.run(&["odd.c3d", "-o", "no.c3d", "--ignore-outliers", "--drop-outliers"]).code == 2);
}
