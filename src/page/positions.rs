//! The positions of a page: rounded to what an eye can see, and packed so that a long take makes a small file.

use super::Gap;
use super::pack::{Packed, Packer};

/// The page's unit of length, in mm: a tenth of what a camera system promises.
pub const STEP_MM: f64 = 0.1;

/// The page's unit of predicted error, in mm.
pub const SIGMA_STEP_MM: f64 = 0.01;

/// What a sample is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// The file that was read holds it.
    Observed,
    /// It was filled.
    Filled,
    /// It is missing.
    #[default]
    Missing,
}

/// One marker over the take.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Track {
    /// What it is in every frame.
    pub states: Vec<State>,
    /// For every filled frame, in order: predicted standard deviation of the 3-D error in [`SIGMA_STEP_MM`]; `None` if the method cannot say.
    pub sigma: Vec<Option<u32>>,
    /// For each of [`Positions::frames`]: position in [`STEP_MM`], in the axes of the take; 0 where it is missing.
    pub at: Vec<[i32; 3]>,
}

/// Markers × frames, as far as they are shown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Positions {
    /// The frames of which positions are known, counted from 0, in order. All of them, unless the log was thinned.
    pub frames: Vec<u32>,
    /// One for every marker.
    pub tracks: Vec<Track>,
    /// What the file held where that is not what is shown: (marker, index into [`frames`](Self::frames), position), by marker and frame.
    pub raw: Vec<(u32, u32, [i32; 3])>,
    /// Points of what was measured in each of [`frames`](Self::frames), in [`CLOUD_STEP_MM`](super::of_body::CLOUD_STEP_MM), if it was no markers.
    pub cloud: Vec<Vec<[i32; 3]>>,
}

/// A position in metres, as the log has it, in [`STEP_MM`].
/// A repair in memory goes through the log's numbers as well, so that both give the same page.
pub fn rounded(metres: [f32; 3]) -> [i32; 3] {
    metres.map(|x| (f64::from(x) * 1000.0 / STEP_MM).round() as i32)
}

/// A predicted error in mm in [`SIGMA_STEP_MM`]; `None` if it is not a number.
pub fn rounded_sigma(sigma_mm: f64) -> Option<u32> {
    (sigma_mm.is_finite() && sigma_mm >= 0.0).then(|| (sigma_mm / SIGMA_STEP_MM).round() as u32)
}

impl Positions {
    /// The gaps: maximal runs of frames in which a marker was not observed, marker by marker.
    pub fn gaps(&self) -> Vec<Gap> {
        let mut gaps = Vec::new();
        for (marker, track) in self.tracks.iter().enumerate() {
            let mut start = 0;
            for run in track.states.chunk_by(|a, b| (*a == State::Observed) == (*b == State::Observed)) {
                if run[0] != State::Observed {
                    gaps.push(Gap { marker: marker as u32, start, frames: run.len() as u32, ..Gap::default() });
                }
                start += run.len() as u32;
            }
        }
        gaps
    }

    /// Streams of numbers, marker by marker; `data.js` unpacks them.
    ///
    /// - `states`: runs of equal states, as pairs of state and length, which together cover the frames of a marker
    /// - `x`, `y`, `z`: by how much a coordinate is not where it would be if it went on as before, for every position that is known;
    ///   after missing ones, if it had stayed where it was
    /// - `sigma`: for every filled sample, 0 if unknown, else one more than it; each as difference to the one before
    /// - `raw`: markers, indices and coordinates, each as difference to the entry before
    /// - `frames`: the differences between the frames of which positions are known
    /// - `cloud`, if there is one: for each frame the number of points, and their coordinates, each as difference to the point before
    pub fn pack(&self) -> Packed {
        let mut packer = Packer::default();
        let mut stream = Vec::new();
        for Track { states, .. } in &self.tracks {
            for run in states.chunk_by(|a, b| a == b) {
                stream.extend([run[0] as i64, run.len() as i64]);
            }
        }
        packer.add("states", &stream);
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            stream.clear();
            for track in &self.tracks {
                let (mut last, mut step) = (0i64, 0i64);
                for (&frame, at) in self.frames.iter().zip(&track.at) {
                    if track.states.get(frame as usize).is_none_or(|state| *state == State::Missing) {
                        step = 0;
                        continue;
                    }
                    let x = i64::from(at[axis]);
                    stream.push(x - last - step);
                    step = x - last;
                    last = x;
                }
            }
            packer.add(name, &stream);
        }
        stream.clear();
        let mut last = 0;
        for sigma in self.tracks.iter().flat_map(|track| &track.sigma) {
            let sigma = sigma.map_or(0, |s| i64::from(s) + 1);
            stream.push(sigma - last);
            last = sigma;
        }
        packer.add("sigma", &stream);
        stream.clear();
        let mut last = [0i64; 5];
        for &(marker, index, [x, y, z]) in &self.raw {
            let entry = [i64::from(marker), i64::from(index), i64::from(x), i64::from(y), i64::from(z)];
            stream.extend(entry.iter().zip(last).map(|(now, before)| now - before));
            last = entry;
        }
        packer.add("raw", &stream);
        stream.clear();
        let mut last = -1;
        for &frame in &self.frames {
            stream.push(i64::from(frame) - last);
            last = i64::from(frame);
        }
        packer.add("frames", &stream);
        if !self.cloud.is_empty() {
            stream.clear();
            let mut last = [0; 3];
            for points in &self.cloud {
                stream.push(points.len() as i64);
                for point in points {
                    stream.extend(point.iter().zip(last).map(|(now, before)| i64::from(*now) - i64::from(before)));
                    last = *point;
                }
            }
            packer.add("cloud", &stream);
        }
        packer.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::metres;

    #[test]
    fn what_the_log_rounds_the_page_does_not_see() {
        for (mm, at) in [(0.0, 0), (0.049, 0), (0.051, 1), (-0.051, -1), (1234.56, 12_346), (-4_000.04, -40_000), (1e12, i32::MAX)] {
            assert_eq!(rounded(metres([mm, 0.0, mm])), [at, 0, at], "{mm}");
        }
        for (mm, sigma) in [(0.0, Some(0)), (1.234, Some(123)), (f64::NAN, None), (f64::INFINITY, None), (-1.0, None)] {
            assert_eq!(rounded_sigma(mm), sigma, "{mm}");
        }
    }

    #[test]
    fn a_steady_motion_costs_nothing() {
        let track = Track { states: vec![State::Observed; 1000], sigma: vec![], at: (0..1000).map(|k| [7 * k, -3 * k, 5]).collect() };
        let positions = Positions { frames: (0..1000).collect(), tracks: vec![track], ..Positions::default() };
        let packed = positions.pack();
        assert!(packed.base64.len() < 120, "{} bytes", packed.base64.len());
    }
}
