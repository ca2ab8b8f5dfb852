//! The codec as a whole: what a file says, and what a saved file keeps.
#![allow(clippy::unwrap_used, clippy::indexing_slicing)]

use super::*;
use crate::text::damage::survive;
use crate::{Direction, Marker, Origin, Role, Samples, TakeBuilder, Unit};

const NONE: Stated = Stated { rate_hz: None, unit: None, missing: Samples::new() };
/// Rate and unit, so that no note speaks of them.
const STATED: Stated = Stated { rate_hz: Some(100.0), unit: Some(Unit::Millimetre), missing: Samples::new() };

fn open(text: impl AsRef<[u8]>, stated: &Stated) -> (Box<dyn Document>, Vec<Note>) {
    let notes = Notes::new();
    let document = Csv.open(text.as_ref().to_vec(), stated, &notes).unwrap();
    (document, notes.take())
}

fn error(text: &str) -> String {
    match Csv.open(text.as_bytes().to_vec(), &STATED, &Notes::new()) {
        Ok(_) => "no error".to_owned(),
        Err(e) => e.to_string(),
    }
}

fn save(document: &dyn Document, take: &Take) -> Vec<u8> {
    let mut out = Vec::new();
    document.save(take, &mut out, &Notes::new()).unwrap();
    out
}

/// Opens, fills every missing sample with a position of its frame and marker, saves.
fn filled(text: &str, stated: &Stated) -> String {
    let (document, _) = open(text, stated);
    let mut take = document.take().clone();
    for frame in 0..take.frames() {
        for marker in 0..take.markers.len() {
            let (f, m) = (frame as f64, marker as f64);
            take.fill(frame, marker, [f + 0.25, m + 0.5, -1000.125].map(|v| v * take.unit.mm()));
        }
    }
    String::from_utf8(save(document.as_ref(), &take)).unwrap()
}

/// `measured` as `m`, missing as `.`, frame by frame.
fn timeline(take: &Take) -> String {
    let row = |f: usize| (0..take.markers.len()).map(|m| if take.origin(f, m) == Origin::Missing { '.' } else { 'm' }).collect::<String>();
    (0..take.frames()).map(row).collect::<Vec<_>>().join(" ")
}

#[test]
fn wide_tables_of_every_spelling() {
    for (text, labels, pattern, first) in [
        ("S:A-x, S:A-y, S:A-z\n1, 2, 3\n4, 5, 6\n", "S:A", "m m", 1),
        ("A_X;A_Y;A_Z\r\n1,5;2,5;3\r\n;;\r\n", "A", "m .", 1),
        ("\u{feff}frame\tA.x\tA.y\tA.z\n10\t1\t2\t3\n11\tNaN\tnan\tNA", "A", "m .", 10),
        ("frame,time,A x,A y,A z\n0,0.00,1,2,3\n1,0.01,,,\n", "A", "m .", 0),
        ("B-z,A-x,B-y,A-y,B-x,A-z\n1,2,3,4,5,6\n,2,,4,,6\n", "B A", "mm .m", 1),
        ("A-x,A-y,A-z,note,\n1,2,3,hello,\n4,5,,world,\n\n\n", "A", "m .", 1),
        ("A-x,A-y,A-z\n\"1\",\" 2 \",\"\"\n\"1.5\",2e3,3\n", "A", ". m", 1),
        ("frame,A-x,A-y,A-z\n1,1,2,3\n,,,\n,,,\n", "A", "m", 1), // rows that a spreadsheet left at the end
        ("A-x,A-y,A-z\n1,2,3,\n4,5,6,\n", "A", "m m", 1),        // a separator at the end of every row
        ("A-x,A-y,A-z,\n1,2,3\n4,5,6\n", "A", "m m", 1),
        ("\n\nA-x,A-y,A-z\r1,2,3\r", "A", "m", 1),
    ] {
        let (document, _) = open(text, &STATED);
        let take = document.take();
        let found = take.markers.iter().map(|m| m.label.as_str()).collect::<Vec<_>>().join(" ");
        assert_eq!((found.as_str(), timeline(take).as_str(), take.first_frame), (labels, pattern, first), "{text:?}");
        assert_eq!(String::from_utf8(save(document.as_ref(), take)).unwrap(), text, "saved unchanged");
    }
    let (document, _) = open("B-z,A-x,B-y,A-y,B-x,A-z\n1,2,3,4,5,6\n", &STATED);
    assert_eq!(document.take().position_mm(0, 0), Some([5.0, 3.0, 1.0]));
    assert_eq!(document.take().position_mm(0, 1), Some([2.0, 4.0, 6.0]));
}

#[test]
fn saving_changes_the_cells_of_filled_samples_only() {
    for (before, after) in [
        // surrounding blanks, line ends and the missing end of the last line stay
        (
            "A-x, A-y, A-z,c\r\n1.2345, 2.3456, 3.4567,\n,  , ,x",
            "A-x, A-y, A-z,c\r\n1.2345, 2.3456, 3.4567,\n1.2500,  0.5000, -1000.1250,x",
        ),
        ("A-x;A-y;A-z\n1,25;2,5;3\n NaN ;\"\";\"NaN\"\n", "A-x;A-y;A-z\n1,25;2,5;3\n 1,25 ;\"0,5\";\"-1000,125\"\n"),
        // a decimal comma between commas needs quotes
        ("A-x,A-y,A-z\n\"1,25\",\"2,5\",3\n,,\"\"\n", "A-x,A-y,A-z\n\"1,25\",\"2,5\",3\n\"1,25\",\"0,5\",\"-1000,125\"\n"),
        // a sample with some coordinates: those stay
        ("A-x,A-y,A-z\n1.5,2,3\n7,,9\n", "A-x,A-y,A-z\n1.5,2,3\n7,0.5,9\n"),
        // other columns stay empty
        ("A-x,A-y,A-z,e\n1.5,2,3,\n,,,\n", "A-x,A-y,A-z,e\n1.5,2,3,\n1.25,0.5,-1000.125,\n"),
    ] {
        assert_eq!(filled(before, &STATED), after);
    }
}

#[test]
fn units_stated_and_guessed() {
    let metres = "A-x,A-y,A-z,B-x,B-y,B-z\n0,0,1.5,0.5,0,1\n,,,0.5,0,1\n";
    let (document, notes) = open(metres, &NONE);
    assert_eq!(notes, [Note::RateAssumed { rate_hz: 100.0 }, Note::UnitAssumed { unit: Unit::Metre }]);
    assert_eq!((document.take().unit, document.take().position_mm(0, 1)), (Unit::Metre, Some([500.0, 0.0, 1000.0])));
    assert!((document.rounding_mm() - 0.0005).abs() < 1e-6, "{}", document.rounding_mm());
    assert_eq!(filled(metres, &NONE), metres.replace(",,,", "1.25,0.5,-1000.125,"));
    let unit = |text: &str, stated: &Stated| open(text, stated).0.take().unit;
    assert_eq!(unit("A-x,A-y,A-z,B-x,B-y,B-z\n0,0,1500,500,0,1000\n", &NONE), Unit::Millimetre);
    assert_eq!(unit("A-x,A-y,A-z\n0,0,1500\n", &NONE), Unit::Millimetre, "one marker: its distance from the origin");
    assert_eq!(unit("A-x [cm],A-y [cm],A-z [cm]\n0,0,1.5\n", &NONE), Unit::Centimetre);
    assert_eq!(unit("A-x [cm],A-y [cm],A-z [cm]\n0,0,1.5\n", &STATED), Unit::Millimetre, "the user knows better");
    let (_, notes) = open("A-x [cm],A-y [cm],A-z [cm]\n0,0,1.5\n", &Stated { rate_hz: Some(1.0), unit: None, missing: Samples::new() });
    assert_eq!(notes, []);
}

#[test]
fn zeros_that_are_gaps_and_zeros_that_are_not() {
    let table = |rows: &[&str]| format!("A-x,A-y,A-z,B-x,B-y,B-z\n{}\n", rows.join("\n"));
    // the marker jumps to the origin and back
    let gap = table(&["500,0,900,700,0,1800", "510,0,900,710,0,1800", "0,0,0,0.0,-0,0.000", "530,0,900,730,0,1800"]);
    let (document, notes) = open(&gap, &STATED);
    assert_eq!((timeline(document.take()).as_str(), notes), ("mm mm .. mm", vec![Note::ZeroReadAsMissing { samples: 2 }]));
    assert_eq!(filled(&gap, &STATED), gap.replace("0,0,0,0.0,-0,0.000", "2.25,0.5,-1000.125,2.25,1.5,-1000.125"));
    // it passes through the origin
    let pass = table(&["-20,0,0,700,0,1800", "-10,0,0,710,0,1800", "0,0,0,720,0,1800", "10,0,0,730,0,1800"]);
    // a root that is the origin of its body
    let root =
        "R-x,R-y,R-z,A-x,A-y,A-z,B-x,B-y,B-z,C-x,C-y,C-z\n0,0,0,100,0,900,150,0,-850,-200,10,50\n0,0,0,100,0,900,150,0,-850,-200,10,50\n";
    let root = root.to_owned();
    for text in [&pass, &root] {
        let (document, notes) = open(text, &STATED);
        assert_eq!((timeline(document.take()).contains('.'), notes), (false, vec![]), "{text}");
        assert_eq!(filled(text, &STATED), *text);
    }
    // never seen, far from everything
    let never = table(&["0,0,0,5000,0,900", "0,0,0,5010,0,900"]);
    assert_eq!(timeline(open(&never, &STATED).0.take()), ".m .m");
    // two zeros do not make a gap
    assert_eq!(timeline(open(table(&["500,0,900,700,0,1800", "0,0,5,710,0,1800"]), &STATED).0.take()), "mm mm");
}

#[test]
fn rates_and_frame_numbers() {
    for (text, rate) in [
        ("time,A-x,A-y,A-z\n0.000,1,2,3\n0.008,1,2,3\n0.017,1,2,3\n0.025,1,2,3\n", 120.0),
        ("Time (ms),A-x,A-y,A-z\n0,1,2,3\n5,1,2,3\n10,1,2,3\n", 200.0),
        ("frame;time (s);A-x;A-y;A-z\n1;0,00;1;2;3\n2;0,02;1;2;3\n", 50.0),
        ("time,frame,marker,x,y,z\n0.00,0,A,1,2,3\n0.04,2,A,1,2,3\n0.02,1,A,1,2,3\n", 50.0),
    ] {
        let (document, notes) = open(text, &Stated { rate_hz: None, unit: Some(Unit::Millimetre), missing: Samples::new() });
        assert_eq!((document.take().rate_hz, notes), (rate, vec![]), "{text}");
        assert_eq!(open(text, &STATED).0.take().rate_hz, 100.0, "stated");
    }
    let (document, notes) = open("frame,A-x,A-y,A-z\n5,1,2,3\n7,1,2,3\n9,1,2,3\n", &STATED);
    assert_eq!((document.take().first_frame, document.take().frames(), notes), (5, 3, vec![Note::FrameStep { step: 2 }]));
}

#[test]
fn what_is_noted() {
    let notes = |text: &str| open(text, &STATED).1.iter().map(ToString::to_string).collect::<Vec<_>>();
    assert_eq!(
        notes("A-x,A-y,A-z,A-x,A-y,A-z,emg 1,w\n1,2,3,4,5,6,7,8\n1,2,,4,5,6,7,8\n"),
        [
            "1 samples have only some of their coordinates; they count as missing, what is given stays as written",
            "labels that occur more than once: A",
            "columns that are no markers were left as they are: emg 1, w",
        ]
    );
    assert_eq!(
        notes("A-x,A-y,A-z,LKneeAngles-x,LKneeAngles-y,LKneeAngles-z\n1,2,3,4,5,6\n1,2,3,,,\n"),
        ["3 columns are model outputs, not markers; left as they are".replace('3', "1")]
    );
}

#[test]
fn long_tables() {
    let sorted = "frame,marker,x,y,z,note\n4,A,1.5,2,3,a\n4,B,4.5,5,6,b\n5,B,,,,c\n7,A,7.5,8,9,d\n";
    let (document, notes) = open(sorted, &STATED);
    let take = document.take();
    assert_eq!((timeline(take).as_str(), take.first_frame), ("mm .. .. m.", 4));
    assert_eq!(notes, [Note::OtherColumns { names: vec!["note".to_owned()] }]);
    assert_eq!(take.position_mm(0, 1), Some([4.5, 5.0, 6.0]));
    assert_eq!(String::from_utf8(save(document.as_ref(), take)).unwrap(), sorted);
    assert_eq!(
        filled(sorted, &STATED),
        "frame,marker,x,y,z,note\n4,A,1.5,2,3,a\n4,B,4.5,5,6,b\n5,B,1.25,1.5,-1000.125,c\n5,A,1.25,0.5,-1000.125,\n\
         6,A,2.25,0.5,-1000.125,\n6,B,2.25,1.5,-1000.125,\n7,A,7.5,8,9,d\n7,B,3.25,1.5,-1000.125,\n"
    );
    // by marker: new rows go to the end; times, blanks, quotes, decimal commas and line ends are copied
    let by_marker = "z; y; x; marker; time (s); frame\r\n3; 2; 1,5; \"A\"; 0,00; 1\r\n3; 2; 1,5; \"A\"; 0,02; 3\r\n6; 5; 4; B; 0,00; 1";
    assert_eq!(
        filled(by_marker, &STATED),
        // 1 and 3 are neighbours: the numbers go up by 2
        format!("{by_marker}\r\n-1000,125; 1,5; 1,25; B; 0,02; 3")
    );
    // a frame without rows gets a time, too
    assert_eq!(
        filled("frame,time,marker,x,y,z\n1,0.50,A,1,2,3.5\n2,0.51,A,1,2,3\n4,0.53,A,1,2,3\n", &STATED),
        "frame,time,marker,x,y,z\n1,0.50,A,1,2,3.5\n2,0.51,A,1,2,3\n3,0.52,A,2.25,0.5,-1000.125\n4,0.53,A,1,2,3\n"
    );
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    for (text, expected) in [
        (
            "A-x,A-y,A-z\n1,2,3\n4,5\n",
            "this row has 2 columns, the header has 3; nothing was skipped, delete or complete this row (line 3)",
        ),
        ("A-x,A-y,A-z\n1,2,3,4\n", "this row has 4 columns, the header has 3; nothing was skipped, delete or complete this row (line 2)"),
        (
            "A-x,A-y,A-z\n1,2,3\n1,2,3,\n",
            "this row has 4 columns, the first row has 3; nothing was skipped, delete or complete this row (line 3)",
        ),
        ("A-x,A-y,A-z\n1,2,3\n\n1,2,3\n", "this row is empty, but rows follow; nothing was skipped, delete or complete it (line 3)"),
        (
            "frame,A-x,A-y,A-z\n1,1,2,3\n,,,\n2,1,2,3\n",
            "this row is empty, but rows follow; nothing was skipped, delete or complete it (line 3)",
        ),
        (
            "A-x,A-y,A-z\n1,2,3\n1,two,3\n",
            "\"two\" is not a number, expected a coordinate; correct it, or leave the cell empty if it is missing (line 3, column 2)",
        ),
        (
            "A-x;A-y;A-z\n1,5;2;3\n1;2;3.5\n",
            "\"3.5\" has another decimal sign than the numbers before, which have \",\"; write all numbers in one way (line 3, column 3)",
        ),
        (
            "frame,A-x,A-y,A-z\n1,1,2,3\n2,1,2,3\n5,1,2,3\n",
            "frame 5 follows frame 2, expected 3; add the missing rows with empty cells, or rename the column \"frame\" to have it left alone \
             (line 4, column 1)",
        ),
        (
            "frame,A-x,A-y,A-z\none,1,2,3\n",
            "\"one\" is not a whole number below 9e15, expected the number of a frame; correct it (line 2, column 1)",
        ),
        ("A-x,A-y,A-z\n", "there is a header, but no row of numbers follows; export the take again"),
        ("frame,marker,x,y,z\n", "there is a header, but no row of numbers follows; export the take again"),
        ("A-x (mm),A-y (mm),A-z (mm),B-x (m),B-y (m),B-z (m)\n1,2,3,4,5,6\n", "no error"), // the user stated one
        (
            "frame,marker,x,y,z\n1,A,1,2,3\n2,A,1,2,3\n1,A,1,2,3\n",
            "marker \"A\" of frame 1 was already given in line 2; delete one of the rows (line 4)",
        ),
        ("frame,marker,x,y,z\n1,,1,2,3\n", "this row names no marker; nothing was skipped, delete or complete this row (line 2)"),
        (
            "frame,marker,x,y,z\n1,A,1,2,3\n2,A,1,2,3\n2000000000,A,1,2,3\n",
            "frames 1 to 2000000000 of 1 markers would be 2000000000 samples, but there are only 3 rows; correct the frame numbers (line 4)",
        ),
        (
            "frame,marker,x,y,z\n-9000000000000000,A,1,2,3\n9000000000000000,A,1,2,3\n",
            "frames -9000000000000000 to 9000000000000000 of 1 markers would be 18000000000000001 samples, but there are only 2 rows; \
             correct the frame numbers (line 3)",
        ),
        (
            "frame,A-x,A-y,A-z\n9223372036854775807,1,2,3\n",
            "\"9223372036854775807\" is not a whole number below 9e15, expected the number of a frame; correct it (line 2, column 1)",
        ),
    ] {
        let expected = if expected == "no error" { expected.to_owned() } else { format!("csv: {expected}") };
        assert_eq!(error(text), expected);
    }
    let rotations = "A.z,A.x,A.y,B.z,B.x,B.y\n1,2,3,4,5,6\n";
    assert_eq!(
        Csv.open(rotations.into(), &NONE, &Notes::new()).err().unwrap().to_string(),
        "csv: the columns of each name come in the order z, x, y, and no value is beyond ±360: these seem to be rotations of joints, not positions; \
         if they are positions, say their unit with --units"
    );
    assert_eq!(open(rotations, &STATED).0.take().position_mm(0, 0), Some([2.0, 3.0, 1.0]));
    let mixed = "A-x (mm),A-y (mm),A-z (mm),B-x (m),B-y (m),B-z (m)\n1,2,3,4,5,6\n";
    assert_eq!(
        Csv.open(mixed.into(), &NONE, &Notes::new()).err().unwrap().to_string(),
        "csv: the header states different units for different columns; write all coordinates in one unit"
    );
}

#[test]
fn who_is_ours() {
    for (head, expected) in [
        (&b"A-x,A-y,A-z\n1,2,3"[..], Match::Certain),
        (b"frame;marker;x;y;z\n", Match::Certain),
        (b"a,b,c\n", Match::Maybe),
        (b"Trajectories\n100\n", Match::No), // a format of its own
        (b"A,,\nX,Y,Z\n", Match::Certain),
        (b"1,2,3\n4,5,6\n", Match::Maybe),
        (b"\xff\xfeA\0", Match::Maybe),
        (b"HIERARCHY\nROOT Hips\n", Match::Maybe),
        (b"hello world\n", Match::No),
        (b"\x02P\x00\x00,,,\n", Match::No),
        (b"", Match::No),
    ] {
        assert_eq!(Csv.sniff(head), expected, "{:?}", String::from_utf8_lossy(head));
    }
}

/// A take with everything that makes writing hard.
fn odd_take(rate_hz: f64, unit: Unit, labels: &[&str]) -> Take {
    let markers = labels.iter().map(|l| Marker::new(*l)).collect();
    let mut b = TakeBuilder::new(markers, 7, rate_hz).first_frame(-2).unit(unit);
    for frame in 0..7 {
        for marker in 0..labels.len() {
            if (frame + marker) % 4 != 0 {
                let value = (frame * 100 + marker) as f64;
                b.set(frame, marker, [value / 7.0, f64::from(-0.1f32), 1e-9 * value], Origin::Measured);
            }
        }
    }
    b.build()
}

#[test]
fn what_is_created_is_read_back() {
    let labels = ["S:C7", "", "a,b", " \"q\" ", "line\nend", "Jörg", "t (mm)", "C-x", "#1", "frame-inde", "time"];
    for unit in Unit::ALL {
        for rate in [100.0, 59.94, 107.53, 60.0033, 1000.0, 0.333_333_333_3] {
            for long in [false, true] {
                let take = odd_take(rate, unit, &labels);
                let (mut text, notes) = (Vec::new(), Notes::new());
                if long { create_long(&take, &mut text, &notes) } else { Csv.create(&take, &mut text, &notes) }.unwrap();
                assert_eq!(notes.take(), []);
                assert_eq!(Csv.sniff(&text), Match::Certain);
                let (document, notes) = open(&text, &NONE);
                let read = document.take();
                assert_eq!(notes, [], "{}", String::from_utf8_lossy(&text));
                assert_eq!((read.rate_hz, read.unit, read.first_frame, &read.markers), (rate, unit, -2, &take.markers));
                for (f, m) in (0..7).flat_map(|f| (0..labels.len()).map(move |m| (f, m))) {
                    match (take.position_mm(f, m), read.position_mm(f, m)) {
                        (Some(a), Some(b)) => assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-15 * a.abs()), "{a:?} {b:?}"),
                        (a, b) => assert_eq!(a, b),
                    }
                }
            }
        }
    }
}

#[test]
fn what_cannot_be_created_is_said() {
    let mut take = odd_take(100.0, Unit::Millimetre, &["A", "A", "LKneeAngles"]);
    take.markers[2].role = Role::ModelOutput;
    let take = TakeBuilder::from(take).up(Some(Direction::PLUS_Z)).build();
    let (mut text, notes) = (Vec::new(), Notes::new());
    Csv.create(&take, &mut text, &notes).unwrap();
    let notes: Vec<String> = notes.take().iter().map(ToString::to_string).collect();
    assert_eq!(notes, ["csv cannot hold 1 columns of model outputs; left out", "csv cannot hold which axis points up (+z); left out"]);
    assert_eq!(open(&text, &NONE).0.take().markers.len(), 2, "the same label twice");
    assert_eq!(
        create_long(&take, &mut text, &Notes::new()).unwrap_err().to_string(),
        "csv: two markers are called \"A\", which a long table cannot tell apart; write a wide one"
    );
    let none = TakeBuilder::new(vec![], 3, 100.0).build();
    assert_eq!(
        Csv.create(&none, &mut text, &Notes::new()).unwrap_err().to_string(),
        "csv: the take has no markers, so there is nothing to write"
    );
}

/// Files with random bytes changed, added, cut out or cut off: an error or a take, never a panic, and never other bytes after an unchanged save.
#[test]
fn broken_files_do_not_break_the_reader() {
    let seeds = [
        "frame,time,S:A-x, S:A-y, S:A-z,B-x,B-y,B-z,note\r\n1,0.00,1.5,2,3,,,,\"a \"\"b\"\r\n2,0.01,0,0,0,4,5.25,6,\r\n3,0.02,NaN,,1,4,5,6,\n",
        "frame;marker;x;y;z\n1;A;1,5;2;3\n1;\"B\";;;\n2;A;1,5;2;3\n4;A;0;0;0\n",
        "A_X\tA_Y\tA_Z (mm)\n1e3\t-2.5\t+.5\n\t\t\n",
    ];
    let opened = survive(&Csv, &seeds, b"\",;\t\n\r.-x0159eN \xff\0", 30_000, &STATED);
    assert!(opened > 3000, "{opened}");
}

#[test]
fn what_is_given_of_a_partial_sample_stays_in_both_flavours() {
    for text in ["A-x,A-y,A-z,B-x,B-y,B-z\n1,2,3,4,5,6\n1,2,3,,7,\n", "frame,marker,x,y,z\n1,A,1,2,3\n1,B,4,5,6\n2,A,1,2,3\n2,B,,7,\n"] {
        let document = Csv.open(text.as_bytes().to_vec(), &STATED, &Notes::new()).unwrap();
        let mut take = document.take().clone();
        assert_eq!((take.origin(1, 1), take.origin(1, 0)), (Origin::Missing, Origin::Measured), "{text}");
        assert!(take.fill(1, 1, [40.0, 50.0, 60.0]));
        assert_eq!(take.position_mm(1, 1).map(|p| p[1]), Some(7.0 * take.unit.mm()), "{text}");
        let again = Csv.open(save(document.as_ref(), &take), &STATED, &Notes::new()).unwrap();
        assert_eq!(again.take().position_mm(1, 1), take.position_mm(1, 1), "{text}");
    }
}

#[test]
fn samples_stated_missing_can_be_replaced() {
    let wide = "frame,A-x (mm),A-y (mm),A-z (mm),B-x (mm),B-y (mm),B-z (mm)\n1,1,2,3,0,0,0\n2,4,5,,7,8,9\n";
    let long = "frame,marker,x (mm),y (mm),z (mm)\n1,A,1,2,3\n1,B,0,0,0\n2,A,4,5,\n2,B,7,8,9\n";
    for (text, expected) in [
        (wide, "frame,A-x (mm),A-y (mm),A-z (mm),B-x (mm),B-y (mm),B-z (mm)\n1,1,2,3,5.500,6.500,7.500\n2,5.500,6.500,7.500,7,8,9\n"),
        (long, "frame,marker,x (mm),y (mm),z (mm)\n1,A,1,2,3\n1,B,5.500,6.500,7.500\n2,A,5.500,6.500,7.500\n2,B,7,8,9\n"),
    ] {
        let stated = Stated { rate_hz: Some(100.0), missing: [(0, 1), (1, 0), (7, 7)].into_iter().collect(), ..NONE };
        let (document, _) = open(text, &stated);
        let mut take = document.take().clone();
        for (frame, marker) in [(0, 1), (1, 0)] {
            assert_eq!(take.origin(frame, marker), Origin::Missing);
            assert!(take.fill(frame, marker, [5.5, 6.5, 7.5]));
        }
        let mut saved = Vec::new();
        document.save(&take, &mut saved, &Notes::new()).unwrap();
        assert_eq!(String::from_utf8(saved).unwrap(), expected);
        let mut same = Vec::new();
        document.save(document.take(), &mut same, &Notes::new()).unwrap();
        assert_eq!(String::from_utf8(same).unwrap(), text);
    }
}

/// What a column is measured in says more than its name.
#[test]
fn a_stated_length_is_no_model_output() {
    for (text, outputs) in [
        ("LGripForce-x (mm),LGripForce-y (mm),LGripForce-z (mm)\n1,2,3\n4,5,6\n", 0),
        ("LGripForce-x,LGripForce-y,LGripForce-z\n1,2,3\n4,5,6\n", 1),
        ("LGripForce-x (mm),LGripForce-y,LGripForce-z\n1,2,3\n4,5,6\n", 1),
        ("frame,marker,x (mm),y (mm),z (mm)\n1,LGripForce,1,2,3\n2,LGripForce,4,5,6\n", 0),
        ("frame,marker,x,y,z\n1,LGripForce,1,2,3\n2,LGripForce,4,5,6\n", 1),
        ("LGripForce,,\nX,Y,Z\nmm,mm,mm\n1,2,3\n4,5,6\n", 0),
        ("LGripForce,,\nX,Y,Z\n1,2,3\n4,5,6\n", 1),
    ] {
        let (document, _) = open(text, &STATED);
        let found = document.take().markers.iter().filter(|m| m.role == Role::ModelOutput).count();
        assert_eq!(found, outputs, "{text}");
    }
}
