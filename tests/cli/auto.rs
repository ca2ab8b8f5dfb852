//! `auto` at work: what it says about its fills, and where.

use crate::lab::{FRAMES, Lab, column, missing};
use mocap_repair::demo::hide;
use serde_json::Value;

/// Two gaps inside, with all neighbours there, and one at the end.
fn lab() -> Lab {
    let lab = Lab::new();
    let mut take = lab.take("walk-truth.c3d");
    for (marker, frames) in [("LKNE", 30..55), ("RFIN", 80..90), ("LKNE", 100..110), ("C7", 140..FRAMES)] {
        take = hide(&take, marker, frames);
    }
    lab.create("gaps.c3d", &take);
    lab
}

/// The stages of a run, from the messages of its `--json`.
fn stages(summary: &Value) -> Vec<(&str, &str)> {
    let stages = summary["stages"].as_array().unwrap();
    stages.iter().map(|stage| (stage["method"].as_str().unwrap(), stage["stop"].as_str().unwrap())).collect()
}

/// The explanation of a gap, after all that must hold for each was checked.
#[track_caller]
fn checked(gap: &Value) -> &Value {
    let parts = gap["explanation"].as_array().unwrap();
    assert_eq!(parts.len(), 1, "{gap}");
    let part = &parts[0];
    assert_eq!((&part["first_frame"], &part["last_frame"]), (&gap["first_frame"], &gap["last_frame"]));
    assert!(part["simulated_gaps"].as_u64().unwrap() >= 4 && part["simulated_frames"] == gap["frames"], "{part}");
    assert!(part["predicted_mm"].as_f64().unwrap() > 0.0, "{part}");
    let neighbours = part["neighbours"].as_array().unwrap();
    assert!(neighbours.len() > 20 && !neighbours.contains(&gap["marker"]), "{part}");
    let experts = part["experts"].as_array().unwrap();
    let shares: Vec<f64> = experts.iter().map(|e| e["share"].as_f64().unwrap()).collect();
    assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-6 && shares.windows(2).all(|w| w[0] >= w[1] && w[1] > 0.0), "{part}");
    assert!(experts.iter().all(|e| !e["expert"].as_str().unwrap().is_empty() && e["error_mm"].as_f64().unwrap() > 0.0), "{part}");
    part
}

#[test]
fn explain_prints_who_filled_each_gap() {
    let lab = lab();
    let explained = lab.run(&["gaps.c3d", "-o", "walk.c3d", "--explain"]).with_code(3).sentences();
    let plain = lab.run(&["gaps.c3d", "-o", "walk.c3d", "--force"]).with_code(3).sentences();
    let added: Vec<&str> = explained.lines().filter(|line| !plain.lines().any(|other| other == *line)).collect();
    let heads: Vec<&str> = added.iter().copied().filter(|line| line.starts_with("gap ")).collect();
    let gaps: Vec<(&str, &str)> = heads.iter().map(|line| line.split_once(": ").unwrap()).collect();
    let (start, more) = (("gap 2", "LKNE, 31 to 55, 25 frames"), ("gap 3", "LKNE, 101 to 110, 10 frames"));
    assert!(gaps.contains(&start) && gaps.contains(&more), "{explained}");
    let open: Vec<_> = heads.iter().filter(|head| head.contains("left open: ")).collect();
    assert_eq!((gaps.len(), open.len()), (4, 1), "{explained}");
    assert!(open[0].contains(": C7, 141 to 150, 10 frames, left open: reaches the first or last frame"), "{}", open[0]);

    let own: Vec<&str> =
        explained.lines().skip_while(|line| !line.starts_with("gap 2: ")).skip(1).take_while(|l| l.starts_with("  ")).collect();
    assert!(own[0].starts_with("  frames     31 to 55: predicted error ") && own[0].ends_with(" simulated gaps of 25 frames"), "{own:?}");
    assert!(own[1].starts_with("  neighbours ") && own[1].contains(" more") && !own[1].contains("LKNE"), "{own:?}");
    assert!(own[1].contains("LTHI") || own[1].contains("LSHN"), "a knee's neighbours are on the leg: {own:?}");
    let shares = own[2..].iter().map(|line| {
        let (share, rest) = line.split_once(" %      ").unwrap();
        assert!(rest.ends_with(" mm on simulated gaps"), "{line}");
        share.trim().parse::<u32>().unwrap()
    });
    let shares: Vec<u32> = shares.collect();
    assert!(shares.len() == 5 && shares.windows(2).all(|w| w[0] >= w[1]) && shares.iter().sum::<u32>() <= 102, "{own:?}");

    // methods that have nothing to say say nothing
    let spline = lab.run(&["gaps.c3d", "-o", "spline.c3d", "--method", "spline", "--explain"]).with_code(3).out;
    assert!(spline.contains("gap 1: ") && !spline.contains("neighbours"), "{spline}");
}

#[test]
fn json_and_the_log_explain_every_filled_gap() {
    let lab = lab();
    let messages = lab.run(&["gaps.c3d", "-o", "walk.c3d", "--json"]).with_code(3).messages();
    let (summary, gaps) = messages.split_last().unwrap();
    assert_eq!(stages(summary).iter().map(|s| s.0).collect::<Vec<_>>(), ["bolero-sc", "auto"]);
    assert_eq!(stages(summary)[1].1, "complete");
    let filled: Vec<&Value> = gaps.iter().filter(|gap| gap["open"].is_null()).collect();
    assert_eq!((gaps.len(), filled.len()), (4, 3));
    for gap in filled {
        checked(gap);
    }
    let open = gaps.iter().find(|gap| !gap["open"].is_null()).unwrap();
    assert_eq!((&open["marker"], &open["open"]), (&"C7".into(), &"at-end".into()));
    assert!(open["explanation"].as_array().is_none_or(Vec::is_empty), "{open}");

    let log = lab.read("walk.mcap");
    let index = mcap::Summary::read(&log).unwrap().unwrap();
    let metadata = mcap::read::metadata(&log, &index.metadata_indexes[0]).unwrap().metadata;
    for (key, value) in
        [("stages", "2"), ("method", "auto"), ("stage.0.method", "bolero-sc"), ("stage.1.method", "auto"), ("stage.1.steps", "3")]
    {
        assert_eq!(metadata.get(key).map(String::as_str), Some(value), "{key}");
    }
    let attached: Vec<_> = index.attachment_indexes.iter().map(|at| mcap::read::attachment(&log, at).unwrap()).collect();
    let table = attached.iter().find(|a| a.name == "report.jsonl").unwrap();
    let mut rows: Vec<Value> = std::str::from_utf8(&table.data).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(rows.pop().unwrap()["message_type"], "summary");
    assert_eq!(rows, gaps, "the log tells what --json tells");
    assert_eq!(table.media_type, "application/jsonl");
}

#[test]
fn whatever_is_less_sure_than_asked_for_stays_open() {
    let lab = lab();
    let before = lab.take("gaps.c3d");
    let ran = lab.run(&["gaps.c3d", "-o", "none.c3d", "--max-sigma", "0.0001", "--extrapolate", "--json"]).with_code(3);
    let messages = ran.messages();
    let (summary, gaps) = messages.split_last().unwrap();
    assert!(gaps.len() == 4 && gaps.iter().all(|gap| gap["open"] == "too-unsure"), "{}", ran.out);
    assert_eq!((&summary["gaps_left_open"], &summary["samples_filled"]), (&4.into(), &0.into()));
    assert!(lab.read("none.c3d") == lab.read("gaps.c3d"), "nothing was filled, so nothing is another byte");

    // a bound between the predictions of gaps leaves the less sure ones open, whole
    let messages = lab.run(&["gaps.c3d", "-o", "all.c3d", "--extrapolate", "--json", "--fills", "fills.csv"]).with_code(0).messages();
    assert!(messages.iter().all(|gap| gap["open"].is_null()));
    let fills = lab.text("fills.csv");
    let rows: Vec<Vec<&str>> = fills.lines().skip(1).map(|row| row.split(',').collect()).collect();
    let worst = |gap: usize| {
        let own = rows.iter().filter(|row| row[7] == gap.to_string()).map(|row| row[6].parse::<f64>().unwrap());
        own.fold(0.0, f64::max)
    };
    let mut sigmas: Vec<f64> = (1..=4).map(worst).collect();
    sigmas.sort_by(f64::total_cmp);
    let bound = f64::midpoint(sigmas[1], sigmas[2]).to_string();
    let messages = lab.run(&["gaps.c3d", "-o", "some.c3d", "--extrapolate", "--json", "--max-sigma", &bound]).with_code(3).messages();
    let after = lab.take("some.c3d");
    for (k, gap) in messages.iter().filter(|m| m["message_type"] == "gap").enumerate() {
        let filled = worst(k + 1) <= bound.parse().unwrap();
        assert_eq!(gap["open"].is_null(), filled, "{gap}");
        let marker = column(&after, gap["marker"].as_str().unwrap());
        let [first, last] = ["first_frame", "last_frame"].map(|key| gap[key].as_u64().unwrap() as usize - 1);
        assert!(
            (first..=last).all(|t| after.position_mm(t, marker).is_some() == filled && before.position_mm(t, marker).is_none()),
            "{gap}"
        );
    }
    assert!(!missing(&after).is_empty() && missing(&after).len() < missing(&before).len());

    let told = lab.run(&["gaps.c3d", "-o", "told.c3d", "--max-sigma", "0.0001"]).with_code(3).out;
    assert!(told.contains("3 gaps left open: less sure than --max-sigma"), "{told}");
    for (method, text) in [("linear", "0.5"), ("auto", "0"), ("auto", "-1"), ("auto", "sure")] {
        let ran = lab.run(&["gaps.c3d", "-o", "x.c3d", "--method", method, "--max-sigma", text]);
        // who cannot say how sure it is is never sure enough; and what is no bound is no command
        assert_eq!(ran.code, if method == "linear" { 3 } else { 2 }, "{method} {text}: {}{}", ran.out, ran.err);
    }
}
