//! Labelled markers on the skin.

use super::figure::JOINTS;
use super::{Actor, ActorPose};
use crate::random::Stream;
use nalgebra::Vector3;

/// How many markers each part carries, in the order of the skeleton: 41 in all.
const COUNTS: [usize; JOINTS] = [0, 7, 4, 2, 2, 2, 2, 2, 2, 3, 3, 3, 3, 3, 3];

/// A marker and where it sits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkinMarker {
    /// Its label: the name of its part, and a number.
    pub name: String,
    /// The vertex of the surface under it.
    pub vertex: usize,
    /// The joint of that vertex.
    pub joint: usize,
}

/// What is recorded of markers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarkerOptions {
    /// Standard deviation of every coordinate, in cm.
    pub noise_cm: f64,
    /// Share of the samples that are hidden.
    pub hidden: f64,
    /// Mean length of the gaps, in frames: 1 hides samples at random.
    pub gap_frames: usize,
}

impl Default for MarkerOptions {
    fn default() -> Self {
        Self { noise_cm: 0.05, hidden: 0.0, gap_frames: 1 }
    }
}

impl Actor {
    /// The 41 markers: spread over each part so that they are far from each other.
    pub fn marker_map(&self) -> Vec<SkinMarker> {
        let mut markers = Vec::new();
        for (joint, count) in COUNTS.into_iter().enumerate() {
            let own: Vec<usize> = (0..self.parts.len()).filter(|&vertex| self.parts[vertex] == joint).collect();
            let at = |vertex: usize| Vector3::from(self.mesh.vertices[vertex]);
            let mut chosen: Vec<usize> = Vec::new();
            for number in 0..count {
                // The first is the farthest from the joint, each next one the farthest from those before.
                let apart = |vertex: usize| {
                    let centre = (at(vertex) - self.figure.centres[joint]).norm();
                    chosen
                        .iter()
                        .map(|&other| (at(vertex) - at(other)).norm())
                        .fold(if chosen.is_empty() { centre } else { f64::INFINITY }, f64::min)
                };
                let far = |a: &&usize, b: &&usize| apart(**a).total_cmp(&apart(**b)).then(b.cmp(a));
                if let Some(&vertex) = own.iter().max_by(far) {
                    markers.push(SkinMarker { name: format!("{}_{number}", self.skeleton.joints[joint].name), vertex, joint });
                    chosen.push(vertex);
                }
            }
        }
        markers
    }

    /// Where the markers are seen, in cm: for every pose, a sample of every marker of the map, or none where it is hidden.
    pub fn markers(&self, poses: &[ActorPose], options: &MarkerOptions) -> Vec<Vec<Option<[f64; 3]>>> {
        let map = self.marker_map();
        let mut noise = self.chance(Stream::Markers, 0);
        let mut frames: Vec<Vec<Option<[f64; 3]>>> = poses
            .iter()
            .map(|pose| {
                let seen = |marker: &SkinMarker| {
                    Vector3::from(self.vertex(pose, marker.vertex)) + Vector3::from(noise.normal3()) * options.noise_cm
                };
                map.iter().map(seen).map(|point| Some(point.into())).collect()
            })
            .collect();
        let mut random = self.chance(Stream::Markers, 1);
        let length = options.gap_frames.max(1) as f64;
        let hidden = options.hidden.clamp(0.0, 0.95);
        // A chain of two states whose stays are as long as asked for and whose shares are as asked for.
        let vanish = (hidden / (1.0 - hidden) / length).min(1.0);
        for marker in 0..map.len() {
            let mut gone = random.between(0.0, 1.0) < hidden;
            for frame in &mut frames {
                if gone {
                    frame[marker] = None;
                }
                let drawn = random.between(0.0, 1.0);
                gone = if options.gap_frames <= 1 {
                    drawn < hidden
                } else if gone {
                    drawn >= 1.0 / length
                } else {
                    drawn < vanish
                };
            }
        }
        frames
    }
}
