//! The main job, and the demonstration take.

use crate::lab::{FRAMES, Lab, changed_points, missing, points_start, with_fourth_words};
use formats::Notes;
use formats::rig::{read_limits, read_mesh, read_parts, read_skeleton};

#[test]
fn the_demonstration_is_four_files() {
    let lab = Lab::empty();
    let command = ["demo", "-o", "new/demo", "--frames", "60"];
    let ran = lab.run(&command).with_code(0);
    let names = ["walk-gaps.c3d", "walk-gaps.csv", "walk-truth.c3d", "walk-truth.csv"];
    assert_eq!(ran.out.lines().collect::<Vec<_>>(), names.map(|name| format!("new/demo/{name}")));
    let files = names.map(|name| lab.read(&format!("new/demo/{name}")));
    assert_eq!(std::fs::read_dir(lab.path("new/demo")).unwrap().count(), 4);

    let again = lab.run(&command);
    assert_eq!((again.code, again.out.as_str()), (1, ""));
    assert!(again.err.contains("new/demo/walk-gaps.c3d: exists already") && again.err.contains("--force"), "{}", again.err);

    lab.write("new/demo/walk-gaps.csv", "something else");
    lab.run(&[&command[..], &["--force"]].concat()).with_code(0);
    assert_eq!(names.map(|name| lab.read(&format!("new/demo/{name}"))), files, "a seed means the same take for ever");

    lab.run(&["demo", "-o", "other", "--frames", "60", "--seed", "2"]).with_code(0);
    assert_ne!(lab.read("other/walk-truth.c3d"), files[2]);
}

#[test]
fn the_demonstration_of_a_body_is_a_rig_with_clouds() {
    let lab = Lab::empty();
    let command = ["demo", "--kind", "body", "-o", "body"];
    let ran = lab.run(&command).with_code(0);
    let names = ["body.off", "body.skl", "body.cst", "body.vj", "clouds", "markers.csv", "markers_map.csv", "truth_joints.csv"];
    assert_eq!(ran.out.lines().collect::<Vec<_>>(), names.map(|name| format!("body/{name}")));
    let notes = Notes::new();
    let skeleton = read_skeleton(&lab.read("body/body.skl"), &notes).unwrap();
    let mesh = read_mesh(&lab.read("body/body.off"), &Notes::new()).unwrap();
    let parts = read_parts(&lab.read("body/body.vj"), &skeleton, mesh.vertices.len()).unwrap();
    let limits = read_limits(&lab.read("body/body.cst"), &skeleton, None, &notes).unwrap();
    assert_eq!((skeleton.joints.len(), skeleton.freedom(), limits.iter().flatten().count()), (15, 29, 13));
    assert_eq!((parts.len(), mesh.normals.len()), (mesh.vertices.len(), mesh.vertices.len()));
    assert_eq!(std::fs::read_dir(lab.path("body/clouds")).unwrap().count(), 60);
    for frame in [0, 59] {
        let cloud = read_mesh(&lab.read(&format!("body/clouds/frame_{frame:03}.off")), &Notes::new()).unwrap();
        assert_eq!((cloud.vertices.len(), cloud.normals.len(), cloud.faces.len()), (2500, 2500, 0));
    }
    for (name, columns) in [("markers.csv", 1 + 3 * 41), ("truth_joints.csv", 1 + 3 * 14)] {
        let text = lab.text(&format!("body/{name}"));
        assert_eq!(text.lines().count(), 61, "{name}");
        assert!(text.lines().all(|line| line.split(',').count() == columns), "{name}");
    }
    assert_eq!(lab.text("body/markers_map.csv").lines().count(), 42);

    let again = lab.run(&command);
    assert_eq!((again.code, again.out.as_str()), (1, ""));
    assert!(again.err.contains("body/body.off: exists already") && again.err.contains("--force"), "{}", again.err);
    let cloud = lab.read("body/clouds/frame_031.off");
    lab.run(&[&command[..], &["--force"]].concat()).with_code(0);
    assert_eq!(lab.read("body/clouds/frame_031.off"), cloud, "a seed means the same body for ever");
}

#[test]
fn the_demonstration_has_gaps_and_a_truth() {
    let lab = Lab::new();
    let (gaps, truth) = (lab.take("walk-gaps.c3d"), lab.take("walk-truth.c3d"));
    assert_eq!((gaps.frames(), missing(&truth).len()), (FRAMES, 0));
    assert!(missing(&gaps).len() > 500);
    // Text and bytes say the same.
    for (c3d, csv) in [(&gaps, lab.take("walk-gaps.csv")), (&truth, lab.take("walk-truth.csv"))] {
        assert_eq!((&c3d.markers, c3d.rate_hz), (&csv.markers, csv.rate_hz));
        for (frame, marker) in (0..FRAMES).flat_map(|f| (0..c3d.markers.len()).map(move |m| (f, m))) {
            assert_eq!(c3d.position_mm(frame, marker), csv.position_mm(frame, marker));
        }
    }
}

#[test]
fn a_repair_writes_take_and_log_and_tells() {
    let lab = Lab::new();
    let before = lab.listing();
    let ran = lab.run(&["walk-gaps.c3d", "-o", "walk.c3d"]).with_code(0);
    assert_eq!(lab.new_since(&before), ["walk.c3d", "walk.mcap"]);

    let (gaps, truth, walk) = (lab.take("walk-gaps.c3d"), lab.take("walk-truth.c3d"), lab.take("walk.c3d"));
    let holes = missing(&gaps);
    let (told, markers) = ran.out.split_once("\n\n").unwrap();
    let heads = told.lines().skip(1).filter(|line| !line.starts_with("   ")).filter_map(|line| line.split_whitespace().next());
    assert_eq!(heads.collect::<Vec<_>>(), ["take", "gaps", "longest", "filled", "expected", "bones", "log"]);
    let rows: Vec<Vec<&str>> = markers.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(rows[0], ["marker", "gaps", "samples", "longest", "worst", "mm"]);
    let worst: Vec<f64> = rows[1..13].iter().map(|row| row[4].parse().unwrap()).collect();
    assert!(
        worst.is_sorted_by(|a, b| a >= b) && rows.len() == 14 && rows[13].join(" ").starts_with("and 29 markers more with "),
        "{markers}"
    );
    assert!(ran.out.starts_with("walk-gaps.c3d -> walk.c3d\n"), "{}", ran.out);
    let by = format!("with {} samples by auto (complete after 3 iterations, ", holes.len());
    assert!(ran.sentences().contains(&by), "{}", ran.out);
    assert!(ran.out.lines().all(|line| line.chars().count() <= 80), "{}", ran.out);

    assert!(missing(&walk).is_empty());
    let (mut sum, mut count) = (0.0, 0.0);
    for (frame, marker) in (0..FRAMES).flat_map(|f| (0..gaps.markers.len()).map(move |m| (f, m))) {
        let (is, was) = (walk.position_mm(frame, marker).unwrap(), truth.position_mm(frame, marker).unwrap());
        if holes.binary_search(&(frame, marker)).is_ok() {
            sum += (0..3).map(|k| (is[k] - was[k]).powi(2)).sum::<f64>();
            count += 1.0;
        } else {
            assert_eq!(is, was, "frame {frame}, marker {marker}: measured samples are not ours to change");
        }
    }
    assert!(f64::sqrt(sum / count) < 15.0, "filled samples are {} mm off", f64::sqrt(sum / count));
}

/// Several formats are called `.csv`: a repair keeps that of its input, whatever the name of the output says.
#[test]
fn an_export_stays_an_export() {
    let lab = Lab::empty();
    let head = "Trajectories\r\n100\r\n,,S:A,,,S:B,,\r\nFrame,Sub Frame,X,Y,Z,X,Y,Z\r\n,,mm,mm,mm,mm,mm,mm\r\n";
    let row = |frame: usize, hidden: bool| {
        let a = if hidden { ",,".to_owned() } else { format!("{frame}.125,2.500,3.500") };
        format!("{frame},0,{a},{frame}.250,500.500,6.500\r\n")
    };
    let rows = |hidden: std::ops::Range<usize>| (1..60).map(|frame| row(frame, hidden.contains(&frame))).collect::<String>();
    let devices = "\r\nDevices\r\n1000\r\n,,Plate\r\nFrame,Sub Frame,Fx\r\n,,N\r\n1,0,0.5\r\n";
    lab.write("in.csv", format!("{head}{}{devices}", rows(20..24)));
    lab.run(&["in.csv", "-o", "out.csv", "--method", "linear", "--no-log"]).with_code(0);
    assert_eq!(String::from_utf8(lab.read("out.csv")).unwrap(), format!("{head}{}{devices}", rows(0..0)));
}

#[test]
fn every_byte_that_is_no_filled_point_stays() {
    let lab = Lab::new();
    let holes = missing(&lab.take("walk-gaps.c3d")).len();
    lab.run(&["walk-gaps.c3d", "-o", "walk.c3d", "--method", "spline"]).with_code(0);
    let (before, after) = (lab.read("walk-gaps.c3d"), lab.read("walk.c3d"));
    assert_eq!(changed_points(&before, &after, points_start(&before)), Some(holes));
}

#[test]
fn the_same_command_gives_the_same_bytes() {
    for method in ["linear", "spline", "lds", "bolero-sc"] {
        let runs = [(); 2].map(|()| {
            let lab = Lab::new();
            lab.run(&["walk-gaps.c3d", "-o", "walk.c3d", "--fills", "fills.csv", "--method", method]).with_code(0);
            lab.listing()
        });
        assert_eq!(runs[0].len(), 7);
        for (name, bytes) in &runs[0] {
            assert!(runs[1].get(name) == Some(bytes), "{method}: {name} differs");
        }
    }
}

#[test]
fn a_take_without_gaps_stays_as_it_is() {
    let lab = Lab::new();
    for name in ["walk-truth.c3d", "walk-truth.csv"] {
        let output = format!("out-{name}");
        let ran = lab.run(&[name, "-o", &output, "--no-log"]).with_code(0);
        assert!(ran.out.contains("\n  gaps       none\n"), "{}", ran.out);
        assert!(lab.read(&output) == lab.read(name), "{name}");
    }
}

#[test]
fn json_is_one_message_per_line() {
    let lab = Lab::new();
    let holes = missing(&lab.take("walk-gaps.c3d")).len();
    let ran = lab.run(&["walk-gaps.c3d", "-o", "walk.c3d", "--json", "--max-gap", "20"]).with_code(3);
    assert!(ran.out.lines().all(|line| line.starts_with("{\"message_type\":\"")), "{}", ran.out);
    let messages = ran.messages();
    let (summary, gaps) = messages.split_last().unwrap();
    assert!(gaps.iter().all(|m| m["message_type"] == "gap"));
    let open = gaps.iter().filter(|m| m["open"] == "too-long").count();
    assert!(open > 0 && open < gaps.len());
    for (key, value) in [
        ("message_type", serde_json::json!("summary")),
        ("input", "walk-gaps.c3d".into()),
        ("output", "walk.c3d".into()),
        ("log", "walk.mcap".into()),
        ("method", "auto".into()),
        ("frames", FRAMES.into()),
        ("gaps", gaps.len().into()),
        ("gaps_left_open", open.into()),
        ("samples_missing", holes.into()),
        ("exit_code", 3.into()),
    ] {
        assert_eq!(summary[key], value, "{key}");
    }
    assert_eq!(summary["stages"].as_array().unwrap().last().unwrap()["stop"], "complete");
    let filled = gaps.iter().filter(|m| m["open"].is_null());
    assert_eq!(summary["samples_filled"], filled.map(|m| m["frames"].as_u64().unwrap()).sum::<u64>());
}

#[test]
fn json_tells_of_failures_too() {
    let lab = Lab::new();
    for arguments in [&["none.c3d", "-o", "walk.c3d", "--json"][..], &["inspect", "none.c3d", "--json"]] {
        let ran = lab.run(arguments).with_code(1);
        let messages = ran.messages();
        assert_eq!(messages.len(), 1, "{}", ran.out);
        assert_eq!(messages[0]["message_type"], "error");
        assert!(messages[0]["text"].as_str().unwrap().starts_with("none.c3d: "), "{}", ran.out);
    }
}

#[test]
fn quiet_prints_failures_only() {
    let lab = Lab::new();
    let ran = lab.run(&["walk-gaps.c3d", "-o", "walk.c3d", "--quiet", "--method", "spline"]).with_code(0);
    assert_eq!(ran.out, "");
    let ran = lab.run(&["walk-gaps.c3d", "-o", "open.c3d", "-q", "--max-gap", "1"]).with_code(3);
    assert_eq!(ran.out, "");
    let ran = lab.run(&["none.c3d", "-o", "none-out.c3d", "-q"]);
    assert_eq!((ran.code, ran.out.as_str()), (1, ""));
    assert!(ran.err.starts_with("mocap-repair: none.c3d: "), "{}", ran.err);
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let lab = Lab::new();
    let mut child = lab.command(&["walk-gaps.c3d", "-o", "walk.c3d", "--method", "spline", "--json"]).spawn().unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
    assert!(missing(&lab.take("walk.c3d")).is_empty());
}

#[test]
fn what_was_assumed_or_left_open_ends_with_3() {
    let lab = Lab::new();
    let truth = lab.take("walk-truth.c3d");
    lab.create("edge.c3d", &mocap_repair::demo::hide(&truth, "LKNE", 0..20));
    lab.create("never.c3d", &mocap_repair::demo::hide(&truth, "LKNE", 0..FRAMES));
    let csv = lab.text("walk-gaps.csv");
    let (head, rows) = csv.split_once('\n').unwrap();
    lab.write("nounit.csv", format!("{}\n{rows}", head.replace(" (mm)", "")));
    let without_times: String = csv.lines().map(|row| row.split(',').skip(2).collect::<Vec<_>>().join(",") + "\n").collect();
    lab.write("norate.csv", without_times);
    for (arguments, told) in [
        (&["edge.c3d"][..], "1 gap left open: reaches the first or last frame (fill it with --extrapolate) LKNE\n"),
        (&["never.c3d"], "1 gap left open: the marker never appears"),
        (&["walk-gaps.c3d", "--max-gap", "20"], "left open: longer than --max-gap"),
        (&["walk-gaps.c3d", "--markers", "LKNE"], "left open: not among --markers"),
        (&["nounit.csv"], "look at    the file names no unit, mm assumed (say it with --units)"),
        (&["norate.csv"], "look at    the file names no frame rate, 100 Hz assumed (say it with --rate)"),
        (&["walk-gaps.c3d", "--method", "lds", "--iterations", "2"], "(step limit after 2 iterations)"),
    ] {
        let before = lab.listing();
        let output = format!("out.{}", arguments[0].rsplit('.').next().unwrap());
        let method = if arguments.contains(&"--method") { &[][..] } else { &["--method", "spline"] };
        let ran = lab.run(&[arguments, &["-o", &output], method].concat()).with_code(3);
        assert!(ran.sentences().contains(told), "{arguments:?}: {}", ran.out);
        assert_eq!(lab.new_since(&before), [output.as_str(), "out.mcap"]);
        std::fs::remove_file(lab.path(&output)).unwrap();
        std::fs::remove_file(lab.path("out.mcap")).unwrap();
    }
}

#[test]
fn a_file_in_which_everything_is_flagged_missing_is_copied_and_explained() {
    let lab = Lab::new();
    lab.write("flagged.c3d", with_fourth_words(&lab.read("walk-truth.c3d"), -1.0));
    let ran = lab.run(&["flagged.c3d", "-o", "out.c3d"]).with_code(3);
    assert!(lab.read("out.c3d") == lab.read("flagged.c3d"));
    assert!(ran.out.contains("41 gaps left open: the marker never appears"), "{}", ran.out);
    let explained = format!("all {} samples are flagged missing although {} hold coordinates", 41 * FRAMES, 41 * FRAMES);
    let told = ran.sentences();
    assert!(told.contains(&explained) && told.contains("export it again with its residuals"), "{told}");
}

#[test]
fn inspect_tells_what_is_there_and_goes_on_after_a_failure() {
    let lab = Lab::new();
    let before = lab.listing();
    let holes = missing(&lab.take("walk-gaps.c3d")).len();
    let ran = lab.run(&["inspect", "walk-gaps.c3d", "none.c3d", "walk-truth.csv"]);
    assert_eq!(ran.code, 1);
    assert_eq!(ran.err, "mocap-repair: none.c3d: cannot be read: no such file or folder\n");
    assert!(ran.out.starts_with("walk-gaps.c3d\n") && ran.out.contains("\nwalk-truth.csv\n"), "{}", ran.out);
    assert!(ran.out.contains(&format!("{holes} of {} samples missing", 41 * FRAMES)), "{}", ran.out);

    let messages = lab.run(&["inspect", "--json", "walk-gaps.c3d", "walk-truth.csv"]).with_code(0).messages();
    let missing: Vec<_> = messages.iter().map(|m| (m["message_type"].as_str().unwrap(), m["samples_missing"].as_u64().unwrap())).collect();
    assert_eq!(missing, [("inspect", holes as u64), ("inspect", 0)]);
    assert!(lab.new_since(&before).is_empty());
}

#[test]
fn help_and_version_go_to_standard_output() {
    let lab = Lab::empty();
    let ran = lab.run(&["--help"]).with_code(0);
    assert!(ran.out.contains("Usage: mocap-repair") && ran.out.contains("Exit codes:"), "{}", ran.out);
    let ran = lab.run(&["--version"]).with_code(0);
    assert_eq!(ran.out, concat!("mocap-repair ", env!("CARGO_PKG_VERSION"), "\n"));
}
