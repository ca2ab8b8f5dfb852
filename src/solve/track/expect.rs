//! The E-step: how probable it is that a point belongs to each part of the body (section 3.3).

use super::body::Body;
use super::nearest::{Nearest, Query};
use crate::solve::ik::terms::Pair;
use crate::solve::ik::{Rigid, Vec3};
use rayon::prelude::*;

/// A cloud of points, in centimetres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Points.
    pub points: Vec<Vec3>,
    /// Their normals, of length 1 or 0; as many as points.
    pub normals: Vec<Vec3>,
}

impl Cloud {
    /// The direction that all points face, more or less, if they do: a single camera sees one side only.
    pub fn side(&self) -> Option<Vec3> {
        let sum: Vec3 = self.normals.iter().sum();
        let known = self.normals.iter().filter(|normal| **normal != Vec3::zeros()).count();
        (sum.norm() > ONE_SIDED * known as f64).then(|| sum.normalize())
    }
}

/// The mixture of a body's parts and a uniform class for what belongs to none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture {
    /// Standard deviation of all parts, cm.
    pub sigma_cm: f64,
    /// What the uniform class has against a part at distance 0 (the report's Eoutlier).
    pub outlier: f64,
    /// The least cosine between the normals of a point and its vertex.
    pub cosine: f64,
    /// How far vertices are apart, cm.
    pub spacing_cm: f64,
    /// How many standard deviations away a part still counts.
    pub reach: f64,
}

/// What an E-step found.
#[derive(Clone, Debug, Default)]
pub struct Expected {
    /// Points and the vertices that they may belong to.
    pub pairs: Vec<Pair>,
    /// For each pair, its point and its vertex.
    pub names: Vec<[u32; 2]>,
    /// Log-likelihood of the cloud, nats, with equal shares for all parts and the uniform class.
    pub log_likelihood: f64,
    /// The share of the points that belong to the body.
    pub inliers: f64,
    /// For each part, the points that belong to it.
    pub mass: Vec<f64>,
    /// For each part, the sum of their squared distances, cm².
    pub squares: Vec<f64>,
}

/// Points are seen from one side if their mean normal is longer than this; half of a ball has 0.5.
const ONE_SIDED: f64 = 0.3;
/// Points of one task. A constant, so that sums do not depend on the number of cores.
const CHUNK: usize = 256;
/// More than what distances are rounded by.
const ROUNDING: f64 = 1.0 + 1e-9;
/// No vertex.
const NONE: u32 = u32::MAX;

/// Does E-steps on clouds, again and again.
#[derive(Clone, Debug, Default)]
pub struct Expectation {
    /// For each point and part, the vertex that was nearest last time.
    hints: Vec<u32>,
    /// What was found.
    pub found: Expected,
}

/// What one task found.
#[derive(Default)]
struct Chunk {
    pairs: Vec<Pair>,
    names: Vec<[u32; 2]>,
    log_likelihood: f64,
    inliers: f64,
    mass: Vec<f64>,
    squares: Vec<f64>,
}

impl Expectation {
    /// Forgets which vertices were near: for a new cloud.
    pub fn forget(&mut self, body: &Body, cloud: &Cloud) {
        self.hints.clear();
        self.hints.resize(cloud.points.len() * body.tree.joints(), NONE);
    }

    /// One E-step (equation 21), with the parts where `posed` puts them. [`forget`](Self::forget) comes before the first of a cloud.
    /// It looks at one point in `every`; sums are those of the whole cloud, as far as those points tell.
    pub fn step(&mut self, body: &Body, nearest: &dyn Nearest, cloud: &Cloud, posed: &[Rigid], mixture: &Mixture, every: usize) {
        let joints = body.tree.joints();
        let parts: Vec<usize> = (0..joints).filter(|&part| !body.surfaces[part].is_empty()).collect();
        let chunks: Vec<Chunk> = self
            .hints
            .par_chunks_mut(CHUNK * joints * every)
            .enumerate()
            .map(|(at, hints)| chunk(body, nearest, cloud, posed, mixture, &parts, at * CHUNK * every, every, hints))
            .collect();
        let found = &mut self.found;
        found.pairs.clear();
        found.names.clear();
        (found.log_likelihood, found.inliers) = (0.0, 0.0);
        for sum in [&mut found.mass, &mut found.squares] {
            sum.clear();
            sum.resize(joints, 0.0);
        }
        for chunk in chunks {
            found.pairs.extend_from_slice(&chunk.pairs);
            found.names.extend_from_slice(&chunk.names);
            found.log_likelihood += chunk.log_likelihood;
            found.inliers += chunk.inliers;
            for part in 0..joints {
                found.mass[part] += chunk.mass[part];
                found.squares[part] += chunk.squares[part];
            }
        }
        let looked = cloud.points.len().div_ceil(every).max(1) as f64;
        let all = cloud.points.len() as f64 / looked;
        found.inliers /= looked;
        found.log_likelihood *= all;
        for sum in found.mass.iter_mut().chain(&mut found.squares) {
            *sum *= all;
        }
    }
}

#[allow(clippy::too_many_arguments)] // one loop, in a function for its tasks
fn chunk(
    body: &Body,
    nearest: &dyn Nearest,
    cloud: &Cloud,
    posed: &[Rigid],
    mixture: &Mixture,
    parts: &[usize],
    first: usize,
    every: usize,
    hints: &mut [u32],
) -> Chunk {
    let joints = body.tree.joints();
    let mut chunk = Chunk { mass: vec![0.0; joints], squares: vec![0.0; joints], ..Chunk::default() };
    let within = mixture.reach.powi(2) * (mixture.sigma_cm.powi(2) + mixture.spacing_cm.powi(2));
    let scale = -0.5 / (mixture.sigma_cm * mixture.sigma_cm);
    let scale_along = -0.5 / (mixture.sigma_cm * mixture.sigma_cm + mixture.spacing_cm * mixture.spacing_cm);
    // Gaussians are as high as they are narrow, along the normal and across it
    let peak = 0.5 * (scale / -std::f64::consts::PI).ln() + (scale_along / -std::f64::consts::PI).ln() - ((parts.len() + 1) as f64).ln();
    // where each part's ball is, and how far from its middle a point may be, squared and a little more
    let balls: Vec<(usize, Vec3, f64)> = parts
        .iter()
        .map(|&part| {
            let (middle, radius) = body.balls[part];
            (part, posed[part].point(&middle), (radius + within.sqrt()).powi(2) * ROUNDING)
        })
        .collect();
    let mut near: Vec<(usize, u32, f64, f64)> = Vec::new();
    for (at, hints) in hints.chunks_exact_mut(joints).enumerate().step_by(every) {
        let (point, normal) = (cloud.points[first + at], cloud.normals[first + at]);
        near.clear();
        let mut sum = mixture.outlier;
        for &(part, middle, far) in &balls {
            if (point - middle).norm_squared() > far {
                continue;
            }
            let rigid = &posed[part];
            let query = Query { point: rigid.back(&point), normal: rigid.rotation.tr_mul(&normal), cosine: mixture.cosine, within };
            let hint = Some(hints[part]).filter(|&hint| hint != NONE);
            if let Some(found) = nearest.nearest(part, &query, hint) {
                hints[part] = found.vertex;
                let name = found.vertex as usize;
                let off = (query.point - body.vertices[name]).dot(&body.normals[name]);
                let across = off * off;
                let kernel = (across * scale + (found.square - across) * scale_along).exp();
                sum += kernel;
                near.push((part, found.vertex, found.square, kernel));
            }
        }
        chunk.log_likelihood += sum.ln() + peak;
        for &(part, vertex, square, kernel) in &near {
            let share = kernel / sum;
            chunk.inliers += share;
            chunk.mass[part] += share;
            chunk.squares[part] += share * square;
            let name = vertex as usize;
            chunk.names.push([(first + at) as u32, vertex]);
            chunk.pairs.push(Pair { part: part as u32, vertex: body.vertices[name], normal: body.normals[name], point, weight: share });
        }
    }
    chunk
}
