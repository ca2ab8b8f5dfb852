//! A place in a binary file that only moves forward inside the bytes there are.
//!
//! Every read is checked, and every error carries the byte where it happened, so a parser can neither panic nor forget to say where.
//! What the bytes mean is left to the formats.

use crate::{FormatError, Place};

/// Reads bytes one after the other.
#[derive(Clone, Debug)]
pub(crate) struct Cursor<'a> {
    format: &'static str,
    section: &'static str,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    /// Starts at the byte `at` of `bytes`, which are the file up to where this section ends.
    pub fn new(format: &'static str, section: &'static str, bytes: &'a [u8], at: usize) -> Self {
        Self { format, section, bytes, at }
    }

    /// Offset of the next byte from the start of the file.
    pub fn at(&self) -> usize {
        self.at
    }

    /// Number of bytes left; 0 behind the end.
    pub fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }

    /// Continues at the byte `at` of the file.
    pub fn go_to(&mut self, at: usize) {
        self.at = at;
    }

    /// The next `count` bytes.
    ///
    /// # Errors
    /// Malformed if fewer are left; `what` says what they should have been.
    pub fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], FormatError> {
        let end = self.at.checked_add(count);
        match end.and_then(|end| self.bytes.get(self.at..end)) {
            Some(bytes) => {
                self.at += count;
                Ok(bytes)
            }
            None => Err(self.malformed(format!(
                "{what} should be here, {count} bytes long, but {} are left: the file is cut off or damaged",
                self.left()
            ))),
        }
    }

    /// The next `N` bytes.
    ///
    /// # Errors
    /// As [`Cursor::take`].
    pub fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], FormatError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        Ok(array)
    }

    /// The next byte.
    ///
    /// # Errors
    /// As [`Cursor::take`].
    pub fn byte(&mut self, what: &str) -> Result<u8, FormatError> {
        Ok(u8::from_le_bytes(self.array(what)?))
    }

    /// The place of the next byte.
    pub fn place(&self) -> Place {
        Place::Byte { offset: self.at as u64, section: self.section }
    }

    /// An error at the next byte.
    pub fn malformed(&self, text: impl Into<String>) -> FormatError {
        FormatError::malformed(self.format, self.place(), text)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn reads_forward_and_says_where_it_ended() {
        let mut c = Cursor::new("toy", "header", &[1, 2, 3, 4], 1);
        assert_eq!((c.byte("a").unwrap(), c.take(2, "b").unwrap(), c.left(), c.at()), (2, [3, 4].as_slice(), 0, 4));
        let error = c.array::<2>("the count").unwrap_err().to_string();
        assert_eq!(error, "toy: the count should be here, 2 bytes long, but 0 are left: the file is cut off or damaged (header, byte 0x4)");
        c.go_to(usize::MAX);
        assert!(c.take(2, "far away").is_err() && c.left() == 0);
    }
}
