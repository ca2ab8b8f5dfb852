//! How a body is held, in the terms of anatomy: how far each joint is bent.
//!
//! All angles are 0 when somebody stands straight with hanging arms, palms to the thighs.
//! The axes of the body are x to its left, y up, z forward.

use nalgebra::{Rotation3, Vector3};

/// An arm. Angles in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ArmPosture {
    /// Lifts the arm forwards; 180 is overhead.
    pub(super) forward: f64,
    /// Lifts the arm sidewards.
    pub(super) aside: f64,
    /// Turns the arm inwards, so that a bent forearm lies across the belly.
    pub(super) inward: f64,
    pub(super) elbow: f64,
    /// Bends the hand towards its palm.
    pub(super) wrist: f64,
}

/// A leg. Angles in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LegPosture {
    /// Lifts the thigh forwards.
    pub(super) forward: f64,
    /// Lifts the thigh sidewards.
    pub(super) aside: f64,
    /// Turns the toes outwards.
    pub(super) outward: f64,
    pub(super) knee: f64,
    /// Points the toes down.
    pub(super) toes_down: f64,
}

/// A whole body. Angles in degrees, lengths in cm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Posture {
    /// Where the pelvis is over the floor, to the left of and ahead of where the reference pose stands.
    pub(super) place: [f64; 2],
    /// How far the lowest point of the body is above the floor.
    pub(super) above: f64,
    /// The pelvis: turned to its left, leaning forward, leaning to its right.
    pub(super) pelvis: [f64; 3],
    /// The back, from pelvis to chest: turned to its left, bent forward, bent to its right.
    pub(super) back: [f64; 3],
    /// The head against the chest, likewise.
    pub(super) head: [f64; 3],
    /// Left and right.
    pub(super) arms: [ArmPosture; 2],
    /// Left and right.
    pub(super) legs: [LegPosture; 2],
}

impl ArmPosture {
    fn mixed(self, other: Self, share: f64) -> Self {
        Self {
            forward: mixed(self.forward, other.forward, share),
            aside: mixed(self.aside, other.aside, share),
            inward: mixed(self.inward, other.inward, share),
            elbow: mixed(self.elbow, other.elbow, share),
            wrist: mixed(self.wrist, other.wrist, share),
        }
    }

    /// The upper arm against the chest; `sign` is 1 on the left and -1 on the right.
    pub(super) fn shoulder(self, sign: f64) -> Rotation3<f64> {
        about_x(-self.forward) * about_z(sign * self.aside) * about_y(-sign * self.inward)
    }
}

impl LegPosture {
    fn mixed(self, other: Self, share: f64) -> Self {
        Self {
            forward: mixed(self.forward, other.forward, share),
            aside: mixed(self.aside, other.aside, share),
            outward: mixed(self.outward, other.outward, share),
            knee: mixed(self.knee, other.knee, share),
            toes_down: mixed(self.toes_down, other.toes_down, share),
        }
    }

    /// The thigh against the pelvis.
    pub(super) fn hip(self, sign: f64) -> Rotation3<f64> {
        about_x(-self.forward) * about_z(sign * self.aside) * about_y(sign * self.outward)
    }
}

impl Posture {
    /// This posture where `share` is 0, the other where it is 1.
    pub(super) fn mixed(&self, other: &Self, share: f64) -> Self {
        let each = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| mixed(a[i], b[i], share));
        Self {
            place: std::array::from_fn(|i| mixed(self.place[i], other.place[i], share)),
            above: mixed(self.above, other.above, share),
            pelvis: each(self.pelvis, other.pelvis),
            back: each(self.back, other.back),
            head: each(self.head, other.head),
            arms: std::array::from_fn(|side| self.arms[side].mixed(other.arms[side], share)),
            legs: std::array::from_fn(|side| self.legs[side].mixed(other.legs[side], share)),
        }
    }
}

/// Turned to the left, leaning forward, leaning to the right.
pub(super) fn turned(angles: [f64; 3]) -> Rotation3<f64> {
    about_y(angles[0]) * about_x(angles[1]) * about_z(angles[2])
}

/// The axis about which an elbow, a wrist, a knee or an ankle bends.
pub(super) fn hinge(joint: Hinge, sign: f64) -> Vector3<f64> {
    match joint {
        Hinge::Elbow => -Vector3::x(),
        Hinge::Wrist => -sign * Vector3::z(),
        Hinge::Knee | Hinge::Ankle => Vector3::x(),
    }
}

/// A joint that bends about one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hinge {
    Elbow,
    Wrist,
    Knee,
    Ankle,
}

/// Both ends exact.
fn mixed(a: f64, b: f64, share: f64) -> f64 {
    a * (1.0 - share) + b * share
}

fn about_x(degrees: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::x_axis(), degrees.to_radians())
}

fn about_y(degrees: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::y_axis(), degrees.to_radians())
}

fn about_z(degrees: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), degrees.to_radians())
}
