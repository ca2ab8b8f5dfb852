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
fn an_interrupt_ends_at_once_what_has_nothing_to_bring_home() {
    use std::os::unix::process::ExitStatusExt;
    let lab = long_take();
    // a pipe that nobody writes to is waited for, for ever
    assert!(Command::new("mkfifo").arg(lab.path("never.c3d")).status().unwrap().success());
    for arguments in [&["inspect", "never.c3d"][..], &["bones", "never.c3d"], &["convert", "never.c3d", "-o", "out.csv"]] {
        let mut child = start(&lab, arguments);
        std::thread::sleep(Duration::from_millis(300));
        assert!(child.try_wait().unwrap().is_none(), "{arguments:?} did not wait");
        // not INT: whoever starts tests in the background may have them, and all they start, pass it over
        assert!(Command::new("sh").args(["-c", &format!("kill -TERM {}", child.id())]).status().unwrap().success());
        let begun = Instant::now();
        let status = loop {
            match child.try_wait().unwrap() {
                Some(status) => break status,
                None if begun.elapsed() > Duration::from_secs(30) => panic!("{arguments:?} goes on"),
                None => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        assert_eq!(status.signal(), Some(15), "{arguments:?}");
    }
}

/// Interrupts a long run in the middle of its work.
#[track_caller]
fn interrupt(lab: &Lab, signal: &str, arguments: &[&str]) -> String {
    let mut child = start(lab, arguments);
    wait_for_work(lab, &mut child);
    let killed = Command::new("sh").args(["-c", &format!("kill -{signal} {}", child.id())]).status().unwrap();
    assert!(killed.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{signal}");
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn an_interrupted_run_leaves_a_log_of_how_far_it_came() {
    let lab = long_take();
    let before = lab.listing();
    let arguments = ["walk-gaps.c3d", "-o", "out.c3d", "--hidden", "32", "--tolerance", "1e-12"];
    // the second run replaces the log of the first, which nobody needs any more
    for signal in ["INT", "TERM"] {
        let told = interrupt(&lab, signal, &arguments);
        assert_eq!(told, "mocap-repair: walk-gaps.c3d: interrupted, no take was written; out.mcap shows how far it came\n");
        assert_eq!(lab.new_since(&before), ["out.mcap"], "{signal}");
        let metadata = lab.log_metadata("out.mcap");
        assert_eq!((metadata["ended"].as_str(), metadata["stop_reason"].as_str()), ("interrupted", "interrupted"));
    }
    // but a log of a take that was written stays
    lab.run(&["walk-gaps.c3d", "-o", "out.c3d", "--method", "linear"]).with_code(0);
    let whole = lab.listing();
    let told = interrupt(&lab, "INT", &[&arguments[..], &["--force"]].concat());
    assert_eq!(told, "mocap-repair: walk-gaps.c3d: interrupted, no take was written\n");
    assert_eq!(lab.listing(), whole);
}

#[test]
fn an_interrupted_run_without_a_log_leaves_nothing_at_all() {
    let lab = long_take();
    let before = lab.listing();
    let mut child = start(&lab, &["walk-gaps.c3d", "-o", "out.c3d", "--hidden", "32", "--tolerance", "1e-12", "--no-log"]);
    std::thread::sleep(Duration::from_millis(700)); // reading takes far less, solving far more; both leave nothing
    let killed = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().unwrap();
    assert!(killed.success());
    assert!(!child.wait().unwrap().success());
    assert!(lab.new_since(&before).is_empty(), "{:?}", lab.new_since(&before));
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
