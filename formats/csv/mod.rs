//! Tables of markers as text: wide (a row is a frame) and long (a row is a marker in a frame), with `,` `;` or tab between cells.
//!
//! A saved table is the opened one, byte for byte, with the cells of filled samples exchanged.
//! So the reader keeps the file and the places of its empty cells, and nothing else about its spelling.
//!
//! | file | holds |
//! | --- | --- |
//! | `scan` | bytes → cells |
//! | `number` | cells → numbers and back |
//! | `header`, `foreign` | what the columns hold; tables of others, refused by name |
//! | `wide`, `long` | rows → samples |
//! | `clock` | times → rate |
//! | `table` | zeros that are gaps, the unit of length |
//! | `save`, `create` | the way back |
//!
//! Exports of Motive, Nexus, Qualisys and OpenSim are tables too, but other ones; they are refused (`foreign`).

mod clock;
mod create;
mod foreign;
mod header;
mod long;
mod number;
mod save;
mod scan;
mod table;
mod wide;

pub(crate) use clock::simplest_rate;
pub use create::create_long;

use crate::{Document, Format, FormatError, FormatInfo, Match, Note, Notes, Place, Stated, Take};
use header::{Column, Header, Shape};
use std::collections::BTreeSet;
use std::io::Write;

const NAME: &str = "csv";
const INFO: FormatInfo =
    FormatInfo { name: NAME, summary: "tables of markers, wide or long, separated by , ; or tab", extensions: &["csv"], holds_gaps: true };

/// Frames per second of a table that does not say it.
const ASSUMED_RATE_HZ: f64 = 100.0;
/// Joint angles in degrees stay within this.
const LARGEST_ANGLE: f64 = 360.0;

/// The format.
#[derive(Clone, Copy, Debug)]
pub struct Csv;

impl Format for Csv {
    fn info(&self) -> &'static FormatInfo {
        &INFO
    }

    fn sniff(&self, head: &[u8]) -> Match {
        if foreign::recognise(head).is_some() {
            return Match::Maybe; // opened only to be refused by name
        }
        if head.iter().any(|&b| b < 0x20 && !matches!(b, b'\t' | b'\n' | b'\r')) {
            return Match::No;
        }
        if Header::likely(head) {
            return Match::Certain;
        }
        let line = head.split(|&b| b == b'\n' || b == b'\r').find(|l| !l.trim_ascii().is_empty()).unwrap_or_default();
        if line.iter().any(|b| matches!(b, b',' | b';' | b'\t')) { Match::Maybe } else { Match::No }
    }

    fn open(&self, bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
        let header = Header::read(&bytes)?;
        if header.units_differ && stated.unit.is_none() {
            let text = "the header states different units for different columns; write all coordinates in one unit";
            return Err(FormatError::unsupported(NAME, Place::Whole, text));
        }
        let (rows, layout) = match header.shape {
            Shape::Wide => (wide::read(&bytes, &header)?, None),
            Shape::Long => long::read(&bytes, &header).map(|(rows, layout)| (rows, Some(layout)))?,
        };
        let unit = stated.unit.or(header.unit);
        if unit.is_none() {
            refuse_rotations(&header, &rows.table.samples)?;
        }
        let rate_hz = match stated.rate_hz {
            Some(rate_hz) => Some(rate_hz),
            None => rows.clock.rate_hz(rows.frame_step, header.has(Column::Frame), notes)?,
        };
        let rate_hz = rate_hz.unwrap_or_else(|| {
            notes.add(Note::RateAssumed { rate_hz: ASSUMED_RATE_HZ });
            ASSUMED_RATE_HZ
        });
        if rows.frame_step != 1 {
            notes.add(Note::FrameStep { step: rows.frame_step });
        }
        let (take, blanks) = rows.table.finish(unit, rate_hz, notes);
        note_labels(&take, &header, notes);
        let style = rows.numbers.style(take.unit);
        // Half a step, and what a double loses on the way from millimetres to the file's unit and back.
        let rounding_mm = 0.5 * style.step() * take.unit.mm() * (1.0 + 1e-6) + 1e-9;
        let rows = layout.map(|layout| save::AddRows { layout, clock: rows.clock, frame_step: rows.frame_step });
        Ok(Box::new(CsvDocument { take, rounding_mm, opened: save::Opened { bytes, blanks, style, rows } }))
    }

    fn create(&self, take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
        create::create_wide(take, out, notes)
    }
}

/// An opened table.
struct CsvDocument {
    take: Take,
    rounding_mm: f64,
    opened: save::Opened,
}

impl Document for CsvDocument {
    fn take(&self) -> &Take {
        &self.take
    }

    fn save(&self, repaired: &Take, out: &mut dyn Write, _notes: &Notes) -> Result<(), FormatError> {
        if (repaired.frames(), repaired.markers.len()) != (self.take.frames(), self.take.markers.len()) {
            let text = "the repaired take is of another size than the opened file; write it to a new file";
            return Err(FormatError::unsupported(NAME, Place::Whole, text));
        }
        self.opened.write(repaired, out).map_err(|e| FormatError::io(NAME, e))
    }

    fn rounding_mm(&self) -> f64 {
        self.rounding_mm
    }
}

/// Joint rotations come in threes with the same names, but in the order in which they are applied, which is seldom x, y, z.
fn refuse_rotations(header: &Header, samples: &[[f64; 3]]) -> Result<(), FormatError> {
    let Some(order) = header.odd_order else { return Ok(()) };
    if samples.iter().flatten().any(|v| v.abs() > LARGEST_ANGLE) {
        return Ok(());
    }
    let letter = |axis: usize| ["x", "y", "z"].get(axis).copied().unwrap_or_default();
    let text = format!(
        "the columns of each name come in the order {}, and no value is beyond ±360: these seem to be rotations of joints, not positions; \
         if they are positions, say their unit with --units",
        order.map(letter).join(", ")
    );
    Err(FormatError::unsupported(NAME, Place::Whole, text))
}

/// Notes labels that occur twice, and columns that are left alone.
fn note_labels(take: &Take, header: &Header, notes: &Notes) {
    let mut seen = BTreeSet::new();
    let mut twice = BTreeSet::new();
    let again = take.markers.iter().map(|m| &m.label).filter(|l| !seen.insert(*l) && twice.insert(*l));
    let again: Vec<String> = again.cloned().collect();
    if !again.is_empty() {
        notes.add(Note::DuplicateLabels { labels: again });
    }
    if !header.others.is_empty() {
        notes.add(Note::OtherColumns { names: header.others.clone() });
    }
}

#[cfg(test)]
mod tests;
