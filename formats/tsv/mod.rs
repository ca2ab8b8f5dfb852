//! TSV as Qualisys Track Manager (QTM) exports 3D data.
//!
//! ```text
//! NO_OF_FRAMES   2000
//! FREQUENCY      100
//! DATA_INCLUDED  3D
//! MARKER_NAMES   LKNE     RKNE
//! Frame          Time     LKNE X   LKNE Y   LKNE Z   RKNE X ...
//! 1              0.00000  819.834  277.770  22.421   694.169 ...
//! ```
//!
//! | file | holds |
//! | --- | --- |
//! | `header` | the lines before the rows |
//! | `create` | new files |
//!
//! Rows are read and put back by what text formats share.
//! Exports of 2D data, of rigid bodies (6D), skeletons and analog channels look alike and are refused by name.

mod create;
mod header;

use crate::text::cut::{self, Whole};
use crate::text::save::TextDocument;
use crate::text::table::Blank;
use crate::text::wide::{self, Rules};
use crate::text::{self, Said};
use crate::{Document, Format, FormatError, FormatInfo, Match, Note, Notes, Origin, Stated, Take, TakeBuilder, Unit};
use header::Header;
use std::io::Write;

const NAME: &str = "tsv";
const INFO: FormatInfo =
    FormatInfo { name: NAME, summary: "TSV exports of Qualisys Track Manager", extensions: &["tsv"], holds_gaps: true };

/// What rows of a TSV file may look like.
const RULES: Rules = Rules { ragged: false, holes: "number the frames one after the other if none is missing" };

/// The format.
#[derive(Clone, Copy, Debug)]
pub struct Tsv;

impl Format for Tsv {
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
    let mut rows = wide::read_by(RULES, &bytes, &header.sheet, &header.markers, &stated.missing)?;
    let whole = Whole {
        separator: header.sheet.separator,
        first: (header.sheet.start, header.sheet.line),
        cells: header.sheet.columns.len(),
        claimed: header.frames,
    };
    cut::refuse(&bytes, whole)?;
    if let Some(claimed) = header.frames.filter(|&claimed| claimed != u64::from(rows.frames)) {
        notes.add(Note::FrameCount { claimed, present: u64::from(rows.frames) });
    }
    if let Some(claimed) = header.claimed.filter(|&claimed| claimed != header.markers.len()) {
        let text = format!("NO_OF_MARKERS is {claimed}, but there are {} MARKER_NAMES; these were taken", header.markers.len());
        notes.add(Note::Contradiction { text });
    }
    // QTM writes gaps as zeros unless it is told to write something else; a file that has something else has no zeros for gaps.
    let stated_missing = |b: &&Blank| stated.missing.contains(b.frame as usize, b.marker as usize);
    if rows.table.blanks.iter().all(|b| b.zero || stated_missing(&b)) {
        rows.table.take_zeros_as_gaps(notes);
    }
    let said = Said { unit: Some(Unit::Millimetre), rate_hz: header.rate_hz };
    let (take, opened) = text::finish(bytes, &header.sheet, rows, said, stated, notes)?;
    let take = with_origins(take, &header.derived);
    let events = header.events;
    let beyond = (events > 0).then(|| format!("{events} event{}", if events == 1 { "" } else { "s" })).into_iter().collect();
    Ok(Box::new(TextDocument { format: NAME, take, opened, beyond }))
}

/// Marks the samples of trajectories that are not measured.
fn with_origins(take: Take, derived: &[bool]) -> Take {
    if !derived.contains(&true) {
        return take;
    }
    let mut builder = TakeBuilder::from(take.clone());
    for marker in (0..take.markers.len()).filter(|&m| derived.get(m) == Some(&true)) {
        for frame in 0..take.frames() {
            if let Some(position) = take.position_mm(frame, marker) {
                builder.set(frame, marker, position, Origin::Derived);
            }
        }
    }
    builder.build()
}

#[cfg(test)]
mod tests;
