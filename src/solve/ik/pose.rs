//! How far joints have moved, and where that puts the body.

use super::Vec3;
use super::block::Twist;
use super::tree::{Motion, Tree};
use nalgebra::{Matrix3, UnitQuaternion};

/// How far a joint has moved from the reference pose, against its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum State {
    /// Of a joint that shifts, cm.
    Shift(Vec3),
    /// Of a joint that turns about an axis, radians.
    Angle(f64),
    /// Of a joint that turns freely.
    Rotation(UnitQuaternion<f64>),
}

impl State {
    /// The state after an update of the joint's own degrees of freedom: shifts and angles add, rotations turn about axes of the part itself
    /// (`R exp([w])`, section 3.2.2).
    #[must_use]
    pub fn updated(&self, update: &[f64]) -> Self {
        match *self {
            Self::Shift(shift) => Self::Shift(shift + Vec3::from_column_slice(update)),
            Self::Angle(angle) => Self::Angle(angle + update[0]),
            Self::Rotation(rotation) => {
                let mut turned = rotation * UnitQuaternion::from_scaled_axis(Vec3::from_column_slice(update));
                turned.renormalize();
                Self::Rotation(turned)
            }
        }
    }

    /// The update that leads from `other` to this state.
    pub fn since(&self, other: &Self, update: &mut [f64]) {
        match (self, other) {
            (Self::Shift(a), Self::Shift(b)) => update.copy_from_slice((a - b).as_slice()),
            (Self::Angle(a), Self::Angle(b)) => update[0] = a - b,
            (Self::Rotation(a), Self::Rotation(b)) => update.copy_from_slice((b.inverse() * a).scaled_axis().as_slice()),
            _ => unreachable!("poses of one tree"),
        }
    }
}

/// The state of every joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose(pub Vec<State>);

impl Pose {
    /// The reference pose.
    pub fn reference(tree: &Tree) -> Self {
        let zero = |motion| match motion {
            Motion::Translate => State::Shift(Vec3::zeros()),
            Motion::Revolute(_) => State::Angle(0.0),
            Motion::Ball => State::Rotation(UnitQuaternion::identity()),
        };
        Self(tree.links.iter().map(|link| zero(link.motion)).collect())
    }

    /// Moves every joint by its part of `update`, scaled. `update` has one number for each degree of freedom.
    pub fn update(&mut self, tree: &Tree, update: &[f64], scale: f64) {
        let mut own = [0.0; 3];
        for (joint, state) in self.0.iter_mut().enumerate() {
            let range = tree.own(joint);
            let own = &mut own[..range.len()];
            for (to, from) in own.iter_mut().zip(&update[range]) {
                *to = from * scale;
            }
            *state = state.updated(own);
        }
    }

    /// The update that leads from `other` to this pose.
    pub fn since(&self, tree: &Tree, other: &Self, update: &mut [f64]) {
        for (joint, (a, b)) in self.0.iter().zip(&other.0).enumerate() {
            a.since(b, &mut update[tree.own(joint)]);
        }
    }
}

/// A rigid motion, from the reference pose into the world: `R x + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid {
    /// R
    pub rotation: Matrix3<f64>,
    /// t, cm.
    pub shift: Vec3,
}

impl Rigid {
    /// Nothing moves.
    pub const IDENTITY: Self =
        Self { rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), shift: Vec3::new(0.0, 0.0, 0.0) };

    /// Where a point of the reference pose comes to be.
    #[inline]
    pub fn point(&self, x: &Vec3) -> Vec3 {
        self.rotation * x + self.shift
    }

    /// Where a point of the world lies in the reference pose.
    #[inline]
    pub fn back(&self, x: &Vec3) -> Vec3 {
        self.rotation.tr_mul(&(x - self.shift))
    }
}

/// Where a pose puts the parts of the body.
#[derive(Clone, Debug)]
pub struct Posed {
    /// For each joint, the motion of its part: the product of the exponentials of its chain (equation 1).
    pub parts: Vec<Rigid>,
    /// For each joint, its own rotation against its parent.
    pub own: Vec<Matrix3<f64>>,
    /// For each joint, where its centre is, cm.
    pub centres: Vec<Vec3>,
    /// For each degree of freedom, how everything behind it moves (equations 8, 10 and 13, in the world).
    pub twists: Vec<Twist>,
}

impl Posed {
    /// Nothing has moved.
    pub fn new(tree: &Tree) -> Self {
        let mut posed = Self {
            parts: vec![Rigid::IDENTITY; tree.joints()],
            own: vec![Matrix3::identity(); tree.joints()],
            centres: vec![Vec3::zeros(); tree.joints()],
            twists: vec![Twist::default(); tree.freedom()],
        };
        posed.set(tree, &Pose::reference(tree));
        posed
    }

    /// Forward kinematics.
    pub fn set(&mut self, tree: &Tree, pose: &Pose) {
        for (at, (link, state)) in tree.links.iter().zip(&pose.0).enumerate() {
            let parent = link.parent.map_or(Rigid::IDENTITY, |parent| self.parts[parent]);
            let centre = parent.point(&link.centre);
            match (state, link.motion) {
                (State::Shift(shift), _) => {
                    // equation 8 has the axes of the room, which is right for the root only: behind a rotation they have turned
                    self.parts[at] = Rigid { rotation: parent.rotation, shift: parent.shift + parent.rotation * shift };
                    self.centres[at] = centre + parent.rotation * shift;
                    for k in 0..3 {
                        self.twists[link.first + k] = Twist { turn: Vec3::zeros(), shift: parent.rotation.column(k).into_owned() };
                    }
                }
                (State::Angle(angle), Motion::Revolute(axis)) => {
                    let own = UnitQuaternion::from_axis_angle(&axis, *angle).to_rotation_matrix().into_inner();
                    self.turn(at, &parent, own, centre, &link.centre);
                    self.twists[link.first] = Twist::about(parent.rotation * axis.into_inner(), &centre);
                }
                (State::Rotation(rotation), _) => {
                    self.turn(at, &parent, rotation.to_rotation_matrix().into_inner(), centre, &link.centre);
                    for k in 0..3 {
                        self.twists[link.first + k] = Twist::about(self.parts[at].rotation.column(k).into_owned(), &centre);
                    }
                }
                (State::Angle(_), _) => unreachable!("a pose of another tree"),
            }
        }
    }

    /// A joint at `centre` that turned by `own`.
    fn turn(&mut self, at: usize, parent: &Rigid, own: Matrix3<f64>, centre: Vec3, reference: &Vec3) {
        let rotation = parent.rotation * own;
        self.parts[at] = Rigid { rotation, shift: centre - rotation * reference };
        self.own[at] = own;
        self.centres[at] = centre;
    }
}
