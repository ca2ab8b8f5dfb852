//! Writes a new TSV file from nothing but a take, as Qualisys Track Manager exports 3D data with header, frame, time and names of columns.
//!
//! Readers count the lines of the header, so all of the older export are there, in its order; what nobody knows is written as QTM writes
//! nothing. Missing samples are zeros, as in an export with the usual settings: readers that split at blanks would shift empty cells.

use super::INFO;
use crate::text::fresh::{NOT_THE_ORIGIN, PLAIN, buffered, labels, time, time_decimals, writable};
use crate::{FormatError, Notes, Take, Unit};
use std::io::{self, Write};

/// Writes the file, in millimetres.
pub(super) fn create(take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
    let columns = writable(take, &INFO, notes)?;
    let labels = labels(&INFO, &PLAIN, take, &columns, &[], notes);
    if take.unit != Unit::Millimetre {
        notes.changed(&INFO, format!("lengths are written in mm, not {}", take.unit.symbol()));
    }
    buffered(&INFO, out, |out| write(take, &columns, &labels, out))
}

fn write(take: &Take, columns: &[usize], labels: &[String], out: &mut dyn Write) -> io::Result<()> {
    let end = "\r\n";
    write!(out, "NO_OF_FRAMES\t{}{end}NO_OF_CAMERAS\t0{end}", take.frames())?;
    write!(out, "NO_OF_MARKERS\t{}{end}FREQUENCY\t{}{end}", columns.len(), take.rate_hz)?;
    write!(out, "NO_OF_ANALOG\t0{end}ANALOG_FREQUENCY\t0{end}DESCRIPTION\t--{end}")?;
    // nobody knows when: a day that is no day of a recording, and the same in every file
    write!(out, "TIME_STAMP\t1970-01-01, 00:00:00{end}DATA_INCLUDED\t3D{end}MARKER_NAMES")?;
    for label in labels {
        write!(out, "\t{label}")?;
    }
    write!(out, "{end}Frame\tTime")?;
    for label in labels {
        write!(out, "\t{label} X\t{label} Y\t{label} Z")?;
    }
    write!(out, "{end}")?;
    let decimals = time_decimals(take);
    for frame in 0..take.frames() {
        write!(out, "{}\t{}", take.frame_label(frame), time(take, frame, decimals))?;
        for &column in columns {
            match take.position_mm(frame, column) {
                None => write!(out, "\t0.000\t0.000\t0.000")?,
                Some(position) => {
                    // zeros mean missing
                    let position = if position == [0.0; 3] { [NOT_THE_ORIGIN, 0.0, 0.0] } else { position };
                    for mm in position {
                        write!(out, "\t{}", mm + 0.0)?; // no "-0"
                    }
                }
            }
        }
        write!(out, "{end}")?;
    }
    Ok(())
}
