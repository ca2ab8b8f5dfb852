//! The lines of a header: keys, values and names, before the rows begin.
//!
//! Headers are short, so here everything is copied into strings; rows go through [`super::scan`].

use super::scan::{Cell, Scanner, decode};

/// A line of a file, without its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line<'a> {
    /// What stands in it.
    pub text: &'a [u8],
    /// Offset of its first byte.
    pub start: usize,
    /// Its number, counted from 1.
    pub number: u64,
}

impl Line<'_> {
    /// True if there is nothing in the line but blanks and separators.
    pub fn is_blank(&self, separator: u8) -> bool {
        self.text.iter().all(|&b| b == separator || b == b' ' || b == b'\t')
    }

    /// The cells of the line. Between tabs, quotes are letters like others, because no program that separates by tabs quotes labels.
    pub fn cells(&self, separator: u8) -> Vec<String> {
        if separator == b'\t' {
            return self.text.split(|&b| b == separator).map(word).collect();
        }
        let mut scanner = Scanner::resume(self.text, separator, 0, self.number);
        let mut cells = Vec::new();
        while let Ok(cell) = scanner.cell() {
            cells.push(decode(&cell));
            if cell.ends_row {
                break;
            }
        }
        cells
    }
}

/// Text as a person reads it, without blanks around it.
pub(crate) fn word(text: &[u8]) -> String {
    decode(&Cell { text: text.trim_ascii(), start: 0, quoted: false, ends_row: false })
}

/// Walks over the lines of a file.
#[derive(Clone, Debug)]
pub(crate) struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    number: u64,
}

impl<'a> Lines<'a> {
    /// Begins at the first byte, behind a UTF-8 byte order mark if there is one.
    pub fn new(bytes: &'a [u8]) -> Self {
        let at = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        Self { bytes, at, number: 1 }
    }

    /// Begins at an offset, which is the start of the line of that number.
    pub fn resume(bytes: &'a [u8], (at, number): (usize, u64)) -> Self {
        Self { bytes, at, number }
    }

    /// Offset and number of the next line.
    pub fn place(&self) -> (usize, u64) {
        (self.at, self.number)
    }

    /// The next line with something in it besides blanks and separators. Stays where it is if there is none.
    pub fn next_filled(&mut self, separator: u8) -> Option<Line<'a>> {
        let mut ahead = self.clone();
        let line = ahead.find(|line| !line.is_blank(separator))?;
        *self = ahead;
        Some(line)
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        let rest = self.bytes.get(self.at..).filter(|rest| !rest.is_empty())?;
        let len = rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(rest.len());
        let line = Line { text: rest.get(..len).unwrap_or_default(), start: self.at, number: self.number };
        let end = match rest.get(len..) {
            Some([b'\r', b'\n', ..]) => 2,
            Some([]) | None => 0,
            Some(_) => 1,
        };
        self.at += len + end;
        self.number += 1;
        Some(line)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn lines_of_every_end() {
        let text = b"\xef\xbb\xbfa\tb\r\nc\r\n\n\t \nd\re";
        let found: Vec<(usize, u64, String)> = Lines::new(text).map(|l| (l.start, l.number, word(l.text))).collect();
        let expected = [(3, 1, "a\tb"), (8, 2, "c"), (11, 3, ""), (12, 4, ""), (15, 5, "d"), (17, 6, "e")];
        assert_eq!(found, expected.map(|(start, number, text)| (start, number, text.to_owned())));
        let mut lines = Lines::new(text);
        let filled: Vec<u64> = std::iter::from_fn(|| lines.next_filled(b'\t')).map(|l| l.number).collect();
        assert_eq!(filled, [1, 2, 5, 6]);
    }

    #[test]
    fn cells_of_a_line() {
        let cells = |text: &[u8], separator| Line { text, start: 0, number: 1 }.cells(separator);
        assert_eq!(cells(b"a\t \"b\t\t c ", b'\t'), ["a", "\"b", "", "c"]);
        assert_eq!(cells(b"a,\"b,c\",", b','), ["a", "b,c", ""]);
        assert_eq!(cells(b"J\xf6rg", b'\t'), ["Jörg"]);
    }
}
