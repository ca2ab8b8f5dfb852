//! Visual hulls: what the silhouettes of several cameras leave, which is more than the body.

use super::net::{self, Lattice};
use super::scan::bounds;
use super::{Actor, ActorPose, Camera};
use formats::rig::Mesh;
use nalgebra::Vector3;

/// How far around the body hulls are looked for, in cm. Phantoms may reach there.
const MARGIN_CM: f64 = 18.0;

impl Actor {
    /// The surface of the visual hull of a pose, with normals from how full the neighbourhood is, and with faces.
    /// `voxel_cm` is the size of the cubes that are carved; 2 to 2.8 cm are usual.
    pub fn hull(&self, pose: &ActorPose, cameras: &[Camera], voxel_cm: f64) -> Mesh {
        let (vertices, _) = self.surface(pose);
        let (low, high) = bounds(&vertices);
        // The grid stands still in space, whatever the body does; two rims around it stay empty.
        let margin = MARGIN_CM + 2.0 * voxel_cm;
        let low = low.map(|x| ((x - margin) / voxel_cm).floor() * voxel_cm);
        let lattice = Lattice::even(low.into(), high.add_scalar(margin).into(), voxel_cm);
        let silhouettes: Vec<_> = cameras.iter().map(|camera| camera.silhouette(&vertices, &self.mesh.faces)).collect();
        let inner = |point: &Vector3<f64>| {
            (0..3).all(|axis| {
                let planes = &lattice.planes[axis];
                point[axis] > planes[1] + 0.5 * voxel_cm && point[axis] < planes[planes.len() - 2] - 0.5 * voxel_cm
            })
        };
        let full = lattice.values(|point| inner(&point) && silhouettes.iter().all(|covers| covers(point)));
        let values: Vec<f64> = full.iter().map(|&full| if full { -1.0 } else { 1.0 }).collect();
        let (points, quads) = net::surface(&lattice, &values);
        let normals = points.iter().map(|point| outwards(&lattice, &full, point, voxel_cm).into()).collect();
        let faces = net::triangles(&points, &quads);
        Mesh { vertices: points.into_iter().map(Into::into).collect(), normals, faces }
    }
}

/// Away from the middle of what is full around a point.
fn outwards(lattice: &Lattice, full: &[bool], point: &Vector3<f64>, voxel_cm: f64) -> Vector3<f64> {
    const REACH: usize = 2;
    let size = lattice.size();
    let cell: [usize; 3] = std::array::from_fn(|axis| ((point[axis] - lattice.planes[axis][0]) / voxel_cm) as usize);
    let near = |axis: usize| cell[axis].saturating_sub(REACH)..(cell[axis] + REACH + 2).min(size[axis]);
    let mut away = Vector3::zeros();
    for x in near(0) {
        for y in near(1) {
            for z in near(2) {
                if full[lattice.index([x, y, z])] {
                    let offset = Vector3::new(lattice.planes[0][x], lattice.planes[1][y], lattice.planes[2][z]) - point;
                    let share = (1.0 - offset.norm_squared() / (voxel_cm * (REACH as f64 + 1.0)).powi(2)).max(0.0);
                    away -= offset * share;
                }
            }
        }
    }
    away.try_normalize(1e-9).unwrap_or_default()
}
