//! Files in, takes and files out.
#![allow(clippy::unwrap_used)]

use super::*;
use crate::Unit;

fn opened_as(text: &str, stated: &Stated) -> (Result<Box<dyn Document>, String>, Vec<String>) {
    let notes = Notes::new();
    let document = Motive.open(text.as_bytes().to_vec(), stated, &notes).map_err(|e| e.to_string());
    (document, notes.take().iter().map(ToString::to_string).collect())
}

fn opened(text: &str) -> (Result<Box<dyn Document>, String>, Vec<String>) {
    opened_as(text, &Stated::default())
}

const SETTINGS: &str = "Format Version,1.23,Take Name,t,Capture Frame Rate,240,Export Frame Rate,120.000000,Total Exported Frames,3,\
                        Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global";
/// A rigid body, where it expects its marker, and two markers, one with its quality.
const HEADER: &str = ",,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body Marker,Rigid Body Marker,\
                      Rigid Body Marker,Marker,Marker,Marker,Marker,Marker,Marker,Marker\n\
                      ,,R,R,R,R,R,R,R,R,R:1,R:1,R:1,R:1,R:1,R:1,R:1,Unlabeled 7,Unlabeled 7,Unlabeled 7\n\
                      ,,i,i,i,i,i,i,i,i,j,j,j,k,k,k,k,l,l,l\n\
                      ,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error,Position,Position,Position,Position,Position,\
                      Position,Marker Quality,Position,Position,Position\n\
                      Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z,X,Y,Z,,X,Y,Z\n";
const ROWS: &str = "0,0.000000,0.1,0.2,0.3,0.9,1,2,3,0.001,0.5,1.5,2.5,0.5,1.5,2.5,1,0.1,0.2,0.3\n\
                    1,0.008333,0.1,0.2,0.3,0.9,1,2,3,0.001,0.5,1.5,2.5,,,,0,0.1,0.2,0.3\n\
                    2,0.016667,,,,,,,,,,,,0.5,1.5,2.5,1,,,\n";

#[test]
fn markers_are_read_and_assets_are_left_alone() {
    let text = format!("{SETTINGS}\n\n{HEADER}{ROWS}");
    assert_eq!(crate::detect(text.as_bytes(), Some("CSV")).unwrap().info().name, NAME);
    let (document, notes) = opened(&text);
    let document = document.unwrap();
    let take = document.take();
    assert_eq!((take.rate_hz, take.unit, take.first_frame, take.frames()), (120.0, Unit::Metre, 0, 3));
    assert_eq!(take.markers.iter().map(|m| m.label.as_str()).collect::<Vec<_>>(), ["R:1", "Unlabeled 7"]);
    assert_eq!((take.position_mm(0, 0), take.position_mm(1, 0), take.position_mm(2, 1)), (Some([500.0, 1500.0, 2500.0]), None, None));
    assert_eq!(notes, ["columns that are no markers were left as they are: Rigid Body R, Rigid Body Marker R:1, Marker R:1"]);
    let mut repaired = take.clone();
    assert!(repaired.fill(1, 0, [501.0, 1502.0, 2503.0]));
    let mut out = Vec::new();
    document.save(&repaired, &mut out, &Notes::new()).unwrap();
    assert_eq!(String::from_utf8(out).unwrap(), text.replace("2.5,,,,0,", "2.5,0.501000,1.502000,2.503000,0,"));
}

#[test]
fn headers_of_other_versions() {
    let newer = ",Type,,Marker,Marker,Marker\n,Name,,A,A,A\n,ID,,x,x,x\n,Parent,,,,\n,,,Position,Position,Position\nFrame,Time (Seconds),TimeCode,X,Y,Z\n\
                 5,0.041667,15:26:46:12.02,1,2,3\n6,0.050000,15:26:46:12.03,,,\n7,0.058333,15:26:46:12.04,1,2,3\n";
    let older = ",,Marker,Marker,Marker\n,,A,A,A\n,,Position,Position,Position\nFrame,Time,X,Y,Z\n5,0.041667,1,2,3\n6,0.050000,,,\n7,0.058333,1,2,3\n";
    for (body, others) in [(newer, 1), (older, 0)] {
        let (document, notes) = opened(&format!("\u{feff}{SETTINGS},,,\n,,,\n{body}"));
        let document = document.unwrap();
        assert_eq!((document.take().markers.len(), document.take().first_frame, notes.len()), (1, 5, others), "{notes:?}");
    }
    // a spreadsheet in much of Europe
    let text = format!("{SETTINGS}\n\n{older}").replace("120.000000", "120,000000").replace("A,A", "A;A");
    let text: String = text.replace(',', ";").replace("120;000000", "120,000000").replace('.', ",").replace("\u{feff}", "");
    assert_eq!(opened(&text).0.unwrap().take().rate_hz, 120.0, "{text}");
}

#[test]
fn what_the_settings_say_and_do_not_say() {
    let rows = HEADER.to_owned() + ROWS;
    let with = |from: &str, to: &str| format!("{}\n\n{rows}", SETTINGS.replace(from, to));
    let last = |text: &str| opened(text).1.last().cloned().unwrap_or_default();
    assert!(opened(&with("Exported Frames,3", "Exported Frames,5")).1.contains(&"the file claims 5 frames and holds 3".to_owned()));
    assert!(opened(&with(",Length Units,Meters", "")).1.contains(&"the file names no unit, m assumed (say it with --units)".to_owned()));
    assert_eq!(opened(&with("Export Frame Rate,120.000000,", "")).1.len(), 2, "{}", last(&with("Export Frame Rate,120.000000,", "")));
    assert_eq!(
        opened(&with("Export Frame Rate,120.000000,", "")).1.first().unwrap(),
        "the first line says 240 Hz, the times say 120 Hz; 240 Hz was taken (say it with --rate)"
    );
    let inches = with("Meters", "Inches");
    assert_eq!(
        opened(&inches).0.err().unwrap(),
        "motive: Length Units are \"Inches\", expected Millimeters, Centimeters or Meters; export it again in one of these (line 1)"
    );
    let stated = Stated { unit: Some(Unit::Centimetre), ..Stated::default() };
    assert_eq!(opened_as(&inches, &stated).0.unwrap().take().position_mm(0, 0), Some([5.0, 15.0, 25.0]));
}

#[test]
fn expected_places_stand_in_for_markers() {
    let text = format!("{SETTINGS}\n\n{HEADER}{ROWS}").replace(",Marker,Marker,Marker,Marker", ",,,,");
    let (document, notes) = opened(&text.replace(",Marker,Marker,Marker\n", ",,,\n"));
    assert_eq!(document.unwrap().take().markers.len(), 1);
    assert_eq!(notes[0], "the file holds no measured markers; the places where bodies expect their markers were taken as the markers");
    let local = text.replace(",Marker,Marker,Marker\n", ",,,\n").replace("Space,Global", "Space,Local");
    assert!(opened(&local).0.err().unwrap().contains("relative to these"));
}

#[test]
fn what_is_refused() {
    let bones = ",,Bone,Bone,Bone\n,,B,B,B\n,,i,i,i\n,,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z\n0,0,1,2,3\n";
    for (text, expected) in [
        (
            format!("{SETTINGS}\n\n{bones}"),
            "motive: the file holds no positions of markers (its columns are: Bone); export it again with Markers",
        ),
        (format!("{SETTINGS}\n\n0,0,1,2,3\n"), "motive: no header line begins with Frame; export the take again, with its header (line 4)"),
        (
            format!("{SETTINGS}\n\n,,Marker\nFrame,Time,X\n"),
            "motive: fewer than three header lines stand above Frame, expected types, names, ... and Position; export it again, with its header",
        ),
        (
            format!("{SETTINGS}\n\n{}", bones.replace("Bone", "Marker").replace("X,Y,Z", "X,Z,Y")),
            "motive: the positions of \"B\" are not in the three columns X, Y, Z; export the take again (line 7, column 3)",
        ),
        (
            format!("{SETTINGS}\n\n{}2,0,1,2,3\n3,0,1,2,3\n1,0,1,2,3\n", bones.replace("Bone", "Marker")),
            "motive: frame 3 follows frame 2, expected 4; add the missing rows with empty cells, or rename the column \"frame\" to have it left \
             alone (line 10, column 1)",
        ),
    ] {
        assert_eq!(opened(&text).0.err().unwrap(), expected, "{text}");
    }
}
