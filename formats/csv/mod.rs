//! Tables of markers as text: wide (a row is a frame) and long (a row is a marker in a frame), with `,` `;` or tab between cells.
//!
//! | file | holds |
//! | --- | --- |
//! | `header` | what the columns hold, from one header line |
//! | `stacked`, `bare` | the same from two header lines, and from none |
//! | `foreign` | tables of others, refused by name |
//! | `long` | rows that are samples; those that are frames are read like in every other table |
//! | `rows`, `create` | the way back |
//!
//! Exports of programs are tables too, but other ones: some are formats of their own, some are refused (`foreign`).

mod bare;
mod create;
mod foreign;
mod header;
mod long;
mod rows;
mod stacked;

pub use create::create_long;

use crate::text::{self, Said, save, wide};
use crate::{Document, Format, FormatError, FormatInfo, Match, Note, Notes, Place, Stated, Take};
use header::{Header, Shape};
use rows::AddRows;
use save::{Opened, TextDocument};
use std::io::Write;

const NAME: &str = "csv";
const INFO: FormatInfo = FormatInfo {
    name: NAME,
    summary: "tables of markers, wide or long, separated by , ; or tab",
    extensions: &["csv", "tsv"],
    holds_gaps: true,
};

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
        open(bytes, stated, notes).map_err(|e| text::named(NAME, e))
    }

    fn create(&self, take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
        create::create_wide(take, out, notes)
    }
}

fn open(bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
    let header = Header::read(&bytes)?;
    if header.units_differ && stated.unit.is_none() {
        let text = "the header states different units for different columns; write all coordinates in one unit";
        return Err(FormatError::unsupported(NAME, Place::Whole, text));
    }
    let (rows, layout) = match header.shape {
        Shape::Wide => (wide::read(&bytes, &header.sheet, &header.markers, &stated.missing)?, None),
        Shape::Long => {
            long::read(&bytes, &header.sheet, header.unit.is_some(), &stated.missing).map(|(rows, layout)| (rows, Some(layout)))?
        }
    };
    if stated.unit.is_none() && header.unit.is_none() {
        refuse_rotations(&header, &rows.table.samples)?;
    }
    if let Some(text) = header.assumed {
        notes.add(Note::Assumed { text });
    }
    let rows_to_add = layout.map(|layout| AddRows { layout, clock: rows.clock.clone(), frame_step: rows.frame_step });
    let said = Said { unit: header.unit, rate_hz: None };
    let (take, opened) = text::finish(bytes, &header.sheet, rows, said, stated, notes)?;
    if !header.others.is_empty() {
        notes.add(Note::OtherColumns { names: header.others });
    }
    Ok(match rows_to_add {
        None => Box::new(TextDocument { format: NAME, take, opened, beyond: Vec::new() }),
        Some(rows) => Box::new(LongDocument { take, opened, rows }),
    })
}

/// An opened table whose rows are samples.
struct LongDocument {
    take: Take,
    opened: Opened,
    /// How rows are added.
    rows: AddRows,
}

impl Document for LongDocument {
    fn take(&self) -> &Take {
        &self.take
    }

    fn save(&self, repaired: &Take, out: &mut dyn Write, _notes: &Notes) -> Result<(), FormatError> {
        save::same_size(NAME, &self.take, repaired)?;
        let insertions = self.rows.insertions(&self.opened, repaired);
        self.opened.write(repaired, insertions, out).map_err(|e| FormatError::io(NAME, e))
    }

    fn rounding_mm(&self) -> f64 {
        self.opened.rounding_mm(&self.take)
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

#[cfg(test)]
mod tests;
