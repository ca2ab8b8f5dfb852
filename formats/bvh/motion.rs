//! The text behind MOTION → where every joint is in every frame.
//!
//! A row is a line. Rows are turned into positions one by one, so that the angles of the whole take are never held at once.

use super::NAME;
use super::hierarchy::Skeleton;
use super::kinematics::{Positions, Stand, apart, length};
use super::scan::{Cursor, decimals, excerpt, number, values};
use crate::text::clock::simplest_rate;
use crate::{FormatError, Place};

/// A table of positions may have this many cells for each byte of the file ...
const CELLS_PER_BYTE: usize = 1;
/// ... or this many in all.
const CELLS_ALWAYS: usize = 1 << 20;
/// Nothing is as far away as this, in any unit.
pub(super) const FARTHEST: f64 = 1e12;
/// A frame time whose last decimal leaves the rate this open (as a share) is taken as it is printed.
const OPEN_RATE: f64 = 2e-3;

/// What stands between MOTION and the first row.
#[derive(Clone, Debug)]
pub(super) struct Head {
    /// Rows that the file claims to have.
    pub claimed: u64,
    /// Frames per second; `None` if the frame time is 0.
    pub rate_hz: Option<f64>,
}

/// The rows of a file, found but not yet read.
#[derive(Clone, Debug)]
pub(super) struct Rows<'a> {
    /// Stands before the first row.
    cursor: Cursor<'a>,
    /// Offset of each row.
    pub starts: Vec<usize>,
}

impl Head {
    /// Reads `Frames:` and `Frame Time:`.
    pub fn read(cursor: &mut Cursor<'_>) -> Result<Self, FormatError> {
        if !cursor.key(&["frames"]) {
            let found = excerpt(cursor.next_word());
            return Err(cursor.wrong(format!("\"{found}\" found, expected \"Frames:\" and their number behind MOTION")));
        }
        let word = cursor.word();
        let claimed = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
        let claimed = claimed.ok_or_else(|| cursor.wrong(format!("\"{}\" found, expected the number of frames", excerpt(word))))?;
        if !cursor.key(&["frame", "time"]) {
            let found = excerpt(cursor.next_word());
            return Err(cursor.wrong(format!("\"{found}\" found, expected \"Frame Time:\" and seconds behind the number of frames")));
        }
        let word = cursor.word();
        let secs = number(word).filter(|secs| *secs >= 0.0 && (*secs == 0.0 || (1.0 / secs).is_finite()));
        let secs = secs.ok_or_else(|| cursor.wrong(format!("\"{}\" found, expected the seconds from frame to frame", excerpt(word))))?;
        Ok(Self { claimed, rate_hz: (secs > 0.0).then(|| rate(secs, decimals(word))) })
    }
}

/// The rate that a frame time with so many decimals stands for: `.0083333` is 120 Hz, `0.0417083750417` is 23.976 Hz.
fn rate(secs: f64, decimals: usize) -> f64 {
    let step = 10_f64.powi(-i32::try_from(decimals).unwrap_or(i32::MAX));
    if step <= OPEN_RATE * secs { simplest_rate(0.0, secs, 1.0, step) } else { 1.0 / secs }
}

/// The rate that a written frame time stands for.
pub(super) fn rate_of(written: &str) -> Option<f64> {
    number(written.as_bytes()).map(|secs| rate(secs, decimals(written.as_bytes())))
}

/// Reads the values of a row into `row`, which has a place for each channel.
///
/// # Errors
/// Too many, too few, or something else than numbers.
pub(super) fn read_row(text: &[u8], line: u64, row: &mut [f64]) -> Result<(), FormatError> {
    let wrong = |column: Option<usize>, text: String| {
        let column = column.map(|c| c as u64 + 1);
        Err(FormatError::malformed(NAME, Place::Line { line, column }, text))
    };
    let mut words = values(text);
    let count = row.len();
    for (column, value) in row.iter_mut().enumerate() {
        let Some((_, word)) = words.next() else {
            let text =
                format!("the row has {column} values, the joints have {count} channels; nothing was skipped, complete or delete this row");
            return wrong(None, text);
        };
        *value = match number(word) {
            Some(value) => value,
            None => return wrong(Some(column), format!("\"{}\" found, expected a number for each of {count} channels", excerpt(word))),
        };
    }
    let more = words.count();
    if more > 0 {
        let text = format!("the row has {} values, the joints have {count} channels; nothing was skipped, correct this row", count + more);
        return wrong(None, text);
    }
    Ok(())
}

impl<'a> Rows<'a> {
    /// Finds the rows of a file of `size` bytes, which make a take of so many columns.
    pub fn find(cursor: &Cursor<'a>, size: usize, columns: usize) -> Result<Self, FormatError> {
        let mut ahead = cursor.clone();
        let mut starts = Vec::new();
        while let Some((start, text)) = ahead.row() {
            if starts.is_empty() {
                // as many rows like this one as the rest of the file has room for
                starts.reserve(size.saturating_sub(start) / (text.len() + 1) + 1);
            }
            starts.push(start);
        }
        if columns.saturating_mul(starts.len()) > size.saturating_mul(CELLS_PER_BYTE).max(CELLS_ALWAYS) {
            let text = format!(
                "{columns} joints and end sites in each of {} frames, but only {size} bytes; too many joints have no values of their own",
                starts.len()
            );
            return Err(FormatError::too_large(NAME, Place::Whole, text));
        }
        Ok(Self { cursor: cursor.clone(), starts })
    }

    /// The values of the first row; zeros if there is none.
    pub fn first(&self, channels: usize) -> Result<Vec<f64>, FormatError> {
        let mut row = vec![0.0; channels];
        let mut cursor = self.cursor.clone();
        if let Some((_, text)) = cursor.row() {
            read_row(text, cursor.line(), &mut row)?;
        }
        Ok(row)
    }

    /// True if no row moves or turns the root.
    pub fn root_is_still(&self, skeleton: &Skeleton) -> bool {
        let Some(root) = skeleton.nodes.first() else { return false };
        let mut cursor = self.cursor.clone();
        std::iter::from_fn(|| cursor.row()).all(|(_, text)| {
            let mut own = values(text).skip(root.first_channel).take(root.channels.len());
            own.all(|(_, word)| number(word) == Some(0.0))
        })
    }

    /// Reads all rows, and hands on how everything stands in each frame.
    pub fn read(&self, skeleton: &Skeleton, positions: Positions, mut take: impl FnMut(usize, &[Stand])) -> Result<(), FormatError> {
        let mut cursor = self.cursor.clone();
        let mut row = vec![0.0; skeleton.channels];
        let mut pose: Vec<Stand> = Vec::with_capacity(skeleton.nodes.len());
        for frame in 0..self.starts.len() {
            let Some((_, text)) = cursor.row() else { break };
            read_row(text, cursor.line(), &mut row)?;
            skeleton.pose(&row, positions, &mut pose);
            let far = skeleton.nodes.iter().zip(&pose).find(|(_, at)| !at.place.iter().all(|x| x.abs() < FARTHEST));
            if let Some((node, _)) = far {
                let text = format!(
                    "joint \"{}\" is farther away than anything can be; correct the values of this row",
                    excerpt(node.label.as_bytes())
                );
                return Err(cursor.wrong(text));
            }
            take(frame, &pose);
        }
        Ok(())
    }
}

/// The diagonal of the box around some places.
pub(super) fn spread<'a>(places: impl Iterator<Item = &'a [f64; 3]>) -> f64 {
    let (mut least, mut most) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for place in places {
        for ((least, most), x) in least.iter_mut().zip(&mut most).zip(place) {
            *least = least.min(*x);
            *most = most.max(*x);
        }
    }
    let diagonal = length(apart(most, least));
    if diagonal.is_finite() { diagonal } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_times_as_printed() {
        for (text, expected) in [
            (".0083333", 120.0),
            ("0.008333", 120.0),
            ("0.033333", 30.0),
            ("0.0333333", 30.0),
            ("0.041667", 24.0),
            ("0.0417083750417", 23.976),
            ("0.016666666666666666", 60.0),
            ("0.038462", 26.0),
            ("0.04", 25.0),
            ("0.01", 100.0),
            ("0.00333333", 300.0),
            ("8.33333e-3", 120.0),
            ("1", 1.0),
        ] {
            assert_eq!(rate_of(text), Some(expected), "{text}");
        }
        // too few digits to say more than they say
        assert_eq!(rate_of("0.033"), Some(1.0 / 0.033));
    }
}
