//! Long tables: a row is a marker in a frame, in any order; what is missing may have an empty row or none.

use super::NAME;
use crate::text::clock::Clock;
use crate::text::number::Numbers;
use crate::text::save::ShortRows;
use crate::text::scan::{Cell, Scanner, decode, excerpt};
use crate::text::table::{Blank, Table, gcd};
use crate::text::titles::is_model_output;
use crate::text::wide::{Rows, Width, bad_number, blank, frame_number, next_row, no_rows, too_many_rows};
use crate::text::{Column, Sheet};
use crate::{FormatError, Marker, Place, Role, Samples};
use std::collections::HashMap;
use std::ops::Range;

/// A take may have this many samples whatever the number of rows.
const SAMPLES_ALWAYS: u128 = 1_000_000;
/// Beyond that, one row must stand for at most this many samples, or a frame number of 2 000 000 000 would cost 48 GB.
const SAMPLES_PER_ROW: u128 = 256;

/// Frames with numbers farther apart than this are no neighbours, but the sign of a number gone wrong.
const LARGEST_STEP: u64 = 10_000;

/// What is needed to add rows to a long table.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    /// Separator of cells.
    pub separator: u8,
    /// What each cell of a row holds.
    pub columns: Vec<Column>,
    /// Blanks before each cell, as in the first row.
    pub leads: Vec<Range<usize>>,
    /// How rows end.
    pub line_end: Range<usize>,
    /// How each marker is written, with its quotes.
    pub labels: Vec<Range<usize>>,
    /// For each frame, where its last row ends (or that of the frame before); empty if rows are not sorted by frame.
    pub frame_ends: Vec<usize>,
    /// Where the last row ends.
    pub end: usize,
    /// How the time of each frame is written, as far as known; empty without a time column.
    pub times: Vec<Range<usize>>,
}

/// A row, until all of them are known.
struct Row {
    frame: i64,
    marker: u32,
    line: u64,
    end: usize,
    /// Where the text of the time stands.
    time: Range<usize>,
}

/// Reads all rows. `stated` are samples that are missing whatever their cells hold; `lengths` is true if the header says that all samples are
/// lengths, so that none is a model output, whatever its name.
///
/// # Errors
/// A row with too few or too many cells, a cell that is no number, a sample given twice, frame numbers too far apart, or no rows at all.
pub(super) fn read(bytes: &[u8], sheet: &Sheet, lengths: bool, stated: &Samples) -> Result<(Rows, Layout), FormatError> {
    let mut numbers = Numbers::new(sheet.separator);
    let mut clock = Clock::new(sheet.separator, sheet.time_unit_secs);
    let mut scanner = Scanner::resume(bytes, sheet.separator, sheet.start, sheet.line);
    let mut width = Width::new(sheet);
    let mut table = Table { markers: Vec::new(), samples: Vec::new(), blanks: Vec::new(), partial: Vec::new(), first_frame: 1 };
    let mut rows: Vec<Row> = Vec::new();
    let mut known: HashMap<&[u8], u32> = HashMap::new(); // looked up only, never walked over
    let mut labels: Vec<Range<usize>> = Vec::new();
    let mut leads: Vec<Range<usize>> = Vec::new();
    let mut cells = 0;
    while next_row(&mut scanner)? {
        let line = scanner.line();
        let number = u32::try_from(rows.len()).map_err(|_| too_many_rows(line))?;
        let blanks_from = table.blanks.len();
        let mut sample = [f64::NAN; 3];
        let (mut frame, mut label, mut time) = (None, None, None);
        let mut at = 0usize;
        loop {
            let from = scanner.offset();
            let cell = scanner.cell()?;
            if rows.is_empty() {
                leads.push(from..cell.start.saturating_sub(usize::from(cell.quoted)));
            }
            match sheet.columns.get(at) {
                Some(&Column::Coordinate { axis, .. }) => {
                    let value = numbers.read(&cell).map_err(|wrong| bad_number(wrong, &cell, line, at))?;
                    let zero = value == Some(0.0);
                    // which sample a row belongs to is known only when all rows are
                    let given = value.is_some() && !stated.is_empty();
                    if value.is_none() || zero || given {
                        table.blanks.push(Blank { zero, given, ..blank(&cell, number, 0, axis) });
                    }
                    if let (Some(v), Some(slot)) = (value, sample.get_mut(axis)) {
                        *slot = v;
                    }
                }
                Some(Column::Frame) => frame = Some(frame_number(&cell, line, at)?),
                Some(Column::Label) => label = Some(cell),
                Some(Column::Time) => time = Some(cell),
                Some(Column::Other) => {}
                None => width.surplus(&cell),
            }
            at += 1;
            if cell.ends_row {
                break;
            }
        }
        width.check(at, line)?;
        cells = at;
        let (Some(frame), Some(label)) = (frame, label.filter(|l| !l.is_blank())) else {
            let text = "this row names no marker; nothing was skipped, delete or complete this row";
            return Err(FormatError::malformed(NAME, Place::Line { line, column: None }, text));
        };
        let marker = *known.entry(label.text).or_insert_with(|| {
            let text = decode(&label);
            let role = if !lengths && is_model_output(&text) { Role::ModelOutput } else { Role::Marker };
            table.markers.push(Marker { label: text, role });
            labels.push(written(&label));
            labels.len() as u32 - 1
        });
        if table.markers.get(marker as usize).is_none_or(|m| m.role != Role::Marker) {
            table.blanks.truncate(blanks_from); // never filled
        }
        table.samples.push(sample);
        table.close_row(rows.len(), blanks_from);
        if let Some(cell) = &time {
            clock.tick(frame, cell, line);
        }
        let time = time.map_or(0..0, |c| written(&c));
        rows.push(Row { frame, marker, line, end: scanner.offset(), time });
    }
    let Some(last) = rows.last() else { return Err(no_rows()) };
    clock.sort();
    let mut layout = Layout {
        separator: sheet.separator,
        columns: (0..cells).map(|i| sheet.columns.get(i).copied().unwrap_or(Column::Other)).collect(),
        leads,
        line_end: line_end(bytes, sheet.start),
        labels,
        frame_ends: Vec::new(),
        end: last.end,
        times: Vec::new(),
    };
    let (first_frame, frame_step, frames) = span(&rows, table.markers.len())?;
    let index = |row: &Row| usize::try_from(row.frame.abs_diff(first_frame) / frame_step.unsigned_abs()).unwrap_or(usize::MAX);

    if rows.is_sorted_by_key(|r| r.frame) {
        layout.frame_ends = vec![0; frames];
        for row in &rows {
            if let Some(end) = layout.frame_ends.get_mut(index(row)) {
                *end = row.end;
            }
        }
        let mut last = 0;
        for end in &mut layout.frame_ends {
            last = last.max(*end);
            *end = last;
        }
    }
    if sheet.has(Column::Time) {
        layout.times = vec![0..0; frames];
        for row in &rows {
            if let Some(time) = layout.times.get_mut(index(row))
                && time.start == time.end
            {
                *time = row.time.clone();
            }
        }
    }

    let columns = table.markers.len();
    let mut samples = vec![[f64::NAN; 3]; frames * columns];
    let mut given = vec![false; frames * columns];
    let cell_of = |row: &Row| index(row).saturating_mul(columns).saturating_add(row.marker as usize);
    for (row, sample) in rows.iter().zip(&table.samples) {
        let cell = cell_of(row);
        let (Some(slot), Some(given)) = (samples.get_mut(cell), given.get_mut(cell)) else { continue };
        if *given {
            return Err(twice(&rows, row, &table.markers));
        }
        *given = true;
        *slot = *sample;
    }
    table.partial = table.partial.iter().filter_map(|&(row, given)| Some((cell_of(rows.get(row)?), given))).collect();
    table.samples = samples;
    for blank in &mut table.blanks {
        if let Some(row) = rows.get(blank.frame as usize) {
            blank.frame = index(row) as u32;
            blank.marker = row.marker;
        }
    }
    for (frame, marker) in stated.iter() {
        if let Some(slot) = samples_of(&mut table, frame, marker) {
            *slot = [f64::NAN; 3];
        }
    }
    table.partial.retain(|&(index, _)| !stated.contains(index / columns.max(1), index % columns.max(1)));
    for blank in &mut table.blanks {
        let stated = stated.contains(blank.frame as usize, blank.marker as usize);
        blank.zero &= !stated;
        blank.given &= !stated && !blank.zero;
    }
    table.blanks.retain(|b| !b.given);
    table.first_frame = first_frame;
    let frames = table.frames() as u32; // one row at least stands for each 256
    let rows = Rows { table, numbers, clock, frame_step, frames, short: ShortRows::default(), surplus: 0 };
    Ok((rows, layout))
}

/// The sample of a marker that is no model output.
fn samples_of(table: &mut Table, frame: usize, marker: usize) -> Option<&mut [f64; 3]> {
    table.markers.get(marker).filter(|m| m.role == Role::Marker)?;
    table.samples.get_mut(frame.checked_mul(table.markers.len())?.checked_add(marker)?)
}

/// First frame number, the step between neighbouring frames, and the number of frames.
fn span(rows: &[Row], markers: usize) -> Result<(i64, i64, usize), FormatError> {
    let first = rows.iter().map(|r| r.frame).min().unwrap_or(1);
    let step = rows.iter().fold(0, |step, r| gcd(r.frame.abs_diff(first), step)).max(1);
    let step = if step > LARGEST_STEP { 1 } else { step };
    let last = rows.iter().max_by_key(|r| r.frame);
    let distance = last.map_or(0, |r| r.frame.abs_diff(first));
    let frames = u128::from(distance / step) + 1;
    let samples = frames.saturating_mul(markers as u128);
    if samples > SAMPLES_ALWAYS.max(SAMPLES_PER_ROW * rows.len() as u128) || frames > u128::from(u32::MAX) {
        let text = format!(
            "frames {first} to {} of {markers} markers would be {samples} samples, but there are only {} rows; correct the frame numbers",
            last.map_or(first, |r| r.frame),
            rows.len()
        );
        return Err(FormatError::too_large(NAME, Place::Line { line: last.map_or(1, |r| r.line), column: None }, text));
    }
    Ok((first, i64::try_from(step).unwrap_or(i64::MAX), frames as usize))
}

fn twice(rows: &[Row], row: &Row, markers: &[Marker]) -> FormatError {
    let first = rows.iter().find(|r| (r.frame, r.marker) == (row.frame, row.marker)).map_or(0, |r| r.line);
    let label = markers.get(row.marker as usize).map_or("", |m| m.label.as_str());
    let text = format!("marker \"{}\" of frame {} was already given in line {first}; delete one of the rows", excerpt(label), row.frame);
    FormatError::malformed(NAME, Place::Line { line: row.line, column: None }, text)
}

/// Where a cell's text stands, with its quotes.
fn written(cell: &Cell<'_>) -> Range<usize> {
    let quote = usize::from(cell.quoted);
    cell.start - quote..cell.start + cell.text.len() + quote
}

/// The line end just before `offset`, where the first row begins.
fn line_end(bytes: &[u8], offset: usize) -> Range<usize> {
    let before = bytes.get(..offset).unwrap_or_default();
    let len = if before.ends_with(b"\r\n") { 2 } else { 1 };
    offset.saturating_sub(len)..offset
}
