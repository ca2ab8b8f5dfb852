//! Rigs: a skeleton, the surface of a body, which joint moves which vertex, and how far joints turn. Kineben's files, and what becomes of them.
//!
//! These are no takes, so they are no [`Format`](crate::Format)s: each file is read by a function of its own.
//! Lengths are in the unit of the file; angles are radians. `docs/formats/rig.md` says what is read, written and assumed.
//!
//! | file | holds |
//! | --- | --- |
//! | `words` | bytes → words, numbers, lines |
//! | `records` | what skeletons and limits have in common |
//! | `off` | surfaces and clouds of points |
//! | `skl` | skeletons |
//! | `cst` | limits |
//! | `vj` | which joint moves which vertex |
//! | `from_bvh` | the hierarchy of a BVH file → a skeleton |

mod cst;
mod from_bvh;
mod off;
mod records;
mod skl;
mod vj;
mod words;

pub use cst::{AngleUnit, read_limits, write_limits};
pub use from_bvh::skeleton_of_bvh;
pub use off::{read_mesh, write_mesh};
pub use skl::{read_skeleton, write_skeleton};
pub use vj::{read_parts, write_parts};

/// How a joint moves, against its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointKind {
    /// It shifts: 3 degrees of freedom.
    Translate,
    /// It turns about an axis of length 1, given in the axes of the reference pose: 1 degree of freedom.
    Revolute {
        /// The axis.
        axis: [f64; 3],
    },
    /// It turns freely: 3 degrees of freedom.
    Ball,
}

impl JointKind {
    /// Number of its degrees of freedom.
    pub fn freedom(self) -> usize {
        match self {
            Self::Revolute { .. } => 1,
            Self::Translate | Self::Ball => 3,
        }
    }
}

/// A joint of a skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Its name, and that of the part of the body that it moves.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// The joint that it hangs on, by its place in [`Skeleton::joints`], which is before its own; `None` for the root.
    pub parent: Option<usize>,
    /// Where it is in the reference pose.
    pub centre: [f64; 3],
    /// The state of the pose that tracking may begin with, if the file gives one: shift, angle (first number) in radians,
    /// or rotation vector in radians. All 0 is the reference pose.
    pub state: [f64; 3],
}

/// A tree of joints in its reference pose: parents before children, the root first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skeleton {
    /// The joints.
    pub joints: Vec<Joint>,
}

impl Skeleton {
    /// The place of a joint.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    /// Number of degrees of freedom.
    pub fn freedom(&self) -> usize {
        self.joints.iter().map(|joint| joint.kind.freedom()).sum()
    }

    /// Lengths in another unit.
    pub fn scale(&mut self, factor: f64) {
        for joint in &mut self.joints {
            joint.centre = joint.centre.map(|x| x * factor);
            if joint.kind == JointKind::Translate {
                joint.state = joint.state.map(|x| x * factor);
            }
        }
    }
}

/// How far a joint moves. Angles are radians, directions have length 1 and are given in the axes of the reference pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// The farthest along each axis of a [`JointKind::Translate`], to either side.
    Translate {
        /// In the unit of the file.
        farthest: [f64; 3],
    },
    /// The least and the largest angle of a [`JointKind::Revolute`].
    Revolute {
        /// Least.
        least: f64,
        /// Largest.
        most: f64,
    },
    /// How far two directions of a [`JointKind::Ball`] turn away from where they are in the reference pose.
    Ball {
        /// The direction of the limb.
        heading: [f64; 3],
        /// Its largest angle.
        heading_most: f64,
        /// A direction across the limb.
        bank: [f64; 3],
        /// Its largest angle.
        bank_most: f64,
    },
}

/// The surface of a body, or a cloud of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Points.
    pub vertices: Vec<[f64; 3]>,
    /// A direction of length 1 (or 0 0 0 where there is none) for every vertex, pointing outwards; empty if the file gives none.
    pub normals: Vec<[f64; 3]>,
    /// Triangles, each three places in `vertices`, anticlockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
}

#[cfg(test)]
mod tests;
