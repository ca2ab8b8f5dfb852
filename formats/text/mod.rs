//! What formats of text have in common: cells, numbers, rows that are frames, and their way back into the file.
//!
//! A saved table is the opened one, byte for byte, with the cells of filled samples exchanged.
//! So a reader keeps the file and the places of its empty cells, and nothing else about its spelling.
//!
//! | file | holds |
//! | --- | --- |
//! | `scan` | bytes → cells |
//! | `number` | cells → numbers and back |
//! | `lines` | the lines of a header |
//! | `wide` | rows that are frames → samples |
//! | `titles` | header lines above each other → markers |
//! | `clock` | times → rate |
//! | `table` | zeros that are gaps, the unit of length |
//! | `cut` | files that end in the middle |
//! | `save` | the way back |
//! | `fresh` | what writers of new files share |
//!
//! Errors made in here carry the name `text`; each format puts its own in its place ([`named`]).

pub(crate) mod clock;
pub(crate) mod cut;
#[cfg(test)]
pub(crate) mod damage;
pub(crate) mod fresh;
pub(crate) mod lines;
pub(crate) mod number;
pub(crate) mod save;
pub(crate) mod scan;
pub(crate) mod table;
pub(crate) mod titles;
pub(crate) mod wide;

use crate::{FormatError, Note, Notes, Stated, Take, Unit, is_a_rate};
use save::Opened;
use wide::Rows;

/// The name in errors, until the format puts its own there.
const NAME: &str = "text";

/// Frames per second of a table that does not say it.
const ASSUMED_RATE_HZ: f64 = 100.0;

/// What a header says about the whole take.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Said {
    /// Unit of length.
    pub unit: Option<Unit>,
    /// Frames per second; goes before what the times say.
    pub rate_hz: Option<f64>,
}

/// The take that rows make, and the opened file with the places of its gaps.
/// What is stated goes before what the header said, that before what the rows show, and that before what is usual.
///
/// # Errors
/// The times say that rows are missing.
pub(crate) fn finish(
    bytes: Vec<u8>,
    sheet: &Sheet,
    rows: Rows,
    said: Said,
    stated: &Stated,
    notes: &Notes,
) -> Result<(Take, Opened), FormatError> {
    let rate_hz = match stated.rate_hz.or(said.rate_hz.filter(|r| is_a_rate(*r))) {
        Some(rate_hz) => Some(rate_hz),
        None => rows.clock.rate_hz(rows.frame_step, sheet.has(Column::Frame), notes)?,
    };
    let rate_hz = rate_hz.filter(|r| is_a_rate(*r)).unwrap_or_else(|| {
        notes.add(Note::RateAssumed { rate_hz: ASSUMED_RATE_HZ });
        ASSUMED_RATE_HZ
    });
    if rows.frame_step != 1 {
        notes.add(Note::FrameStep { step: rows.frame_step });
    }
    let (take, blanks) = rows.table.finish(stated.unit.or(said.unit), rate_hz, rows.frame_step, notes);
    notes.duplicate_labels(take.markers.iter().map(|m| m.label.as_str()));
    let style = rows.numbers.style(take.unit);
    Ok((take, Opened { bytes, blanks, style, short: rows.short }))
}

/// The error with the name of the format that it came up in.
pub(crate) fn named(format: &'static str, error: FormatError) -> FormatError {
    FormatError { format, ..error }
}

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Column {
    /// One coordinate (0 = x, 1 = y, 2 = z) of a marker; in a long table `marker` is 0.
    Coordinate {
        /// Column of the take.
        marker: usize,
        /// 0, 1, 2.
        axis: usize,
    },
    /// The frame's number.
    Frame,
    /// The frame's time.
    Time,
    /// The marker's label, in a long table.
    Label,
    /// Something else.
    Other,
}

/// Where the rows of a table are, and what their cells hold.
#[derive(Clone, Debug)]
pub(crate) struct Sheet {
    /// Separator of cells.
    pub separator: u8,
    /// What each column holds.
    pub columns: Vec<Column>,
    /// How many of the last columns have no name, and may be lacking in rows.
    pub nameless_tail: usize,
    /// How many seconds one unit of the time column is, if the header states it.
    pub time_unit_secs: Option<f64>,
    /// Offset of the first row.
    pub start: usize,
    /// Line number of the first row, counted from 1.
    pub line: u64,
}

impl Sheet {
    /// True if there is such a column.
    pub fn has(&self, column: Column) -> bool {
        self.columns.contains(&column)
    }
}
