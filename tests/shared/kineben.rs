//! Rigs and clouds of points of sequences whose truth is known, and the skeletons of their recordings.

use super::expect;
use formats::bvh::{Bvh, Motion, Order, State, write_motion};
use formats::rig::{self, JointKind, Skeleton};
use formats::{Format, Note, Notes, Stated, Unit};
use libtest_mimic::Failed;
use std::path::Path;

/// Sequences, and how many clouds each has.
pub const SEQUENCES: [(&str, usize); 2] = [("walk", 100), ("gym", 120)];

/// Everything of a sequence reads, and reads as the same once it is written.
pub fn sequence(folder: &Path, clouds: usize) -> Result<(), Failed> {
    let file = |name: &str| std::fs::read(folder.join(name));
    let notes = Notes::new();
    let mesh = rig::read_mesh(&file("model.off")?, &notes)?;
    expect("vertices and faces", (mesh.vertices.len(), mesh.faces.len()), (3501, 6998))?;
    let mut out = Vec::new();
    rig::write_mesh(&mesh, &mut out)?;
    expect("the surface again", rig::read_mesh(&out, &notes)? == mesh, true)?;
    let skeleton = rig::read_skeleton(&file("model.skl")?, &notes)?;
    expect("joints and degrees of freedom", (skeleton.joints.len(), skeleton.freedom()), (15, 29))?;
    expect("notes", notes.take().len(), 0)?;
    let mut out = Vec::new();
    rig::write_skeleton(&skeleton, &mut out)?;
    expect("the skeleton again", rig::read_skeleton(&out, &notes)? == skeleton, true)?;
    let limits = rig::read_limits(&file("model.cst")?, &skeleton, None, &notes)?;
    expect("limits", limits.iter().flatten().count(), 13)?;
    expect("a note of degrees", matches!(notes.take().as_slice(), [Note::Assumed { .. }]), true)?;
    let parts = rig::read_parts(&file("model.vj")?, &skeleton, mesh.vertices.len())?;
    expect("parts", parts.len(), 3501)?;
    expect("vertices of the root", parts.contains(&0), false)?;
    let mut out = Vec::new();
    rig::write_parts(&parts, &skeleton, &mut out)?;
    expect("the parts again", rig::read_parts(&out, &skeleton, mesh.vertices.len())? == parts, true)?;
    for frame in 0..clouds {
        let cloud = rig::read_mesh(&file(&format!("clouds/frame_{frame:03}.off"))?, &notes)?;
        // points with normals, or a surface that gives them
        expect("normals", cloud.normals.len() == cloud.vertices.len() || !cloud.faces.is_empty(), true)?;
        expect("an empty cloud", cloud.vertices.is_empty(), false)?;
    }
    at_rest(&skeleton)?;
    let recorded = rig::skeleton_of_bvh(&file("truth.bvh")?, &notes)?;
    expect("joints of the recording", recorded.joints.first().map(|joint| joint.kind), Some(JointKind::Translate))?;
    expect("a tree", recorded.joints.iter().skip(1).all(|joint| joint.parent.is_some()), true)?;
    at_rest(&recorded)
}

/// The reference pose, written as a motion of one frame, has its joints where the skeleton has them.
fn at_rest(skeleton: &Skeleton) -> Result<(), Failed> {
    let rest = |kind| match kind {
        JointKind::Translate => State::Shift([0.0; 3]),
        JointKind::Revolute { .. } => State::Angle(0.0),
        JointKind::Ball => State::Rotation([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    };
    let frames = [skeleton.joints.iter().map(|joint| rest(joint.kind)).collect()];
    let motion = Motion { skeleton, ends: Vec::new(), frame_secs: 1.0 / 30.0, order: Order::default(), frames: &frames };
    let mut out = Vec::new();
    write_motion(&motion, &mut out)?;
    let stated = Stated { unit: Some(Unit::Millimetre), ..Stated::default() };
    let document = Bvh.open(out, &stated, &Notes::new())?;
    let take = document.take();
    expect("frames per second", take.rate_hz, 30.0)?;
    let mut found = 0;
    for (column, marker) in take.markers.iter().enumerate() {
        let Some(joint) = skeleton.joint(&marker.label).and_then(|at| skeleton.joints.get(at)) else { continue };
        let place = take.position_mm(0, column).ok_or("a joint without a place")?;
        let off = place.iter().zip(joint.centre).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        expect("a joint where it is", off < 1e-4, true)?;
        found += 1;
    }
    // the root and the ball at its place are one
    expect("joints found", found, skeleton.joints.len() - 1)
}
