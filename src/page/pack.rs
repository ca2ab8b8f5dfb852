//! Numbers as text that a page can carry: differences as variable-length integers, deflated, in base 64.

use serde::Serialize;

/// Streams of integers in one text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packed {
    /// Name of each stream and the number of bytes that it takes once inflated, in order.
    pub streams: Vec<Stream>,
    /// All streams behind each other: zlib, then base 64.
    pub base64: String,
}

/// One of them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Stream {
    /// What it holds.
    pub name: &'static str,
    /// Length in bytes.
    pub bytes: usize,
}

/// Collects streams.
#[derive(Debug, Default)]
pub struct Packer {
    streams: Vec<Stream>,
    bytes: Vec<u8>,
}

impl Packer {
    /// Appends a stream. Numbers near 0 take one byte, whatever their sign.
    pub fn add(&mut self, name: &'static str, numbers: &[i64]) {
        let before = self.bytes.len();
        for &number in numbers {
            push(&mut self.bytes, number);
        }
        self.streams.push(Stream { name, bytes: self.bytes.len() - before });
    }

    /// Appends a stream that was made with [`push`].
    pub fn add_bytes(&mut self, name: &'static str, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
        self.streams.push(Stream { name, bytes: bytes.len() });
    }

    /// The finished text.
    pub fn finish(self) -> Packed {
        Packed { streams: self.streams, base64: pack(&self.bytes) }
    }
}

/// Appends one number: 0, -1, 1, -2, 2, ... as 0, 1, 2, 3, 4, ..., seven bits a byte, the lowest first.
pub fn push(bytes: &mut Vec<u8>, number: i64) {
    let mut rest = ((number << 1) ^ (number >> 63)).cast_unsigned();
    while rest >= 0x80 {
        bytes.push((rest & 0x7f) as u8 | 0x80);
        rest >>= 7;
    }
    bytes.push(rest as u8);
}

/// Zlib, then base 64: what a browser undoes by itself.
pub fn pack(bytes: &[u8]) -> String {
    base64(&miniz_oxide::deflate::compress_to_vec_zlib(bytes, 9))
}

/// Base 64 as in RFC 4648, section 4, with padding.
pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let mut three = [0; 3];
        three[..chunk.len()].copy_from_slice(chunk);
        let bits = u32::from_be_bytes([0, three[0], three[1], three[2]]);
        for digit in 0..4 {
            let value = (bits >> (18 - 6 * digit)) & 63;
            out.push(if digit <= chunk.len() { char::from(DIGITS[value as usize]) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_as_in_rfc_4648() {
        for (bytes, text) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("fooba", "Zm9vYmE="), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xff, 0xfe, 0xfd]), "//79");
    }

    #[test]
    fn small_numbers_are_small() {
        for (number, bytes) in [
            (0, vec![0]),
            (-1, vec![1]),
            (1, vec![2]),
            (-64, vec![127]),
            (64, vec![128, 1]),
            (-300, vec![0xd7, 4]),
            (i64::MAX, [vec![0xfe], vec![0xff; 8], vec![1]].concat()),
            (i64::MIN, [vec![0xff; 9], vec![1]].concat()),
        ] {
            let mut packer = Packer::default();
            packer.add("n", &[number]);
            assert_eq!(packer.bytes, bytes, "{number}");
        }
    }
}
