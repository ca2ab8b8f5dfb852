//! What the cameras miss: a plan of gaps like those of real takes.
//!
//! Hands and arms hide wrists, fingers and hips most often; a fallen cable or a person in the way hides a whole limb;
//! and once in a take all cameras blink together.

use super::markers::MARKERS;
use crate::random::{Random, Stream};
use crate::solve::Gap;
use std::ops::Range;

/// Frames at both ends of a take in which every marker is seen, so that a repair can be complete.
pub(super) const CLEAR_FRAMES: usize = 10;
/// The least number of seen frames between two gaps of one marker.
const BETWEEN_FRAMES: usize = 8;
/// Shortest and longest gap of a single marker, in frames.
const SINGLE_FRAMES: (usize, usize) = (10, 250);
/// The black-out of all cameras, in frames.
const BLACKOUT_FRAMES: usize = 12;
/// Places that are tried for one gap before it is given up.
const TRIES: usize = 200;
/// One of each larger event for so many frames.
const EVENT_EVERY_FRAMES: usize = 900;

/// The plan so far.
struct Plan {
    frames: usize,
    /// Longest gap that a take of this length bears.
    longest: usize,
    gaps: Vec<Gap>,
}

impl Plan {
    /// Hides all `names` in `when` unless that touches an end of the take or comes too close to another gap of one of them.
    fn hide(&mut self, names: &[&str], when: Range<usize>) -> bool {
        let inside = when.start >= CLEAR_FRAMES && when.end + CLEAR_FRAMES <= self.frames;
        if when.is_empty() || when.len() > self.longest || !inside {
            return false;
        }
        let markers: Vec<usize> = (0..MARKERS.len()).filter(|&m| names.contains(&MARKERS[m].name)).collect();
        let crowded = |gap: &Gap| gap.start < when.end + BETWEEN_FRAMES && when.start < gap.end + BETWEEN_FRAMES;
        if self.gaps.iter().any(|gap| markers.contains(&gap.marker) && crowded(gap)) {
            return false;
        }
        self.gaps.extend(markers.iter().map(|&marker| Gap { marker, start: when.start, end: when.end }));
        true
    }

    /// Hides all `names` for `length` frames somewhere.
    fn hide_somewhere(&mut self, random: &mut Random, names: &[&str], length: usize) {
        let room = self.frames.saturating_sub(2 * CLEAR_FRAMES + length);
        for _ in 0..TRIES {
            let start = CLEAR_FRAMES + random.whole(0, room + 1);
            if self.hide(names, start..start + length) {
                return;
            }
        }
    }

    fn samples(&self) -> usize {
        self.gaps.iter().map(Gap::frames).sum()
    }
}

/// How often a marker is hidden, compared with others.
fn weight(name: &str) -> f64 {
    match name.get(1..).unwrap_or_default() {
        "FIN" | "WRA" | "WRB" => 5.0,
        "KNE" | "FWT" => 4.0,
        "THI" | "BWT" | "FRM" | "ELB" => 2.0,
        "FHD" | "BHD" | "7" => 0.4,
        _ => 1.0,
    }
}

/// Plans gaps for about `share` of the samples of a take, sorted by marker and frame.
/// `strides` gives the gait phase of each frame: hips disappear while the arms pass them.
pub(super) fn plan(seed: u64, share: f64, strides: &[f64]) -> Vec<Gap> {
    let mut random = Random::new(seed, Stream::Gaps);
    let frames = strides.len();
    let mut plan = Plan { frames, longest: (frames / 3).min(SINGLE_FRAMES.1), gaps: Vec::new() };
    let wanted = (share * random.between(0.93, 1.03) * (frames * MARKERS.len()) as f64) as usize;
    if wanted == 0 {
        return Vec::new();
    }

    let everything: Vec<&str> = MARKERS.iter().map(|marker| marker.name).collect();
    plan.hide_somewhere(&mut random, &everything, BLACKOUT_FRAMES);
    for event in 0..frames.div_ceil(EVENT_EVERY_FRAMES) {
        // Sides alternate from event to event.
        let (knee, hand): (&[&str], &[&str]) = if event % 2 == 0 {
            (&["RKNE", "RSHN"], &["LFRM", "LWRA", "LWRB", "LFIN"])
        } else {
            (&["LKNE", "LTHI"], &["RFRM", "RWRA", "RWRB", "RFIN"])
        };
        if plan.samples() < wanted {
            plan.hide_somewhere(&mut random, knee, 65);
            plan.hide_somewhere(&mut random, hand, 60);
        }
    }
    for (frame, pair) in strides.windows(2).enumerate() {
        // The arms pass the hips a quarter and three quarters of a stride after a heel strike.
        let passes = pair.iter().map(|phase| (2.0 * phase - 0.5).floor()).collect::<Vec<_>>();
        if passes[0] != passes[1] && random.between(0.0, 1.0) < 0.3 && plan.samples() < wanted / 2 {
            let half = random.whole(9, 24);
            plan.hide(&["LFWT", "RFWT"], frame.saturating_sub(half)..frame + half);
        }
    }

    let total: f64 = MARKERS.iter().map(|marker| weight(marker.name)).sum();
    for _ in 0..TRIES * frames {
        if plan.samples() >= wanted {
            break;
        }
        let mut left = random.between(0.0, total);
        let chosen = MARKERS.iter().find(|marker| {
            left -= weight(marker.name);
            left < 0.0
        });
        let (short, long) = SINGLE_FRAMES;
        // Uniform in the logarithm: there are many short gaps and few long ones.
        let length = random.between((short as f64).ln(), (long as f64 + 1.0).ln()).exp() as usize;
        if let Some(marker) = chosen
            && frames > 2 * CLEAR_FRAMES
        {
            let start = random.whole(CLEAR_FRAMES, frames - CLEAR_FRAMES);
            plan.hide(&[marker.name], start..start + length);
        }
    }
    plan.gaps.sort_by_key(|gap| (gap.marker, gap.start));
    plan.gaps
}
