//! Labelled markers: points of known parts that shall be in known places.

use super::{At, Term};
use crate::solve::ik::{Normal, Vec3};

/// A marker on the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marker {
    /// The part it is fixed to.
    pub part: usize,
    /// The point of the surface that it sits on, in the reference pose, cm.
    pub vertex: Vec3,
    /// From there to its middle, in the axes of the reference pose, cm: the marker's own radius, and what it was placed beside the vertex.
    pub offset: Vec3,
}

impl Marker {
    /// Where it is in the reference pose, cm.
    pub fn place(&self) -> Vec3 {
        self.vertex + self.offset
    }
}

/// Markers and where they were seen.
#[derive(Clone, Debug, Default)]
pub struct Markers {
    /// Each with its place in the world, cm, and the weight of its squared distance.
    pub seen: Vec<(Marker, Vec3, f64)>,
}

impl Term for Markers {
    fn residuals(&self, at: &At<'_>, residuals: &mut Vec<f64>) {
        for (marker, seen, weight) in &self.seen {
            let off = (at.posed.parts[marker.part].point(&marker.place()) - seen) * weight.sqrt();
            residuals.extend(off.iter());
        }
    }

    fn add(&self, at: &At<'_>, normal: &mut Normal) {
        for (marker, seen, weight) in &self.seen {
            let x = at.posed.parts[marker.part].point(&marker.place());
            normal.blocks[marker.part].point(&x, *weight, &(x - seen));
        }
    }

    fn energy(&self, at: &At<'_>) -> f64 {
        self.seen.iter().map(|(m, seen, weight)| weight * (at.posed.parts[m.part].point(&m.place()) - seen).norm_squared()).sum()
    }
}
