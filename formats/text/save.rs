//! Writes an opened table again: every byte as it was, except for the cells of filled samples, and what is put in between.

use super::number::Style;
use super::table::Blank;
use super::{Column, Sheet};
use crate::{Document, FormatError, Notes, Origin, Place, Take};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::ops::Range;

/// A table as it was opened.
pub(crate) struct Opened {
    /// The whole file.
    pub bytes: Vec<u8>,
    /// The cells that may be filled, in the order of the file.
    pub blanks: Vec<Blank>,
    /// How numbers are written.
    pub style: Style,
    /// Rows that end before their last cells.
    pub short: ShortRows,
}

/// Rows that end before their last cells; those are added, with their separators, as far as they are filled.
#[derive(Clone, Debug, Default)]
pub(crate) struct ShortRows {
    /// Separator of cells.
    separator: u8,
    /// The cell of a row that holds each coordinate of each marker.
    places: Vec<[u32; 3]>,
    /// How many cells there are in such a row, by frame.
    cells: BTreeMap<u32, u32>,
}

impl ShortRows {
    /// No such rows so far.
    pub fn new(sheet: &Sheet, markers: usize) -> Self {
        let mut places = vec![[0; 3]; markers];
        for (at, column) in (0u32..).zip(&sheet.columns) {
            if let Column::Coordinate { marker, axis } = *column
                && let Some(place) = places.get_mut(marker).and_then(|m| m.get_mut(axis))
            {
                *place = at;
            }
        }
        Self { separator: sheet.separator, places, cells: BTreeMap::new() }
    }

    /// Takes in a row with so many cells.
    pub fn add(&mut self, frame: u32, cells: usize) {
        self.cells.insert(frame, u32::try_from(cells).unwrap_or(u32::MAX));
    }

    /// How many separators come before a filled cell. `reached` is the last such row, and how many cells it has by now.
    fn separators(&self, blank: &Blank, reached: &mut (u32, u32)) -> usize {
        let Some(&cells) = self.cells.get(&blank.frame) else { return 0 };
        let place = self.places.get(blank.marker as usize).and_then(|m| m.get(usize::from(blank.axis))).copied().unwrap_or(0);
        let present = if reached.0 == blank.frame { reached.1.max(cells) } else { cells };
        *reached = (blank.frame, present.max(place.saturating_add(1)));
        place.saturating_add(1).saturating_sub(present) as usize
    }
}

/// Text that is put into the file.
pub(crate) struct Insertion {
    /// Before the byte at this offset.
    pub at: usize,
    /// True if a cell that begins at the same place comes first.
    pub behind: bool,
    /// What is put in.
    pub text: Vec<u8>,
}

/// One change of the file.
enum Edit {
    Insert(Insertion),
    Cell(Blank),
}

impl Opened {
    /// Writes the file with the [`Origin::Repaired`] samples of `take` and the insertions, which come in the order of the file.
    pub fn write(&self, take: &Take, insertions: Vec<Insertion>, out: &mut dyn Write) -> io::Result<()> {
        let mut out = io::BufWriter::with_capacity(1 << 16, out);
        let mut done = 0;
        let mut text = Vec::new();
        let mut reached = (0, 0);
        let repaired = |b: &Blank| take.origin(b.frame as usize, b.marker as usize) == Origin::Repaired;
        let any = !insertions.is_empty();
        let mut edits: Vec<Edit> = insertions.into_iter().map(Edit::Insert).collect();
        edits.extend(self.blanks.iter().copied().filter(repaired).map(Edit::Cell));
        if any {
            // Stable: what is put in at one place stays in its order.
            edits.sort_by_key(|e| match e {
                Edit::Insert(insertion) => (insertion.at, if insertion.behind { 2 } else { 0 }),
                Edit::Cell(blank) => (blank.start as usize, 1),
            });
        }
        for edit in edits {
            text.clear();
            let upto = match edit {
                Edit::Insert(insertion) => {
                    text = insertion.text;
                    insertion.at..insertion.at
                }
                Edit::Cell(blank) => {
                    let position = take.position_mm(blank.frame as usize, blank.marker as usize).unwrap_or_default();
                    let value = position.get(usize::from(blank.axis)).copied().unwrap_or_default();
                    text.extend(std::iter::repeat_n(self.short.separator, self.short.separators(&blank, &mut reached)));
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

    /// Half a step of new numbers in mm, and what a double loses on the way from millimetres to the file's unit and back.
    pub fn rounding_mm(&self, take: &Take) -> f64 {
        0.5 * self.style.step() * take.unit.mm() * (1.0 + 1e-6) + 1e-9
    }

    /// Some of the file's bytes; none outside the file.
    pub fn text(&self, range: Range<usize>) -> &[u8] {
        self.bytes.get(range).unwrap_or_default()
    }
}

/// That `repaired` is of the size of `opened`.
///
/// # Errors
/// It is not.
pub(crate) fn same_size(format: &'static str, opened: &Take, repaired: &Take) -> Result<(), FormatError> {
    if (repaired.frames(), repaired.markers.len()) == (opened.frames(), opened.markers.len()) {
        return Ok(());
    }
    let text = "the repaired take is of another size than the opened file; write it to a new file";
    Err(FormatError::unsupported(format, Place::Whole, text))
}

/// An opened table whose rows are frames.
pub(crate) struct TextDocument {
    /// Name of the format.
    pub format: &'static str,
    /// What was read.
    pub take: Take,
    /// The file, and where its gaps are.
    pub opened: Opened,
    /// What the file holds that is not in the take ([`Document::beyond_take`]).
    pub beyond: Vec<String>,
}

impl Document for TextDocument {
    fn take(&self) -> &Take {
        &self.take
    }

    fn save(&self, repaired: &Take, out: &mut dyn Write, _notes: &Notes) -> Result<(), FormatError> {
        same_size(self.format, &self.take, repaired)?;
        self.opened.write(repaired, Vec::new(), out).map_err(|e| FormatError::io(self.format, e))
    }

    fn beyond_take(&self) -> Vec<String> {
        self.beyond.clone()
    }

    fn rounding_mm(&self) -> f64 {
        self.opened.rounding_mm(&self.take)
    }
}
