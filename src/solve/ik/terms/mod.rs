//! What a pose should be like. Each term is a sum of squared residuals and knows their derivatives.
//!
//! To add one: a file here, and an example in `ALL` of its test; the comparison with finite differences and the count of terms do the rest.

mod cloud;
mod limits;
mod markers;
mod pull;
#[cfg(test)]
mod tests;

pub use cloud::{Pair, Planes, Points};
pub use limits::{Bound, Limits};
pub use markers::{Marker, Markers};
pub use pull::{Prior, Pull};

use super::normal::Normal;
use super::pose::{Pose, Posed};
use super::tree::Tree;

/// A pose, and where it puts the body.
#[derive(Clone, Copy, Debug)]
pub struct At<'a> {
    /// The skeleton.
    pub tree: &'a Tree,
    /// The pose.
    pub pose: &'a Pose,
    /// Its forward kinematics.
    pub posed: &'a Posed,
}

/// A part of the energy: half of nothing, the plain sum of squared residuals (equation 2).
pub trait Term {
    /// Appends the residuals, times the square root of their weights.
    fn residuals(&self, at: &At<'_>, residuals: &mut Vec<f64>);

    /// Adds `JᵀJ` and `Jᵀr`. Points of parts go into the blocks of `normal`, all else straight into its matrix.
    fn add(&self, at: &At<'_>, normal: &mut Normal);

    /// The sum of squared residuals.
    fn energy(&self, at: &At<'_>) -> f64 {
        let mut residuals = Vec::new();
        self.residuals(at, &mut residuals);
        residuals.iter().map(|r| r * r).sum()
    }
}
