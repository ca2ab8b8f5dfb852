//! The lines before the rows: what they state, and which columns are whose.
//!
//! Three places count the markers: `NumMarkers`, the labels, and the heads of the coordinates (`X1`, `Y1`, `Z1`, ...).
//! Where they agree there is nothing to decide. Where they do not, the rows decide ([`Count::decide`]).

use super::NAME;
use crate::text::lines::{Line, Lines};
use crate::text::number::decimal;
use crate::text::scan::excerpt;
use crate::text::{Column, Sheet};
use crate::{FormatError, Marker, Note, Notes, Place, Unit};

/// How the first line begins.
const FIRST_WORD: &[u8] = b"PathFileType";
/// Frame number and time.
const BEFORE_MARKERS: usize = 2;

/// The lines before the rows, understood.
#[derive(Clone, Debug)]
pub(super) struct Header {
    /// Where the rows are, and what each column holds.
    pub sheet: Sheet,
    /// The markers, in the order of their columns.
    pub markers: Vec<Marker>,
    /// `DataRate`, if it is a rate: that of the rows.
    pub rate_hz: Option<f64>,
    /// `CameraRate`, if it is a rate.
    pub camera_rate_hz: Option<f64>,
    /// `NumFrames`.
    pub frames: Option<u64>,
    /// `Units`, if known.
    pub unit: Option<Unit>,
    /// `Units` as written.
    pub unit_written: Option<String>,
    /// Names of columns behind the markers.
    pub others: Vec<String>,
    /// `NumMarkers`.
    claimed: Option<usize>,
    /// How many labels there are.
    labels: usize,
}

/// True if these are the first bytes of a TRC file.
pub(super) fn begins(head: &[u8]) -> bool {
    Lines::new(head).next_filled(b'\t').is_some_and(|line| line.text.trim_ascii_start().starts_with(FIRST_WORD))
}

impl Header {
    /// Reads everything before the first row.
    ///
    /// # Errors
    /// A line is missing, or labels cannot be told to columns.
    pub fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        let mut lines = Lines::new(bytes);
        let first = lines.next_filled(b'\t').filter(|l| l.text.trim_ascii_start().starts_with(FIRST_WORD));
        let Some(first) = first else {
            let text = "the file does not begin with PathFileType, as every TRC file does; rename it after its content, or export it again";
            return Err(FormatError::malformed(NAME, Place::Line { line: 1, column: None }, text));
        };
        let separator = match first.text.trim_ascii_start().get(FIRST_WORD.len()) {
            Some(&b) if matches!(b, b',' | b';') => b,
            _ => b'\t',
        };
        let keys = lines.next_filled(separator).ok_or_else(|| ends(&lines, "the line with DataRate, NumFrames, NumMarkers, Units, ..."))?;
        if !known_keys(keys, separator) {
            return Err(unexpected(keys, "the names DataRate, CameraRate, NumFrames, NumMarkers, Units, ..."));
        }
        let values = lines.next_filled(separator).ok_or_else(|| ends(&lines, "the line with the values of DataRate, NumFrames, ..."))?;
        let stated = pairs(&words(keys, separator), &words(values, separator));
        let value = |key: &str| stated.iter().find(|(k, _)| k.eq_ignore_ascii_case(key)).map(|(_, v)| v.as_str()).filter(|v| !v.is_empty());
        let rate = |key: &str| value(key).and_then(decimal).filter(|r| *r > 0.0);

        let head = lines.next_filled(separator).ok_or_else(|| ends(&lines, "the line with Frame#, Time and the labels"))?;
        let cells = head.cells(separator);
        let starts = |at: usize, word: &str| cells.get(at).is_some_and(|c| c.to_ascii_lowercase().starts_with(word));
        if !starts(0, "frame") || !starts(1, "time") {
            return Err(unexpected(head, "Frame#, Time and the labels of the markers"));
        }
        let axes = read_axes(&mut lines, separator)?;
        let (start, line) = first_row(&lines, separator);

        let claimed = value("NumMarkers").and_then(|v| v.parse::<usize>().ok());
        let labels = Labels::read(cells.get(BEFORE_MARKERS..).unwrap_or_default(), axes);
        let count = Count { labels: labels.names.len(), claimed, axes };
        let widest = || widest_row(Lines::resume(bytes, (start, line)), separator).saturating_sub(BEFORE_MARKERS);
        let markers = count.decide(widest);
        if markers != count.labels && !labels.in_place {
            let text = format!(
                "{} labels stand side by side, but there seem to be {markers} markers, so nobody can tell whose labels they are; write each \
                 label above its X column, or correct NumMarkers",
                count.labels
            );
            return Err(FormatError::malformed(NAME, Place::Line { line: head.number, column: None }, text));
        }
        let mut columns = vec![Column::Frame, Column::Time];
        columns.extend((0..markers).flat_map(|marker| (0..3).map(move |axis| Column::Coordinate { marker, axis })));
        let name = |at: usize| Marker::new(labels.names.get(at).cloned().unwrap_or_default());
        let unit_written = value("Units").map(str::to_owned);
        Ok(Self {
            sheet: Sheet { separator, columns, nameless_tail: 0, time_unit_secs: Some(1.0), start, line },
            markers: (0..markers).map(name).collect(),
            rate_hz: rate("DataRate"),
            camera_rate_hz: rate("CameraRate"),
            frames: value("NumFrames").and_then(|v| v.parse().ok()),
            unit: unit_written.as_deref().and_then(Unit::parse),
            unit_written,
            others: labels.names.iter().skip(markers).filter(|n| !n.is_empty()).cloned().collect(),
            claimed,
            labels: count.labels,
        })
    }

    /// Notes what the header contradicts itself in.
    pub fn tell(&self, notes: &Notes) {
        let columns = self.markers.len();
        if let Some(claimed) = self.claimed.filter(|&claimed| claimed != columns) {
            notes.add(Note::Contradiction { text: format!("NumMarkers is {claimed}, but there are {columns} markers") });
        }
        if self.labels < columns {
            notes.add(Note::LabelCount { labels: self.labels, columns });
        }
    }
}

/// The numbers of markers that a header gives.
#[derive(Clone, Copy, Debug)]
struct Count {
    labels: usize,
    claimed: Option<usize>,
    axes: Option<usize>,
}

impl Count {
    /// How many markers there are. `widest` is the number of coordinates of the longest row, which is looked up only if it matters.
    fn decide(self, widest: impl FnOnce() -> usize) -> usize {
        let Self { labels, claimed, axes } = self;
        let others = [claimed, axes];
        if others.into_iter().flatten().all(|n| n == labels) {
            return labels;
        }
        let widest = widest();
        let more = others.into_iter().flatten().max().unwrap_or(0);
        if more > labels {
            // markers without a name, if there are cells for them; else a count that is wrong
            return labels.max(more.min(widest.div_ceil(3)));
        }
        match (claimed, axes) {
            // something else stands behind the markers, and has a name
            (Some(a), Some(b)) if a == b => a,
            (None, Some(axes)) => axes,
            (Some(claimed), None) if (3 * labels).saturating_sub(2) <= widest && widest < 3 * labels => claimed,
            _ => labels,
        }
    }
}

/// The labels of the markers.
struct Labels {
    names: Vec<String>,
    /// True if each stands above its own columns, so that one that is missing moves no other.
    in_place: bool,
}

impl Labels {
    /// Reads the cells behind `Time`. `axes` is the number of markers that have heads for their coordinates.
    fn read(cells: &[String], axes: Option<usize>) -> Self {
        let filled = || cells.iter().enumerate().filter(|(_, c)| !c.is_empty());
        if filled().all(|(at, _)| at % 3 == 0) {
            let count = filled().next_back().map_or(0, |(at, _)| at / 3 + 1);
            return Self { names: cells.iter().step_by(3).take(count).cloned().collect(), in_place: true };
        }
        let all: Vec<&String> = filled().map(|(_, c)| c).collect();
        // the same label above each of its three columns
        let triples = axes.is_some_and(|n| all.len() == 3 * n) && all.chunks_exact(3).all(|c| c.iter().all(|l| Some(l) == c.first()));
        let names = all.into_iter().step_by(if triples { 3 } else { 1 }).cloned().collect();
        Self { names, in_place: triples }
    }
}

/// Reads the line `X1 Y1 Z1 X2 ...`, if there is one: for how many markers.
fn read_axes(lines: &mut Lines<'_>, separator: u8) -> Result<Option<usize>, FormatError> {
    let mut ahead = lines.clone();
    let Some(line) = ahead.next_filled(separator) else { return Ok(None) };
    let cells = line.cells(separator);
    // a row begins with the number of its frame
    if cells.iter().take(BEFORE_MARKERS).any(|c| !c.is_empty()) {
        return Ok(None);
    }
    *lines = ahead;
    let axis = |cell: &String| cell.bytes().next().map(|b| b.to_ascii_lowercase());
    let coordinates = cells.get(BEFORE_MARKERS..).unwrap_or_default();
    let count = coordinates.chunks_exact(3).take_while(|c| c.iter().map(axis).eq([Some(b'x'), Some(b'y'), Some(b'z')])).count();
    if count == 0 {
        return Err(unexpected(line, "X1, Y1, Z1, X2, ... above the coordinates"));
    }
    Ok(Some(count))
}

/// Offset and number of the first line with something in it.
fn first_row(lines: &Lines<'_>, separator: u8) -> (usize, u64) {
    let mut ahead = lines.clone();
    ahead.next_filled(separator).map_or_else(|| lines.place(), |line| (line.start, line.number))
}

/// The number of cells of the longest row; blank ones at the end do not count.
fn widest_row(rows: Lines<'_>, separator: u8) -> usize {
    let filled = |text: &[u8]| text.iter().rposition(|&b| b != separator && b != b' ').map_or(0, |last| last + 1);
    rows.map(|line| {
        let cells = line.text.get(..filled(line.text)).unwrap_or_default();
        if cells.is_empty() { 0 } else { cells.split(|&b| b == separator).count() }
    })
    .max()
    .unwrap_or(0)
}

/// The cells of a line of keys or values; words, if there are no separators in it.
fn words(line: Line<'_>, separator: u8) -> Vec<String> {
    let cells = line.cells(separator);
    if cells.iter().filter(|c| !c.is_empty()).count() > 1 {
        return cells;
    }
    cells.iter().flat_map(|c| c.split_ascii_whitespace()).map(str::to_owned).collect()
}

/// Brings keys and values together: by their columns, or, where some program padded the lines with separators, by their order.
fn pairs(keys: &[String], values: &[String]) -> Vec<(String, String)> {
    let filled = |cells: &[String]| cells.iter().filter(|c| !c.is_empty()).cloned().collect::<Vec<_>>();
    let width = |cells: &[String]| cells.iter().rposition(|c| !c.is_empty()).map_or(0, |last| last + 1);
    if width(values) <= width(keys) {
        return keys.iter().cloned().zip(values.iter().cloned()).collect();
    }
    filled(keys).into_iter().zip(filled(values)).collect()
}

/// True if the line names something that a TRC file states.
fn known_keys(line: Line<'_>, separator: u8) -> bool {
    let known = ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"];
    words(line, separator).iter().any(|w| known.iter().any(|k| w.eq_ignore_ascii_case(k)))
}

fn ends(lines: &Lines<'_>, expected: &str) -> FormatError {
    let (_, line) = lines.place();
    let text = format!("the file ends inside its header, expected {expected}; export the take again");
    FormatError::malformed(NAME, Place::Line { line, column: None }, text)
}

fn unexpected(line: Line<'_>, expected: &str) -> FormatError {
    let found = excerpt(&crate::text::lines::word(line.text));
    let text = format!("found \"{found}\", expected {expected}; put the header right, or export the take again");
    FormatError::malformed(NAME, Place::Line { line: line.number, column: None }, text)
}
