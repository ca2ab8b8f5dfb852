//! What the points of one part say about its motion, whatever the joints above it: six numbers instead of one column for each degree of freedom.
//!
//! The velocity of a point of a rigid part is `turn × x + shift`; a residual along direction `d` at `x` therefore has the gradient `(x × d, d)`
//! against the part's twist. Sums of products of those gradients take 21 numbers for a part, and the normal equations of any chain follow from
//! the sums of everything behind each joint: their cost does not depend on the number of points.

use super::Vec3;
use nalgebra::Matrix3;

/// How a rigid body moves: `turn × x + shift`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Axis times speed.
    pub turn: Vec3,
    /// Velocity of the origin.
    pub shift: Vec3,
}

impl Twist {
    /// Turning about an axis through `centre`.
    pub fn about(axis: Vec3, centre: &Vec3) -> Self {
        Self { turn: axis, shift: centre.cross(&axis) }
    }

    /// The velocity of a point.
    pub fn at(&self, x: &Vec3) -> Vec3 {
        self.turn.cross(x) + self.shift
    }
}

/// Sums over the residuals of one part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Block {
    /// Second moments of the gradients: turn by turn, turn by shift, shift by shift.
    turn: Matrix3<f64>,
    mixed: Matrix3<f64>,
    shift: Matrix3<f64>,
    /// Gradients times residuals.
    turn_residual: Vec3,
    shift_residual: Vec3,
}

impl Block {
    /// Adds the residual `residual` of weight `weight` along `direction` (of length 1) at `x`.
    #[inline]
    pub fn plane(&mut self, x: &Vec3, direction: &Vec3, weight: f64, residual: f64) {
        let arm = x.cross(direction);
        let (arm_weighed, direction_weighed) = (arm * weight, direction * weight);
        self.turn += arm_weighed * arm.transpose();
        self.mixed += arm_weighed * direction.transpose();
        self.shift += direction_weighed * direction.transpose();
        self.turn_residual += arm_weighed * residual;
        self.shift_residual += direction_weighed * residual;
    }

    /// Adds the residual `residual` of weight `weight` in all three directions at `x`.
    #[inline]
    pub fn point(&mut self, x: &Vec3, weight: f64, residual: &Vec3) {
        let weighed = x * weight;
        let square = weighed.dot(x);
        self.turn -= weighed * x.transpose();
        self.mixed += weighed.cross_matrix();
        for k in 0..3 {
            self.turn[(k, k)] += square;
            self.shift[(k, k)] += weight;
        }
        self.turn_residual += weighed.cross(residual);
        self.shift_residual += residual * weight;
    }

    /// Adds what another block has.
    pub fn add(&mut self, other: &Self) {
        self.turn += other.turn;
        self.mixed += other.mixed;
        self.shift += other.shift;
        self.turn_residual += other.turn_residual;
        self.shift_residual += other.shift_residual;
    }

    /// The second moments times a twist.
    #[inline]
    pub(super) fn times(&self, twist: &Twist) -> Twist {
        Twist { turn: self.turn * twist.turn + self.mixed * twist.shift, shift: self.mixed.tr_mul(&twist.turn) + self.shift * twist.shift }
    }

    /// Gradient times residual along a twist.
    #[inline]
    pub(super) fn residual(&self, twist: &Twist) -> f64 {
        twist.turn.dot(&self.turn_residual) + twist.shift.dot(&self.shift_residual)
    }
}
