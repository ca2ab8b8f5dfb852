//! Clouds of points drawn from the surface, as scanners and stereo cameras give them.

use super::{Actor, ActorPose};
use crate::random::{Random, Stream};
use formats::rig::Mesh;
use nalgebra::Vector3;

/// What a scan is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanOptions {
    /// Number of points, those that fall into holes included.
    pub points: usize,
    /// Standard deviation of every coordinate, in cm.
    pub noise_cm: f64,
    /// Standard deviation of the normals, in rad.
    pub tilt_rad: f64,
    /// Number of patches of the surface without points. They stay where they are for [`ScanOptions::HOLE_FRAMES`] frames.
    pub holes: usize,
    /// Radius of these patches, in cm.
    pub hole_cm: f64,
    /// Share of points that lie anywhere around the body, with any normal.
    pub outliers: f64,
}

impl Default for ScanOptions {
    fn default() -> Self {
        Self { points: 2500, noise_cm: 0.3, tilt_rad: 0.1, holes: 0, hole_cm: 10.0, outliers: 0.0 }
    }
}

impl ScanOptions {
    /// How long holes stay where they are.
    pub const HOLE_FRAMES: usize = 10;
}

impl Actor {
    /// A cloud of points around the surface in a pose, with normals and without faces. Every frame draws its own points.
    pub fn scan(&self, pose: &ActorPose, frame: usize, options: &ScanOptions) -> Mesh {
        let (vertices, normals) = self.surface(pose);
        let corner = |vertex: u32| Vector3::from(vertices[vertex as usize]);
        let mut grown = 0.0;
        let areas: Vec<f64> = self
            .mesh
            .faces
            .iter()
            .map(|face| {
                let [a, b, c] = face.map(corner);
                grown += 0.5 * (b - a).cross(&(c - a)).norm();
                grown
            })
            .collect();
        let mut holes_random = self.chance(Stream::Cloud, 1 + 2 * (frame / ScanOptions::HOLE_FRAMES));
        let holes: Vec<Vector3<f64>> = (0..options.holes).map(|_| Vector3::from(vertices[holes_random.whole(0, vertices.len())])).collect();
        let mut random = self.chance(Stream::Cloud, 2 * frame);
        let (low, high) = bounds(&vertices);
        let mut cloud = Mesh::default();
        for _ in 0..options.points {
            if random.between(0.0, 1.0) < options.outliers {
                let margin = (high - low) * 0.1;
                cloud.vertices.push(std::array::from_fn(|axis| random.between(low[axis] - margin[axis], high[axis] + margin[axis])));
                cloud.normals.push(Vector3::from(random.normal3()).normalize().into());
                continue;
            }
            let drawn = random.between(0.0, grown);
            let face = self.mesh.faces[areas.partition_point(|&area| area <= drawn).min(areas.len() - 1)];
            // Evenly over the triangle: half of the parallelogram is folded onto the other half.
            let (mut u, mut v) = (random.between(0.0, 1.0), random.between(0.0, 1.0));
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let shares = [1.0 - u - v, u, v];
            let blend = |of: &[[f64; 3]]| -> Vector3<f64> {
                face.iter().zip(shares).map(|(&k, share)| Vector3::from(of[k as usize]) * share).sum()
            };
            let (point, normal) = (blend(&vertices), blend(&normals));
            let noise = Vector3::from(random.normal3()) * options.noise_cm;
            let tilt = Vector3::from(random.normal3()) * options.tilt_rad;
            if holes.iter().any(|hole| (point - hole).norm() < options.hole_cm) {
                continue;
            }
            cloud.vertices.push((point + noise).into());
            cloud.normals.push((normal.normalize() + tilt).normalize().into());
        }
        cloud
    }

    /// Random numbers of this actor for one thing out of many.
    pub(super) fn chance(&self, stream: Stream, which: usize) -> Random {
        Random::new(self.seed.wrapping_mul(0xa076_1d64_78bd_642f) ^ which as u64, stream)
    }
}

/// The box around points.
pub(super) fn bounds(points: &[[f64; 3]]) -> (Vector3<f64>, Vector3<f64>) {
    let all = |pick: fn(f64, f64) -> f64, start: f64| Vector3::from_fn(|axis, _| points.iter().map(|p| p[axis]).fold(start, pick));
    (all(f64::min, f64::INFINITY), all(f64::max, f64::NEG_INFINITY))
}
