//! A body in space: what was measured of it, its surface, and its joints, as viewers draw them.

use super::channels::timestamp;
use super::cloud::{FILLED, OBSERVED, RAW, Rgba, of_fields};
use super::schema::foxglove::{
    LinePrimitive, Log, Point3, PointCloud, SceneUpdate, line_primitive, log::Level, packed_element_field::NumericType,
};
use super::skeleton::{IDENTITY, LINE_WIDTH, color, entity};
use crate::rig::Rig;
use crate::solve::ik::{Rigid, Vec3};
use prost_types::Timestamp;

/// Bytes of a point.
const STRIDE: u32 = 16;
/// What each point consists of: name, place in bytes, type.
const FIELDS: [(&str, u32, NumericType); 7] = [
    ("x", 0, NumericType::Float32),
    ("y", 4, NumericType::Float32),
    ("z", 8, NumericType::Float32),
    ("red", 12, NumericType::Uint8),
    ("green", 13, NumericType::Uint8),
    ("blue", 14, NumericType::Uint8),
    ("alpha", 15, NumericType::Uint8),
];

/// The colours of parts: neighbours differ, and every eye tells them from what is lost.
const PARTS: [Rgba; 5] = [[86, 180, 233, 255], [0, 158, 115, 255], [204, 121, 167, 255], [240, 228, 66, 255], [0, 114, 178, 255]];

/// What was measured and belongs to the body, or does not.
pub(super) const MEASURED: [Rgba; 2] = [RAW, FILLED];

/// Where the body has a marker.
pub(super) const EXPECTED: Rgba = [240, 240, 240, 255];

/// About so many frames decide where the view looks.
pub(super) const VIEWED: usize = 300;

/// True if a frame is drawn in space, of which so many are drawn per second.
pub(super) fn in_space(frame: u32, rate_hz: f64, log_rate_hz: Option<f64>) -> bool {
    let Some(log_rate_hz) = log_rate_hz.filter(|hz| *hz < rate_hz) else { return true };
    let period = |frame: u32| (f64::from(frame) * log_rate_hz / rate_hz).floor();
    frame == 0 || period(frame) > period(frame - 1)
}

/// What happened in a frame, in words. `number` is the file's own, `source` the file.
pub(super) fn said(time: u64, number: u32, warning: bool, name: &str, message: String, source: &str) -> Log {
    let level = if warning { Level::Warning } else { Level::Info };
    Log { timestamp: Some(timestamp(time)), level: level.into(), message, name: name.to_owned(), file: source.to_owned(), line: number }
}

/// A cloud without points, to be given them frame by frame.
pub(super) fn empty_cloud() -> PointCloud {
    of_fields(STRIDE, &FIELDS)
}

/// Puts points into `cloud`, given in cm.
pub(super) fn put(cloud: &mut PointCloud, time: Timestamp, points: impl Iterator<Item = (Vec3, Rgba)>) {
    cloud.timestamp = Some(time);
    cloud.data.clear();
    for (point, colour) in points {
        for x in point.iter() {
            cloud.data.extend(((x * 1e-2) as f32).to_le_bytes());
        }
        cloud.data.extend(colour);
    }
}

/// The vertices of a posed surface, each in the colour of its part or of what is lost.
pub(super) fn surface<'a>(rig: &'a Rig, parts: &'a [Rigid], lost: &'a [bool]) -> impl Iterator<Item = (Vec3, Rgba)> + 'a {
    let colour = |part: usize| if lost.get(part) == Some(&true) { FILLED } else { PARTS[part % PARTS.len()] };
    rig.body.posed(parts).zip(rig.body.parts.iter().map(move |&part| colour(part)))
}

/// Lines from joint to joint, and to the ends of limbs.
#[derive(Clone, Debug)]
pub(super) struct Limbs {
    /// From joint to joint, with the part between them.
    between: Vec<(usize, usize)>,
    /// Joints without children, and where their parts end in the reference pose, cm.
    ends: Vec<(usize, Vec3)>,
}

impl Limbs {
    pub fn new(rig: &Rig) -> Self {
        let links = &rig.body.tree.links;
        let apart = |a: usize, b: usize| links[a].centre != links[b].centre;
        let between = links.iter().enumerate().filter_map(|(at, link)| link.parent.map(|parent| (parent, at)));
        let leaf = |joint: usize| links.iter().all(|link| link.parent != Some(joint));
        let ends = rig.ends().into_iter().enumerate().filter(|(joint, _)| leaf(*joint));
        Self {
            between: between.filter(|(a, b)| apart(*a, *b)).collect(),
            ends: ends.filter_map(|(joint, end)| end.map(|end| (joint, end))).collect(),
        }
    }

    /// The skeleton of a frame. Each line has two points of its own: viewers count lines by points, and would leave out those that indices make of fewer.
    pub fn scene(&self, time: Timestamp, parts: &[Rigid], centres: &[Vec3], lost: &[bool]) -> SceneUpdate {
        let between = self.between.iter().map(|&(parent, joint)| (parent, centres[parent], centres[joint]));
        let ends = self.ends.iter().map(|&(joint, end)| (joint, centres[joint], parts[joint].point(&end)));
        let (mut points, mut colors) = (Vec::new(), Vec::new());
        let plain = !lost.contains(&true);
        for (part, from, to) in between.chain(ends) {
            points.extend([from, to].map(|p| p * 1e-2).map(|p| Point3 { x: p.x, y: p.y, z: p.z }));
            if !plain {
                let colour = if lost.get(part) == Some(&true) { color(FILLED, 1.0) } else { color(OBSERVED, 1.0) };
                colors.extend([colour; 2]);
            }
        }
        let mut entity = entity("skeleton", time);
        if !points.is_empty() {
            entity.lines.push(LinePrimitive {
                r#type: line_primitive::Type::LineList.into(),
                pose: Some(IDENTITY),
                thickness: 2.0 * LINE_WIDTH,
                scale_invariant: true,
                points,
                color: plain.then(|| color(OBSERVED, 1.0)),
                colors,
                indices: Vec::new(),
            });
        }
        SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
    }
}
