//! How far joints are from the truth.

use super::variants::Sequence;
use mocap_repair::solve::ik::{Tree, Vec3};
use mocap_repair::solve::track::{Settings, Tracked, Tracker, Way};

/// A frame whose joints are farther off than this on average is lost, cm.
const LOST_CM: f64 = 5.0;

/// How well a body was followed. Distances are those of joints from the truth, over all joints and frames, cm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// Mean.
    pub mean_cm: f64,
    /// 95 of 100 are smaller.
    pub p95_cm: f64,
    /// Largest.
    pub worst_cm: f64,
    /// The share of frames whose mean is beyond 5 cm.
    pub lost: f64,
    /// The first of them.
    pub first_lost: Option<usize>,
    /// The share of frames in which limbs were searched, and found.
    pub searched: f64,
    /// The share of parts that are not where they should be and not told as lost, in all frames.
    pub silent: f64,
    /// The share of parts that are told as lost although they are where they should be.
    pub false_alarms: f64,
}

/// A part is not where it should be if one of its joints is farther off than this, cm ...
const ASTRAY_CM: f64 = 15.0;
/// ... and is if all are nearer than this.
const RIGHT_CM: f64 = 4.0;

/// Follows the body of a sequence through all of its frames.
pub fn follow(sequence: &Sequence, settings: Settings) -> Vec<Tracked> {
    let mut tracker = Tracker::new(&sequence.body, sequence.limits.as_ref(), sequence.start.clone(), settings);
    let mut tracked = Vec::with_capacity(sequence.clouds.len());
    for cloud in &sequence.clouds {
        tracked.extend(tracker.push(cloud.clone()));
    }
    tracked.extend(tracker.finish());
    tracked
}

/// What came of it.
pub fn score(tree: &Tree, truth: &[Vec<Vec3>], tracked: &[Tracked]) -> Score {
    assert_eq!(truth.len(), tracked.len(), "every frame that was pushed comes out");
    let mut all = Vec::new();
    let mut lost = Vec::new();
    for (frame, (truth, tracked)) in truth.iter().zip(tracked).enumerate() {
        let off = truth.iter().zip(&tracked.centres).map(|(a, b)| (a - b).norm()).filter(|off| !off.is_nan());
        let own: Vec<f64> = off.collect();
        if mean(&own) > LOST_CM {
            lost.push(frame);
        }
        all.extend(own);
    }
    all.sort_by(f64::total_cmp);
    let (mut parts, mut silent, mut false_alarms) = (0.0, 0.0, 0.0);
    for (truth, tracked) in truth.iter().zip(tracked) {
        for part in 0..tree.joints() {
            let own = (0..tree.joints()).filter(|&joint| joint == part || tree.links[joint].parent == Some(part));
            let off = own.map(|joint| (truth[joint] - tracked.centres[joint]).norm()).filter(|off| !off.is_nan()).fold(0.0, f64::max);
            parts += 1.0;
            silent += f64::from(u8::from(off > ASTRAY_CM && !tracked.lost[part]));
            false_alarms += f64::from(u8::from(off < RIGHT_CM && tracked.lost[part]));
        }
    }
    let searched = tracked.iter().filter(|frame| frame.way == Way::Searched).count();
    Score {
        mean_cm: mean(&all),
        p95_cm: all.get(all.len() * 95 / 100).copied().unwrap_or_default(),
        worst_cm: all.last().copied().unwrap_or_default(),
        lost: lost.len() as f64 / tracked.len().max(1) as f64,
        first_lost: lost.first().copied(),
        searched: searched as f64 / tracked.len().max(1) as f64,
        silent: silent / f64::max(parts, 1.0),
        false_alarms: false_alarms / f64::max(parts, 1.0),
    }
}

/// For each joint its mean distance from the truth, cm; NaN where nobody knows.
pub fn by_joint(truth: &[Vec<Vec3>], tracked: &[Tracked]) -> Vec<f64> {
    let joints = truth.first().map_or(0, Vec::len);
    let off = |joint: usize| truth.iter().zip(tracked).map(move |(truth, tracked)| (truth[joint] - tracked.centres[joint]).norm());
    (0..joints).map(|joint| off(joint).sum::<f64>() / truth.len() as f64).collect()
}

fn mean(list: &[f64]) -> f64 {
    list.iter().sum::<f64>() / list.len().max(1) as f64
}
