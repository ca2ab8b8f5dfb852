//! The header lines of the block of markers.
//!
//! | line | Nexus | Workstation |
//! | --- | --- | --- |
//! | 1 | `Trajectories` | `TRAJECTORIES` |
//! | 2 | `100` | `100,Hz` |
//! | 3 | `,,Subject:LKNE,,,Subject:RKNE,,` | `,LKNE,,,RKNE,,` |
//! | 4 | `Frame,Sub Frame,X,Y,Z,X,Y,Z` | `Field #,X,Y,Z,X,Y,Z` |
//! | 5 | `,,mm,mm,mm,mm,mm,mm` | |

use super::NAME;
use super::blocks::{Block, lines};
use crate::text::scan::{Scanner, excerpt, likely_separator};
use crate::text::titles::{self, Titles, row};
use crate::text::{Column, Sheet};
use crate::{FormatError, Place};
use std::collections::BTreeSet;

/// The axes stand at most this many lines below the name of the block; more than in the table because a quoted name may have line ends.
const DEEPEST: usize = 12;

/// The header lines, understood.
#[derive(Clone, Debug)]
pub(super) struct Head {
    /// Where the rows are, and what each column holds.
    pub sheet: Sheet,
    /// The markers and their unit.
    pub titles: Titles,
    /// How many of them are model outputs.
    pub model_outputs: usize,
    /// Columns that are nothing of ours: velocities, ...
    pub others: Vec<String>,
    line: u64,
}

impl Head {
    /// Understands the header lines of `block`; `bytes` end where it does.
    ///
    /// # Errors
    /// There are no axes, or no markers.
    pub fn read(bytes: &[u8], block: &Block) -> Result<Self, FormatError> {
        let place = |line| Place::Line { line, column: None };
        let no_axes = || {
            let text =
                "no line follows that begins with Frame and names the axes, expected Frame,Sub Frame,X,Y,Z,...; export the take again";
            FormatError::malformed(NAME, place(block.line), text)
        };
        let below = bytes.get(block.start..).unwrap_or_default();
        let axes_line =
            lines(below).take(DEEPEST).skip(2).map(|(_, _, text)| text).find(|text| begins_axes(&String::from_utf8_lossy(text)));
        let separator = likely_separator(axes_line.ok_or_else(no_axes)?);
        let mut scanner = Scanner::resume(bytes, separator, block.start, block.line);
        if block.start == 0 && bytes.starts_with(b"\xef\xbb\xbf") {
            scanner = Scanner::new(bytes, separator);
        }
        for _ in 0..2 {
            row(&mut scanner)?;
        }
        let names = row(&mut scanner)?;
        let line = scanner.line();
        let axes = row(&mut scanner)?;
        if !axes.first().is_some_and(|a| begins_axes(a)) {
            return Err(no_axes());
        }
        let mut ahead = scanner.clone();
        let mut units = row(&mut ahead)?;
        // a row has a frame number where the units have nothing
        if units.first().is_some_and(String::is_empty) && units.iter().any(|u| !u.is_empty()) {
            scanner = ahead;
        } else {
            units.clear();
        }
        let mut titles = titles::understand(&names, &axes, &units);
        if titles.markers.is_empty() {
            let text = "the block Trajectories names no markers, expected names above X, Y, Z; export the take again";
            return Err(FormatError::unsupported(NAME, place(line), text));
        }
        // Workstation writes results among the trajectories, and no units by which they could be told.
        let model_outputs = if units.is_empty() { titles.mark_model_outputs() } else { 0 };
        titles.set(0, Column::Frame);
        let sheet = Sheet {
            separator,
            columns: titles.columns.clone(),
            nameless_tail: titles.nameless_tail,
            time_unit_secs: None,
            start: scanner.offset(),
            line: scanner.line(),
        };
        let others = others(&names, &axes, &titles.columns);
        Ok(Self { sheet, titles, model_outputs, others, line })
    }

    /// Where the axes are.
    pub fn place(&self) -> Place {
        Place::Line { line: self.line, column: None }
    }
}

/// True for the first cell of the line of axes, and for that line.
fn begins_axes(text: &str) -> bool {
    let word: String = text.trim_start_matches([' ', '"']).chars().take(5).flat_map(char::to_lowercase).collect();
    word == "frame" || word == "field"
}

/// Names of the columns that hold neither coordinates nor frame numbers, each once: the name, and the axis under it.
fn others(names: &[String], axes: &[String], columns: &[Column]) -> Vec<String> {
    let mut seen = BTreeSet::new();
    let mut others = Vec::new();
    let mut name = "";
    for (at, axis) in axes.iter().enumerate() {
        if let Some(next) = names.get(at).filter(|n| !n.is_empty()) {
            name = next;
        }
        let is_ours = columns.get(at) != Some(&Column::Other) || axis.is_empty() || axis.eq_ignore_ascii_case("Sub Frame");
        if !is_ours {
            let text = format!("{} {axis}", excerpt(name)).trim_start().to_owned();
            if seen.insert(text.clone()) {
                others.push(text);
            }
        }
    }
    others
}
