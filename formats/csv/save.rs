//! Writes an opened table again: every byte as it was, except for the cells of filled samples, and rows for samples that had none.

use super::clock::Clock;
use super::header::Column;
use super::long::Layout;
use super::number::Style;
use super::table::Blank;
use crate::{Origin, Take};
use std::collections::HashSet;
use std::io::{self, Write};
use std::ops::Range;

/// A table as it was opened.
pub(super) struct Opened {
    /// The whole file.
    pub bytes: Vec<u8>,
    /// The cells that may be filled, in the order of the file.
    pub blanks: Vec<Blank>,
    /// How numbers are written.
    pub style: Style,
    /// How rows are added, in a long table.
    pub rows: Option<AddRows>,
}

/// How rows are added to a long table.
pub(super) struct AddRows {
    /// Where cells and rows go.
    pub layout: Layout,
    /// The times.
    pub clock: Clock,
    /// By how much frame numbers go up.
    pub frame_step: i64,
}

/// One change of the file.
enum Edit {
    /// A row is put in before the byte at an offset.
    Row { at: usize, frame: usize, marker: usize },
    /// A cell is exchanged.
    Cell(Blank),
}

impl Opened {
    /// Writes the file with the [`Origin::Repaired`] samples of `take`.
    pub fn write(&self, take: &Take, out: &mut dyn Write) -> io::Result<()> {
        let mut out = io::BufWriter::with_capacity(1 << 16, out);
        let mut done = 0;
        let mut text = Vec::new();
        for edit in self.edits(take) {
            text.clear();
            let upto = match edit {
                Edit::Row { at, frame, marker } => {
                    self.row(take, at, frame, marker, &mut text);
                    at..at
                }
                Edit::Cell(blank) => {
                    let position = take.position_mm(blank.frame as usize, blank.marker as usize).unwrap_or_default();
                    let value = position.get(usize::from(blank.axis)).copied().unwrap_or_default();
                    self.style.write(value / take.unit.mm(), blank.quoted, &mut text);
                    let start = blank.start as usize;
                    start..start.saturating_add(blank.len as usize)
                }
            };
            out.write_all(self.text(done..upto.start))?;
            out.write_all(&text)?;
            done = upto.end;
        }
        out.write_all(self.text(done..self.bytes.len()))?;
        out.flush()
    }

    /// The changes in the order of the file.
    fn edits(&self, take: &Take) -> Vec<Edit> {
        let repaired = |b: &Blank| take.origin(b.frame as usize, b.marker as usize) == Origin::Repaired;
        let mut edits: Vec<Edit> = Vec::new();
        if let Some(rows) = &self.rows {
            let present: HashSet<(usize, usize)> = self.blanks.iter().map(|b| (b.frame as usize, b.marker as usize)).collect();
            for frame in 0..take.frames() {
                for marker in 0..take.markers.len() {
                    if take.origin(frame, marker) == Origin::Repaired && !present.contains(&(frame, marker)) {
                        let at = rows.layout.frame_ends.get(frame).copied().unwrap_or(rows.layout.end);
                        edits.push(Edit::Row { at, frame, marker });
                    }
                }
            }
        }
        edits.extend(self.blanks.iter().copied().filter(repaired).map(Edit::Cell));
        if self.rows.is_some() {
            // Stable: rows stay in the order of frames and markers.
            // A row comes before a cell that begins where it is put in, unless that cell is the last of a file that does not end its last line.
            edits.sort_by_key(|e| match e {
                Edit::Row { at, .. } => (*at, if self.is_open(*at) { 2 } else { 0 }),
                Edit::Cell(blank) => (blank.start as usize, 1),
            });
        }
        edits
    }

    /// The text of a new row, put in at `at`.
    fn row(&self, take: &Take, at: usize, frame: usize, marker: usize, out: &mut Vec<u8>) {
        let Some(AddRows { layout, clock, frame_step }) = &self.rows else { return };
        let open = self.is_open(at);
        let line_end = self.text(layout.line_end.clone());
        if open {
            out.extend_from_slice(line_end);
        }
        let position = take.position_mm(frame, marker).unwrap_or_default();
        let number = take.first_frame.saturating_add(i64::try_from(frame).unwrap_or(i64::MAX).saturating_mul(*frame_step));
        for (i, column) in layout.columns.iter().enumerate() {
            if i > 0 {
                out.push(layout.separator);
            }
            out.extend_from_slice(self.text(layout.leads.get(i).cloned().unwrap_or(0..0)));
            match column {
                Column::Frame => out.extend_from_slice(number.to_string().as_bytes()),
                Column::Label => out.extend_from_slice(self.text(layout.labels.get(marker).cloned().unwrap_or(0..0))),
                Column::Coordinate { axis, .. } => {
                    let value = position.get(*axis).copied().unwrap_or_default();
                    self.style.write(value / take.unit.mm(), false, out);
                }
                Column::Time => match layout.times.get(frame).filter(|t| !t.is_empty()) {
                    Some(written) => out.extend_from_slice(self.text(written.clone())),
                    None => {
                        if let Some(time) = clock.time_of(number, *frame_step, take.rate_hz) {
                            Style { decimals: clock.decimals(), padded: true, ..self.style }.write(time, false, out);
                        }
                    }
                },
                Column::Other => {}
            }
        }
        if !open {
            out.extend_from_slice(line_end);
        }
    }

    /// True if the line before `at` has no end: the last of a file that does not end its last line.
    fn is_open(&self, at: usize) -> bool {
        !matches!(self.text(0..at).last(), Some(b'\n' | b'\r'))
    }

    fn text(&self, range: Range<usize>) -> &[u8] {
        self.bytes.get(range).unwrap_or_default()
    }
}
