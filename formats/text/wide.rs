//! Wide tables: a row is a frame, three columns are a marker.

use super::clock::Clock;
use super::number::{Numbers, Wrong, whole};
use super::save::ShortRows;
use super::scan::{Cell, Scanner, decode, excerpt};
use super::table::{Blank, Table};
use super::{Column, NAME, Sheet};
use crate::{FormatError, Marker, Place, Role, Samples};

/// What the rows of a table said.
#[derive(Debug)]
pub(crate) struct Rows {
    /// The samples.
    pub table: Table,
    /// How numbers are written.
    pub numbers: Numbers,
    /// The times.
    pub clock: Clock,
    /// By how much the frame numbers go up.
    pub frame_step: i64,
    /// Number of rows, which [`Table`] cannot tell if it has no columns.
    pub frames: u32,
    /// Rows that lack their last cells.
    pub short: ShortRows,
    /// How many cells the longest row has behind its last column; blank ones at the end do not count.
    pub surplus: usize,
}

/// What rows may look like.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// True if rows may lack their last cells, and may have cells for which there is no column.
    pub ragged: bool,
    /// What can be done about frame numbers with holes, to complete "add the missing rows with empty cells, or".
    pub holes: &'static str,
}

impl Rules {
    /// Every row has the cells of the header.
    pub const STRICT: Self = Self { ragged: false, holes: "rename the column \"frame\" to have it left alone" };
}

/// Samples that rows may lack in any file. Beyond that, a file must have a byte for each, or a few rows would cost gigabytes.
const LACKING_ALWAYS: usize = 1_000_000;

/// Reads all rows. `stated` are samples that are missing whatever their cells hold.
///
/// # Errors
/// A row with too few or too many cells, a cell that is no number, frame numbers with holes, or no rows at all.
pub(crate) fn read(bytes: &[u8], sheet: &Sheet, columns: &[Marker], stated: &Samples) -> Result<Rows, FormatError> {
    read_by(Rules::STRICT, bytes, sheet, columns, stated)
}

/// Reads all rows that look as `rules` say. `stated` are samples that are missing whatever their cells hold.
///
/// # Errors
/// A row with too few or too many cells, a cell that is no number, frame numbers with holes, or no rows at all.
pub(crate) fn read_by(rules: Rules, bytes: &[u8], sheet: &Sheet, columns: &[Marker], stated: &Samples) -> Result<Rows, FormatError> {
    let markers = columns.len();
    let mut table = Table { markers: columns.to_vec(), samples: Vec::new(), blanks: Vec::new(), partial: Vec::new(), first_frame: 1 };
    let mut numbers = Numbers::new(sheet.separator);
    let mut clock = Clock::new(sheet.separator, sheet.time_unit_secs);
    let mut scanner = Scanner::resume(bytes, sheet.separator, sheet.start, sheet.line);
    let mut width = Width::new(sheet);
    let mut frame_numbers = FrameNumbers::default();
    let numbered = sheet.has(Column::Frame);
    let mut frames = 0u32;
    let mut short = ShortRows::new(sheet, markers);
    let mut lacking = 0usize;
    let mut surplus = 0usize;
    let mut empty_row = None; // a row of nothing but separators, as spreadsheets add them at the end
    while next_row(&mut scanner)? {
        let line = scanner.line();
        let (from, blanks_from) = (table.samples.len(), table.blanks.len());
        table.samples.resize(from + markers, [f64::NAN; 3]);
        let mut frame_cell = None;
        let mut time_cell = None;
        let mut all_blank = true;
        let mut at = 0usize;
        loop {
            let cell = scanner.cell()?;
            all_blank &= cell.is_blank();
            match sheet.columns.get(at) {
                Some(&Column::Coordinate { marker, axis }) => {
                    let mut value = numbers.read(&cell).map_err(|wrong| bad_number(wrong, &cell, line, at))?;
                    let stated = stated.contains(frames as usize, marker);
                    if (stated || value.is_none_or(|v| v == 0.0)) && table.markers.get(marker).is_some_and(|m| m.role == Role::Marker) {
                        table.blanks.push(Blank { zero: value.is_some() && !stated, ..blank(&cell, frames, marker, axis) });
                        if stated {
                            value = None;
                        }
                    }
                    if let (Some(v), Some(slot)) = (value, table.samples.get_mut(from + marker).and_then(|s| s.get_mut(axis))) {
                        *slot = v;
                    }
                }
                Some(Column::Frame) => frame_cell = Some((cell, at)),
                Some(Column::Time) => time_cell = Some(cell),
                Some(Column::Label | Column::Other) => {}
                None if rules.ragged => {
                    if !cell.is_blank() {
                        surplus = surplus.max(at + 1 - sheet.columns.len());
                    }
                }
                None => width.surplus(&cell),
            }
            at += 1;
            if cell.ends_row {
                break;
            }
        }
        if numbered && all_blank {
            table.samples.truncate(from);
            table.blanks.truncate(blanks_from);
            empty_row = empty_row.or(Some(line));
            continue;
        }
        if let Some(line) = empty_row {
            return Err(empty_line(line));
        }
        if !rules.ragged {
            width.check(at, line)?;
        } else if at < sheet.columns.len() {
            lacking = lacking.saturating_add((sheet.columns.len() - at).div_ceil(3));
            if lacking > LACKING_ALWAYS.saturating_add(bytes.len()) {
                return Err(too_ragged(line));
            }
            short.add(frames, at);
            let end = row_end(bytes, scanner.offset());
            for column in sheet.columns.iter().skip(at) {
                if let Column::Coordinate { marker, axis } = *column
                    && table.markers.get(marker).is_some_and(|m| m.role == Role::Marker)
                {
                    let nothing = Cell { text: &[], start: end, quoted: false, ends_row: true };
                    table.blanks.push(blank(&nothing, frames, marker, axis));
                }
            }
        }
        table.close_row(from, blanks_from);
        let frame = match frame_cell {
            Some((cell, column)) => frame_numbers.next(&cell, line, column, rules.holes)?,
            None => i64::from(frames) + 1,
        };
        if frames == 0 {
            table.first_frame = frame;
        }
        if let Some(cell) = time_cell {
            clock.tick(frame, &cell, line);
        }
        frames = frames.checked_add(1).ok_or_else(|| too_many_rows(line))?;
    }
    if frames == 0 {
        return Err(no_rows());
    }
    Ok(Rows { table, numbers, clock, frame_step: frame_numbers.step.unwrap_or(1), frames, short, surplus })
}

/// Where the row ends whose line end, if it has one, lies before `next`.
fn row_end(bytes: &[u8], next: usize) -> usize {
    match bytes.get(..next).unwrap_or_default() {
        [.., b'\r', b'\n'] => next - 2,
        [.., b'\r' | b'\n'] => next - 1,
        _ => next,
    }
}

/// Steps to the next row; false at the end of the file, which may have empty lines before it.
pub(crate) fn next_row(scanner: &mut Scanner<'_>) -> Result<bool, FormatError> {
    let line = scanner.line();
    scanner.skip_blank_lines();
    if scanner.at_end() {
        return Ok(false);
    }
    if scanner.line() == line { Ok(true) } else { Err(empty_line(line)) }
}

/// The place of a cell that can be filled.
pub(crate) fn blank(cell: &Cell<'_>, frame: u32, marker: usize, axis: usize) -> Blank {
    Blank {
        start: cell.start as u64,
        len: u32::try_from(cell.text.len()).unwrap_or(u32::MAX), // a number of 4 GiB would be the whole file
        frame,
        marker: marker as u32,
        axis: axis as u8,
        quoted: cell.quoted,
        zero: false,
        given: false,
    }
}

/// Watches that all rows have the same number of cells, and the header's.
#[derive(Clone, Debug)]
pub(crate) struct Width {
    header: usize,
    /// Columns of the header that rows may lack, because they have no name.
    nameless: usize,
    first_row: Option<usize>,
    surplus: bool,
}

impl Width {
    pub fn new(sheet: &Sheet) -> Self {
        Self { header: sheet.columns.len(), nameless: sheet.nameless_tail, first_row: None, surplus: false }
    }

    /// Takes in a cell for which the header has no column. Only separators at the end of every row are harmless.
    pub fn surplus(&mut self, cell: &Cell<'_>) {
        self.surplus |= !cell.is_blank();
    }

    /// Judges a finished row.
    pub fn check(&mut self, cells: usize, line: u64) -> Result<(), FormatError> {
        let header = self.header;
        let fits = !self.surplus && cells + self.nameless >= header;
        let expected = match self.first_row {
            _ if !fits => format!("the header has {header}"),
            Some(first) if first != cells => format!("the first row has {first}"),
            _ => {
                self.first_row = Some(cells);
                return Ok(());
            }
        };
        let text = format!("this row has {cells} columns, {expected}; nothing was skipped, delete or complete this row");
        Err(FormatError::malformed(NAME, Place::Line { line, column: None }, text))
    }
}

/// Watches that frame numbers go up by the same step from row to row.
#[derive(Clone, Debug, Default)]
struct FrameNumbers {
    last: Option<i64>,
    step: Option<i64>,
}

impl FrameNumbers {
    fn next(&mut self, cell: &Cell<'_>, line: u64, column: usize, holes: &str) -> Result<i64, FormatError> {
        let number = frame_number(cell, line, column)?;
        if let Some(last) = self.last {
            let step = number.saturating_sub(last);
            if step < 1 || self.step.is_some_and(|s| s != step) {
                let expected = last.saturating_add(self.step.unwrap_or(1));
                let text =
                    format!("frame {number} follows frame {last}, expected {expected}; add the missing rows with empty cells, or {holes}");
                return Err(FormatError::malformed(NAME, place(line, column), text));
            }
            self.step = Some(step);
        }
        self.last = Some(number);
        Ok(number)
    }
}

/// The frame number in a cell.
pub(crate) fn frame_number(cell: &Cell<'_>, line: u64, column: usize) -> Result<i64, FormatError> {
    whole(cell).ok_or_else(|| {
        let text = format!("\"{}\" is not a whole number below 9e15, expected the number of a frame; correct it", excerpt(&decode(cell)));
        FormatError::malformed(NAME, place(line, column), text)
    })
}

pub(crate) fn bad_number(wrong: Wrong, cell: &Cell<'_>, line: u64, column: usize) -> FormatError {
    let found = excerpt(&decode(cell));
    let text = match wrong {
        Wrong::NotANumber => {
            format!("\"{found}\" is not a number, expected a coordinate; correct it, or leave the cell empty if it is missing")
        }
        Wrong::OtherSign { usual } => {
            format!("\"{found}\" has another decimal sign than the numbers before, which have \"{usual}\"; write all numbers in one way")
        }
    };
    FormatError::malformed(NAME, place(line, column), text)
}

fn place(line: u64, column: usize) -> Place {
    Place::Line { line, column: Some(column as u64 + 1) }
}

fn empty_line(line: u64) -> FormatError {
    FormatError::malformed(
        NAME,
        Place::Line { line, column: None },
        "this row is empty, but rows follow; nothing was skipped, delete or complete it",
    )
}

pub(crate) fn no_rows() -> FormatError {
    FormatError::malformed(NAME, Place::Whole, "there is a header, but no row of numbers follows; export the take again")
}

fn too_ragged(line: u64) -> FormatError {
    let text =
        "too many rows end long before the last marker of the header; take the markers without samples out of it, or complete the rows";
    FormatError::too_large(NAME, Place::Line { line, column: None }, text)
}

pub(crate) fn too_many_rows(line: u64) -> FormatError {
    FormatError::too_large(NAME, Place::Line { line, column: None }, "more than 4294967295 rows; split the file")
}
