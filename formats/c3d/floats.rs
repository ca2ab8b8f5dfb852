//! A file of integers as a file of floats, for a repair that integers cannot hold.
//!
//! | part | in the new file |
//! | --- | --- |
//! | header, parameters | byte for byte, but both scales of the points negative, which is how a C3D says "floats" |
//! | coordinates | integer × scale, as 32-bit floats of the same processor |
//! | fourth word | the same 16-bit number as a float: camera mask and residual mean what they meant, −1 stays −1 |
//! | analog words | the same number as a float, unsigned where ANALOG:FORMAT says so; their scales and offsets are parameters and stay |
//! | behind the samples | zeros: again up to a whole block, if they were; anything else: as it was |
//!
//! The data begin where they began, so nothing that points at them changes.
//! The new file is laid out anew before it is returned: unless a reader finds the same frames and points in it, it is refused.
//! Rotations have a place of their own behind the points, which would move: a file with rotations is refused as well.

use super::NAME;
use super::layout::{self, Layout, Storage};
use super::parameters::{BLOCK, Parameters};
use super::processor::Processor;
use crate::{FormatError, Notes, Place};

/// Where the scale of the points is in the header.
const HEADER_SCALE: usize = 12;

fn refused(text: impl Into<String>) -> FormatError {
    FormatError::unsupported(NAME, Place::Whole, text)
}

/// The file of `bytes`, laid out as `layout` says, with floats instead of integers. `None` if it has no points, or floats already.
///
/// # Errors
/// Unsupported if a coordinate has no 32-bit float, or something that points into the file would point elsewhere.
pub(super) fn convert(layout: &Layout, bytes: &[u8]) -> Result<Option<Vec<u8>>, FormatError> {
    if layout.storage == Storage::Float || layout.points == 0 {
        return Ok(None);
    }
    let parameters = Parameters::read(bytes, &Notes::new())?;
    if parameters.number("ROTATION", "USED").is_some_and(|used| used > 0.0) {
        return Err(refused("the file has rotations behind its points, which would no longer be found there; write .csv instead"));
    }
    let mut new = head(&parameters, layout, bytes)?;
    let unsigned =
        parameters.texts("ANALOG", "FORMAT").and_then(|t| t.into_iter().next()).is_some_and(|t| t.eq_ignore_ascii_case("UNSIGNED"));
    let samples = layout.frames.saturating_mul(layout.frame_bytes);
    let rest_at = layout.start.saturating_add(samples);
    let data = bytes.get(layout.start..rest_at).unwrap_or(&[]);
    new.reserve_exact(2 * data.len() + BLOCK);
    for frame in data.chunks_exact(layout.frame_bytes.max(1)) {
        let (points, analog) = frame.split_at_checked(layout.points * 8).unwrap_or((frame, &[]));
        for sample in points.as_chunks::<2>().0.as_chunks::<4>().0 {
            let [x, y, z, word] = sample.map(|w| layout.processor.u16(w).cast_signed());
            for step in [x, y, z] {
                new.extend(coordinate(layout, step)?);
            }
            new.extend(whole(layout.processor, f32::from(word))?);
        }
        for word in analog.as_chunks::<2>().0 {
            let word = layout.processor.u16(*word);
            new.extend(whole(layout.processor, if unsigned { f32::from(word) } else { f32::from(word.cast_signed()) })?);
        }
    }
    // What is behind the samples, as it was, and then without the zeros that only completed the last block there: the first that is read
    // as the same take.
    let rest = bytes.get(rest_at..).unwrap_or(&[]);
    let end = new.len();
    let zeros = rest.iter().all(|&b| b == 0);
    let padded = end.next_multiple_of(BLOCK);
    let tails: &[(usize, &[u8])] = match (zeros, rest.is_empty()) {
        (_, true) => &[(end, &[])],
        (true, false) => &[(padded, &[]), (end, &[])],
        (false, false) => &[(end, rest)],
    };
    for (length, tail) in tails {
        new.truncate(end);
        new.resize(*length, 0);
        new.extend_from_slice(tail);
        if reads_alike(layout, &new) {
            return Ok(Some(new));
        }
    }
    Err(refused(format!(
        "stored as floats, the {} frames of this file would no longer fit its own counts and sizes, which contradict each other; write .csv \
         instead",
        layout.frames
    )))
}

/// Everything before the samples, with the scales of the points negative.
fn head(parameters: &Parameters<'_>, layout: &Layout, bytes: &[u8]) -> Result<Vec<u8>, FormatError> {
    let scales = parameters.floats_at("POINT", "SCALE");
    if parameters.end > layout.start || parameters.number("POINT", "SCALE").is_some() && scales.is_empty() {
        return Err(refused("its parameters are not where or what they should be, so it cannot be stored as floats; write .csv instead"));
    }
    let mut head = bytes.get(..layout.start).unwrap_or(bytes).to_vec();
    for at in scales.into_iter().chain([HEADER_SCALE]) {
        let Some(cell) = head.get_mut(at..).and_then(<[u8]>::first_chunk_mut::<4>) else { continue };
        let own = layout.processor.f32(*cell).abs();
        // A residual is a number of scale steps, so each scale keeps its size, even if it contradicts the other.
        let size = if own.is_normal() { own } else { layout.scale as f32 };
        *cell = layout.processor.put_f32(-size).ok_or_else(|| refused(format!("the scale {size:e} has no negative number")))?;
    }
    Ok(head)
}

/// A coordinate. The product is exact in 64 bits, and rounded once.
fn coordinate(layout: &Layout, step: i16) -> Result<[u8; 4], FormatError> {
    let number = (f64::from(step) * layout.scale) as f32;
    layout
        .processor
        .put_f32(number)
        .filter(|&bytes| number.is_finite() && (step == 0) == (layout.processor.f32(bytes) == 0.0))
        .ok_or_else(|| refused(format!("{step} steps of {:e} have no 32-bit float of this file; write .csv instead", layout.scale)))
}

/// A whole number of 16 bits, which every processor has.
fn whole(processor: Processor, number: f32) -> Result<[u8; 4], FormatError> {
    processor.put_f32(number).ok_or_else(|| refused(format!("{number} has no 32-bit float")))
}

/// True if a reader finds the same frames and points, as floats.
fn reads_alike(was: &Layout, new: &[u8]) -> bool {
    let notes = Notes::new();
    let Ok(parameters) = Parameters::read(new, &notes) else { return false };
    layout::choose(&parameters, new, &notes).is_ok_and(|is| {
        let frame_bytes = 2 * was.frame_bytes;
        let expected = Layout { storage: Storage::Float, frame_bytes, scale: is.scale, ..*was };
        is == expected
    })
}
