//! Writes a new TRC file from nothing but a take, as Motion Analysis and OpenSim write them.
//!
//! OpenSim's reader wants exactly the eight keys in this order, a label for each marker, `X1 Y1 Z1 ...` below them, and as many cells in
//! each row as there are columns. It does not count an empty last cell unless a tab follows, so every cell is followed by one.
//! Missing samples are empty cells, which it reads as NaN.

use super::INFO;
use crate::text::fresh::{PLAIN, buffered, cells, labels, time, time_decimals, writable};
use crate::{FormatError, Notes, Take};
use std::io::{self, Write};

/// Writes the file.
pub(super) fn create(take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
    let columns = writable(take, &INFO, notes)?;
    let labels = labels(&INFO, &PLAIN, take, &columns, &[], notes);
    buffered(&INFO, out, |out| write(take, &columns, &labels, out))
}

fn write(take: &Take, columns: &[usize], labels: &[String], out: &mut dyn Write) -> io::Result<()> {
    let (frames, rate, first) = (take.frames(), rate(take.rate_hz), take.first_frame);
    writeln!(out, "PathFileType\t4\t(X/Y/Z)\tmocap-repair.trc")?;
    writeln!(out, "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames")?;
    writeln!(out, "{rate}\t{rate}\t{frames}\t{}\t{}\t{rate}\t{first}\t{frames}", columns.len(), take.unit.symbol())?;
    write!(out, "Frame#\tTime\t")?;
    for label in labels {
        write!(out, "{label}\t\t\t")?;
    }
    write!(out, "\n\t\t")?;
    for number in 1..=columns.len() {
        write!(out, "X{number}\tY{number}\tZ{number}\t")?;
    }
    write!(out, "\n\n")?;
    let decimals = time_decimals(take);
    for frame in 0..frames {
        write!(out, "{}\t{}\t", take.frame_label(frame), time(take, frame, decimals))?;
        for &column in columns {
            match cells(take, frame, column) {
                None => write!(out, "\t\t\t")?,
                Some(cells) => {
                    for cell in cells {
                        write!(out, "{cell}\t")?;
                    }
                }
            }
        }
        writeln!(out)?;
    }
    Ok(())
}

/// A rate with two decimals, as is usual, or with as many as it takes.
fn rate(rate_hz: f64) -> String {
    let usual = format!("{rate_hz:.2}");
    if usual.parse() == Ok(rate_hz) { usual } else { rate_hz.to_string() }
}
