//! Files in, takes and files out.
#![allow(clippy::unwrap_used)]

use super::*;
use crate::{Origin, Role};

fn opened(text: &str) -> (Result<Box<dyn Document>, String>, Vec<String>) {
    let notes = Notes::new();
    let document = Nexus.open(text.as_bytes().to_vec(), &Stated::default(), &notes).map_err(|e| e.to_string());
    (document, notes.take().iter().map(ToString::to_string).collect())
}

/// The file after marker `marker` was filled in frame `frame`.
fn filled(document: &dyn Document, frame: usize, marker: usize, position: [f64; 3]) -> String {
    let mut take = document.take().clone();
    assert!(take.fill(frame, marker, position));
    let mut out = Vec::new();
    document.save(&take, &mut out, &Notes::new()).unwrap();
    String::from_utf8(out).unwrap()
}

const TRAJECTORIES: &str = "Trajectories\r\n120\r\n,,S:A,,,S:B\r\nFrame,Sub Frame,X,Y,Z,X,Y,Z\r\n,,mm,mm,mm,mm,mm,mm\r\n\
                            7,0,1.5,2.5,3.5,4.5,5.5,6.5\r\n8,0,,,,4.6,5.6,6.6\r\n9,0,1.7,2.7,3.7,4.7,5.7,6.7\r\n\r\n";
const OUTPUTS: &str =
    "Model Outputs\r\n120\r\n,,S:LHipAngles,,\r\nFrame,Sub Frame,X,Y,Z\r\n,,deg,deg,deg\r\n7,0,1,2,3\r\n8,0,,,\r\n9,0,1,2,3\r\n\r\n";
const DEVICES: &str = "Devices\r\n1200\r\n,,Plate - Force,,\r\nFrame,Sub Frame,Fx,Fy,Fz\r\n,,N,N,N\r\n7,0,1,2,3\r\n7,1,1,2,3\r\n\r\n";

#[test]
fn markers_are_found_wherever_their_block_is() {
    assert_eq!(crate::detect(TRAJECTORIES.as_bytes(), Some("csv")).unwrap().info().name, NAME);
    for text in [
        TRAJECTORIES.to_owned(),
        format!("{TRAJECTORIES}{OUTPUTS}{DEVICES}"),
        format!("{DEVICES}{TRAJECTORIES}{OUTPUTS}"),
        format!("{OUTPUTS}{DEVICES}{TRAJECTORIES}").replace("\r\n\r\n", "\r\n"), // no blank lines
        format!("\u{feff}{TRAJECTORIES}"),
    ] {
        let (document, notes) = opened(&text);
        let document = document.unwrap();
        let take = document.take();
        assert_eq!((take.rate_hz, take.unit, take.first_frame, take.frames()), (120.0, Unit::Millimetre, 7, 3), "{text}");
        assert_eq!(take.markers.iter().map(|m| m.label.as_str()).collect::<Vec<_>>(), ["S:A", "S:B"]);
        assert_eq!((take.position_mm(1, 0), take.position_mm(1, 1)), (None, Some([4.6, 5.6, 6.6])));
        assert_eq!(notes.is_empty(), !text.contains("Devices"), "{notes:?}");
        assert_eq!(filled(document.as_ref(), 1, 0, [1.6, 2.6, 3.6]), text.replace("8,0,,,,4.6", "8,0,1.600,2.600,3.600,4.6"));
    }
    let (_, notes) = opened(&format!("{DEVICES}{TRAJECTORIES}{OUTPUTS}"));
    assert_eq!(notes, ["blocks that hold no markers were left as they are: Devices, Model Outputs"]);
}

#[test]
fn padded_and_european() {
    let text = "Trajectories;;;;\n59,94;;;;\n;;A;;\nFrame;Sub Frame;X;Y;Z\n;;m;m;m\n1;0;1,25;0,5;0,75\n2;0;;;\n;;;;\n";
    let (document, notes) = opened(text);
    let document = document.unwrap();
    assert_eq!((document.take().rate_hz, document.take().position_mm(0, 0), notes.len()), (59.94, Some([1250.0, 500.0, 750.0]), 0));
    assert_eq!(filled(document.as_ref(), 1, 0, [1250.0, 500.0, 1.0]), text.replace("2;0;;;\n", "2;0;1,25;0,5;0,001\n"));
}

#[test]
fn velocities_beside_positions_stay() {
    let text = "Trajectories\n100\n,,A,,,,,\nFrame,Sub Frame,X,Y,Z,X',Y',Z'\n,,mm,mm,mm,mm/s,mm/s,mm/s\n1,0,1,2,3,4,5,6\n2,0,,,,,,\n";
    let (document, notes) = opened(text);
    assert_eq!(notes, ["columns that are no markers were left as they are: A X', A Y', A Z'"]);
    assert_eq!(filled(document.unwrap().as_ref(), 1, 0, [7.0, 8.0, 9.0]), text.replace("2,0,,,,,,", "2,0,7.000,8.000,9.000,,,"));
}

#[test]
fn workstation() {
    let text = "Title,,,,,,\nDate:,,,,,,\n,,,,,,\nTRAJECTORIES,,,,,,\n100,Hz,,,,,\n,LASI,,,LHipAngles,,\nField #,X,Y,Z,X,Y,Z\n\
                1,-100.5,2.5,900.5,1,2,3\n2,-100.6,2.6,900.6,,,\n";
    let (document, notes) = opened(text);
    let document = document.unwrap();
    let take = document.take();
    assert_eq!((take.rate_hz, take.markers.len(), take.markers[1].role), (100.0, 2, Role::ModelOutput));
    assert_eq!((take.origin(1, 0), take.position_mm(0, 0)), (Origin::Measured, Some([-100.5, 2.5, 900.5])));
    assert_eq!(
        notes,
        ["the file names no unit, mm assumed (say it with --units)", "1 columns are model outputs, not markers; left as they are"]
    );
    assert_eq!(Nexus.sniff(text.as_bytes()), Match::Certain);
}

#[test]
fn what_is_refused() {
    let head = "Trajectories\n100\n,,A,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n";
    for (text, expected) in [
        (DEVICES.to_owned(), "nexus: the file holds no block of trajectories (its blocks: \"Devices\"); export it again with Trajectories"),
        (format!("{head}\n{head}"), "nexus: a second block of trajectories, the first is in line 1; split the file (line 8)"),
        (format!("{head}\n2,0,1,2,3\n"), "nexus: this row is empty, but rows follow; nothing was skipped, delete or complete it (line 7)"),
        (
            format!("{head}3,0,1,2\n"),
            "nexus: this row has 4 columns, the header has 5; nothing was skipped, delete or complete this row (line 7)",
        ),
        (
            "Trajectories\n100\n\n".to_owned(),
            "nexus: no line follows that begins with Frame and names the axes, expected Frame,Sub Frame,X,Y,Z,...; export the take again (line 1)",
        ),
        (
            "Trajectories\n100\n,,A\nFrame,Sub Frame,X\n".to_owned(),
            "nexus: the block Trajectories names no markers, expected names above X, Y, Z; export the take again (line 4)",
        ),
        (
            "Trajectories\n100\n,,A,,,B,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,m,m,m\n1,0,1,2,3,4,5,6\n".to_owned(),
            "nexus: the block Trajectories has different units for different columns; export it again in one unit (line 4)",
        ),
    ] {
        assert_eq!(opened(&text).0.err().unwrap(), expected, "{text}");
    }
}

#[test]
fn an_unknown_unit_and_no_rate() {
    let text = "Trajectories\n0\n,,A,,\nFrame,Sub Frame,X,Y,Z\n,,ell,ell,ell\n1,0,1,2,3\n2,0,1,2,3\n";
    let (document, notes) = opened(text);
    assert_eq!(document.unwrap().take().rate_hz, 100.0);
    assert_eq!(
        notes,
        [
            "the unit \"ell\" is unknown, mm assumed (say it with --units)",
            "the file names no frame rate, 100 Hz assumed (say it with --rate)"
        ]
    );
}
