//! The surface in the reference pose, and how it hangs on the bones.

use super::figure::{ARM, Figure, JOINTS, LEG, TORSO};
use super::flesh::Flesh;
use super::net::{self, Lattice};
use formats::rig::Mesh;
use nalgebra::Vector3;

/// Distance of the planes of the grid, in cm: elsewhere, and where hands and feet are.
const SPACING_CM: [f64; 2] = [3.05, 1.9];
/// How often vertices are moved to the middle of their neighbours, within the surface.
const EVENINGS: usize = 8;
/// How often folds are smoothed.
const UNFOLDINGS: usize = 4;
/// How often the weights of neighbours are mixed: joints bend over about 1.4 times the distance of vertices to either side.
const MIXINGS: usize = 8;

/// What moves a vertex: the parts with their joints, and three more that bend within the torso.
pub(super) const MOVERS: usize = JOINTS + 3;
/// The upper end of the back.
pub(super) const CHEST: usize = JOINTS;
/// The shoulders, left and right.
pub(super) const SHOULDER: [usize; 2] = [JOINTS + 1, JOINTS + 2];

/// A surface with the joint of every vertex, and what moves it by how much.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub(super) mesh: Mesh,
    pub(super) parts: Vec<usize>,
    /// For every vertex: movers and shares, which add up to 1.
    pub(super) weights: Vec<Vec<(usize, f64)>>,
}

impl Body {
    pub(super) fn new(figure: &Figure) -> Self {
        let flesh = Flesh::new(figure);
        let (mut vertices, faces) = polygons(figure, &flesh);
        let neighbours = net::neighbours(vertices.len(), &faces);
        even(&flesh, &mut vertices, &neighbours);
        unfold(&mut vertices, &faces, &neighbours);
        let parts: Vec<usize> = vertices.iter().map(|vertex| flesh.part(vertex)).collect();
        let weights = weights(figure, &vertices, &parts, &neighbours);
        let vertices: Vec<[f64; 3]> = vertices.into_iter().map(Into::into).collect();
        let normals = net::normals(&vertices, &faces);
        Self { mesh: Mesh { vertices, normals, faces }, parts, weights }
    }
}

/// The surface on a grid that is finer at hands and feet.
fn polygons(figure: &Figure, flesh: &Flesh) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let (m, wrist, ankle) = (&figure.measures, figure.centres[ARM[0] + 2], figure.centres[LEG[0] + 2]);
    let planes = |low: f64, high: f64, fine: &dyn Fn(f64) -> bool| {
        let mut planes = vec![low];
        let mut at = low;
        while at < high {
            at += SPACING_CM[usize::from(fine(at))] * figure.measures.stature / 174.0;
            planes.push(at);
        }
        planes
    };
    let reach = wrist.x + m.hand + 6.0;
    let lattice = Lattice {
        planes: [
            planes(-reach, reach, &|x| x.abs() > wrist.x),
            planes(-5.0, m.stature + 5.0, &|y| y < ankle.y),
            planes(-24.0, f64::max(ankle.z + m.foot, wrist.z + m.hand) + 6.0, &|z| z > 13.0),
        ],
    };
    let mut values = lattice.values(|point| flesh.value(&point));
    net::join(&lattice, &mut values);
    let (vertices, quads) = net::surface(&lattice, &values);
    let faces = net::triangles(&vertices, &quads);
    (vertices, faces)
}

/// Moves a point towards the surface; twice is enough for a hundredth of a millimetre where it is near.
fn settle(flesh: &Flesh, point: &mut Vector3<f64>) {
    let (value, slope) = flesh.value_and_slope(point);
    let step = slope * (value / slope.norm_squared().max(0.1));
    *point -= step.cap_magnitude(0.7);
}

/// Spreads the vertices evenly over the surface.
fn even(flesh: &Flesh, vertices: &mut [Vector3<f64>], neighbours: &[Vec<usize>]) {
    for _ in 0..EVENINGS {
        let means = means(vertices, neighbours);
        for (vertex, mean) in vertices.iter_mut().zip(means) {
            *vertex = vertex.lerp(&mean, 0.4);
            settle(flesh, vertex);
        }
    }
    for vertex in vertices {
        settle(flesh, vertex);
        settle(flesh, vertex);
    }
}

/// Smooths the few places, between thumb and palm and the like, where the surface is folded more finely than the grid can show.
fn unfold(vertices: &mut [Vector3<f64>], faces: &[[u32; 3]], neighbours: &[Vec<usize>]) {
    for _ in 0..UNFOLDINGS {
        let plain: Vec<[f64; 3]> = vertices.iter().map(|&vertex| vertex.into()).collect();
        let normals = net::normals(&plain, faces);
        let mut folded = vec![false; vertices.len()];
        for face in faces {
            let [a, b, c] = face.map(|vertex| vertices[vertex as usize]);
            let normal = (b - a).cross(&(c - a)).normalize();
            for &vertex in face {
                folded[vertex as usize] |= normal.dot(&Vector3::from(normals[vertex as usize])) < 0.3;
            }
        }
        let means = means(vertices, neighbours);
        for (vertex, mean) in (0..vertices.len()).filter(|&vertex| folded[vertex]).map(|vertex| (vertex, means[vertex])) {
            vertices[vertex] = mean;
        }
    }
}

/// The middle of the neighbours of every vertex.
fn means(vertices: &[Vector3<f64>], neighbours: &[Vec<usize>]) -> Vec<Vector3<f64>> {
    neighbours.iter().map(|list| list.iter().map(|&n| vertices[n]).sum::<Vector3<f64>>() / list.len() as f64).collect()
}

/// Every part moves its own vertices; towards other parts the weights change smoothly, as do those of pelvis, chest and shoulders.
fn weights(figure: &Figure, vertices: &[Vector3<f64>], parts: &[usize], neighbours: &[Vec<usize>]) -> Vec<Vec<(usize, f64)>> {
    let mut shares: Vec<[f64; JOINTS]> =
        parts.iter().map(|&part| std::array::from_fn(|joint| if joint == part { 1.0 } else { 0.0 })).collect();
    for _ in 0..MIXINGS {
        shares = shares
            .iter()
            .zip(neighbours)
            .map(|(own, list)| {
                let mean = |joint: usize| list.iter().map(|&n| shares[n][joint]).sum::<f64>() / list.len() as f64;
                std::array::from_fn(|joint| 0.5 * own[joint] + 0.5 * mean(joint))
            })
            .collect();
    }
    let s = figure.measures.stature / 174.0;
    let split = |vertex: &Vector3<f64>, shares: &[f64; JOINTS]| {
        let mut all = [0.0; MOVERS];
        all[..JOINTS].copy_from_slice(shares);
        let torso = all[TORSO];
        // The back bends over 24 cm around the lumbar joint.
        let chest = smooth((vertex.y - figure.lumbar.y) / (24.0 * s) + 0.5);
        let near = ARM.map(|arm| smooth(1.3 - (vertex - figure.centres[arm]).norm() / (15.0 * s)));
        let shoulders = near[0] + near[1];
        all[TORSO] = torso * (1.0 - chest);
        all[CHEST] = torso * chest * (1.0 - shoulders);
        for side in 0..2 {
            all[SHOULDER[side]] = torso * chest * near[side];
        }
        // What is negligible is left out.
        let kept: Vec<(usize, f64)> = all.into_iter().enumerate().filter(|&(_, share)| share > 1e-3).collect();
        let sum: f64 = kept.iter().map(|(_, share)| share).sum();
        kept.into_iter().map(|(mover, share)| (mover, share / sum)).collect()
    };
    vertices.iter().zip(&shares).map(|(vertex, shares)| split(vertex, shares)).collect()
}

/// 0 below 0, 1 above 1.
fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
