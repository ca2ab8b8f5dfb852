//! What the neighbours of a marker say about its path.
//!
//! Each marker has a few partners, those to which it keeps its distance best.
//! From one frame to another they turn and move together, and carry along what is fixed to them: [`Witness::carried`].
//! Where a marker is against where its partners carry it is what the body does not explain; nothing here knows where north is.

use super::tracks::{Point, Tracks, distance, length, minus, quantile};
use super::turn::Pairs;
use crate::solve::Bone;
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// Each marker has at most this many partners: enough to do without a few that are hidden or wrong themselves.
const PARTNERS: usize = 7;

/// Distances are looked at in about so many frames.
const LOOKED_AT: usize = 160;

/// A partner farther away than this, in mm, is on another limb or another person.
const FARTHEST_MM: f64 = 900.0;

/// What 1 mm of distance costs against 1 mm of spread.
const DISTANCE_COST: f64 = 0.02;

/// A partner whose distance varies by more than this, in mm, says nothing.
const LOOSEST_MM: f64 = 90.0;

/// A partner is never weighed as if its distance varied by less than this, in mm.
const STIFFEST_MM: f64 = 3.0;

/// Fewer do not say how they turn.
const LEAST_PARTNERS: usize = 3;

/// A choice of a marker's partners, best first from the lowest bit.
pub(super) type Those = u8;

/// All of them.
pub(super) const ALL: Those = Those::MAX;

/// A marker that keeps its distance to another, and its weight among the partners.
#[derive(Clone, Copy, Debug)]
pub(super) struct Partner {
    pub marker: usize,
    pub weight: f64,
}

/// The partners of all markers.
pub(super) struct Witness<'a> {
    pub tracks: &'a Tracks,
    partners: Vec<Vec<Partner>>,
}

impl<'a> Witness<'a> {
    /// Chooses partners. Bones come before other pairs of the same spread.
    pub fn new(tracks: &'a Tracks, bones: &[Bone]) -> Self {
        let count = tracks.len();
        let stated: BTreeSet<(usize, usize)> = bones.iter().map(|bone| (bone.a.min(bone.b), bone.a.max(bone.b))).collect();
        // many markers, fewer frames: this must not take longer than looking at the paths
        let wanted = (LOOKED_AT * 120 / count.max(120)).max(40);
        let stride = (tracks.frames / wanted).max(1);
        let mut pairs: Vec<Vec<(f64, usize, f64)>> = vec![Vec::new(); count];
        let mut lengths = Vec::with_capacity(wanted);
        for a in 0..count {
            for b in a + 1..count {
                lengths.clear();
                let both = |f: usize| Some(distance(tracks.at(a, f)?, tracks.at(b, f)?));
                lengths.extend((0..tracks.frames).step_by(stride).filter_map(both));
                if lengths.len() < 12.min(tracks.frames / 2) {
                    continue;
                }
                let (Some(middle), Some(low), Some(high)) =
                    (quantile(&mut lengths, 0.5), quantile(&mut lengths, 0.25), quantile(&mut lengths, 0.75))
                else {
                    continue;
                };
                let spread = (high - low) / 1.349; // of a Gaussian between its quartiles: a label that is elsewhere for a fifth of the take does not count
                if middle > FARTHEST_MM || spread > LOOSEST_MM {
                    continue;
                }
                // columns rise with paths
                let is_bone = stated.contains(&(tracks.columns[a], tracks.columns[b]));
                let cost = (spread + DISTANCE_COST * middle) * if is_bone { 0.5 } else { 1.0 };
                pairs[a].push((cost, b, spread));
                pairs[b].push((cost, a, spread));
            }
        }
        let partners = pairs
            .into_iter()
            .map(|mut own| {
                own.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
                let weigh = |(_, marker, spread): (f64, usize, f64)| {
                    let spread = spread.max(STIFFEST_MM);
                    Partner { marker, weight: 1.0 / (spread * spread) }
                };
                own.into_iter().take(PARTNERS).map(weigh).collect()
            })
            .collect();
        Self { tracks, partners }
    }

    /// The same partners, seen in other tracks.
    pub fn seen_in<'b>(&self, tracks: &'b Tracks) -> Witness<'b> {
        Witness { tracks, partners: self.partners.clone() }
    }

    /// The partners of a marker, best first.
    pub fn of(&self, marker: usize) -> &[Partner] {
        &self.partners[marker]
    }

    /// Where `point`, fixed to the partners of `marker` in frame `from`, is in frame `to`, if only `those` of them count.
    /// `None` if fewer than three partners are seen in both.
    pub fn carried(&self, marker: usize, point: Point, from: usize, to: usize, those: Those) -> Option<Point> {
        let mut pairs = [([0.0; 3], [0.0; 3], 0.0); PARTNERS];
        let mut seen = 0;
        for (at, partner) in self.partners[marker].iter().enumerate() {
            if those & (1 << at) == 0 {
                continue;
            }
            if let (Some(p), Some(q)) = (self.tracks.at(partner.marker, from), self.tracks.at(partner.marker, to)) {
                pairs[seen] = (p, q, partner.weight);
                seen += 1;
            }
        }
        let pairs = &pairs[..seen];
        if seen < LEAST_PARTNERS {
            return None;
        }
        let total: f64 = pairs.iter().map(|x| x.2).sum();
        let mean = |of: fn(&(Point, Point, f64)) -> Point| -> Point {
            std::array::from_fn(|k| pairs.iter().map(|x| x.2 * of(x)[k]).sum::<f64>() / total)
        };
        let (p_mean, q_mean) = (mean(|x| x.0), mean(|x| x.1));
        let sums = Pairs::new(pairs.iter().map(|&(p, q, weight)| (minus(p, p_mean), minus(q, q_mean), weight)));
        let near = from.abs_diff(to) as f64 <= NEAR_SECS * self.tracks.rate_hz || from.abs_diff(to) <= 2;
        let turn = if near { sums.small() } else { sums.any()? };
        let turned = turn * Vector3::from(minus(point, p_mean));
        Some(std::array::from_fn(|k| q_mean[k] + turned[k]))
    }

    /// Those partners of a marker that are seen in all of some frames; all of them if these are too few.
    pub fn steady(&self, marker: usize, mut frames: impl Iterator<Item = usize> + Clone) -> Those {
        let mut those: Those = 0;
        for (at, partner) in self.partners[marker].iter().enumerate() {
            if frames.clone().all(|f| self.tracks.at(partner.marker, f).is_some()) {
                those |= 1 << at;
            }
        }
        if those.count_ones() < LEAST_PARTNERS as u32 && frames.next().is_some() { ALL } else { those }
    }

    /// What the partners do not explain of the way from one frame to another: where the marker is less where it would have been carried.
    pub fn unexplained(&self, path: &Tracks, marker: usize, from: usize, to: usize) -> Option<Point> {
        let (was, is) = (path.at(marker, from)?, path.at(marker, to)?);
        Some(minus(is, self.carried(marker, was, from, to, ALL)?))
    }

    /// How far the partners usually let a marker drift within 1, 2, 4, ... frames, mm: the 80th percentile.
    pub fn drift(&self, marker: usize) -> Drift {
        let frames = self.tracks.frames;
        let mut levels = Vec::new();
        let mut lag = 1;
        while lag < frames {
            let step = ((frames - lag) / 48).max(1);
            let drifts = (0..frames - lag).step_by(step).filter_map(|f| self.unexplained(self.tracks, marker, f, f + lag));
            let mut drifts: Vec<f64> = drifts.map(length).collect();
            let before = levels.last().copied().unwrap_or(0.0);
            levels.push(quantile(&mut drifts, 0.8).unwrap_or(before).max(before));
            lag *= 2;
        }
        Drift(levels)
    }
}

/// Within this time a body turns so little that the turn can be found from no turn at all.
const NEAR_SECS: f64 = 0.05;

/// How far a marker drifts among its partners, by powers of two of the time.
#[derive(Clone, Debug)]
pub(super) struct Drift(Vec<f64>);

impl Drift {
    /// Within so many frames, mm.
    pub fn within(&self, frames: usize) -> f64 {
        let level = frames.max(1).next_power_of_two().trailing_zeros() as usize;
        self.0.get(level.min(self.0.len().saturating_sub(1))).copied().unwrap_or(0.0)
    }
}
