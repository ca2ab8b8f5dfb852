//! What is known about a frame when it has been tracked.

use super::expect::Cloud;
use crate::solve::ik::{Pose, Rigid, Vec3};
use std::sync::Arc;

/// One round of EM. Lists have one entry for each joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Round {
    /// Log-likelihood of the cloud before the round's step, nats.
    pub log_likelihood: f64,
    /// Standard deviation of the mixture in this round, cm.
    pub sigma_cm: f64,
    /// The share of the points that belong to the body.
    pub inliers: f64,
    /// The farthest that the step moved a joint, cm.
    pub moved_cm: f64,
    /// For each part, the number of points that belong to it.
    pub mass: Vec<f64>,
    /// For each part, the root mean square distance of those points from their vertices, cm; NaN if there are none.
    pub residual_cm: Vec<f64>,
}

/// How a frame came to its pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Way {
    /// From its cloud, starting where motion led.
    #[default]
    Tracked,
    /// From its cloud, after limbs that were lost had been searched.
    Searched,
    /// There was no cloud: the pose is on the way between those that have one, or where the last one was.
    Predicted,
}

/// A frame that has been tracked. Lists have one entry for each joint.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// The pose.
    pub pose: Pose,
    /// Where it puts the parts of the body.
    pub parts: Vec<Rigid>,
    /// Where it puts the joints, cm.
    pub centres: Vec<Vec3>,
    /// The rounds of EM, in order.
    pub rounds: Vec<Round>,
    /// How it came about.
    pub way: Way,
    /// The share of the points that belong to the body.
    pub inliers: f64,
    /// For each part, the share of its surface that has points of the cloud beside it.
    pub coverage: Vec<f64>,
    /// For each part, the root mean square distance of its points from their vertices, cm; NaN if there are none.
    pub residual_cm: Vec<f64>,
    /// For each part, whether it has lost the body that it should follow.
    pub lost: Vec<bool>,
    /// The cloud, if there was one.
    pub cloud: Option<Arc<Cloud>>,
}
