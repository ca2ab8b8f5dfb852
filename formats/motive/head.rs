//! The line of settings and the header lines.
//!
//! | line | holds | in column 2 since 1.24 |
//! | --- | --- | --- |
//! | 1 | settings: `Format Version,1.23,Take Name,...,Export Frame Rate,120,...` | |
//! | 2 | nothing | |
//! | 3 | `Marker`, `Rigid Body`, `Rigid Body Marker`, `Bone`, `Bone Marker` for each column | `Type` |
//! | 4 | names, for each column | `Name` |
//! | 5 | identifiers | `ID` |
//! | (6) | what the asset hangs on, since 1.25 | `Parent` |
//! | 6 or 7 | `Position`, `Rotation`, `Mean Marker Error`, `Marker Quality`, ... | |
//! | 7 or 8 | `Frame`, `Time (Seconds)`, possibly `TimeCode`, and `X`, `Y`, `Z`, `W` | |
//!
//! The version is not asked: lines are told by what they hold.

use super::NAME;
use crate::text::number::decimal;
use crate::text::scan::{Scanner, excerpt};
use crate::text::titles::{self, row};
use crate::text::{Column, Sheet};
use crate::{FormatError, Marker, Place, Unit};
use std::collections::BTreeSet;

/// What the first cell of the file holds.
const FIRST: &[u8] = b"Format Version";
/// At most this many header lines are looked through for the axes.
const MOST_LINES: usize = 16;
/// Columns of markers as they were seen.
const SEEN: [&str; 1] = ["Marker"];
/// Columns of the places where an asset that was fitted to its markers has them.
const EXPECTED: [&str; 2] = ["Rigid Body Marker", "Bone Marker"];

/// What the file says about its unit of length.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Length {
    /// Nothing.
    Unstated,
    /// A unit.
    Known(Unit),
    /// A unit that we do not know, as written.
    Unknown(String),
}

/// The beginning of the file, understood.
#[derive(Clone, Debug)]
pub(super) struct Head {
    /// Where the rows are, and what each column holds.
    pub sheet: Sheet,
    /// The markers, from left to right.
    pub markers: Vec<Marker>,
    /// The unit of length.
    pub length: Length,
    /// Frames per second of the exported rows.
    pub rate_hz: Option<f64>,
    /// How many rows the file claims.
    pub frames: Option<u64>,
    /// True if the markers are where bodies expect them, because the file has no others.
    pub expected_places: bool,
    /// What the other columns hold, each once.
    pub others: Vec<String>,
}

/// The separator of cells, if the text begins like a Motive export.
pub(super) fn separator(bytes: &[u8]) -> Option<u8> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let rest = text.strip_prefix(b"\"").unwrap_or(text).strip_prefix(FIRST)?;
    rest.iter().copied().find(|b| !matches!(b, b'"' | b' ')).filter(|b| matches!(b, b',' | b';' | b'\t'))
}

impl Head {
    /// Understands the beginning of the file.
    ///
    /// # Errors
    /// Header lines are lacking, or there are no positions of markers.
    pub fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        let whole = |text: &str| FormatError::malformed(NAME, Place::Whole, text);
        let separator =
            separator(bytes).ok_or_else(|| whole("the file does not begin with Format Version; export it again, with its header"))?;
        let mut scanner = Scanner::new(bytes, separator);
        let settings = row(&mut scanner)?;
        let setting = |key: &str| {
            let at = settings.iter().step_by(2).position(|k| k.trim().eq_ignore_ascii_case(key))?;
            settings.get(2 * at + 1).map(|v| v.trim()).filter(|v| !v.is_empty())
        };
        let number = |key: &str| setting(key).and_then(decimal).filter(|v| *v > 0.0);

        let (lines, axes) = header_lines(bytes, &mut scanner)?;
        let (Some(types), Some(names), Some(contents)) =
            (line(&lines, "Type", 0), line(&lines, "Name", 1), lines.get(2..).and_then(<[_]>::last))
        else {
            return Err(whole(
                "fewer than three header lines stand above Frame, expected types, names, ... and Position; export it again, with its header",
            ));
        };
        let cell = |cells: &[String], at: usize| cells.get(at).map_or(String::new(), |c| c.trim().to_owned());
        let holds = |at: usize, kinds: &[&str]| kinds.contains(&cell(types, at).as_str()) && cell(contents, at) == "Position";
        let any = |kinds: &[&str]| (0..axes.len()).any(|at| holds(at, kinds));
        let (kinds, expected_places): (&[&str], bool) = match (any(&SEEN), any(&EXPECTED)) {
            (true, _) => (&SEEN, false),
            (false, true) => (&EXPECTED, true),
            (false, false) => return Err(no_markers(types)),
        };
        if expected_places && setting("Coordinate Space").is_some_and(|s| s.eq_ignore_ascii_case("Local")) {
            let text = "the file holds no measured markers, and the places where bodies expect theirs are relative to these (Coordinate Space is \
                        Local); export it again with Markers, or in Global";
            return Err(FormatError::unsupported(NAME, Place::Line { line: 1, column: None }, text));
        }
        let chosen = |cells: &[String]| -> Vec<String> {
            (0..axes.len()).map(|at| if holds(at, kinds) { cells.get(at).cloned().unwrap_or_default() } else { String::new() }).collect()
        };
        let mut titles = titles::understand(&chosen(names), &chosen(&axes), &[]);
        if let Some(at) = (0..axes.len()).find(|&at| holds(at, kinds) && titles.columns.get(at) == Some(&Column::Other)) {
            let text =
                format!("the positions of \"{}\" are not in the three columns X, Y, Z; export the take again", excerpt(&cell(names, at)));
            return Err(FormatError::malformed(
                NAME,
                Place::Line { line: scanner.line().saturating_sub(1), column: Some(at as u64 + 1) },
                text,
            ));
        }
        titles.set(0, Column::Frame);
        if axes.get(1).is_some_and(|a| a.to_ascii_lowercase().starts_with("time") && !a.eq_ignore_ascii_case("timecode")) {
            titles.set(1, Column::Time);
        }
        let is_nameless = |at: &usize| [types, names, &axes].iter().all(|cells| cell(cells, *at).is_empty());
        Ok(Self {
            others: others(types, names, &axes, &titles.columns),
            sheet: Sheet {
                separator,
                columns: titles.columns,
                nameless_tail: (0..axes.len()).rev().take_while(is_nameless).count(),
                time_unit_secs: Some(1.0),
                start: scanner.offset(),
                line: scanner.line(),
            },
            markers: titles.markers,
            length: setting("Length Units")
                .map_or(Length::Unstated, |w| Unit::parse(w).map_or_else(|| Length::Unknown(excerpt(w)), Length::Known)),
            rate_hz: number("Export Frame Rate").or_else(|| number("Capture Frame Rate")),
            frames: setting("Total Exported Frames").and_then(|v| v.parse().ok()),
            expected_places,
        })
    }
}

/// The lines between the settings and the axes that are not empty, and the line of axes.
/// A line of names that are all empty has quotes in it; one of nothing but separators is an empty line that a spreadsheet saved.
fn header_lines(bytes: &[u8], scanner: &mut Scanner<'_>) -> Result<(Vec<Vec<String>>, Vec<String>), FormatError> {
    let mut lines = Vec::new();
    while lines.len() < MOST_LINES {
        scanner.skip_blank_lines();
        if scanner.at_end() {
            break;
        }
        let start = scanner.offset();
        let cells = row(scanner)?;
        if cells.first().is_some_and(|c| c.trim().eq_ignore_ascii_case("Frame")) {
            return Ok((lines, cells));
        }
        let quotes = || bytes.get(start..scanner.offset()).unwrap_or_default().contains(&b'"');
        if cells.iter().any(|c| !c.is_empty()) || quotes() {
            lines.push(cells);
        }
    }
    let text = "no header line begins with Frame; export the take again, with its header";
    Err(FormatError::malformed(NAME, Place::Line { line: scanner.line(), column: None }, text))
}

/// The header line that calls itself `name` in its second cell, as they do since 1.24; else the one at its usual place.
fn line<'a>(lines: &'a [Vec<String>], name: &str, usual: usize) -> Option<&'a Vec<String>> {
    lines.iter().find(|cells| cells.get(1).is_some_and(|c| c == name)).or_else(|| lines.get(usual))
}

fn no_markers(types: &[String]) -> FormatError {
    let kinds: BTreeSet<&str> = types.iter().skip(2).map(|t| t.trim()).filter(|t| !t.is_empty()).collect();
    let kinds: Vec<String> = kinds.into_iter().take(8).map(excerpt).collect();
    let found = if kinds.is_empty() { "nothing".to_owned() } else { kinds.join(", ") };
    let text = format!("the file holds no positions of markers (its columns are: {found}); export it again with Markers");
    FormatError::unsupported(NAME, Place::Whole, text)
}

/// What the columns hold that are neither coordinates nor frames nor times: type and name, or the word above the rows, each once.
fn others(types: &[String], names: &[String], axes: &[String], columns: &[Column]) -> Vec<String> {
    let mut seen = BTreeSet::new();
    let mut others = Vec::new();
    for (at, _) in columns.iter().enumerate().filter(|(_, c)| **c == Column::Other) {
        let cell = |cells: &[String]| cells.get(at).map_or(String::new(), |c| excerpt(c));
        let text = match (cell(types), cell(names)) {
            (kind, name) if kind.is_empty() && name.is_empty() => cell(axes),
            (kind, name) => format!("{kind} {name}").trim().to_owned(),
        };
        if !text.is_empty() && seen.insert(text.clone()) {
            others.push(text);
        }
    }
    others
}
