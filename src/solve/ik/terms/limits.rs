//! How far joints turn (section 3.2.3).

use super::{At, Term};
use crate::solve::ik::{Normal, State, Tree, Vec3};
use formats::rig::Limit;
use nalgebra::UnitQuaternion;

/// A bound of one joint. What is inside costs nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// A shift along one axis, cm.
    Box {
        /// 0, 1 or 2.
        axis: usize,
        /// The farthest to either side.
        most: f64,
    },
    /// The angle of a joint with one axis (equation 14).
    Range {
        /// Least.
        least: f64,
        /// Largest.
        most: f64,
    },
    /// How far a direction turns away from where it is in the reference pose: a cone (equation 15). The residual is the angle beyond the cone,
    /// not the difference of cosines: that has no gradient where a direction has turned around.
    Cone {
        /// The direction.
        direction: Vec3,
        /// The cone's half angle.
        most: f64,
    },
    /// How far a joint turns about a direction, after the swing that takes the direction where it is.
    Twist {
        /// The direction.
        direction: Vec3,
        /// The largest angle to either side.
        most: f64,
    },
}

/// Joints and their bounds, with weights that can follow the data's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Limits {
    /// Each with its joint and the weight of its squared angle.
    pub bounds: Vec<(usize, Bound, f64)>,
}

/// Sines below this have no direction.
const NO_DIRECTION: f64 = 1e-9;

impl Limits {
    /// Takes limits as the file has them, one for each joint. Lengths are multiplied by `unit_cm`.
    /// With `swing_twist`, the second angle of a ball is the largest turn about its first direction; without, it is a cone like the first.
    pub fn new(limits: &[Option<Limit>], swing_twist: bool, unit_cm: f64) -> Self {
        let mut bounds = Vec::new();
        for (joint, limit) in limits.iter().enumerate() {
            match *limit {
                None => {}
                Some(Limit::Translate { farthest }) => {
                    bounds.extend((0..3).map(|axis| (joint, Bound::Box { axis, most: farthest[axis] * unit_cm }, 1.0)));
                }
                Some(Limit::Revolute { least, most }) => bounds.push((joint, Bound::Range { least, most }, 1.0)),
                Some(Limit::Ball { heading, heading_most, bank, bank_most }) => {
                    let (heading, bank) = (Vec3::from(heading), Vec3::from(bank));
                    bounds.push((joint, Bound::Cone { direction: heading, most: heading_most }, 1.0));
                    let second = if swing_twist {
                        Bound::Twist { direction: heading, most: bank_most }
                    } else {
                        Bound::Cone { direction: bank, most: bank_most }
                    };
                    bounds.push((joint, second, 1.0));
                }
            }
        }
        Self { bounds }
    }

    /// The same bounds, all with one weight.
    #[must_use]
    pub fn weighing(&self, weight: f64) -> Self {
        Self { bounds: self.bounds.iter().map(|&(joint, bound, _)| (joint, bound, weight)).collect() }
    }

    /// Gives every bound a weight like that of what the data say about its joint: as written in the report, angles stand beside squared
    /// centimetres of thousands of points and do nothing. `normal` holds the data, gathered.
    pub fn weigh(&mut self, tree: &Tree, normal: &Normal, factor: f64, least: f64) {
        for (joint, _, weight) in &mut self.bounds {
            let own = tree.own(*joint);
            let count = own.len() as f64;
            *weight = factor * own.map(|at| normal.diagonal(at)).sum::<f64>() / count + least;
        }
    }

    /// The residual and gradient of a bound that is exceeded.
    fn exceeded(bound: &Bound, state: &State) -> Option<(f64, [f64; 3], usize)> {
        match (*bound, state) {
            (Bound::Box { axis, most }, State::Shift(shift)) => {
                let beyond = beyond(shift[axis], -most, most)?;
                let mut gradient = [0.0; 3];
                gradient[axis] = 1.0;
                Some((beyond, gradient, 3))
            }
            (Bound::Range { least, most }, State::Angle(angle)) => Some((beyond(*angle, least, most)?, [1.0, 0.0, 0.0], 1)),
            (Bound::Cone { direction, most }, State::Rotation(rotation)) => {
                let turned = rotation.inverse() * direction;
                let across = turned.cross(&direction);
                let sine = across.norm();
                let angle = sine.atan2(turned.dot(&direction));
                let beyond = beyond(angle, -most, most)?;
                // turned around, any way back is as good as another
                let gradient = if sine > NO_DIRECTION { across / sine } else { perpendicular(&direction) };
                Some((beyond, gradient.into(), 3))
            }
            (Bound::Twist { direction, most }, State::Rotation(rotation)) => {
                let (angle, gradient) = twist(rotation, &direction)?;
                Some((beyond(angle, -most, most)?, gradient.into(), 3))
            }
            _ => None,
        }
    }
}

/// By how much a value is outside, with its sign; `None` inside.
fn beyond(value: f64, least: f64, most: f64) -> Option<f64> {
    if value < least {
        Some(value - least)
    } else if value > most {
        Some(value - most)
    } else {
        None
    }
}

/// Some direction across another.
fn perpendicular(direction: &Vec3) -> Vec3 {
    let axis = if direction.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
    direction.cross(&axis).normalize()
}

/// The angle of a rotation about a direction, between -π and π, and its gradient against updates `R exp([w])`.
/// `None` where the direction has turned around: then the angle means nothing.
fn twist(rotation: &UnitQuaternion<f64>, direction: &Vec3) -> Option<(f64, Vec3)> {
    let vector = Vec3::new(rotation.i, rotation.j, rotation.k);
    let (mut along, mut real) = (vector.dot(direction), rotation.w);
    let square = along * along + real * real;
    if square < NO_DIRECTION {
        return None;
    }
    let gradient = (real * (real * direction + direction.cross(&vector)) + along * vector) / square;
    // one rotation has two quaternions
    if real < 0.0 {
        (along, real) = (-along, -real);
    }
    Some((2.0 * along.atan2(real), gradient))
}

impl Term for Limits {
    fn residuals(&self, at: &At<'_>, residuals: &mut Vec<f64>) {
        residuals.extend(self.bounds.iter().map(|(joint, bound, weight)| {
            Self::exceeded(bound, &at.pose.0[*joint]).map_or(0.0, |(residual, ..)| residual * weight.sqrt())
        }));
    }

    fn add(&self, at: &At<'_>, normal: &mut Normal) {
        for (joint, bound, weight) in &self.bounds {
            if let Some((residual, gradient, count)) = Self::exceeded(bound, &at.pose.0[*joint]) {
                normal.add(at.tree.links[*joint].first, &gradient[..count], *weight, residual);
            }
        }
    }
}
