//! `solve`, and `--method skeleton`: the synthetic actor wears markers, and its joints are known.

use crate::lab::{Lab, Ran, column, missing};
use crate::tracking::messages;
use formats::rig::{write_limits, write_mesh, write_parts, write_skeleton};
use formats::{Direction, Marker, Origin, Take, TakeBuilder};
use mocap_repair::demo::actor::{Actor, MarkerOptions, Motion};
use mocap_repair::log::schema::{SolveRound, SolvedFrame, foxglove::PointCloud};
use std::fmt::Write;
use std::sync::OnceLock;

const FRAMES: usize = 60;
const RATE_HZ: f64 = 30.0;

const BODY: [&str; 10] = ["--skl", "body.skl", "--off", "body.off", "--vj", "body.vj", "--cst", "body.cst", "--cst-unit", "rad"];

fn actor() -> &'static Actor {
    static ACTOR: OnceLock<Actor> = OnceLock::new();
    ACTOR.get_or_init(|| Actor::new(3))
}

/// What is seen of a walk.
fn walk(options: &MarkerOptions) -> Take {
    let actor = actor();
    let labels = actor.marker_map().into_iter().map(|m| Marker::new(format!("actor:{}", m.name))).collect();
    let mut take = TakeBuilder::new(labels, FRAMES, RATE_HZ).up(Some(Direction::PLUS_Y)).first_frame(101);
    for (frame, row) in actor.markers(&actor.poses(Motion::Walk, FRAMES, RATE_HZ), options).iter().enumerate() {
        for (marker, place) in row.iter().enumerate() {
            if let Some(place) = place {
                take.set(frame, marker, place.map(|x| x * 10.0), Origin::Measured);
            }
        }
    }
    take.build()
}

/// The take without some samples.
fn without(take: &Take, hidden: impl Fn(usize, &str) -> bool) -> Take {
    let mut other = TakeBuilder::from(take.clone());
    for frame in 0..take.frames() {
        for (at, marker) in take.markers.iter().enumerate().filter(|(_, marker)| hidden(frame, marker.name())) {
            assert!(!marker.label.is_empty());
            other.hide(frame, at);
        }
    }
    other.build()
}

fn map() -> String {
    let actor = actor();
    let row = |m: mocap_repair::demo::actor::SkinMarker| format!("{},{},{}\n", m.name, m.vertex, actor.skeleton.joints[m.joint].name);
    "marker,vertex,joint\n".to_owned() + &actor.marker_map().into_iter().map(row).collect::<String>()
}

fn written(write: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes);
    bytes
}

/// A folder with the body, the map, and a take.
fn lab(take: &Take) -> Lab {
    let (lab, actor) = (Lab::empty(), actor());
    lab.write("body.skl", written(|out| write_skeleton(&actor.skeleton, out).unwrap()));
    lab.write("body.off", written(|out| write_mesh(&actor.mesh, out).unwrap()));
    lab.write("body.vj", written(|out| write_parts(&actor.parts, &actor.skeleton, out).unwrap()));
    lab.write("body.cst", written(|out| write_limits(&actor.limits, &actor.skeleton, out).unwrap()));
    lab.write("map.csv", map());
    lab.create("in.c3d", take);
    lab
}

fn run(lab: &Lab, more: &[&str]) -> Ran {
    lab.run(&[&["solve", "in.c3d", "-o", "out.bvh", "--map", "map.csv"], &BODY[..], more].concat())
}

/// The mean and largest distance of joints from the truth, cm.
fn errors_cm(lab: &Lab) -> (f64, f64) {
    let (actor, take) = (actor(), lab.take("out.bvh"));
    assert_eq!(take.frames(), FRAMES);
    let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
    for (frame, pose) in actor.poses(Motion::Walk, FRAMES, RATE_HZ).iter().enumerate() {
        for (joint, was) in actor.skeleton.joints.iter().zip(actor.joints(pose)).skip(1) {
            let is = take.position_mm(frame, column(&take, &joint.name)).unwrap();
            // the file has no unit, and cm are taken
            let off = (0..3).map(|k| (is[k] / 10.0 - was[k]).powi(2)).sum::<f64>().sqrt();
            sum += off;
            count += 1.0;
            worst = worst.max(off);
        }
    }
    (sum / count, worst)
}

#[track_caller]
fn close(lab: &Lab, mean_cm: f64, worst_cm: f64) {
    let (mean, worst) = errors_cm(lab);
    assert!(mean < mean_cm && worst < worst_cm, "mean {mean} cm, worst {worst} cm");
}

#[test]
fn a_motion_is_found_and_told() {
    let lab = lab(&walk(&MarkerOptions::default()));
    let before = lab.listing();
    let ran = run(&lab, &[]).with_code(0);
    assert_eq!(lab.new_since(&before), ["out.bvh", "out.frames.csv", "out.mcap"]);
    assert!(ran.out.starts_with("in.c3d -> out.bvh\n") && ran.out.contains("41 of 41 are used"), "{}", ran.out);
    close(&lab, 0.6, 2.5);

    let table = lab.text("out.frames.csv");
    let header = table.lines().next().unwrap();
    assert!(header.starts_with("frame,markers,rms_cm,worst_cm,worst,actor:torso_0:residual_cm,"), "{header}");
    assert_eq!((table.lines().count(), header.split(',').count()), (FRAMES + 1, 5 + 41));
    assert!(table.lines().nth(1).unwrap().starts_with("101,41,"), "{table}");

    let log = lab.read("out.mcap");
    let frames = messages::<SolvedFrame>(&log, "/solve/frames");
    assert_eq!(frames.iter().map(|(time, _)| *time).take(3).collect::<Vec<_>>(), [0, 33_333_333, 66_666_667]);
    assert_eq!((frames.len(), frames[1].1.frame, frames[1].1.marker_count, frames[1].1.markers.len()), (FRAMES, 102, 41, 41));
    let rounds = messages::<SolveRound>(&log, "/solve/rounds");
    assert!(rounds.len() >= 3 && rounds[0].1.largest_change.is_nan() && rounds.iter().all(|(_, round)| round.rms_cm < 2.0), "{rounds:?}");
    for topic in ["/markers/seen", "/markers/expected"] {
        let clouds = messages::<PointCloud>(&log, topic);
        assert!(clouds.len() == FRAMES && clouds.iter().all(|(_, cloud)| cloud.data.len() == 41 * 16), "{topic}");
    }
    let metadata = lab.log_metadata("out.mcap");
    assert_eq!((metadata["command"].as_str(), metadata["result.markers_used"].as_str()), ("solve", "41"));

    let ran = run(&lab, &["--json", "--force", "--no-log"]).with_code(0);
    let told = ran.messages();
    assert_eq!(told.iter().filter(|m| m["message_type"] == "marker").count(), 41);
    assert_eq!((&told[41]["message_type"], &told[41]["log"]), (&"solved".into(), &serde_json::Value::Null));
}

#[test]
fn the_report_shows_what_became_of_the_frames() {
    let hidden =
        |frame: usize, name: &str| frame == 30 || ((20..26).contains(&frame) && (name.starts_with("l_farm") || name.starts_with("l_hand")));
    let lab = lab(&without(&walk(&MarkerOptions::default()), hidden));
    run(&lab, &["--no-log", "--report", "out.html"]).with_code(3);
    let page = lab.page("out.html");
    assert_eq!(
        (&page["source_name"], &page["take"]["first_frame"], &page["take"]["frames"]),
        (&"in.c3d".into(), &101.into(), &FRAMES.into())
    );
    let followed = &page["followed"];
    let predicted = serde_json::json!({ "start": 30, "frames": 1, "kind": "predicted", "marker": null, "about": "no marker" });
    let events = followed["events"].as_array().unwrap();
    assert!(events.contains(&predicted), "{events:?}");
    assert!(events.iter().any(|event| event["kind"] == "unseen" && event["start"] == 20 && event["frames"] == 6), "{events:?}");
    assert_eq!((&followed["tiles"][0]["value"], &followed["tiles"][3]["value"]), (&"41".into(), &"1".into()));
    let table = lab.text("out.frames.csv");
    let rms = followed["curves"][0]["values"].as_array().unwrap();
    assert!(rms.len() == FRAMES && rms[30].is_null());
    let told: f64 = table.lines().nth(1).unwrap().split(',').nth(2).unwrap().parse().unwrap();
    assert!((rms[0].as_f64().unwrap() - told).abs() < 1.01e-4, "{told}");
}

#[test]
fn equal_takes_give_equal_bytes() {
    let files = [(); 2].map(|()| {
        let lab = lab(&walk(&MarkerOptions { hidden: 0.3, ..MarkerOptions::default() }));
        run(&lab, &[]);
        ["out.bvh", "out.frames.csv", "out.mcap"].map(|name| lab.read(name))
    });
    assert!(files[0] == files[1]);
}

#[test]
fn what_is_hidden_is_carried_by_the_rest() {
    let lab = lab(&walk(&MarkerOptions { hidden: 0.3, ..MarkerOptions::default() }));
    run(&lab, &[]).with_code(0);
    close(&lab, 0.8, 5.0);
}

#[test]
fn a_limb_and_frames_that_nobody_saw() {
    let hidden = |frame: usize, name: &str| {
        (40..44).contains(&frame) || ((20..30).contains(&frame) && (name.starts_with("l_farm") || name.starts_with("l_hand")))
    };
    let lab = lab(&without(&walk(&MarkerOptions::default()), hidden));
    let ran = run(&lab, &[]).with_code(3);
    let told = ran.sentences();
    assert!(told.contains("4 frames without any marker: 141-144"), "{told}");
    assert!(told.contains("unseen") && told.contains("in 10 frames: 121-130"), "{told}");
    close(&lab, 0.9, 15.0);
    assert!(lab.text("out.frames.csv").lines().nth(41).unwrap().starts_with("141,0,,,,"));
}

#[test]
fn a_take_in_other_axes_is_turned() {
    let lab = lab(&walk(&MarkerOptions::default()).turned(Direction::PLUS_Y, Direction::PLUS_Z));
    let ran = run(&lab, &["--no-log"]).with_code(0);
    assert!(ran.sentences().contains("the take has +z up and the body has +y up, so the take was turned"), "{}", ran.out);
    close(&lab, 0.6, 2.5);
}

#[test]
fn filled_samples_count_the_less_the_less_sure_they_are() {
    // a hand's breadth off, as if somebody had filled them badly
    let take = walk(&MarkerOptions::default());
    let mut bad = TakeBuilder::from(take.clone());
    let mut fills = String::from("frame_index,frame,marker,x,y,z,sigma_mm,gap,method\n");
    for at in (0..take.markers.len()).step_by(3) {
        for frame in 10..50 {
            let [x, y, z] = take.position_mm(frame, at).unwrap();
            bad.set(frame, at, [x + 80.0, y, z - 60.0], Origin::Measured);
            writeln!(fills, "{frame},{},{},0,0,0,150,1,auto", frame + 101, take.display_label(at)).unwrap();
        }
    }
    let lab = lab(&bad.build());
    lab.write("fills.csv", &fills);
    run(&lab, &["--no-log"]);
    let (blind, _) = errors_cm(&lab);
    run(&lab, &["--no-log", "--force", "--fills", "fills.csv"]);
    let (told, _) = errors_cm(&lab);
    assert!(told < 0.8 && told < 0.4 * blind, "{told} cm with the table, {blind} cm without");
    lab.write("fills.csv", fills.replace("actor:torso_0,", "actor:nobody,"));
    let ran = run(&lab, &["--no-log", "--force", "--fills", "fills.csv"]);
    assert!(ran.code == 1 && ran.err.contains("fills.csv: line 2: marker \"actor:nobody\" is not in the take"), "{ran:?}");
}

#[test]
fn maps_that_cannot_be_meant() {
    let lab = lab(&walk(&MarkerOptions::default()));
    let map = map();
    let line = |number: usize| map.lines().nth(number - 1).unwrap();
    let before = lab.listing();
    for (text, said) in [
        (String::new(), "map.csv: no marker was found"),
        ("marker,vertex,joint\n".to_owned(), "map.csv: no marker was found"),
        ("marker,x\na,1\n".to_owned(), "line 1: the header has no column vertex"),
        ("marker,vertex,joint,colour\n".to_owned(), "line 1: the header has a column \"colour\""),
        (map.replacen(line(3), "torso_1,5,trunk", 1), "line 3: joint \"trunk\" is not in the skeleton; it has root, torso"),
        (map.replacen(line(3), "torso_1,999999,", 1), "line 3: vertex 999999 is not there, the surface has vertices 0 to "),
        (map.replacen(line(3), "torso_1,-1,", 1), "line 3: vertex \"-1\" is not the number of a vertex"),
        (map.replacen(line(3), line(2), 1), "line 3: marker \"torso_0\" is in line 2 already"),
        (
            map.replacen(line(3), &line(2).replace("torso_0", "actor:torso_0"), 1),
            "marker \"actor:torso_0\" of the take is in line 2 already",
        ),
        (map.replacen(line(3), "torso_1,,", 1), "line 3: marker \"torso_1\" has neither a vertex nor x, y and z, nor a joint"),
        (map.replacen(line(3), "torso_1,,torso", 1), "only the joint is told of"),
        (map.replacen(line(3), "torso_1,5,torso,1", 1), "line 3: 4 cells found, the header has 3"),
        ("marker,vertex,joint,x,y,z\ntorso_0,,torso,1,2,\n".to_owned(), "line 2: only some of x, y and z are given"),
        ("marker,vertex,joint,x,y,z\ntorso_0,,,1,2,3\n".to_owned(), "line 2: neither a vertex nor a joint"),
        ("marker,vertex,joint,weight\ntorso_0,1,,-1\n".to_owned(), "line 2: weight -1 is below 0"),
        ("marker,vertex,joint\nLKNE,1,torso\n".to_owned(), "none of its markers is in the take; the first one is LKNE"),
    ] {
        lab.write("map.csv", &text);
        let ran = run(&lab, &[]);
        assert!(ran.code == 1 && ran.err.contains(said), "{said}: {ran:?}");
        lab.write("map.csv", &map);
        assert!(lab.new_since(&before).is_empty());
    }
    let ran = lab.run(&[&["solve", "in.c3d", "-o", "out.bvh"], &BODY[..]].concat());
    assert!(ran.code == 2 && ran.err.contains("--map"), "{ran:?}");
    let ran = run(&lab, &["--csv", "map.csv", "--force"]);
    assert!(ran.code == 1 && ran.err.contains("map.csv: is read as well"), "{ran:?}");
}

#[test]
fn maps_that_are_not_quite_right() {
    let lab = lab(&walk(&MarkerOptions::default()));
    // swapped labels, a marker that is not there, and others that the map does not have
    let map = map();
    let kept: String = map.lines().filter(|line| !line.starts_with("head_")).map(|line| line.to_owned() + "\n").collect();
    let swapped = kept.replace("l_foot_0,", "@,").replace("r_foot_0,", "l_foot_0,").replace("@,", "r_foot_0,") + "nose,1,torso\n";
    lab.write("map.csv", swapped);
    let ran = run(&lab, &[]).with_code(3);
    let told = ran.sentences();
    assert!(told.contains("37 of 41 are used") && told.contains("actor:head_0, actor:head_1"), "{told}");
    assert!(told.contains("markers of the map that the take does not have: nose"), "{told}");
    assert!(told.contains("l_foot_0") && told.contains("labels swapped, or another vertex?"), "{told}");
    assert!(told.contains("no marker tells how these joints turn: head"), "{told}");
    // places instead of vertices, offsets of nothing, and a weight
    let at = |vertex: usize| actor().mesh.vertices[vertex];
    let mut places = String::from("joint,weight,marker,z,y,x,vertex\n");
    for m in actor().marker_map() {
        let ([x, y, z], joint) = (at(m.vertex), &actor().skeleton.joints[m.joint].name);
        let row =
            if m.vertex % 2 == 0 { format!("{joint},2,{},{z},{y},{x},\n", m.name) } else { format!(",,{},0,0,0,{}\n", m.name, m.vertex) };
        places += &row;
    }
    lab.write("map.csv", places);
    run(&lab, &["--force"]).with_code(0);
    close(&lab, 0.6, 2.5);
}

#[test]
fn gaps_are_filled_from_the_body() {
    let whole = walk(&MarkerOptions::default());
    let holed = without(&whole, |frame, name| {
        (name == "l_thigh_0" && (15..45).contains(&frame)) || (name == "r_farm_0" && (20..50).contains(&frame))
    });
    let lab = lab(&holed);
    let ran = lab.run(&["in.c3d", "-o", "out.c3d", "--method", "skeleton"]);
    let lacking = ["--skl", "--off", "--vj", "--map"].iter().all(|option| ran.err.contains(option));
    assert!(ran.code == 2 && lacking, "{ran:?}");
    let rms_mm = |output: &str| {
        let take = lab.take(output);
        let square = |&(frame, marker): &(usize, usize)| {
            let [p, q] = [&take, &whole].map(|take| take.position_mm(frame, marker).unwrap());
            (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>()
        };
        let gaps = missing(&holed);
        (gaps.iter().map(square).sum::<f64>() / gaps.len() as f64).sqrt()
    };
    let command = [&["in.c3d", "-o", "out.c3d", "--method", "skeleton", "--map", "map.csv", "--fills", "fills.csv"], &BODY[..]].concat();
    let told = lab.run(&[&command[..], &["--explain"]].concat()).with_code(0).sentences();
    for (part, neighbour) in [("l_thigh", "actor:l_thigh_"), ("r_farm", "actor:r_farm_")] {
        let gap = told.split("\ngap ").skip(1).find(|gap| gap.contains(&format!("actor:{part}_0,"))).unwrap();
        assert!(gap.contains(&format!("pose of {part}")) && gap.contains("judged by"), "{gap}");
        assert!(gap.lines().any(|line| line.contains("neighbours") && line.contains(neighbour)), "{gap}");
    }
    lab.run(&["in.c3d", "-o", "spline.c3d", "--method", "spline", "--no-log"]).with_code(0);
    let (skeleton, spline) = (rms_mm("out.c3d"), rms_mm("spline.c3d"));
    assert!(skeleton < 15.0 && skeleton < 0.5 * spline, "skeleton {skeleton} mm, spline {spline} mm");
    let sigmas: Vec<f64> = lab.text("fills.csv").lines().skip(1).map(|line| line.split(',').nth(6).unwrap().parse().unwrap()).collect();
    let promised = (sigmas.iter().map(|s| s * s).sum::<f64>() / sigmas.len() as f64).sqrt();
    assert!((0.3..3.0).contains(&(skeleton / promised)), "off by {skeleton} mm, promised are {promised} mm");
    // what the map does not have is filled all the same, and told
    lab.write(
        "map.csv",
        map().lines().filter(|line| !line.starts_with("l_thigh_0")).map(|line| line.to_owned() + "\n").collect::<String>(),
    );
    let ran = lab.run(&[&command[..], &["--force"]].concat()).with_code(3);
    assert!(ran.sentences().contains("markers that --map does not have are filled by splines: actor:l_thigh_0"), "{}", ran.out);
    assert!(missing(&lab.take("out.c3d")).is_empty());
}

#[test]
fn a_dry_run_looks_and_writes_nothing() {
    let lab = lab(&without(&walk(&MarkerOptions::default()), |_, name| name == "l_thigh_0"));
    let before = lab.listing();
    let ran = run(&lab, &["--dry-run"]).with_code(3);
    assert!(ran.out.starts_with("in.c3d (dry run, nothing was written)\n"), "{}", ran.out);
    let told = ran.sentences();
    assert!(["l_thigh_0", "are used", "out.bvh", "out.frames.csv"].iter().all(|what| told.contains(what)), "{told}");
    let summary = run(&lab, &["--dry-run", "--json"]).with_code(3).messages().pop().unwrap();
    assert_eq!((&summary["dry_run"], &summary["output"], &summary["frames"]), (&true.into(), &serde_json::Value::Null, &FRAMES.into()));
    lab.write("bad.csv", "marker,vertex,joint\nx,999999,torso\n");
    let words: Vec<&str> = [&["solve", "in.c3d", "-o", "out.bvh", "--map", "bad.csv", "--dry-run"], &BODY[..]].concat();
    let ran = lab.run(&words);
    assert!(ran.code == 1 && ran.err.contains("bad.csv: "), "{ran:?}");
    assert!(lab.new_since(&before) == ["bad.csv"]);
}

#[test]
fn a_spine_bends_and_is_in_the_output() {
    let lab = lab(&walk(&MarkerOptions::default()));
    run(&lab, &["--no-log"]).with_code(0);
    let stiff = errors_cm(&lab).0;
    run(&lab, &["--no-log", "--spine", "--force"]).with_code(0);
    assert!(lab.text("out.bvh").contains("JOINT torso_spine"));
    let bent = errors_cm(&lab).0;
    assert!(bent < stiff + 0.1, "{bent} cm with a spine, {stiff} cm without");
}

#[test]
fn the_second_limit_of_a_ball_may_be_a_twist() {
    let lab = lab(&walk(&MarkerOptions::default()));
    run(&lab, &["--cst-ball", "swing-twist"]).with_code(0);
    assert_eq!(lab.log_metadata("out.mcap").get("option.cst_ball").map(String::as_str), Some("swing-twist"));
    assert!(errors_cm(&lab).0 < 2.0, "{:?}", errors_cm(&lab));
    let without: Vec<&str> = ["solve", "in.c3d", "-o", "o.bvh", "--map", "map.csv", "--cst-ball", "swing-twist"]
        .into_iter()
        .chain(BODY[..6].iter().copied())
        .collect();
    let ran = lab.run(&without);
    assert!(ran.code == 2 && ran.err.contains("--cst <FILE.cst>"), "{ran:?}");
}

/// The take as a table that names no unit, its numbers in centimetres.
fn table_in_cm(take: &Take) -> String {
    let mut text = String::from("frame");
    for marker in &take.markers {
        let name = marker.name();
        write!(text, ",{name}_x,{name}_y,{name}_z").unwrap();
    }
    for frame in 0..take.frames() {
        write!(text, "\n{frame}").unwrap();
        for at in 0..take.markers.len() {
            match take.position_mm(frame, at) {
                Some([x, y, z]) => write!(text, ",{:.3},{:.3},{:.3}", x / 10.0, y / 10.0, z / 10.0).unwrap(),
                None => text += ",,,",
            }
        }
    }
    text + "\n"
}

#[test]
fn a_unit_that_nobody_said_is_known_by_the_size_of_the_body() {
    let take = walk(&MarkerOptions::default());
    let lab = lab(&take);
    lab.write("in.csv", table_in_cm(&take));
    let solve = |more: &[&str]| {
        lab.run(&[&["solve", "in.csv", "-o", "out.bvh", "--map", "map.csv", "--rate", "30", "--no-log"], &BODY[..], more].concat())
    };
    let ran = solve(&[]).with_code(3);
    assert!(ran.sentences().contains("cm assumed, because the markers have the size of the body then"), "{}", ran.out);
    close(&lab, 0.6, 2.5);
    solve(&["--units", "cm", "--force"]).with_code(0);
    let before = lab.listing();
    for unit in ["mm", "m"] {
        let ran = solve(&["--units", unit, "--force"]);
        let told = ran.err.contains(&format!("(read as {unit})")) && ran.err.contains("are expected of this body; say --units cm");
        assert!(ran.code == 1 && told, "{ran:?}");
    }
    assert!(lab.new_since(&before).is_empty());
    // the filler has the same body
    lab.write("in.csv", table_in_cm(&without(&take, |frame, name| name == "l_thigh_0" && (15..45).contains(&frame))));
    let fill = |more: &[&str]| {
        let command = ["in.csv", "-o", "out.csv", "--method", "skeleton", "--map", "map.csv", "--rate", "30", "--no-log", "--force"];
        lab.run(&[&command, &BODY[..], more].concat())
    };
    let ran = fill(&[]).with_code(3);
    assert!(ran.sentences().contains("the body fits its markers if they are in cm"), "{}", ran.out);
    let ran = fill(&["--units", "m"]);
    assert!(ran.code == 1 && ran.err.contains("say --units cm"), "{ran:?}");
}

#[test]
fn markers_that_are_never_seen() {
    let take = walk(&MarkerOptions::default());
    let lab = lab(&without(&take, |_, name| name == "l_hand_1"));
    let ran = run(&lab, &["--no-log"]).with_code(3);
    assert!(ran.sentences().contains("markers of the map that are not seen in any frame: actor:l_hand_1"), "{}", ran.out);
    lab.create("in.c3d", &without(&take, |_, _| true));
    let before = lab.listing();
    let ran = run(&lab, &["--no-log", "--force"]);
    assert!(ran.code == 1 && ran.err.contains("no marker of the body is seen in any frame"), "{ran:?}");
    assert!(lab.new_since(&before).is_empty());
}

#[test]
fn a_limb_that_is_unseen_for_long_is_a_reason_to_look() {
    let arm = |name: &str| ["l_uarm", "l_farm", "l_hand"].iter().any(|joint| name.starts_with(joint));
    let lab = lab(&without(&walk(&MarkerOptions::default()), |frame, name| frame < 20 && arm(name)));
    let ran = run(&lab, &["--no-log"]).with_code(3);
    let told = "l_uarm and what hangs on it had no marker for long, in 20 frames: 101-120; its pose there is a guess";
    assert!(ran.sentences().contains(told), "{}", ran.out);
    close(&lab, 1.5, 40.0);
    let ran = run(&lab, &["--no-log", "--force", "--json"]);
    let messages = ran.messages();
    let summary = messages.last().unwrap();
    assert_eq!((&summary["exit_code"], &summary["look_at"][0]), (&3.into(), &told.into()));
    // for a few frames it is told, and no reason
    lab.create("in.c3d", &without(&walk(&MarkerOptions::default()), |frame, name| (30..34).contains(&frame) && arm(name)));
    let ran = run(&lab, &["--no-log", "--force"]).with_code(0);
    assert!(ran.sentences().contains("l_uarm in 4 frames: 131-134"), "{}", ran.out);
}

#[test]
fn places_of_markers_are_found_out() {
    let lab = lab(&walk(&MarkerOptions::default()));
    let calibrated =
        |more: &[&str]| lab.run(&[&["solve", "in.c3d", "-o", "out.bvh", "--no-log", "--force", "--calibrate"], &BODY[..], more].concat());
    let ran = calibrated(&[]).with_code(0);
    assert!(ran.sentences().contains("% of the size of the rig"), "{}", ran.out);
    close(&lab, 1.0, 4.0);
    calibrated(&["--spine"]).with_code(0);
    close(&lab, 1.0, 4.0);
    calibrated(&["--map", "map.csv"]).with_code(0);
    close(&lab, 0.7, 3.0);
    let joints: String = map().lines().map(|line| line.split(',').step_by(2).collect::<Vec<_>>().join(",") + "\n").collect();
    lab.write("joints.csv", joints);
    calibrated(&["--map", "joints.csv"]).with_code(0);
    close(&lab, 1.0, 4.0);
    let ran = lab.run(&[&["solve", "in.c3d", "-o", "out.bvh", "--force", "--map", "joints.csv"], &BODY[..]].concat());
    assert!(ran.code == 1 && ran.err.contains("only the joint is told of"), "{ran:?}");
}

#[test]
fn gaps_of_a_take_in_other_axes_are_filled_from_the_body() {
    let whole = walk(&MarkerOptions::default()).turned(Direction::PLUS_Y, Direction::PLUS_Z);
    let holed = without(&whole, |frame, name| name == "l_thigh_0" && (15..45).contains(&frame));
    let lab = lab(&holed);
    lab.run(&[&["in.c3d", "-o", "out.c3d", "--method", "skeleton", "--map", "map.csv", "--no-log"], &BODY[..]].concat()).with_code(0);
    let take = lab.take("out.c3d");
    for (frame, marker) in missing(&holed) {
        let [p, q] = [&take, &whole].map(|take| take.position_mm(frame, marker).unwrap());
        let off = (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt();
        assert!(off < 40.0, "frame {frame}: {off} mm");
    }
}

#[test]
fn fills_of_limbs_that_nobody_saw_are_as_unsure_as_they_are() {
    let whole = walk(&MarkerOptions::default());
    let arm = |name: &str| ["l_uarm", "l_farm", "l_hand"].iter().any(|joint| name.starts_with(joint));
    for gap in [20..40, 40..60] {
        let holed = without(&whole, |frame, name| gap.contains(&frame) && arm(name));
        let lab = lab(&holed);
        let more = ["--no-log", "--extrapolate", "--fills", "fills.csv"];
        lab.run(&[&["in.c3d", "-o", "out.c3d", "--method", "skeleton", "--map", "map.csv"], &more[..], &BODY[..]].concat());
        let take = lab.take("out.c3d");
        let mut ratios = Vec::new();
        for line in lab.text("fills.csv").lines().skip(1) {
            let cells: Vec<&str> = line.split(',').collect();
            let (frame, marker) = (cells[0].parse().unwrap(), column(&take, cells[2]));
            let [p, q] = [&take, &whole].map(|take| take.position_mm(frame, marker).unwrap());
            let off = (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt();
            ratios.push(off / cells[6].parse::<f64>().unwrap());
        }
        ratios.sort_by(f64::total_cmp);
        assert!(ratios.len() == 20 * 6, "{}", ratios.len());
        let (middle, high) = (ratios[ratios.len() / 2], ratios[ratios.len() * 9 / 10]);
        assert!((0.05..2.0).contains(&middle) && high < 3.5, "{gap:?}: {middle} and {high} times what was promised");
    }
}
