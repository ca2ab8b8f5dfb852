//! The samples: three coordinates and a fourth word that says whether to believe them.
//!
//! What real files put into the fourth word (as float in a file of floats):
//!
//! | fourth word | coordinates | taken as |
//! | --- | --- | --- |
//! | −1, or anything negative | any | missing |
//! | 32768 to 65535 in a file of floats (the word −1 converted as if it had no sign) | any | missing |
//! | any | NaN or infinite | missing |
//! | any | exactly 0 0 0 | missing in a marker, a value in a model output |
//! | 0 | finite | derived if other samples of the file have more than 0, else measured |
//! | above 0: cameras and residual | finite | measured |
//! | 65536 and above, or NaN: garbage | finite | measured |
//!
//! What 0 means depends on the whole file, so only files that use both 0 and residuals are walked twice.

use super::NAME;
use super::layout::{Layout, Storage};
use super::processor::{Processor, dec_to_f32};
use crate::{FormatError, Note, Notes, Origin, Place, Role, Take, TakeBuilder};

/// Coordinates as the file stores them, and the fourth word.
type Sample = ([f32; 3], f32);

/// What a sample says about itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Coordinates, and a fourth word above 0.
    Seen,
    /// Coordinates, and a fourth word of 0.
    Unsaid,
    /// Coordinates, and a fourth word that makes no sense.
    Garbage,
    /// Flagged missing, with coordinates.
    Stale,
    /// Flagged missing, without.
    Flagged,
    /// Not flagged, and exactly at the origin.
    Zero,
    /// Not flagged, and some coordinate is no number.
    NoNumber,
    /// As before, and some coordinate is one.
    PartlyNoNumber,
}

#[inline]
fn kind(([x, y, z], word): Sample, role: Role) -> Kind {
    // Nearly all samples of nearly all files: a residual, finite, and not at the origin.
    if word > 0.0 && word < 32768.0 && (x != 0.0 || y != 0.0 || z != 0.0) && x.is_finite() && y.is_finite() && z.is_finite() {
        return Kind::Seen;
    }
    let finite = [x, y, z].iter().filter(|c| c.is_finite()).count();
    let zero = x == 0.0 && y == 0.0 && z == 0.0;
    if word < 0.0 || (32768.0..65536.0).contains(&word) {
        return if finite == 3 && !zero { Kind::Stale } else { Kind::Flagged };
    }
    if finite < 3 {
        return if finite == 0 { Kind::NoNumber } else { Kind::PartlyNoNumber };
    }
    if zero && role == Role::Marker {
        return Kind::Zero;
    }
    if word == 0.0 {
        Kind::Unsaid
    } else if word < 65536.0 {
        Kind::Seen
    } else {
        Kind::Garbage
    }
}

/// How many samples of each kind the markers have.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    /// Some column, be it a model output, has a residual.
    used: bool,
    samples: usize,
    garbage: usize,
    stale: usize,
    flagged: usize,
    zero: usize,
    partly: usize,
}

/// Calls `each` with frame, column and sample, frame by frame.
fn walk(layout: &Layout, bytes: &[u8], each: impl FnMut(usize, usize, Sample)) {
    let data = bytes.get(layout.start..).unwrap_or(&[]);
    match (layout.storage, layout.processor) {
        (Storage::Float, Processor::Intel) => walk_floats(layout, data, f32::from_le_bytes, each),
        (Storage::Float, Processor::Mips) => walk_floats(layout, data, f32::from_be_bytes, each),
        (Storage::Float, Processor::Dec) => walk_floats(layout, data, dec_to_f32, each),
        (Storage::Integer, Processor::Mips) => walk_integers(layout, data, i16::from_be_bytes, each),
        (Storage::Integer, Processor::Intel | Processor::Dec) => walk_integers(layout, data, i16::from_le_bytes, each),
    }
}

fn walk_floats(layout: &Layout, data: &[u8], number: impl Fn([u8; 4]) -> f32, mut each: impl FnMut(usize, usize, Sample)) {
    for (frame, bytes) in data.chunks_exact(layout.frame_bytes.max(1)).take(layout.frames).enumerate() {
        let (words, _) = bytes.as_chunks::<4>();
        let (samples, _) = words.as_chunks::<4>();
        for (column, sample) in samples.iter().take(layout.points).enumerate() {
            let [x, y, z, word] = sample.map(&number);
            each(frame, column, ([x, y, z], word));
        }
    }
}

fn walk_integers(layout: &Layout, data: &[u8], number: impl Fn([u8; 2]) -> i16, mut each: impl FnMut(usize, usize, Sample)) {
    for (frame, bytes) in data.chunks_exact(layout.frame_bytes.max(1)).take(layout.frames).enumerate() {
        let (words, _) = bytes.as_chunks::<2>();
        let (samples, _) = words.as_chunks::<4>();
        for (column, sample) in samples.iter().take(layout.points).enumerate() {
            let [x, y, z, word] = sample.map(|w| f32::from(number(w)));
            each(frame, column, ([x, y, z], word));
        }
    }
}

/// Reads all samples into `builder`, whose columns have the given roles.
/// `step_mm` is the length of a stored 1 in mm, `unit_mm` that of the file's unit, which means nothing to model outputs. Returns the take and the largest coordinate of a marker in mm.
pub(super) fn read(
    layout: &Layout,
    bytes: &[u8],
    mut builder: TakeBuilder,
    roles: &[Role],
    (step_mm, unit_mm): (f64, f64),
    notes: &Notes,
) -> (Take, f64) {
    let role = |column: usize| roles.get(column).copied().unwrap_or(Role::Marker);
    let step = |role: Role| if role == Role::Marker { step_mm } else { step_mm / unit_mm };
    let mut tally = Tally::default();
    let mut unsaid = false;
    let mut largest = 0.0_f32;
    walk(layout, bytes, |frame, column, sample| {
        let role = role(column);
        let kind = kind(sample, role);
        tally.add(kind, role);
        if let Kind::Seen | Kind::Garbage | Kind::Unsaid = kind {
            unsaid |= kind == Kind::Unsaid;
            if role == Role::Marker {
                largest = sample.0.iter().fold(largest, |most, c| most.max(c.abs()));
            }
            builder.set_multiples(frame, column, sample.0, step(role), Origin::Measured);
        }
    });
    tally.note(notes);
    // "0 means somebody filled this" only where the writer used residuals at all; many put 0 everywhere.
    if unsaid && tally.used {
        walk(layout, bytes, |frame, column, sample| {
            if kind(sample, role(column)) == Kind::Unsaid {
                builder.set_multiples(frame, column, sample.0, step(role(column)), Origin::Derived);
            }
        });
    }
    (builder.build(), f64::from(largest) * step_mm)
}

impl Tally {
    fn add(&mut self, kind: Kind, role: Role) {
        self.used |= kind == Kind::Seen;
        if role == Role::ModelOutput {
            return;
        }
        self.samples += 1;
        match kind {
            Kind::Garbage => self.garbage += 1,
            Kind::Stale => self.stale += 1,
            Kind::Flagged => self.flagged += 1,
            Kind::Zero => self.zero += 1,
            Kind::PartlyNoNumber => self.partly += 1,
            Kind::Seen | Kind::Unsaid | Kind::NoNumber => {}
        }
    }

    fn note(&self, notes: &Notes) {
        if self.zero > 0 {
            notes.add(Note::ZeroReadAsMissing { samples: self.zero });
        }
        if self.garbage > 0 {
            notes.add(Note::ResidualGarbage { samples: self.garbage });
        }
        if self.stale > 0 && self.stale + self.flagged == self.samples {
            notes.add(Note::AllFlaggedMissing { with_coordinates: self.stale, samples: self.samples });
        } else if self.stale + self.partly > 0 {
            notes.add(Note::StaleCoordinates { samples: self.stale + self.partly });
        }
    }
}

/// Bytes that replace a sample.
pub(super) struct Patch {
    /// First byte of the sample in the file.
    pub offset: usize,
    bytes: [u8; 16],
    length: usize,
}

impl Patch {
    /// The new bytes of the sample.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or(&[])
    }
}

/// A position that is not exactly the origin: readers take that as missing.
/// This is one step of an integer file, and a millionth of the unit in a file of floats.
pub(super) const NOT_THE_ORIGIN: f32 = 1e-6;

/// The bytes that store a filled sample: its coordinates, residual 0, camera mask 0.
/// `place` names marker and frame in errors.
///
/// # Errors
/// Unsupported if the file cannot hold a coordinate.
pub(super) fn patch(
    layout: &Layout,
    frame: usize,
    column: usize,
    position_mm: [f64; 3],
    mm: f64,
    place: impl Fn() -> String,
) -> Result<Patch, FormatError> {
    let length = 4 * layout.storage.bytes();
    let offset = layout.start + frame * layout.frame_bytes + column * length;
    let refuse = |axis: usize, why: String| {
        let axis = ["x", "y", "z"].get(axis).copied().unwrap_or("?");
        let at = Place::Byte { offset: offset as u64, section: "points" };
        FormatError::unsupported(NAME, at, format!("the filled {axis} of {} {why}", place()))
    };
    let mut bytes = [0; 16];
    match layout.storage {
        Storage::Float => {
            let mut numbers = position_mm.map(|c| (c / mm) as f32);
            if numbers == [0.0; 3] {
                numbers = [NOT_THE_ORIGIN, 0.0, 0.0];
            }
            for (axis, (&number, cell)) in numbers.iter().zip(bytes.as_chunks_mut::<4>().0).enumerate() {
                *cell = layout.processor.put_f32(number).filter(|_| number.is_finite()).ok_or_else(|| {
                    refuse(axis, format!("is {number:e}, which a 32-bit float of this file cannot hold; the repair has run away"))
                })?;
            }
        }
        Storage::Integer => {
            let step_mm = layout.scale * mm;
            let mut steps = position_mm.map(|c| (c / step_mm).round());
            if steps == [0.0; 3] {
                steps = [1.0, 0.0, 0.0];
            }
            for (axis, (&step, cell)) in steps.iter().zip(bytes.as_chunks_mut::<2>().0).enumerate() {
                if step.abs() > 32767.0 || step.is_nan() {
                    return Err(refuse(
                        axis,
                        format!(
                            "is {:.1} mm, beyond the \u{b1}{:.1} mm that this file of integers can hold (POINT:SCALE \u{d7} 32767); write \
                             it as floats with --float, or to another format, such as .csv",
                            position_mm.get(axis).copied().unwrap_or(f64::NAN),
                            32767.0 * step_mm
                        ),
                    ));
                }
                *cell = layout.processor.put_i16(step as i16);
            }
        }
    }
    Ok(Patch { offset, bytes, length })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fourth_word() {
        let at = [1.0, 2.0, 3.0];
        for (xyz, word, expected) in [
            (at, 1.0, Kind::Seen),
            (at, 0.25, Kind::Seen),
            (at, 32767.0, Kind::Seen),
            (at, 0.0, Kind::Unsaid),
            (at, -0.0, Kind::Unsaid),
            (at, 1.7e38, Kind::Garbage),
            (at, f32::NAN, Kind::Garbage),
            (at, -1.0, Kind::Stale),
            (at, -32768.0, Kind::Stale),
            (at, 65535.0, Kind::Stale),
            (at, 32768.0, Kind::Stale),
            ([0.0; 3], 65535.0, Kind::Flagged),
            ([f32::NAN; 3], -1.0, Kind::Flagged),
            ([0.0; 3], 32767.0, Kind::Zero),
            ([0.0, -0.0, 0.0], 0.0, Kind::Zero),
            ([0.0, 0.0, 1e-30], 0.0, Kind::Unsaid),
            ([f32::NAN; 3], 0.0, Kind::NoNumber),
            ([f32::INFINITY, f32::NAN, f32::NAN], 0.0, Kind::NoNumber),
            ([1.0, f32::NAN, 2.0], 0.0, Kind::PartlyNoNumber),
        ] {
            assert_eq!(kind((xyz, word), Role::Marker), expected, "{xyz:?} {word}");
        }
        assert_eq!(kind(([0.0; 3], 0.0), Role::ModelOutput), Kind::Unsaid, "an angle of 0 is a value");
    }
}
