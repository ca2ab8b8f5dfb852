//! What is usual for a body in a sequence of clouds, so that what is not can be noticed.
//!
//! Clouds differ in how much of a body they show: hulls cut off fingers, one camera sees one side. So coverage is held against what it was before.

use super::record::Tracked;
use super::search::Limb;

/// A limb may be elsewhere if its coverage falls below this share of the usual.
const SUSPECT: f64 = 0.7;
/// It is lost if, after all that was tried, it stays below this share.
const LOST: f64 = 0.5;
/// So is a single part of it below this share: a foot may be far away while its thigh and shank are where they were.
const PART_LOST: f64 = 0.25;
/// Of the first frame nobody knows what is usual: what has less than this share of the coverage of the better parts is not.
const FIRST: f64 = 0.8;
/// Something is wrong if the share of points that belong to the body falls below this share of the usual.
const FEWER: f64 = 0.8;
/// With less than this share of points or of the surface, a body is nowhere near.
const HARDLY_ANY: f64 = 0.1;
/// A coverage below this tells nothing.
const LITTLE: f64 = 0.05;
/// How fast the usual follows what is better ...
const UP: f64 = 0.1;
/// ... and what is worse.
const DOWN: f64 = 0.02;

/// What is usual for this body in these clouds.
#[derive(Clone, Debug, Default)]
pub(super) struct Usual {
    inliers: f64,
    coverage: Vec<f64>,
}

impl Usual {
    /// Begins with what the first frame shows. What it shows little of is taken to be elsewhere, not to be usual.
    pub fn begin(&mut self, tracked: &Tracked) {
        let mut known: Vec<f64> = tracked.coverage.iter().copied().filter(|share| share.is_finite()).collect();
        known.sort_by(f64::total_cmp);
        let better = known.get(known.len() * 3 / 4).copied().unwrap_or_default();
        self.inliers = tracked.inliers;
        self.coverage = tracked.coverage.iter().map(|share| share.max(FIRST * better)).collect();
    }

    /// True before the first frame.
    pub fn is_empty(&self) -> bool {
        self.coverage.is_empty()
    }

    /// True if a part has next to nothing of what is usual for it.
    fn bare(&self, tracked: &Tracked, joint: usize) -> bool {
        let usual = self.coverage.get(joint).copied().unwrap_or_default();
        usual > LITTLE && tracked.coverage[joint] < PART_LOST * usual
    }

    /// How much of a limb is covered, against what is usual.
    fn lacks(&self, tracked: &Tracked, limb: &Limb) -> f64 {
        if self.coverage.is_empty() {
            return 1.0;
        }
        let (mut sum, mut usual) = (0.0, 0.0);
        for &joint in limb.joints.iter().filter(|&&joint| tracked.coverage[joint].is_finite()) {
            sum += tracked.coverage[joint];
            usual += self.coverage[joint];
        }
        sum / usual.max(LITTLE)
    }

    /// True if a limb may be elsewhere.
    pub fn missing(&self, tracked: &Tracked, limb: &Limb) -> bool {
        self.lacks(tracked, limb) < SUSPECT || limb.joints.iter().any(|&joint| self.bare(tracked, joint))
    }

    /// True if a frame looks as if something was lost.
    pub fn troubled(&self, tracked: &Tracked, limbs: &[Limb]) -> bool {
        nowhere(tracked) || tracked.inliers < FEWER * self.inliers || limbs.iter().any(|limb| self.missing(tracked, limb))
    }

    /// For each joint, whether its limb is lost for good.
    pub fn lost(&self, tracked: &Tracked, limbs: &[Limb]) -> Vec<bool> {
        let all = nowhere(tracked) || tracked.inliers < LOST * self.inliers;
        let mut lost = vec![all; tracked.coverage.len()];
        for limb in limbs {
            // where a part is lost, so is what hangs on it
            let first =
                if self.lacks(tracked, limb) < LOST { Some(0) } else { limb.joints.iter().position(|&joint| self.bare(tracked, joint)) };
            for &joint in first.map_or(&[][..], |first| &limb.joints[first..]) {
                lost[joint] = true;
            }
        }
        lost
    }

    /// What is not lost is what is usual.
    pub fn learn(&mut self, tracked: &Tracked) {
        if nowhere(tracked) {
            return;
        }
        // what is worse than usual counts little: it may be the beginning of a loss
        let follow = |usual: &mut f64, now: f64| {
            if now.is_finite() {
                *usual += (now - *usual) * if now > *usual { UP } else { DOWN }
            }
        };
        follow(&mut self.inliers, tracked.inliers);
        for (part, now) in tracked.coverage.iter().enumerate() {
            if !tracked.lost[part] {
                follow(&mut self.coverage[part], *now);
            }
        }
    }
}

/// True if the body is not where the points are, whatever is usual.
pub(super) fn nowhere(tracked: &Tracked) -> bool {
    let covered = tracked.coverage.iter().copied().filter(|coverage| coverage.is_finite());
    let (sum, count) = covered.fold((0.0, 0.0), |(sum, count), coverage| (sum + coverage, count + 1.0));
    tracked.inliers < HARDLY_ANY || sum < HARDLY_ANY * count
}
