//! Bytes → words, numbers and lines, as all files of a rig have them: white space between words, `#` before a remark, lines that end in any of
//! three ways, perhaps a byte order mark.

use crate::text::number::{finite, leading};
use crate::text::scan::{self, letters};
use crate::{FormatError, Place};

/// Nothing is as far away as this, in any unit.
const FARTHEST: f64 = 1e12;

/// A word and the line in which it stands, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Word<'a> {
    pub text: &'a [u8],
    pub line: u64,
}

impl Word<'_> {
    /// An error at this word.
    pub fn wrong(self, format: &'static str, text: impl Into<String>) -> FormatError {
        wrong(format, self.line, text)
    }

    /// The word for an error.
    pub fn shown(self) -> String {
        excerpt(self.text)
    }

    /// The number that it is, if it is one that can be a place or an angle.
    pub fn number(self) -> Option<f64> {
        finite(self.text).filter(|x| x.abs() < FARTHEST)
    }
}

/// An error in a line.
pub(super) fn wrong(format: &'static str, line: u64, text: impl Into<String>) -> FormatError {
    FormatError::malformed(format, Place::Line { line, column: None }, text)
}

/// The beginning of some bytes, for an error.
pub(super) fn excerpt(text: &[u8]) -> String {
    scan::excerpt(&letters(text))
}

/// The bytes behind a byte order mark.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

fn is_blank(b: u8) -> bool {
    matches!(b, b' ' | b'\t' | 0x0b | 0x0c)
}

fn ends_line(b: u8) -> bool {
    matches!(b, b'\n' | b'\r')
}

/// Walks over a text, and knows the line.
#[derive(Clone, Debug)]
pub(super) struct Words<'a> {
    format: &'static str,
    rest: &'a [u8],
    line: u64,
}

impl<'a> Words<'a> {
    /// Stands at the beginning of a file of `format`.
    pub fn new(format: &'static str, bytes: &'a [u8]) -> Self {
        Self { format, rest: without_mark(bytes), line: 1 }
    }

    /// The bytes from here on.
    pub fn left(&self) -> usize {
        self.rest.len()
    }

    /// An error in this line.
    pub fn wrong(&self, text: impl Into<String>) -> FormatError {
        wrong(self.format, self.line, text)
    }

    /// Goes to the next word, in this line or another. False at the end of the file.
    pub fn seek(&mut self) -> bool {
        loop {
            match self.rest {
                [b, behind @ ..] if is_blank(*b) => self.rest = behind,
                [b'\r', b'\n', behind @ ..] | [b'\n' | b'\r', behind @ ..] => {
                    self.rest = behind;
                    self.line += 1;
                }
                [b'#', ..] => self.leave_line(),
                _ => return !self.rest.is_empty(),
            }
        }
    }

    /// Goes to the end of this line.
    pub fn leave_line(&mut self) {
        let length = self.rest.iter().position(|&b| ends_line(b)).unwrap_or(self.rest.len());
        self.rest = self.rest.get(length..).unwrap_or_default();
    }

    /// Goes to the next word of this line. False at its end.
    fn seek_here(&mut self) -> bool {
        while let [b, behind @ ..] = self.rest
            && is_blank(*b)
        {
            self.rest = behind;
        }
        self.rest.first().is_some_and(|&b| !ends_line(b) && b != b'#')
    }

    /// The next word of the file.
    pub fn word(&mut self) -> Option<Word<'a>> {
        self.seek().then(|| self.take_word())
    }

    /// The next word of this line.
    pub fn word_here(&mut self) -> Option<Word<'a>> {
        self.seek_here().then(|| self.take_word())
    }

    fn take_word(&mut self) -> Word<'a> {
        let ends = |b: &u8| is_blank(*b) || ends_line(*b);
        let length = self.rest.iter().position(ends).unwrap_or(self.rest.len());
        let (text, rest) = self.rest.split_at_checked(length).unwrap_or((self.rest, &[]));
        self.rest = rest;
        Word { text, line: self.line }
    }

    /// The next word of this line as a number up to 1e12. `what` was expected.
    ///
    /// # Errors
    /// There is none, or it is something else.
    pub fn number_here(&mut self, what: &str) -> Result<f64, FormatError> {
        if self.seek_here() {
            match leading(self.rest) {
                Some((value, rest)) if value.abs() < FARTHEST => {
                    self.rest = rest;
                    return Ok(value);
                }
                _ => {}
            }
        }
        Err(self.no_number(what))
    }

    /// The next word of this line as a whole number. `what` was expected.
    ///
    /// # Errors
    /// There is none, or it is something else.
    pub fn whole_here(&mut self, what: &str) -> Result<u64, FormatError> {
        let mut value = None;
        if self.seek_here() {
            let mut rest = self.rest;
            let mut sum = Some(0_u64);
            while let [b @ b'0'..=b'9', behind @ ..] = rest {
                sum = sum.and_then(|sum| sum.checked_mul(10)?.checked_add(u64::from(b - b'0')));
                rest = behind;
            }
            if rest.len() < self.rest.len() && rest.first().is_none_or(|&b| is_blank(b) || ends_line(b) || b == b'#') {
                value = sum.map(|sum| (sum, rest));
            }
        }
        let Some((value, rest)) = value else { return Err(self.no_count(what)) };
        self.rest = rest;
        Ok(value)
    }

    #[cold]
    fn no_count(&mut self, what: &str) -> FormatError {
        let Some(word) = self.word_here() else { return self.nothing(what) };
        let more = if word.text.iter().all(u8::is_ascii_digit) { ", which is more than there can be of anything" } else { "" };
        let link = if more.is_empty() { "," } else { ";" };
        word.wrong(self.format, format!("\"{}\" found{more}{link} expected {what}", word.shown()))
    }

    #[cold]
    fn no_number(&mut self, what: &str) -> FormatError {
        let Some(word) = self.word_here() else { return self.nothing(what) };
        match finite(word.text) {
            Some(x) if x.abs() >= FARTHEST => {
                word.wrong(self.format, format!("\"{}\" is farther away than anything can be; correct it", word.shown()))
            }
            _ => word.wrong(self.format, format!("\"{}\" found, expected {what}", word.shown())),
        }
    }

    fn nothing(&self, what: &str) -> FormatError {
        self.wrong(format!("the line ends where {what} is expected; complete it"))
    }
}

/// The vector with length 1, and unchanged if it is that long already; `None` if it is shorter than `least`.
pub(super) fn normalised(v: [f64; 3], least: f64) -> Option<[f64; 3]> {
    let largest = v.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    if largest == 0.0 {
        return None;
    }
    let length = largest * v.iter().map(|x| (x / largest) * (x / largest)).sum::<f64>().sqrt();
    // what was normalised before stays as it is to the last digit, so that files read back as they were written
    let done = (length - 1.0).abs() < 1e-15;
    (length >= least).then(|| if done { v } else { v.map(|x| x / length) })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn words_know_their_lines() {
        let mut words = Words::new("rig", b"\xef\xbb\xbfa b # remark\r\n#\rc\n\n  d");
        let mut found = Vec::new();
        while let Some(word) = words.word() {
            found.push((word.shown(), word.line));
        }
        assert_eq!(found, [("a".to_owned(), 1), ("b".to_owned(), 1), ("c".to_owned(), 3), ("d".to_owned(), 5)]);
    }

    #[test]
    fn numbers_of_a_line() {
        let mut words = Words::new("rig", b" 1.5\t-2e1#3\n4 x 1e13 18446744073709551616");
        assert_eq!(words.number_here("x").unwrap(), 1.5);
        assert_eq!(words.number_here("x").unwrap(), -20.0);
        let end = "rig: the line ends where a number is expected; complete it (line 1)";
        assert_eq!(words.number_here("a number").unwrap_err().to_string(), end);
        assert!(words.seek());
        assert_eq!(words.whole_here("a count").unwrap(), 4);
        assert_eq!(words.whole_here("a count").unwrap_err().to_string(), "rig: \"x\" found, expected a count (line 2)");
        let far = "rig: \"1e13\" is farther away than anything can be; correct it (line 2)";
        assert_eq!(words.number_here("a number").unwrap_err().to_string(), far);
        let many = "rig: \"18446744073709551616\" found, which is more than there can be of anything; expected a count (line 2)";
        assert_eq!(words.whole_here("a count").unwrap_err().to_string(), many);
    }

    #[test]
    fn a_direction_is_normalised_once() {
        let once = normalised([0.3, -0.2, 1.7], 1e-9).unwrap();
        assert_eq!(normalised(once, 1e-9), Some(once));
        assert_eq!(normalised([1e-10, 0.0, 0.0], 1e-9), None);
        assert_eq!(normalised([0.0; 3], 0.0), None);
        assert_eq!(normalised([0.0, 1e-200, 0.0], 0.0), Some([0.0, 1.0, 0.0]));
    }
}
