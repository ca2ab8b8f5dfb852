//! Writes an actor who walks to a folder: the rig, the clouds, the markers, and the truth.

use super::{Actor, MarkerOptions, Motion, ScanOptions};
use crate::output::unwritable;
use crate::repair::RepairError;
use crate::staging;
use formats::FormatError;
use formats::rig::{Mesh, write_limits, write_mesh, write_parts, write_skeleton};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What the sequence is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyOptions {
    /// Number of frames, and so of clouds.
    pub frames: usize,
    /// Frames per second.
    pub rate_hz: f64,
    /// Decides on the body, its way of walking, and the noise.
    pub seed: u64,
}

impl Default for BodyOptions {
    fn default() -> Self {
        Self { frames: 60, rate_hz: 30.0, seed: 1 }
    }
}

/// The first joint that the truth tells of: the root is where the torso is.
const FIRST: usize = 1;

/// Writes the rig as `body.off`, `.skl`, `.cst` and `.vj`, a cloud of every frame into the folder `clouds`, `markers.csv` with
/// `markers_map.csv`, and `truth_joints.csv` into `folder`, which is made if it is not there. Lengths are in cm.
/// Returns the names; the clouds are named by their folder.
///
/// # Errors
/// A file exists and `force` is false, or the folder cannot be written to.
pub fn write_body(folder: &Path, options: &BodyOptions, force: bool) -> Result<Vec<PathBuf>, RepairError> {
    let io = |path: &Path, problem: String| RepairError::Io { path: path.to_owned(), problem };
    let clouds = folder.join("clouds");
    let cloud_of = |frame: usize| clouds.join(format!("frame_{frame:03}.off"));
    let named = ["body.off", "body.skl", "body.cst", "body.vj", "markers.csv", "markers_map.csv", "truth_joints.csv"];
    let named = named.map(|name| folder.join(name));
    for path in named.iter().cloned().chain((0..options.frames).map(cloud_of)) {
        if path.exists() && !force {
            return Err(io(&path, "exists already; give another folder, or say --force to replace it".to_owned()));
        }
    }
    std::fs::create_dir_all(&clouds).map_err(|e| io(&clouds, format!("cannot be made: {e}")))?;
    let actor = Actor::new(options.seed);
    let poses = actor.poses(Motion::Walk, options.frames, options.rate_hz);
    let put = |path: &Path, write: &dyn Fn(&mut Vec<u8>) -> Result<(), FormatError>| {
        let mut bytes = Vec::new();
        write(&mut bytes).map_err(|error| RepairError::Format { path: path.to_owned(), error })?;
        let mut file = staging::beside(path).map_err(|e| unwritable(path, &e))?;
        std::io::Write::write_all(&mut file, &bytes).map_err(|e| unwritable(path, &e))?;
        staging::publish(file, path).map_err(|e| unwritable(path, &e))
    };
    let text = |path: &Path, text: String| {
        put(path, &|out| {
            out.extend_from_slice(text.as_bytes());
            Ok(())
        })
    };
    let [mesh, skeleton, limits, parts, markers, map, truth] = &named;
    put(mesh, &|out| write_mesh(&rounded(&actor.mesh), out))?;
    put(skeleton, &|out| write_skeleton(&actor.skeleton, out))?;
    put(limits, &|out| write_limits(&actor.limits, &actor.skeleton, out))?;
    put(parts, &|out| write_parts(&actor.parts, &actor.skeleton, out))?;
    for (frame, pose) in poses.iter().enumerate() {
        let cloud = rounded(&actor.scan(pose, frame, &ScanOptions::default()));
        put(&cloud_of(frame), &|out| write_mesh(&cloud, out))?;
    }

    let placed = actor.marker_map();
    let mut lines = String::from("marker,vertex,joint\n");
    for marker in &placed {
        let _ = writeln!(lines, "{},{},{}", marker.name, marker.vertex, actor.skeleton.joints[marker.joint].name);
    }
    text(map, lines)?;
    let names: Vec<&str> = placed.iter().map(|marker| marker.name.as_str()).collect();
    text(markers, table(&names, &actor.markers(&poses, &MarkerOptions::default()), 3))?;
    let names: Vec<&str> = actor.skeleton.joints[FIRST..].iter().map(|joint| joint.name.as_str()).collect();
    let joints: Vec<Vec<Option<[f64; 3]>>> =
        poses.iter().map(|pose| actor.joints(pose)[FIRST..].iter().map(|&joint| Some(joint)).collect()).collect();
    text(truth, table(&names, &joints, 4))?;
    let [mesh, skeleton, limits, parts, markers, map, truth] = named;
    Ok(vec![mesh, skeleton, limits, parts, clouds, markers, map, truth])
}

/// A row for every frame, three columns for every name; hidden samples are empty.
fn table(names: &[&str], frames: &[Vec<Option<[f64; 3]>>], decimals: usize) -> String {
    let mut lines = String::from("frame");
    for name in names {
        let _ = write!(lines, ",{name}_x,{name}_y,{name}_z");
    }
    lines.push('\n');
    for (index, frame) in frames.iter().enumerate() {
        let _ = write!(lines, "{index}");
        for sample in frame {
            let _ = match sample {
                Some([x, y, z]) => write!(lines, ",{x:.decimals$},{y:.decimals$},{z:.decimals$}"),
                None => write!(lines, ",,,"),
            };
        }
        lines.push('\n');
    }
    lines
}

/// The mesh to the micrometre, and to four decimals of its normals: more would be written of every number than anybody measures.
fn rounded(mesh: &Mesh) -> Mesh {
    // Adding 0 turns -0 into 0.
    let round = |list: &[[f64; 3]]| list.iter().map(|point| point.map(|x| (x * 1e4).round() / 1e4 + 0.0)).collect();
    Mesh { vertices: round(&mesh.vertices), normals: round(&mesh.normals), faces: mesh.faces.clone() }
}
