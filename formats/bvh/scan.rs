//! Bytes → words and lines.

use super::NAME;
pub(super) use crate::text::number::finite as number;
use crate::text::scan::{self, letters};
use crate::{FormatError, Place};

/// How many digits stand behind the decimal point of a number, after its exponent was applied; `1.5e-3` has 4.
pub(super) fn decimals(text: &[u8]) -> usize {
    let split = text.iter().position(|b| matches!(b, b'e' | b'E'));
    let mantissa = split.and_then(|at| text.get(..at)).unwrap_or(text);
    let exponent = split.and_then(|at| text.get(at + 1..)).and_then(|e| std::str::from_utf8(e).ok()?.parse::<i32>().ok()).unwrap_or(0);
    let behind = mantissa.iter().position(|&b| b == b'.').map_or(0, |at| mantissa.len() - at - 1);
    let behind = i64::try_from(behind).unwrap_or(i64::MAX).saturating_sub(i64::from(exponent));
    usize::try_from(behind.clamp(0, 400)).unwrap_or(0)
}

/// The beginning of some bytes, for an error.
pub(super) fn excerpt(text: &[u8]) -> String {
    scan::excerpt(&letters(text))
}

/// Blanks within a line.
pub(super) fn is_blank(b: u8) -> bool {
    matches!(b, b' ' | b'\t' | 0x0b | 0x0c)
}

fn is_space(b: u8) -> bool {
    is_blank(b) || matches!(b, b'\n' | b'\r')
}

/// Walks over a text, and knows the line.
#[derive(Clone, Debug)]
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    line: u64,
}

impl<'a> Cursor<'a> {
    /// Stands at the beginning, behind a byte order mark.
    pub fn new(bytes: &'a [u8]) -> Self {
        let at = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        Self { bytes, at, line: 1 }
    }

    /// The line of the next byte, counted from 1.
    pub fn line(&self) -> u64 {
        self.line
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    fn step(&mut self) {
        match (self.peek(), self.bytes.get(self.at + 1)) {
            (Some(b'\r'), Some(b'\n')) | (None, _) => {}
            (Some(b'\r' | b'\n'), _) => self.line += 1,
            _ => {}
        }
        self.at += 1;
    }

    /// Goes to the next byte that is no white space. False at the end.
    pub fn skip_space(&mut self) -> bool {
        while self.peek().is_some_and(is_space) {
            self.step();
        }
        self.peek().is_some()
    }

    /// The next word, or bracket; empty at the end.
    pub fn word(&mut self) -> &'a [u8] {
        self.skip_space();
        let start = self.at;
        if matches!(self.peek(), Some(b'{' | b'}')) {
            self.at += 1;
        } else {
            while self.peek().is_some_and(|b| !is_space(b) && !matches!(b, b'{' | b'}')) {
                self.at += 1;
            }
        }
        self.bytes.get(start..self.at).unwrap_or_default()
    }

    /// What the next word is, without going there.
    pub fn next_word(&self) -> &'a [u8] {
        self.clone().word()
    }

    /// The rest of the line up to an opening bracket, without blanks around it: a name, which may hold blanks.
    pub fn name(&mut self) -> &'a [u8] {
        let start = self.at;
        while self.peek().is_some_and(|b| !matches!(b, b'\n' | b'\r' | b'{')) {
            self.at += 1;
        }
        self.bytes.get(start..self.at).unwrap_or_default().trim_ascii()
    }

    /// Takes `words` (lower case, in any case in the file, blanks between them or not) and a colon.
    pub fn key(&mut self, words: &[&str]) -> bool {
        let mut ahead = self.clone();
        for word in words {
            ahead.skip_space();
            let found = ahead.bytes.get(ahead.at..ahead.at.saturating_add(word.len())).unwrap_or_default();
            if !found.eq_ignore_ascii_case(word.as_bytes()) {
                return false;
            }
            ahead.at += word.len();
        }
        ahead.skip_space();
        if ahead.peek() != Some(b':') {
            return false;
        }
        ahead.at += 1;
        *self = ahead;
        true
    }

    /// The next line with something in it: where it starts, and its text. The cursor stands behind its end afterwards.
    pub fn row(&mut self) -> Option<(usize, &'a [u8])> {
        if !self.skip_space() {
            return None;
        }
        let start = self.at;
        let rest = self.bytes.get(start..)?;
        let length = rest.iter().position(|&b| matches!(b, b'\n' | b'\r')).unwrap_or(rest.len());
        self.at = start + length;
        rest.get(..length).map(|text| (start, text))
    }

    /// An error at the current line.
    pub fn wrong(&self, text: impl Into<String>) -> FormatError {
        FormatError::malformed(NAME, Place::Line { line: self.line, column: None }, text)
    }
}

/// The words of a row, each with its offset.
pub(super) fn values(row: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let mut at = 0;
    std::iter::from_fn(move || {
        let rest = row.get(at..)?;
        let start = at + rest.iter().position(|&b| !is_blank(b))?;
        let rest = row.get(start..)?;
        let length = rest.iter().position(|&b| is_blank(b)).unwrap_or(rest.len());
        at = start + length;
        rest.get(..length).map(|word| (start, word))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_behind_the_point() {
        for (text, expected) in [("1", 0), ("1.50", 2), (".0083333", 7), ("1.5e-3", 4), ("1.5e+3", 0), ("1e9999999999", 0)] {
            assert_eq!(decimals(text.as_bytes()), expected, "{text}");
        }
    }

    #[test]
    fn lines_end_in_three_ways() {
        let mut cursor = Cursor::new(b"\xef\xbb\xbfa\r\nb\rc\n\n d  e \n");
        assert_eq!((cursor.word(), cursor.line()), (&b"a"[..], 1));
        assert_eq!((cursor.word(), cursor.line()), (&b"b"[..], 2));
        assert_eq!((cursor.word(), cursor.line()), (&b"c"[..], 3));
        assert_eq!(cursor.row(), Some((12, &b"d  e "[..])));
        assert_eq!(cursor.line(), 5);
        assert_eq!(cursor.row(), None);
        assert_eq!(values(b"d  e ").collect::<Vec<_>>(), [(0, &b"d"[..]), (3, b"e")]);
    }
}
