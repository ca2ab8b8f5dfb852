//! What is timed: a synthetic walk of 41 markers at 120 Hz with something missing.

use formats::{Take, TakeBuilder};
use mocap_repair::demo::{hide, walk};

/// One marker is missing for 60 frames in the middle.
pub fn one_gap(frames: usize) -> Take {
    let whole = walk(frames, 120.0, 1);
    let marker = whole.markers[20].name().to_owned();
    hide(&whole, &marker, frames / 2 - 30..frames / 2 + 30)
}

/// 15 % of the samples in gaps of 60 frames on average, from a fixed sequence of numbers.
pub fn scatter(frames: usize) -> Take {
    let take = walk(frames, 120.0, 1);
    let markers = take.markers.len();
    let mut out = TakeBuilder::from(take);
    let mut state = 42u64;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut hidden = 0;
    while hidden * 100 < 15 * frames * markers {
        let length = (-60.0 * (1.0 - unit()).ln()).clamp(3.0, frames as f64 / 3.0) as usize;
        let from = (unit() * (frames - length) as f64) as usize;
        let marker = (unit() * markers as f64) as usize;
        for t in from..from + length {
            out.hide(t, marker);
        }
        hidden += length;
    }
    out.build()
}
