//! Rows that are added to a long table, for samples that had none.

use super::long::Layout;
use crate::text::Column;
use crate::text::clock::Clock;
use crate::text::number::Style;
use crate::text::save::{Insertion, Opened};
use crate::{Origin, Take};
use std::collections::HashSet;

/// How rows are added to a long table.
pub(super) struct AddRows {
    /// Where cells and rows go.
    pub layout: Layout,
    /// The times.
    pub clock: Clock,
    /// By how much frame numbers go up.
    pub frame_step: i64,
}

impl AddRows {
    /// The rows of the [`Origin::Repaired`] samples of `take` that have none in the file, by frame and marker.
    pub fn insertions(&self, opened: &Opened, take: &Take) -> Vec<Insertion> {
        let present: HashSet<(usize, usize)> = opened.blanks.iter().map(|b| (b.frame as usize, b.marker as usize)).collect();
        let mut insertions = Vec::new();
        for frame in 0..take.frames() {
            for marker in 0..take.markers.len() {
                if take.origin(frame, marker) == Origin::Repaired && !present.contains(&(frame, marker)) {
                    let at = self.layout.frame_ends.get(frame).copied().unwrap_or(self.layout.end);
                    // A row comes before a cell that begins where it is put in, unless that cell is the last of a file
                    // that does not end its last line.
                    let open = !matches!(opened.text(0..at).last(), Some(b'\n' | b'\r'));
                    insertions.push(Insertion { at, behind: open, text: self.row(opened, take, frame, marker, open) });
                }
            }
        }
        insertions
    }

    /// The text of a new row. `open` if the line before it has no end.
    fn row(&self, opened: &Opened, take: &Take, frame: usize, marker: usize, open: bool) -> Vec<u8> {
        let Self { layout, clock, frame_step } = self;
        let mut out = Vec::new();
        let line_end = opened.text(layout.line_end.clone());
        if open {
            out.extend_from_slice(line_end);
        }
        let position = take.position_mm(frame, marker).unwrap_or_default();
        let number = take.frame_label(frame);
        for (i, column) in layout.columns.iter().enumerate() {
            if i > 0 {
                out.push(layout.separator);
            }
            out.extend_from_slice(opened.text(layout.leads.get(i).cloned().unwrap_or(0..0)));
            match column {
                Column::Frame => out.extend_from_slice(number.to_string().as_bytes()),
                Column::Label => out.extend_from_slice(opened.text(layout.labels.get(marker).cloned().unwrap_or(0..0))),
                Column::Coordinate { axis, .. } => {
                    let value = position.get(*axis).copied().unwrap_or_default();
                    opened.style.write(value / take.unit.mm(), false, &mut out);
                }
                Column::Time => match layout.times.get(frame).filter(|t| !t.is_empty()) {
                    Some(written) => out.extend_from_slice(opened.text(written.clone())),
                    None => {
                        if let Some(time) = clock.time_of(number, *frame_step, take.rate_hz) {
                            Style { decimals: clock.decimals(), padded: true, ..opened.style }.write(time, false, &mut out);
                        }
                    }
                },
                Column::Other => {}
            }
        }
        if !open {
            out.extend_from_slice(line_end);
        }
        out
    }
}
