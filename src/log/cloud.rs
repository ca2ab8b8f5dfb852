//! The markers of one frame as a point cloud.

use super::FRAME_ID;
use super::frames::Sample;
use super::schema::foxglove::{PackedElementField, PointCloud, packed_element_field::NumericType};
use super::schema::marker_states::State;
use super::skeleton::IDENTITY;
use prost_types::Timestamp;

/// Bytes of a point. Numbers of four bytes lie at multiples of four.
const STRIDE: u32 = 24;

/// A red-green-blue-opaqueness quadruple of bytes.
pub(super) type Rgba = [u8; 4];

/// The file gave it. Blue and orange are told apart by every eye.
pub(super) const OBSERVED: Rgba = [86, 180, 233, 255];
/// It was filled.
pub(super) const FILLED: Rgba = [255, 145, 0, 255];
/// As the file has it: in the background of what was made of it.
pub(super) const RAW: Rgba = [170, 170, 170, 255];

/// What each point consists of: name, place in bytes, type.
pub(super) const FIELDS: [(&str, u32, NumericType); 10] = [
    ("x", 0, NumericType::Float32),
    ("y", 4, NumericType::Float32),
    ("z", 8, NumericType::Float32),
    ("red", 12, NumericType::Uint8),
    ("green", 13, NumericType::Uint8),
    ("blue", 14, NumericType::Uint8),
    ("alpha", 15, NumericType::Uint8),
    ("state", 16, NumericType::Uint8),
    ("marker", 18, NumericType::Uint16),
    ("sigma_mm", 20, NumericType::Float32),
];

/// The cloud without its points, to be given them frame by frame.
pub(super) fn empty() -> PointCloud {
    of_fields(STRIDE, &FIELDS)
}

/// The same with other fields: name, place in bytes, type.
pub(super) fn of_fields(stride: u32, fields: &[(&str, u32, NumericType)]) -> PointCloud {
    PointCloud {
        timestamp: None,
        frame_id: FRAME_ID.to_owned(),
        pose: Some(IDENTITY),
        point_stride: stride,
        fields: fields
            .iter()
            .map(|&(name, offset, kind)| PackedElementField { name: name.to_owned(), offset, r#type: kind.into() })
            .collect(),
        data: Vec::new(),
    }
}

/// A position in mm as the clouds have it.
pub(crate) fn metres(position_mm: [f64; 3]) -> [f32; 3] {
    position_mm.map(|x| (x * 1e-3) as f32)
}

/// One point of a cloud that [`put`] made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point {
    /// Place in the list of markers.
    pub marker: usize,
    /// Position.
    pub metres: [f32; 3],
}

/// The points of a cloud, or `None` if it is not one of ours.
pub(crate) fn points(cloud: &PointCloud) -> Option<Vec<Point>> {
    let (points, rest) = cloud.data.as_chunks::<{ STRIDE as usize }>();
    if cloud.point_stride != STRIDE || !rest.is_empty() {
        return None;
    }
    let float = |p: &[u8; STRIDE as usize], at: usize| f32::from_le_bytes([p[at], p[at + 1], p[at + 2], p[at + 3]]);
    let marker = |p: &[u8; STRIDE as usize]| usize::from(u16::from_le_bytes([p[18], p[19]]));
    Some(points.iter().map(|p| Point { marker: marker(p), metres: [float(p, 0), float(p, 4), float(p, 8)] }).collect())
}

/// Puts the known markers of a frame into `cloud`. `raw`: as the file has them, all of one colour.
pub(super) fn put(cloud: &mut PointCloud, time: Timestamp, samples: &[Sample], raw: bool) {
    cloud.timestamp = Some(time);
    cloud.data.clear();
    for (place, sample) in samples.iter().enumerate() {
        let Some(p) = sample.position_mm else { continue };
        let filled = sample.state == State::Filled;
        let colour = match (raw, filled) {
            (true, _) => RAW,
            (false, true) => FILLED,
            (false, false) => OBSERVED,
        };
        for x in metres(p) {
            cloud.data.extend(x.to_le_bytes());
        }
        cloud.data.extend(colour);
        cloud.data.extend([u8::from(filled), 0]);
        // a take of more than 65,535 markers exists in no laboratory
        cloud.data.extend(u16::try_from(place).unwrap_or(u16::MAX).to_le_bytes());
        cloud.data.extend((sample.sigma_mm as f32).to_le_bytes());
    }
}
