//! Inverse kinematics: the pose of a tree of joints that fits what was seen.
//!
//! A [`Tree`] is a skeleton in its reference pose; a [`Pose`] says how far every joint has moved; [`Posed`] is where that puts the parts of the body,
//! with the column of the Jacobian of every degree of freedom as a twist. [`Term`]s say what a pose should be like, and add to the
//! [`Normal`] equations; [`GaussNewton`] solves them.
//!
//! Everything is in the axes of the reference pose and in centimetres, as in the report (`docs/kineben.md` has its equations and where they are);
//! angles are radians.

mod block;
pub mod gauss_newton;
mod normal;
mod pose;
pub mod terms;
#[cfg(test)]
mod tests;
mod tree;

pub use block::{Block, Twist};
pub use gauss_newton::{GaussNewton, Solved};
pub use normal::Normal;
pub use pose::{Pose, Posed, Rigid, State};
pub use terms::Term;
pub use tree::{Link, Motion, Tree};

use nalgebra::Vector3;

/// A point or direction.
pub type Vec3 = Vector3<f64>;
