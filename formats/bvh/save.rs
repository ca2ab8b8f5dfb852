//! Writes an opened file again: every byte as it was, except for numbers of rows in which something was repaired.

use super::fit::Fitter;
use super::kinematics::{apart, length};
use super::motion::read_row;
use super::scan::{number, values};
use super::{BvhDocument, NAME};
use crate::{FormatError, Note, Notes, Origin, Take};
use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};

/// What could not be done.
#[derive(Default)]
struct Missed {
    samples: usize,
    worst_mm: f64,
}

/// Writes the file with the [`Origin::Repaired`] samples of `repaired`.
pub(super) fn save(document: &BvhDocument, repaired: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
    let mut out = BufWriter::with_capacity(1 << 16, out);
    let missed = write(document, repaired, &mut out).map_err(|e| FormatError::io(NAME, e))?;
    if missed.samples > 0 {
        notes.add(Note::NotRealised { samples: missed.samples, worst_mm: missed.worst_mm });
    }
    Ok(())
}

fn write(document: &BvhDocument, repaired: &Take, out: &mut dyn Write) -> io::Result<Missed> {
    let unit_mm = document.take.unit.mm();
    let fitter = Fitter::new(&document.skeleton, document.positions, unit_mm);
    let markers: BTreeMap<usize, usize> = document.skeleton.nodes.iter().enumerate().filter_map(|(at, n)| Some((n.marker?, at))).collect();
    let mut missed = Missed::default();
    let mut previous: Option<(usize, Vec<f64>)> = None;
    let mut done = 0;
    for (frame, &start) in document.starts.iter().enumerate() {
        let filled = (0..repaired.markers.len()).filter(|&m| repaired.origin(frame, m) == Origin::Repaired);
        let wanted: BTreeMap<usize, [f64; 3]> =
            filled.filter_map(|m| Some((*markers.get(&m)?, repaired.position_mm(frame, m)?.map(|x| x / unit_mm)))).collect();
        if wanted.is_empty() {
            continue;
        }
        let text = row_text(&document.bytes, start);
        let mut row = vec![0.0; document.skeleton.channels];
        if read_row(text, 0, &mut row).is_err() {
            continue; // it was read before
        }
        let start_from = previous.as_ref().filter(|(at, _)| at + 1 == frame).map(|(_, values)| values.as_slice());
        let (patched, values) = patch(document, repaired, &fitter, frame, (text, &row), &wanted, start_from, &mut missed);
        out.write_all(document.bytes.get(done..start).unwrap_or_default())?;
        out.write_all(&patched)?;
        done = start + text.len();
        previous = Some((frame, values));
    }
    out.write_all(document.bytes.get(done..).unwrap_or_default())?;
    out.flush()?;
    Ok(missed)
}

fn row_text(bytes: &[u8], start: usize) -> &[u8] {
    let rest = bytes.get(start..).unwrap_or_default();
    rest.split(|&b| matches!(b, b'\n' | b'\r')).next().unwrap_or_default()
}

/// The text of a row with its joints where they are wanted, and its values.
#[allow(clippy::too_many_arguments)] // one row, and all that it depends on
fn patch(
    document: &BvhDocument,
    repaired: &Take,
    fitter: &Fitter<'_>,
    frame: usize,
    (text, row): (&[u8], &[f64]),
    wanted: &BTreeMap<usize, [f64; 3]>,
    previous: Option<&[f64]>,
    missed: &mut Missed,
) -> (Vec<u8>, Vec<f64>) {
    let known = |node: &super::hierarchy::Node| node.marker.is_some_and(|m| repaired.origin(frame, m).is_known());
    let before = fitter.pose(row);
    let off = |values: &[f64]| -> Vec<f64> {
        let pose = fitter.pose(values);
        wanted.iter().filter_map(|(&at, place)| Some(length(apart(pose.get(at)?.place, *place)) * fitter.unit_mm)).collect()
    };
    let worst = |off: &[f64]| off.iter().copied().fold(0.0, f64::max);
    let mut best = (text.to_vec(), row.to_vec());
    let mut best_off = off(row);
    if worst(&best_off) > document.known_mm {
        let mut fitted = row.to_vec();
        fitter.fit(&mut fitted, wanted, previous);
        let (new_text, new_row) = spell(document, text, row, &fitted);
        // What a reader will see, rounded as it is written: if it moves what is known, or helps nobody, the row stays.
        let pose = fitter.pose(&new_row);
        let moved = document.skeleton.nodes.iter().zip(before.iter().zip(&pose)).filter(|(n, _)| known(n));
        let moved_mm = moved.map(|(_, (was, is))| length(apart(was.place, is.place)) * fitter.unit_mm).fold(0.0, f64::max);
        let new_off = off(&new_row);
        let squares = |off: &[f64]| off.iter().map(|d| d * d).sum::<f64>();
        if moved_mm <= document.known_mm && squares(&new_off) < squares(&best_off) {
            (best, best_off) = ((new_text, new_row), new_off);
        }
    }
    missed.samples += best_off.iter().filter(|d| **d > document.known_mm).count();
    missed.worst_mm = missed.worst_mm.max(worst(&best_off));
    best
}

/// The row with the numbers that differ exchanged, and the values that it then holds.
fn spell(document: &BvhDocument, text: &[u8], was: &[f64], is: &[f64]) -> (Vec<u8>, Vec<f64>) {
    let mut angle = vec![false; was.len()];
    for (at, channel) in document.skeleton.nodes.iter().flat_map(super::hierarchy::Node::channels) {
        if let Some(angle) = angle.get_mut(at) {
            *angle = matches!(channel, super::hierarchy::Channel::Rotation(_));
        }
    }
    let mut out = Vec::with_capacity(text.len() + 64);
    let mut row = was.to_vec();
    let mut done = 0;
    let mut new = Vec::new();
    for ((start, word), (value, (wanted, angle))) in values(text).zip(row.iter_mut().zip(is.iter().zip(angle))) {
        if *wanted == *value {
            continue;
        }
        new.clear();
        document.style.write(*wanted, angle, document.take.unit, &mut new);
        let mut old = Vec::new();
        document.style.write(*value, angle, document.take.unit, &mut old);
        if new == old {
            continue; // the same number, as far as it is written
        }
        out.extend_from_slice(text.get(done..start).unwrap_or_default());
        out.extend_from_slice(&new);
        done = start + word.len();
        *value = number(&new).unwrap_or(*value);
    }
    out.extend_from_slice(text.get(done..).unwrap_or_default());
    (out, row)
}
