//! The codec as a whole: what an export says, and what a saved file keeps.
#![allow(clippy::unwrap_used, clippy::indexing_slicing)]

use super::*;
use crate::{Direction, Marker, Samples};

const NONE: Stated = Stated { rate_hz: None, unit: None, missing: Samples::new() };

/// An export of two markers with these lines behind its header, `|` for tabs.
fn file(more: &str) -> String {
    format!("NO_OF_FRAMES|2\nNO_OF_MARKERS|2\nFREQUENCY|100\nDATA_INCLUDED|3D\nMARKER_NAMES|A b|C\n{more}").replace('|', "\t")
}

fn open(text: &str, stated: &Stated) -> (Box<dyn Document>, Vec<String>) {
    let notes = Notes::new();
    let document = Tsv.open(text.as_bytes().to_vec(), stated, &notes).unwrap();
    (document, notes.take().iter().map(ToString::to_string).collect())
}

fn save(document: &dyn Document, take: &Take) -> String {
    let mut out = Vec::new();
    document.save(take, &mut out, &Notes::new()).unwrap();
    String::from_utf8(out).unwrap()
}

#[test]
fn rows_of_every_shape() {
    let heading = "Frame|Time|A b X|A b Y|A b Z|C X|C Y|C Z|";
    for (more, first) in [
        ("1|2|3|4|5|6\n1|2|3|0.000|0.000|0.000\n".to_owned(), 1),
        ("1|2|3|4|5|6|\n1|2|3||||\n".to_owned(), 1),
        ("5|0.04|1|2|3|4|5|6\n6|0.05|1|2|3|null|null|null\n".to_owned(), 5),
        (format!("{heading}\n5|0.04|1|2|3|4|5|6\n6|0.05|1|2|3|||\n"), 5),
        ("A b X|A b Y|A b Z|C X|C Y|C Z\n1|2|3|4|5|6\n1|2|3|NaN|NaN|NaN\n".to_owned(), 1),
    ] {
        let text = file(&more);
        let (document, _) = open(&text, &NONE);
        let mut take = document.take().clone();
        assert_eq!((take.frames(), take.rate_hz, take.first_frame, take.unit), (2, 100.0, first, Unit::Millimetre), "{text}");
        assert_eq!((take.markers[0].label.as_str(), take.position_mm(0, 1)), ("A b", Some([4.0, 5.0, 6.0])), "{text}");
        assert_eq!(take.origin(1, 1), Origin::Missing, "{text}");
        assert_eq!(save(document.as_ref(), &take), text);
        assert!(take.fill(1, 1, [4.5, 5.5, 6.5]));
        let saved = save(document.as_ref(), &take);
        assert!(saved.contains("1\t2\t3\t4.5") && saved.contains("\t6.5"), "{saved}");
        assert_eq!(open(&saved, &NONE).0.take().position_mm(1, 1), Some([4.5, 5.5, 6.5]));
    }
}

#[test]
fn zeros_are_gaps_unless_gaps_are_something_else() {
    let (document, notes) = open(&file("1|2|3|4|5|6\n1|2|3|0|0|0\n"), &NONE);
    assert_eq!(document.take().origin(1, 1), Origin::Missing);
    assert_eq!(notes, ["1 samples at exactly 0 0 0 were read as missing"]);
    // a marker that walks through the origin, in a file that has empty cells for gaps
    let (document, notes) =
        open(&file("900|0|0|-1|-1|-1\n900|0|0|0|0|0\n900|0|0|1|1|1\n900|0|0|||\n").replace("FRAMES\t2", "FRAMES\t4"), &NONE);
    assert_eq!(document.take().position_mm(1, 1), Some([0.0; 3]));
    assert_eq!(notes, [] as [&str; 0]);
}

#[test]
fn types_of_trajectories() {
    let (document, notes) = open(&file("TRAJECTORY_TYPES|Mixed|Gap-filled\nEVENT|jump|1|0.0\n1|2|3|4|5|6\n1|2|3|||\n"), &NONE);
    let take = document.take();
    assert_eq!([take.origin(0, 0), take.origin(0, 1), take.origin(1, 1)], [Origin::Measured, Origin::Derived, Origin::Missing]);
    assert_eq!(notes, [] as [&str; 0]);
    assert_eq!(document.beyond_take(), ["1 event"]);
}

#[test]
fn what_is_an_export_and_what_is_none() {
    let text = file("1|2|3|4|5|6\n1|2|3|4|5|6\n");
    assert_eq!(Tsv.sniff(text.as_bytes()), Match::Certain);
    assert_eq!(Tsv.sniff(b"FILE_VERSION\t2.0.0\r\nNO_OF_FRAMES\t1\r\n"), Match::Certain);
    assert_eq!(Tsv.sniff(b"frame\tA-x\tA-y\n"), Match::No);
    for extension in [None, Some("tsv"), Some("txt")] {
        assert_eq!(crate::detect(text.as_bytes(), extension).unwrap().info().name, "tsv", "{extension:?}");
    }
    // the usual owner of the extension writes it, and other tables may have it
    assert_eq!(crate::by_extension("TSV").unwrap().info().name, "tsv");
    assert_eq!(crate::detect(b"A-x\tA-y\tA-z\n1\t2\t3\n", Some("tsv")).unwrap().info().name, "csv");
    let csv = crate::detect(text.as_bytes(), Some("csv")).unwrap();
    let message = csv.open(text.into_bytes(), &NONE, &Notes::new()).err().unwrap().to_string();
    assert_eq!(message, "csv: this seems to be a TSV export of Qualisys Track Manager, which is another format; name it .tsv");
}

#[test]
fn what_is_created() {
    let mut b = TakeBuilder::new(vec![Marker::new("A b"), Marker::new("")], 2, 59.94).unit(Unit::Metre).first_frame(7);
    b.set(0, 0, [1.0, -0.0, 3.5], Origin::Measured);
    let take = b.up(Some(Direction::PLUS_Z)).build();
    let (mut out, notes) = (Vec::new(), Notes::new());
    Tsv.create(&take, &mut out, &notes).unwrap();
    let text = String::from_utf8(out).unwrap();
    let tail = "MARKER_NAMES|A b|unlabelled_2\r\nFrame|Time|A b X|A b Y|A b Z|unlabelled_2 X|unlabelled_2 Y|unlabelled_2 Z\r\n\
                7|0.000000|1|0|3.5|0.000|0.000|0.000\r\n8|0.016683|0.000|0.000|0.000|0.000|0.000|0.000\r\n";
    assert!(text.starts_with("NO_OF_FRAMES\t2\r\nNO_OF_CAMERAS\t0\r\nNO_OF_MARKERS\t2\r\nFREQUENCY\t59.94\r\n"), "{text}");
    assert!(text.replace('\t', "|").ends_with(tail), "{text}");
    let said: Vec<String> = notes.take().iter().map(ToString::to_string).collect();
    let changed = ["1 labels that are empty were changed: now called unlabelled_2", "lengths are written in mm, not m"];
    assert_eq!(said, [&["tsv cannot hold which axis points up (+z); left out"][..], &changed].concat());
    let (again, notes) = open(&text, &NONE);
    assert_eq!(notes, ["3 samples at exactly 0 0 0 were read as missing"]);
    assert_eq!((again.take().rate_hz, again.take().first_frame), (59.94, 7));
    let mut b = TakeBuilder::from(take);
    b.set(1, 0, [0.0; 3], Origin::Measured);
    let mut bytes = Vec::new();
    Tsv.create(&b.build(), &mut bytes, &Notes::new()).unwrap();
    let (again, _) = open(&String::from_utf8(bytes).unwrap(), &NONE);
    assert_eq!(again.take().position_mm(1, 0), Some([1e-6, 0.0, 0.0]), "zeros would read as missing");
}
