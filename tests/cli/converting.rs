//! `convert`, compressed takes, and samples that are stated missing.

use crate::lab::{Lab, column};
use formats::{Direction, Format, Notes, Origin, Stated, Take, Unit};

/// Largest distance between the samples of two takes that both know, in mm; infinite if one knows what the other does not.
fn distance(a: &Take, b: &Take) -> f64 {
    assert_eq!((a.frames(), a.markers.len()), (b.frames(), b.markers.len()));
    let mut worst = 0.0_f64;
    for frame in 0..a.frames() {
        for marker in 0..a.markers.len() {
            worst = worst.max(match (a.position_mm(frame, marker), b.position_mm(frame, marker)) {
                (Some(p), Some(q)) => (0..3).map(|k| (p[k] - q[k]).abs()).fold(0.0, f64::max),
                (None, None) => 0.0,
                _ => f64::INFINITY,
            });
        }
    }
    worst
}

#[test]
fn a_take_goes_from_format_to_format_and_back() {
    let lab = Lab::new();
    let was = lab.take("walk-gaps.c3d");
    // the demonstration states which axis is up, which a table cannot say
    let ran = lab.run(&["convert", "walk-gaps.c3d", "-o", "table.csv"]).with_code(3);
    assert!(ran.out.starts_with("walk-gaps.c3d -> table.csv\n  c3d to csv: 41 markers, 150 frames at 120 Hz, in mm"), "{}", ran.out);
    assert!(ran.out.contains("look at    csv cannot hold which axis points up (+z); left out"), "{}", ran.out);
    assert!(distance(&lab.take("table.csv"), &was) < 1e-9);
    lab.run(&["convert", "table.csv", "-o", "again.c3d"]).with_code(0);
    assert_eq!(distance(&lab.take("again.c3d"), &was), 0.0, "32-bit floats survive a table");
}

#[test]
fn the_same_format_is_copied() {
    let lab = Lab::new();
    let ran = lab.run(&["convert", "walk-gaps.c3d", "-o", "copy.c3d"]).with_code(0);
    assert!(ran.out.contains("c3d, copied byte for byte"), "{}", ran.out);
    assert_eq!(lab.read("copy.c3d"), lab.read("walk-gaps.c3d"));
}

#[test]
fn units_and_axes_change_together() {
    let lab = Lab::new();
    let ran = lab.run(&["convert", "walk-gaps.c3d", "-o", "metres.c3d", "--units", "m", "--up", "y", "--json"]).with_code(0);
    let message = &ran.messages()[0];
    assert_eq!(
        (message["message_type"].as_str(), message["unit"].as_str(), message["up"].as_str()),
        (Some("converted"), Some("m"), Some("+y"))
    );
    let (was, is) = (lab.take("walk-gaps.c3d"), lab.take("metres.c3d"));
    assert_eq!((is.unit, is.up), (Unit::Metre, Some(Direction::PLUS_Y)));
    assert!(distance(&is, &was.turned(Direction::PLUS_Z, Direction::PLUS_Y)) < 1e-3);
    assert!(distance(&is, &was) > 500.0);
    // a table does not say where up is
    lab.run(&["convert", "walk-gaps.c3d", "-o", "t.csv"]).with_code(3);
    let refused = lab.run(&["convert", "t.csv", "-o", "u.csv", "--up", "y"]);
    assert_eq!(refused.code, 1);
    assert_eq!(refused.err, "mocap-repair: t.csv: does not say which axis points up, so it cannot be turned; say it with --from-up\n");
    lab.run(&["convert", "t.csv", "-o", "u.csv", "--from-up", "z", "--up", "y", "--units", "cm"]).with_code(3);
    assert!(lab.text("u.csv").lines().next().unwrap().contains("-x (cm)"));
    assert!(distance(&lab.take("u.csv"), &was.turned(Direction::PLUS_Z, Direction::PLUS_Y)) < 1e-9);
}

#[test]
fn compressed_takes_are_takes() {
    let lab = Lab::new();
    lab.run(&["convert", "walk-gaps.c3d", "-o", "walk.c3d.zst"]).with_code(0);
    assert!(lab.read("walk.c3d.zst").starts_with(&[0x28, 0xb5, 0x2f, 0xfd]));
    lab.run(&["convert", "walk.c3d.zst", "-o", "back.c3d"]).with_code(0);
    assert_eq!(lab.read("back.c3d"), lab.read("walk-gaps.c3d"));
    // the main job, from and to compressed files, is the main job
    for (input, output) in
        [("walk-gaps.c3d", "a.c3d"), ("walk.c3d.zst", "b.c3d"), ("walk.c3d.zst", "c.c3d.zst"), ("walk-gaps.c3d", "d.c3d.zst")]
    {
        lab.run(&[input, "-o", output, "--method", "spline"]).with_code(0);
    }
    assert_eq!(lab.read("b.c3d"), lab.read("a.c3d"));
    assert_eq!(lab.read("c.c3d.zst"), lab.read("d.c3d.zst"));
    lab.run(&["convert", "c.c3d.zst", "-o", "e.c3d"]).with_code(0);
    assert_eq!(lab.read("e.c3d"), lab.read("a.c3d"));
    assert!(lab.listing_names().iter().any(|n| n == "c.mcap"), "the log is named after the take");
}

#[test]
fn compressed_files_that_are_none() {
    let lab = Lab::new();
    lab.write("named.c3d.zst", lab.read("walk-gaps.c3d"));
    let ran = lab.run(&["named.c3d.zst", "-o", "out.c3d"]);
    assert_eq!((ran.code, ran.out.as_str()), (1, ""));
    assert!(ran.err.contains("is named .zst, but its content is not compressed with Zstandard"), "{}", ran.err);
    lab.run(&["convert", "walk-gaps.c3d", "-o", "walk.c3d.zst"]).with_code(0);
    let whole = lab.read("walk.c3d.zst");
    lab.write("cut.c3d.zst", &whole[..whole.len() / 2]);
    let ran = lab.run(&["inspect", "cut.c3d.zst"]);
    assert!(ran.code == 1 && ran.err.contains("damaged or cut off"), "{}", ran.err);
}

#[test]
fn samples_stated_missing_are_filled() {
    let lab = Lab::new();
    let was = lab.take("walk-truth.c3d");
    let knee = column(&was, "LKNE");
    let label = &was.markers[knee].label;
    let (first, last) = (was.frame_label(40), was.frame_label(49));
    let stated = format!("{label}:{first}-{last}");
    let ran = lab.run(&["inspect", "walk-truth.c3d", "--missing", &stated]).with_code(0);
    assert!(ran.out.contains("1 gaps, 10 of"), "{}", ran.out);
    lab.run(&["walk-truth.c3d", "-o", "filled.c3d", "--missing", &stated, "--fills", "fills.csv"]).with_code(0);
    // the table of fills names the same samples
    lab.run(&["walk-truth.c3d", "-o", "again.c3d", "--missing", "fills.csv"]).with_code(0);
    assert_eq!(lab.read("again.c3d"), lab.read("filled.c3d"));
    let is = lab.take("filled.c3d");
    for frame in 0..was.frames() {
        for marker in 0..was.markers.len() {
            let (p, q) = (was.position_mm(frame, marker).unwrap(), is.position_mm(frame, marker).unwrap());
            if marker == knee && (40..50).contains(&frame) {
                assert_eq!(is.origin(frame, marker), Origin::Derived);
                assert!(p != q && (0..3).all(|k| (p[k] - q[k]).abs() < 20.0), "{p:?} {q:?}");
            } else {
                assert_eq!(p, q);
            }
        }
    }
    let ran = lab.run(&["walk-truth.c3d", "-o", "no.c3d", "--missing", "NOSE:1-2"]);
    assert!(ran.code == 1 && ran.err.contains("walk-truth.c3d: --missing NOSE:1-2 fits no marker; the take has"), "{}", ran.err);
}
/// A C3D of integers holds ±32767 steps and no more.
#[test]
fn integers_become_floats_where_that_is_needed() {
    let lab = Lab::empty();
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/c3d/good/intel_integer.c3d")).unwrap();
    lab.write("integer.c3d", &bytes);
    lab.run(&["convert", "integer.c3d", "-o", "same.c3d"]).with_code(0);
    assert_eq!(lab.read("same.c3d"), bytes);
    let ran = lab.run(&["convert", "integer.c3d", "-o", "float.c3d", "--float"]).with_code(0);
    assert!(ran.out.contains("coordinates stored as integers become floating-point numbers"), "{}", ran.out);
    let open = |name: &str| formats::c3d::C3d.open(lab.read(name), &Stated::default(), &Notes::new()).unwrap().take().clone();
    assert!(distance(&open("integer.c3d"), &open("float.c3d")) < 1e-3);
    assert!(lab.read("float.c3d").len() > bytes.len());
}
