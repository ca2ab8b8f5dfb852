//! Cuts the bytes of a table into cells, in one pass and without copying.
//!
//! It knows separators, quotes and line ends, and nothing of what cells mean.
//! Cells keep their place in the file, because a saved file is the opened one with some cells exchanged.
//!
//! | in the file | cell text |
//! | --- | --- |
//! | `a, b ,c` | `a` `b` `c`: blanks around a cell are not part of it |
//! | `"a; ""b"""` | `a; ""b""`: quotes begin a cell only at its start; doubled quotes stay doubled in [`Cell::text`] |
//! | `\n`, `\r\n`, `\r` | the end of a row, in any mixture |

use super::NAME;
use crate::{FormatError, Place};

/// How many cells of each line are looked at for a first impression.
const CELLS_OF_A_BEGINNING: usize = 64;

/// One cell of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cell<'a> {
    /// What the cell holds, without surrounding blanks and quotes.
    pub text: &'a [u8],
    /// Where [`Cell::text`] begins in the file. An empty cell begins where its number would be written: after its blanks.
    pub start: usize,
    /// True if the cell stands in quotes.
    pub quoted: bool,
    /// True if no other cell follows in this row.
    pub ends_row: bool,
}

impl Cell<'_> {
    /// True if there is nothing in the cell, not even a pair of quotes.
    pub fn is_blank(&self) -> bool {
        self.text.is_empty() && !self.quoted
    }
}

/// Walks over the cells of a file.
#[derive(Clone, Debug)]
pub(crate) struct Scanner<'a> {
    bytes: &'a [u8],
    at: usize,
    line: u64,
    separator: u8,
}

impl<'a> Scanner<'a> {
    /// Begins at the first byte, behind a UTF-8 byte order mark if there is one.
    pub fn new(bytes: &'a [u8], separator: u8) -> Self {
        let at = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        Self { bytes, at, line: 1, separator }
    }

    /// Begins at `offset`, which is the start of line number `line`.
    pub fn resume(bytes: &'a [u8], separator: u8, offset: usize, line: u64) -> Self {
        Self { bytes, at: offset, line, separator }
    }

    /// The line of the next cell, counted from 1.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// The offset of the next byte.
    pub fn offset(&self) -> usize {
        self.at
    }

    /// True if every byte has been seen. Only meaningful between rows.
    pub fn at_end(&self) -> bool {
        self.at >= self.bytes.len()
    }

    /// True at the end of a file that does not end its last line.
    pub fn in_open_line(&self) -> bool {
        self.at_end() && !matches!(self.bytes.last(), Some(b'\n' | b'\r'))
    }

    /// Steps over empty lines.
    pub fn skip_blank_lines(&mut self) {
        while !self.at_end() {
            let mut ahead = self.clone();
            let blank = ahead.rest().iter().take_while(|&&b| ahead.is_blank(b)).count();
            ahead.at += blank;
            match ahead.rest().first() {
                None | Some(b'\n' | b'\r') => _ = ahead.finish(ahead.at),
                Some(_) => return,
            }
            *self = ahead;
        }
    }

    /// The next cell. After one that ends its row comes the first of the next row.
    ///
    /// # Errors
    /// A quote that is never closed, or text behind a closing quote.
    pub fn cell(&mut self) -> Result<Cell<'a>, FormatError> {
        let rest = self.rest();
        let lead = rest.iter().take_while(|&&b| self.is_blank(b)).count();
        let start = self.at + lead;
        let body = rest.get(lead..).unwrap_or_default();
        if body.first() == Some(&b'"') {
            return self.quoted(start);
        }
        let separator = self.separator;
        let len = body.iter().position(|&b| b == separator || b == b'\n' || b == b'\r').unwrap_or(body.len());
        let text = body.get(..len).unwrap_or_default();
        let tail = text.iter().rev().take_while(|&&b| self.is_blank(b)).count();
        let text = text.get(..len - tail).unwrap_or_default();
        let ends_row = self.finish(start + len);
        Ok(Cell { text, start, quoted: false, ends_row })
    }

    /// The cell whose opening quote stands at `open`.
    fn quoted(&mut self, open: usize) -> Result<Cell<'a>, FormatError> {
        let start = open + 1;
        let mut close = start;
        loop {
            let Some(n) = self.bytes.get(close..).unwrap_or_default().iter().position(|&b| b == b'"') else {
                let text = "a quote is opened here and never closed; close it, or take it away";
                return Err(FormatError::malformed(NAME, Place::Line { line: self.line, column: None }, text));
            };
            close += n;
            if self.bytes.get(close + 1) != Some(&b'"') {
                break;
            }
            close += 2;
        }
        let text = self.bytes.get(start..close).unwrap_or_default();
        let mut before = 0;
        for &b in text {
            // "\r\n" is one line end, counted at its "\r"
            self.line += u64::from(b == b'\r' || (b == b'\n' && before != b'\r'));
            before = b;
        }
        let after = self.bytes.get(close + 1..).unwrap_or_default();
        let end = close + 1 + after.iter().take_while(|&&b| self.is_blank(b)).count();
        match self.bytes.get(end) {
            None | Some(b'\n' | b'\r') => {}
            Some(&b) if b == self.separator => {}
            Some(_) => {
                let text = "text follows a closing quote; double the quotes inside a quoted cell";
                return Err(FormatError::malformed(NAME, Place::Line { line: self.line, column: None }, text));
            }
        }
        let ends_row = self.finish(end);
        Ok(Cell { text, start, quoted: true, ends_row })
    }

    fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    fn is_blank(&self, b: u8) -> bool {
        b == b' ' || (b == b'\t' && self.separator != b'\t')
    }

    /// Steps over what ends a cell at `end`; true if that is the end of the row.
    fn finish(&mut self, end: usize) -> bool {
        match self.bytes.get(end) {
            Some(b'\r') => self.at = if self.bytes.get(end + 1) == Some(&b'\n') { end + 2 } else { end + 1 },
            Some(b'\n') => self.at = end + 1,
            Some(_) => {
                self.at = end + 1;
                return false;
            }
            None => {
                self.at = self.bytes.len();
                return true;
            }
        }
        self.line += 1;
        true
    }
}

/// Bytes as letters: UTF-8, or Latin-1 where they are not UTF-8.
pub(crate) fn letters(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        // Every byte is a character of Latin-1, so nothing is lost and different labels stay different.
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    }
}

/// The text of a cell as a person reads it: quotes undoubled, UTF-8, or Latin-1 where it is not UTF-8.
pub(crate) fn decode(cell: &Cell<'_>) -> String {
    let text = letters(cell.text);
    if cell.quoted { text.replace("\"\"", "\"") } else { text }
}

/// Text of a file as it is put into a message: short, and without control characters.
pub(crate) fn excerpt(text: &str) -> String {
    let mut short: String = text.chars().take(30).flat_map(char::escape_debug).collect();
    if text.chars().nth(30).is_some() {
        short.push('…');
    }
    short
}

/// The separator that the first line seems to have: tabs and semicolons are rare inside cells, commas may be decimal signs.
pub(crate) fn likely_separator(bytes: &[u8]) -> u8 {
    let line = bytes.split(|&b| b == b'\n' || b == b'\r').find(|l| !l.is_empty()).unwrap_or_default();
    [b'\t', b';'].into_iter().find(|separator| line.contains(separator)).unwrap_or(b',')
}

/// The first cells of the first `most` lines that are not empty, under the separator that seems right for each.
/// For a first look only: a quoted cell with a line end in it is two.
pub(crate) fn first_lines(bytes: &[u8], most: usize) -> Vec<Vec<String>> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    text.split(|&b| b == b'\n' || b == b'\r')
        .filter(|line| !line.trim_ascii().is_empty())
        .take(most)
        .map(|line| {
            let mut scanner = Scanner::new(line, likely_separator(line));
            let mut cells = Vec::new();
            while let Ok(cell) = scanner.cell() {
                cells.push(decode(&cell));
                if cell.ends_row || cells.len() >= CELLS_OF_A_BEGINNING {
                    break;
                }
            }
            cells
        })
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn rows(text: &[u8], separator: u8) -> Result<Vec<Vec<String>>, String> {
        let mut scanner = Scanner::new(text, separator);
        let mut rows = Vec::new();
        while !scanner.at_end() {
            let mut row = Vec::new();
            loop {
                let cell = scanner.cell().map_err(|e| e.to_string())?;
                row.push(decode(&cell));
                if cell.ends_row {
                    break;
                }
            }
            rows.push(row);
        }
        Ok(rows)
    }

    #[test]
    fn cells_of_every_shape() {
        for (text, separator, expected) in [
            ("a,b\nc,d\n", b',', vec![vec!["a", "b"], vec!["c", "d"]]),
            ("a, b ,\r\n,,", b',', vec![vec!["a", "b", ""], vec!["", "", ""]]),
            ("a\rb\r\nc\n\nd", b',', vec![vec!["a"], vec!["b"], vec!["c"], vec![""], vec!["d"]]),
            ("a\t b \t\tc", b'\t', vec![vec!["a", "b", "", "c"]]),
            ("\" a,\"\"b\" , \"\"\n5\",6", b',', vec![vec![" a,\"b", ""], vec!["5\"", "6"]]),
            ("\u{feff}\"a\nb\",c", b',', vec![vec!["a\nb", "c"]]),
            ("1,5;2", b';', vec![vec!["1,5", "2"]]),
        ] {
            assert_eq!(rows(text.as_bytes(), separator).unwrap(), expected, "{text:?}");
        }
        assert_eq!(rows(b"J\xf6rg,x", b',').unwrap(), [["Jörg", "x"]]);
    }

    #[test]
    fn quotes_that_make_no_sense() {
        for (text, expected) in [
            ("a\nb,\"c\n1,2\n", "text: a quote is opened here and never closed; close it, or take it away (line 2)"),
            ("\"a\nb\"c,d", "text: text follows a closing quote; double the quotes inside a quoted cell (line 2)"),
        ] {
            assert_eq!(rows(text.as_bytes(), b',').unwrap_err(), expected);
        }
    }

    #[test]
    fn text_lies_where_it_says() {
        let bytes = b"a,  12 ,\"NaN\",  ,\n";
        let mut scanner = Scanner::new(bytes, b',');
        let spans: Vec<_> = std::iter::from_fn(|| (!scanner.at_end()).then(|| scanner.cell().unwrap()))
            .map(|c| (c.start, c.text.len(), c.quoted))
            .collect();
        assert_eq!(spans, [(0, 1, false), (4, 2, false), (9, 3, true), (16, 0, false), (17, 0, false)]);
    }

    /// Another reader, of other people, sees the same cells.
    #[test]
    fn agrees_with_the_csv_crate() {
        let alphabet = [b'a', b'1', b',', b',', b'\n', b'"', b'.', b'\r'];
        let mut state = 0x2545_f491_4f6c_dd1d_u64;
        let mut compared = 0;
        for _ in 0..20_000 {
            let text: Vec<u8> = (0..12)
                .map(|_| {
                    state ^= state << 13;
                    state ^= state >> 7;
                    state ^= state << 17;
                    *alphabet.get((state >> 33) as usize % alphabet.len()).unwrap()
                })
                .collect();
            let Ok(ours) = rows(&text, b',') else { continue };
            // The crate skips empty lines and believes quotes anywhere; we are stricter, and compare what is left.
            let ours: Vec<_> = ours.into_iter().filter(|r| r != &[""]).collect();
            let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_slice());
            let theirs: Vec<Vec<String>> = reader.records().map(|r| r.unwrap().iter().map(str::to_owned).collect()).collect();
            let theirs: Vec<_> = theirs.into_iter().filter(|r| r != &[""]).collect();
            assert_eq!(ours, theirs, "{:?}", String::from_utf8_lossy(&text));
            compared += 1;
        }
        assert!(compared > 10_000, "{compared}");
    }
}
