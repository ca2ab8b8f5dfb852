//! The bones of one frame as lines, and what was filled as balls with labels: both are drawn by viewers as they are.

use super::FRAME_ID;
use super::cloud::{FILLED, OBSERVED, Rgba};
use super::frames::Look;
use super::schema::foxglove::{
    Color, KeyValuePair, LinePrimitive, Point3, Pose, Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, TextPrimitive, Vector3,
    line_primitive,
};
use super::schema::marker_states::State;
use crate::solve::Bone;
use prost_types::{Duration, Timestamp};

/// A pose that moves and turns nothing. A quaternion of zeros would make viewers refuse the whole thing.
pub(super) const IDENTITY: Pose =
    Pose { position: Some(Vector3 { x: 0.0, y: 0.0, z: 0.0 }), orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }) };

/// Pixels.
pub(super) const LINE_WIDTH: f64 = 2.0;
/// Pixels.
const FONT_SIZE: f64 = 12.0;
/// Balls are as large as the predicted error, within these limits, in metres.
const RADII: (f64, f64) = (0.012, 0.25);

pub(super) fn color(rgba: Rgba, opaque: f64) -> Color {
    let [r, g, b, _] = rgba.map(|byte| f64::from(byte) / 255.0);
    Color { r, g, b, a: opaque }
}

fn metres(p: [f64; 3]) -> [f64; 3] {
    p.map(|x| x * 1e-3)
}

fn at(p: [f64; 3]) -> Pose {
    let [x, y, z] = metres(p);
    Pose { position: Some(Vector3 { x, y, z }), ..IDENTITY }
}

pub(super) fn entity(id: &str, time: Timestamp) -> SceneEntity {
    SceneEntity {
        timestamp: Some(time),
        frame_id: FRAME_ID.to_owned(),
        id: id.to_owned(),
        lifetime: Some(Duration::default()), // it stays until the next frame replaces it
        ..SceneEntity::default()
    }
}

/// The skeleton and the filled markers of a frame.
pub(super) fn scene(time: Timestamp, look: &Look<'_>, bones: &[Bone]) -> SceneUpdate {
    SceneUpdate { deletions: Vec::new(), entities: vec![lines(time, look, bones), balls(time, look)] }
}

/// Every bone whose two ends are known. A line runs from the colour of one end to that of the other.
///
/// Each line has two points of its own: viewers count lines by points, and would leave out those that indices make of fewer.
fn lines(time: Timestamp, look: &Look<'_>, bones: &[Bone]) -> SceneEntity {
    let mut points = Vec::with_capacity(2 * bones.len());
    let mut colors = Vec::new();
    // one colour for all takes less room
    let plain = look.samples.iter().all(|sample| sample.state != State::Filled);
    for [a, b] in bones.iter().filter_map(|bone| look.ends(bone)) {
        let ends = [a, b].map(|end| &look.samples[end]);
        let [Some(from), Some(to)] = ends.map(|sample| sample.position_mm) else { continue };
        points.extend([from, to].map(metres).map(|[x, y, z]| Point3 { x, y, z }));
        if !plain {
            colors.extend(ends.map(|sample| if sample.state == State::Filled { color(FILLED, 1.0) } else { color(OBSERVED, 0.6) }));
        }
    }
    let mut entity = entity("skeleton", time);
    if !points.is_empty() {
        entity.lines.push(LinePrimitive {
            r#type: line_primitive::Type::LineList.into(),
            pose: Some(IDENTITY),
            thickness: LINE_WIDTH,
            scale_invariant: true,
            points,
            color: plain.then(|| color(OBSERVED, 0.6)),
            colors,
            indices: Vec::new(),
        });
    }
    entity
}

/// A ball of the size of its predicted error and a label for every filled marker; the same numbers as metadata, which viewers show on a click.
fn balls(time: Timestamp, look: &Look<'_>) -> SceneEntity {
    let mut entity = entity("filled", time);
    for (sample, label) in look.samples.iter().zip(look.labels).filter(|(sample, _)| sample.state == State::Filled) {
        let Some(p) = sample.position_mm else { continue };
        let sigma_mm = sample.sigma_mm;
        let radius = if sigma_mm.is_finite() { (sigma_mm * 1e-3).clamp(RADII.0, RADII.1) } else { RADII.0 };
        let size = Some(Vector3 { x: 2.0 * radius, y: 2.0 * radius, z: 2.0 * radius });
        entity.spheres.push(SpherePrimitive { pose: Some(at(p)), size, color: Some(color(FILLED, 0.35)) });
        let told = if sigma_mm.is_finite() { format!("±{sigma_mm:.1} mm") } else { "filled".to_owned() };
        entity.texts.push(TextPrimitive {
            pose: Some(at(p)),
            billboard: true,
            font_size: FONT_SIZE,
            scale_invariant: true,
            color: Some(color(FILLED, 1.0)),
            text: format!("{label} {told}"),
        });
        entity.metadata.push(KeyValuePair { key: label.clone(), value: told });
    }
    entity
}
