//! A table without a header line: numbers only, three columns for each marker.
//!
//! | columns | are |
//! | --- | --- |
//! | 3 n | the coordinates of n markers |
//! | 3 n + 1 | a frame number or a time before them |
//! | 3 n + 2 | a frame number, and a time or a sub frame that is always 0 |
//!
//! Frame numbers go up by one, times by a constant step; otherwise what the first columns are cannot be told, and the table is refused.

use super::NAME;
use super::header::{Header, Shape};
use crate::text::number::decimal;
use crate::text::scan::{Scanner, decode, first_lines, likely_separator};
use crate::text::{Column, Sheet};
use crate::{FormatError, Marker, Place};

/// How many rows are looked at.
const ROWS: usize = 1000;
/// Steps of a time differ from their mean by at most this part of it, because times are rounded.
const UNEVEN: f64 = 0.1;

/// True if the first line that is not empty holds numbers and nothing else.
pub(super) fn is_bare(bytes: &[u8]) -> bool {
    let numeric = |text: &str| decimal(text).is_some();
    let lines = first_lines(bytes, 1);
    let cells: Vec<&String> = lines.first().into_iter().flatten().filter(|c| !c.is_empty()).collect();
    cells.iter().filter(|c| numeric(c)).count() >= 2 && cells.iter().all(|c| numeric(c) || c.eq_ignore_ascii_case("nan"))
}

/// The header that such a table would have; markers are called `M1`, `M2`, ...
///
/// # Errors
/// The number of columns, or what the first of them hold, does not fit.
pub(super) fn read(bytes: &[u8]) -> Result<Header, FormatError> {
    let separator = likely_separator(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes));
    let mut scanner = Scanner::new(bytes, separator);
    scanner.skip_blank_lines();
    let (start, line) = (scanner.offset(), scanner.line());
    let seen = Beginning::read(scanner)?;
    let refuse = |why: &str| {
        let text = format!("the file has no header line, and {why}; add one: NAME-x, NAME-y, NAME-z, ...");
        Err(FormatError::unsupported(NAME, Place::Line { line, column: None }, text))
    };
    let coordinates = |columns: usize| (0..columns / 3).flat_map(|marker| (0..3).map(move |axis| Column::Coordinate { marker, axis }));
    let columns = seen.columns;
    let (lead, what): (&[Column], _) = match columns % 3 {
        0 if seen.rows > 2 && seen.counts_frames() => {
            return refuse("its first column counts frames, but three for each marker do not remain");
        }
        0 => (&[], String::new()),
        1 if seen.counts_frames() => (&[Column::Frame], "a frame number and ".to_owned()),
        1 if seen.first.is_even() => (&[Column::Time], "a time and ".to_owned()),
        2 if seen.counts_frames() && seen.second.is_zero() => {
            (&[Column::Frame, Column::Other], "a frame number, a sub frame and ".to_owned())
        }
        2 if seen.counts_frames() && seen.second.is_even() => (&[Column::Frame, Column::Time], "a frame number, a time and ".to_owned()),
        _ => {
            return refuse(&format!(
                "its {columns} columns are not three for each marker, with or without a frame number and a time before them"
            ));
        }
    };
    let markers = columns / 3;
    Ok(Header {
        sheet: Sheet {
            separator,
            columns: lead.iter().copied().chain(coordinates(columns - lead.len())).collect(),
            nameless_tail: 0,
            time_unit_secs: None,
            start,
            line,
        },
        shape: Shape::Wide,
        markers: (1..=markers).map(|number| Marker::new(format!("M{number}"))).collect(),
        unit: None,
        units_differ: false,
        others: Vec::new(),
        odd_order: None,
        assumed: Some(format!(
            "the file has no header line: its {columns} columns were taken as {what}x, y, z of {markers} markers, called M1 to M{markers}"
        )),
    })
}

/// What the first rows show.
struct Beginning {
    /// Columns, without one at the end that is always empty and stands alone.
    columns: usize,
    rows: usize,
    first: Lead,
    second: Lead,
}

impl Beginning {
    fn read(mut scanner: Scanner<'_>) -> Result<Self, FormatError> {
        let mut seen = Self { columns: 0, rows: 0, first: Lead::default(), second: Lead::default() };
        // A column that is always empty ends rows that end with a separator; but a marker that is never seen has three of them.
        let (mut last_is_empty, mut before_is_empty) = (true, true);
        while seen.rows < ROWS && !scanner.at_end() {
            let (mut cells, mut blank, mut before) = (0usize, true, true);
            let (mut first, mut second) = (None, None);
            loop {
                let cell = scanner.cell()?;
                blank &= cell.is_blank();
                if cells < 2 {
                    let value = decode(&cell).trim().replace(',', ".").parse::<f64>().ok();
                    *(if cells == 0 { &mut first } else { &mut second }) = value;
                }
                cells += 1;
                if cell.ends_row {
                    if !blank {
                        last_is_empty &= cell.is_blank();
                        before_is_empty &= before;
                    }
                    break;
                }
                before = cell.is_blank();
            }
            if blank {
                break;
            }
            if seen.rows == 0 {
                seen.columns = cells;
            }
            seen.first.add(first);
            seen.second.add(second);
            seen.rows += 1;
        }
        seen.columns -= usize::from(last_is_empty && !before_is_empty);
        Ok(seen)
    }

    fn counts_frames(&self) -> bool {
        self.first.goes_up_by_one()
    }
}

/// The values of one of the first columns.
#[derive(Default)]
struct Lead(Vec<Option<f64>>);

impl Lead {
    fn add(&mut self, value: Option<f64>) {
        self.0.push(value);
    }

    fn steps(&self) -> impl Iterator<Item = f64> {
        self.0.iter().zip(self.0.iter().skip(1)).map(|(a, b)| b.unwrap_or(f64::NAN) - a.unwrap_or(f64::NAN))
    }

    /// True for at least two whole numbers, each larger by one than that before.
    fn goes_up_by_one(&self) -> bool {
        self.0.len() > 1 && self.0.iter().all(|v| v.is_some_and(|v| v.fract() == 0.0)) && self.steps().all(|step| step == 1.0)
    }

    /// True for at least three numbers that go up by the same step, as far as rounded times do.
    fn is_even(&self) -> bool {
        let (Some(Some(first)), Some(Some(last))) = (self.0.first(), self.0.last()) else { return false };
        let mean = (last - first) / (self.0.len() as f64 - 1.0);
        self.0.len() > 2 && mean > 0.0 && self.steps().all(|step| (step - mean).abs() <= UNEVEN * mean)
    }

    fn is_zero(&self) -> bool {
        self.0.iter().all(|v| *v == Some(0.0))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn columns_by_their_number_and_what_the_first_hold() {
        let note = |what: &str| format!("the file has no header line: its {what} markers, called M1 to M");
        for (text, expected) in [
            ("1,2,3\n4,5,6\n", note("3 columns were taken as x, y, z of 1") + "1"),
            ("1.5,2,3,NaN,,\n", note("6 columns were taken as x, y, z of 2") + "2"),
            ("1,2,3,\n4,5,6,\n", note("3 columns were taken as x, y, z of 1") + "1"),
            ("1,0,1,2,3,\n2,0,1,2,3,\n3,0,1,2,3,\n", note("5 columns were taken as a frame number, a sub frame and x, y, z of 1") + "1"),
            ("7,0,1,2,3,,,\n8,0,1,2,3,,,\n", note("8 columns were taken as a frame number, a sub frame and x, y, z of 2") + "2"),
            ("1.0,2,3,\n1.1,5,6,\n1.2,5,6,\n", note("3 columns were taken as x, y, z of 1") + "1"),
            ("1;1,5;2;3\n2;1,5;2;3\n", note("4 columns were taken as a frame number and x, y, z of 1") + "1"),
            ("0.00\t1\t2\t3\n0.01\t1\t2\t3\n0.02\t1\t2\t3\n", note("4 columns were taken as a time and x, y, z of 1") + "1"),
            ("7,0,1,2,3\n8,0,1,2,3\n", note("5 columns were taken as a frame number, a sub frame and x, y, z of 1") + "1"),
            ("7,0.0,1,2,3\n8,0.1,1,2,3\n9,0.2,1,2,3\n", note("5 columns were taken as a frame number, a time and x, y, z of 1") + "1"),
        ] {
            assert!(is_bare(text.as_bytes()), "{text}");
            assert_eq!(read(text.as_bytes()).unwrap().assumed.unwrap(), expected, "{text}");
        }
    }

    #[test]
    fn what_cannot_be_told() {
        for (text, expected) in [
            ("1,2,3,4\n", "its 4 columns are not three for each marker, with or without a frame number and a time before them"),
            (
                "1,5,2,3,4\n2,7,2,3,4\n3,1,2,3,4\n",
                "its 5 columns are not three for each marker, with or without a frame number and a time before them",
            ),
            ("1,5,2\n2,7,2\n3,1,2\n", "its first column counts frames, but three for each marker do not remain"),
        ] {
            let expected = format!("text: the file has no header line, and {expected}; add one: NAME-x, NAME-y, NAME-z, ... (line 1)");
            assert_eq!(read(text.as_bytes()).err().unwrap().to_string().replace("csv:", "text:"), expected, "{text}");
        }
        for text in ["A,1,2\n", "\n", "1\n2\n", "NaN,NaN\n"] {
            assert!(!is_bare(text.as_bytes()), "{text}");
        }
    }
}
