#![allow(clippy::unwrap_used, clippy::indexing_slicing)]
use super::*;
use crate::{Marker, Samples};

/// An arm: two rigid bones, a hand with two fingers, and a leg that has nothing to do with it.
const ARM: &str = "HIERARCHY
ROOT Hips
{
\tOFFSET 0 0 0
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\tJOINT Shoulder
\t{
\t\tOFFSET 20 50 0
\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\tJOINT Elbow
\t\t{
\t\t\tOFFSET 30 0 0
\t\t\tCHANNELS 3 Yrotation Zrotation Xrotation
\t\t\tJOINT Wrist
\t\t\t{
\t\t\t\tOFFSET 25 0 0
\t\t\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\t\t\tJOINT Thumb
\t\t\t\t{
\t\t\t\t\tOFFSET 5 0 4
\t\t\t\t}
\t\t\t\tEnd Site
\t\t\t\t{
\t\t\t\t\tOFFSET 10 0 0
\t\t\t\t}
\t\t\t}
\t\t}
\t}
\tJOINT Knee
\t{
\t\tOFFSET 10 -45 0
\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\tEnd Site
\t\t{
\t\t\tOFFSET 0 -40 0
\t\t}
\t}
}
MOTION
Frames: 3
Frame Time: .0083333
";

fn row(elbow: f64) -> String {
    format!(
        "1.000000 92.000000 3.000000 5.000000 -4.000000 10.000000 20.000000 15.000000 -30.000000 {elbow:.6} 40.000000 12.000000 \
         3.000000 -8.000000 2.000000 1.000000 2.000000 3.000000\n"
    )
}

fn arm() -> String {
    format!("{ARM}{}{}{}", row(20.0), row(25.0), row(30.0))
}

fn opened(text: &str, stated: &Stated) -> (Result<Box<dyn Document>, FormatError>, Vec<String>) {
    let notes = Notes::new();
    let document = Bvh.open(text.as_bytes().to_vec(), stated, &notes);
    (document, notes.take().iter().map(ToString::to_string).collect())
}

fn take_of(text: &str) -> Take {
    opened(text, &Stated::default()).0.unwrap().take().clone()
}

fn error_of(text: &str) -> String {
    opened(text, &Stated::default()).0.err().map(|e| e.to_string()).unwrap_or_default()
}

fn column(take: &Take, label: &str) -> usize {
    take.markers.iter().position(|m| m.label == label).unwrap_or_else(|| panic!("{label}"))
}

fn at(take: &Take, frame: usize, label: &str) -> [f64; 3] {
    take.position_mm(frame, column(take, label)).unwrap()
}

fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    kinematics::length(kinematics::apart(a, b))
}

/// What a save of `text` makes of it when samples go where `fill` says.
fn filled(text: &str, fill: &[(usize, &str, [f64; 3])]) -> (String, Take, Vec<Note>, Leeway) {
    let truth = take_of(text);
    let missing: Samples = fill.iter().map(|(frame, label, _)| (*frame, column(&truth, label))).collect();
    let document = opened(text, &Stated { missing, ..Stated::default() }).0.unwrap();
    let mut repaired = document.take().clone();
    for (frame, label, position) in fill {
        assert!(repaired.fill(*frame, column(&truth, label), *position), "{label}");
    }
    let (mut out, notes) = (Vec::new(), Notes::new());
    document.save(&repaired, &mut out, &notes).unwrap();
    let leeway = document.leeway(&notes.take());
    let out = String::from_utf8(out).unwrap();
    let back = take_of(&out);
    // known samples: bit for bit in other frames, within the leeway in these
    for frame in 0..back.frames() {
        let touched = fill.iter().any(|(f, ..)| *f == frame);
        for marker in 0..back.markers.len() {
            let (is, was) = (back.position_mm(frame, marker).unwrap(), repaired.position_mm(frame, marker).unwrap());
            if !touched {
                assert_eq!(is, was);
            } else if repaired.origin(frame, marker) == Origin::Repaired {
                assert!(apart(is, was) <= leeway.filled_mm, "{} mm, {:?}", apart(is, was), leeway);
            } else {
                assert!(apart(is, was) <= leeway.known_mm, "{}: {} mm", back.display_label(marker), apart(is, was));
            }
        }
    }
    (out, back, notes.take(), leeway)
}

/// `point`, turned about the line from `a` to `b`.
fn swivel(point: [f64; 3], a: [f64; 3], b: [f64; 3], degrees: f64) -> [f64; 3] {
    let (s, c) = degrees.to_radians().sin_cos();
    let along = kinematics::apart(b, a);
    let u = along.map(|x| x / kinematics::length(along));
    let v = kinematics::apart(point, a);
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let dot = u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    std::array::from_fn(|k| a[k] + v[k] * c + cross[k] * s + u[k] * dot * (1.0 - c))
}

#[test]
fn joints_and_end_sites_are_markers() {
    let take = take_of(&arm());
    let labels: Vec<&str> = take.markers.iter().map(|m| m.label.as_str()).collect();
    assert_eq!(labels, ["Hips", "Shoulder", "Elbow", "Wrist", "Thumb", "Wrist_end", "Knee", "Knee_end"]);
    assert_eq!((take.frames(), take.rate_hz, take.first_frame, take.unit, take.up), (3, 120.0, 1, Unit::Centimetre, None));
    assert_eq!(at(&take, 1, "Hips"), [10.0, 920.0, 30.0]);
    assert!((apart(at(&take, 2, "Elbow"), at(&take, 2, "Wrist")) - 250.0).abs() < 1e-9);
}

#[test]
fn an_elbow_that_swivels_is_realised_and_nothing_else_moves() {
    let text = arm();
    let take = take_of(&text);
    let elbow = swivel(at(&take, 1, "Elbow"), at(&take, 1, "Shoulder"), at(&take, 1, "Wrist"), 35.0);
    let (out, back, notes, leeway) = filled(&text, &[(1, "Elbow", elbow)]);
    assert!(apart(at(&back, 1, "Elbow"), elbow) <= leeway.known_mm && notes.is_empty(), "{notes:?}");
    assert!(leeway.known_mm < 0.01, "{leeway:?}");
    // only the nine angles of shoulder, elbow and wrist changed, and their spelling is that of the file
    let (was, is): (Vec<&str>, Vec<&str>) = (text.split_whitespace().collect(), out.split_whitespace().collect());
    let changed: Vec<&str> = was.iter().zip(&is).filter(|(a, b)| a != b).map(|(_, b)| *b).collect();
    assert!(was.len() == is.len() && changed.len() <= 9, "{changed:?}");
    assert!(changed.iter().all(|n| n.split('.').nth(1).is_some_and(|d| d.len() == 6)), "{changed:?}");
    assert_eq!(text.lines().count(), out.lines().count());
}

#[test]
fn a_limb_that_is_missing_as_a_whole_is_realised() {
    let text = arm();
    let other = take_of(&text.replace("20.000000 15.000000 -30.000000", "-50.000000 45.000000 70.000000"));
    let fill: Vec<(usize, &str, [f64; 3])> = (0..3)
        .flat_map(|f| ["Elbow", "Wrist", "Thumb", "Wrist_end"].map(|label| (f, label, [0.0; 3])))
        .map(|(f, label, _)| (f, label, at(&other, f, label)))
        .collect();
    let (_, back, notes, leeway) = filled(&text, &fill);
    for (frame, label, position) in fill {
        assert!(apart(at(&back, frame, label), position) <= leeway.known_mm, "{label}: {notes:?}");
    }
    assert!(notes.is_empty());
}

#[test]
fn a_root_that_is_filled_moves_without_the_others_as_far_as_bones_allow() {
    let text = arm();
    let hips = at(&take_of(&text), 1, "Hips");
    let (_, _, notes, _) = filled(&text, &[(1, "Hips", [hips[0] + 30.0, hips[1], hips[2]])]);
    assert!(notes.iter().any(|n| matches!(n, Note::NotRealised { samples: 1, worst_mm } if *worst_mm > 5.0)), "{notes:?}");
    assert!(notes.iter().all(Note::matters));
}

#[test]
fn what_bones_forbid_is_noted() {
    let text = arm();
    let elbow = at(&take_of(&text), 1, "Elbow");
    let (_, _, notes, _) = filled(&text, &[(1, "Elbow", [elbow[0], elbow[1] + 2.0, elbow[2]])]);
    assert!(notes.iter().any(|n| matches!(n, Note::NotRealised { samples: 1, worst_mm } if *worst_mm < 2.1)), "{notes:?}");
    assert!(!notes.iter().any(Note::matters), "2 mm are no reason to stop a batch");
}

#[test]
fn points_of_a_cloud_go_where_they_are_filled() {
    let mut builder = TakeBuilder::new(["A", "B", "C"].map(Marker::new).to_vec(), 4, 59.94).unit(Unit::Metre);
    for frame in 0..4 {
        for marker in 0..3 {
            builder.set(frame, marker, [frame as f64 * 10.0, 100.5, marker as f64 * 300.0], Origin::Measured);
        }
    }
    let (take, mut bytes) = (builder.build(), Vec::new());
    Bvh.create(&take, &mut bytes, &Notes::new()).unwrap();
    let text = String::from_utf8(bytes).unwrap();
    let (document, notes) = opened(&text, &Stated::default());
    let back = document.unwrap().take().clone();
    assert_eq!((back.unit, back.rate_hz, back.markers.len(), notes.len()), (Unit::Metre, 59.94, 3, 0));
    let (out, back, notes, _) = filled(&text, &[(2, "B", [1.0, 2.0, 3.0])]);
    assert!(apart(at(&back, 2, "B"), [1.0, 2.0, 3.0]) < 1e-6 && notes.is_empty(), "{:?} {notes:?}", at(&back, 2, "B"));
    assert_eq!(text.split_whitespace().zip(out.split_whitespace()).filter(|(a, b)| a != b).count(), 3);
}

#[test]
fn missing_samples_stand_where_their_marker_was_seen() {
    let mut builder = TakeBuilder::new(["left knee", "left knee", ""].map(Marker::new).to_vec(), 6, 100.0).first_frame(7);
    builder.set(1, 0, [1.0, 2.0, 3.0], Origin::Measured);
    builder.set(4, 0, [4.0, 5.0, 6.0], Origin::Derived);
    builder.set(0, 1, [7.0; 3], Origin::Measured);
    let (notes, mut bytes) = (Notes::new(), Vec::new());
    Bvh.create(&builder.build(), &mut bytes, &notes).unwrap();
    let take = take_of(std::str::from_utf8(&bytes).unwrap());
    let labels: Vec<&str> = take.markers.iter().map(|m| m.label.as_str()).collect();
    assert_eq!(labels, ["left_knee", "left_knee_2", "marker_3"]);
    let x: Vec<f64> = (0..6).map(|f| take.position_mm(f, 0).unwrap()[0]).collect();
    assert_eq!(x, [1.0, 1.0, 1.0, 4.0, 4.0, 4.0]);
    assert_eq!(take.position_mm(3, 2), Some([0.0; 3]));
    let said: Vec<String> = notes.take().iter().map(ToString::to_string).collect();
    for what in ["9 samples are missing", "1 markers were never seen", "3 labels", "first frame (7)", "1 samples were filled"] {
        assert!(said.iter().any(|s| s.contains(what)), "{what}: {said:#?}");
    }
    assert!(!said.iter().any(|s| s.contains("unit")), "the name of the root says it");
}

#[test]
fn what_position_channels_mean_is_seen_from_bones() {
    let file = |row: &str| {
        format!(
            "HIERARCHY ROOT A {{ OFFSET 1 2 3 CHANNELS 3 Xposition Yposition Zposition JOINT B {{ OFFSET 0 10 0 \n\
             CHANNELS 6 Xposition Yposition Zposition Xrotation Yrotation Zrotation }} }} MOTION Frames: 1 Frame Time: 0.01\n{row}\n"
        )
    };
    for (row, b) in [("5 5 5 0 10 0 0 0 0", 17.0), ("5 5 5 0 0 0 0 0 0", 17.0), ("5 5 5 6 17.1 8 0 0 0", 17.1)] {
        let take = take_of(&file(row));
        assert_eq!(at(&take, 0, "A"), [60.0, 70.0, 80.0]);
        assert_eq!(at(&take, 0, "B"), [60.0, b * 10.0, 80.0], "{row}");
    }
}

#[test]
fn units_by_size() {
    for (offset, unit) in [("1.7", Unit::Metre), ("170", Unit::Centimetre), ("1700", Unit::Millimetre)] {
        let text = format!(
            "HIERARCHY\nROOT A\n{{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\nEnd Site\n{{\nOFFSET 0 {offset} 0\n}}\n}}\nMOTION\nFrames: 1\nFrame Time: 0.01\n0\n"
        );
        let (document, notes) = opened(&text, &Stated::default());
        assert_eq!((document.unwrap().take().unit, notes.len()), (unit, 1));
    }
}

#[test]
fn hostile_depth_and_width_are_no_trouble() {
    let deep = 20_000;
    let mut text = String::from("HIERARCHY ROOT r { OFFSET 0 0 0 CHANNELS 1 Xrotation ");
    for _ in 0..deep {
        text.push_str("End Site { OFFSET 0 1 0 ");
    }
    text.push_str(&"}".repeat(deep + 1));
    text.push_str("MOTION\nFrames: 1\nFrame Time: 0.1\n1\n");
    assert_eq!(take_of(&text).markers.len(), deep + 1);
    // many joints, few values
    text.push_str(&"0\n".repeat(2000));
    assert!(error_of(&text).contains("too many joints have no values of their own"), "{}", error_of(&text));
}

#[test]
fn rows_of_another_length_are_errors() {
    let text = arm();
    let cut = text.trim_end().rsplit_once(' ').unwrap().0;
    let line = ARM.lines().count();
    assert_eq!(
        error_of(cut),
        format!(
            "bvh: the row has 17 values, the joints have 18 channels; nothing was skipped, complete or delete this row (line {})",
            line + 3
        )
    );
    let long = format!("{} 7\n", text.trim_end());
    assert!(error_of(&long).starts_with("bvh: the row has 19 values"), "{}", error_of(&long));
    let merged = text.replace("Frame Time: .0083333\n", "Frame Time: .0083333\n<<<<<<< HEAD\n");
    let expected = format!("bvh: \"<<<<<<<\" found, expected a number for each of 18 channels (line {}, column 1)", line + 1);
    assert_eq!(error_of(&merged), expected);
}
