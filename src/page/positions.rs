//! The positions of a page: rounded to what an eye can see, and packed so that a long take makes a small file.

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

/// One sample, rounded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sample {
    /// What it is.
    pub state: State,
    /// Position in [`STEP_MM`], in the axes of the take; 0 if it is missing.
    pub at: [i32; 3],
    /// Predicted standard deviation of the 3-D error in [`SIGMA_STEP_MM`]; `None` if it was observed, or the method cannot say.
    pub sigma: Option<u32>,
}

/// Markers × frames, as far as they are shown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Positions {
    /// The frames that are shown, counted from 0, in order. All of them, unless the log was thinned.
    pub frames: Vec<u32>,
    /// For every marker, a sample for each of [`frames`](Self::frames).
    pub tracks: Vec<Vec<Sample>>,
    /// What the file held where that is not what is shown: (marker, index into [`frames`](Self::frames), position), in order.
    pub raw: Vec<(u32, u32, [i32; 3])>,
}

/// A position in metres, as single-precision numbers: what the log holds.
pub fn metres(position_mm: [f64; 3]) -> [f32; 3] {
    position_mm.map(|x| (x / 1000.0) as f32)
}

/// A position of the log in [`STEP_MM`].
/// A repair in memory goes through the log's numbers as well, so that both give the same page.
pub fn rounded(metres: [f32; 3]) -> [i32; 3] {
    metres.map(|x| (f64::from(x) * 1000.0 / STEP_MM).round() as i32)
}

/// A predicted error of the log, in mm, in [`SIGMA_STEP_MM`]; `None` if it is not a number.
pub fn rounded_sigma(sigma_mm: f32) -> Option<u32> {
    (sigma_mm.is_finite() && sigma_mm >= 0.0).then(|| (f64::from(sigma_mm) / SIGMA_STEP_MM).round() as u32)
}

impl Positions {
    /// Five streams of numbers, marker by marker; `data.js` unpacks them.
    ///
    /// - `states`: runs of equal states, as pairs of state and length, which together cover the frames of a marker
    /// - `x`, `y`, `z`: what a coordinate differs by from going on as before, for every sample that is not missing;
    ///   after missing ones, from staying where it was
    /// - `sigma`: for every filled sample, 0 if unknown, else one more than it; each as difference to the one before
    /// - `raw`: markers, indices and coordinates, each as difference to the entry before
    /// - `frames`: the differences between the frames that are shown
    pub fn pack(&self) -> Packed {
        let mut packer = Packer::default();
        let mut stream = Vec::new();
        for track in &self.tracks {
            let mut at = 0;
            while let Some(first) = track.get(at) {
                let run = track.iter().skip(at).take_while(|s| s.state == first.state).count();
                stream.push(first.state as i64);
                stream.push(run as i64);
                at += run;
            }
        }
        packer.add("states", &stream);
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            stream.clear();
            for track in &self.tracks {
                let (mut last, mut step) = (0i64, 0i64);
                for sample in track {
                    if sample.state == State::Missing {
                        step = 0;
                        continue;
                    }
                    let x = i64::from(sample.at[axis]);
                    stream.push(x - last - step);
                    step = x - last;
                    last = x;
                }
            }
            packer.add(name, &stream);
        }
        stream.clear();
        let mut last = 0;
        for sample in self.tracks.iter().flatten().filter(|s| s.state == State::Filled) {
            let sigma = sample.sigma.map_or(0, |s| i64::from(s) + 1);
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
        packer.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_log_rounds_the_page_does_not_see() {
        for (mm, at) in [(0.0, 0), (0.049, 0), (0.051, 1), (-0.051, -1), (1234.56, 12_346), (-4_000.04, -40_000), (1e12, i32::MAX)] {
            assert_eq!(rounded(metres([mm, 0.0, mm])), [at, 0, at], "{mm}");
        }
        for (mm, sigma) in [(0.0, Some(0)), (1.234, Some(123)), (f32::NAN, None), (f32::INFINITY, None), (-1.0, None)] {
            assert_eq!(rounded_sigma(mm), sigma, "{mm}");
        }
    }

    #[test]
    fn a_steady_motion_costs_nothing() {
        let observed = |k: i32| Sample { state: State::Observed, at: [7 * k, -3 * k, 5], sigma: None };
        let positions = Positions { frames: (0..1000).collect(), tracks: vec![(0..1000).map(observed).collect()], raw: Vec::new() };
        let packed = positions.pack();
        assert!(packed.base64.len() < 120, "{} bytes", packed.base64.len());
    }
}
