//! What each option changes in the files.

use crate::lab::{FRAMES, Lab, changed_points, column, missing, points_start};
use formats::{Origin, Take};
use mocap_repair::demo::hide;

/// A row of `--fills`.
struct Row {
    frame_index: usize,
    frame: i64,
    marker: String,
    position_mm: [f64; 3],
    sigma_mm: Option<f64>,
    gap: usize,
    method: String,
}

fn fills(lab: &Lab, name: &str) -> Vec<Row> {
    let text = lab.text(name);
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("frame_index,frame,marker,x,y,z,sigma_mm,gap,method"));
    lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            assert_eq!(cells.len(), 9, "{line}");
            let number = |at: usize| cells[at].parse::<f64>().unwrap();
            Row {
                frame_index: cells[0].parse().unwrap(),
                frame: cells[1].parse().unwrap(),
                marker: cells[2].to_owned(),
                position_mm: [number(3), number(4), number(5)],
                sigma_mm: (!cells[6].is_empty()).then(|| number(6)),
                gap: cells[7].parse().unwrap(),
                method: cells[8].to_owned(),
            }
        })
        .collect()
}

/// All samples of a take, as bits.
fn positions(take: &Take) -> Vec<Option<[u64; 3]>> {
    let cells = (0..take.frames()).flat_map(|f| (0..take.markers.len()).map(move |m| (f, m)));
    cells.map(|(f, m)| take.position_mm(f, m).map(|p| p.map(f64::to_bits))).collect()
}

/// Lengths of the runs of missing samples of a marker.
fn gap_lengths(take: &Take, marker: usize) -> Vec<usize> {
    let known: Vec<bool> = (0..take.frames()).map(|f| take.origin(f, marker) != Origin::Missing).collect();
    known.split(|&k| k).map(<[bool]>::len).filter(|&n| n > 0).collect()
}

#[test]
fn fills_has_a_row_for_each_filled_sample() {
    let lab = Lab::new();
    let holes = missing(&lab.take("walk-gaps.c3d"));
    for (method, knows_its_error) in [("linear", false), ("spline", false), ("lds", true), ("bolero-sc", true)] {
        let (output, table) = (format!("{method}.c3d"), format!("{method}.csv"));
        let ran = lab.run(&["walk-gaps.c3d", "-o", &output, "--fills", &table, "--method", method]).with_code(0);
        assert!(ran.out.contains(&format!("\n  fills      {table}\n")), "{}", ran.out);
        let (rows, take) = (fills(&lab, &table), lab.take(&output));
        let mut cells: Vec<(usize, usize)> = rows.iter().map(|row| (row.frame_index, column(&take, &row.marker))).collect();
        assert!(rows.windows(2).all(|w| (w[0].gap, w[0].frame_index) < (w[1].gap, w[1].frame_index)), "gap by gap, frame by frame");
        for (row, &(frame, marker)) in rows.iter().zip(&cells) {
            let written = take.position_mm(frame, marker).unwrap();
            assert!(
                (0..3).all(|k| (row.position_mm[k] - written[k]).abs() < 1e-3),
                "{method}, frame {frame}: the table and the take differ"
            );
            assert_eq!((row.frame, row.method.as_str()), (take.frame_label(frame), method));
            match row.sigma_mm {
                Some(sigma) => assert!(knows_its_error && sigma.is_finite() && sigma > 0.0, "{method}: {sigma}"),
                None => assert!(!knows_its_error, "{method} knows its error"),
            }
        }
        cells.sort_unstable();
        assert_eq!(cells, holes, "{method}");
    }
}

#[test]
fn max_gap_leaves_longer_gaps_open_whole() {
    let lab = Lab::new();
    lab.run(&["walk-gaps.c3d", "-o", "out.c3d", "--max-gap", "15", "--method", "linear"]).with_code(3);
    let (before, after) = (lab.take("walk-gaps.c3d"), lab.take("out.c3d"));
    let (mut closed, mut open) = (0, 0);
    for marker in 0..before.markers.len() {
        let (short, long): (Vec<usize>, Vec<usize>) = gap_lengths(&before, marker).into_iter().partition(|&frames| frames <= 15);
        assert_eq!(gap_lengths(&after, marker), long);
        closed += short.len();
        open += long.len();
    }
    assert!(closed > 0 && open > 0);
}

#[test]
fn extrapolate_closes_gaps_at_the_ends() {
    let lab = Lab::new();
    let take = hide(&hide(&lab.take("walk-truth.c3d"), "LKNE", 0..20), "RTOE", FRAMES - 7..FRAMES);
    lab.create("edges.c3d", &take);
    for method in ["linear", "spline", "lds", "bolero-sc"] {
        let (open, closed) = (format!("{method}-open.c3d"), format!("{method}-closed.c3d"));
        lab.run(&["edges.c3d", "-o", &open, "--method", method]).with_code(3);
        assert!(lab.read(&open) == lab.read("edges.c3d"));
        lab.run(&["edges.c3d", "-o", &closed, "--method", method, "--extrapolate"]).with_code(0);
        assert!(missing(&lab.take(&closed)).is_empty(), "{method}");
    }
}

#[test]
fn markers_says_which_are_filled() {
    let lab = Lab::new();
    lab.run(&["walk-gaps.c3d", "-o", "all.c3d"]).with_code(0);
    lab.run(&["walk-gaps.c3d", "-o", "some.c3d", "--markers", "LKNE,R?HD", "--markers", "*TOE"]).with_code(3);
    let (before, all, some) = (lab.take("walk-gaps.c3d"), lab.take("all.c3d"), lab.take("some.c3d"));
    let asked = ["LKNE", "LTOE", "RBHD", "RFHD", "RTOE"].map(|label| column(&before, label));
    let mut filled = 0;
    for (frame, marker) in missing(&before) {
        let expected = if asked.contains(&marker) { all.position_mm(frame, marker) } else { None };
        assert_eq!(some.position_mm(frame, marker), expected, "frame {frame}, marker {marker}");
        filled += usize::from(expected.is_some());
    }
    assert!(filled > 0);
}

#[test]
fn bones_are_read_and_kept() {
    let lab = Lab::new();
    // As printed, the bones come back rounded, so that the repair is nearly the same, not to the bit.
    let printed = lab.run(&["bones", "walk-gaps.c3d"]).with_code(0).out;
    lab.write("bones.csv", &printed);
    let bones = printed.lines().count() - 1;
    assert!(bones >= 41, "{printed}");
    let found = lab.run(&["walk-gaps.c3d", "-o", "found.c3d"]).with_code(0);
    let stated = lab.run(&["walk-gaps.c3d", "-o", "stated.c3d", "--bones", "bones.csv"]).with_code(0);
    assert!(found.out.contains(&format!("{bones} bones found\n")), "{}", found.out);
    assert!(stated.out.contains(&format!("{bones} bones stated\n")), "{}", stated.out);
    let (found, stated) = (lab.take("found.c3d"), lab.take("stated.c3d"));
    for (frame, marker) in missing(&lab.take("walk-gaps.c3d")) {
        let (a, b) = (found.position_mm(frame, marker).unwrap(), stated.position_mm(frame, marker).unwrap());
        assert!((0..3).all(|k| (a[k] - b[k]).abs() < 2.0), "frame {frame}, marker {marker}: {a:?} and {b:?}");
    }

    // A bone that is stated 30 mm too short pulls.
    let (a, b) = ("LTHI", "LKNE");
    let length = |take: &Take| {
        let (a, b) = (column(take, a), column(take, b));
        let lengths: Vec<f64> = missing(&lab.take("walk-gaps.c3d"))
            .iter()
            .filter(|&&(_, marker)| marker == a)
            .map(|&(frame, _)| {
                let (p, q) = (take.position_mm(frame, a).unwrap(), take.position_mm(frame, b).unwrap());
                (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt()
            })
            .collect();
        lengths.iter().sum::<f64>() / lengths.len() as f64
    };
    let free = length(&found);
    lab.write("short.csv", format!("marker,marker,length\n# thigh\n{a},{b},{:.1}\n", free - 30.0));
    let with_it = |arguments: &[&str]| {
        let ran = lab.run(&[&["walk-gaps.c3d", "-o", "short.c3d", "--bones", "short.csv", "--quiet", "--force"], arguments].concat());
        assert!(ran.code == 0 || ran.code == 3, "{}", ran.err);
        length(&lab.take("short.c3d"))
    };
    // the whole take says otherwise, so a bone that may give only pulls
    for (method, least) in [("bolero-sc", 5.0), ("auto", 1.0)] {
        let pulled = with_it(&["--method", method]);
        assert!(pulled < free - least, "{method}: {pulled} mm with a bone of {} mm, {free} mm without", free - 30.0);
    }
    let held = with_it(&["--bones", "hard"]);
    assert!((held - (free - 30.0)).abs() < 0.1, "{held} mm with a hard bone of {} mm", free - 30.0);
    assert_eq!(lab.run(&["walk-gaps.c3d", "-o", "x.c3d", "--bones", "hard", "--method", "lds"]).code, 2);
}

#[test]
fn rate_and_units_overrule_the_file() {
    let lab = Lab::new();
    let said = |arguments: &[&str]| {
        let summary = lab.run(&[&["walk-gaps.c3d", "--dry-run", "--json"], arguments].concat()).messages().pop().unwrap();
        summary["rate_hz"].as_f64().unwrap()
    };
    assert_eq!((said(&[]), said(&["--rate", "50"])), (120.0, 50.0));
    let inspected = |arguments: &[&str]| lab.run(&[&["inspect", "walk-gaps.csv"], arguments].concat()).with_code(0).out;
    assert!(inspected(&[]).contains("at 120 Hz (1.25 s), in mm"), "{}", inspected(&[]));
    let stated = inspected(&["--rate", "50", "--units", "m"]);
    assert!(stated.contains("at 50 Hz (3 s), in m,") || stated.contains("at 50 Hz (3.00 s), in m,"), "{stated}");

    // What is stated about the input does not change what is written about it: only the filled points differ.
    let holes = missing(&lab.take("walk-gaps.c3d")).len();
    lab.run(&["walk-gaps.c3d", "-o", "out.c3d", "--method", "linear", "--rate", "50"]).with_code(0);
    let (before, after) = (lab.read("walk-gaps.c3d"), lab.read("out.c3d"));
    assert_eq!(changed_points(&before, &after, points_start(&before)), Some(holes));

    // A new file says what was stated.
    lab.run(&["walk-gaps.csv", "-o", "from.c3d", "--method", "linear", "--rate", "50"]).with_code(0);
    assert_eq!(lab.take("from.c3d").rate_hz, 50.0);
}

#[test]
fn the_extension_names_the_format() {
    let lab = Lab::new();
    let truth = positions(&lab.take("walk-truth.c3d"));
    // There and back: CSV cannot say which axis is up, and says so.
    let ran = lab.run(&["walk-truth.c3d", "-o", "there.csv"]).with_code(3);
    assert!(ran.out.contains("csv cannot hold which axis points up"), "{}", ran.out);
    assert!(positions(&lab.take("there.csv")) == truth);
    lab.run(&["there.csv", "-o", "back.C3D"]).with_code(0);
    assert_eq!(&lab.read("back.C3D")[..2], [2, 0x50]);
    std::fs::rename(lab.path("back.C3D"), lab.path("back.c3d")).unwrap();
    assert!(positions(&lab.take("back.c3d")) == truth);

    // Gaps survive the way, whatever is filled.
    let gaps = missing(&lab.take("walk-gaps.csv"));
    lab.run(&["walk-gaps.csv", "-o", "open.c3d", "--max-gap", "0"]).with_code(3);
    assert_eq!(missing(&lab.take("open.c3d")), gaps);
}

#[test]
fn in_place_keeps_the_original() {
    let lab = Lab::new();
    let before = lab.read("walk-gaps.c3d");
    let ran = lab.run(&["walk-gaps.c3d", "--in-place", "--method", "spline"]).with_code(0);
    assert!(ran.out.starts_with("walk-gaps.c3d -> walk-gaps.c3d\n"), "{}", ran.out);
    assert!(lab.read("walk-gaps.c3d.orig") == before);
    assert!(missing(&lab.take("walk-gaps.c3d")).is_empty());
    assert_eq!(lab.listing().len(), 6, "four files of the demonstration, the original, the log");

    let now = lab.listing();
    for arguments in [&["walk-gaps.c3d", "--in-place"][..], &["walk-gaps.c3d", "--in-place", "--force"]] {
        let ran = lab.run(arguments);
        assert_eq!((ran.code, ran.out.as_str()), (1, ""));
        assert!(ran.err.contains("walk-gaps.c3d.orig: exists already, so the original could not be kept"), "{}", ran.err);
        assert!(lab.listing() == now);
    }
}

#[cfg(unix)]
#[test]
fn in_place_keeps_who_may_read() {
    use std::os::unix::fs::PermissionsExt;
    let lab = Lab::new();
    std::fs::set_permissions(lab.path("walk-gaps.c3d"), std::fs::Permissions::from_mode(0o600)).unwrap();
    lab.run(&["walk-gaps.c3d", "--in-place", "--method", "spline"]).with_code(0);
    for name in ["walk-gaps.c3d", "walk-gaps.c3d.orig"] {
        let mode = std::fs::metadata(lab.path(name)).unwrap().permissions().mode() & 0o777;
        assert_eq!(format!("{mode:o}"), "600", "{name}");
    }
}

#[test]
fn a_dry_run_writes_nothing() {
    let lab = Lab::new();
    let before = lab.listing();
    for arguments in [
        &["walk-gaps.c3d", "--dry-run"][..],
        &["walk-gaps.c3d", "--dry-run", "-o", "out.c3d", "--fills", "fills.csv", "--log", "log.mcap"],
        &["walk-gaps.c3d", "--dry-run", "--in-place"],
    ] {
        let ran = lab.run(arguments).with_code(0);
        assert!(ran.out.starts_with("walk-gaps.c3d (dry run, nothing was written)\n"), "{}", ran.out);
        assert!(lab.new_since(&before).is_empty());
    }
    let ran = lab.run(&["walk-gaps.c3d", "--dry-run", "--max-gap", "15"]).with_code(3);
    assert!(ran.out.contains("gaps would stay open: longer than --max-gap"), "{}", ran.out);
}

#[test]
fn the_log_goes_where_it_is_told() {
    let lab = Lab::new();
    let before = lab.listing();
    let repair = |arguments: &[&str]| {
        lab.run(&[&["walk-gaps.c3d", "--force", "--method", "lds", "--iterations", "3"], arguments].concat()).with_code(3);
        let new = lab.new_since(&before);
        let log = lab.listing().remove("log.mcap");
        lab.remove(&new);
        (new, log)
    };
    assert_eq!(repair(&["-o", "out.c3d", "--no-log"]).0, ["out.c3d"]);
    let (new, plain) = repair(&["-o", "out.c3d", "--log", "log.mcap"]);
    assert_eq!(new, ["log.mcap", "out.c3d"]);
    let (_, timed) = repair(&["-o", "out.c3d", "--log", "log.mcap", "--timings"]);
    assert!(plain.is_some() && plain != timed, "computing times are in the log, and only when asked for");
}

#[test]
fn names_may_have_blanks_and_any_letters() {
    let lab = Lab::new();
    let names = ["Größe 1, Läufer.c3d", "歩行 データ.c3d", "-dash.c3d", "a'b\"c$d.c3d"];
    for name in names {
        let input = format!("./{name}");
        lab.write(name, lab.read("walk-gaps.c3d"));
        let output = format!("./out {name}");
        let ran = lab.run(&[&input, "-o", &output, "--method", "linear"]).with_code(0);
        assert!(ran.out.starts_with(&format!("{input} -> {output}\n")), "{}", ran.out);
        assert!(missing(&lab.take(&output)).is_empty());
        assert!(lab.path(&format!("out {}.mcap", name.trim_end_matches(".c3d"))).exists());
    }
}

#[test]
fn the_input_is_never_touched() {
    let lab = Lab::new();
    let path = lab.path("walk-gaps.c3d");
    let mut permissions = std::fs::metadata(&path).unwrap().permissions();
    permissions.set_readonly(true);
    std::fs::set_permissions(&path, permissions).unwrap();
    let (bytes, modified) = (lab.read("walk-gaps.c3d"), std::fs::metadata(&path).unwrap().modified().unwrap());
    lab.run(&["walk-gaps.c3d", "-o", "out.c3d", "--method", "spline"]).with_code(0);
    lab.run(&["inspect", "walk-gaps.c3d"]).with_code(0);
    let after = std::fs::metadata(&path).unwrap();
    assert!(lab.read("walk-gaps.c3d") == bytes);
    assert_eq!((after.modified().unwrap(), after.permissions().readonly()), (modified, true));
}

/// Two bones from one missing marker to seen ones leave it a circle: hard bones are exact there. Contradicting ones are said to be.
#[test]
fn hard_bones_are_exact_or_said_not_to_be() {
    let lab = Lab::new();
    lab.write("two.csv", "marker,marker\nLTHI,LKNE\nLKNE,LSHN\n");
    let take = |name: &str| lab.take(name);
    let ran = lab.run(&["walk-gaps.c3d", "-o", "hard.c3d", "--method", "bolero-hc", "--bones", "two.csv"]).with_code(0);
    assert!(!ran.out.contains("not kept"), "{}", ran.out);
    let printed = lab.run(&["walk-gaps.c3d", "-o", "frames.c3d", "--method", "bolero-hc", "--bones", "two.csv", "--as-printed", "--force"]);
    assert!(printed.code == 0 || printed.code == 3, "{}", printed.err);
    for name in ["hard.c3d", "frames.c3d"] {
        let (before, after) = (take("walk-gaps.c3d"), take(name));
        for (a, b) in [("LTHI", "LKNE"), ("LKNE", "LSHN")] {
            let (a, b) = (column(&after, a), column(&after, b));
            let length = |frame: usize, take: &Take| {
                let (p, q) = (take.position_mm(frame, a)?, take.position_mm(frame, b)?);
                Some((0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt())
            };
            let filled: Vec<f64> =
                (0..after.frames()).filter(|&f| length(f, &before).is_none()).filter_map(|f| length(f, &after)).collect();
            assert!(filled.len() > 10, "{name}: {}", filled.len());
            let (least, most) = filled.iter().fold((f64::INFINITY, 0.0f64), |(l, m), x| (l.min(*x), m.max(*x)));
            assert!(most - least < 0.02, "{name}: from {least} to {most} mm");
        }
    }
    lab.write("torn.csv", "marker,marker,length\nLTHI,LKNE,300\nLTHI,LSHN,20\nLKNE,LSHN,500\n");
    let ran = lab.run(&["walk-gaps.c3d", "-o", "torn.c3d", "--method", "bolero-hc", "--bones", "torn.csv"]).with_code(3);
    assert!(ran.out.contains("not kept"), "{}", ran.out);
}
