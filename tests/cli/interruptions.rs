//! Runs that are ended from outside: whatever has a final name is whole.
#![cfg(unix)]

use crate::lab::{Lab, Listing};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// True for the hidden names that files have while they are written.
fn unfinished(name: &str) -> bool {
    name.starts_with('.') && Path::new(name).extension().is_some_and(|e| e == "part")
}

/// Waits until the run has begun to work, which shows in the hidden file that will become the log.
#[track_caller]
fn wait_for_work(lab: &Lab, child: &mut Child) {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(60) {
        if lab.listing_names().iter().any(|name| unfinished(name)) {
            return;
        }
        assert!(child.try_wait().unwrap().is_none(), "it ended before it could be killed; take a longer take");
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("no sign of work after a minute");
}

/// A take that needs far longer than the test waits.
fn long_take() -> Lab {
    let lab = Lab::empty();
    lab.run(&["demo", "-o", ".", "--frames", "6000"]).with_code(0);
    lab
}

fn start(lab: &Lab, arguments: &[&str]) -> Child {
    lab.command(arguments).stdout(Stdio::null()).spawn().unwrap()
}

#[test]
fn a_killed_run_leaves_no_output() {
    let lab = long_take();
    let before = lab.listing();
    let mut child = start(&lab, &["walk-gaps.c3d", "-o", "out.c3d", "--fills", "fills.csv", "--hidden", "32", "--tolerance", "1e-12"]);
    wait_for_work(&lab, &mut child);
    std::thread::sleep(Duration::from_millis(150));
    child.kill().unwrap();
    assert_eq!(child.wait().unwrap().code(), None, "it ended before it was killed");
    let left = lab.new_since(&before);
    assert!(!left.is_empty() && left.iter().all(|name| unfinished(name)), "{left:?}");

    // What is left is in nobody's way.
    lab.run(&["walk-gaps.c3d", "-o", "out.c3d", "--method", "linear"]).with_code(0);
}

#[test]
fn an_interrupted_run_leaves_nothing_at_all() {
    let lab = long_take();
    let before = lab.listing();
    for signal in ["INT", "TERM"] {
        let mut child = start(&lab, &["walk-gaps.c3d", "-o", "out.c3d", "--hidden", "32", "--tolerance", "1e-12"]);
        wait_for_work(&lab, &mut child);
        let killed = Command::new("sh").args(["-c", &format!("kill -{signal} {}", child.id())]).status().unwrap();
        assert!(killed.success());
        let output = child.wait_with_output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), told.as_str()), (Some(1), "mocap-repair: walk-gaps.c3d: interrupted, nothing was written\n"));
        assert!(lab.new_since(&before).is_empty(), "{signal}: {:?}", lab.new_since(&before));
    }
}

/// Kills a short run at many moments, those of writing and renaming included.
#[test]
fn whatever_has_its_name_is_whole() {
    let arguments = ["walk-gaps.csv", "-o", "out.c3d", "--fills", "fills.csv", "--method", "linear", "--quiet"];
    let reference = Lab::new();
    let begun = Instant::now();
    reference.run(&arguments).with_code(0);
    let takes = begun.elapsed();
    let whole = reference.listing();

    let lab = Lab::new();
    let before = lab.listing();
    let (mut killed, mut finished) = (0, 0);
    for step in 0..40 {
        let mut child = start(&lab, &arguments);
        std::thread::sleep(takes * step / 30);
        child.kill().unwrap();
        if child.wait().unwrap().code().is_none() {
            killed += 1;
        } else {
            finished += 1;
        }
        let now: Listing = lab.listing().into_iter().filter(|(name, _)| !name.starts_with('.')).collect();
        for (name, bytes) in &now {
            assert!(whole.get(name) == Some(bytes), "{name} is not whole after {step}/30 of a run");
        }
        assert!(!now.contains_key("out.c3d") || now.len() == whole.len(), "the output comes last: {:?}", now.keys());
        lab.remove(&lab.new_since(&before));
    }
    assert!(killed >= 5, "{killed} runs were killed, {finished} were faster");
}
