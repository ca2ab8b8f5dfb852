//! Bones: pairs of markers whose distance hardly changes, found without a template or read from a file.
//!
//! What a bone is for the solvers, [`Bone`], is a pair of columns with a length and a spread; this file finds them.
//! Spread and length are robust: a label that jumps to another marker for a while must not hide a bone, nor invent one.

use crate::solve::{Bone, forest};
use formats::{Origin, Role, Take};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::fmt::Write;

/// Distances are taken from about this many frames, evenly over the take.
const FRAMES_LOOKED_AT: usize = 1200;

/// A pair seen together in fewer frames than this is no bone: its spread would mean nothing.
const LEAST_FRAMES: usize = 10;

/// A bone's length may vary by this share of itself ...
const MOST_RELATIVE_SPREAD: f64 = 0.08;

/// ... but not by more than this, in mm.
const MOST_SPREAD_MM: f64 = 20.0;

/// A bone is not longer than this, in mm: farther markers of one body do not share a segment.
const MOST_LENGTH_MM: f64 = 600.0;

/// Each marker keeps this many of its stiffest bones, besides those that connect the whole.
const PER_MARKER: usize = 3;

/// What 1 mm of length costs against 1 mm of spread when bones compete: of two equally stiff partners the nearer one is on the same segment.
const LENGTH_COST: f64 = 0.02;

/// Finds the bones between the markers for which `include` is true: a spanning forest of the stiffest pairs plus each marker's three best.
/// Ordered by their ends; lengths and spreads in mm.
pub fn find(take: &Take, include: &[bool]) -> Vec<Bone> {
    let markers: Vec<usize> = (0..take.markers.len())
        .filter(|&m| include.get(m).copied().unwrap_or(false) && take.markers.get(m).is_some_and(|k| k.role == Role::Marker))
        .collect();
    let stride = (take.frames() / FRAMES_LOOKED_AT).max(1);
    let tracks: Vec<Vec<Option<[f64; 3]>>> =
        markers.iter().map(|&m| (0..take.frames()).step_by(stride).map(|f| take.position_mm(f, m)).collect()).collect();
    let pairs = |k: usize| -> Vec<(f64, Bone)> {
        let (a, track_a) = (markers[k], &tracks[k]);
        let mut own = Vec::new();
        for (&b, track_b) in markers.iter().zip(&tracks).skip(k + 1) {
            let thin = distances(track_a, track_b);
            // rarely seen together: then every frame counts
            let measured = if thin.len() < 50 && stride > 1 { measure(take, a, b) } else { spread(thin) };
            let Some((length_mm, spread_mm)) = measured else { continue };
            let stiff = spread_mm <= (MOST_RELATIVE_SPREAD * length_mm).clamp(2.0, MOST_SPREAD_MM);
            if stiff && length_mm <= MOST_LENGTH_MM && length_mm > 0.0 {
                own.push((spread_mm + LENGTH_COST * length_mm, Bone { a, b, length_mm, spread_mm }));
            }
        }
        own
    };
    let mut candidates: Vec<(f64, Bone)> = (0..markers.len()).into_par_iter().flat_map_iter(pairs).collect();
    candidates.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.1.a, x.1.b).cmp(&(y.1.a, y.1.b))));
    let mut chosen = BTreeSet::new();
    let mut tree: Vec<usize> = (0..take.markers.len()).collect(); // union-find
    let mut degree = vec![0usize; take.markers.len()];
    for (at, (_, bone)) in candidates.iter().enumerate() {
        let (root_a, root_b) = (forest::root(&mut tree, bone.a), forest::root(&mut tree, bone.b));
        let connects = root_a != root_b;
        if connects && let Some(r) = tree.get_mut(root_a) {
            *r = root_b;
        }
        let wanted = [bone.a, bone.b].iter().any(|&m| degree.get(m).is_some_and(|&d| d < PER_MARKER));
        if connects || wanted {
            chosen.insert(at);
        }
        for m in [bone.a, bone.b] {
            if let Some(d) = degree.get_mut(m) {
                *d += 1;
            }
        }
    }
    let mut bones: Vec<Bone> = chosen.into_iter().map(|at| candidates[at].1).collect();
    bones.sort_by_key(|bone| (bone.a, bone.b));
    bones
}

/// How long a bone is in one frame, mm; `None` if an end is missing.
pub(crate) fn length_mm(take: &Take, bone: &Bone, frame: usize) -> Option<f64> {
    Some(distance(take.position_mm(frame, bone.a)?, take.position_mm(frame, bone.b)?))
}

/// True if an end of the bone was filled in this frame.
pub(crate) fn is_filled(take: &Take, bone: &Bone, frame: usize) -> bool {
    [bone.a, bone.b].iter().any(|&end| take.origin(frame, end) == Origin::Repaired)
}

/// Length and spread (mm) of one pair over all frames in which both are seen; `None` if those are too few.
pub fn measure(take: &Take, a: usize, b: usize) -> Option<(f64, f64)> {
    spread((0..take.frames()).filter_map(|f| Some(distance(take.position_mm(f, a)?, take.position_mm(f, b)?))).collect())
}

/// How far two places are apart, in their own unit.
#[inline]
pub(crate) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt()
}

fn distances(a: &[Option<[f64; 3]>], b: &[Option<[f64; 3]>]) -> Vec<f64> {
    a.iter().zip(b).filter_map(|(a, b)| Some(distance((*a)?, (*b)?))).collect()
}

/// Mean and standard deviation from the middle 90 % of the values: the mean of those, and the span of a Gaussian's 5th to 95th percentile.
fn spread(mut values: Vec<f64>) -> Option<(f64, f64)> {
    if values.len() < LEAST_FRAMES {
        return None;
    }
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    let at = |share: f64| {
        let place = share * last as f64;
        let low = place.floor() as usize;
        let high = (low + 1).min(last);
        values[low] + (values[high] - values[low]) * (place - low as f64)
    };
    let (low, high) = (at(0.05), at(0.95));
    let middle: Vec<f64> = values.iter().copied().filter(|v| (low..=high).contains(v)).collect();
    let mean = middle.iter().sum::<f64>() / middle.len().max(1) as f64;
    Some((mean, (high - low) / 3.29))
}

/// A bone as a file states it.
#[derive(Clone, Debug, PartialEq)]
pub struct StatedBone {
    /// Label of one end.
    pub a: String,
    /// Label of the other.
    pub b: String,
    /// Length in mm, if stated.
    pub length_mm: Option<f64>,
}

/// Why a file of bones could not be used.
#[derive(Debug, thiserror::Error)]
pub enum BonesError {
    /// A row cannot be read.
    #[error("line {line}: {problem}")]
    Row {
        /// Counted from 1.
        line: u64,
        /// What was found and what was expected.
        problem: String,
    },
    /// A marker of the file is not in the take.
    #[error("marker \"{label}\" is not in the take; it has {known}")]
    Unknown {
        /// As the file writes it.
        label: String,
        /// What the take has.
        known: String,
    },
    /// A bone from a marker to itself, or stated again.
    #[error("the bone {a} - {b} is stated twice or joins a marker to itself; delete it")]
    Twice {
        /// One end.
        a: String,
        /// The other.
        b: String,
    },
    /// There is nothing in the file.
    #[error("no bone was found, expected lines of: marker,marker[,length in mm]; leave --bones out to have them found")]
    Empty,
    /// A bone without a stated length whose ends are hardly ever seen together.
    #[error("{a} and {b} are seen together in fewer than {LEAST_FRAMES} frames, so the length must be stated (third column, mm)")]
    Unmeasurable {
        /// One end.
        a: String,
        /// The other.
        b: String,
    },
}

/// Reads a file of bones: `marker,marker[,length in mm]` per line. A first line that names the columns, empty lines and lines that start with `#` are skipped.
///
/// # Errors
/// A row that is not of this form.
pub fn parse(text: &[u8]) -> Result<Vec<StatedBone>, BonesError> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).comment(Some(b'#')).trim(csv::Trim::All).from_reader(text);
    let mut bones = Vec::new();
    for (at, record) in reader.records().enumerate() {
        let record = record.map_err(|e| BonesError::Row {
            line: e.position().map_or(at as u64 + 1, csv::Position::line),
            problem: "not text in CSV form, expected: marker,marker[,length in mm]".to_owned(),
        })?;
        let line = record.position().map_or(at as u64 + 1, csv::Position::line);
        let cells: Vec<&str> = record.iter().collect();
        if at == 0 && cells.first().is_some_and(|c| c.eq_ignore_ascii_case("marker") || c.eq_ignore_ascii_case("marker_a")) {
            continue;
        }
        let (Some(a), Some(b)) = (cells.first().filter(|c| !c.is_empty()), cells.get(1).filter(|c| !c.is_empty())) else {
            return Err(BonesError::Row { line, problem: format!("{} cells found, expected: marker,marker[,length in mm]", cells.len()) });
        };
        let length_mm = match cells.get(2).filter(|c| !c.is_empty()) {
            None => None,
            Some(cell) => match cell.parse::<f64>() {
                Ok(length) if length.is_finite() && length > 0.0 => Some(length),
                _ => return Err(BonesError::Row { line, problem: format!("\"{cell}\" is not a length in mm") }),
            },
        };
        bones.push(StatedBone { a: (*a).to_owned(), b: (*b).to_owned(), length_mm });
    }
    Ok(bones)
}

/// Turns stated bones into bones of a take. A label matches as written or without its subject's prefix. Without a stated length the take's own is measured.
///
/// # Errors
/// A marker that the take does not have, or a length that can be neither read nor measured.
pub fn resolve(stated: &[StatedBone], take: &Take) -> Result<Vec<Bone>, BonesError> {
    let column = |label: &str| {
        let exact = take.markers.iter().position(|m| m.label == label);
        exact.or_else(|| take.markers.iter().position(|m| m.name() == label)).ok_or_else(|| BonesError::Unknown {
            label: label.to_owned(),
            known: (0..take.markers.len()).map(|m| take.display_label(m)).collect::<Vec<_>>().join(", "),
        })
    };
    if stated.is_empty() {
        return Err(BonesError::Empty);
    }
    let mut seen = BTreeSet::new();
    stated
        .iter()
        .map(|bone| {
            let (a, b) = (column(&bone.a)?, column(&bone.b)?);
            if a == b || !seen.insert((a.min(b), a.max(b))) {
                return Err(BonesError::Twice { a: bone.a.clone(), b: bone.b.clone() });
            }
            let measured = measure(take, a, b);
            let (length_mm, spread_mm) = match (bone.length_mm, measured) {
                (Some(length), measured) => (length, measured.map_or(STATED_SPREAD_MM, |(_, spread)| spread)),
                (None, Some(measured)) => measured,
                (None, None) => return Err(BonesError::Unmeasurable { a: bone.a.clone(), b: bone.b.clone() }),
            };
            Ok(Bone { a: a.min(b), b: a.max(b), length_mm, spread_mm })
        })
        .collect()
}

/// How much a bone is believed to vary if the take cannot tell, mm.
const STATED_SPREAD_MM: f64 = 3.0;

/// Writes bones in the form that [`parse`] reads, with the measured spread in a fourth column.
pub fn write(bones: &[Bone], take: &Take) -> String {
    let mut out = String::from("marker_a,marker_b,length_mm,spread_mm\n");
    for bone in bones {
        let cells = [take.display_label(bone.a), take.display_label(bone.b)].map(|label| quoted(&label));
        let _ = writeln!(out, "{},{},{:.2},{:.2}", cells[0], cells[1], bone.length_mm, bone.spread_mm); // a String takes everything
    }
    out
}

/// A cell as CSV wants it.
pub fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.to_owned() }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use formats::{Marker, Origin, TakeBuilder};

    /// A and B on one stick, C on another that swings around; D never seen.
    fn take() -> Take {
        let mut b = TakeBuilder::new(["s:A", "s:B", "s:C", "s:D"].map(Marker::new).to_vec(), 200, 100.0);
        for f in 0..200usize {
            let angle = f as f64 * 0.05;
            let base = [f as f64 * 5.0, 0.0, 1000.0];
            b.set(f, 0, base, Origin::Measured);
            b.set(f, 1, [base[0] + 300.0, base[1], base[2] + (f % 3) as f64], Origin::Measured);
            b.set(f, 2, [base[0] + 300.0 + 250.0 * angle.cos(), 250.0 * angle.sin(), base[2]], Origin::Measured);
        }
        // a swapped label for a few frames must not hide the bone
        for f in 50..55 {
            b.set(f, 1, [0.0, 0.0, 0.0], Origin::Measured);
        }
        b.build()
    }

    #[test]
    fn stiff_pairs_are_bones_and_swinging_ones_are_not() {
        let t = take();
        let bones = find(&t, &[true; 4]);
        let pairs: Vec<(usize, usize)> = bones.iter().map(|b| (b.a, b.b)).collect();
        assert_eq!(pairs, [(0, 1), (1, 2)]);
        assert!((bones[0].length_mm - 300.0).abs() < 0.1 && bones[0].spread_mm < 1.0, "{bones:?}");
        assert!(find(&t, &[true, false, true, true]).is_empty());
    }

    #[test]
    fn a_file_of_bones_is_read_and_written() {
        let t = take();
        let stated = parse(b"marker,marker,length\n# thigh\ns:A, B\nC,s:B,260\n").unwrap();
        let bones = resolve(&stated, &t).unwrap();
        assert_eq!((bones[1].a, bones[1].b, bones[1].length_mm), (1, 2, 260.0));
        assert!((bones[0].length_mm - 300.0).abs() < 0.1);
        let again = resolve(&parse(write(&bones, &t).as_bytes()).unwrap(), &t).unwrap();
        assert_eq!(again.len(), 2);
        for (text, message) in [
            (&b"A\n"[..], "line 1: 1 cells found, expected: marker,marker[,length in mm]"),
            (b"A,B,long\n", "line 1: \"long\" is not a length in mm"),
            (b"A,B\n\xff\xfe,C\n", "line 2: not text in CSV form, expected: marker,marker[,length in mm]"),
        ] {
            assert_eq!(parse(text).unwrap_err().to_string(), message);
        }
        let unknown = resolve(&parse(b"A,Z\n").unwrap(), &t).unwrap_err().to_string();
        assert_eq!(unknown, "marker \"Z\" is not in the take; it has s:A, s:B, s:C, s:D");
        for text in [&b"A,A\n"[..], b"A,B\nB,A\n"] {
            assert!(resolve(&parse(text).unwrap(), &t).unwrap_err().to_string().contains("twice or joins a marker to itself"));
        }
        assert!(resolve(&[], &t).unwrap_err().to_string().contains("no bone was found"));
        assert!(resolve(&parse(b"A,D\n").unwrap(), &t).unwrap_err().to_string().contains("must be stated"));
    }
}
