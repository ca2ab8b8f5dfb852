//! Finds out from the header line what each column holds.
//!
//! Two shapes with one header line are known here, others in `stacked` (two header lines) and `bare` (none):
//!
//! | shape | header | a row is |
//! | --- | --- | --- |
//! | wide | `NAME-x,NAME-y,NAME-z,...` | a frame |
//! | long | `frame,marker,x,y,z` | a marker in a frame |
//!
//! The separator is the one under which the header makes most sense.
//! What is not understood is a column of its own right ([`Column::Other`]) and never touched.

use super::NAME;
use super::{bare, foreign, stacked};
use crate::text::scan::{Scanner, decode, excerpt, likely_separator};
use crate::text::titles::is_model_output;
use crate::text::{Column, Sheet};
use crate::{FormatError, Marker, Place, Role, Unit};
use std::collections::BTreeMap;

/// Separators, in the order in which they are tried.
pub(super) const SEPARATORS: [u8; 3] = [b',', b';', b'\t'];

/// The two shapes of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// A row is a frame.
    Wide,
    /// A row is a marker in a frame.
    Long,
}

/// The header line, understood.
#[derive(Clone, Debug)]
pub(super) struct Header {
    /// Where the rows are, and what each column holds.
    pub sheet: Sheet,
    /// Wide or long.
    pub shape: Shape,
    /// The markers of a wide table, in the order of their first column; empty for a long one.
    pub markers: Vec<Marker>,
    /// The unit of length, if the header states it.
    pub unit: Option<Unit>,
    /// True if the header states different units for different columns.
    pub units_differ: bool,
    /// Names of the columns that are nothing of ours.
    pub others: Vec<String>,
    /// The order of the coordinates, if all markers have the same and it is not x, y, z.
    pub odd_order: Option<[usize; 3]>,
    /// What was assumed about the columns, if there is no header.
    pub assumed: Option<String>,
}

impl Header {
    /// How many columns the header gives a meaning to.
    fn understood(&self) -> usize {
        self.sheet.columns.iter().filter(|c| **c != Column::Other).count()
    }

    /// Understands the first line that is not empty, or two of them, or none.
    ///
    /// # Errors
    /// The table is of a flavour that we do not read, or of none that we know.
    pub fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        if let Some(found) = foreign::recognise(bytes) {
            return Err(found.refuse());
        }
        if bare::is_bare(bytes) {
            return bare::read(bytes);
        }
        if let Some(header) = stacked::read(bytes) {
            return Ok(header);
        }
        let mut best: Option<Self> = None;
        for separator in SEPARATORS {
            if let Some(header) = Self::with_separator(bytes, separator, true)?
                && best.as_ref().is_none_or(|b| header.understood() > b.understood())
            {
                best = Some(header);
            }
        }
        best.ok_or_else(|| {
            let mut scanner = Scanner::new(bytes, likely_separator(bytes));
            scanner.skip_blank_lines();
            let place = Place::Line { line: scanner.line(), column: None };
            let names = names(&mut scanner, true).unwrap_or_default();
            let seen: Vec<String> = names.iter().take(4).map(|n| format!("\"{}\"", excerpt(n))).collect();
            let more = if names.len() > seen.len() { ", ..." } else { "" };
            let text = format!(
                "the header names no markers: found {}{more}; expected NAME-x, NAME-y, NAME-z for each marker, or frame, marker, x, y, z; \
                 rename the columns",
                seen.join(", ")
            );
            FormatError::unsupported(NAME, place, text)
        })
    }

    /// True if the first line looks like a header of ours. The line may be cut off where `head` ends.
    pub fn likely(head: &[u8]) -> bool {
        stacked::read(head).is_some()
            || SEPARATORS.iter().any(|&separator| matches!(Self::with_separator(head, separator, false), Ok(Some(_))))
    }

    fn with_separator(bytes: &[u8], separator: u8, whole: bool) -> Result<Option<Self>, FormatError> {
        let mut scanner = Scanner::new(bytes, separator);
        scanner.skip_blank_lines();
        let line = scanner.line();
        // Quotes may be none under the wrong separator; the caller finds out that nothing fits.
        let Ok(names) = names(&mut scanner, whole) else { return Ok(None) };
        let (start, next_line) = (scanner.offset(), scanner.line());
        let parsed: Vec<Name> = names.iter().map(|n| Name::parse(n)).collect();
        let draft = Self {
            sheet: Sheet {
                separator,
                columns: vec![Column::Other; names.len()],
                nameless_tail: names.iter().rev().take_while(|n| n.is_empty()).count(),
                time_unit_secs: None,
                start,
                line: next_line,
            },
            shape: Shape::Wide,
            markers: Vec::new(),
            unit: None,
            units_differ: false,
            others: Vec::new(),
            odd_order: None,
            assumed: None,
        };
        if let Some(header) = draft.clone().long(&names, &parsed) {
            return Ok(Some(header));
        }
        draft.wide(&names, &parsed, line, whole)
    }

    /// The header of a long table, if frame, marker, x, y and z are there.
    fn long(mut self, names: &[String], parsed: &[Name<'_>]) -> Option<Self> {
        self.shape = Shape::Long;
        let label = parsed.iter().position(|n| matches!(n, Name::Label))?;
        self.set(label, Column::Label);
        self.frame_and_time(parsed);
        if !self.sheet.has(Column::Frame) {
            return None;
        }
        for axis in 0..3 {
            let column = parsed.iter().position(|n| match n {
                Name::Coordinate { base, axis: a, length, .. } => *a == axis && *length != Length::Not && is_position_word(base),
                _ => false,
            })?;
            self.set(column, Column::Coordinate { marker: 0, axis });
        }
        self.finish(names, parsed);
        Some(self)
    }

    /// The header of a wide table, if at least one marker has all three coordinates.
    fn wide(mut self, names: &[String], parsed: &[Name<'_>], line: u64, whole: bool) -> Result<Option<Self>, FormatError> {
        /// Columns of the coordinates of all markers that share a label.
        type Columns = [Vec<usize>; 3];
        let mut labels: BTreeMap<(&str, char), Columns> = BTreeMap::new();
        for (column, name) in parsed.iter().enumerate() {
            if let Name::Coordinate { base, mark: Some(mark), axis, length } = name
                && *length != Length::Not
                && let Some(list) = labels.entry((base, *mark)).or_default().get_mut(*axis)
            {
                list.push(column);
            }
        }
        let mut triples: Vec<([usize; 3], &str)> = Vec::new();
        for ((base, _), [x, y, z]) in &labels {
            if x.len() != y.len() || y.len() != z.len() {
                let least = x.len().min(y.len()).min(z.len());
                if least > 0 && whole {
                    let text = format!(
                        "\"{}\" has {} columns for x, {} for y and {} for z; which belong together cannot be told, rename them",
                        excerpt(base),
                        x.len(),
                        y.len(),
                        z.len()
                    );
                    return Err(FormatError::malformed(NAME, Place::Line { line, column: None }, text));
                }
                if least == 0 {
                    continue; // a lone "temperature_x" is some other column
                }
            }
            triples.extend(x.iter().zip(y).zip(z).map(|((&x, &y), &z)| ([x, y, z], *base)));
        }
        if triples.is_empty() {
            return Ok(None);
        }
        triples.sort_by_key(|(columns, _)| columns.iter().copied().min());
        for (marker, (columns, base)) in triples.iter().enumerate() {
            // a stated unit of length says more than a name
            let is_length = columns.iter().all(|&c| matches!(parsed.get(c), Some(Name::Coordinate { length: Length::Stated(_), .. })));
            let role = if !is_length && is_model_output(base) { Role::ModelOutput } else { Role::Marker };
            self.markers.push(Marker { label: (*base).to_owned(), role });
            for (axis, &column) in columns.iter().enumerate() {
                self.set(column, Column::Coordinate { marker, axis });
            }
        }
        let orders: Vec<[usize; 3]> = triples
            .iter()
            .map(|(columns, _)| {
                let mut order = [0, 1, 2];
                order.sort_by_key(|&axis| columns.get(axis).copied());
                order
            })
            .collect();
        self.odd_order = orders.first().copied().filter(|first| *first != [0, 1, 2] && orders.iter().all(|o| o == first));
        self.frame_and_time(parsed);
        self.finish(names, parsed);
        Ok(Some(self))
    }

    fn set(&mut self, at: usize, column: Column) {
        if let Some(c) = self.sheet.columns.get_mut(at) {
            *c = column;
        }
    }

    /// The first frame column and the first time column count, others of the kind are others.
    fn frame_and_time(&mut self, parsed: &[Name<'_>]) {
        if let Some(frame) = parsed.iter().position(|n| matches!(n, Name::Frame)) {
            self.set(frame, Column::Frame);
        }
        if let Some((time, unit_secs)) = parsed.iter().enumerate().find_map(|(i, n)| match n {
            Name::Time { unit_secs } => Some((i, *unit_secs)),
            _ => None,
        }) {
            self.set(time, Column::Time);
            self.sheet.time_unit_secs = unit_secs;
        }
    }

    /// Gathers the stated units and the names of other columns.
    fn finish(&mut self, names: &[String], parsed: &[Name<'_>]) {
        for ((column, name), parsed) in self.sheet.columns.iter().zip(names).zip(parsed) {
            match (column, parsed) {
                (Column::Coordinate { .. }, Name::Coordinate { length: Length::Stated(unit), .. }) => {
                    self.units_differ |= self.unit.is_some_and(|u| u != *unit);
                    self.unit = self.unit.or(Some(*unit));
                }
                (Column::Other, _) if !name.is_empty() => self.others.push(name.clone()),
                _ => {}
            }
        }
    }
}

/// Cells of one line. If the line may be cut off (`whole` is false), a last cell without an end is left out.
fn names(scanner: &mut Scanner<'_>, whole: bool) -> Result<Vec<String>, FormatError> {
    let mut names = Vec::new();
    loop {
        let cell = scanner.cell()?;
        let mut name = decode(&cell);
        if names.is_empty() && !cell.quoted {
            // numpy puts a comment sign before its header
            if let Some(rest) = name.strip_prefix('#').map(str::trim_start).filter(|r| !r.is_empty()) {
                name = String::from(rest);
            }
        }
        let cut = cell.ends_row && scanner.in_open_line();
        if !cut || whole {
            names.push(name);
        }
        if cell.ends_row {
            return Ok(names);
        }
    }
}

/// A column's name, taken apart.
#[derive(Debug, PartialEq)]
pub(super) enum Name<'a> {
    /// A frame number.
    Frame,
    /// A time.
    Time {
        /// How many seconds one unit is, if the name states it.
        unit_secs: Option<f64>,
    },
    /// A marker's label.
    Label,
    /// `base` `mark` `x|y|z` `(unit)`
    Coordinate {
        base: &'a str,
        /// The sign between label and axis; `None` for a bare `x`.
        mark: Option<char>,
        axis: usize,
        length: Length,
    },
    Other,
}

/// What a column's name says about its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Length {
    /// Nothing.
    Unstated,
    /// A unit of length.
    Stated(Unit),
    /// Something else, such as `(deg)`.
    Not,
}

impl<'a> Name<'a> {
    /// Takes a name apart.
    pub fn parse(name: &'a str) -> Self {
        let (stem, bracketed) = split_bracket(name);
        let length = match bracketed {
            None => Length::Unstated,
            Some(unit) => Unit::parse(unit).map_or(Length::Not, Length::Stated),
        };
        if let Some((base, mark, axis)) = split_axis(stem) {
            return Self::Coordinate { base, mark, axis, length };
        }
        // NAME_x_mm
        if let (None, Some((rest, unit))) = (bracketed, stem.rsplit_once('_')) {
            let unit = Unit::ALL.into_iter().find(|u| u.symbol() == unit);
            if let (Some(unit), Some((base, mark, axis))) = (unit, split_axis(rest)) {
                return Self::Coordinate { base, mark, axis, length: Length::Stated(unit) };
            }
        }
        Self::word(stem, bracketed).unwrap_or(Self::Other)
    }

    /// Frame, time and label columns.
    fn word(stem: &str, bracketed: Option<&str>) -> Option<Self> {
        if !stem.is_ascii() {
            return None;
        }
        let word: String = stem.chars().filter(char::is_ascii_alphanumeric).flat_map(char::to_lowercase).collect();
        let unit = |text: &str| match text.to_ascii_lowercase().as_str() {
            "s" | "sec" | "secs" | "second" | "seconds" => Some(1.0),
            "ms" | "msec" | "millisecond" | "milliseconds" => Some(1e-3),
            "us" | "µs" | "microsecond" | "microseconds" => Some(1e-6),
            _ => None,
        };
        match word.as_str() {
            "frame" | "frames" | "framenumber" | "frameno" | "framenr" | "framenum" | "frameindex" | "frameid" => Some(Self::Frame),
            "marker" | "markers" | "markername" | "markerlabel" | "label" | "name" | "point" | "pointname" | "landmark" | "trajectory" => {
                Some(Self::Label)
            }
            "time" | "times" | "timestamp" | "t" => match bracketed {
                None => Some(Self::Time { unit_secs: None }),
                Some(text) => unit(text.trim()).map(|secs| Self::Time { unit_secs: Some(secs) }),
            },
            "seconds" | "secs" | "sec" => Some(Self::Time { unit_secs: Some(1.0) }),
            _ => {
                unit(word.strip_prefix("timestamp").or_else(|| word.strip_prefix("time"))?).map(|secs| Self::Time { unit_secs: Some(secs) })
            }
        }
    }
}

/// `NAME-x (mm)` gives `NAME-x` and `mm`; round or square brackets.
fn split_bracket(name: &str) -> (&str, Option<&str>) {
    let open = match name.chars().last() {
        Some(')') => '(',
        Some(']') => '[',
        _ => return (name, None),
    };
    match name.rsplit_once(open) {
        Some((stem, unit)) => (stem.trim_end(), unit.get(..unit.len().saturating_sub(1))),
        None => (name, None),
    }
}

/// `NAME-x` gives `NAME`, `-` and 0; `x` gives an empty label without a mark.
fn split_axis(stem: &str) -> Option<(&str, Option<char>, usize)> {
    let mut chars = stem.chars();
    let axis = match chars.next_back()? {
        'x' | 'X' => 0,
        'y' | 'Y' => 1,
        'z' | 'Z' => 2,
        _ => return None,
    };
    match chars.next_back() {
        None => Some(("", None, axis)),
        Some(mark @ ('-' | '_' | '.' | ' ' | ':')) => Some((chars.as_str(), Some(mark), axis)),
        Some(_) => None,
    }
}

/// What may stand before x, y and z in a long table.
fn is_position_word(base: &str) -> bool {
    let words = ["", "pos", "position", "coord", "coordinate"];
    words.iter().any(|w| base.eq_ignore_ascii_case(w))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn labels(header: &str) -> Vec<String> {
        Header::read(header.as_bytes()).unwrap().markers.into_iter().map(|m| m.label).collect()
    }

    #[test]
    fn wide_headers_of_every_spelling() {
        for (header, expected) in [
            ("S:C7-x, S:C7-y, S:C7-z\n", &["S:C7"][..]),
            ("A_X\tA_Y\tA_Z\tB.x\tB.y\tB.z", &["A", "B"]),
            ("\u{feff}frame;time (s);A x;A y;A z;", &["A"]),
            ("# time,A.x,A.y,A.z", &["A"]),
            ("B-x,A-x,A-y,B-z,B-y,A-z", &["B", "A"]), // not side by side
            ("A-x (mm),A-y (mm),A-z (mm)", &["A"]),
            ("A-x[m],A-y[m],A-z[m]", &["A"]),
            ("A_x_mm,A_y_mm,A_z_mm", &["A"]),
            ("A-x,A-y,A-z,A-x,A-y,A-z", &["A", "A"]), // twice
            ("A-x,A-y,A-z,B-x,B-y,temperature", &["A"]),
            ("A-x,A-y,A-z,Knee-x (deg),Knee-y (deg),Knee-z (deg)", &["A"]),
            ("-x (mm),-y (mm),-z (mm)", &[""]),
            ("\"a,\"\"b\"\" (mm)-x (mm)\",\"a,\"\"b\"\" (mm)-y (mm)\",\"a,\"\"b\"\" (mm)-z (mm)\"", &["a,\"b\" (mm)"]),
            ("x-x,x-y,x-z,y-x,y-y,y-z", &["x", "y"]),
        ] {
            assert_eq!(labels(header), expected, "{header}");
        }
    }

    #[test]
    fn what_else_a_header_says() {
        let h = Header::read(b"Frame#,Time [ms],A-x (cm),A-y (cm),A-z (cm),force,\n").unwrap();
        assert_eq!(
            (h.shape, h.sheet.separator, h.unit, h.sheet.time_unit_secs, h.sheet.nameless_tail),
            (Shape::Wide, b',', Some(Unit::Centimetre), Some(1e-3), 1)
        );
        assert_eq!((h.sheet.has(Column::Frame), h.sheet.has(Column::Time), h.others), (true, true, vec!["force".to_owned()]));
        let h = Header::read(b"z;X;Y (mm);Marker Name;frame_number;note").unwrap();
        assert_eq!((h.shape, h.sheet.separator, h.unit, h.others), (Shape::Long, b';', Some(Unit::Millimetre), vec!["note".to_owned()]));
        let h = Header::read(b"A.z,A.x,A.y,B.z,B.x,B.y").unwrap();
        assert_eq!(h.odd_order, Some([2, 0, 1]));
        let h = Header::read(b"A-x,A-y,A-z,LKneeAngles-x,LKneeAngles-y,LKneeAngles-z").unwrap();
        assert_eq!(h.markers.iter().map(|m| m.role).collect::<Vec<_>>(), [Role::Marker, Role::ModelOutput]);
    }

    #[test]
    fn headers_of_nothing_we_know() {
        for (header, expected) in [
            (
                "a,b,c\n1,2,3\n",
                "csv: the header names no markers: found \"a\", \"b\", \"c\"; expected NAME-x, NAME-y, NAME-z for each marker, or frame, marker, \
                 x, y, z; rename the columns (line 1)",
            ),
            (
                "time,x,y,z,w\n",
                "csv: the header names no markers: found \"time\", \"x\", \"y\", \"z\", ...; expected NAME-x, NAME-y, NAME-z for each marker, \
                 or frame, marker, x, y, z; rename the columns (line 1)",
            ),
            (
                "A-x,A-y,A-z,A-x\n",
                "csv: \"A\" has 2 columns for x, 1 for y and 1 for z; which belong together cannot be told, rename them (line 1)",
            ),
        ] {
            assert_eq!(Header::read(header.as_bytes()).unwrap_err().to_string(), expected);
        }
    }

    #[test]
    fn a_head_may_be_cut_off() {
        assert!(Header::likely(b"A-x,A-y,A-z,B-"));
        assert!(Header::likely(b"A-x,A-y,A-z,A-"));
        assert!(!Header::likely(b"A-x,A-y,A"));
        assert!(!Header::likely(b"hello, world\n"));
    }
}
