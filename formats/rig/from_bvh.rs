//! The hierarchy of a BVH file → a skeleton in the pose in which all its channels are 0.
//!
//! | in the file | becomes |
//! | --- | --- |
//! | ROOT | a translate joint, and at the same place what its rotations make it |
//! | three rotation channels, or two | a ball joint |
//! | one rotation channel | a revolute joint about that axis |
//! | position channels only | a translate joint |
//! | no channels | nothing; what hangs on it hangs on its parent |
//! | End Site | nothing |

use super::records::{NAMES, NOBODY};
use super::{Joint, JointKind, Skeleton};
use crate::bvh::{Channel, Node, joints};
use crate::note::listed;
use crate::text::fresh::spelled;
use crate::{FormatError, Note, Notes, Place};

const NAME: &str = "bvh";
/// Nothing is as far away as this, in any unit.
const FARTHEST: f64 = 1e12;

/// Reads the hierarchy of a BVH file as a skeleton; its motion is not looked at. Lengths stay in the unit of the file.
///
/// The root becomes a translate joint of its name and `_translation`, and at the same place a joint of its name.
/// Joints that are left out or turn more freely than in the file, position channels of joints that also turn, and changed names are noted.
///
/// # Errors
/// Malformed: the text before MOTION is no hierarchy. Unsupported: it has more than one ROOT, or joints farther away than anything can be.
pub fn skeleton_of_bvh(bytes: &[u8], notes: &Notes) -> Result<Skeleton, FormatError> {
    let nodes = joints(bytes)?;
    if let Some(second) = nodes.iter().skip(1).find(|node| node.parent.is_none()) {
        let text =
            format!("\"{}\" is a second ROOT; a skeleton has one, so take the other out of the file", crate::printable(&second.label));
        return Err(FormatError::unsupported(NAME, Place::Whole, text));
    }
    let mut skeleton = Skeleton::default();
    // For each node where it is, and the joint that what hangs on it hangs on.
    let mut placed: Vec<([f64; 3], Option<usize>)> = Vec::with_capacity(nodes.len());
    let mut told = Told::default();
    for node in &nodes {
        let (from, parent) = node.parent.and_then(|parent| placed.get(parent)).copied().unwrap_or_default();
        let ([x, y, z], [dx, dy, dz]) = (from, node.offset);
        let centre = [x + dx, y + dy, z + dz];
        if !centre.iter().all(|x| x.abs() < FARTHEST) {
            let text = format!("joint \"{}\" is farther away than anything can be; correct its OFFSET", crate::printable(&node.label));
            return Err(FormatError::unsupported(NAME, Place::Whole, text));
        }
        let mut hangs = parent;
        let mut add = |name: String, kind: JointKind| {
            skeleton.joints.push(Joint { name, kind, parent: hangs, centre, state: [0.0; 3] });
            hangs = Some(skeleton.joints.len() - 1);
        };
        let root = node.parent.is_none();
        let kind = kind_of(node, &mut told);
        if root && kind.is_some() {
            add(format!("{}_translation", node.label), JointKind::Translate);
        }
        match kind {
            Some(kind) => add(node.label.clone(), kind),
            None if root || node.is_placed() => add(node.label.clone(), JointKind::Translate),
            None if !node.end => told.left_out.push(node.label.clone()),
            None => {}
        }
        placed.push((centre, hangs));
    }
    told.note(notes);
    let all: Vec<(usize, &str)> = skeleton.joints.iter().enumerate().map(|(at, joint)| (at, joint.name.as_str())).collect();
    let spelled = spelled(&NAMES, &all, &[NOBODY.to_owned()], "names of joints");
    if let Some(what) = spelled.told {
        notes.add(Note::Changed { format: NAME, what });
    }
    for (joint, name) in skeleton.joints.iter_mut().zip(spelled.labels) {
        joint.name = name;
    }
    Ok(skeleton)
}

/// Joints that are otherwise in the skeleton than in the file.
#[derive(Default)]
struct Told {
    left_out: Vec<String>,
    freer: Vec<String>,
    moved: Vec<String>,
}

impl Told {
    fn note(self, notes: &Notes) {
        for (names, what) in [
            (self.left_out, "joints without channels are not in the skeleton, what hangs on them hangs on their parents"),
            (self.freer, "joints with two rotation channels turn freely in the skeleton"),
            (self.moved, "position channels of joints that also turn are not in the skeleton, whose joints stay at their OFFSETs"),
        ] {
            if !names.is_empty() {
                notes.add(Note::Changed { format: NAME, what: format!("{what}: {}", listed(&names)) });
            }
        }
    }
}

/// How a node turns; `None` if it does not.
fn kind_of(node: &Node, told: &mut Told) -> Option<JointKind> {
    let mut axes = node.channels.iter().filter_map(|channel| match channel {
        Channel::Rotation(axis) => Some(*axis),
        Channel::Position(_) => None,
    });
    let first = axes.next()?;
    if node.is_placed() && node.parent.is_some() {
        told.moved.push(node.label.clone());
    }
    match axes.count() {
        0 => {
            let mut axis = [0.0; 3];
            if let Some(x) = axis.get_mut(first) {
                *x = 1.0;
            }
            Some(JointKind::Revolute { axis })
        }
        1 => {
            told.freer.push(node.label.clone());
            Some(JointKind::Ball)
        }
        _ => Some(JointKind::Ball),
    }
}
