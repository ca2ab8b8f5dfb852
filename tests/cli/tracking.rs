//! `track`: a body of two boxes with a hinge between them, and what becomes of its clouds.

use crate::lab::Lab;
use formats::rig::{Joint, JointKind, Limit, Mesh, Skeleton, write_limits, write_mesh, write_parts, write_skeleton};
use mocap_repair::log::schema::{EmRound, TrackedFrame, foxglove::PointCloud};
use prost::Message;
use std::fmt::Write as _;

type Point = [f64; 3];

/// Frames of the sequence; their numbers begin at 3.
const FRAMES: usize = 12;
const FIRST: usize = 3;
/// Where the arm hangs on the trunk.
const SHOULDER: Point = [15.0, 150.0, 0.0];

const TRACK: [&str; 8] = ["track", "cloud_%02d.off", "--skl", "body.skl", "--off", "body.off", "--vj", "body.vj"];

/// Points on the surface of a box and their normals.
fn surface(from: Point, to: Point, points: &mut Vec<Point>, normals: &mut Vec<Point>) {
    for axis in 0..3 {
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let steps = |k: usize| ((to[k] - from[k]) / 4.0).ceil() as usize;
        for (side, sign) in [(from, -1.0), (to, 1.0)] {
            for i in 0..steps(a) {
                for j in 0..steps(b) {
                    let mut point = side;
                    let mut normal = [0.0; 3];
                    point[a] = from[a] + (to[a] - from[a]) * (i as f64 + 0.5) / steps(a) as f64;
                    point[b] = from[b] + (to[b] - from[b]) * (j as f64 + 0.5) / steps(b) as f64;
                    normal[axis] = sign;
                    points.push(point);
                    normals.push(normal);
                }
            }
        }
    }
}

fn skeleton() -> Skeleton {
    let joint = |name: &str, kind, parent, centre| Joint { name: name.to_owned(), kind, parent, centre, state: [0.0; 3] };
    Skeleton {
        joints: vec![
            joint("root", JointKind::Translate, None, [0.0, 90.0, 0.0]),
            joint("trunk", JointKind::Ball, Some(0), [0.0, 90.0, 0.0]),
            joint("arm", JointKind::Revolute { axis: [0.0, 0.0, 1.0] }, Some(1), SHOULDER),
        ],
    }
}

/// The surface, and which joint moves which vertex.
fn body() -> (Mesh, Vec<usize>) {
    let mut mesh = Mesh::default();
    surface([-15.0, 0.0, -10.0], [15.0, 170.0, 10.0], &mut mesh.vertices, &mut mesh.normals);
    let trunk = mesh.vertices.len();
    surface([17.0, 144.0, -6.0], [77.0, 156.0, 6.0], &mut mesh.vertices, &mut mesh.normals);
    let parts = (0..mesh.vertices.len()).map(|vertex| if vertex < trunk { 1 } else { 2 }).collect();
    (mesh, parts)
}

fn shift(frame: usize) -> Point {
    let t = frame as f64;
    [1.5 * t, 0.2 * t, -0.5 * t]
}

/// Where the arm, bent as in a frame, has a point; as a direction if `turned_only`.
fn bent(point: Point, frame: usize, turned_only: bool) -> Point {
    let (sin, cos) = (0.06 * frame as f64).sin_cos();
    let [cx, cy, _] = if turned_only { [0.0; 3] } else { SHOULDER };
    let (x, y) = (point[0] - cx, point[1] - cy);
    [cos * x - sin * y + cx, sin * x + cos * y + cy, point[2]]
}

fn moved(point: Point, frame: usize) -> Point {
    let by = shift(frame);
    std::array::from_fn(|k| point[k] + by[k])
}

/// The cloud of a frame: every vertex where it is by then.
fn cloud(frame: usize) -> Mesh {
    let (mut mesh, parts) = body();
    for ((point, normal), part) in mesh.vertices.iter_mut().zip(&mut mesh.normals).zip(parts) {
        if part == 2 {
            *point = bent(*point, frame, false);
            *normal = bent(*normal, frame, true);
        }
        *point = moved(*point, frame);
    }
    mesh
}

fn name(frame: usize) -> String {
    format!("cloud_{:02}.off", frame + FIRST)
}

fn written(write: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes);
    bytes
}

fn scaled(mut mesh: Mesh, factor: f64) -> Mesh {
    mesh.vertices.iter_mut().flatten().for_each(|x| *x *= factor);
    mesh
}

/// A folder with the body and its clouds, whose lengths are multiplied by `factor`.
fn lab_in(factor: f64) -> Lab {
    let lab = Lab::empty();
    let (mesh, parts) = body();
    let mut skeleton = skeleton();
    lab.write("body.vj", written(|out| write_parts(&parts, &skeleton, out).unwrap()));
    let limits = [None, None, Some(Limit::Revolute { least: -2.0, most: 2.0 })];
    lab.write("body.cst", written(|out| write_limits(&limits, &skeleton, out).unwrap()));
    skeleton.scale(factor);
    lab.write("body.skl", written(|out| write_skeleton(&skeleton, out).unwrap()));
    lab.write("body.off", written(|out| write_mesh(&scaled(mesh, factor), out).unwrap()));
    for frame in 0..FRAMES {
        lab.write(&name(frame), written(|out| write_mesh(&scaled(cloud(frame), factor), out).unwrap()));
    }
    lab
}

fn lab() -> Lab {
    lab_in(1.0)
}

fn run(lab: &Lab, more: &[&str]) -> crate::lab::Ran {
    lab.run(&[&TRACK[..], &["-o", "out.bvh"], more].concat())
}

/// The farthest that a joint of the BVH file is from the truth in the frames that are asked for, cm.
fn worst_cm(lab: &Lab, frames: impl Iterator<Item = usize>) -> f64 {
    let take = lab.take("out.bvh");
    assert_eq!(take.frames(), FRAMES);
    let mut worst = 0.0_f64;
    for frame in frames {
        for (joint, centre) in [("trunk", [0.0, 90.0, 0.0]), ("arm", SHOULDER)] {
            let is = take.position_mm(frame, crate::lab::column(&take, joint)).unwrap();
            let was = moved(centre, frame);
            worst = worst.max((0..3).map(|k| (is[k] / 10.0 - was[k]).abs()).fold(0.0, f64::max));
        }
    }
    worst
}

/// The messages of a topic with their times in ns.
pub fn messages<M: Message + Default>(log: &[u8], topic: &str) -> Vec<(u64, M)> {
    let all = mcap::MessageStream::new(log).unwrap().map(Result::unwrap);
    let of_topic = all.filter(|message| message.channel.topic == topic);
    of_topic.map(|message| (message.log_time, M::decode(&message.data[..]).unwrap())).collect()
}

#[test]
fn a_body_is_followed() {
    let lab = lab();
    let before = lab.listing();
    let ran = run(&lab, &["--cst", "body.cst", "--cst-unit", "rad"]).with_code(0);
    assert_eq!(lab.new_since(&before), ["out.bvh", "out.frames.csv", "out.mcap"]);
    assert!(ran.out.starts_with("cloud_%02d.off -> out.bvh\n"), "{}", ran.out);
    assert!(ran.out.contains("12 frames at 30 Hz (0.4 s), in cm") && ran.out.contains("12 frames by planes"), "{}", ran.out);
    let worst = worst_cm(&lab, 0..FRAMES);
    assert!(worst < 0.2, "{worst} cm");
    let bvh = lab.text("out.bvh");
    assert!(bvh.contains("ROOT trunk") && bvh.contains("JOINT arm") && bvh.contains("End Site"), "{bvh}");
    // the hinge turns about an axis of the file, so it needs one channel, and its angle is the truth's
    let last: f64 = bvh.trim_end().rsplit(' ').next().unwrap().parse().unwrap();
    assert!((last - (0.06 * (FRAMES - 1) as f64).to_degrees()).abs() < 0.3, "{last}");
}

#[test]
fn every_frame_has_a_row() {
    let lab = lab();
    run(&lab, &["--csv", "table.csv", "--no-log", "--first", "5", "--last", "9"]).with_code(0);
    let text = lab.text("table.csv");
    let mut lines = text.lines();
    assert_eq!(
        lines.next().unwrap(),
        "frame,way,points,rounds,log_likelihood,sigma_cm,inliers,residual_cm,\
         trunk:coverage,trunk:residual_cm,trunk:lost,arm:coverage,arm:residual_cm,arm:lost"
    );
    let points = body().0.vertices.len();
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 5);
    for (row, frame) in rows.iter().zip(5..) {
        assert_eq!(row[..3], [&frame.to_string(), "tracked", &points.to_string()]);
        let number = |column: usize| row[column].parse::<f64>().unwrap();
        assert!((1.0..=8.0).contains(&number(3)) && number(5) < 4.0, "{row:?}");
        assert!(number(6) > 0.5 && number(8) > 0.95 && row[10] == "0", "{row:?}");
    }
}

#[test]
fn the_log_tells_every_round_and_frame() {
    let lab = lab();
    run(&lab, &["--fps", "50", "--rounds", "5"]).with_code(0);
    let log = lab.read("out.mcap");
    let frames = messages::<TrackedFrame>(&log, "/track/frames");
    assert_eq!(frames.iter().map(|(time, _)| *time).collect::<Vec<_>>(), (0..12).map(|k| 20_000_000 * k).collect::<Vec<u64>>());
    let rounds = messages::<EmRound>(&log, "/em/rounds");
    let mut told = rounds.iter();
    for (at, (_, frame)) in frames.iter().enumerate() {
        assert!((1..=5).contains(&frame.rounds), "{frame:?}");
        for number in 0..frame.rounds {
            let (time, round) = told.next().unwrap();
            let share = f64::from(number) / f64::from(frame.rounds);
            assert_eq!(*time, ((at as f64 + share) * 2e7).round() as u64, "rounds share the 20 ms of a frame");
            assert_eq!((round.frame as usize, round.round), (FIRST + at, number));
            let labels: Vec<&str> = round.parts.iter().map(|part| part.label.as_str()).collect();
            assert_eq!(labels, ["trunk", "arm"], "the root moves no vertex");
        }
    }
    assert!(told.next().is_none());
    assert!(frames.iter().all(|(_, frame)| frame.lost_count == 0 && frame.parts.iter().all(|part| part.coverage > 0.9)));
    let points = body().0.vertices.len();
    for topic in ["/cloud", "/model"] {
        let clouds = messages::<PointCloud>(&log, topic);
        assert_eq!(clouds.len(), FRAMES);
        assert!(clouds.iter().all(|(_, cloud)| cloud.data.len() == points * cloud.point_stride as usize), "{topic}");
    }
    let metadata = lab.log_metadata("out.mcap");
    for (key, value) in [("command", "track"), ("ended", "done"), ("option.rounds", "5"), ("first_frame", "3"), ("up", "+y (guessed)")] {
        assert_eq!(metadata.get(key).map(String::as_str), Some(value), "{key}");
    }
    assert!(metadata.contains_key("skeleton_sha256") && metadata.contains_key("result.residual_cm"));
    lab.run(&["layout", "out.mcap", "-o", "layout.json"]).with_code(0);
    let layout: serde_json::Value = serde_json::from_str(&lab.text("layout.json")).unwrap();
    assert!(layout["configById"]["3D!body"]["topics"]["/model"]["visible"].as_bool().unwrap());
    // fewer in space
    run(&lab, &["--fps", "50", "--log-rate", "10", "--force"]).with_code(0);
    assert_eq!(messages::<PointCloud>(&lab.read("out.mcap"), "/model").len(), 3);
}

#[test]
fn the_report_shows_what_became_of_the_frames() {
    let lab = lab();
    std::fs::remove_file(lab.path(&name(7))).unwrap();
    let before = lab.listing();
    let ran = run(&lab, &["--no-log", "--report", "out.html"]).with_code(3);
    assert_eq!(lab.new_since(&before), ["out.bvh", "out.frames.csv", "out.html"]);
    assert!(ran.out.contains("out.html"), "{}", ran.out);
    let html = lab.text("out.html");
    assert!(html.starts_with("<!doctype html>") && !html.contains("src=\"") && !html.contains("href=\"http"));
    let page = lab.page("out.html");
    assert_eq!(page["source_name"], "cloud_%02d.off");
    let take = &page["take"];
    assert_eq!((&take["frames"], &take["first_frame"], &take["rate_hz"]), (&FRAMES.into(), &FIRST.into(), &30.0.into()));
    assert_eq!(take["markers"], serde_json::json!(["root", "trunk", "arm", "arm end"]));
    let bones: Vec<&str> = take["bones"].as_array().unwrap().iter().map(|bone| bone["label"].as_str().unwrap()).collect();
    assert_eq!(bones, ["trunk-arm", "arm-arm end"], "root and trunk are in one place");
    let followed = &page["followed"];
    let event = serde_json::json!({ "start": 7, "frames": 1, "kind": "predicted", "marker": null, "about": "no file" });
    assert_eq!(followed["events"], serde_json::json!([event]));
    assert_eq!((&followed["tiles"][0]["value"], &followed["tiles"][1]["value"]), (&"11".into(), &"1".into()));
    // the curves are those of the table
    let table = lab.text("out.frames.csv");
    for (curve, column) in [(0, 4), (1, 5), (2, 6), (3, 7)] {
        let values = followed["curves"][curve]["values"].as_array().unwrap();
        assert_eq!(values.len(), FRAMES);
        for (value, row) in values.iter().zip(table.lines().skip(1)) {
            let told = row.split(',').nth(column).unwrap();
            assert_eq!(value.is_null(), told.is_empty(), "{row}");
            assert!(value.is_null() || (value.as_f64().unwrap() - told.parse::<f64>().unwrap()).abs() < 0.051, "{value}: {row}");
        }
    }
    // parts and rounds are those of the table, too
    let by_part = &followed["by_part"];
    assert_eq!(by_part["markers"], serde_json::json!([1, 2]), "the root moves no vertex");
    for (at, row) in table.lines().skip(1).enumerate() {
        let cells: Vec<&str> = row.split(',').collect();
        let rounds = by_part["rounds"][at].as_array().unwrap();
        assert_eq!(rounds.len().to_string(), cells[3], "{row}");
        if let Some(last) = rounds.last() {
            assert!((last[1].as_f64().unwrap() - cells[5].parse::<f64>().unwrap()).abs() < 6e-4, "{last}: {row}");
        }
        for part in 0..2 {
            for (values, column, unit, step) in [("coverage", 8 + 3 * part, 100.0, 0.51), ("residual_cm", 9 + 3 * part, 1.0, 0.0051)] {
                let value = &by_part[values][part][at];
                assert_eq!(value.is_null(), cells[column].is_empty(), "{row}");
                let told = cells[column].parse::<f64>().unwrap_or_default();
                assert!((value.as_f64().unwrap_or_default() - unit * told).abs() < step, "{value}: {row}");
            }
        }
    }
    let streams: Vec<&str> = page["streams"].as_array().unwrap().iter().map(|stream| stream["name"].as_str().unwrap()).collect();
    assert!(streams.contains(&"cloud"), "{streams:?}");
    let ran = run(&lab, &["--json", "--report", "out.html", "--force"]).with_code(3);
    assert_eq!(ran.messages().last().unwrap()["report"].as_str().map(|name| name.ends_with("out.html")), Some(true));
}

#[test]
fn equal_sequences_give_equal_bytes() {
    let files = [lab(), lab()].map(|lab| {
        run(&lab, &["--report", "out.html"]).with_code(0);
        ["out.bvh", "out.frames.csv", "out.mcap", "out.html"].map(|name| lab.read(name))
    });
    assert!(files[0] == files[1]);
}

#[test]
fn frames_without_points_are_predicted_and_told() {
    let lab = lab();
    lab.write(&name(4), "NOFF\n0 0 0\n");
    std::fs::remove_file(lab.path(&name(7))).unwrap();
    let ran = run(&lab, &[]).with_code(3);
    let told = ran.sentences();
    assert!(told.contains("1 frame without a file: 10") && told.contains("1 frame without points: 7"), "{told}");
    assert!(told.contains("10 frames by planes"), "{told}");
    assert!(worst_cm(&lab, 0..FRAMES) < 1.0);
    let table = lab.text("out.frames.csv");
    let row = table.lines().find(|line| line.starts_with("10,")).unwrap();
    assert_eq!(row, "10,predicted,0,0,,,,,,,0,,,0");
    let log = lab.read("out.mcap");
    let notes = messages::<mocap_repair::log::schema::foxglove::Log>(&log, "/log");
    let told: Vec<(u64, &str)> = notes.iter().map(|(time, note)| (*time, note.message.as_str())).collect();
    assert_eq!(
        told,
        [
            (0, "a body of 3 joints is followed through 12 frames by planes"),
            (133_333_333, "the cloud has no points, the pose is predicted"),
            (233_333_333, "there is no cloud, the pose is predicted"),
        ]
    );
    let ran = run(&lab, &["--json", "--force"]).with_code(3);
    let messages = ran.messages();
    assert_eq!(messages[0]["message_type"], "predicted");
    let summary = messages.last().unwrap();
    assert_eq!((&summary["message_type"], &summary["frames_predicted"]), (&"tracked".into(), &2.into()), "{summary}");
}

#[test]
fn a_body_in_metres_is_noticed() {
    let lab = lab_in(0.01);
    let ran = run(&lab, &[]).with_code(3);
    assert!(ran.sentences().contains("the body is 1.7 tall, m assumed (say it with --unit)"), "{}", ran.out);
    assert!(worst_cm(&lab, 0..FRAMES) < 0.2);
    run(&lab, &["--unit", "m", "--force"]).with_code(0);
}

#[test]
fn clouds_may_be_compressed_and_need_no_normals() {
    let lab = lab();
    for frame in 0..FRAMES {
        let bare = Mesh { normals: Vec::new(), ..cloud(frame) };
        let text = written(|out| write_mesh(&bare, out).unwrap());
        std::fs::remove_file(lab.path(&name(frame))).unwrap();
        lab.write(&format!("{}.zst", name(frame)), zstd::encode_all(&text[..], 3).unwrap());
    }
    let ran = run(&lab, &["--method", "planes"]).with_code(3);
    assert_eq!(ran.sentences().matches("clouds have no normals").count(), 1, "{}", ran.out);
    assert!(worst_cm(&lab, 0..FRAMES) < 0.3);
}

#[test]
fn normals_need_not_be_announced() {
    let lab = lab();
    for frame in 0..FRAMES {
        lab.write(&name(frame), lab.text(&name(frame)).replacen("NOFF", "OFF", 1));
    }
    let ran = run(&lab, &[]).with_code(0);
    assert_eq!(ran.sentences().matches("clouds: OFF at the beginning says nothing of normals").count(), 1, "{}", ran.out);
    assert!(worst_cm(&lab, 0..FRAMES) < 0.2);
}

#[test]
fn a_dry_run_looks_and_writes_nothing() {
    let lab = lab();
    let before = lab.listing();
    let ran = run(&lab, &["--dry-run"]).with_code(0);
    assert!(ran.out.starts_with("cloud_%02d.off (dry run, nothing was written)\n"), "{}", ran.out);
    let told = ran.sentences();
    assert!(["12 frames by planes", "out.bvh", "out.frames.csv", "out.mcap"].iter().all(|what| told.contains(what)), "{told}");
    assert!(lab.new_since(&before).is_empty());
    std::fs::remove_file(lab.path(&name(7))).unwrap();
    let messages = run(&lab, &["--dry-run", "--json"]).with_code(3).messages();
    assert_eq!((&messages[0]["message_type"], &messages[0]["first_frame"]), (&"predicted".into(), &10.into()), "{messages:?}");
    let summary = messages.last().unwrap();
    assert_eq!((&summary["dry_run"], &summary["output"], &summary["frames"]), (&true.into(), &serde_json::Value::Null, &12.into()));
    // what would fail fails
    lab.write(&name(0), "OFF\n2 0 0\n1 2 3\n1 x 3\n");
    let before = lab.listing();
    let ran = run(&lab, &["--dry-run"]);
    assert!(ran.code == 1 && ran.err.contains("cloud_03.off: off: "), "{ran:?}");
    let ran = lab.run(&[&TRACK[..], &["-o", "nowhere/out.bvh", "--dry-run"]].concat());
    assert!(ran.code == 1 && ran.err.contains("its folder does not exist"), "{ran:?}");
    assert!(lab.new_since(&before).is_empty());
}

#[test]
fn the_log_says_where_its_report_comes_from() {
    let lab = lab();
    run(&lab, &["--last", "5"]).with_code(0);
    let ran = lab.run(&["report", "out.mcap", "-o", "out.html"]);
    let told = ran.err.contains("out.mcap: is the log of mocap-repair track") && ran.err.contains("--report FILE.html");
    assert!(ran.code == 1 && told, "{ran:?}");
}

#[test]
fn what_is_wrong_is_said_and_nothing_is_left() {
    let text = |change: &dyn Fn(&Lab)| {
        let lab = lab();
        change(&lab);
        let before = lab.listing();
        let ran = run(&lab, &[]);
        assert_eq!(ran.code, 1, "{ran:?}");
        assert!(lab.new_since(&before).is_empty());
        ran.err
    };
    let changed = |lab: &Lab, name: &str, from: &str, to: &str| {
        let text = lab.text(name);
        assert!(text.contains(from), "{text}");
        lab.write(name, text.replacen(from, to, 1));
    };
    for (change, said) in [
        (&(|lab: &Lab| lab.write(&name(5), "OFF\n2 0 0\n1 2 3\n1 x 3\n")) as &dyn Fn(&Lab), "cloud_08.off: off: "),
        (&|lab: &Lab| lab.write(&name(5), "OFF\n2 0 0\n1 2 3\n1 x 3\n"), "line 4"),
        (&|lab: &Lab| (0..FRAMES).for_each(|frame| std::fs::remove_file(lab.path(&name(frame))).unwrap()), "no file has such a name"),
        (&|lab: &Lab| changed(lab, "body.vj", "trunk\n", ""), "body.vj: vj: the file ends after"),
        (&|lab: &Lab| changed(lab, "body.vj", "trunk\n", "trunk\ntrunk\n"), "more lines than"),
        (&|lab: &Lab| changed(lab, "body.skl", "150 0 0 0 1", "150 0 0 0 0"), "has no length"),
        (&|lab: &Lab| changed(lab, "body.skl", "trunk ball root", "trunk ball arm"), "body.skl: skl: "),
        (&|lab: &Lab| lab.write("body.off", "OFF\n0 0 0\n"), "has no vertices"),
        (&|lab: &Lab| lab.write("out.bvh", "mine"), "out.bvh: exists already"),
    ] {
        let error = text(change);
        assert!(error.contains(said), "{said}: {error}");
    }
}

#[test]
fn names_are_checked_before_anything_is_done() {
    let lab = lab();
    let before = lab.listing();
    let refused = |arguments: &[&str], code: i32, said: &str| {
        let ran = lab.run(arguments);
        assert!(ran.code == code && ran.err.contains(said), "{said}: {ran:?}");
        assert!(lab.new_since(&before).is_empty());
    };
    let with = |more: &[&'static str]| [&TRACK[..], more].concat();
    refused(&with(&["-o", "out.c3d"]), 1, "motion is written as BVH");
    refused(&with(&["-o", "out.bvh", "--csv", "cloud_04.off", "--force"]), 1, "cloud_04.off: is read as well");
    refused(&with(&["-o", "out.bvh", "--log", "body.skl", "--force"]), 1, "body.skl: is the input itself");
    refused(&with(&["-o", "out.bvh", "--csv", "x", "--log", "x"]), 1, "is named for two different files");
    refused(&with(&["-o", "out.bvh", "--csv", "x", "--report", "x"]), 1, "is named for two different files");
    refused(&with(&["-o", "out.bvh", "--first", "1"]), 1, "there are files from 3 to 14");
    refused(&with(&["-o", "out.bvh", "--first", "5", "--last", "3"]), 2, "--first 5 is behind --last 3");
    refused(&with(&["-o", "out.bvh", "--nthresh", "0.5", "--normal-angle", "60"]), 2, "--normal-angle");
    let mut other = with(&["-o", "out.bvh"]);
    let mut said = String::new();
    for pattern in ["cloud.off", "cloud_%s.off"] {
        other[1] = pattern;
        let ran = lab.run(&other);
        assert_eq!(ran.code, 2, "{ran:?}");
        write!(said, "{}", ran.err).unwrap();
    }
    assert!(said.contains("as in clouds/frame_%03d.off") && said.contains("\"%s\" is no number of a frame"), "{said}");
}

#[cfg(unix)]
#[test]
fn an_interrupt_leaves_a_log_and_no_motion() {
    let lab = lab();
    let bytes = lab.read(&name(0));
    for number in FIRST + FRAMES..900 {
        lab.write(&format!("cloud_{number:02}.off"), &bytes);
    }
    let mut child = lab.command(&[&TRACK[..], &["-o", "out.bvh"]].concat()).spawn().unwrap();
    let begun = std::time::Instant::now();
    while !lab.listing_names().iter().any(|name| name.starts_with(".out.mcap")) {
        assert!(begun.elapsed().as_secs() < 60 && child.try_wait().unwrap().is_none(), "it never began");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    std::thread::sleep(std::time::Duration::from_millis(200));
    let killed = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("interrupted") && error.contains("out.mcap shows how far it came"), "{error}");
    assert!(!lab.path("out.bvh").exists() && !lab.path("out.frames.csv").exists());
    assert_eq!(lab.log_metadata("out.mcap").get("ended").map(String::as_str), Some("interrupted"));
}
