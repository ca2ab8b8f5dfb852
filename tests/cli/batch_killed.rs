//! Batches that are ended from outside, watched folders, and two runs at once.
#![cfg(unix)]

use crate::batch::{outcomes, plan, put, records, run, studio, tree};
use crate::lab::Lab;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// Waits until something is there.
#[track_caller]
fn wait_for(what: &str, there: impl Fn() -> bool) {
    let begun = Instant::now();
    while !there() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{what}: not there after a minute");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn start(lab: &Lab, arguments: &[&str]) -> Child {
    lab.command(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// A studio with a dozen takes, and options that take a while.
fn busy() -> Lab {
    let lab = studio();
    lab.write("quick.toml", "method = \"lds\"\niterations = 40\ntolerance = 1e-12\n");
    for k in 0..8 {
        put(&lab, &format!("in/more/{k}.c3d"), &lab.read("walk-gaps.c3d"));
    }
    lab
}

#[test]
fn a_killed_run_goes_on_and_makes_the_same_tree() {
    let lab = busy();
    plan(&lab, &[]).with_code(0);
    let undisturbed = lab.run(&["batch", "run", "plan.jsonl", "--out", "undisturbed", "--quiet"]);
    assert_eq!(undisturbed.code, 3);
    let whole = tree(&lab.path("undisturbed"));
    for round in 1..=4u64 {
        let mut child = start(&lab, &["batch", "run", "plan.jsonl", "--out", "out", "--jobs", "2"]);
        // at one moment and another of the takes that run
        let ledger = lab.path("out/.mocap-repair/ledger");
        wait_for("a ledger", || std::fs::read_dir(&ledger).is_ok_and(|found| found.count() as u64 >= round));
        std::thread::sleep(Duration::from_millis(70 * round));
        let _ = child.kill();
        child.wait().unwrap();
    }
    assert_eq!(run(&lab, &[]).code, 3);
    assert!(tree(&lab.path("out")) == whole, "the trees differ: {:?}", tree(&lab.path("out")).keys());
    assert!(std::fs::read_dir(lab.path("out/.mocap-repair/staging")).unwrap().next().is_none(), "temporary files are left");
    // whatever was done before a kill was not done again
    let done = outcomes(&records(&lab.path("out"))).into_iter().filter(|(_, outcome)| outcome == "done").map(|(path, _)| path);
    let done: Vec<String> = done.collect();
    let mut once = done.clone();
    once.dedup();
    assert_eq!(done, once);
}

#[test]
fn processes_of_takes_end_with_their_run() {
    let lab = busy();
    lab.write("quick.toml", "method = \"lds\"\nhidden = 32\niterations = 100000\ntolerance = 1e-300\n");
    plan(&lab, &[]).with_code(0);
    let mut child = start(&lab, &["batch", "run", "plan.jsonl", "--out", "out", "--jobs", "2"]);
    let work = lab.path("out/.mocap-repair/staging");
    let count = || walk(&work);
    wait_for("work", || count() >= 2);
    let own = lab.path("out");
    assert!(running(own.to_str().unwrap()), "this test would see nothing");
    child.kill().unwrap();
    child.wait().unwrap();
    // a process that goes on would go on writing its log
    wait_for("an end", || !running(own.to_str().unwrap()));
}

/// Number of files below a folder.
fn walk(folder: &std::path::Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    entries.flatten().map(|entry| if entry.path().is_dir() { walk(&entry.path()) } else { 1 }).sum()
}

/// True if some process has a file below the folder open.
fn running(folder: &str) -> bool {
    let Ok(processes) = std::fs::read_dir("/proc") else { return false };
    processes.flatten().any(|process| {
        let open = std::fs::read_dir(process.path().join("fd"));
        open.is_ok_and(|open| {
            open.flatten().any(|fd| std::fs::read_link(fd.path()).is_ok_and(|to| to.to_string_lossy().starts_with(folder)))
        })
    })
}

#[test]
fn an_interrupt_brings_home_what_runs() {
    let lab = busy();
    plan(&lab, &[]).with_code(0);
    let mut child = start(&lab, &["batch", "run", "plan.jsonl", "--out", "out", "--jobs", "1"]);
    wait_for("work", || walk(&lab.path("out/.mocap-repair/staging")) > 0);
    let pid = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(75));
    let seen = records(&lab.path("out"));
    assert_eq!(seen.last().unwrap().1["stop"], "interrupted");
    let done = outcomes(&seen);
    assert!(!done.is_empty() && done.len() < 12 && done.iter().all(|(_, outcome)| outcome != "failed"), "{done:?}");
    assert_eq!(lab.run(&["batch", "status", "out", "--json"]).messages().last().unwrap()["open"], 12 - done.len());
}

#[test]
fn two_runs_of_one_shard_do_not_disturb_each_other() {
    let lab = busy();
    plan(&lab, &[]).with_code(0);
    let mut child = start(&lab, &["batch", "run", "plan.jsonl", "--out", "out", "--jobs", "1"]);
    wait_for("work", || walk(&lab.path("out/.mocap-repair/staging")) > 0);
    let told = run(&lab, &[]);
    assert!(told.code == 75 && told.err.contains("works on 0-of-1; wait until it has ended"), "{told:?}");
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(run(&lab, &[]).code, 3, "the lock goes with the process");
}

#[test]
fn a_watched_folder_is_repaired_as_takes_come() {
    let lab = studio();
    let watch = ["batch", "watch", "in", "--out", "out", "--config", "quick.toml", "--settle", "300ms", "--every", "50ms"];
    let told = lab.run(&[&watch[..], &["--once", "--quiet"]].concat());
    assert_eq!(told.code, 3, "{told:?}");
    assert_eq!(outcomes(&records(&lab.path("out"))).len(), 4);
    let mut child = start(&lab, &watch);
    put(&lab, "in/new/walk.c3d", &lab.read("walk-gaps.c3d")[..9000]);
    std::thread::sleep(Duration::from_millis(150));
    put(&lab, "in/new/walk.c3d", &lab.read("walk-gaps.c3d"));
    wait_for("the new take", || lab.path("out/new/walk.c3d").exists());
    assert!(std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(3), "an end that somebody has to make");
    let seen = outcomes(&records(&lab.path("out")));
    let of = |path: &str| seen.iter().filter(|(p, _)| p == path).map(|(_, outcome)| outcome.as_str()).collect::<Vec<_>>();
    assert_eq!(of("new/walk.c3d"), ["done"], "when it had stopped growing");
    assert_eq!(of("Day 1/walk.c3d"), ["done", "skipped"]);
    assert_eq!(lab.read("out/new/walk.c3d"), lab.read("out/Day 1/walk.c3d"));
}
