//! What a log tells of every frame, and of the take as a whole.

use super::{METADATA, Told, about, drive, messages, metadata, scripts};
use formats::{Direction, Marker, Origin, Role, Take, TakeBuilder};
use mocap_repair::fills::Filled;
use mocap_repair::log::{About, Closing, Description, Ended, Event, McapLog, Shown, Up, attachment, extract_layout, is_unfinished, schema};
use mocap_repair::solve::Bone;
use schema::marker_states::State;
use std::path::Path;

/// Three markers, two of which have the same label, and a model output between them.
/// `A` is missing from frame 1 and filled, `B` is missing from frame 2 and stays so.
pub(super) fn raw() -> Take {
    let mut angles = Marker::new("LKneeAngles");
    angles.role = Role::ModelOutput;
    let markers = vec![Marker::new("S:A"), angles, Marker::new("S:B"), Marker::new("S:B")];
    let mut take = TakeBuilder::new(markers, 4, 59.94).first_frame(101).up(Some(Direction::PLUS_Y));
    for frame in 0..4 {
        for (marker, x) in [0.0, 7.0, 400.0, 1000.0].into_iter().enumerate() {
            take.set(frame, marker, [x, frame as f64, -250.0], Origin::Measured);
        }
    }
    take.hide(1, 0);
    take.hide(2, 2);
    take.build()
}

pub(super) const FILLED: Filled = Filled { frame: 1, marker: 0, gap: 0, position_mm: [3.0, 1.0, -250.0], sigma_mm: 20.0 };

pub(super) fn repaired() -> Take {
    let mut take = raw();
    assert!(take.fill(FILLED.frame, FILLED.marker, FILLED.position_mm));
    take
}

pub(super) const BONES: [Bone; 2] =
    [Bone { a: 0, b: 2, length_mm: 400.0, spread_mm: 0.5 }, Bone { a: 2, b: 3, length_mm: 600.0, spread_mm: 0.25 }];

/// A log of [`repaired`], by its path.
fn log(folder: &Path, log_rate_hz: Option<f64>) -> Vec<u8> {
    let path = folder.join("walk.mcap");
    let mut log = McapLog::create(&path, About { up: Up::Stated(Direction::PLUS_Y), ..about() }).unwrap();
    drive(&mut log, scripts());
    let (raw, repaired) = (raw(), repaired());
    let shown = Shown { raw: &raw, repaired: Some(&repaired), bones: &BONES, samples: &[FILLED], log_rate_hz };
    let events = vec![
        Event { frame: 2, warning: true, name: "S:B".into(), message: "left open".into() },
        Event { frame: 1, warning: false, name: "S:A".into(), message: "filled".into() },
    ];
    log.finish(&Closing { shown: Some(shown), events, ..Closing::default() }).unwrap();
    std::fs::read(path).unwrap()
}

fn told(log_rate_hz: Option<f64>) -> Told {
    messages(&log(tempfile::tempdir().unwrap().path(), log_rate_hz))
}

/// Nanoseconds of the frames of the take, which are those of iterations, too.
const TIMES: [u64; 4] = [0, 16_683_350, 33_366_700, 50_050_050];

fn times<M>(messages: &[(u64, M)]) -> Vec<u64> {
    messages.iter().map(|(time, _)| *time).collect()
}

#[test]
fn every_frame_has_its_messages_at_its_time() {
    let told = told(None);
    for (topic, times) in [
        ("lengths", times(&told.lengths)),
        ("states", times(&told.states)),
        ("raw", times(&told.raw)),
        ("repaired", times(&told.repaired)),
        ("scenes", times(&told.scenes)),
    ] {
        assert_eq!(times, TIMES, "{topic}");
    }
    for (time, frame) in told.lengths.iter().map(|(t, m)| (*t, m.frame)).chain(told.states.iter().map(|(t, m)| (*t, m.frame))) {
        assert_eq!(TIMES[(frame - 101) as usize], time, "frames have the file's own numbers");
    }
    let stamps: Vec<_> = told.raw.iter().map(|(_, m)| m.timestamp.unwrap().nanos as u64).collect();
    assert_eq!(stamps, TIMES);
}

#[test]
fn what_became_of_every_marker_is_told() {
    let told = told(None);
    let states = |frame: usize| told.states[frame].1.markers.iter().map(|m| (m.label.as_str(), m.value())).collect::<Vec<_>>();
    assert_eq!(states(0), [("S:A", State::Observed), ("S:B", State::Observed), ("S:B (2)", State::Observed)], "no model output");
    assert_eq!(states(1), [("S:A", State::Filled), ("S:B", State::Observed), ("S:B (2)", State::Observed)]);
    assert_eq!(states(2), [("S:A", State::Observed), ("S:B", State::Missing), ("S:B (2)", State::Observed)]);
    let counts: Vec<_> = told.states.iter().map(|(_, m)| (m.filled_count, m.missing_count)).collect();
    assert_eq!(counts, [(0, 0), (1, 0), (0, 1), (0, 0)]);
    let sigma = |frame: usize, marker: usize| told.states[frame].1.markers[marker].sigma_mm;
    assert_eq!((sigma(1, 0), sigma(0, 0)), (20.0, 0.0));
    assert!(sigma(2, 1).is_nan());
}

#[test]
fn bone_lengths_are_those_of_the_repaired_take() {
    let told = told(None);
    let bones = |frame: usize| told.lengths[frame].1.bones.iter().map(|b| (b.value, b.error_mm, b.filled)).collect::<Vec<_>>();
    assert_eq!(bones(0), [(400.0, 0.0, false), (600.0, 0.0, false)]);
    assert_eq!(bones(1), [(397.0, -3.0, true), (600.0, 0.0, false)]);
    assert!(told.lengths[2].1.bones.iter().all(|b| b.value.is_nan() && b.error_mm.is_nan() && !b.filled), "B is missing");
    let labels: Vec<_> = told.lengths[0].1.bones.iter().map(|b| b.label.as_str()).collect();
    assert_eq!(labels, ["A-B", "B-B"]);
}

/// x, y, z in m, colour, state, marker, sigma in mm.
type Point = ([f32; 3], [u8; 4], u8, u16, f32);

fn points(cloud: &schema::foxglove::PointCloud) -> Vec<Point> {
    let offset = |name: &str| cloud.fields.iter().find(|f| f.name == name).unwrap().offset as usize;
    cloud
        .data
        .chunks(cloud.point_stride as usize)
        .map(|p| {
            let float = |name: &str| f32::from_le_bytes(p[offset(name)..][..4].try_into().unwrap());
            let marker = u16::from_le_bytes(p[offset("marker")..][..2].try_into().unwrap());
            let colour = ["red", "green", "blue", "alpha"].map(|c| p[offset(c)]);
            (["x", "y", "z"].map(float), colour, p[offset("state")], marker, float("sigma_mm"))
        })
        .collect()
}

#[test]
fn clouds_hold_what_was_there_and_what_was_made_of_it() {
    let told = told(None);
    let raw: Vec<_> = told.raw.iter().map(|(_, cloud)| points(cloud)).collect();
    let repaired: Vec<_> = told.repaired.iter().map(|(_, cloud)| points(cloud)).collect();
    assert_eq!(raw.iter().map(Vec::len).collect::<Vec<_>>(), [3, 2, 2, 3]);
    assert_eq!(repaired.iter().map(Vec::len).collect::<Vec<_>>(), [3, 3, 2, 3]);
    let plain = |p: &Point| (p.0, p.2, p.3, p.4);
    assert_eq!(plain(&repaired[1][0]), ([0.003, 0.001, -0.25], 1, 0, 20.0));
    assert_eq!(plain(&repaired[1][2]), ([1.0, 0.001, -0.25], 0, 2, 0.0));
    assert_eq!(plain(&raw[2][1]), ([1.0, 0.002, -0.25], 0, 2, 0.0));
    assert!(repaired[1][0].1 != repaired[1][1].1, "filled markers have a colour of their own");
    let cloud = &told.raw[0].1;
    assert_eq!((cloud.frame_id.as_str(), cloud.point_stride % 4), ("lab", 0));
    assert_eq!(cloud.pose.as_ref().unwrap().orientation.as_ref().unwrap().w, 1.0);
    for field in &cloud.fields {
        use schema::foxglove::packed_element_field::NumericType;
        let bytes = match field.r#type() {
            NumericType::Uint8 => 1,
            NumericType::Uint16 => 2,
            NumericType::Float32 => 4,
            other => panic!("{other:?}"),
        };
        assert!(field.offset % bytes == 0 && field.offset + bytes <= cloud.point_stride, "{field:?}");
    }
}

#[test]
fn the_skeleton_has_the_bones_whose_ends_are_known() {
    let told = told(None);
    for (frame, (_, scene)) in told.scenes.iter().enumerate() {
        let ids: Vec<_> = scene.entities.iter().map(|e| e.id.as_str()).collect();
        assert_eq!(ids, ["skeleton", "filled"], "the same entities in every frame, each replacing itself");
        assert!(scene.deletions.is_empty());
        let lines: usize = scene.entities[0].lines.iter().map(|l| l.points.len() / 2).sum();
        assert_eq!(lines, [2, 2, 0, 2][frame]);
        for line in &scene.entities[0].lines {
            let coloured = if frame == 1 { line.points.len() } else { 0 };
            assert_eq!((line.colors.len(), line.color.is_some()), (coloured, frame != 1), "a colour for each point, or one for all");
            assert!(
                line.points.len() % 2 == 0 && line.indices.is_empty(),
                "viewers draw half as many lines as there are points, whatever indices say"
            );
        }
        let filled = &scene.entities[1];
        let number = usize::from(frame == 1);
        assert_eq!((filled.spheres.len(), filled.texts.len(), filled.metadata.len()), (number, number, number));
    }
    let filled = &told.scenes[1].1.entities[1];
    assert_eq!((filled.texts[0].text.as_str(), filled.metadata[0].key.as_str()), ("S:A ±20.0 mm", "S:A"));
    assert_eq!(filled.spheres[0].size.as_ref().unwrap().x, 0.04, "one standard deviation to each side");
}

#[test]
fn a_lower_rate_thins_what_is_drawn_and_nothing_else() {
    let told = told(Some(30.0));
    assert_eq!((told.raw.len(), told.repaired.len(), told.scenes.len()), (2, 2, 2));
    assert_eq!((told.lengths.len(), told.states.len()), (4, 4));
    assert_eq!(times(&told.raw), times(&told.scenes));
    assert_eq!(told.raw[0].0, 0);
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(metadata(&log(folder.path(), Some(30.0)))["log_rate_hz"], "30");
    assert_eq!(super::messages(&log(folder.path(), Some(1000.0))).raw.len(), 4, "more than there are is all of them");
}

#[test]
fn events_are_told_at_their_frames() {
    let told = told(None);
    let own: Vec<_> = told.events.iter().filter(|(_, m)| m.name.starts_with("S:")).collect();
    let seen: Vec<_> = own.iter().map(|(t, m)| (*t, m.name.as_str(), m.message.as_str(), m.line, m.level().as_str_name())).collect();
    assert_eq!(seen, [(TIMES[1], "S:A", "filled", 102, "INFO"), (TIMES[2], "S:B", "left open", 103, "WARNING")]);
    assert!(told.events.iter().all(|(_, m)| m.file == "walk.c3d"));
    let stages: Vec<_> =
        told.events.iter().filter(|(_, m)| m.message.starts_with("model")).map(|(t, m)| (*t, m.message.as_str())).collect();
    let expected = [
        (TIMES[0], "model 0 begins: lds, at most 5 steps"),
        (TIMES[2], "model 0 ends: converged after 3 steps"),
        (TIMES[3], "model 1 begins: linear, at most 5 steps"),
        (TIMES[3], "model 1 ends: converged after 1 step"),
        (TIMES[3], "model 2 begins: breaks, at most 5 steps"),
        (TIMES[3], "model 2 ends: failed after 1 step: the script has ended"),
    ];
    assert_eq!(stages, expected);
    let ends: Vec<_> = told.events.iter().filter(|(_, m)| m.message.contains("ends")).map(|(_, m)| m.level().as_str_name()).collect();
    assert_eq!(ends, ["INFO", "INFO", "WARNING"], "only the last model has to settle");
}

#[test]
fn a_take_that_does_not_stand_is_stood_up_once() {
    let told = told(None);
    let [(0, axes)] = &told.axes[..] else { panic!("{:?}", told.axes) };
    let [transform] = &axes.transforms[..] else { panic!("{axes:?}") };
    assert_eq!((transform.parent_frame_id.as_str(), transform.child_frame_id.as_str()), ("world", "lab"));
    let q = transform.rotation.as_ref().unwrap();
    assert!(q.x > 0.7 && q.w > 0.7 && q.y == 0.0 && q.z == 0.0, "y becomes z: {q:?}");

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("z.mcap");
    let raw = raw();
    let shown = Shown { raw: &raw, repaired: None, bones: &BONES, samples: &[], log_rate_hz: None };
    McapLog::create(&path, about()).unwrap().finish(&Closing { shown: Some(shown), ..Closing::default() }).unwrap();
    assert!(messages(&std::fs::read(&path).unwrap()).axes.is_empty(), "z is up already");
}

#[test]
fn the_log_of_a_repair_that_came_to_nothing_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.mcap");
    let raw = raw();
    let mut log = McapLog::create(&path, about()).unwrap();
    drive(&mut log, scripts());
    let shown = Shown { raw: &raw, repaired: None, bones: &BONES, samples: &[], log_rate_hz: None };
    log.finish(&Closing { ended: Ended::Interrupted, shown: Some(shown), ..Closing::default() }).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let told = messages(&bytes);
    assert_eq!((told.raw.len(), told.repaired.len(), told.likelihoods.len()), (4, 0, 4));
    assert_eq!(told.states[1].1.markers[0].value(), State::Missing);
    assert_eq!(metadata(&bytes)["ended"], "interrupted");
    assert!(is_unfinished(&path));

    super::write(&path);
    assert!(!is_unfinished(&path), "a whole log is not to be replaced unasked");
    std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    assert!(!is_unfinished(&path), "nor is what cannot be read");
    assert_eq!(METADATA, "mocap-repair");
}

#[test]
fn the_take_is_described() {
    let folder = tempfile::tempdir().unwrap();
    log(folder.path(), None);
    let bytes = attachment(&folder.path().join("walk.mcap"), "take.json").unwrap();
    let take: Description = serde_json::from_slice(&bytes).unwrap();
    assert_eq!((take.rate_hz, take.frames, take.first_frame, take.frame_step), (59.94, 4, 101, 1));
    assert_eq!((take.up.as_deref(), take.up_guessed, take.unit.as_str()), (Some("+y"), false, "mm"));
    assert_eq!(take.markers, ["S:A", "S:B", "S:B (2)"]);
    let bones: Vec<_> = take.bones.iter().map(|b| (b.label.as_str(), b.a, b.b, b.length_mm)).collect();
    assert_eq!(bones, [("A-B", 0, 1, 400.0), ("B-B", 1, 2, 600.0)], "places among the markers, not columns of the file");
}

/// Every message path of a layout, with the panel that it is in.
fn paths(value: &serde_json::Value, found: &mut Vec<String>) {
    match value {
        serde_json::Value::Object(map) => {
            if let Some(path) = map.get("value").and_then(|v| v.as_str()) {
                found.push(path.to_owned());
            }
            map.values().for_each(|v| paths(v, found));
        }
        serde_json::Value::Array(list) => list.iter().for_each(|v| paths(v, found)),
        _ => {}
    }
}

#[test]
fn the_layout_shows_what_is_in_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = log(folder.path(), None);
    let (from, to) = (folder.path().join("walk.mcap"), folder.path().join("layout.json"));
    extract_layout(&from, &to, false).unwrap();
    assert!(extract_layout(&from, &to, false).unwrap_err().to_string().contains("--force"));
    let layout: serde_json::Value = serde_json::from_slice(&std::fs::read(&to).unwrap()).unwrap();

    // every panel that is configured has its place and the other way round
    let mut placed = Vec::new();
    let mut open = vec![&layout["layout"]];
    while let Some(node) = open.pop() {
        match node.as_str() {
            Some(id) => placed.push(id.to_owned()),
            None => open.extend([&node["first"], &node["second"]]),
        }
    }
    placed.sort();
    let panels = layout["configById"].as_object().unwrap();
    assert_eq!(placed, panels.keys().cloned().collect::<Vec<_>>());
    for kind in ["3D", "Plot", "StateTransitions", "RosOut", "RawMessages"] {
        assert!(placed.iter().any(|id| id.starts_with(&format!("{kind}!"))), "{kind}");
    }

    let topics = mcap::Summary::read(&bytes).unwrap().unwrap().channels.values().map(|c| c.topic.clone()).collect::<Vec<_>>();
    let told = messages(&bytes);
    let mut seen = 0;
    for (id, panel) in panels {
        assert_eq!(panel["foxglovePanelTitle"], panel["lichtblickPanelTitle"], "{id}");
        assert!(panel["foxglovePanelTitle"].is_string(), "{id}");
        let mut found = Vec::new();
        paths(panel, &mut found);
        for path in &found {
            let topic = path.split(['.', '{']).next().unwrap();
            assert!(topics.iter().any(|t| t == topic), "{id}: {path}");
            let at = path.split_once('[').map(|(_, rest)| rest.split(']').next().unwrap().parse::<usize>().unwrap());
            match (topic, at) {
                ("/take/marker_state", Some(at)) => assert!(at < told.states[0].1.markers.len(), "{path}"),
                ("/take/bone_lengths", Some(at)) => assert!(at < told.lengths[0].1.bones.len(), "{path}"),
                ("/em/bone_residuals", Some(at)) => assert!(at < told.residuals[0].1.bones.len(), "{path}"),
                _ => assert!(at.is_none(), "{path}"),
            }
            seen += 1;
        }
        if let Some(x) = panel["xAxisPath"]["value"].as_str() {
            let topic = |path: &str| path.split(['.', '{']).next().unwrap().to_owned();
            let curves = panel["paths"].as_array().unwrap();
            assert!(curves.iter().all(|c| topic(c["value"].as_str().unwrap()) != topic(x)), "{id}: x and y of one topic show nothing");
        }
    }
    assert!(seen > 6, "{seen}");
    assert_eq!(panels["3D!take"]["followTf"], "world", "y is up");
    let states: Vec<_> =
        panels["StateTransitions!markers"]["paths"].as_array().unwrap().iter().map(|p| p["label"].as_str().unwrap()).collect();
    assert_eq!(states, ["S:A", "S:B"], "those with gaps");
}
