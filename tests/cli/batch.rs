//! Many takes: planned, repaired, put aside, accounted for, and gone on with after whatever happened.

use crate::lab::{Lab, Ran};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Files below a folder by their path, without what a batch keeps about running.
pub type Tree = BTreeMap<String, Vec<u8>>;

pub const OWN: &str = ".mocap-repair";

#[track_caller]
pub fn tree(folder: &Path) -> Tree {
    let mut found = Tree::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inside) = folders.pop() {
        for entry in std::fs::read_dir(&inside).unwrap() {
            let path = entry.unwrap().path();
            if path.file_name().unwrap() == OWN {
                continue;
            }
            if path.is_dir() {
                folders.push(path);
            } else {
                found.insert(path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned(), std::fs::read(&path).unwrap());
            }
        }
    }
    found
}

/// All records of all ledgers of an output folder, by the ledger's name.
#[track_caller]
pub fn records(out: &Path) -> Vec<(String, Value)> {
    let mut ledgers: Vec<_> = std::fs::read_dir(out.join(OWN).join("ledger")).unwrap().map(|e| e.unwrap().path()).collect();
    ledgers.sort();
    let lines = ledgers.iter().flat_map(|path| {
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let text = std::fs::read_to_string(path).unwrap();
        text.lines().map(|line| (name.clone(), line.to_owned())).collect::<Vec<_>>()
    });
    lines.filter_map(|(name, line)| Some((name, serde_json::from_str(&line).ok()?))).collect()
}

/// The takes of these records, by what became of them.
pub fn outcomes(records: &[(String, Value)]) -> Vec<(String, String)> {
    let takes = records.iter().filter(|(_, record)| record["message_type"] == "take");
    let mut all: Vec<_> =
        takes.map(|(_, record)| (record["path"].as_str().unwrap().to_owned(), record["outcome"].as_str().unwrap().to_owned())).collect();
    all.sort();
    all
}

/// A lab with a folder `in` of takes: good ones in two folders, and one that is cut off. Options that are quick are in `quick.toml`.
pub fn studio() -> Lab {
    let lab = Lab::new();
    for (to, from) in
        [("in/Day 1/walk.c3d", "walk-gaps.c3d"), ("in/Day 1/Größe.csv", "walk-gaps.csv"), ("in/Day 2/walk.c3d", "walk-truth.c3d")]
    {
        put(&lab, to, &lab.read(from));
    }
    put(&lab, "in/Day 2/cut.c3d", &lab.read("walk-gaps.c3d")[..5000]);
    put(&lab, "in/Day 2/notes.docx", b"no take");
    lab.write("quick.toml", "method = \"linear\"\n");
    lab
}

pub fn put(lab: &Lab, name: &str, bytes: &[u8]) {
    std::fs::create_dir_all(lab.path(name).parent().unwrap()).unwrap();
    lab.write(name, bytes);
}

#[track_caller]
pub fn plan(lab: &Lab, more: &[&str]) -> Ran {
    lab.run(&[&["batch", "plan", "in", "-o", "plan.jsonl", "--config", "quick.toml", "--force"], more].concat())
}

pub fn run(lab: &Lab, more: &[&str]) -> Ran {
    lab.run(&[&["batch", "run", "plan.jsonl", "--out", "out", "--quiet"], more].concat())
}

#[test]
fn every_take_is_repaired_as_if_it_were_the_only_one() {
    let lab = studio();
    let told = plan(&lab, &["--reports", "--fills"]).with_code(0);
    assert!(told.out.contains("4 takes") && told.sentences().contains("files that are no takes: .docx 1"), "{}", told.out);
    let before = tree(&lab.path("in"));
    let told = lab.run(&["batch", "run", "plan.jsonl", "--out", "out"]);
    assert_eq!(told.code, 3, "{told:?}");
    assert!(told.out.contains("4 takes: 3 repaired, 1 put aside"), "{}", told.out);
    assert!(told.err.contains("Day 2/cut.c3d: put aside: c3d: "), "{}", told.err);
    assert_eq!(tree(&lab.path("in")), before, "inputs are only read");
    let after = tree(&lab.path("out"));
    let mut expected = Vec::new();
    for take in ["Day 1/Größe.csv", "Day 1/walk.c3d", "Day 2/walk.c3d"] {
        expected.extend(["", ".fills.csv", ".html", ".mcap", ".repair.json"].map(|extension| format!("{take}{extension}")));
    }
    assert_eq!(after.keys().map(String::as_str).collect::<Vec<_>>(), expected);
    std::fs::create_dir(lab.path("alone")).unwrap();
    let output = ["alone/walk.c3d", "alone/walk.c3d.mcap", "alone/walk.c3d.html", "alone/walk.c3d.fills.csv"];
    lab.run(&[
        "in/Day 1/walk.c3d",
        "-o",
        output[0],
        "--log",
        output[1],
        "--report",
        output[2],
        "--fills",
        output[3],
        "--config",
        "quick.toml",
        "--quiet",
    ]);
    for name in output {
        let name = name.trim_start_matches("alone/");
        assert!(after[&format!("Day 1/{name}")] == lab.read(&format!("alone/{name}")), "{name} differs from that of the take alone");
    }
    let sidecar: Value = serde_json::from_slice(&after["Day 1/walk.c3d.repair.json"]).unwrap();
    assert_eq!(sidecar["path"], "Day 1/walk.c3d");
    assert_eq!(sidecar["summary"]["samples_missing"], sidecar["summary"]["samples_filled"]);
    let missing: u64 = sidecar["markers"].as_array().unwrap().iter().map(|m| m["missing"].as_u64().unwrap()).sum();
    assert_eq!(Some(missing), sidecar["summary"]["samples_missing"].as_u64());
    assert!(missing > 0);
}

#[test]
fn what_is_done_is_not_done_again_and_what_is_damaged_is() {
    let lab = studio();
    plan(&lab, &[]).with_code(0);
    assert_eq!(run(&lab, &[]).code, 3);
    let first = tree(&lab.path("out"));
    assert_eq!(run(&lab, &[]).code, 3);
    let seen = records(&lab.path("out"));
    let again: Vec<_> = seen.iter().filter(|(name, _)| name.ends_with("-0002.jsonl")).cloned().collect();
    assert_eq!(
        outcomes(&again).iter().map(|(_, outcome)| outcome.as_str()).collect::<Vec<_>>(),
        ["skipped", "skipped", "quarantined", "skipped"]
    );
    assert!(again.iter().all(|(_, record)| record["tries"].as_array().is_none_or(Vec::is_empty)), "nothing ran");
    assert_eq!(tree(&lab.path("out")), first);

    // a byte of an output, a log, a sidecar: what is damaged comes back
    for damaged in ["Day 1/walk.c3d", "Day 1/walk.c3d.mcap", "Day 1/walk.c3d.repair.json"] {
        let mut bytes = first[damaged].clone();
        let at = bytes.len() / 2;
        bytes[at] ^= 1;
        lab.write(&format!("out/{damaged}"), &bytes);
        assert_eq!(run(&lab, &[]).code, 3);
        assert!(tree(&lab.path("out")) == first, "{damaged} was not mended");
        let done = outcomes(&records(&lab.path("out"))).iter().filter(|(_, outcome)| outcome == "done").count();
        assert!(done > 3, "{damaged}");
    }
    std::fs::remove_file(lab.path("out/Day 2/walk.c3d")).unwrap();
    assert_eq!(run(&lab, &[]).code, 3);
    assert!(tree(&lab.path("out")) == first);

    // other options make other takes, and take away what is not wanted any more
    plan(&lab, &["--reports"]).with_code(0);
    run(&lab, &[]);
    assert!(lab.path("out/Day 1/walk.c3d.html").exists());
    lab.write("quick.toml", "method = \"spline\"\n");
    plan(&lab, &[]).with_code(0);
    run(&lab, &[]);
    let other = tree(&lab.path("out"));
    assert!(!other.contains_key("Day 1/walk.c3d.html") && other["Day 1/walk.c3d"] != first["Day 1/walk.c3d"]);
}

#[test]
fn bad_takes_are_put_aside_once_and_tried_again_when_asked_for() {
    let lab = studio();
    put(&lab, "in/empty.csv", b"");
    put(&lab, "in/text.c3d", b"This is no take.");
    let table = lab.text("walk-gaps.csv");
    let columns = table.lines().next().unwrap().matches(',').count();
    let unseen: Vec<String> = table
        .lines()
        .enumerate()
        .map(|(at, line)| match at {
            0 => line.to_owned(),
            _ => format!("{}{}", line.split(',').next().unwrap(), ",".repeat(columns)),
        })
        .collect();
    put(&lab, "in/unseen.csv", (unseen.join("\n") + "\n").as_bytes());
    plan(&lab, &[]).with_code(0);
    assert_eq!(run(&lab, &[]).code, 3);
    let seen = records(&lab.path("out"));
    let aside: BTreeMap<String, Value> = seen
        .iter()
        .filter(|(_, record)| record["outcome"] == "quarantined")
        .map(|(_, record)| (record["path"].as_str().unwrap().to_owned(), record.clone()))
        .collect();
    for (path, why) in [
        ("Day 2/cut.c3d", "cut off"),
        ("empty.csv", "the file is empty"),
        ("text.c3d", "it holds text"),
        ("unseen.csv", "no marker was ever seen"),
    ] {
        let record = &aside[path];
        assert!(record["reason"].as_str().unwrap().contains(why), "{record}");
        assert_eq!((record["exit_code"].as_u64(), record["tries"].as_array().unwrap().len()), (Some(65), 1), "{record}");
    }
    assert_eq!(aside.len(), 4);
    let tries = |lab: &Lab| {
        records(&lab.path("out"))
            .iter()
            .filter(|(_, r)| r["outcome"] == "quarantined" && !r["tries"].as_array().unwrap().is_empty())
            .count()
    };
    run(&lab, &[]);
    assert_eq!(tries(&lab), 4, "never again ...");
    run(&lab, &["--retry"]);
    assert_eq!(tries(&lab), 8, "... unless it is asked for");
    let told = lab.run(&["batch", "status", "out"]).with_code(3);
    assert!(told.out.contains("put aside  4") && told.out.contains("text.c3d: "), "{}", told.out);
    let told = lab.run(&["batch", "status", "out", "--json"]).with_code(3).messages();
    let status = told.last().unwrap();
    assert_eq!((&status["takes"], &status["done"], &status["open"]), (&7.into(), &3.into(), &0.into()), "{status}");

    // another file of that name is another take
    put(&lab, "in/empty.csv", table.as_bytes());
    assert_eq!(run(&lab, &[]).code, 1);
    let seen = records(&lab.path("out"));
    let (_, changed) = seen.iter().rev().find(|(_, record)| record["path"] == "empty.csv").unwrap();
    assert_eq!(changed["outcome"], "failed", "it is not what was planned: {changed}");
    plan(&lab, &[]).with_code(0);
    run(&lab, &[]);
    assert!(lab.path("out/empty.csv").exists());
}

#[test]
fn shards_make_one_tree() {
    let lab = studio();
    plan(&lab, &[]).with_code(0);
    run(&lab, &[]);
    let whole = tree(&lab.path("out"));
    let mut takes = 0;
    for shard in ["0/3", "1/3", "2/3"] {
        let told = lab.run(&["batch", "run", "plan.jsonl", "--out", "parts", "--shard", shard, "--json"]).messages();
        let ended = told.last().unwrap();
        assert_eq!(ended["message_type"], "run_ended");
        takes += ["done", "quarantined"].iter().map(|what| ended[what].as_u64().unwrap()).sum::<u64>();
    }
    assert_eq!(takes, 4);
    assert!(tree(&lab.path("parts")) == whole);
    lab.run(&["batch", "run", "plan.jsonl", "--out", "parts", "--shard", "3/3"]).code.eq(&2).then_some(()).unwrap();
    let told = lab.run(&["batch", "status", "parts"]).with_code(3);
    assert!(told.out.contains("shard 2/3") && told.out.contains("4 takes"), "{}", told.out);
}

#[test]
fn nobody_elses_file_is_replaced() {
    let lab = studio();
    plan(&lab, &[]).with_code(0);
    put(&lab, "out/Day 1/walk.c3d", b"mine");
    assert_eq!(run(&lab, &[]).code, 1, "somebody has to do something first");
    assert_eq!(lab.read("out/Day 1/walk.c3d"), b"mine");
    let seen = records(&lab.path("out"));
    let (_, record) = seen.iter().find(|(_, record)| record["path"] == "Day 1/walk.c3d").unwrap();
    assert!(record["outcome"] == "failed" && record["reason"].as_str().unwrap().contains("does not come from a batch"), "{record}");
    assert_eq!(run(&lab, &["--force"]).code, 3);
    assert_ne!(lab.read("out/Day 1/walk.c3d"), b"mine");

    let told = lab.run(&["batch", "run", "plan.jsonl", "--out", "in"]);
    assert!(told.code == 1 && told.err.contains("choose another --out"), "{told:?}");
    // outputs are no inputs
    put(&lab, "in/results/x.c3d", &lab.read("walk-gaps.c3d"));
    std::fs::create_dir(lab.path("in/results/.mocap-repair")).unwrap();
    let told = plan(&lab, &[]).with_code(0);
    assert!(told.out.contains("4 takes") && told.sentences().contains("which is the output of a batch"), "{}", told.out);
}

#[test]
fn what_changed_since_it_was_planned_is_not_repaired() {
    let lab = studio();
    plan(&lab, &[]).with_code(0);
    put(&lab, "in/Day 1/walk.c3d", &lab.read("walk-truth.c3d"));
    assert_eq!(run(&lab, &[]).code, 1);
    assert!(!lab.path("out/Day 1/walk.c3d").exists());
    let seen = records(&lab.path("out"));
    let (_, record) = seen.iter().find(|(_, record)| record["path"] == "Day 1/walk.c3d").unwrap();
    assert!(record["outcome"] == "failed" && record["reason"].as_str().unwrap().contains("plan again"), "{record}");
    // a time that changed and a content that did not is fine
    plan(&lab, &[]).with_code(0);
    put(&lab, "in/Day 1/walk.c3d", &lab.read("in/Day 1/walk.c3d"));
    run(&lab, &[]);
    assert!(lab.path("out/Day 1/walk.c3d").exists());
}

#[test]
fn a_take_that_takes_too_long_or_too_much_costs_only_itself() {
    let lab = studio();
    lab.run(&["demo", "-o", "long", "--frames", "6000"]).with_code(0);
    std::fs::copy(lab.path("long/walk-gaps.c3d"), lab.path("in/long.c3d")).unwrap();
    lab.write("quick.toml", "hidden = 32\nmethod = \"lds\"\ntolerance = 1e-12\niterations = 100000\n");
    lab.write("in/Day 2/cut.c3d", b"");
    for name in ["in/Day 1/Größe.csv", "in/Day 2/cut.c3d", "in/Day 1/walk.c3d"] {
        std::fs::remove_file(lab.path(name)).unwrap();
    }
    plan(&lab, &[]).with_code(0);
    assert_eq!(run(&lab, &["--timeout", "1s"]).code, 3);
    let seen = records(&lab.path("out"));
    let (_, record) = seen.iter().find(|(_, record)| record["path"] == "long.c3d").unwrap();
    assert_eq!(record["outcome"], "quarantined", "{record}");
    let tries = record["tries"].as_array().unwrap();
    assert!(tries.len() == 4 && tries.iter().all(|one| one["ended"] == "timeout"), "three more: {record}");
    assert!(lab.path("out/Day 2/walk.c3d").exists(), "the other one is there");
    if cfg!(target_os = "linux") {
        assert_eq!(run(&lab, &["--retry", "--memory", "40M"]).code, 3);
        let seen = records(&lab.path("out"));
        let (_, record) = seen.iter().rev().find(|(_, record)| record["path"] == "long.c3d").unwrap();
        assert!(record["reason"].as_str().unwrap().contains("took more than 41.9 MB"), "{record}");
        assert!(record["tries"].as_array().unwrap().len() <= 2, "alone it has all there is: {record}");
    }
    assert!(std::fs::read_dir(lab.path("out/.mocap-repair/staging")).unwrap().next().is_none(), "nothing is left");
}

#[test]
fn if_most_of_the_first_takes_fail_something_else_is_wrong() {
    let lab = Lab::empty();
    for k in 0..60 {
        put(&lab, &format!("in/{k}.c3d"), format!("no take {k}").as_bytes());
    }
    lab.write("quick.toml", "method = \"linear\"\n");
    plan(&lab, &[]).with_code(0);
    let told = lab.run(&["batch", "run", "plan.jsonl", "--out", "out", "--jobs", "1"]);
    assert!(told.code == 1 && told.sentences().contains("41 of the first 41 takes failed"), "{told:?}");
    assert_eq!(outcomes(&records(&lab.path("out"))).len(), 41);
    assert_eq!(run(&lab, &["--keep-going"]).code, 3);
    assert_eq!(lab.run(&["batch", "status", "out", "--json"]).messages().last().unwrap()["quarantined"], 60);
}

#[test]
fn names_that_would_be_one_get_names_of_their_own() {
    let lab = Lab::new();
    let take = lab.read("walk-gaps.c3d");
    let long = format!("{}.c3d", "x".repeat(240));
    for name in ["A/walk.c3d", "A/Walk.c3d", "a/WALK.C3D", "mü.c3d", "mu\u{308}.c3d", long.as_str(), "50% #1.c3d"] {
        put(&lab, &format!("in/{name}"), &take);
    }
    #[cfg(target_os = "linux")]
    {
        use std::os::unix::ffi::OsStrExt;
        std::fs::write(lab.path("in").join(std::ffi::OsStr::from_bytes(b"no\xfftext.c3d")), &take).unwrap();
    }
    lab.write("quick.toml", "method = \"linear\"\n");
    let told = plan(&lab, &["--json"]);
    let renamed: Vec<_> = told.messages().into_iter().filter(|m| m["message_type"] == "renamed").collect();
    assert_eq!(renamed.len(), 4, "{renamed:?}");
    assert_eq!(run(&lab, &[]).code, 3 * i32::from(cfg!(target_os = "linux")));
    let outputs: Vec<String> = tree(&lab.path("out")).into_keys().collect();
    let mut folded: Vec<String> = outputs.iter().map(|name| name.to_lowercase()).collect();
    folded.sort();
    folded.dedup();
    assert_eq!(folded.len(), outputs.len());
    assert_eq!(outputs.iter().filter(|name| name.ends_with(".repair.json")).count(), 7);
    if cfg!(target_os = "linux") {
        let seen = records(&lab.path("out"));
        let (_, record) = seen.iter().find(|(_, record)| record["outcome"] == "quarantined").unwrap();
        assert!(record["reason"].as_str().unwrap().contains("not UTF-8"), "{record}");
    }
}

#[test]
fn plans_that_cannot_be_run_are_refused() {
    let lab = studio();
    let refused = |arguments: &[&str], code: i32, why: &str| {
        let told = lab.run(arguments);
        assert!(told.code == code && told.err.contains(why), "{arguments:?}: {told:?}");
    };
    refused(&["batch", "plan", "nowhere", "-o", "plan.jsonl"], 1, "no such file or folder");
    std::fs::create_dir(lab.path("nothing")).unwrap();
    refused(&["batch", "plan", "nothing", "-o", "plan.jsonl"], 1, "takes end in .bvh, .c3d");
    lab.write("single.toml", "fills = \"x.csv\"\n");
    refused(&["batch", "plan", "in", "-o", "plan.jsonl", "--config", "single.toml"], 2, "a batch has --fills");
    refused(
        &["batch", "plan", "s3://bucket/takes", "-o", "plan.jsonl"],
        1,
        if cfg!(feature = "cloud") { "s3://" } else { "--features cloud" },
    );
    refused(&["batch", "run", "walk-gaps.csv", "--out", "out"], 1, "is no plan of a batch");
    refused(&["batch", "status", "in"], 1, "holds no batch");
    plan(&lab, &[]).with_code(0);
    refused(&["batch", "plan", "in", "-o", "plan.jsonl"], 1, "--force");
    let text = lab.text("plan.jsonl");
    let cut: Vec<&str> = text.lines().take(3).collect();
    lab.write("cut.jsonl", cut.join("\n") + "\n");
    refused(&["batch", "run", "cut.jsonl", "--out", "out"], 1, "has 2 takes, its first line says 4");
    lab.write("old.jsonl", text.replacen(env!("CARGO_PKG_VERSION"), "0.0.1", 1));
    refused(&["batch", "run", "old.jsonl", "--out", "out"], 1, "plan again");
    refused(&["batch", "run", "plan.jsonl", "--out", "out", "--engine", "ray", "--python", "nowhere/python"], 1, "--python");
    assert!(!lab.path("out/Day 1").exists());
}

#[test]
fn lists_patterns_and_several_folders_are_sources() {
    let lab = studio();
    let paths = |lab: &Lab| -> Vec<String> {
        let text = lab.text("plan.jsonl");
        let mut paths: Vec<String> =
            text.lines().skip(1).map(|line| serde_json::from_str::<Value>(line).unwrap()["output"].as_str().unwrap().to_owned()).collect();
        paths.sort();
        paths
    };
    lab.run(&["batch", "plan", "in/*/walk.c3d", "-o", "plan.jsonl"]).with_code(0);
    assert_eq!(paths(&lab), ["Day 1/walk.c3d", "Day 2/walk.c3d"]);
    lab.run(&["batch", "plan", "in/Day 1", "in/Day 2", "in/Day 2/walk.c3d", "-o", "plan.jsonl", "--force"]).with_code(0);
    assert_eq!(paths(&lab), ["Day 1/Größe.csv", "Day 1/walk.c3d", "Day 2/cut.c3d", "Day 2/walk.c3d"]);
    lab.write("list.txt", "# two takes\nin/Day 1/walk.c3d\n\nin/Day 2/walk.c3d\n");
    lab.run(&["batch", "plan", "--list", "list.txt", "-o", "plan.jsonl", "--force"]).with_code(0);
    assert_eq!(paths(&lab), ["Day 1/walk.c3d", "Day 2/walk.c3d"]);
    let file = format!("file://{}/in/Day%201", lab.folder().display());
    lab.run(&["batch", "plan", &file, "-o", "plan.jsonl", "--force"]).with_code(0);
    assert_eq!(paths(&lab), ["Größe.csv", "walk.c3d"]);
    // the same sources make the same plan
    let first = lab.text("plan.jsonl");
    lab.run(&["batch", "plan", &file, "-o", "plan.jsonl", "--force"]).with_code(0);
    assert_eq!(lab.text("plan.jsonl"), first);
}
