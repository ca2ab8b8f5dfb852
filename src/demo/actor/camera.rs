//! Cameras, and what they see of a surface: silhouettes and depths.

use super::{Actor, ActorPose};
use crate::random::Stream;
use formats::rig::Mesh;
use nalgebra::Vector3;

/// A pinhole camera that looks level or downwards, never straight up or down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it is, in cm.
    pub eye: [f64; 3],
    /// Where the middle of its picture is, in cm.
    pub target: [f64; 3],
    /// Focal length, in pixels.
    pub focal: f64,
    /// Width and height of the picture, in pixels.
    pub size: [usize; 2],
}

impl Camera {
    /// Cameras around a stage, at changing heights, in a distance from which they see somebody with lifted arms.
    pub fn ring(count: usize, stage: [f64; 3]) -> Vec<Self> {
        const DISTANCE_CM: f64 = 450.0;
        const HEIGHTS_CM: [f64; 2] = [220.0, 110.0];
        let camera = |i: usize| {
            let angle = std::f64::consts::TAU * (i as f64 + 0.3) / count as f64;
            let eye = [stage[0] + DISTANCE_CM * angle.sin(), HEIGHTS_CM[i % 2], stage[2] + DISTANCE_CM * angle.cos()];
            Self { eye, target: [stage[0], 110.0, stage[2]], focal: 420.0, size: [480, 420] }
        };
        (0..count).map(camera).collect()
    }

    /// A depth camera 3 m in front of a stage: what is there is sampled about every 1.5 cm.
    pub fn depth(stage: [f64; 3]) -> Self {
        Self { eye: [stage[0], 120.0, stage[2] + 300.0], target: [stage[0], 105.0, stage[2]], focal: 200.0, size: [240, 200] }
    }

    /// Right, down and ahead.
    fn axes(&self) -> [Vector3<f64>; 3] {
        let ahead = (Vector3::from(self.target) - Vector3::from(self.eye)).normalize();
        let right = ahead.cross(&Vector3::y()).normalize();
        [right, ahead.cross(&right), ahead]
    }

    /// A projection made ready: pixel column, pixel row and depth of a point.
    fn projection(&self) -> impl Fn(Vector3<f64>) -> [f64; 3] + use<> {
        let (eye, [right, down, ahead], focal) = (Vector3::from(self.eye), self.axes(), self.focal);
        let middle = self.size.map(|n| 0.5 * n as f64);
        move |point| {
            let seen = point - eye;
            let depth = seen.dot(&ahead);
            let scale = focal / depth;
            [middle[0] + scale * seen.dot(&right), middle[1] + scale * seen.dot(&down), depth]
        }
    }

    /// For every pixel, the nearest face and where on it, by the shares of its corners.
    fn render(&self, vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Vec<Option<Seen>> {
        let project = self.projection();
        let seen: Vec<[f64; 3]> = vertices.iter().map(|&vertex| project(Vector3::from(vertex))).collect();
        let mut picture: Vec<Option<Seen>> = vec![None; self.size[0] * self.size[1]];
        for (index, face) in faces.iter().enumerate() {
            let [a, b, c] = face.map(|vertex| seen[vertex as usize]);
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
            if area == 0.0 || a[2].min(b[2]).min(c[2]) < 1.0 {
                continue;
            }
            let range = |axis: usize| {
                let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
                // Pixels whose middle is within.
                (low - 0.5).ceil().max(0.0) as usize..((high - 0.5).floor() + 1.0).clamp(0.0, self.size[axis] as f64) as usize
            };
            for row in range(1) {
                for column in range(0) {
                    let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                    let side = |p: [f64; 3], q: [f64; 3]| ((q[0] - p[0]) * (y - p[1]) - (x - p[0]) * (q[1] - p[1])) / area;
                    let flat = [side(b, c), side(c, a), side(a, b)];
                    if flat.iter().any(|&share| share < 0.0) {
                        continue;
                    }
                    // What is linear in space is not linear in the picture, but linear over depth.
                    let over = [flat[0] / a[2], flat[1] / b[2], flat[2] / c[2]];
                    let depth = 1.0 / over.iter().sum::<f64>();
                    let pixel = &mut picture[row * self.size[0] + column];
                    if pixel.as_ref().is_none_or(|nearer| depth < nearer.depth) {
                        *pixel = Some(Seen { face: index, shares: over.map(|share| share * depth), depth });
                    }
                }
            }
        }
        picture
    }

    /// Tells of points whether the body may be there: whether they are in its silhouette, or out of the picture.
    pub(super) fn silhouette(&self, vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> impl Fn(Vector3<f64>) -> bool + use<> {
        let picture: Vec<bool> = self.render(vertices, faces).into_iter().map(|pixel| pixel.is_some()).collect();
        let (project, size) = (self.projection(), self.size);
        move |point| {
            let [x, y, depth] = project(point);
            let within = depth > 1.0 && x >= 0.0 && y >= 0.0 && x < size[0] as f64 && y < size[1] as f64;
            !within || picture[y as usize * size[0] + x as usize]
        }
    }
}

/// What a pixel shows.
#[derive(Clone, Debug)]
struct Seen {
    face: usize,
    shares: [f64; 3],
    depth: f64,
}

impl Actor {
    /// What a depth camera sees in a pose: the points of its front, with normals and without faces.
    /// `noise_cm` is the standard deviation of depths at 3 m; it grows with the square of the distance, as that of such cameras does.
    pub fn depth(&self, pose: &ActorPose, frame: usize, camera: &Camera, noise_cm: f64) -> Mesh {
        const TILT_RAD: f64 = 0.1;
        let (vertices, normals) = self.surface(pose);
        let eye = Vector3::from(camera.eye);
        let mut random = self.chance(Stream::Cloud, 2 * frame);
        let mut cloud = Mesh::default();
        for seen in camera.render(&vertices, &self.mesh.faces).into_iter().flatten() {
            let corners = self.mesh.faces[seen.face].map(|vertex| vertex as usize);
            let blend =
                |of: &[[f64; 3]]| -> Vector3<f64> { corners.iter().zip(seen.shares).map(|(&k, share)| Vector3::from(of[k]) * share).sum() };
            let (point, normal) = (blend(&vertices), blend(&normals).normalize());
            let ray = (point - eye).normalize();
            let error = random.normal() * noise_cm * (seen.depth / 300.0).powi(2);
            let mut tilted = normal + Vector3::from(random.normal3()) * TILT_RAD;
            // What is measured from one side never seems to face away from it.
            tilted -= ray * tilted.dot(&ray).max(0.0);
            cloud.vertices.push((point + ray * error).into());
            cloud.normals.push(tilted.try_normalize(1e-9).unwrap_or(normal).into());
        }
        cloud
    }
}
