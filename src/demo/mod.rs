//! A synthetic take of somebody who walks: the truth, and the same take with gaps.
//!
//! It shows what a repair does without anybody's data, and tests measure errors against a truth that real takes do not have.
//! The body has joints, the skin moves on the bones by millimetres, the cameras add noise, and no two strides are alike;
//! but it is no measured motion, so the errors of a repair on it say nothing about takes of yours.
//!
//! A seed means the same take for ever: the random numbers are our own, and positions are rounded to `f32`
//! (what most files hold; far coarser than what the sines of two platforms differ by).
//!
//! - `walker`: the body in motion, with `path` to walk along
//! - `markers`: where the markers sit, and the skin
//! - `gaps`: what the cameras miss
//! - [`actor`]: somebody with a surface, for what follows bodies in clouds of points
//! - [`picture`]: a gap before and after, as SVG

pub mod actor;
mod files;
mod gaps;
mod markers;
mod path;
pub mod picture;
#[cfg(test)]
mod tests;
mod walker;

pub use files::write_demo;

use crate::random::{Random, Stream};
use crate::solve::Gap;
use formats::{Direction, Marker, Origin, Take, TakeBuilder};
use markers::{MARKERS, Suit};
use std::ops::Range;
use walker::Walker;

/// What the take is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DemoOptions {
    /// Length of the take. 900 frames are 7.5 s, about half way around the oval. Takes below 60 frames get few gaps or none.
    pub frames: usize,
    /// Frames per second.
    pub rate_hz: f64,
    /// Decides on the actor, the way of walking, the noise and the gaps.
    pub seed: u64,
    /// Standard deviation of the camera noise on each axis, in mm. 0 switches it off.
    pub noise_mm: f64,
    /// Scales the motion of skin and muscle against the bones. 1 is a person, 0 a robot.
    pub softness: f64,
    /// Share of the samples to hide, roughly met. 0 hides nothing.
    pub gap_share: f64,
}

impl Default for DemoOptions {
    fn default() -> Self {
        Self { frames: 900, rate_hz: 120.0, seed: 1, noise_mm: 0.3, softness: 1.0, gap_share: 0.10 }
    }
}

/// A take with gaps, and what was in them.
#[derive(Clone, Debug)]
pub struct Demo {
    /// Every sample, with soft tissue and noise: what the cameras would have seen had nothing been in the way.
    pub truth: Take,
    /// The same take with gaps. Every seen sample equals that of the truth bit for bit.
    pub gaps: Take,
    /// What is hidden, sorted by marker and frame. Gaps of one marker never touch each other or the ends of the take.
    pub hidden: Vec<Gap>,
}

/// Makes a take of 41 markers in mm, z up, floor at z = 0, first frame 1.
pub fn demo(options: &DemoOptions) -> Demo {
    let walker = Walker::new(options.seed);
    let truth = record(&walker, options);
    let strides: Vec<f64> = (0..options.frames).map(|frame| walker.phase(frame as f64 / options.rate_hz)).collect();
    let hidden = gaps::plan(options.seed, options.gap_share, &strides);
    let mut builder = TakeBuilder::from(truth.clone());
    for gap in &hidden {
        for frame in gap.start..gap.end {
            builder.hide(frame, gap.marker);
        }
    }
    Demo { truth, gaps: builder.build(), hidden }
}

/// A take of somebody who walks, with soft tissue and noise but without gaps: the truth of a [`demo`].
pub fn walk(frames: usize, rate_hz: f64, seed: u64) -> Take {
    record(&Walker::new(seed), &DemoOptions { frames, rate_hz, seed, ..DemoOptions::default() })
}

/// The take without the samples of one marker in `frames`: `hide(&walk(300, 120.0, 1), "LKNE", 40..90)`.
///
/// The marker is named without a subject's prefix; of several with that name all are hidden.
/// Panics if there is no such marker or no such frame, because a test that hides nothing shows nothing.
#[must_use]
pub fn hide(take: &Take, marker: &str, frames: Range<usize>) -> Take {
    assert!(frames.end <= take.frames(), "cannot hide frames {frames:?} of {marker}: the take has {} frames", take.frames());
    let columns: Vec<usize> = (0..take.markers.len()).filter(|&m| take.markers[m].name() == marker).collect();
    assert!(!columns.is_empty(), "cannot hide {marker}: the take has no marker of that name");
    let mut builder = TakeBuilder::from(take.clone());
    for frame in frames {
        for &column in &columns {
            builder.hide(frame, column);
        }
    }
    builder.build()
}

/// Films a walker.
fn record(walker: &Walker, options: &DemoOptions) -> Take {
    let suit = Suit::new(options.seed, options.softness);
    let mut noise = Random::new(options.seed, Stream::Noise);
    let columns = MARKERS.iter().map(|marker| Marker::new(marker.name)).collect();
    let mut builder = TakeBuilder::new(columns, options.frames, options.rate_hz).up(Some(Direction::PLUS_Z));
    for frame in 0..options.frames {
        let time_secs = frame as f64 / options.rate_hz;
        let pose = walker.pose(time_secs);
        for (marker, position_mm) in suit.positions_mm(&pose, time_secs).enumerate() {
            let shaken = noise.normal3();
            let seen = std::array::from_fn(|axis| f64::from((position_mm[axis] + options.noise_mm * shaken[axis]) as f32));
            builder.set(frame, marker, seen, Origin::Measured);
        }
    }
    builder.build()
}
