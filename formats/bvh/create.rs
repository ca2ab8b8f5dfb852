//! Writes a new file from nothing but a take: a cloud of points, so that markers can be looked at in any viewer of BVH.
//!
//! The root stands at the origin and never moves. Below it every marker is a joint with three position channels, and an end site where it is.
//! The root's name tells our reader the unit, and that the root is no marker.

use super::motion::{FARTHEST, rate_of};
use super::{INFO, NAME};
use crate::text::fresh::{Spelling, buffered, in_unit, labels, writable};
use crate::{FormatError, Notes, Origin, Place, Take, Unit};
use std::io::{self, Write};

/// The name of the root, before its unit.
const ROOT: &str = "origin_";
/// Names without blanks and brackets, not empty, and no two the same.
pub(super) const NAMES: Spelling = Spelling {
    odd: |c| c.is_whitespace() || c.is_control() || matches!(c, '{' | '}'),
    odd_are: "blanks, brackets or control characters",
    trimmed: false,
    empty: Some("marker_"),
    longest: 200, // more than anybody gives, fewer than readers stumble over
    unique: true,
};
/// Values of the root in every row: position and rotation.
const STILL: &str = "0 0 0 0 0 0";

/// The unit that the name of a root tells.
pub(super) fn unit_of(root: &str) -> Option<Unit> {
    let symbol = root.strip_prefix(ROOT)?;
    Unit::ALL.into_iter().find(|unit| unit.symbol() == symbol)
}

/// Writes the take.
pub(super) fn create(take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
    let columns = writable(take, &INFO, notes)?;
    let all = || columns.iter().flat_map(|&column| (0..take.frames()).map(move |frame| (frame, column)));
    let far = |position: [f64; 3]| !position.iter().all(|mm| (mm / take.unit.mm()).abs() < FARTHEST);
    if let Some((frame, column)) = all().find(|&(frame, column)| take.position_mm(frame, column).is_some_and(far)) {
        let text = format!(
            "marker {} in frame {} is farther away than anything can be; correct it first",
            take.display_label(column),
            take.frame_label(frame)
        );
        return Err(FormatError::unsupported(NAME, Place::Whole, text));
    }
    let names = labels(&INFO, &NAMES, take, &columns, &[format!("{ROOT}{}", take.unit.symbol())], notes);
    note_losses(take, &columns, notes);
    buffered(&INFO, out, |out| {
        write_head(take, &names, out)?;
        write_rows(take, &columns, out)
    })
}

/// Notes what a cloud of points lacks besides.
fn note_losses(take: &Take, columns: &[usize], notes: &Notes) {
    let lost = |what: String| notes.not_expressible(&INFO, what);
    if take.frame_step != 1 {
        lost(format!("frame numbers in steps of {}", take.frame_step));
    }
    if take.first_frame != 1 {
        lost(format!("the number of the first frame ({})", take.first_frame));
    }
    let count = |&c: &usize| (0..take.frames()).filter(|&f| take.origin(f, c) == Origin::Missing).count();
    let missing: Vec<usize> = columns.iter().map(count).collect();
    let never = missing.iter().filter(|m| **m == take.frames() && **m > 0).count();
    let held: usize = missing.iter().filter(|m| **m < take.frames()).sum();
    if held > 0 {
        lost(format!("that {held} samples are missing (each is written where its marker was seen nearest in time)"));
    }
    if never > 0 {
        lost(format!("that {never} markers were never seen (they are written at 0 0 0)"));
    }
}

fn write_head(take: &Take, names: &[String], out: &mut dyn Write) -> io::Result<()> {
    let positions = "Xposition Yposition Zposition";
    writeln!(out, "HIERARCHY\nROOT {ROOT}{}\n{{", take.unit.symbol())?;
    writeln!(out, "\tOFFSET 0 0 0\n\tCHANNELS 6 {positions} Zrotation Xrotation Yrotation")?;
    for name in names {
        writeln!(out, "\tJOINT {name}\n\t{{\n\t\tOFFSET 0 0 0\n\t\tCHANNELS 3 {positions}")?;
        writeln!(out, "\t\tEnd Site\n\t\t{{\n\t\t\tOFFSET 0 0 0\n\t\t}}\n\t}}")?;
    }
    writeln!(out, "}}\nMOTION\nFrames: {}\nFrame Time: {}", take.frames(), frame_time(take.rate_hz))
}

/// The seconds from frame to frame, with as many digits as it takes to read the rate back.
fn frame_time(rate_hz: f64) -> String {
    let secs = 1.0 / rate_hz;
    let written = (6..24).map(|decimals| format!("{secs:.decimals$}")).find(|text| rate_of(text) == Some(rate_hz));
    written.unwrap_or_else(|| format!("{secs}"))
}

fn write_rows(take: &Take, columns: &[usize], out: &mut dyn Write) -> io::Result<()> {
    // where each marker was seen last, and the frame in which it is seen next
    let mut last: Vec<Option<(usize, [f64; 3])>> = vec![None; columns.len()];
    let mut next: Vec<usize> = vec![0; columns.len()];
    for frame in 0..take.frames() {
        write!(out, "{STILL}")?;
        for ((&column, last), next) in columns.iter().zip(&mut last).zip(&mut next) {
            if let Some(position) = take.position_mm(frame, column) {
                *last = Some((frame, position));
            }
            while *next < take.frames() && (*next < frame || take.origin(*next, column) == Origin::Missing) {
                *next += 1;
            }
            let ahead = take.position_mm(*next, column);
            let position = match (*last, ahead) {
                (Some((seen, _)), Some(position)) if *next - frame < frame - seen => position,
                (Some((_, position)), _) | (None, Some(position)) => position,
                (None, None) => [0.0; 3],
            };
            for mm in position {
                write!(out, " {}", in_unit(mm, take.unit.mm()))?;
            }
        }
        writeln!(out)?;
    }
    Ok(())
}
