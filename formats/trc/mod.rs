//! TRC: *track row column*, the text format of Motion Analysis (EVaRT, Cortex) and OpenSim.
//!
//! ```text
//! PathFileType  4         (X/Y/Z)    walk.trc
//! DataRate      CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames
//! 100.00        100.00     487       2          mm    100.00       1                  487
//! Frame#        Time       LKNE                 RKNE
//!                          X1   Y1   Z1         X2    Y2    Z2
//!
//! 1             0.000      1.5  2.5  3.5
//! ```
//!
//! | file | holds |
//! | --- | --- |
//! | `header` | the lines before the rows, and which columns are markers |
//! | `create` | new files |
//!
//! Rows are read and put back by what text formats share.
//! They may end before their last marker, and may go on behind it with points that nobody named; `*.trb` is binary, and another format.

mod create;
mod header;

use crate::text::cut::{self, Whole};
use crate::text::save::TextDocument;
use crate::text::wide::{self, Rows, Rules};
use crate::text::{self, Said};
use crate::{Document, Format, FormatError, FormatInfo, Match, Note, Notes, Stated, Take, TakeBuilder, Unit};
use header::Header;
use std::io::Write;

const NAME: &str = "trc";
const INFO: FormatInfo =
    FormatInfo { name: NAME, summary: "marker tables of OpenSim and Motion Analysis", extensions: &["trc"], holds_gaps: true };

/// Rates that differ by more than this, as a part of themselves, contradict each other. Rounding to two decimals stays below.
const RATES_DIFFER: f64 = 0.002;

/// What rows of a TRC file may look like.
const RULES: Rules = Rules { ragged: true, holes: "number the frames one after the other if none is missing" };

/// The format.
#[derive(Clone, Copy, Debug)]
pub struct Trc;

impl Format for Trc {
    fn info(&self) -> &'static FormatInfo {
        &INFO
    }

    fn sniff(&self, head: &[u8]) -> Match {
        if header::begins(head) { Match::Certain } else { Match::No }
    }

    fn open(&self, bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
        open(bytes, stated, notes).map_err(|e| text::named(NAME, e))
    }

    fn create(&self, take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
        create::create(take, out, notes)
    }
}

fn open(bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
    let header = Header::read(&bytes)?;
    let rows = wide::read_by(RULES, &bytes, &header.sheet, &header.markers, &stated.missing)?;
    let whole = Whole {
        separator: header.sheet.separator,
        first: (header.sheet.start, header.sheet.line),
        cells: header.sheet.columns.len(),
        claimed: header.frames,
    };
    cut::refuse(&bytes, whole)?;
    header.tell(notes);
    if let Some(claimed) = header.frames.filter(|&claimed| claimed != u64::from(rows.frames)) {
        notes.add(Note::FrameCount { claimed, present: u64::from(rows.frames) });
    }
    let unnamed = if header.others.is_empty() { rows.surplus } else { 0 };
    tell_surplus(&header, unnamed, notes);
    let beyond = (unnamed > 0).then(|| "points that were not recognised, behind the last marker".to_owned()).into_iter().collect();
    if stated.rate_hz.is_none() {
        tell_rates(&header, &rows, notes)?;
    }
    let mut unit = header.unit;
    if let (None, Some(written), None) = (unit, &header.unit_written, stated.unit) {
        unit = Some(Unit::Millimetre);
        notes.add(Note::UnitUnknown { written: written.clone(), unit: Unit::Millimetre });
    }
    let (frames, first_frame) = (rows.frames as usize, rows.table.first_frame);
    let said = Said { unit, rate_hz: header.rate_hz };
    let (mut take, opened) = text::finish(bytes, &header.sheet, rows, said, stated, notes)?;
    if take.markers.is_empty() {
        // a table without columns does not know how long it is
        take = TakeBuilder::new(Vec::new(), frames, take.rate_hz).first_frame(first_frame).unit(take.unit).build();
    }
    Ok(Box::new(TextDocument { format: NAME, take, opened, beyond }))
}

/// Cells behind the last marker: Motion Analysis writes the points there that it could not name, pieces of tracks that come and go.
fn tell_surplus(header: &Header, surplus: usize, notes: &Notes) {
    if !header.others.is_empty() {
        notes.add(Note::OtherColumns { names: header.others.clone() });
    }
    if surplus > 0 {
        let text = format!(
            "rows have up to {surplus} cells behind the {} markers, which the header does not name; they were taken as points that were not \
             recognised, and left as they are",
            header.markers.len()
        );
        notes.add(Note::Assumed { text });
    }
}

/// Notes rates that contradict each other.
fn tell_rates(header: &Header, rows: &Rows, notes: &Notes) -> Result<(), FormatError> {
    let Some(said) = header.rate_hz else { return Ok(()) };
    if let Some(camera) = header.camera_rate_hz.filter(|camera| *camera != said) {
        notes.add(Note::Contradiction { text: format!("CameraRate is {camera} Hz, DataRate is {said} Hz; rows are at the DataRate") });
    }
    let Some(timed) = rows.clock.rate_hz(rows.frame_step, true, notes)? else { return Ok(()) };
    let steps = f64::from(rows.frames.saturating_sub(1));
    // what the last time is off by, beyond its own rounding
    let off_secs = steps * (1.0 / said - 1.0 / timed).abs() - text::number::step(rows.clock.decimals());
    if off_secs > 0.0 && (timed / said - 1.0).abs() > RATES_DIFFER {
        let text = format!("DataRate is {said} Hz, but the times go by at {timed:.2} Hz; DataRate was taken (say it with --rate)");
        notes.add(Note::Assumed { text });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
