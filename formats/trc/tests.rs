//! The codec as a whole: what a file says, and what a saved file keeps.
#![allow(clippy::unwrap_used, clippy::indexing_slicing)]

use super::*;
use crate::text::damage::survive;
use crate::{Direction, Marker, Origin, Samples};

const NONE: Stated = Stated { rate_hz: None, unit: None, missing: Samples::new() };

/// A file with these label and coordinate lines, `|` for tabs.
fn file(counts: &str, labels: &str, rows: &[&str]) -> String {
    let head = "PathFileType|4|(X/Y/Z)|a.trc\nDataRate|CameraRate|NumFrames|NumMarkers|Units|OrigDataRate|OrigDataStartFrame|OrigNumFrames";
    format!("{head}\n100|100|{counts}|mm|100|1|1\nFrame#|Time|{labels}\n{}\n", rows.join("\n")).replace('|', "\t")
}

fn open(text: impl AsRef<[u8]>, stated: &Stated) -> (Box<dyn Document>, Vec<String>) {
    let notes = Notes::new();
    let document = Trc.open(text.as_ref().to_vec(), stated, &notes).unwrap();
    (document, notes.take().iter().map(ToString::to_string).collect())
}

fn error(text: &str) -> String {
    Trc.open(text.as_bytes().to_vec(), &NONE, &Notes::new()).err().map_or_else(|| "no error".to_owned(), |e| e.to_string())
}

fn save(document: &dyn Document, take: &Take) -> String {
    let mut out = Vec::new();
    document.save(take, &mut out, &Notes::new()).unwrap();
    String::from_utf8(out).unwrap()
}

fn labels(take: &Take) -> Vec<&str> {
    take.markers.iter().map(|m| m.label.as_str()).collect()
}

#[test]
fn rows_that_end_early_are_completed() {
    let text = file("4|3", "A|||B|||C", &["1|0.00|1|2|3|4|5|6|7|8|9", "2|0.01|1|2|3", "3|0.02", "4|0.03|1|2|3||||7|8|9"]);
    let (document, notes) = open(&text, &NONE);
    assert_eq!(notes, [] as [&str; 0]);
    assert_eq!(save(document.as_ref(), document.take()), text);
    let mut all = document.take().clone();
    let mut some = document.take().clone();
    for (frame, marker) in [(1, 1), (1, 2), (2, 0), (2, 1), (2, 2), (3, 1)] {
        assert_eq!(all.origin(frame, marker), Origin::Missing);
        assert!(all.fill(frame, marker, [10.0, 20.0, 30.0]));
    }
    let rows =
        ["1|0.00|1|2|3|4|5|6|7|8|9", "2|0.01|1|2|3|10|20|30|10|20|30", "3|0.02|10|20|30|10|20|30|10|20|30", "4|0.03|1|2|3|10|20|30|7|8|9"];
    assert_eq!(save(document.as_ref(), &all), file("4|3", "A|||B|||C", &rows).replace("10\t20\t30", "10.000\t20.000\t30.000"));
    // only the last marker: what lies before stays empty
    assert!(some.fill(1, 2, [10.0, 20.0, 30.0]));
    assert!(save(document.as_ref(), &some).contains("\n2\t0.01\t1\t2\t3\t\t\t\t10.000\t20.000\t30.000\n3\t0.02\n"));
}

#[test]
fn short_rows_keep_what_ends_them() {
    // a tab behind the last cell, a blank, CRLF, and no line end at all
    let text = "PathFileType\t4\nDataRate\tNumMarkers\tUnits\n100\t2\tmm\nFrame#\tTime\tA\t\t\tB\n1\t0.00\t1\t2\t3\t\r\n2\t0.01\t1\t2\t3 \r\n3\t0.02\t1\t2\t3\t4\t5\t6\r\n";
    let (document, _) = open(text, &NONE);
    let mut take = document.take().clone();
    assert!(take.fill(0, 1, [4.0, 5.0, 6.0]) && take.fill(1, 1, [4.0, 5.0, 6.0]));
    let saved = save(document.as_ref(), &take);
    assert!(saved.contains("\n1\t0.00\t1\t2\t3\t4.000\t5.000\t6.000\r\n2\t0.01\t1\t2\t3 \t4.000\t5.000\t6.000\r\n3\t"), "{saved:?}");
    let again = open(saved, &NONE).0;
    assert_eq!(again.take().position_mm(1, 1), Some([4.0, 5.0, 6.0]));
}

#[test]
fn who_the_columns_belong_to() {
    let row = |coordinates: usize| format!("1|0|{}", vec!["1.5"; coordinates].join("|"));
    for (claimed, head, cells, expected) in [
        ("2", "A|||B|||", 6, &["A", "B"][..]),
        ("2", "A|B", 6, &["A", "B"]),
        ("2", "A|A|A|B|B|B\n||X1|Y1|Z1|X2|Y2|Z2", 6, &["A", "B"]),
        ("5", "A|||B|||", 6, &["A", "B"]),                            // NumMarkers is wrong
        ("1", "A|||B|||", 6, &["A", "B"]),                            // also too small
        ("3", "A|||B|||", 12, &["A", "B", ""]),                       // a marker without a name, and a point behind
        ("3", "A||||||C", 9, &["A", "", "C"]),                        // its name is empty
        ("0", "", 9, &[]),                                            // points only
        ("2", "A|||B|||Q\n||X1|Y1|Z1|X2|Y2|Z2", 7, &["A", "B"]),      // another column behind
        ("2", "A|||B|||Q", 7, &["A", "B"]),                           // the same without heads
        ("x", "A|||B|||Q\n||X1|Y1|Z1|X2|Y2|Z2|Q", 7, &["A", "B"]),    // the same without NumMarkers
        ("3", "A|||B|||C\n||X1|Y1|Z1|X2|Y2|Z2", 9, &["A", "B", "C"]), // heads that end early
    ] {
        let text = file(&format!("1|{claimed}"), head, &[&row(cells)]);
        let (document, notes) = open(&text, &NONE);
        assert_eq!(labels(document.take()), expected, "{claimed} {head:?} {notes:?}");
        assert_eq!(save(document.as_ref(), document.take()), text);
    }
    for (claimed, head) in [("2", "A|B|C\n||X1|Y1|Z1|X2|Y2|Z2"), ("3", "A|B")] {
        let message = error(&file(&format!("1|{claimed}"), head, &[&row(9)]));
        assert!(message.contains("labels stand side by side") && message.ends_with("(line 4)"), "{message}");
    }
}

#[test]
fn what_is_stated_goes_before_the_header() {
    let text = file("2|1", "A", &["1|0.000|1|2|3", "2|0.020|1|2|3"]);
    let (document, notes) = open(&text, &NONE);
    assert_eq!(document.take().rate_hz, 100.0);
    assert_eq!(notes, ["DataRate is 100 Hz, but the times go by at 50.00 Hz; DataRate was taken (say it with --rate)"]);
    let stated = Stated { rate_hz: Some(50.0), unit: Some(Unit::Metre), missing: [(1, 0)].into_iter().collect() };
    let (document, notes) = open(&text, &stated);
    let take = document.take();
    assert_eq!((take.rate_hz, take.unit, take.position_mm(0, 0)), (50.0, Unit::Metre, Some([1000.0, 2000.0, 3000.0])));
    assert_eq!((take.origin(1, 0), notes.len()), (Origin::Missing, 0));
}

#[test]
fn what_is_a_trc_file_and_what_is_none() {
    for (head, expected) in [
        ("PathFileType\t4", Match::Certain),
        ("\u{feff}\r\n PathFileType  4", Match::Certain),
        ("PathFileType,4,(X/Y/Z)", Match::Certain),
        ("frame,time,A-x\n", Match::No),
        ("NO_OF_FRAMES\t3\n", Match::No),
        ("", Match::No),
    ] {
        assert_eq!(Trc.sniff(head.as_bytes()), expected, "{head:?}");
    }
    let text = file("1|1", "A", &["1|0|1|2|3"]);
    for extension in [None, Some("trc"), Some("TRC"), Some("txt"), Some("dat")] {
        assert_eq!(crate::detect(text.as_bytes(), extension).unwrap().info().name, "trc", "{extension:?}");
    }
    // under another format's name it is refused by name
    let csv = crate::detect(text.as_bytes(), Some("csv")).unwrap();
    let message = csv.open(text.into_bytes(), &NONE, &Notes::new()).err().unwrap().to_string();
    assert_eq!(message, "csv: this seems to be an OpenSim TRC file, which is another format; name it .trc");
}

#[test]
fn what_is_created_suits_other_readers() {
    let mut b = TakeBuilder::new(vec![Marker::new("A b"), Marker::new(""), Marker::new("t\tu")], 3, 59.94).unit(Unit::Metre).first_frame(7);
    b.set(0, 0, [1.0, -0.0, 3.5], Origin::Measured);
    b.set(2, 2, [100.0, 200.0, 300.0], Origin::Derived);
    let take = b.up(Some(Direction::PLUS_Y)).build();
    let (mut out, notes) = (Vec::new(), Notes::new());
    Trc.create(&take, &mut out, &notes).unwrap();
    let text = String::from_utf8(out).unwrap();
    assert_eq!(
        text.replace('\t', "|"),
        "PathFileType|4|(X/Y/Z)|mocap-repair.trc\n\
         DataRate|CameraRate|NumFrames|NumMarkers|Units|OrigDataRate|OrigDataStartFrame|OrigNumFrames\n\
         59.94|59.94|3|3|m|59.94|7|3\n\
         Frame#|Time|A b|||unlabelled_2|||t_u|||\n\
         ||X1|Y1|Z1|X2|Y2|Z2|X3|Y3|Z3|\n\n\
         7|0.000000|0.001|0|0.0035|||||||\n\
         8|0.016683|||||||||||\n\
         9|0.033367|||||||0.1|0.2|0.3|\n"
            .replace("8|0.016683|||||||||||", "8|0.016683||||||||||")
    );
    let notes: Vec<String> = notes.take().iter().map(ToString::to_string).collect();
    assert_eq!(
        notes,
        [
            "trc cannot hold which axis points up (+y); left out",
            "trc cannot hold that 1 samples were filled or filtered before; left out",
            "2 labels that are empty or have tabs, line ends or other control characters in them were changed: now called unlabelled_2, t_u",
        ]
    );
    let (again, notes) = open(&text, &NONE);
    assert_eq!(notes, [] as [&str; 0]);
    let again = again.take();
    assert_eq!((again.rate_hz, again.first_frame, again.unit, again.position_mm(0, 0)), (59.94, 7, Unit::Metre, Some([1.0, 0.0, 3.5])));
    let nothing = TakeBuilder::new(vec![], 3, 100.0).build();
    assert_eq!(
        Trc.create(&nothing, &mut Vec::new(), &Notes::new()).unwrap_err().to_string(),
        "trc: the take has no markers, so there is nothing to write"
    );
}

#[test]
fn times_are_seconds() {
    let rows = ["1|0|1|2|3", "2|100|1|2|3", "3|200|1|2|3"];
    let (document, notes) = open(file("3|1", "A", &rows).replace("\n100\t100\t", "\n0.01\t0.01\t"), &NONE);
    assert_eq!((document.take().rate_hz, notes), (0.01, vec![]));
}

#[test]
fn points_that_nobody_named_are_beyond_a_take() {
    let (document, notes) = open(file("2|1", "A", &["1|0.00|1|2|3|7|8|9", "2|0.01|1|2|3"]), &NONE);
    assert_eq!((document.beyond_take(), notes.len()), (vec!["points that were not recognised, behind the last marker".to_owned()], 1));
    let (document, _) = open(file("2|1", "A", &["1|0.00|1|2|3", "2|0.01|1|2|3"]), &NONE);
    assert!(document.beyond_take().is_empty());
}

/// Memory belongs to bytes that are there, not to labels times rows.
#[test]
fn rows_without_cells_are_limited() {
    let rows: String = (1..=4000).flat_map(|f| [f.to_string(), "\t0\n".to_owned()]).collect();
    let text = format!("PathFileType\t4\nDataRate\tNumMarkers\n100\t9000\nFrame#\tTime\t{}\n{rows}", "A\t\t\t".repeat(9000));
    let message = error(&text);
    assert!(message.starts_with("trc: too many rows end long before the last marker"), "{message}");
}

/// Files with random bytes changed, added, cut out or cut off: an error or a take, never a panic, and never other bytes after an unchanged save.
#[test]
fn broken_files_do_not_break_the_reader() {
    let seeds = [
        file("3|2", "A|||B\n||X1|Y1|Z1|X2|Y2|Z2", &["1|0.00|1.5|2|3|4|5|6", "2|0.01|0|0|0||||", "3|0.02|1|2|3"]),
        file("2|2", "A|B\n", &["1|0.00|1,5|2|3|4|5|6|7", "2|0.01|NaN||1|4|5|6|7|8|9"]),
        "PathFileType,4\nUnits,NumMarkers\nm,3\nFrame#,Time,\"A\",,,B\n,,,,\n0,0,1,2,3,4,5,6\n1,.01,1,2,3\n".to_owned(),
    ];
    let seeds: Vec<&str> = seeds.iter().map(String::as_str).collect();
    let opened = survive(&Trc, &seeds, b"\",;\t\n\r.-x0159eN \xff\0X", 20_000, &NONE);
    assert!(opened > 2000, "{opened}");
}
