//! What is refused: one line that says why, the right exit code, and not a byte left behind.

use crate::lab::Lab;

/// Runs a repair that must fail, and returns what it said about it.
#[track_caller]
fn refused(lab: &Lab, arguments: &[&str]) -> String {
    let before = lab.listing();
    let ran = lab.run(arguments);
    assert_eq!((ran.code, ran.out.as_str()), (1, ""), "{arguments:?}: {}", ran.err);
    assert!(lab.new_since(&before).is_empty(), "{arguments:?} left {:?}", lab.new_since(&before));
    let line = ran.err.strip_prefix("mocap-repair: ").and_then(|rest| rest.strip_suffix('\n'));
    let line = line.unwrap_or_else(|| panic!("{arguments:?}: not one line of ours: {:?}", ran.err));
    assert!(!line.contains('\n') && !line.contains("panicked"), "{arguments:?}: {line}");
    line.to_owned()
}

#[test]
fn wrong_command_lines_end_with_2() {
    let lab = Lab::new();
    let before = lab.listing();
    for (arguments, told) in [
        (&[][..], "--output <OUT>"),
        (&["walk-gaps.c3d"], "--output <OUT>"),
        (&["-o", "out.c3d"], "<IN>"),
        (
            &["walk-gaps.c3d", "-o", "out.c3d", "--method", "magic"],
            "possible values: linear, spline, msvd, lds, bolero-hc, bolero-sc, skeleton, auto",
        ),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--rate", "0"], "expected a number of frames per second, from 0.001 to 1000000"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--rate", "fast"], "expected a number of frames per second"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--lambda", "inf"], "expected a number above 0"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--hidden", "0"], "--hidden"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--energy", "1.5"], "expected a number above 0 and at most 1"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--energy", "0.9", "--hidden", "4"], "cannot be used with"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--step", "newton"], "possible values: gauss-newton, gradient"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--iterations", "0"], "--iterations"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--max-gap", "-1"], "-1"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--units", "feet"], "[possible values: mm, cm, m]"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--in-place"], "--in-place"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--log", "l.mcap", "--no-log"], "--no-log"),
        (&["walk-gaps.c3d", "-o", "out.c3d", "--no-such-option"], "--no-such-option"),
        (&["demo"], "--output <DIR>"),
        (&["demo", "-o", "d", "--frames", "3"], "--frames"),
        (&["inspect"], "<IN>"),
        (&["bones"], "<IN>"),
    ] {
        let ran = lab.run(arguments);
        assert_eq!((ran.code, ran.out.as_str()), (2, ""), "{arguments:?}: {}", ran.err);
        assert!(ran.err.contains(told), "{arguments:?}: {}", ran.err);
        assert!(lab.new_since(&before).is_empty(), "{arguments:?}");
    }
}

#[test]
fn a_cut_c3d_is_never_repaired() {
    let lab = Lab::new();
    let whole = lab.read("walk-gaps.c3d");
    let lengths = [1, 2, 100, 511, 512, 600, 1023, 1024, 2000, whole.len() / 3, whole.len() / 2, 9 * whole.len() / 10];
    for length in lengths {
        lab.write("cut.c3d", &whole[..length]);
        let told = refused(&lab, &["cut.c3d", "-o", "out.c3d"]);
        assert!(told.starts_with("cut.c3d: "), "{told}");
    }
    lab.write("cut.c3d", &whole[..whole.len() / 2]);
    let told = refused(&lab, &["cut.c3d", "-o", "out.c3d"]);
    assert!(told.contains("the file ends in frame") && told.contains("copy or export it again"), "{told}");
}

#[test]
fn what_is_no_take_is_refused() {
    let lab = Lab::new();
    lab.write("text.c3d", "Dear lab,\nplease find attached\n");
    lab.write("empty.c3d", "");
    lab.write("stray.csv", "frame,time,\"LKNE\u{1b}[2J.X\",LKNE.Y,LKNE.Z\n1,0.0,1,2,3\n");
    lab.write("noise.bin", [0x7f, 0x45, 0x4c, 0x46, 0, 0, 0, 0]);
    lab.write("short.csv", "frame,time,A-x,A-y,A-z\n1,0.0,1,2,3\n2,0.01,1,2\n");
    std::fs::create_dir(lab.path("folder.c3d")).unwrap();
    for (input, told) in [
        ("text.c3d", "text.c3d: named .c3d but not c3d: it holds text that begins \"Dear lab,"),
        ("empty.c3d", "empty.c3d: the file is empty (0 bytes)"),
        (
            "stray.csv",
            "stray.csv: named .csv but not csv: it begins as text, \"frame,time,\"LKNE[2J.X\",\", but byte 16 is 1b, which no text holds",
        ),
        (
            "noise.bin",
            "noise.bin: not a format we know: it begins with the bytes 7f 45 4c 46; expected one of: c3d, csv, motive, nexus, trc, tsv, bvh",
        ),
        (
            "short.csv",
            "short.csv: csv: this row has 4 columns, the header has 5; nothing was skipped, delete or complete this row (line 3)",
        ),
        ("folder.c3d", "folder.c3d: is a folder; name one file in it"),
        ("none.c3d", "none.c3d: cannot be read: no such file or folder"),
    ] {
        let line = refused(&lab, &[input, "-o", "out.c3d"]);
        assert!(line.starts_with(told), "{line}\nexpected: {told}");
        assert_eq!(refused(&lab, &["bones", input]), line);
    }
}

#[test]
fn outputs_that_cannot_be_or_must_not_be_are_refused() {
    let lab = Lab::new();
    lab.write("there.c3d", "precious");
    lab.write("there.mcap", "precious");
    lab.write("file.txt", "");
    std::fs::create_dir(lab.path("folder.c3d")).unwrap();
    std::fs::hard_link(lab.path("walk-gaps.c3d"), lab.path("hard.c3d")).unwrap();
    let input = "walk-gaps.c3d";
    for (arguments, told) in [
        (&["-o", "file.txt/out.c3d"][..], "file.txt/out.c3d: its folder does not exist"),
        (&["-o", "none/out.c3d"], "none/out.c3d: its folder does not exist; make it first"),
        (&["-o", "folder.c3d"], "folder.c3d: is a folder; name a file in it"),
        (&["-o", "out.c3d", "--fills", "none/fills.csv"], "none/fills.csv: its folder does not exist"),
        (&["-o", "out.c3d", "--log", "none/log.mcap"], "none/log.mcap: its folder does not exist"),
        (&["-o", "there.c3d"], "there.c3d: exists already; give another name, or say --force to replace it"),
        (&["-o", "there.csv"], "there.mcap: exists already; give another name, or say --force to replace it"),
        (&["-o", "out.c3d", "--fills", "there.c3d"], "there.c3d: exists already"),
        (&["-o", input], "walk-gaps.c3d: is the input itself; give another name, or repair with --in-place"),
        (&["-o", input, "--force"], "walk-gaps.c3d: is the input itself"),
        (&["-o", "./walk-gaps.c3d", "--force"], "./walk-gaps.c3d: is the input itself"),
        (&["-o", "hard.c3d"], "hard.c3d: is the input itself"),
        (&["-o", "hard.c3d", "--force"], "hard.c3d: is the input itself"),
        (&["-o", "out.c3d", "--log", input, "--force"], "walk-gaps.c3d: is the input itself"),
        (&["-o", "out.c3d", "--log", "out.c3d"], "out.c3d: is named for two different files; give different names"),
        (&["-o", "out.c3d", "--log", "./out.c3d"], "./out.c3d: is named for two different files"),
        (&["-o", "out.c3d", "--fills", "out.mcap"], "out.mcap: is named for two different files"),
    ] {
        let line = refused(&lab, &[&[input], arguments].concat());
        assert!(line.starts_with(told), "{line}\nexpected: {told}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(input, lab.path("soft.c3d")).unwrap();
        let line = refused(&lab, &[input, "-o", "soft.c3d", "--force"]);
        assert!(line.starts_with("soft.c3d: is the input itself"), "{line}");
    }
}

#[test]
fn force_replaces_what_exists() {
    let lab = Lab::new();
    for name in ["out.c3d", "out.mcap", "fills.csv"] {
        lab.write(name, "old");
    }
    let command = ["walk-gaps.c3d", "-o", "out.c3d", "--fills", "fills.csv", "--method", "linear"];
    lab.run(&[&command[..], &["--force"]].concat()).with_code(0);
    let fresh = Lab::new();
    fresh.run(&command).with_code(0);
    assert!(lab.listing() == fresh.listing());
}

#[test]
fn a_failure_with_force_leaves_the_old_files() {
    let lab = Lab::new();
    lab.write("out.c3d", "old");
    lab.write("out.mcap", "old");
    lab.write("cut.c3d", &lab.read("walk-gaps.c3d")[..5000]);
    refused(&lab, &["cut.c3d", "-o", "out.c3d", "--force"]);
    refused(&lab, &["walk-gaps.c3d", "-o", "out.c3d", "--force", "--markers", "NOBODY"]);
}

#[test]
fn markers_and_bones_that_are_not_there_are_named() {
    let lab = Lab::new();
    for (bones, told) in [
        ("LKNE,LANK,long\n", "bones.csv: line 1: \"long\" is not a length in mm"),
        ("marker,marker\nLKNE,LANK\nLKNE\n", "bones.csv: line 3: 1 cells found, expected: marker,marker[,length in mm]"),
        ("LKNE,TAIL\n", "bones.csv: marker \"TAIL\" is not in the take; it has C7, CLAV, "),
    ] {
        lab.write("bones.csv", bones);
        let line = refused(&lab, &["walk-gaps.c3d", "-o", "out.c3d", "--bones", "bones.csv"]);
        assert!(line.starts_with(told), "{line}\nexpected: {told}");
    }
    for (arguments, told) in [
        (&["--bones", "none.csv"][..], "none.csv: cannot be read: no such file or folder"),
        (&["--markers", "LKNE,TAIL*"], "walk-gaps.c3d: --markers TAIL* fits no marker; the take has C7, CLAV, "),
    ] {
        let line = refused(&lab, &[&["walk-gaps.c3d", "-o", "out.c3d"], arguments].concat());
        assert!(line.starts_with(told), "{line}\nexpected: {told}");
    }
}

/// The folder must also be clean when the failure comes late: here after solving, while the output is written.
#[test]
fn a_failure_while_writing_leaves_nothing() {
    let lab = Lab::new();
    let text = lab.text("walk-gaps.csv");
    let (head, rows) = text.split_once('\n').unwrap();
    let mut cells: Vec<&str> = rows.split(',').collect();
    cells[2] = "1e60"; // the first marker's first x: no number that a C3D can hold
    lab.write("far.csv", format!("{head}\n{}", cells.join(",")));
    let line = refused(&lab, &["far.csv", "-o", "out.c3d", "--fills", "fills.csv", "--method", "linear"]);
    assert_eq!(line, "out.c3d: c3d: C7 in frame 1 is too far away for 32-bit floats");
    lab.run(&["far.csv", "-o", "out.csv", "--method", "linear"]).with_code(0);
}

#[test]
fn names_that_cannot_be_meant_are_refused() {
    let lab = Lab::new();
    let before = lab.listing();
    let ran = lab.run(&["walk-gaps.c3d", "-o", "walk.xyz"]);
    assert_eq!(ran.code, 1);
    assert!(
        ran.err.contains("walk.xyz: the extension .xyz names no format that can be written; use one of: .bvh, .c3d, .csv, .trc, .tsv"),
        "{}",
        ran.err
    );
    let ran = lab.run(&["walk-gaps.c3d", "walk-truth.c3d", "-o", "walk.c3d"]);
    assert_eq!(ran.code, 2);
    assert!(ran.err.contains("2 takes were named; repair one at a time, each with its own -o"), "{}", ran.err);
    assert!(lab.new_since(&before).is_empty());
}

#[cfg(unix)]
#[test]
fn a_pipe_is_not_replaced_even_by_force() {
    let lab = Lab::new();
    let pipe = lab.path("out.c3d");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let ran = lab.run(&["walk-gaps.c3d", "-o", "out.c3d", "--force", "--no-log", "--method", "linear"]);
    assert_eq!(ran.code, 1);
    assert!(ran.err.contains("out.c3d: is a device or a pipe, which a file cannot take the place of"), "{}", ran.err);
    assert!(!std::fs::metadata(&pipe).unwrap().is_file());
}

#[test]
fn what_is_read_is_not_replaced_even_by_force() {
    let lab = Lab::new();
    lab.write("bones.csv", "LKNE,LANK\n");
    lab.write("lab.toml", "method = \"linear\"\n");
    lab.write("holes.csv", "marker,frame\nLKNE,20\n");
    let before = lab.listing();
    for (option, file) in [("--bones", "bones.csv"), ("--config", "lab.toml"), ("--missing", "holes.csv")] {
        let ran = lab.run(&["walk-gaps.c3d", "-o", "walk.c3d", option, file, "--fills", file, "--force"]);
        assert_eq!((ran.code, ran.err), (1, format!("mocap-repair: {file}: is read as well; give another name\n")), "{option}");
    }
    assert_eq!(lab.listing(), before);
}
