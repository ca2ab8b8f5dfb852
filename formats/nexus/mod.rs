//! ASCII exports of Vicon Nexus, and of Vicon Workstation before it: blocks of rows, one of which holds the markers.
//!
//! | file | holds |
//! | --- | --- |
//! | `blocks` | where the blocks are |
//! | `head` | the header lines of the block of markers |
//! | `create` | a new file |
//!
//! Other blocks (model outputs, joints, segments, devices, events) are noted and left alone: they are results, or nothing that is in frames.

mod blocks;
mod create;
mod head;

use crate::text::scan::excerpt;
use crate::text::{self, Said, save, wide};
use crate::{Document, Format, FormatError, FormatInfo, Match, Note, Notes, Place, Stated, Take, Unit};
use blocks::Block;
use head::Head;
use save::TextDocument;
use std::io::Write;

const NAME: &str = "nexus";
const INFO: FormatInfo =
    FormatInfo { name: NAME, summary: "ASCII exports of Vicon Nexus and Vicon Workstation", extensions: &["csv"], holds_gaps: true };

/// The format.
#[derive(Clone, Copy, Debug)]
pub struct Nexus;

impl Format for Nexus {
    fn info(&self) -> &'static FormatInfo {
        &INFO
    }

    fn sniff(&self, head: &[u8]) -> Match {
        if blocks::find(head).iter().any(Block::is_known) { Match::Certain } else { Match::No }
    }

    fn open(&self, bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
        open(bytes, stated, notes).map_err(|e| text::named(NAME, e))
    }

    fn create(&self, take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
        create::create(take, out, notes)
    }
}

fn open(bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
    let blocks = blocks::find(&bytes);
    let block = the_markers(&blocks)?;
    // To whoever reads the rows, the file ends where the block does.
    let readable = bytes.get(..block.end).unwrap_or_default();
    let mut head = Head::read(readable, block)?;
    if head.titles.units_differ && stated.unit.is_none() {
        let text = "the block Trajectories has different units for different columns; export it again in one unit";
        return Err(FormatError::unsupported(NAME, head.place(), text));
    }
    if let (None, Some(written), None) = (head.titles.unit, head.titles.unknown_unit.take(), stated.unit) {
        head.titles.unit = Some(Unit::Millimetre);
        notes.add(Note::UnitUnknown { written, unit: Unit::Millimetre });
    }
    let rows = wide::read(readable, &head.sheet, &head.titles.markers, &stated.missing)?;
    let said = Said { unit: head.titles.unit, rate_hz: Some(block.rate_hz).filter(|rate| *rate > 0.0) };
    let others: Vec<String> = blocks.iter().filter(|b| !b.holds_markers()).map(|b| b.name.clone()).collect();
    let (take, opened) = text::finish(bytes, &head.sheet, rows, said, stated, notes)?;
    if head.model_outputs > 0 {
        notes.add(Note::ModelOutputs { columns: head.model_outputs });
    }
    if !head.others.is_empty() {
        notes.add(Note::OtherColumns { names: head.others });
    }
    if !others.is_empty() {
        notes.add(Note::OtherBlocks { names: others });
    }
    Ok(Box::new(TextDocument { format: NAME, take, opened, beyond: Vec::new() }))
}

/// The one block that holds the markers.
fn the_markers(blocks: &[Block]) -> Result<&Block, FormatError> {
    let mut found = blocks.iter().filter(|b| b.holds_markers());
    let Some(block) = found.next() else {
        let names: Vec<String> = blocks.iter().take(8).map(|b| format!("\"{}\"", excerpt(&b.name))).collect();
        let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        let text = format!("the file holds no block of trajectories (its blocks: {names}); export it again with Trajectories");
        return Err(FormatError::unsupported(NAME, Place::Whole, text));
    };
    if let Some(again) = found.next() {
        let text = format!("a second block of trajectories, the first is in line {}; split the file", block.line);
        return Err(FormatError::unsupported(NAME, Place::Line { line: again.line, column: None }, text));
    }
    Ok(block)
}

#[cfg(test)]
mod tests;
