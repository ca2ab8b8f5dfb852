//! The report to look at: from a repair and from its log, and what becomes of it when something is in the way.

use crate::lab::Lab;
use mocap_repair::page::{Page, State};

/// Repairs with `options` into `out.*`, with report and log.
#[track_caller]
fn repair(lab: &Lab, input: &str, code: i32, options: &[&str]) {
    let arguments = [&[input, "-o", "out.c3d", "--report", "out.html", "--force"], options].concat();
    lab.run(&arguments).with_code(code);
}

#[test]
fn the_log_gives_the_same_report_as_the_repair() {
    let lab = Lab::new();
    for (input, code, options) in [
        ("walk-gaps.c3d", 0, &[][..]),
        ("walk-gaps.c3d", 0, &["--method", "lds", "--iterations", "30", "--tolerance", "0.1"]),
        ("walk-gaps.c3d", 0, &["--method", "spline"]),
        ("walk-gaps.c3d", 3, &["--method", "linear", "--max-gap", "10", "--missing", "L*:30-60"]),
        ("walk-truth.c3d", 0, &[]),
        ("walk-gaps.csv", 3, &["--method", "linear", "--missing", "LKNE", "--max-sigma", "1"]),
    ] {
        repair(&lab, input, code, options);
        lab.run(&["report", "out.mcap", "-o", "again.html", "--force"]).with_code(0);
        assert!(lab.read("out.html") == lab.read("again.html"), "{input} {options:?}");
        assert!(lab.read("out.html").len() < 500_000, "{input} {options:?}");
    }
}

#[test]
fn the_same_repair_gives_the_same_report_wherever_it_is_made() {
    let (here, there) = (Lab::new(), Lab::new());
    repair(&here, "walk-gaps.c3d", 0, &["--method", "spline"]);
    let folder = there.folder().to_str().unwrap().to_owned();
    let path = |name: &str| format!("{folder}/{name}");
    let arguments = [&path("walk-gaps.c3d"), "-o", &path("out.c3d"), "--report", &path("out.html"), "--method", "spline", "--no-log"];
    here.run(&arguments).with_code(0);
    assert!(here.read("out.html") == there.read("out.html"));
    assert!(!String::from_utf8(there.read("out.html")).unwrap().contains(&folder));
}

#[test]
fn a_thinned_log_gives_what_it_has() {
    let lab = Lab::new();
    repair(&lab, "walk-gaps.c3d", 0, &["--method", "spline"]);
    let whole = Page::of_log(&lab.path("out.mcap")).unwrap();
    repair(&lab, "walk-gaps.c3d", 0, &["--method", "spline", "--log-rate", "30"]);
    let thinned = Page::of_log(&lab.path("out.mcap")).unwrap();
    assert_eq!((whole.positions.frames.len(), thinned.positions.frames.len()), (150, 38));
    assert_eq!(thinned.positions.frames[..4], [0, 4, 8, 12]);
    assert_eq!(thinned.gaps, whole.gaps);
    for (thin, full) in thinned.positions.tracks.iter().zip(&whole.positions.tracks) {
        assert_eq!((&thin.states, &thin.sigma), (&full.states, &full.sigma), "known for every frame");
        assert!(thinned.positions.frames.iter().zip(&thin.at).all(|(&frame, at)| full.at[frame as usize] == *at));
    }
    lab.run(&["report", "out.mcap", "-o", "thin.html"]).with_code(0);
}

#[test]
fn the_report_shows_what_was_done() {
    let lab = Lab::new();
    repair(&lab, "walk-gaps.c3d", 3, &["--method", "spline", "--max-gap", "15"]);
    let page = Page::of_log(&lab.path("out.mcap")).unwrap();
    assert_eq!((page.source_name.as_str(), page.method.as_str(), page.take.frames), ("walk-gaps.c3d", "spline", 150));
    assert_eq!(page.options["max_gap"], "15");
    assert!(page.curves.is_empty() && page.summary.stages.len() == 1, "splines have no likelihood");
    let before = lab.take("walk-gaps.c3d");
    for gap in &page.gaps {
        let track = &page.positions.tracks[gap.marker as usize];
        let state = if gap.frames > 15 { State::Missing } else { State::Filled };
        assert_eq!(gap.open.as_deref().is_some_and(|why| why == "too-long"), gap.frames > 15);
        for frame in gap.start..gap.start + gap.frames {
            assert_eq!(track.states[frame as usize], state);
            assert_eq!(before.position_mm(frame as usize, gap.marker as usize), None);
        }
    }
    let (missing, filled) = (page.summary.samples_missing, page.summary.samples_filled);
    assert!(missing > filled && filled > 0);
    assert_eq!(page.positions.tracks.iter().flat_map(|t| &t.sigma).count() as u64, filled);
}

#[test]
fn a_report_that_cannot_be_written_keeps_everything_from_being_written() {
    let lab = Lab::new();
    lab.write("there.html", "mine");
    let before = lab.listing();
    for (report, told) in [
        ("nowhere/out.html", "nowhere/out.html: its folder does not exist; make it first"),
        ("there.html", "there.html: exists already; give another name, or say --force to replace it"),
        ("out.c3d", "out.c3d: is named for two different files; give different names"),
        ("walk-gaps.c3d", "walk-gaps.c3d: is the input itself; give another name"),
        (".", ".: is a folder; name a file in it"),
    ] {
        let ran = lab.run(&["walk-gaps.c3d", "-o", "out.c3d", "--method", "linear", "--report", report]);
        assert_eq!((ran.code, ran.err.trim_end()), (1, format!("mocap-repair: {told}").as_str()), "{report}");
        assert!(lab.new_since(&before).is_empty(), "{report}");
    }
    #[cfg(target_os = "linux")]
    {
        // a folder that even an administrator cannot make files in
        let ran = lab.run(&["walk-gaps.c3d", "-o", "out.c3d", "--report", "/proc/out.html"]);
        assert!(ran.code == 1 && ran.err.starts_with("mocap-repair: /proc/out.html: cannot be written: "), "{ran:?}");
    }
    let dry = lab.run(&["walk-gaps.c3d", "-o", "out.c3d", "--dry-run", "--report", "out.html"]);
    assert!(dry.code != 1 && lab.new_since(&before).is_empty(), "a dry run writes nothing");
}

#[test]
fn what_is_no_log_gives_no_report() {
    let lab = Lab::new();
    repair(&lab, "walk-gaps.c3d", 0, &["--method", "linear"]);
    let log = lab.read("out.mcap");
    lab.write("cut.mcap", &log[..log.len() / 2]);
    lab.write("empty.mcap", "");
    let mut bent = log.clone();
    bent[log.len() / 3] ^= 1;
    lab.write("bent.mcap", bent);
    let before = lab.listing();
    for name in ["cut.mcap", "empty.mcap", "bent.mcap", "walk-gaps.c3d", "nowhere.mcap"] {
        let ran = lab.run(&["report", name, "-o", "new.html"]);
        assert_eq!(ran.code, 1, "{name}: {}", ran.err);
        assert!(ran.err.starts_with(&format!("mocap-repair: {name}: ")) && ran.err.lines().count() == 1, "{name}: {}", ran.err);
        assert!(lab.new_since(&before).is_empty(), "{name}");
    }
    let ran = lab.run(&["report", "out.mcap", "-o", "out.html"]);
    assert_eq!((ran.code, ran.err.contains("exists already")), (1, true), "{}", ran.err);
}
