//! Writes a new table from nothing but a take.
//!
//! Wide: `frame,time (s),LABEL-x (mm),LABEL-y (mm),LABEL-z (mm),...`; long: `frame,time (s),marker,x (mm),y (mm),z (mm)`.
//! The header states the unit, the times give the rate, so that a reader has nothing to assume.
//! Numbers have the fewest digits that read back as the same number; missing samples are empty cells.

use super::{INFO, NAME};
use crate::text::fresh::{buffered, quoted, time, time_decimals, writable, write_position};
use crate::{FormatError, Notes, Place, Take};
use std::collections::BTreeSet;
use std::io::{self, Write};

/// Writes a wide table: a row for each frame.
pub(super) fn create_wide(take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
    let columns = markers(take, notes)?;
    buffered(&INFO, out, |out| write_wide(take, &columns, out))
}

/// Writes a long table: a row for each sample, frame by frame, with empty coordinates where the sample is missing.
///
/// Lengths are in the take's own unit.
///
/// # Errors
/// Unsupported if the take has no markers or two of the same label, or an I/O error of `out`.
pub fn create_long(take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
    let columns = markers(take, notes)?;
    let mut seen = BTreeSet::new();
    for marker in columns.iter().filter_map(|&c| take.markers.get(c)) {
        if !seen.insert(&marker.label) {
            let text = format!("two markers are called \"{}\", which a long table cannot tell apart; write a wide one", marker.label);
            return Err(FormatError::unsupported(NAME, Place::Whole, text));
        }
    }
    buffered(&INFO, out, |out| write_long(take, &columns, out))
}

/// The columns of the take that can be written; what cannot is noted.
fn markers(take: &Take, notes: &Notes) -> Result<Vec<usize>, FormatError> {
    if take.frames() < 2 {
        notes.not_expressible(&INFO, format!("the frame rate ({} Hz) of fewer than two frames", take.rate_hz));
    }
    writable(take, &INFO, notes)
}

fn write_wide(take: &Take, columns: &[usize], out: &mut dyn Write) -> io::Result<()> {
    write!(out, "frame,time (s)")?;
    for label in columns.iter().filter_map(|&c| take.markers.get(c)).map(|m| m.label.as_str()) {
        for axis in ["x", "y", "z"] {
            write!(out, ",{}", quoted(&format!("{label}-{axis} ({})", take.unit.symbol())))?;
        }
    }
    writeln!(out)?;
    let decimals = time_decimals(take);
    for frame in 0..take.frames() {
        write!(out, "{},{}", take.frame_label(frame), time(take, frame, decimals))?;
        for &column in columns {
            write_position(take, frame, column, out)?;
        }
        writeln!(out)?;
    }
    Ok(())
}

fn write_long(take: &Take, columns: &[usize], out: &mut dyn Write) -> io::Result<()> {
    let unit = take.unit.symbol();
    writeln!(out, "frame,time (s),marker,x ({unit}),y ({unit}),z ({unit})")?;
    let decimals = time_decimals(take);
    for frame in 0..take.frames() {
        let time = time(take, frame, decimals);
        for &column in columns {
            let label = take.markers.get(column).map_or("", |m| m.label.as_str());
            write!(out, "{},{time},{}", take.frame_label(frame), quoted(label))?;
            write_position(take, frame, column, out)?;
            writeln!(out)?;
        }
    }
    Ok(())
}
