//! Finds the blocks of an export: a line with nothing but a name, below it one with nothing but a rate.
//!
//! Blocks come in any order, with or without a blank line before them, padded with separators (a spreadsheet saved the file) or not.
//! Here a line is what stands between line ends; cells are the matter of those who read a block.

use crate::text::number::decimal;

/// A block of an export.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Block {
    /// What its first line holds: `Trajectories`, `Model Outputs`, `ANALOG`, ...
    pub name: String,
    /// Frames or samples per second, as its second line says.
    pub rate_hz: f64,
    /// Offset of its first line.
    pub start: usize,
    /// Number of its first line, counted from 1.
    pub line: u64,
    /// Offset where the next block begins, or the end of the file.
    pub end: usize,
}

/// Names that tell an export from some other text.
const KNOWN: [&str; 8] = ["Trajectories", "Model Outputs", "Joints", "Segments", "Devices", "Events", "Analog", "Forces"];

impl Block {
    /// True if programs of Vicon write blocks of this name.
    pub fn is_known(&self) -> bool {
        KNOWN.iter().any(|name| self.name.eq_ignore_ascii_case(name))
    }

    /// True for the block of the markers.
    pub fn holds_markers(&self) -> bool {
        self.name.eq_ignore_ascii_case("Trajectories")
    }
}

/// All blocks, in the order of the file.
pub(super) fn find(bytes: &[u8]) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut name: Option<(String, usize, u64)> = None;
    for (start, line, text) in lines(bytes) {
        if let (Some((name, start, line)), Some(rate_hz)) = (name.take(), lone_rate(text)) {
            if let Some(before) = blocks.last_mut() {
                before.end = start;
            }
            blocks.push(Block { name, rate_hz, start, line, end: bytes.len() });
            continue;
        }
        name = lone_name(text).map(|name| (name, start, line));
    }
    blocks
}

/// Offset, number and text of each line, behind a byte order mark if there is one.
pub(super) fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, u64, &[u8])> {
    let mut at = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
    let mut line = 0;
    std::iter::from_fn(move || {
        let rest = bytes.get(at..).filter(|r| !r.is_empty())?;
        let len = rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(rest.len());
        let text = rest.get(..len).unwrap_or_default();
        let end = if rest.get(len..).unwrap_or_default().starts_with(b"\r\n") { 2 } else { 1 };
        let start = at;
        at += len + end;
        line += 1;
        Some((start, line, text))
    })
}

/// The first cell of a line whose other cells are empty, without quotes, if it begins with a letter.
fn lone_name(line: &[u8]) -> Option<String> {
    let first = line.iter().find(|b| !matches!(b, b' ' | b'"'))?;
    if !first.is_ascii_alphabetic() {
        return None;
    }
    let text = lone(line)?;
    (!text.contains([',', ';', '\t'])).then(|| text.to_owned())
}

/// The rate in a line that holds nothing else, but possibly the word `Hz`.
fn lone_rate(line: &[u8]) -> Option<f64> {
    let text = lone(line)?;
    let number = match text.get(..text.len().saturating_sub(2)) {
        Some(number) if text.to_ascii_lowercase().ends_with("hz") => lone(number.as_bytes())?,
        _ => text,
    };
    decimal(number)
}

/// The text of a line without blanks, quotes and separators around it, if it is short enough to be a name or a number.
fn lone(line: &[u8]) -> Option<&str> {
    /// Longer names are none; and this keeps long lines cheap.
    const LONGEST: usize = 64;
    let is_padding = |b: &u8| matches!(b, b',' | b';' | b'\t' | b' ' | b'"');
    let from = line.iter().position(|b| !is_padding(b))?;
    let to = line.iter().rposition(|b| !is_padding(b))?;
    let text = line.get(from..=to)?;
    // a line of data does not begin with a separator's worth of nothing
    let leads_with_separator = line.get(..from)?.iter().any(|b| matches!(b, b',' | b';' | b'\t'));
    if leads_with_separator || text.len() > LONGEST {
        return None;
    }
    std::str::from_utf8(text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_every_spelling() {
        for (text, expected) in [
            ("Trajectories\n100\n,,A,,\n", &[("Trajectories", 100.0, 1)][..]),
            ("\u{feff}Trajectories,,,\r\n100,,,\r\n,,A,,\r\n", &[("Trajectories", 100.0, 1)]),
            ("Title,,\nDate:,,\n,,\nTRAJECTORIES,,\n100,Hz,\n,A,,\n", &[("TRAJECTORIES", 100.0, 4)]),
            ("Trajectories;;;\n59,94;;;\n", &[("Trajectories", 59.94, 1)]),
            (
                "\"Devices\"\n1000\nFrame,Sub Frame,Fx\n1,0,2\n\nTrajectories\n\"50\"\n",
                &[("Devices", 1000.0, 1), ("Trajectories", 50.0, 6)],
            ),
            ("Events\n100\nSubject,Context\nWalter,Left\n", &[("Events", 100.0, 1)]),
            ("Trajectories\nFrame\n100\n", &[("Frame", 100.0, 2)]),
            (",A\n100\n", &[]),
            ("Trajectories\n1,2,3\n", &[]),
            ("", &[]),
        ] {
            let found = find(text.as_bytes());
            let found: Vec<_> = found.iter().map(|b| (b.name.as_str(), b.rate_hz, b.line)).collect();
            assert_eq!(found, expected, "{text:?}");
        }
    }

    #[test]
    fn a_block_ends_where_the_next_begins() {
        let text = b"Trajectories\n100\n1\n\nDevices\n1000\n2\n";
        let found: Vec<_> = find(text).iter().map(|b| (b.start, b.end)).collect();
        assert_eq!(found, [(0, 20), (20, text.len())]);
    }
}
