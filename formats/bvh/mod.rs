//! BVH: a skeleton and, for every frame, a row of its joints' positions and angles. Read as where the joints are, and patched.
//!
//! `docs/formats/bvh.md` says what is read, written and assumed, and what real files do.
//! A saved file is the opened one, byte for byte, except for the numbers that have to change so that repaired joints are where they were filled.
//!
//! | file | holds |
//! | --- | --- |
//! | `scan` | bytes → words, lines |
//! | `hierarchy` | the text before MOTION → the skeleton |
//! | `motion` | the text behind it → rows |
//! | `kinematics` | a row → where every joint is |
//! | `fit` | where joints shall be → a row |
//! | `style` | how numbers are written |
//! | `save`, `create` | the way back |
//! | `skeleton_out`, `euler` | states of a [rig](crate::rig) → a new file |

mod create;
mod euler;
mod fit;
mod hierarchy;
mod kinematics;
mod motion;
mod save;
mod scan;
mod skeleton_out;
mod style;

use crate::{Document, Format, FormatError, FormatInfo, Leeway, Match, Note, Notes, Origin, Place, Stated, Take, TakeBuilder, Unit};
pub use euler::Order;
use hierarchy::Skeleton;
pub(crate) use hierarchy::{Channel, Node};
use kinematics::Positions;
use motion::{Head, Rows};
use scan::Cursor;
pub use skeleton_out::{Motion, State, motion_joints, write_motion};
use std::io::Write;
use style::Style;

const NAME: &str = "bvh";
static INFO: FormatInfo = FormatInfo {
    name: NAME,
    summary: "BVH, skeletons with joint angles, as positions of the joints",
    extensions: &["bvh"],
    holds_gaps: false,
};

/// Taken where the frame time is 0.
const ASSUMED_RATE_HZ: f64 = 30.0;
/// A skeleton whose box has a smaller diagonal than this is in metres ...
const LARGEST_IN_METRES: f64 = 10.0;
/// ... and one with a smaller than this in centimetres.
const LARGEST_IN_CENTIMETRES: f64 = 600.0;

/// What is lost between two ways to compute a distance.
const ROUND_OFF_MM: f64 = 1e-6;

/// The format.
#[derive(Clone, Copy, Debug)]
pub struct Bvh;

impl Format for Bvh {
    fn info(&self) -> &'static FormatInfo {
        &INFO
    }

    fn sniff(&self, head: &[u8]) -> Match {
        if Cursor::new(head).word().eq_ignore_ascii_case(b"hierarchy") { Match::Certain } else { Match::No }
    }

    fn open(&self, bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
        let mut cursor = Cursor::new(&bytes);
        let mut skeleton = Skeleton::read(&mut cursor)?;
        let head = Head::read(&mut cursor)?;
        let rows = Rows::find(&cursor, bytes.len(), skeleton.nodes.len())?;
        let first = rows.first(skeleton.channels)?;
        let positions = skeleton.meaning(&first);
        skeleton.cloud = skeleton.looks_like_cloud().filter(|_| rows.root_is_still(&skeleton));
        let markers = skeleton.markers();
        let frames = rows.starts.len();
        if head.claimed != frames as u64 {
            notes.add(Note::FrameCount { claimed: head.claimed, present: frames as u64 });
        }
        let rate_hz = stated.rate_hz.or(head.rate_hz).filter(|r| crate::is_a_rate(*r)).unwrap_or_else(|| {
            notes.add(Note::RateAssumed { rate_hz: ASSUMED_RATE_HZ });
            ASSUMED_RATE_HZ
        });
        let unit = stated.unit.or(skeleton.cloud).unwrap_or_else(|| {
            let unit = likely_unit(&skeleton, positions, &first);
            notes.add(Note::UnitAssumed { unit });
            unit
        });
        note_oddities(&skeleton, positions, notes);
        let mut builder = TakeBuilder::new(markers, frames, rate_hz).unit(unit).missing(&stated.missing);
        rows.read(&skeleton, positions, |frame, pose| {
            for (node, at) in skeleton.nodes.iter().zip(pose) {
                if let Some(column) = node.marker {
                    builder.set(frame, column, at.place.map(|x| x * unit.mm()), Origin::Measured);
                }
            }
        })?;
        let starts = rows.starts;
        let style = Style::of(&bytes, &starts);
        let known_mm = style.known_mm(&skeleton, unit);
        let take = builder.build();
        Ok(Box::new(BvhDocument { take, bytes, skeleton, starts, positions, style, known_mm }))
    }

    fn create(&self, take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
        create::create(take, out, notes)
    }
}

/// The joints and end sites of a file, whatever its motion is.
///
/// # Errors
/// The text before MOTION is malformed, or has too many joints.
pub(crate) fn joints(bytes: &[u8]) -> Result<Vec<Node>, FormatError> {
    Ok(Skeleton::read(&mut Cursor::new(bytes))?.nodes)
}

/// The unit in which a skeleton has a likely size: OFFSETs tell, or the first frame where they are all 0.
fn likely_unit(skeleton: &Skeleton, positions: Positions, first: &[f64]) -> Unit {
    let size = |values: &[f64], positions: Positions| {
        let mut pose = Vec::new();
        skeleton.pose(values, positions, &mut pose);
        motion::spread(pose.iter().map(|at| &at.place))
    };
    let at_rest = size(&vec![0.0; skeleton.channels], Positions::AddedToOffset);
    let diagonal = if at_rest > 0.0 { at_rest } else { size(first, positions) };
    match diagonal {
        0.0 => Unit::Centimetre,
        d if d < LARGEST_IN_METRES => Unit::Metre,
        d if d < LARGEST_IN_CENTIMETRES => Unit::Centimetre,
        _ => Unit::Millimetre,
    }
}

fn note_oddities(skeleton: &Skeleton, positions: Positions, notes: &Notes) {
    notes.duplicate_labels(skeleton.nodes.iter().filter(|n| n.marker.is_some()).map(|n| n.label.as_str()));
    let meaning = match positions {
        Positions::InPlaceOfOffset => return,
        Positions::AddedToOffset => "are added to their OFFSETs",
        Positions::InRoom => "are positions in the room, not relative to their parents",
    };
    let text = format!("the position channels of joints below the root {meaning}: only so do bones have the lengths of their OFFSETs");
    notes.add(Note::Assumed { text });
}

/// An opened file.
struct BvhDocument {
    take: Take,
    bytes: Vec<u8>,
    skeleton: Skeleton,
    /// Where each row begins.
    starts: Vec<usize>,
    positions: Positions,
    style: Style,
    /// How far joints that are not repaired may move in a row that changes.
    known_mm: f64,
}

impl Document for BvhDocument {
    fn take(&self) -> &Take {
        &self.take
    }

    fn save(&self, repaired: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
        if (repaired.frames(), repaired.markers.len()) != (self.take.frames(), self.take.markers.len()) {
            let text = "the repaired take is of another size than the opened file; write it to a new file";
            return Err(FormatError::unsupported(NAME, Place::Whole, text));
        }
        save::save(self, repaired, out, notes)
    }

    fn beyond_take(&self) -> Vec<String> {
        // a cloud of points has no bones
        let skeleton = self.skeleton.cloud.is_none();
        skeleton.then(|| "the skeleton and the rotations of its joints".to_owned()).into_iter().collect()
    }

    fn rounding_mm(&self) -> f64 {
        self.known_mm
    }

    fn leeway(&self, notes: &[Note]) -> Leeway {
        let noted = notes.iter().filter_map(|n| if let Note::NotRealised { worst_mm, .. } = n { Some(*worst_mm) } else { None });
        Leeway { known_mm: self.known_mm, filled_mm: noted.fold(self.known_mm, f64::max) + ROUND_OFF_MM }
    }
}

#[cfg(test)]
mod tests;
