//! Writes a new file from a skeleton and its states: what tracking and solving end in.
//!
//! A joint of the file stands upright in the reference pose, so its OFFSET is the way from its parent's place to its own, in the axes of that pose,
//! and its rotation is that of its state.
//!
//! | in the skeleton | in the file |
//! | --- | --- |
//! | the root | `ROOT`, OFFSET 0 0 0, six channels: where it is, and how it is turned |
//! | a translate joint whose only child is a ball at the same place | one joint, of the ball's name |
//! | another translate joint below the root | six channels: OFFSET and shift together in place of OFFSET, and rotations that stay 0 |
//! | a ball | three rotation channels |
//! | a revolute joint about x, y or z | one rotation channel |
//! | about another axis | three rotation channels |
//! | a joint without children | an `End Site` |

use super::create::NAMES;
use super::euler::{self, Order, angles, unwrapped};
use super::{INFO, NAME};
use crate::rig::{JointKind, Skeleton};
use crate::text::fresh::{buffered, spelled};
use crate::{FormatError, Place};
use std::io::{self, Write};

/// Deeper than this, lines are not moved any farther in.
const DEEPEST_INDENT: usize = 40;
/// An axis is that of a channel if it differs from it by less than this.
const ALONG: f64 = 1e-12;
/// How far the columns of a rotation may be from a right-handed frame of length 1.
const CROOKED: f64 = 1e-3;
/// Nothing is as far away as this, in any unit.
const FARTHEST: f64 = super::motion::FARTHEST;

/// What a joint does in one frame, against the reference pose and in its axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum State {
    /// The shift of a translate joint, in the unit of the skeleton.
    Shift([f64; 3]),
    /// The angle of a revolute joint, in radians.
    Angle(f64),
    /// The rotation of a ball joint, row by row.
    Rotation([[f64; 3]; 3]),
}

/// A skeleton in motion.
#[derive(Clone, Debug)]
pub struct Motion<'a> {
    /// The skeleton.
    pub skeleton: &'a Skeleton,
    /// For each joint without children where its limb ends in the reference pose; those without one end where they are.
    /// Those of other joints are not written.
    pub ends: Vec<Option<[f64; 3]>>,
    /// Seconds from frame to frame.
    pub frame_secs: f64,
    /// The order of rotation channels.
    pub order: Order,
    /// For each frame the state of each joint.
    pub frames: &'a [Vec<State>],
}

/// A joint of the file.
struct Out {
    name: String,
    /// Its place in the skeleton.
    joint: usize,
    /// How many joints it is below the root.
    depth: usize,
    offset: [f64; 3],
    /// Where it is in the reference pose, as its position channels have it.
    place: [f64; 3],
    /// The translate joint that it takes its position channels from; the root has them in any case.
    shifted: Option<usize>,
    positions: bool,
    turned: Turned,
    /// Where its limb ends, from its place.
    end: Option<[f64; 3]>,
}

/// Where a joint of the file takes its rotation channels from.
#[derive(Clone, Copy)]
enum Turned {
    Never,
    /// One channel, about this axis of the file, from the angle of a joint times -1 or 1.
    Axis(usize, f64, usize),
    About([f64; 3], usize),
    Free(usize),
}

/// Writes a skeleton in motion. Lengths are in the unit of the skeleton, angles in degrees, all with six decimals; angles do not jump by more than
/// half a turn from frame to frame. Joints keep their names, except that blanks and brackets become `_`, and those that are the same get numbers.
///
/// # Errors
/// Unsupported: a skeleton that is none or has no joints, another number or type of states than the joints have, states and places that are no
/// numbers or farther away than anything can be, matrices that are no rotations, a time from frame to frame that is none.
/// Or an I/O error of `out`.
pub fn write_motion(motion: &Motion<'_>, out: &mut dyn Write) -> Result<(), FormatError> {
    check(motion)?;
    let joints = plan(motion);
    buffered(&INFO, out, |out| {
        write_hierarchy(&joints, motion.order, out)?;
        writeln!(out, "MOTION\nFrames: {}\nFrame Time: {}", motion.frames.len(), seconds(motion.frame_secs))?;
        let mut before = vec![None; joints.len()];
        let mut row = String::new();
        for states in motion.frames {
            row.clear();
            for (joint, before) in joints.iter().zip(&mut before) {
                joint.write_values(states, motion.order, before, &mut row);
            }
            writeln!(out, "{}", row.trim_end())?;
        }
        Ok(())
    })
}

/// What [`write_motion`] calls the joints of the file, in its order, each with its place in [`Skeleton::joints`].
pub fn motion_joints(motion: &Motion<'_>) -> Vec<(String, usize)> {
    plan(motion).into_iter().map(|out| (out.name, out.joint)).collect()
}

/// Seconds with enough digits for any program to tell the rate, which may know nothing of rates that are simple numbers.
fn seconds(secs: f64) -> String {
    let near = |text: &String| text.parse::<f64>().is_ok_and(|read| (read - secs).abs() <= 1e-9 * secs);
    (6..18).map(|decimals| format!("{secs:.decimals$}")).find(near).unwrap_or_else(|| format!("{secs}"))
}

fn refuse(text: String) -> FormatError {
    FormatError::unsupported(NAME, Place::Whole, text)
}

fn check(motion: &Motion<'_>) -> Result<(), FormatError> {
    let joints = &motion.skeleton.joints;
    if joints.is_empty() {
        return Err(refuse("the skeleton has no joints, so there is nothing to write".to_owned()));
    }
    if !(motion.frame_secs > 0.0 && motion.frame_secs.is_finite()) {
        return Err(refuse(format!("{} is no time from frame to frame", motion.frame_secs)));
    }
    let near = |place: &[f64; 3]| place.iter().all(|x| x.abs() < FARTHEST);
    for (at, joint) in joints.iter().enumerate() {
        if joint.parent.is_none() != (at == 0) || joint.parent.is_some_and(|parent| parent >= at) {
            return Err(refuse(format!("joint \"{}\" does not hang on one before it", joint.name)));
        }
        let end = motion.ends.get(at).copied().flatten().unwrap_or_default();
        let axis = if let JointKind::Revolute { axis } = joint.kind { axis } else { [0.0; 3] };
        if !near(&joint.centre) || !near(&end) || !near(&axis) {
            return Err(refuse(format!("joint \"{}\" has coordinates that are no numbers, or too large", joint.name)));
        }
    }
    for (frame, states) in motion.frames.iter().enumerate() {
        if states.len() != joints.len() {
            return Err(refuse(format!("frame {frame} has {} states, but there are {} joints", states.len(), joints.len())));
        }
        for (joint, state) in joints.iter().zip(states) {
            let fits = match (joint.kind, state) {
                (JointKind::Translate, State::Shift(shift)) => near(shift),
                (JointKind::Revolute { .. }, State::Angle(angle)) => angle.abs() < FARTHEST,
                (JointKind::Ball, State::Rotation(rotation)) => is_rotation(rotation),
                _ => false,
            };
            if !fits {
                return Err(refuse(format!("the state of joint \"{}\" in frame {frame} does not fit its type: {state:?}", joint.name)));
            }
        }
    }
    Ok(())
}

fn is_rotation([x, y, z]: &[[f64; 3]; 3]) -> bool {
    let dot = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    let is = |found: f64, expected: f64| (found - expected).abs() < CROOKED;
    is(dot(x, x), 1.0) && is(dot(y, y), 1.0) && is(dot(z, z), 1.0) && is(dot(x, y), 0.0) && is(dot(&cross, z), 1.0)
}

fn minus([x, y, z]: [f64; 3], [a, b, c]: [f64; 3]) -> [f64; 3] {
    [x - a, y - b, z - c]
}

/// The joints of the file, in its order: each before what hangs on it, and that before the next on the same parent.
fn plan(motion: &Motion<'_>) -> Vec<Out> {
    let joints = &motion.skeleton.joints;
    let names: Vec<(usize, &str)> = joints.iter().enumerate().map(|(at, joint)| (at, joint.name.as_str())).collect();
    let names = spelled(&NAMES, &names, &[], "names").labels;
    let mut children = vec![Vec::new(); joints.len()];
    for (at, joint) in joints.iter().enumerate() {
        if let Some(list) = joint.parent.and_then(|parent| children.get_mut(parent)) {
            list.push(at);
        }
    }
    let mut planned = Vec::with_capacity(joints.len());
    // a joint, the place of the one that it hangs on, and its depth
    let mut open = vec![(0, [0.0; 3], 0)];
    while let Some((mut at, from, depth)) = open.pop() {
        let Some(mut joint) = joints.get(at) else { continue };
        let mut below: &[usize] = children.get(at).map(Vec::as_slice).unwrap_or_default();
        let shifted = (joint.kind == JointKind::Translate).then_some(at);
        if let (Some(_), &[only]) = (shifted, below)
            && let Some(ball) = joints.get(only).filter(|ball| ball.kind == JointKind::Ball && ball.centre == joint.centre)
        {
            (at, joint) = (only, ball);
            below = children.get(only).map(Vec::as_slice).unwrap_or_default();
        }
        let place = joint.centre;
        let offset = if depth == 0 { [0.0; 3] } else { minus(place, from) };
        planned.push(Out {
            name: names.get(at).cloned().unwrap_or_default(),
            joint: at,
            depth,
            offset,
            place: if depth == 0 { place } else { offset },
            shifted,
            positions: depth == 0 || shifted.is_some(),
            turned: match joint.kind {
                JointKind::Translate => Turned::Never,
                JointKind::Ball => Turned::Free(at),
                JointKind::Revolute { axis } => match along(axis).filter(|_| depth > 0) {
                    Some((channel, sign)) => Turned::Axis(channel, sign, at),
                    None => Turned::About(axis, at),
                },
            },
            end: below.is_empty().then(|| motion.ends.get(at).copied().flatten().map_or([0.0; 3], |end| minus(end, place))),
        });
        open.extend(below.iter().rev().map(|&child| (child, place, depth + 1)));
    }
    planned
}

/// The axis of the file that this is, and 1, or -1 if it points the other way.
fn along(axis: [f64; 3]) -> Option<(usize, f64)> {
    let found = axis.iter().position(|x| (x.abs() - 1.0).abs() < ALONG)?;
    let others = axis.iter().enumerate().filter(|(at, _)| *at != found).all(|(_, x)| x.abs() < ALONG);
    axis.get(found).filter(|_| others).map(|x| (found, x.signum()))
}

impl Out {
    fn write_values(&self, states: &[State], order: Order, before: &mut Option<[f64; 3]>, row: &mut String) {
        if self.positions {
            let shift = match self.shifted.and_then(|at| states.get(at)) {
                Some(State::Shift(shift)) => *shift,
                _ => [0.0; 3],
            };
            for (x, shift) in self.place.iter().zip(shift) {
                push(x + shift, row);
            }
        }
        let last = before.unwrap_or_default();
        let turned = match self.turned {
            Turned::Never => Some([0.0; 3]),
            Turned::Axis(_, sign, at) => {
                let angle = if let Some(State::Angle(angle)) = states.get(at) { angle * sign } else { 0.0 };
                let angle = before.map_or(angle, |[last, ..]| unwrapped(angle, last));
                *before = Some([angle, 0.0, 0.0]);
                push(angle.to_degrees(), row);
                None
            }
            Turned::About(axis, at) => match states.get(at) {
                Some(State::Angle(angle)) => Some(angles(&euler::about(axis, *angle), order, last)),
                _ => Some(last),
            },
            Turned::Free(at) => match states.get(at) {
                Some(State::Rotation(rotation)) => Some(angles(rotation, order, last)),
                _ => Some(last),
            },
        };
        if let Some(turned) = turned {
            *before = Some(turned);
            for angle in turned {
                push(angle.to_degrees(), row);
            }
        }
    }

    fn channels(&self, order: Order) -> String {
        let rotation = |axis: usize| match axis {
            0 => "Xrotation",
            1 => "Yrotation",
            _ => "Zrotation",
        };
        let mut channels: Vec<&str> = if self.positions { vec!["Xposition", "Yposition", "Zposition"] } else { Vec::new() };
        match self.turned {
            Turned::Axis(axis, ..) => channels.push(rotation(axis)),
            _ => channels.extend(order.axes().map(rotation)),
        }
        format!("{} {}", channels.len(), channels.join(" "))
    }
}

/// Appends a number and a blank, with six decimals, and never `-0`.
fn push(value: f64, row: &mut String) {
    let text = format!("{value:.6} ");
    row.push_str(if text == "-0.000000 " { "0.000000 " } else { &text });
}

fn write_hierarchy(joints: &[Out], order: Order, out: &mut dyn Write) -> io::Result<()> {
    let triple = |[x, y, z]: [f64; 3]| {
        let mut text = String::new();
        for value in [x, y, z] {
            push(value, &mut text);
        }
        text.trim_end().to_owned()
    };
    let indent = |depth: usize| "\t".repeat(depth.min(DEEPEST_INDENT));
    writeln!(out, "HIERARCHY")?;
    let mut open = 0;
    for joint in joints {
        while open > joint.depth {
            open -= 1;
            writeln!(out, "{}}}", indent(open))?;
        }
        let (outside, inside) = (indent(joint.depth), indent(joint.depth + 1));
        let word = if joint.depth == 0 { "ROOT" } else { "JOINT" };
        writeln!(out, "{outside}{word} {}\n{outside}{{", joint.name)?;
        writeln!(out, "{inside}OFFSET {}\n{inside}CHANNELS {}", triple(joint.offset), joint.channels(order))?;
        if let Some(end) = joint.end {
            writeln!(out, "{inside}End Site\n{inside}{{\n{}OFFSET {}\n{inside}}}", indent(joint.depth + 2), triple(end))?;
        }
        open += 1;
    }
    while open > 0 {
        open -= 1;
        writeln!(out, "{}}}", indent(open))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
