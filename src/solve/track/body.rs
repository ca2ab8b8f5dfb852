//! A body whose surface follows its skeleton.

use crate::solve::ik::{Rigid, Tree, Vec3};

/// A surface whose every vertex moves with one part (the report's rigged mesh), in centimetres.
#[derive(Clone, Debug)]
pub struct Body {
    /// The skeleton.
    pub tree: Tree,
    /// Vertices in the reference pose, cm.
    pub vertices: Vec<Vec3>,
    /// Their outward normals; 0 for a vertex without faces.
    pub normals: Vec<Vec3>,
    /// Triangles.
    pub faces: Vec<[u32; 3]>,
    /// The joint of every vertex.
    pub parts: Vec<usize>,
    /// The vertices of every joint.
    pub surfaces: Vec<Vec<u32>>,
    /// For every joint a ball around those vertices in the reference pose: its middle and radius, cm.
    pub balls: Vec<(Vec3, f64)>,
}

impl Body {
    /// `parts` has the joint of every vertex. Normals are computed from faces where `normals` is empty.
    pub fn new(tree: Tree, vertices: Vec<Vec3>, normals: Vec<Vec3>, faces: Vec<[u32; 3]>, parts: Vec<usize>) -> Self {
        let normals = if normals.len() == vertices.len() { normals } else { vertex_normals(&vertices, &faces) };
        let mut surfaces = vec![Vec::new(); tree.joints()];
        for (vertex, &part) in parts.iter().enumerate() {
            surfaces[part].push(vertex as u32);
        }
        let balls = surfaces.iter().map(|surface| ball(&vertices, surface)).collect();
        Self { tree, vertices, normals, faces, parts, surfaces, balls }
    }

    /// The same body in another size.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        for vertex in &mut scaled.vertices {
            *vertex *= factor;
        }
        for link in &mut scaled.tree.links {
            link.centre *= factor;
        }
        for (middle, radius) in &mut scaled.balls {
            *middle *= factor;
            *radius *= factor;
        }
        scaled
    }

    /// Turns all normals around.
    pub fn turn_normals(&mut self) {
        for normal in &mut self.normals {
            *normal = -*normal;
        }
    }

    /// Where the vertices are when the parts have moved, cm.
    pub fn posed<'a>(&'a self, parts: &'a [Rigid]) -> impl Iterator<Item = Vec3> + 'a {
        self.vertices.iter().zip(&self.parts).map(|(x, &part)| parts[part].point(x))
    }

    /// From the lowest to the highest vertex along the longest side, cm.
    pub fn size_cm(&self) -> f64 {
        self.size().max()
    }

    /// The sides of the box around the surface, cm.
    fn size(&self) -> Vec3 {
        let (mut least, mut most) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        for x in &self.vertices {
            least = least.inf(x);
            most = most.sup(x);
        }
        (most - least).sup(&Vec3::zeros())
    }
}

/// A ball around some vertices.
fn ball(vertices: &[Vec3], surface: &[u32]) -> (Vec3, f64) {
    let (mut least, mut most) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    for &vertex in surface {
        least = least.inf(&vertices[vertex as usize]);
        most = most.sup(&vertices[vertex as usize]);
    }
    let middle = if surface.is_empty() { Vec3::zeros() } else { (least + most) / 2.0 };
    let radius = surface.iter().map(|&vertex| (vertices[vertex as usize] - middle).norm()).fold(0.0, f64::max);
    (middle, radius)
}

/// The normals of vertices: the means of their faces', weighed by area. 0 where there are no faces.
pub fn vertex_normals(vertices: &[Vec3], faces: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::zeros(); vertices.len()];
    for face in faces {
        let [a, b, c] = face.map(|at| vertices[at as usize]);
        let normal = (b - a).cross(&(c - a));
        for at in face {
            normals[*at as usize] += normal;
        }
    }
    for normal in &mut normals {
        *normal = normal.try_normalize(1e-12).unwrap_or_default();
    }
    normals
}
