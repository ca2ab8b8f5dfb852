//! Limits: `KBCST`, the number of joints with limits, and for each of these its name and numbers.
//!
//! | type | numbers |
//! | --- | --- |
//! | `translate` | the farthest along each axis |
//! | `revolute` | least and largest angle |
//! | `ball` | direction of the limb, its largest angle, a direction across the limb, its largest angle |
//!
//! The file does not tell the unit of its angles: see [`read_limits`].

use super::records::{head, how_many, joint, names, note_count, numbers, written};
use super::words::{Word, Words, excerpt, normalised};
use super::{JointKind, Limit, Skeleton};
use crate::{FormatError, Note, Notes, Place};
use std::f64::consts::TAU;
use std::io::{BufWriter, Write};

const NAME: &str = "cst";
const FIRST: &str = "KBCST";
/// The shortest direction.
const SHORTEST: f64 = 1e-9;

/// The unit of the angles of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AngleUnit {
    /// 360 are a whole turn.
    Degree,
    /// 2π are a whole turn.
    Radian,
}

impl AngleUnit {
    /// Radians of an angle in this unit.
    fn radians(self, angle: f64) -> f64 {
        match self {
            Self::Degree => angle.to_radians(),
            Self::Radian => angle,
        }
    }
}

/// Reads how far joints move: a place for each joint of the skeleton, `None` for those that the file does not name.
///
/// Angles become radians. Without a stated unit, the angles of a file of which one is beyond a whole turn of 2π in either direction are degrees,
/// which is noted; else they are radians. Directions get length 1.
///
/// # Errors
/// Malformed: a joint that is not in the skeleton or comes twice, another number of numbers than its type has, a least angle above the largest,
/// a largest angle or a distance below 0, a direction of length 0.
pub fn read_limits(bytes: &[u8], skeleton: &Skeleton, unit: Option<AngleUnit>, notes: &Notes) -> Result<Vec<Option<Limit>>, FormatError> {
    let mut words = Words::new(NAME, bytes);
    let claimed = head(&mut words, NAME, FIRST, "joints with limits")?;
    let names = names(skeleton);
    let mut limits: Vec<Option<Limit>> = vec![None; skeleton.joints.len()];
    let mut count = 0;
    while let Some(word) = words.word() {
        let at = joint(word, NAME, &names)?;
        let (Some(own), Some(limit)) = (skeleton.joints.get(at), limits.get_mut(at)) else { continue };
        if limit.is_some() {
            return Err(word.wrong(NAME, format!("\"{}\" has its limits twice; take one of them away", word.shown())));
        }
        let least = match own.kind {
            JointKind::Translate => 3,
            JointKind::Revolute { .. } => 2,
            JointKind::Ball => 8,
        };
        let found = numbers(&mut words, &names, least);
        if let Some(next) = words.clone().word()
            && found.len() < least
            && joint(next, NAME, &names).is_err()
        {
            let text = format!("\"{}\" found among the numbers of \"{}\", expected {}", next.shown(), word.shown(), wanted(own.kind));
            return Err(next.wrong(NAME, text));
        }
        *limit = Some(read_limit(word, own.kind, &found)?);
        count += 1;
    }
    note_count(notes, FIRST, "joints with limits", claimed, count);
    let unit = unit.unwrap_or_else(|| {
        let Some(angle) = limits.iter().flatten().flat_map(angles).find(|angle| angle.abs() > TAU) else { return AngleUnit::Radian };
        let text =
            format!("the limits do not name the unit of their angles; degrees assumed, because {angle} radians are more than a whole turn");
        notes.add(Note::Assumed { text });
        AngleUnit::Degree
    });
    for limit in limits.iter_mut().flatten() {
        match limit {
            Limit::Translate { .. } => {}
            Limit::Revolute { least, most } => (*least, *most) = (unit.radians(*least), unit.radians(*most)),
            Limit::Ball { heading_most, bank_most, .. } => {
                (*heading_most, *bank_most) = (unit.radians(*heading_most), unit.radians(*bank_most));
            }
        }
    }
    Ok(limits)
}

fn angles(limit: &Limit) -> Vec<f64> {
    match *limit {
        Limit::Translate { .. } => Vec::new(),
        Limit::Revolute { least, most } => vec![least, most],
        Limit::Ball { heading_most, bank_most, .. } => vec![heading_most, bank_most],
    }
}

/// What a joint needs, in words.
fn wanted(kind: JointKind) -> &'static str {
    match kind {
        JointKind::Translate => "three numbers: the farthest along each axis",
        JointKind::Revolute { .. } => "two numbers: its least and its largest angle",
        JointKind::Ball => {
            "eight numbers: the direction of the limb and its largest angle, a direction across the limb and its largest angle"
        }
    }
}

fn read_limit(word: Word<'_>, kind: JointKind, found: &[f64]) -> Result<Limit, FormatError> {
    let wrong = |text: String| word.wrong(NAME, text);
    let direction = |numbers: [f64; 3], what: &str| {
        normalised(numbers, SHORTEST).ok_or_else(|| {
            wrong(format!("the {what} direction of \"{}\" has no length; give a direction in the reference pose", word.shown()))
        })
    };
    let positive = |x: f64, what: &str| {
        if x >= 0.0 { Ok(x) } else { Err(wrong(format!("the {what} of \"{}\" is {x}, below 0; correct it", word.shown()))) }
    };
    match (kind, found) {
        (JointKind::Translate, &[x, y, z]) => {
            for x in [x, y, z] {
                positive(x, "farthest shift")?;
            }
            Ok(Limit::Translate { farthest: [x, y, z] })
        }
        (JointKind::Revolute { .. }, &[least, most]) if least > most => {
            Err(wrong(format!("the least angle of \"{}\", {least}, is above the largest, {most}; exchange them", word.shown())))
        }
        (JointKind::Revolute { .. }, &[least, most]) => Ok(Limit::Revolute { least, most }),
        (JointKind::Ball, &[hx, hy, hz, heading, bx, by, bz, bank]) => Ok(Limit::Ball {
            heading: direction([hx, hy, hz], "heading")?,
            heading_most: positive(heading, "largest angle of the heading")?,
            bank: direction([bx, by, bz], "bank")?,
            bank_most: positive(bank, "largest angle of the bank")?,
        }),
        _ => {
            let text = format!("\"{}\" has {} behind it, expected {}", word.shown(), how_many(found.len()), wanted(kind));
            Err(wrong(text))
        }
    }
}

/// Writes how far joints move, with angles in radians, or in degrees where an angle is more than a whole turn, which a reader would take for
/// degrees. `limits` has a place for each joint. Names are spelled as [`write_skeleton`](super::write_skeleton) spells them.
///
/// # Errors
/// Unsupported: a limit of another type than its joint, or one that is no number. Or an I/O error of `out`.
pub fn write_limits(limits: &[Option<Limit>], skeleton: &Skeleton, out: &mut dyn Write) -> Result<(), FormatError> {
    let turned = limits.iter().flatten().flat_map(angles).any(|angle| angle.abs() > TAU);
    let angle = |radians: f64| if turned { radians.to_degrees() } else { radians };
    let names = written(skeleton);
    let mut text = format!("{FIRST} {}\n", limits.iter().flatten().count());
    for (at, limit) in limits.iter().enumerate().filter_map(|(at, limit)| Some((at, (*limit)?))) {
        let (kind, name) = match (skeleton.joints.get(at), names.get(at)) {
            (Some(joint), Some(name)) => (joint.kind, name),
            _ => return Err(FormatError::unsupported(NAME, Place::Whole, format!("a limit for joint {at}, which is not there"))),
        };
        let numbers: Vec<f64> = match (kind, limit) {
            (JointKind::Translate, Limit::Translate { farthest }) => farthest.to_vec(),
            (JointKind::Revolute { .. }, Limit::Revolute { least, most }) => vec![angle(least), angle(most)],
            (JointKind::Ball, Limit::Ball { heading, heading_most, bank, bank_most }) => {
                let ([hx, hy, hz], [bx, by, bz]) = (heading, bank);
                vec![hx, hy, hz, angle(heading_most), bx, by, bz, angle(bank_most)]
            }
            _ => {
                let text = format!("the limit of joint \"{}\" belongs to a joint of another type", excerpt(name.as_bytes()));
                return Err(FormatError::unsupported(NAME, Place::Whole, text));
            }
        };
        if !numbers.iter().all(|x| x.is_finite()) {
            let text = format!("the limit of joint \"{}\" is no number", excerpt(name.as_bytes()));
            return Err(FormatError::unsupported(NAME, Place::Whole, text));
        }
        let numbers: Vec<String> = numbers.iter().map(|x| (x + 0.0).to_string()).collect(); // no "-0"
        text += &[name, " ", &numbers.join(" "), "\n"].concat();
    }
    let mut out = BufWriter::new(out);
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(|e| FormatError::io(NAME, e))
}
