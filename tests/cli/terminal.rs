//! What is told to people: how wide, in which colours, with which characters, and what a pipe makes of that.

use crate::lab::{FRAMES, Lab, Ran};
use mocap_repair::demo::hide;

impl Lab {
    /// Runs with nothing in the environment that could say how text is to be set, but for `environment`.
    fn run_in(&self, environment: &[(&str, &str)], arguments: &[&str]) -> Ran {
        let mut command = self.command(arguments);
        for name in ["NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "TERM", "LC_ALL", "LC_CTYPE", "LANG", "COLUMNS"] {
            command.env_remove(name);
        }
        let output = command.envs(environment.iter().copied()).output().unwrap();
        Ran {
            code: output.status.code().unwrap_or(-1),
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

#[test]
fn colours_are_for_those_who_want_them() {
    let lab = Lab::new();
    lab.create("open.c3d", &hide(&lab.take("walk-truth.c3d"), "LKNE", 0..20));
    let coloured = |ran: &Ran| (ran.out.contains('\u{1b}'), ran.err.contains('\u{1b}'));
    for (arguments, streams) in [
        (&["open.c3d", "--dry-run"][..], (true, false)),
        (&["inspect", "open.c3d"], (true, false)),
        (&["--help"], (true, false)),
        (&["none.c3d", "--dry-run"], (false, true)),
        (&["--nonsense"], (false, true)),
        (&["open.c3d", "--dry-run", "--json"], (false, false)),
        (&["none.c3d", "--dry-run", "--json"], (false, false)),
        (&["inspect", "open.c3d", "--json"], (false, false)),
        (&["bones", "open.c3d"], (false, false)),
    ] {
        let forced = lab.run_in(&[("CLICOLOR_FORCE", "1")], arguments);
        assert_eq!(coloured(&forced), streams, "{arguments:?}: {forced:?}");
        for environment in [&[][..], &[("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")], &[("TERM", "dumb")]] {
            let ran = lab.run_in(environment, arguments);
            assert_eq!(coloured(&ran), (false, false), "{environment:?} {arguments:?}: {ran:?}");
            assert_eq!(ran.code, forced.code);
        }
    }
}

#[test]
fn a_pipe_gets_no_progress() {
    let lab = Lab::new();
    for arguments in [&["walk-gaps.c3d", "-o", "out.c3d"][..], &["inspect", "walk-gaps.c3d"], &["convert", "walk-gaps.c3d", "-o", "x.csv"]]
    {
        assert_eq!(lab.run_in(&[("TERM", "xterm"), ("CLICOLOR_FORCE", "1")], arguments).err, "");
    }
}

#[test]
fn sentences_have_80_columns() {
    let lab = Lab::new();
    lab.create("open.c3d", &hide(&lab.take("walk-gaps.c3d"), "LKNE", 0..20));
    for arguments in [
        &["walk-gaps.c3d", "-o", "out.c3d", "--explain", "--max-gap", "12", "--units", "m"][..],
        &["open.c3d", "--dry-run"],
        &["open.c3d", "-o", "open-out.c3d", "--explain", "--method", "linear"],
        &["inspect", "open.c3d"],
        &["inspect", "open.c3d", "--all"],
        &["convert", "open.c3d", "-o", "out.csv", "--units", "cm"],
    ] {
        let ran = lab.run(arguments);
        let widest = ran.out.lines().max_by_key(|line| line.chars().count()).unwrap();
        assert!(widest.chars().count() <= 80, "{arguments:?}: {widest}");
        assert!(ran.out.lines().all(|line| line == line.trim_end()), "{}", ran.out);
    }
}

#[test]
fn long_labels_do_not_make_it_wider() {
    let lab = Lab::new();
    let mut take = lab.take("walk-gaps.c3d");
    for marker in &mut take.markers {
        marker.label = format!("{}{}", marker.label, "_and_then_some".repeat(8));
    }
    lab.create("long.c3d", &take);
    for arguments in [&["long.c3d", "-o", "out.c3d"][..], &["long.c3d", "--dry-run", "--max-gap", "12"], &["inspect", "long.c3d"]] {
        let ran = lab.run(arguments);
        assert!(ran.out.contains("_and_then"), "{ran:?}");
        for line in ran.out.lines() {
            assert!(line.chars().count() <= 80 || !line.trim().contains(' '), "{arguments:?}: {line}");
        }
    }
}

#[test]
fn the_gap_map_shows_where_markers_are_missing() {
    let lab = Lab::new();
    let mut take = lab.take("walk-truth.c3d");
    for (marker, frames) in [("LKNE", 0..75), ("RTOE", 0..FRAMES), ("C7", 149..150)] {
        take = hide(&take, marker, frames);
    }
    lab.create("gaps.c3d", &take);
    let utf8 = [("LC_ALL", "C.UTF-8")];
    let drawn = lab.run_in(&utf8, &["inspect", "gaps.c3d"]).out;
    let row = |text: &str, label: &str| -> String {
        text.lines().find(|line| line.trim_start().starts_with(label)).unwrap_or_else(|| panic!("{label}: {text}")).to_owned()
    };
    let blocks = |line: &str| line.chars().filter(|c| "░▒▓█".contains(*c)).collect::<String>();
    let whole = blocks(&row(&drawn, "RTOE"));
    assert!(whole.len() > 3 * 30 && whole.chars().all(|c| c == '█'), "{drawn}");
    let half = blocks(&row(&drawn, "LKNE")).chars().count();
    assert!((half * 2).abs_diff(whole.chars().count()) <= 1, "{drawn}");
    assert!(row(&drawn, "LKNE").ends_with("50.0 %     1       75"), "{drawn}");
    assert!(["░", "▒"].contains(&blocks(&row(&drawn, "C7")).as_str()), "{drawn}");
    assert!(row(&drawn, "markers").ends_with("at most 2 of 41"), "{drawn}");
    assert!(drawn.contains("\n  without gaps (38): CLAV LANK "), "{drawn}");

    for (environment, arguments) in [
        (&utf8[..], &["inspect", "gaps.c3d", "--ascii"][..]),
        (&[("LC_ALL", "C"), ("LANG", "C.UTF-8")], &["inspect", "gaps.c3d"]),
        (&[], &["inspect", "gaps.c3d"]),
    ] {
        let plain = lab.run_in(environment, arguments).out;
        assert_eq!(plain.is_ascii(), !cfg!(windows) || arguments.contains(&"--ascii"), "{plain}");
        let drawn: String = drawn
            .chars()
            .map(|c| match c {
                '░' => '.',
                '▒' => ':',
                '▓' => '+',
                '█' => '#',
                c => c,
            })
            .collect();
        assert_eq!(row(&plain, "LKNE"), row(&drawn, "LKNE"));
    }
}

#[test]
fn everything_is_shown_when_asked_for() {
    let lab = Lab::new();
    let gaps = lab.run(&["inspect", "walk-gaps.c3d", "--json"]).messages()[0]["gaps"].as_array().unwrap().len();
    assert!(gaps > 40, "{gaps}");
    let short = lab.run(&["inspect", "walk-gaps.c3d"]).out;
    assert!(short.contains(&format!("\n  and {} gaps more (--all lists them)\n", gaps - 10)), "{short}");
    assert!(short.contains("mocap-repair bones prints them"), "{short}");
    let all = lab.run(&["inspect", "walk-gaps.c3d", "--all"]).out;
    let listed = all.split("\n\n").find(|part| part.trim_start().starts_with("gap of")).unwrap();
    assert_eq!(listed.lines().count() - 1, gaps);
    assert!(all.contains("bone       "), "{all}");
}
