//! Writes a new export from nothing but a take: its markers, as Motive 2 writes them (format version 1.23).

use super::INFO;
use crate::text::fresh::{LINES, buffered, labels, quoted, time, time_decimals, writable, write_position};
use crate::{FormatError, Notes, Take, Unit};
use std::io::{self, Write};

/// Writes the table, in the take's own unit. Markers get their number as identifier.
///
/// # Errors
/// Unsupported if the take has no markers, or an I/O error of `out`.
pub(super) fn create(take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
    let columns = writable(take, &INFO, notes)?;
    let labels = labels(&INFO, &LINES, take, &columns, &[], notes);
    buffered(&INFO, out, |out| write(take, &columns, &labels, out))
}

fn write(take: &Take, columns: &[usize], labels: &[String], out: &mut dyn Write) -> io::Result<()> {
    let (rate, frames) = (take.rate_hz, take.frames());
    let unit = match take.unit {
        Unit::Millimetre => "Millimeters",
        Unit::Centimetre => "Centimeters",
        Unit::Metre => "Meters",
    };
    write!(
        out,
        "Format Version,1.23,Take Name,,Take Notes,,Capture Frame Rate,{rate},Export Frame Rate,{rate},Capture Start Time,,\
         Total Frames in Take,{frames},Total Exported Frames,{frames},Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global\r\n\r\n,"
    )?;
    write!(out, "{}\r\n,", ",Marker,Marker,Marker".repeat(columns.len()))?;
    for label in labels.iter().map(|label| quoted(label)) {
        write!(out, ",{label},{label},{label}")?;
    }
    write!(out, "\r\n,")?;
    for id in 1..=columns.len() {
        write!(out, ",{id},{id},{id}")?;
    }
    write!(out, "\r\n,{}\r\n", ",Position,Position,Position".repeat(columns.len()))?;
    write!(out, "Frame,Time (Seconds){}\r\n", ",X,Y,Z".repeat(columns.len()))?;
    let decimals = time_decimals(take);
    for frame in 0..frames {
        write!(out, "{},{}", take.frame_label(frame), time(take, frame, decimals))?;
        for &column in columns {
            write_position(take, frame, column, out)?;
        }
        write!(out, "\r\n")?;
    }
    Ok(())
}
