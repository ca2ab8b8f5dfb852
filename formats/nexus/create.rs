//! Writes a new export from nothing but a take: one block of trajectories, as Nexus writes it.

use super::INFO;
use crate::text::fresh::{LINES, buffered, labels, quoted, writable, write_position};
use crate::{FormatError, Notes, Take};
use std::io::{self, Write};

/// Writes the block, in the take's own unit.
///
/// # Errors
/// Unsupported if the take has no markers, or an I/O error of `out`.
pub(super) fn create(take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
    let columns = writable(take, &INFO, notes)?;
    let labels = labels(&INFO, &LINES, take, &columns, &[], notes);
    buffered(&INFO, out, |out| write(take, &columns, &labels, out))
}

fn write(take: &Take, columns: &[usize], labels: &[String], out: &mut dyn Write) -> io::Result<()> {
    write!(out, "Trajectories\r\n{}\r\n,", take.rate_hz)?;
    for label in labels {
        write!(out, ",{},,", quoted(label))?;
    }
    write!(out, "\r\nFrame,Sub Frame{}\r\n,", ",X,Y,Z".repeat(columns.len()))?;
    let unit = take.unit.symbol();
    write!(out, "{}\r\n", format!(",{unit},{unit},{unit}").repeat(columns.len()))?;
    for frame in 0..take.frames() {
        write!(out, "{},0", take.frame_label(frame))?;
        for &column in columns {
            write_position(take, frame, column, out)?;
        }
        write!(out, "\r\n")?;
    }
    write!(out, "\r\n")
}
