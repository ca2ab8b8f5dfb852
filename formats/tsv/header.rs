//! The lines before the rows: a key and its values each, then the names of the columns if QTM was told to write them.

use super::NAME;
use crate::text::lines::{Line, Lines, word};
use crate::text::number::decimal;
use crate::text::scan::excerpt;
use crate::text::{Column, Sheet};
use crate::{FormatError, Marker, Place};

const TAB: u8 = b'\t';
/// How the first line of an export begins, of any kind of data.
const FIRST_KEYS: [&str; 5] = ["FILE_VERSION", "NO_OF_FRAMES", "NO_OF_BODIES", "TOT_NO_OF_CHAN", "NO_OF_CAMERAS"];
/// Keys that do not look like keys.
const PLAIN_KEYS: [&str; 3] = ["FREQUENCY", "DESCRIPTION", "EVENT"];
/// Types of trajectories whose samples are not measured. Of a `Mixed` one nobody can say which samples are.
const DERIVED: [&str; 3] = ["gap-filled", "virtual", "edited"];

/// The lines before the rows, understood.
#[derive(Clone, Debug)]
pub(super) struct Header {
    /// Where the rows are, and what each column holds.
    pub sheet: Sheet,
    /// `MARKER_NAMES`.
    pub markers: Vec<Marker>,
    /// For each marker, true if its type says that it is not measured.
    pub derived: Vec<bool>,
    /// `FREQUENCY`, if it is a number.
    pub rate_hz: Option<f64>,
    /// `NO_OF_FRAMES`.
    pub frames: Option<u64>,
    /// `NO_OF_MARKERS`.
    pub claimed: Option<usize>,
    /// How many lines `EVENT` there are.
    pub events: usize,
}

/// True if these are the first bytes of an export of QTM.
pub(super) fn begins(head: &[u8]) -> bool {
    let Some(line) = Lines::new(head).next_filled(TAB) else { return false };
    let cells = line.cells(TAB);
    cells.len() > 1 && cells.first().is_some_and(|key| FIRST_KEYS.contains(&key.as_str()))
}

impl Header {
    /// Reads everything before the first row.
    ///
    /// # Errors
    /// Other data than 3D, no names, or columns that do not fit them.
    pub fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        if !begins(bytes) {
            let text = "the file does not begin with NO_OF_FRAMES, as exports of Qualisys Track Manager do; check \"Include TSV header\" when \
                        exporting, or rename the file after its content";
            return Err(FormatError::malformed(NAME, Place::Line { line: 1, column: None }, text));
        }
        let mut lines = Lines::new(bytes);
        let mut keys: Vec<(String, Vec<String>)> = Vec::new();
        let rows = loop {
            let place = lines.clone();
            let Some(line) = lines.next_filled(TAB) else {
                let (_, line) = lines.place();
                let text = "the file ends inside its header; export it again";
                return Err(FormatError::malformed(NAME, Place::Line { line, column: None }, text));
            };
            let mut cells = line.cells(TAB).into_iter();
            match cells.next() {
                Some(key) if is_key(&key) => keys.push((key, cells.collect())),
                _ => break place,
            }
        };
        let values = |key: &str| keys.iter().find(|(k, _)| k == key).map(|(_, values)| values.as_slice());
        let value = |key: &str| values(key).and_then(|v| v.first()).map(String::as_str).filter(|v| !v.is_empty());
        refuse_other_data(value("DATA_INCLUDED"), &keys)?;
        let claimed = value("NO_OF_MARKERS").and_then(|v| v.parse::<usize>().ok());
        let Some(names) = values("MARKER_NAMES") else {
            let text = "there is no line MARKER_NAMES; export the file again, with its header";
            return Err(FormatError::malformed(NAME, Place::Whole, text));
        };
        // names may be empty; a tab at the end of the line is no name
        let filled = names.iter().rposition(|n| !n.is_empty()).map_or(0, |last| last + 1);
        let count = filled.max(claimed.unwrap_or(0).min(names.len()));
        let names: Vec<&String> = names.iter().take(count).collect();
        let types = values("TRAJECTORY_TYPES").unwrap_or_default();
        let derived = |at: usize| types.get(at).is_some_and(|t| DERIVED.iter().any(|d| t.to_ascii_lowercase().starts_with(d)));
        let (columns, start, line) = columns(rows, count)?;
        Ok(Self {
            sheet: Sheet { separator: TAB, columns, nameless_tail: 0, time_unit_secs: Some(1.0), start, line },
            markers: names.into_iter().map(Marker::new).collect(),
            derived: (0..count).map(derived).collect(),
            rate_hz: value("FREQUENCY").and_then(decimal).filter(|r| *r > 0.0),
            frames: value("NO_OF_FRAMES").and_then(|v| v.parse().ok()),
            claimed,
            events: keys.iter().filter(|(key, _)| key == "EVENT").count(),
        })
    }
}

/// True for a word in capitals with a line between its parts, and for the keys without one.
fn is_key(cell: &str) -> bool {
    let capital = |b: u8| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_';
    PLAIN_KEYS.contains(&cell)
        || (cell.contains('_') && cell.as_bytes().first().is_some_and(u8::is_ascii_uppercase) && cell.bytes().all(capital))
}

/// Refuses exports that hold something else than positions of markers.
fn refuse_other_data(included: Option<&str>, keys: &[(String, Vec<String>)]) -> Result<(), FormatError> {
    let has = |key: &str| keys.iter().any(|(k, _)| k == key);
    let found = match included {
        Some(data) if data.eq_ignore_ascii_case("3D") => return Ok(()),
        Some(data) => excerpt(data),
        None if has("NO_OF_BODIES") => "6D".to_owned(),
        None if has("TOT_NO_OF_CHAN") => "ANALOG".to_owned(),
        None => return Ok(()),
    };
    let what = match found.to_ascii_uppercase().as_str() {
        "6D" => "the motion of rigid bodies (6D)".to_owned(),
        "2D" => "what cameras saw (2D)".to_owned(),
        "ANALOG" => "analog channels".to_owned(),
        _ => format!("\"{found}\""),
    };
    let text = format!("this export holds {what}, not positions of markers; export 3D data, as TSV or as C3D");
    Err(FormatError::unsupported(NAME, Place::Whole, text))
}

/// What each column holds, and offset and number of the first row. `rows` stands before the names of the columns, or the first row.
fn columns(mut rows: Lines<'_>, markers: usize) -> Result<(Vec<Column>, usize, u64), FormatError> {
    let coordinates = (0..markers).flat_map(|marker| (0..3).map(move |axis| Column::Coordinate { marker, axis }));
    let before_row = rows.clone();
    let place = rows.place();
    let Some(line) = rows.next_filled(TAB) else { return Ok((coordinates.collect(), place.0, place.1)) };
    let cells = line.cells(TAB);
    let before = if is_heading(&cells) {
        let before = cells.iter().take_while(|c| before_markers(c).is_some()).count();
        check_heading(cells.get(before..).unwrap_or_default(), markers, line)?;
        cells.iter().take(before).filter_map(|c| before_markers(c)).collect()
    } else {
        // without names of columns, their number tells; a tab may end the row
        let width = cells.len();
        rows = before_row;
        match width.checked_sub(3 * markers) {
            Some(0 | 1) => vec![],
            Some(2 | 3) => vec![Column::Frame, Column::Time],
            _ => {
                let text = format!(
                    "this row has {width} cells, expected {} for the {markers} MARKER_NAMES, or 2 more with frame and time; export the file again",
                    3 * markers
                );
                return Err(FormatError::malformed(NAME, Place::Line { line: line.number, column: None }, text));
            }
        }
    };
    let (start, line) = {
        let mut ahead = rows.clone();
        ahead.next_filled(TAB).map_or_else(|| rows.place(), |line| (line.start, line.number))
    };
    Ok((before.into_iter().chain(coordinates).collect(), start, line))
}

/// The columns before the markers, by their names.
fn before_markers(cell: &str) -> Option<Column> {
    match cell.to_ascii_lowercase().as_str() {
        "frame" => Some(Column::Frame),
        "time" => Some(Column::Time),
        _ => None,
    }
}

/// True if these cells name columns: none of them is a number or nothing, except at the end.
fn is_heading(cells: &[String]) -> bool {
    let filled = cells.iter().rposition(|c| !c.is_empty()).map_or(0, |last| last + 1);
    let number = |c: &String| c.is_empty() || c.replace(',', ".").parse::<f64>().is_ok() || c.eq_ignore_ascii_case("null");
    filled > 0 && !cells.iter().take(filled).any(number)
}

/// Checks the names of the coordinates: `LKNE X`, `LKNE Y`, `LKNE Z`, ...
fn check_heading(cells: &[String], markers: usize, line: Line<'_>) -> Result<(), FormatError> {
    let filled = cells.iter().rposition(|c| !c.is_empty()).map_or(0, |last| last + 1);
    let refuse = |text: String| Err(FormatError::malformed(NAME, Place::Line { line: line.number, column: None }, text));
    if filled != 3 * markers {
        return refuse(format!(
            "{filled} coordinates are named here, expected 3 for each of the {markers} MARKER_NAMES; export the file again"
        ));
    }
    for (cell, axis) in cells.iter().zip(["x", "y", "z"].into_iter().cycle()) {
        let last = word(cell.as_bytes()).to_ascii_lowercase();
        if !cell.is_empty() && !last.ends_with(axis) {
            return refuse(format!("found the column \"{}\", expected the {axis} of a marker; export positions", excerpt(cell)));
        }
    }
    Ok(())
}
