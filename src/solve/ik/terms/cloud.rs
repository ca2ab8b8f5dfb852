//! Points of a cloud, each with the vertex of a part that it may belong to.

use super::{At, Term};
use crate::solve::ik::{Block, Normal, Vec3};
use rayon::prelude::*;

/// A point and a vertex that it may belong to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// The vertex's part.
    pub part: u32,
    /// The vertex in the reference pose, cm.
    pub vertex: Vec3,
    /// Its normal there.
    pub normal: Vec3,
    /// The point, in the world, cm.
    pub point: Vec3,
    /// How probable it is that they belong together, and how much such a pair counts.
    pub weight: f64,
}

/// Pairs whose sums are made by one task. A constant, so that sums do not depend on the number of cores.
const CHUNK: usize = 512;

/// The squared distance of points and vertices (equation 2, weighed as in equation 29).
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    /// Who belongs to whom.
    pub pairs: &'a [Pair],
}

impl Term for Points<'_> {
    fn residuals(&self, at: &At<'_>, residuals: &mut Vec<f64>) {
        for pair in self.pairs {
            let off = at.posed.parts[pair.part as usize].point(&pair.vertex) - pair.point;
            residuals.extend((off * pair.weight.sqrt()).iter());
        }
    }

    fn add(&self, at: &At<'_>, normal: &mut Normal) {
        add(self.pairs, at, normal, |pair, block, x, _| block.point(x, pair.weight, &(x - pair.point)));
    }
}

/// The squared distance of points from the tangent planes of vertices, and a share of the distance along the plane: Gaussians that are flat on the surface,
/// as in Horaud et al., "Rigid and articulated point registration with expectation conditional maximization" (2011).
#[derive(Clone, Copy, Debug)]
pub struct Planes<'a> {
    /// Who belongs to whom.
    pub pairs: &'a [Pair],
    /// How much the distance along the plane counts, against that from the plane.
    pub along: f64,
}

impl Term for Planes<'_> {
    fn residuals(&self, at: &At<'_>, residuals: &mut Vec<f64>) {
        for pair in self.pairs {
            let part = &at.posed.parts[pair.part as usize];
            let off = part.point(&pair.vertex) - pair.point;
            let normal = part.rotation * pair.normal;
            residuals.push(off.dot(&normal) * (pair.weight * (1.0 - self.along)).sqrt());
            residuals.extend((off * (pair.weight * self.along).sqrt()).iter());
        }
    }

    fn add(&self, at: &At<'_>, normal: &mut Normal) {
        let along = self.along;
        // the normal is that of the step's beginning: where the plane turns with the part, a point on it does not move along the normal
        add(self.pairs, at, normal, |pair, block, x, direction| {
            let off = x - pair.point;
            block.plane(&pair.point, direction, pair.weight * (1.0 - along), off.dot(direction));
            block.point(x, pair.weight * along, &off);
        });
    }
}

/// Adds every pair to the block of its part, in chunks on all cores. `put` is given the vertex and its normal in the world.
fn add(pairs: &[Pair], at: &At<'_>, normal: &mut Normal, put: impl Fn(&Pair, &mut Block, &Vec3, &Vec3) + Sync) {
    let parts = &at.posed.parts;
    let sums: Vec<Vec<Block>> = pairs
        .par_chunks(CHUNK)
        .map(|pairs| {
            let mut blocks = vec![Block::default(); parts.len()];
            for pair in pairs {
                let part = &parts[pair.part as usize];
                put(pair, &mut blocks[pair.part as usize], &part.point(&pair.vertex), &(part.rotation * pair.normal));
            }
            blocks
        })
        .collect();
    for blocks in sums {
        for (sum, block) in normal.blocks.iter_mut().zip(&blocks) {
            sum.add(block);
        }
    }
}
