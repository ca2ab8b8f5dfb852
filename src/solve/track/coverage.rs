//! How much of a surface has points of a cloud beside it.

use super::body::Body;
use super::expect::Cloud;
use crate::solve::ik::{Rigid, Vec3};
use rayon::prelude::*;

/// Points of a cloud in boxes, as far as they are near a body.
#[derive(Clone, Debug)]
pub struct Beside<'a> {
    cloud: &'a Cloud,
    least: Vec3,
    size_cm: f64,
    counts: [usize; 3],
    /// Where the points of each box begin in `order`.
    starts: Vec<u32>,
    order: Vec<u32>,
    /// Where all points face, if they do.
    side: Option<Vec3>,
}

/// A surface faces a camera if the cosine between its normal and the direction to the camera is larger than this.
const FACING: f64 = 0.2;

/// The most boxes along one axis: what is farther apart shares boxes.
const MOST_BOXES: f64 = 120.0;

impl<'a> Beside<'a> {
    /// Sorts a cloud into boxes of about `size_cm`. `near` says what it will be asked about: points far from all of that are left out.
    pub fn new(cloud: &'a Cloud, near: impl Iterator<Item = Vec3>, size_cm: f64) -> Self {
        let (mut least, mut most) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        for x in near {
            least = least.inf(&x);
            most = most.sup(&x);
        }
        let any = least.x <= most.x;
        if !any {
            (least, most) = (Vec3::zeros(), Vec3::zeros());
        }
        least -= Vec3::repeat(size_cm);
        most += Vec3::repeat(size_cm);
        let size_cm = size_cm.max((most - least).max() / MOST_BOXES);
        let counts: [usize; 3] = std::array::from_fn(|k| ((most[k] - least[k]) / size_cm) as usize + 1);
        let mut beside = Self {
            cloud,
            least,
            size_cm,
            counts,
            starts: vec![0; counts.iter().product::<usize>() + 1],
            order: Vec::new(),
            side: cloud.side(),
        };
        let boxes: Vec<Option<usize>> = cloud.points.iter().map(|x| beside.at(x)).collect();
        for at in boxes.iter().flatten() {
            beside.starts[at + 1] += 1;
        }
        for at in 1..beside.starts.len() {
            beside.starts[at] += beside.starts[at - 1];
        }
        beside.order.resize(beside.starts.last().map_or(0, |&count| count as usize), 0);
        let mut next = beside.starts.clone();
        for (point, at) in boxes.iter().enumerate() {
            if let Some(at) = at {
                beside.order[next[*at] as usize] = point as u32;
                next[*at] += 1;
            }
        }
        beside
    }

    /// True if a surface with this normal may be seen at all.
    pub fn faces(&self, normal: &Vec3) -> bool {
        self.side.is_none_or(|side| side.dot(normal) > FACING || *normal == Vec3::zeros())
    }

    /// The box of a point, along each axis.
    fn cell(&self, x: &Vec3) -> [f64; 3] {
        std::array::from_fn(|k| ((x[k] - self.least[k]) / self.size_cm).floor())
    }

    fn at(&self, x: &Vec3) -> Option<usize> {
        let cell = self.cell(x);
        let inside = (0..3).all(|k| cell[k] >= 0.0 && cell[k] < self.counts[k] as f64);
        inside.then(|| (cell[2] as usize * self.counts[1] + cell[1] as usize) * self.counts[0] + cell[0] as usize)
    }

    /// The squared distance of the nearest point with a compatible normal, cm²; `most` if there is none nearer than that.
    /// `most` is at most the square of the boxes' size.
    pub fn square(&self, x: &Vec3, normal: &Vec3, cosine: f64, most: f64) -> f64 {
        let cell = self.cell(x);
        let range = |k: usize| {
            let low = (cell[k] - 1.0).clamp(0.0, self.counts[k] as f64) as usize;
            let high = (cell[k] + 2.0).clamp(0.0, self.counts[k] as f64) as usize;
            (low, high.max(low))
        };
        let ((x0, x1), (y0, y1), (z0, z1)) = (range(0), range(1), range(2));
        let mut best = most;
        for z in z0..z1 {
            for y in y0..y1 {
                // boxes of a row lie behind each other
                let row = (z * self.counts[1] + y) * self.counts[0];
                let (first, last) = (self.starts[row + x0] as usize, self.starts[row + x1] as usize);
                for &point in &self.order[first..last] {
                    let square = (self.cloud.points[point as usize] - x).norm_squared();
                    if square < best {
                        let other = &self.cloud.normals[point as usize];
                        if other.dot(normal) > cosine || *other == Vec3::zeros() || *normal == Vec3::zeros() {
                            best = square;
                        }
                    }
                }
            }
        }
        best
    }
}

/// For each part, the share of its vertices with a compatible point within `reach_cm`; NaN for parts without vertices. Where all points face one side,
/// vertices that face another one do not count, and a part that has no others is not covered.
pub fn coverage(body: &Body, posed: &[Rigid], beside: &Beside<'_>, cosine: f64, reach_cm: f64) -> Vec<f64> {
    let share = |(surface, rigid): (&Vec<u32>, &Rigid)| {
        let most = reach_cm * reach_cm;
        let (mut covered, mut all) = (0_usize, 0_usize);
        for &vertex in surface {
            let normal = rigid.rotation * body.normals[vertex as usize];
            if beside.faces(&normal) {
                all += 1;
                covered += usize::from(beside.square(&rigid.point(&body.vertices[vertex as usize]), &normal, cosine, most) < most);
            }
        }
        if surface.is_empty() { f64::NAN } else { covered as f64 / all.max(1) as f64 }
    };
    body.surfaces.par_iter().zip(posed).map(share).collect()
}
