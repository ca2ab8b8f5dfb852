//! `convert`, compressed takes, and samples that are stated missing.

use crate::lab::{Lab, column};
use formats::{Direction, Format, Notes, Origin, Stated, Take, Unit};
use std::fmt::Write;

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

/// What stays open keeps its cells, and is told.
#[test]
fn samples_stated_missing_may_stay_open() {
    let lab = Lab::new();
    lab.run(&["convert", "walk-truth.c3d", "-o", "walk.csv"]).with_code(3);
    let was = lab.take("walk-truth.c3d");
    let label = &was.markers[column(&was, "LKNE")].label;
    for input in ["walk-truth.c3d", "walk.csv"] {
        let output = format!("out-{input}");
        let first = format!("{label}:{}-{}", was.frame_label(0), was.frame_label(3));
        let ran = lab.run(&[input, "-o", &output, "--missing", &first]).with_code(3);
        assert!(
            ran.sentences().contains("4 samples that are stated missing or dropped stay open, and the file still holds"),
            "{}",
            ran.out
        );
        assert_eq!(lab.read(&output), lab.read(input));
    }
    // a new file has them as gaps
    let first = format!("{label}:{}", was.frame_label(0));
    lab.run(&["convert", "walk-truth.c3d", "-o", "new.c3d", "--missing", &first]).with_code(0);
    assert_eq!(lab.take("new.c3d").origin(0, column(&was, "LKNE")), Origin::Missing);
}

#[test]
fn what_is_stated_goes_into_the_file() {
    let lab = Lab::new();
    lab.write("plain.csv", "A-x,A-y,A-z\n1000,2000,3000\n1001,2001,3001\n1002,2002,3002\n");
    lab.run(&["convert", "plain.csv", "-o", "timed.csv", "--rate", "50", "--from-units", "mm"]).with_code(0);
    let take = lab.take("timed.csv");
    assert_eq!((take.rate_hz, take.unit), (50.0, Unit::Millimetre));
    lab.run(&["convert", "timed.csv", "-o", "same.csv", "--rate", "50"]).with_code(0);
    assert_eq!(lab.read("same.csv"), lab.read("timed.csv"));
    lab.run(&["convert", "timed.csv", "-o", "slow.csv", "--rate", "25"]).with_code(0);
    assert_eq!(lab.take("slow.csv").rate_hz, 25.0);
    // one frame has no rate in a table
    lab.write("one.csv", "A-x (mm),A-y (mm),A-z (mm)\n1000,2000,3000\n");
    let ran = lab.run(&["convert", "one.csv", "-o", "metres.csv", "--rate", "50", "--units", "m"]).with_code(3);
    assert!(ran.out.contains("csv cannot hold the frame rate (50 Hz) of fewer than two frames"), "{}", ran.out);
}

#[test]
fn names_that_lie_are_refused() {
    let lab = Lab::new();
    let ran = lab.run(&["convert", "walk-gaps.csv", "-o", "x.c3d", "--to", "csv"]);
    assert_eq!((ran.code, ran.err.as_str()), (1, "mocap-repair: x.c3d: is named like c3d, but --to asks for csv; name it .csv\n"));
    lab.run(&["convert", "walk-gaps.csv", "-o", "x.csv", "--to", "nexus"]).with_code(0);
    assert!(lab.text("x.csv").starts_with("Trajectories\r\n"));
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("nowhere", lab.path("link.csv")).unwrap();
        let ran = lab.run(&["convert", "walk-gaps.c3d", "-o", "link.csv"]);
        assert!(ran.code == 1 && ran.err.contains("link.csv: exists already"), "{}", ran.err);
    }
}

#[test]
fn a_compressed_take_is_replaced_by_a_compressed_one() {
    let lab = Lab::new();
    lab.run(&["convert", "walk-gaps.c3d", "-o", "walk.c3d.zst"]).with_code(0);
    lab.write("plain-name.c3d", lab.read("walk.c3d.zst"));
    lab.run(&["plain-name.c3d", "--in-place", "--no-log", "--method", "spline"]);
    assert!(lab.read("plain-name.c3d").starts_with(&[0x28, 0xb5, 0x2f, 0xfd]));
    assert_eq!(lab.read("plain-name.c3d.orig"), lab.read("walk.c3d.zst"));
}

/// A table, and so everything that is said about a fill, has what the file has, even where a skeleton did not let the joint go where it was put.
#[test]
fn fills_are_as_written() {
    let lab = Lab::empty();
    let skeleton = "HIERARCHY\nROOT Hips\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n \
         JOINT Knee\n {\n  OFFSET 0 -40 0\n  CHANNELS 3 Zrotation Xrotation Yrotation\n  JOINT Foot\n  {\n   OFFSET 0 -38 0\n   \
         CHANNELS 3 Zrotation Xrotation Yrotation\n   End Site\n   {\n    OFFSET 0 -2 10\n   }\n  }\n }\n}\nMOTION\nFrames: 60\n\
         Frame Time: 0.01\n";
    let mut rows = String::new();
    for t in (0..60).map(|f| f64::from(f) * 0.1) {
        let (hip, knee) = (20.0 * t.sin(), 15.0 * t.cos());
        let _ = writeln!(rows, "{t:.4} 80.0000 0.0000 0.0000 {hip:.4} 0.0000 0.0000 {knee:.4} 0.0000 0.0000 0.0000 0.0000");
    }
    lab.write("leg.bvh", format!("{skeleton}{rows}"));
    let arguments =
        ["leg.bvh", "-o", "out.bvh", "--missing", "Foot:21-30", "--units", "cm", "--method", "linear", "--fills", "fills.csv", "--no-log"];
    let ran = lab.run(&arguments);
    assert!(matches!(ran.code, 0 | 3), "{}", ran.err);
    let open = |name: &str| {
        let stated = Stated { unit: Some(Unit::Centimetre), ..Stated::default() };
        formats::bvh::Bvh.open(lab.read(name), &stated, &Notes::new()).unwrap().take().clone()
    };
    let (written, foot) = (open("out.bvh"), column(&open("leg.bvh"), "Foot"));
    let table = lab.text("fills.csv");
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 10, "{table}");
    for row in rows {
        let frame: usize = row[0].parse().unwrap();
        let place = written.position_mm(frame, foot).unwrap();
        for k in 0..3 {
            let told: f64 = row[3 + k].parse().unwrap();
            assert!((told - place[k]).abs() < 1e-3, "{row:?} {place:?}");
        }
    }
}
