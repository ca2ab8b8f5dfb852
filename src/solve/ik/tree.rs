//! The skeleton as the solver sees it.

use super::Vec3;
use formats::rig::{JointKind, Skeleton};
use nalgebra::Unit;

/// A joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// The joint it hangs on, which stands before it; `None` for the root.
    pub parent: Option<usize>,
    /// How it moves.
    pub motion: Motion,
    /// Where it is in the reference pose, cm.
    pub centre: Vec3,
    /// Its first degree of freedom.
    pub first: usize,
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// It shifts.
    Translate,
    /// It turns about an axis.
    Revolute(Unit<Vec3>),
    /// It turns freely.
    Ball,
}

impl Motion {
    /// Number of degrees of freedom.
    pub fn freedom(self) -> usize {
        match self {
            Self::Revolute(_) => 1,
            Self::Translate | Self::Ball => 3,
        }
    }
}

/// A skeleton in its reference pose. Parents stand before children.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// The joints.
    pub links: Vec<Link>,
    /// The joint of each degree of freedom.
    pub owners: Vec<usize>,
    /// For each joint, the degrees of freedom that move it: those of its ancestors and its own, in ascending order.
    pub chains: Vec<Vec<usize>>,
}

impl Tree {
    /// Takes a skeleton, whose lengths are multiplied by `unit_cm`.
    pub fn new(skeleton: &Skeleton, unit_cm: f64) -> Self {
        let mut tree = Self { links: Vec::new(), owners: Vec::new(), chains: Vec::new() };
        for (at, joint) in skeleton.joints.iter().enumerate() {
            let motion = match joint.kind {
                JointKind::Translate => Motion::Translate,
                JointKind::Revolute { axis } => Motion::Revolute(Unit::new_normalize(Vec3::from(axis))),
                JointKind::Ball => Motion::Ball,
            };
            let first = tree.owners.len();
            let mut chain = joint.parent.map_or_else(Vec::new, |parent| tree.chains[parent].clone());
            chain.extend(first..first + motion.freedom());
            tree.owners.extend(std::iter::repeat_n(at, motion.freedom()));
            tree.chains.push(chain);
            tree.links.push(Link { parent: joint.parent, motion, centre: Vec3::from(joint.centre) * unit_cm, first });
        }
        tree
    }

    /// Number of degrees of freedom.
    pub fn freedom(&self) -> usize {
        self.owners.len()
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.links.len()
    }

    /// The first joint that turns freely: the body turns with it as a whole.
    pub fn whole(&self) -> Option<usize> {
        self.links.iter().position(|link| link.motion == Motion::Ball)
    }

    /// True for joints that turn against what carries them, and not with the whole body.
    pub fn turns_within(&self, joint: usize) -> bool {
        self.links[joint].motion != Motion::Translate && Some(joint) != self.whole()
    }

    /// Number of joints that hang on a joint.
    pub fn children(&self, joint: usize) -> usize {
        self.links.iter().filter(|link| link.parent == Some(joint)).count()
    }

    /// True for a joint, and for all that hangs on it.
    pub fn behind(&self, joint: usize) -> Vec<bool> {
        let mut behind = vec![false; self.joints()];
        behind[joint] = true;
        for at in joint + 1..self.joints() {
            behind[at] = self.links[at].parent.is_some_and(|parent| behind[parent]);
        }
        behind
    }

    /// Degrees of freedom of a joint.
    pub fn own(&self, joint: usize) -> std::ops::Range<usize> {
        let link = &self.links[joint];
        link.first..link.first + link.motion.freedom()
    }
}
