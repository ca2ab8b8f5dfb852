//! The 512-byte header and the parameter section.
//!
//! Header (words of 16 bits, numbered from 1 as in the C3D user guide, "The Header Section"):
//!
//! | word | meaning |
//! | --- | --- |
//! | 1 | low byte: block of the parameter section, counted from 1; high byte: 0x50 |
//! | 2 | points per frame |
//! | 3 | analog words per frame |
//! | 4, 5 | first and last frame number |
//! | 7-8 | scale of the points; negative in a file that stores floats |
//! | 9 | block of the data, counted from 1 |
//! | 10 | analog samples per frame |
//! | 11-12 | frames per second |
//! | 150 | 12345 if the header may have events with labels of four characters |
//! | 151 | number of events |
//!
//! The parameter section begins with four bytes (two of no meaning, the number of blocks, the processor + 83) and goes on with records:
//!
//! | bytes | group | parameter |
//! | --- | --- | --- |
//! | 1 | length of the name, negative if locked | same |
//! | 1 | −id | id of the group |
//! | n | name | name |
//! | 2 | bytes from here to the next record, 0 in the last | same |
//! | 1 | length of the description | type: −1 text, 1 byte, 2 word, 4 float |
//! | ... | description | number of dimensions, dimensions, data, length of the description, description |
//!
//! Groups may follow their parameters, ids may lack a group, and names may occur twice (the first one counts here).
//! Nothing is copied: a [`Parameter`] remembers where its data lies.

use super::NAME;
use super::processor::Processor;
use crate::cursor::Cursor;
use crate::text::scan::letters;
use crate::{FormatError, Note, Notes, Place};
use std::ops::Range;

/// C3D counts in blocks of this many bytes.
pub(super) const BLOCK: usize = 512;

/// More records than any file has; what claims more is damaged and would only cost memory.
const MOST_RECORDS: usize = 50_000;

/// More continuations (LABELS2, LABELS3, ...) than 65535 points need.
const MOST_PARTS: usize = 1000;

/// In word 150 of the header: there may be events, whose labels have four characters.
const EVENT_KEY: u16 = 12345;

/// The header has room for no more events.
const MOST_EVENTS: u16 = 18;

/// What the header says. Numbers are as stored; nothing is checked yet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Header {
    /// Points per frame.
    pub points: u16,
    /// Analog words per frame.
    pub analog_words: u16,
    /// Number of the first frame.
    pub first: u16,
    /// Number of the last frame.
    pub last: u16,
    /// Scale of the points.
    pub scale: f32,
    /// Block of the data, from 1.
    pub data_block: u16,
    /// Analog samples per frame.
    pub analog_ratio: u16,
    /// Frames per second.
    pub rate: f32,
}

/// A parameter record.
#[derive(Clone, Debug)]
struct Parameter {
    group: u8,
    name: String,
    kind: i8,
    dimensions: Vec<u8>,
    data: Range<usize>,
}

/// Header and parameters.
#[derive(Debug)]
pub(super) struct Parameters<'a> {
    bytes: &'a [u8],
    /// Who wrote the file.
    pub processor: Processor,
    /// What the header says.
    pub header: Header,
    /// First byte behind the last record.
    pub end: usize,
    groups: Vec<(u8, String)>,
    records: Vec<Parameter>,
}

/// Names are compared without padding and case.
fn name_of(bytes: &[u8]) -> String {
    text_of(bytes).to_ascii_uppercase()
}

/// Text without trailing padding: UTF-8 if it is, Latin-1 otherwise. Writers in C leave anything behind a NUL.
fn text_of(bytes: &[u8]) -> String {
    let bytes = bytes.split(|&b| b == 0).next().unwrap_or(&[]);
    letters(bytes).trim_end().to_owned()
}

impl<'a> Parameters<'a> {
    /// Reads both.
    ///
    /// # Errors
    /// Malformed if a byte that must be there is not, or the records cannot be followed as far as POINT:USED.
    pub fn read(bytes: &'a [u8], notes: &Notes) -> Result<Self, FormatError> {
        let mut head = Cursor::new(NAME, "header", bytes, 0);
        if head.left() < BLOCK {
            return Err(FormatError::malformed(
                NAME,
                Place::Whole,
                format!("the file has {} bytes, the header alone has {BLOCK}: the file is cut off or not a C3D", bytes.len()),
            ));
        }
        let block = head.byte("the parameter block")?;
        let magic = head.byte("the key")?;
        if magic != 0x50 {
            head.go_to(1);
            return Err(head.malformed(format!("the second byte is {magic:#04x}, expected 0x50: this is not a C3D")));
        }
        if block < 2 {
            head.go_to(0);
            return Err(head.malformed(format!("the parameters should begin in block {block}, expected 2 or more: the header is damaged")));
        }
        let section = (usize::from(block) - 1) * BLOCK;
        let mut records = Cursor::new(NAME, "parameters", bytes, section);
        let [_, _, blocks, processor] = records.array("the head of the parameters")?;
        let Some(processor) = Processor::from_byte(processor) else {
            records.go_to(section + 3);
            return Err(records.malformed(format!(
                "the processor is {processor}, expected 84 (Intel), 85 (DEC) or 86 (MIPS): the parameters are damaged or were never written"
            )));
        };
        let header = Header::read(&mut head, processor)?;

        // The section ends where the data begins. The number of blocks is often too small (Vicon writes a byte that wrapped or a stale
        // one), so it only serves where the header does not know either.
        let data = usize::from(header.data_block).saturating_sub(1) * BLOCK;
        let end = if data > section { data } else { section.saturating_add(usize::from(blocks).max(1) * BLOCK) };
        let mut this = Self { bytes, processor, header, end: records.at(), groups: Vec::new(), records: Vec::new() };
        let records = Cursor::new(NAME, "parameters", bytes.get(..end).unwrap_or(bytes), records.at());
        match this.read_records(records, end, notes) {
            Ok(()) => Ok(this),
            // Some programs let the data overwrite the last parameters. What was read until there is good, and so are the data.
            Err(error) if data > section && end <= bytes.len() && this.number("POINT", "USED").is_some() => {
                let text = format!("{}{}; the parameters from there on were not read", error.problem, error.place);
                notes.add(Note::Damaged { text });
                Ok(this)
            }
            Err(error) => Err(error),
        }
    }

    /// Follows the records. Each one begins behind the one before, so this ends.
    fn read_records(&mut self, mut at: Cursor<'a>, end: usize, notes: &Notes) -> Result<(), FormatError> {
        loop {
            self.end = at.at();
            if at.at() == end && end <= self.bytes.len() {
                return Ok(()); // A section that is full to the last byte needs no end mark.
            }
            if self.records.len() + self.groups.len() == MOST_RECORDS {
                return Err(FormatError::too_large(NAME, at.place(), format!("more than {MOST_RECORDS} parameters: they are damaged")));
            }
            let length = at.byte("the next record")?.cast_signed();
            if length == 0 {
                return Ok(());
            }
            let id = at.byte("the group of a record")?.cast_signed();
            if id == 0 {
                return Ok(());
            }
            let name = name_of(at.take(usize::from(length.unsigned_abs()), "the name of a record")?);
            let step_at = at.at();
            let step = self.processor.u16(at.array("the step to the next record")?);
            let leads_out = |step: u16| step == 1 || step_at + usize::from(step) > end.min(self.bytes.len());
            // One program that converts files for other processors forgets to swap some of these.
            let swapped = leads_out(step) && step.swap_bytes() > 1 && !leads_out(step.swap_bytes());
            let step = if swapped { step.swap_bytes() } else { step };
            if swapped {
                let text = format!("the step behind parameter {name} has its bytes swapped; it was read the other way round");
                notes.add(Note::Contradiction { text });
            }
            let leads_out = leads_out(step);
            let next = step_at + usize::from(step);
            if id < 0 {
                self.groups.push((id.unsigned_abs(), name));
            } else {
                let kind = at.byte("the type of a parameter")?.cast_signed();
                let count = at.byte("the number of dimensions")?;
                let dimensions = at.take(usize::from(count), "the dimensions of a parameter")?.to_vec();
                let size = dimensions.iter().try_fold(usize::from(kind.unsigned_abs()), |n, &d| n.checked_mul(usize::from(d)));
                let start = at.at();
                let Some(data_end) = size.and_then(|size| start.checked_add(size)).filter(|&e| e <= end.min(self.bytes.len())) else {
                    return Err(
                        at.malformed(format!("the data of parameter {name} reaches beyond the parameters: the file is cut off or damaged"))
                    );
                };
                // Dimensions that claim more than the step to the next record would show the next record as data.
                let data = start..if step == 0 { data_end } else { data_end.min(next.max(start)) };
                self.records.push(Parameter { group: id.unsigned_abs(), name, kind, dimensions, data });
            }
            if step == 0 {
                self.end = at.at();
                return Ok(());
            }
            if leads_out {
                at.go_to(step_at);
                return Err(
                    at.malformed(format!("the step to the next record is {step}, which leads out of the parameters: they are damaged"))
                );
            }
            at.go_to(next);
        }
    }

    /// The parameters of this name (upper case) in the group of this name.
    fn named(&self, group: &str, name: &str) -> impl Iterator<Item = &Parameter> {
        let in_group = move |p: &Parameter| self.groups.iter().find(|(id, _)| *id == p.group).is_some_and(|(_, g)| g == group);
        self.records.iter().filter(move |p| p.name == name && in_group(p))
    }

    /// The first of them.
    fn find(&self, group: &str, name: &str) -> Option<&Parameter> {
        self.named(group, name).next()
    }

    /// True if there is a group of this name.
    pub fn has_group(&self, group: &str) -> bool {
        self.groups.iter().any(|(_, name)| name == group)
    }

    /// Names of all groups, in upper case.
    pub fn group_names(&self) -> impl Iterator<Item = &str> {
        self.groups.iter().map(|(_, name)| name.as_str())
    }

    /// How many events the header holds (words 150 and 151); there is room for 18.
    pub fn header_events(&self) -> u16 {
        let word = |n: usize| {
            let bytes = self.bytes.get((n - 1) * 2..).and_then(|b| b.first_chunk());
            bytes.map_or(0, |b| self.processor.u16(*b))
        };
        if word(150) == EVENT_KEY && word(151) <= MOST_EVENTS { word(151) } else { 0 }
    }

    /// True if the parameter exists and holds floats.
    pub fn is_float(&self, group: &str, name: &str) -> bool {
        self.find(group, name).is_some_and(|p| p.kind == 4)
    }

    /// The numbers of a parameter, at most `most`. Bytes and words are taken as unsigned, as every count in a C3D is.
    pub fn numbers(&self, group: &str, name: &str, most: usize) -> Vec<f64> {
        let Some(p) = self.find(group, name) else { return Vec::new() };
        let data = self.bytes.get(p.data.clone()).unwrap_or(&[]);
        match p.kind {
            1 => data.iter().take(most).map(|&b| f64::from(b)).collect(),
            2 => data.as_chunks().0.iter().take(most).map(|&b| f64::from(self.processor.u16(b))).collect(),
            4 => data.as_chunks().0.iter().take(most).map(|&b| f64::from(self.processor.f32(b))).collect(),
            _ => Vec::new(),
        }
    }

    /// The first number of a parameter, if it is finite.
    pub fn number(&self, group: &str, name: &str) -> Option<f64> {
        self.numbers(group, name, 1).first().copied().filter(|x| x.is_finite())
    }

    /// Where the first float of each parameter of this name is in the file; names may occur twice.
    pub fn floats_at(&self, group: &str, name: &str) -> Vec<usize> {
        let floats = |p: &&Parameter| p.kind == 4 && p.data.len() >= 4;
        self.named(group, name).filter(floats).map(|p| p.data.start).collect()
    }

    /// The texts of a parameter without trailing padding. `None` if there is no such parameter or it is no text.
    pub fn texts(&self, group: &str, name: &str) -> Option<Vec<String>> {
        let p = self.find(group, name).filter(|p| p.kind == -1)?;
        let data = self.bytes.get(p.data.clone())?;
        // One dimension is one text; the first of several is the length of each.
        let width = p.dimensions.first().map_or(1, |&d| usize::from(d));
        if width == 0 || data.is_empty() {
            return Some(Vec::new());
        }
        Some(data.chunks(width).map(text_of).collect())
    }

    /// The texts of `name`, `name`2, `name`3, ...: how files get around the limit of 255.
    pub fn continued_texts(&self, group: &str, name: &str) -> Vec<String> {
        let mut all = self.texts(group, name).unwrap_or_default();
        for part in 2..=MOST_PARTS {
            match self.texts(group, &format!("{name}{part}")) {
                Some(more) => all.extend(more),
                None => break,
            }
        }
        all
    }
}

impl Header {
    fn read(at: &mut Cursor<'_>, processor: Processor) -> Result<Self, FormatError> {
        let mut word = |n: usize| -> Result<u16, FormatError> {
            at.go_to((n - 1) * 2);
            Ok(processor.u16(at.array("a word of the header")?))
        };
        let (points, analog_words, first, last, data_block, analog_ratio) = (word(2)?, word(3)?, word(4)?, word(5)?, word(9)?, word(10)?);
        at.go_to(12);
        let scale = processor.f32(at.array("the scale")?);
        at.go_to(20);
        let rate = processor.f32(at.array("the rate")?);
        Ok(Self { points, analog_words, first, last, scale, data_block, analog_ratio, rate })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_loses_padding_only() {
        for (bytes, text) in [
            (&b"LKNE  "[..], "LKNE"),
            (b"A\0\0", "A"),
            (b"B\0junk", "B"),
            (b" x", " x"),
            (b"   ", ""),
            (b"\xc3\xa4 ", "\u{e4}"),
            (b"\xe4", "\u{e4}"),
        ] {
            assert_eq!(text_of(bytes), text);
        }
        assert_eq!(name_of(b"Labels "), "LABELS");
    }
}
