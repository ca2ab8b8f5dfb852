//! A new C3D from nothing but a take: Intel, floats, no analog samples.
//!
//! | part | content |
//! | --- | --- |
//! | header | one block |
//! | parameters | POINT, ANALOG and FORCE_PLATFORM (nothing used), TRIAL, MOCAPREPAIR (who made the file, and how much of it) |
//! | data | per frame and point: x, y, z in the take's own unit and the fourth word, as 32-bit floats |
//!
//! The data are not padded to a whole block: padding looks like frames to readers that trust the size of the file where there are more
//! than 65535 frames, and a file without padding shows every cut.
//!
//! The fourth word is 1 for a measured sample (no camera mask, a residual of one scale step), 0 for a derived or repaired one
//! ("interpolated"), and −1 with zero coordinates for a missing one.
//! Parameters that say nothing here are written nevertheless if the C3D user guide has them and programs look for them: some readers ask for
//! ANALOG:SCALE or FORCE_PLATFORM:TYPE before they ask whether there is anything to scale.
//!
//! The scale is the largest coordinate / 32000 as the C3D user guide asks for, so that programs which convert to integers can.

use super::parameters::BLOCK;
use super::points::NOT_THE_ORIGIN;
use super::{INFO, NAME};
use crate::{Direction, FormatError, Notes, Origin, Place, Role, Take};
use std::collections::BTreeSet;
use std::io::Write;

/// Labels per parameter: dimensions are bytes.
const LABELS_PER_LIST: usize = 255;

/// Bytes of text per parameter. Many readers take the step to the next record as signed.
const TEXT_PER_LIST: usize = 32_000;

/// The type of a parameter of 16-bit words.
const WORD: i8 = 2;

/// The type of a parameter of 32-bit floats.
const FLOAT: i8 = 4;

/// In word 150 of the header: event labels have four characters.
const EVENT_KEY: u16 = 12345;

/// The parameter section under construction.
#[derive(Default)]
struct Records {
    bytes: Vec<u8>,
}

impl Records {
    fn record(&mut self, id: u8, group: bool, name: &str, body: &[u8]) {
        self.bytes.push(name.len() as u8);
        self.bytes.push(if group { id.wrapping_neg() } else { id });
        self.bytes.extend(name.bytes());
        // From here to the next record: this word, the body, the length of the description (0).
        self.bytes.extend((body.len() as u16 + 3).to_le_bytes());
        self.bytes.extend(body);
        self.bytes.push(0);
    }

    fn group(&mut self, id: u8, name: &str) {
        self.record(id, true, name, &[]);
    }

    fn parameter(&mut self, group: u8, name: &str, kind: i8, dimensions: &[u8], data: &[u8]) {
        let mut body = vec![kind.cast_unsigned(), dimensions.len() as u8];
        body.extend(dimensions);
        body.extend(data);
        self.record(group, false, name, &body);
    }

    fn words(&mut self, group: u8, name: &str, words: &[u16]) {
        let data: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        let dimensions = if words.len() == 1 { vec![] } else { vec![words.len() as u8] };
        self.parameter(group, name, WORD, &dimensions, &data);
    }

    /// A list or table of this type that has a dimension of 0.
    fn none(&mut self, group: u8, name: &str, kind: i8, dimensions: &[u8]) {
        self.parameter(group, name, kind, dimensions, &[]);
    }

    fn float(&mut self, group: u8, name: &str, value: f32) {
        self.parameter(group, name, FLOAT, &[], &value.to_le_bytes());
    }

    fn text(&mut self, group: u8, name: &str, text: &str) {
        self.parameter(group, name, -1, &[text.len() as u8], text.as_bytes());
    }

    /// `name`, and `name`2, `name`3, ... for what does not fit. Texts are at most 255 bytes long.
    fn texts(&mut self, group: u8, name: &str, texts: &[&str]) {
        let width = texts.iter().map(|t| t.len()).max().unwrap_or(0).max(1);
        let per_list = LABELS_PER_LIST.min(TEXT_PER_LIST / width);
        if texts.is_empty() {
            self.parameter(group, name, -1, &[width as u8, 0], &[]);
        }
        for (i, list) in texts.chunks(per_list).enumerate() {
            let mut data = Vec::with_capacity(width * list.len());
            for text in list {
                data.extend(text.bytes());
                data.resize(data.len() + width - text.len(), b' ');
            }
            let name = if i == 0 { name.to_owned() } else { format!("{name}{}", i + 1) };
            self.parameter(group, &name, -1, &[width as u8, list.len() as u8], &data);
        }
    }
}

/// The first 255 bytes of a text, cut between two characters.
fn cut(text: &str) -> &str {
    let mut end = text.len().min(255);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.get(..end).unwrap_or("")
}

/// Notes what a C3D cannot say about this take.
fn note_losses(take: &Take, labels: &[&str], notes: &Notes) {
    let long = take.markers.iter().zip(labels).filter(|(m, l)| m.label.len() != l.len()).count();
    if long > 0 {
        notes.not_expressible(&INFO, format!("the end of {long} labels that are longer than 255 bytes"));
    }
    let markers: BTreeSet<&str> = take.markers.iter().zip(labels).filter(|(m, _)| m.role == Role::Marker).map(|(_, l)| *l).collect();
    let outputs = take.markers.iter().zip(labels).filter(|(m, _)| m.role == Role::ModelOutput);
    let unnamed = outputs.filter(|(_, l)| l.is_empty() || markers.contains(*l)).count();
    if unnamed > 0 {
        notes.not_expressible(
            &INFO,
            format!("that {unnamed} columns are model outputs, because no label of their own tells them from markers"),
        );
    }
}

/// Words 4 and 5 of the header, and TRIAL's two fields, all of them unsigned.
struct FrameNumbers {
    first: u32,
    last: u32,
}

impl FrameNumbers {
    fn new(take: &Take, notes: &Notes) -> Result<Self, FormatError> {
        let too_many = || FormatError::too_large(NAME, Place::Whole, format!("{} frames are more than a C3D can number", take.frames()));
        let frames = u32::try_from(take.frames()).map_err(|_| too_many())?;
        let fits = |&first: &u32| first.checked_add(frames).is_some();
        if take.frame_step != 1 {
            notes.not_expressible(&INFO, format!("frame numbers in steps of {}", take.frame_step));
        }
        let first = u32::try_from(take.first_frame).ok().filter(fits).unwrap_or_else(|| {
            notes.not_expressible(&INFO, format!("a first frame of number {}", take.first_frame));
            1
        });
        // A take of no frames ends before it begins.
        Ok(Self { first, last: first.checked_add(frames).ok_or_else(too_many)?.saturating_sub(1) })
    }

    fn words(number: u32) -> [u16; 2] {
        [(number & 0xffff) as u16, (number >> 16) as u16]
    }
}

/// A count as an unsigned word; 65535 says "look elsewhere".
fn word(n: impl TryInto<u16>) -> u16 {
    n.try_into().unwrap_or(0xffff)
}

/// Writes the take.
///
/// # Errors
/// Too large for the counts of a C3D, a coordinate that is no 32-bit float, or an I/O error.
pub(super) fn create(take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
    let points = u16::try_from(take.markers.len()).map_err(|_| {
        FormatError::too_large(
            NAME,
            Place::Whole,
            format!("{} markers are more than the 65535 of a C3D; leave some out", take.markers.len()),
        )
    })?;
    let labels: Vec<&str> = take.markers.iter().map(|m| cut(&m.label)).collect();
    note_losses(take, &labels, notes);
    let numbers = FrameNumbers::new(take, notes)?;
    let scale = scale(take)?;
    let rate = take.rate_hz as f32;

    let data_block = |records: &Records| 2 + (records.bytes.len() + 4 + 2).div_ceil(BLOCK);
    // The section holds the number of the block behind it, which does not change its length.
    let sizing = parameters(take, &labels, &numbers, scale, 0);
    let block = data_block(&sizing);
    // The head of the section counts its blocks in a byte.
    if block > 257 {
        return Err(FormatError::too_large(
            NAME,
            Place::Whole,
            format!(
                "the labels of {points} markers need {} blocks of parameters, a C3D has 255; shorten them or leave some out",
                block - 2
            ),
        ));
    }
    let records = parameters(take, &labels, &numbers, scale, block as u16);

    let mut head = vec![0u8; (block - 1) * BLOCK];
    let mut put = |at: usize, bytes: &[u8]| {
        if let Some(cell) = head.get_mut(at..at + bytes.len()) {
            cell.copy_from_slice(bytes);
        }
    };
    put(0, &[2, 0x50]);
    put(2, &points.to_le_bytes());
    put(6, &word(numbers.first).to_le_bytes());
    put(8, &word(numbers.last).to_le_bytes());
    put(12, &(-scale).to_le_bytes());
    put(16, &(block as u16).to_le_bytes());
    put(18, &1u16.to_le_bytes()); // analog samples per frame: none, but 1 is what the two rates say
    put(20, &rate.to_le_bytes());
    put(298, &EVENT_KEY.to_le_bytes()); // word 150; there are no events, and no labels with a range (word 148)
    put(BLOCK, &[1, 0x50, (block - 2) as u8, 84]);
    put(BLOCK + 4, &records.bytes);

    let mut out = std::io::BufWriter::new(out);
    let io = |e| FormatError::io(NAME, e);
    out.write_all(&head).map_err(io)?;
    let mut row = Vec::with_capacity(take.markers.len() * 16);
    for frame in 0..take.frames() {
        row.clear();
        for marker in 0..take.markers.len() {
            let sample = sample(take, frame, marker)?;
            row.extend(sample.iter().flat_map(|x| x.to_le_bytes()));
        }
        out.write_all(&row).map_err(io)?;
    }
    out.flush().map_err(io)
}

/// Coordinates in the file's unit, and the fourth word.
fn sample(take: &Take, frame: usize, marker: usize) -> Result<[f32; 4], FormatError> {
    let Some(position_mm) = take.position_mm(frame, marker) else { return Ok([0.0, 0.0, 0.0, -1.0]) };
    let role = take.markers.get(marker).map_or(Role::Marker, |m| m.role);
    // angles and the like have no unit of length
    let unit_mm = if role == Role::Marker { take.unit.mm() } else { 1.0 };
    let [mut x, y, z] = position_mm.map(|c| (c / unit_mm) as f32);
    if ![x, y, z].iter().all(|c| c.is_finite()) {
        let text = format!("{} in frame {} is too far away for 32-bit floats", take.display_label(marker), take.frame_label(frame));
        return Err(FormatError::unsupported(NAME, Place::Whole, text));
    }
    if role == Role::Marker && [x, y, z] == [0.0; 3] {
        x = NOT_THE_ORIGIN;
    }
    let word = if take.origin(frame, marker) == Origin::Measured { 1.0 } else { 0.0 };
    Ok([x, y, z, word])
}

/// The largest coordinate / 32000, in the file's unit.
fn scale(take: &Take) -> Result<f32, FormatError> {
    let mut largest = 0.0_f32;
    for frame in 0..take.frames() {
        for marker in 0..take.markers.len() {
            let [x, y, z, _] = sample(take, frame, marker)?;
            largest = largest.max(x.abs()).max(y.abs()).max(z.abs());
        }
    }
    let scale = largest / 32000.0;
    Ok(if scale.is_normal() { scale } else { 1.0 })
}

fn parameters(take: &Take, labels: &[&str], numbers: &FrameNumbers, scale: f32, data_block: u16) -> Records {
    const POINT: u8 = 1;
    const ANALOG: u8 = 2;
    const TRIAL: u8 = 3;
    const FORCE_PLATFORM: u8 = 4;
    const MOCAPREPAIR: u8 = 5;
    let mut r = Records::default();
    r.group(POINT, "POINT");
    r.words(POINT, "USED", &[word(take.markers.len())]);
    r.words(POINT, "FRAMES", &[word(take.frames())]);
    // A float counts up to 2^24; beyond that TRIAL has the number alone.
    if (0x1_0000..=0x100_0000).contains(&take.frames()) {
        r.float(POINT, "LONG_FRAMES", take.frames() as f32);
    }
    r.float(POINT, "SCALE", -scale);
    r.float(POINT, "RATE", take.rate_hz as f32);
    r.words(POINT, "DATA_START", &[data_block]);
    r.text(POINT, "UNITS", take.unit.symbol());
    if let Some(up) = take.up {
        // Some axis that lies: a picture has its y up.
        let x = Direction { axis: usize::from(up.axis == 0), positive: true };
        r.text(POINT, "X_SCREEN", &x.to_string().to_ascii_uppercase());
        r.text(POINT, "Y_SCREEN", &up.to_string().to_ascii_uppercase());
    }
    r.texts(POINT, "LABELS", labels);
    r.texts(POINT, "DESCRIPTIONS", &vec![""; labels.len()]);
    let outputs: Vec<&str> =
        take.markers.iter().zip(labels).filter(|(m, l)| m.role == Role::ModelOutput && !l.is_empty()).map(|(_, l)| *l).collect();
    if !outputs.is_empty() {
        r.texts(POINT, "SCALARS", &outputs);
    }
    r.group(ANALOG, "ANALOG");
    r.words(ANALOG, "USED", &[0]);
    r.float(ANALOG, "RATE", take.rate_hz as f32);
    r.float(ANALOG, "GEN_SCALE", 1.0);
    r.none(ANALOG, "SCALE", FLOAT, &[0]);
    r.none(ANALOG, "OFFSET", WORD, &[0]);
    for name in ["LABELS", "DESCRIPTIONS", "UNITS"] {
        r.texts(ANALOG, name, &[]);
    }
    r.group(TRIAL, "TRIAL");
    r.words(TRIAL, "ACTUAL_START_FIELD", &FrameNumbers::words(numbers.first));
    r.words(TRIAL, "ACTUAL_END_FIELD", &FrameNumbers::words(numbers.last));
    r.group(FORCE_PLATFORM, "FORCE_PLATFORM");
    r.words(FORCE_PLATFORM, "USED", &[0]);
    r.none(FORCE_PLATFORM, "TYPE", WORD, &[0]);
    r.words(FORCE_PLATFORM, "ZERO", &[1, 0]);
    r.none(FORCE_PLATFORM, "CORNERS", FLOAT, &[3, 4, 0]);
    r.none(FORCE_PLATFORM, "ORIGIN", FLOAT, &[3, 0]);
    r.none(FORCE_PLATFORM, "CHANNEL", WORD, &[6, 0]);
    r.group(MOCAPREPAIR, "MOCAPREPAIR");
    r.text(MOCAPREPAIR, "VERSION", env!("CARGO_PKG_VERSION"));
    if let Some(method) = &take.filled_by {
        r.text(MOCAPREPAIR, "METHOD", cut(method));
    }
    r.float(MOCAPREPAIR, "FILLED", filled(take) as f32);
    r
}

/// How many samples were filled.
fn filled(take: &Take) -> usize {
    (0..take.frames()).map(|f| (0..take.markers.len()).filter(|&m| take.origin(f, m) == Origin::Repaired).count()).sum()
}
