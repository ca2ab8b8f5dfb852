//! Swaps: two markers that carry each other's label.
//!
//! Short ones show as stray pieces of which one lies where the other belongs.
//! Long ones, and those that happen in a gap, are found from afar: in some frames each marker is asked how far it is from where
//! it is in most frames, among its partners, and if two are far, whether each is where the other belongs.
//! From there the exchange is followed frame by frame; where it begins and ends something must jump, be missing, or come near,
//! because an arm that turns may look like an exchange, but does not jump.

use super::pieces::{Path, Stray, some_frames};
use super::tracks::{Point, Tracks, distance, quantile};
use super::witness::Witness;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Two markers that carry each other's label in a stretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Swap {
    pub markers: [usize; 2],
    /// Half-open.
    pub start: usize,
    pub end: usize,
    /// How far the two are apart, mm.
    pub size_mm: f64,
}

/// Exchanged, each is off by at most this share of what it is off as it is.
const EXPLAINED: f64 = 0.5;
/// Nearer markers than this, mm, are not looked for from afar.
const LEAST_APART_MM: f64 = 50.0;
/// From afar, a marker is somewhere else if it is so many times as far off as usual.
const TIMES_USUAL: f64 = 2.0;
/// The take is looked at in about so many frames.
const LOOKED_AT: usize = 120;
/// What comes between two gaps is looked at besides, but only so often: a marker that flickers has more than that.
const MOST_BETWEEN: usize = 200;
/// Markers that come nearer than this, mm, may exchange labels without a jump.
const TOUCHING_MM: f64 = 40.0;
/// Going on exchanged is at most this share of the way of going on as before, where two markers jump to each other's place.
const CROSSED: f64 = 0.3;
/// So many frames may lie between where two stray pieces begin, or end.
const SLACK: usize = 3;

/// The swaps among stray pieces.
pub(super) fn among(strays: &[Stray], tracks: &Tracks, witness: &Witness) -> Vec<Swap> {
    let mut swaps: Vec<Swap> = Vec::new();
    for stray in strays {
        let frames = some_frames(stray.start, stray.end, 9);
        if swaps.iter().any(|s| s.touches(stray)) {
            continue;
        }
        let path = |marker| Path { tracks, witness, marker };
        let own: Vec<(usize, Point, f64)> = frames
            .iter()
            .filter_map(|&f| {
                let (is, expected) = (tracks.at(stray.marker, f)?, path(stray.marker).expected(f, stray.left, stray.right)?);
                Some((f, expected, distance(is, expected)))
            })
            .collect();
        let mut best: Option<(f64, usize)> = None;
        for other in (0..tracks.len()).filter(|&m| m != stray.marker) {
            // where the other one is against where this one belongs, and the other way round
            let mut there: Vec<f64> =
                own.iter().filter_map(|&(f, expected, off)| Some(distance(tracks.at(other, f)?, expected) / off.max(1.0))).collect();
            if there.len() * 2 < own.len() + 1 || quantile(&mut there, 0.5).is_none_or(|share| share > EXPLAINED) {
                continue;
            }
            let theirs =
                strays.iter().find(|s| s.marker == other && s.start.abs_diff(stray.start) <= SLACK && s.end.abs_diff(stray.end) <= SLACK);
            let outside = |mut frames: std::ops::Range<usize>, back: bool| {
                let seen = |f: &usize| tracks.at(other, *f).is_some();
                if back { frames.rev().find(seen) } else { frames.find(seen) }
            };
            let (left, right) = theirs.map_or_else(
                || {
                    let reach = 2 * SLACK + stray.end - stray.start;
                    let left = outside(stray.start.saturating_sub(reach)..stray.start, true);
                    (left.filter(|_| stray.left.is_some()), outside(stray.end..stray.end + reach, false).filter(|_| stray.right.is_some()))
                },
                |s| (s.left, s.right),
            );
            let back = |&(f, _, _): &(usize, Point, f64)| {
                let expected = path(other).expected(f, left, right)?;
                Some(distance(tracks.at(stray.marker, f)?, expected) / distance(tracks.at(other, f)?, expected).max(1.0))
            };
            let mut shares: Vec<f64> = own.iter().filter_map(back).collect();
            let Some(share) = quantile(&mut shares, 0.5).filter(|&share| share <= EXPLAINED) else { continue };
            if best.is_none_or(|(least, _)| share < least) {
                best = Some((share, other));
            }
        }
        if let Some((_, other)) = best {
            let markers = [stray.marker.min(other), stray.marker.max(other)];
            swaps.push(Swap { markers, start: stray.start, end: stray.end, size_mm: apart(tracks, markers, stray.start, stray.end) });
        }
    }
    swaps
}

/// The distance of two markers in the middle of what it is in a stretch, mm.
fn apart(tracks: &Tracks, [a, b]: [usize; 2], start: usize, end: usize) -> f64 {
    let both = |f: usize| Some(distance(tracks.at(a, f)?, tracks.at(b, f)?));
    let mut distances: Vec<f64> = (start..end).filter_map(both).collect();
    quantile(&mut distances, 0.5).unwrap_or(0.0)
}

/// The swaps that show where they begin and end: two markers jump in one frame, each to where the other would have gone on.
/// `edges` are the frames in which each marker jumps. Partners are not asked, so it does not matter how long the exchange lasts;
/// of the two ways to be labelled, the one that lasts for less of the take is the wrong one.
pub(super) fn crossings(edges: &[Vec<usize>], tracks: &Tracks) -> Vec<Swap> {
    let mut events: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
    let mut jumps: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (marker, frames) in edges.iter().enumerate() {
        for &frame in frames {
            jumps.entry(frame).or_default().push(marker);
        }
    }
    for (frame, markers) in jumps {
        for (k, &a) in markers.iter().enumerate() {
            for &b in markers[k + 1..].iter().filter(|&&b| crosses(tracks, a, b, frame) == Some(true)) {
                events.entry([a, b]).or_default().push(frame);
            }
        }
    }
    let mut swaps = Vec::new();
    for (pair, frames) in events {
        let borders: Vec<usize> = [0].into_iter().chain(frames).chain([tracks.frames]).collect();
        let stretches: Vec<(usize, usize)> = borders.windows(2).map(|w| (w[0], w[1])).collect();
        let both = |frame: &usize| pair.iter().all(|&m| tracks.at(m, *frame).is_some());
        let lasts = |odd: usize| -> usize { stretches.iter().skip(odd).step_by(2).map(|&(a, b)| (a..b).filter(both).count()).sum() };
        let wrong = usize::from(lasts(1) <= lasts(0));
        for &(start, end) in stretches.iter().skip(wrong).step_by(2) {
            // what reaches an end of the take may have been undone in a gap, or by a jump that was not understood
            let open = start == 0 || end == tracks.frames;
            let jumps = || pair.iter().any(|&m| edges[m].iter().any(|e| (start + 1..end).contains(e)));
            if end > start && (!open || ((start..end).all(|f| both(&f)) && !jumps())) {
                swaps.push(Swap { markers: pair, start, end, size_mm: apart(tracks, pair, start, end) });
            }
        }
    }
    swaps
}

/// True if two markers go on in each other's place from `frame` on, as far as the frames around it show.
fn crosses(tracks: &Tracks, a: usize, b: usize, frame: usize) -> Option<bool> {
    // going on as fast as before, or not at all: the frame before may be exchanged itself
    let way = |from: usize, to: usize| -> Option<f64> {
        let (last, next) = (tracks.near(from, frame, -1)?, tracks.at(to, frame)?);
        let steady = |before: Point| distance(std::array::from_fn(|k| 2.0 * last[k] - before[k]), next);
        Some(tracks.near(from, frame, -2).map_or(f64::INFINITY, steady).min(distance(last, next)))
    };
    let (kept, crossed) = (way(a, a)? + way(b, b)?, way(a, b)? + way(b, a)?);
    Some(crossed < CROSSED * kept && kept > TOUCHING_MM)
}

/// Looks for swaps from afar.
pub(super) struct Afar<'a> {
    tracks: &'a Tracks,
    witness: &'a Witness<'a>,
    anchors: Vec<Vec<usize>>,
    /// How far each marker usually is from where it is in most frames, mm.
    usual_mm: Vec<f64>,
}

impl<'a> Afar<'a> {
    pub fn new(tracks: &'a Tracks, witness: &'a Witness<'a>) -> Self {
        let anchors = (0..tracks.len()).map(|marker| Path::anchors(&tracks.seen(marker))).collect();
        Self { tracks, witness, anchors, usual_mm: vec![0.0; tracks.len()] }
    }

    /// How far `at` is from where `marker` belongs, mm, if that can be said.
    fn off(&self, marker: usize, at: usize, frame: usize) -> Option<f64> {
        Path { tracks: self.tracks, witness: self.witness, marker }.level(self.tracks.at(at, frame)?, frame, &self.anchors[marker])
    }

    /// What is off in some frames, frame by frame: marker and distance in mm.
    fn far(&mut self) -> BTreeMap<usize, Vec<(usize, f64)>> {
        let step = (self.tracks.frames / LOOKED_AT).max(1);
        let levels = |marker: usize| -> Vec<(usize, f64)> {
            let mut frames: Vec<usize> = (0..self.tracks.frames).step_by(step).collect();
            // what comes between two gaps is not to be missed
            frames.extend(self.tracks.seen(marker).iter().filter(|(a, b)| b - a < 2 * step).take(MOST_BETWEEN).map(|(a, b)| (a + b) / 2));
            frames.sort_unstable();
            frames.dedup();
            frames.into_iter().filter_map(|f| Some((f, self.off(marker, marker, f)?))).collect()
        };
        let levels: Vec<Vec<(usize, f64)>> = (0..self.tracks.len()).into_par_iter().map(levels).collect();
        for (usual_mm, own) in self.usual_mm.iter_mut().zip(&levels) {
            let mut values: Vec<f64> = own.iter().map(|x| x.1).collect();
            *usual_mm = quantile(&mut values, 0.5).unwrap_or(0.0);
        }
        let mut far: BTreeMap<usize, Vec<(usize, f64)>> = BTreeMap::new();
        for (marker, own) in levels.into_iter().enumerate() {
            for (frame, off) in own {
                if off > LEAST_APART_MM.max(TIMES_USUAL * self.usual_mm[marker]) {
                    far.entry(frame).or_default().push((marker, off));
                }
            }
        }
        far
    }

    /// True if each of the two is where the other belongs, and neither is where it belongs itself.
    fn exchanged(&self, [a, b]: [usize; 2], frame: usize) -> Option<bool> {
        let (own_a, own_b) = (self.off(a, a, frame)?, self.off(b, b, frame)?);
        let (at_a, at_b) = (self.off(a, b, frame)?, self.off(b, a, frame)?);
        let fits = |cross: f64, own: f64| cross < 0.5 * own;
        Some(fits(at_a, own_a) && fits(at_b, own_b) && at_a + at_b < EXPLAINED * (own_a + own_b))
    }

    /// All of them.
    pub fn swaps(&mut self) -> Vec<Swap> {
        let mut found: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
        for (frame, far) in self.far() {
            for (k, &(a, _)) in far.iter().enumerate() {
                for &(b, _) in &far[k + 1..] {
                    let pair = [a.min(b), a.max(b)];
                    let fits = |marker: usize, other: usize| {
                        self.off(marker, other, frame).is_some_and(|cross| cross < LEAST_APART_MM.max(1.5 * self.usual_mm[marker]))
                    };
                    if self.exchanged(pair, frame) == Some(true) && fits(a, b) && fits(b, a) {
                        found.entry(pair).or_default().push(frame);
                    }
                }
            }
        }
        let mut swaps = Vec::new();
        for (pair, frames) in found {
            let mut done = 0;
            for frame in frames {
                if frame < done {
                    continue;
                }
                let end = self.follow(pair, frame, true) + 1;
                let start = self.follow(pair, frame, false);
                done = end;
                if self.breaks(pair, start, start.checked_sub(1))
                    && self.breaks(pair, end - 1, Some(end).filter(|&f| f < self.tracks.frames))
                {
                    swaps.push(Swap { markers: pair, start, end, size_mm: apart(self.tracks, pair, start, end) });
                }
            }
        }
        swaps
    }

    /// The last frame of the exchange, onwards or backwards from one in which it holds.
    fn follow(&self, pair: [usize; 2], from: usize, onwards: bool) -> usize {
        let (mut last, mut frame) = (from, from);
        // a frame or two in which nobody can tell do not end it
        let mut doubts = 0;
        loop {
            let next = if onwards { Some(frame + 1).filter(|&f| f < self.tracks.frames) } else { frame.checked_sub(1) };
            let Some(next) = next else { return last };
            frame = next;
            match self.exchanged(pair, frame) {
                Some(true) => {
                    last = frame;
                    doubts = 0;
                }
                Some(false) => {
                    doubts += 1;
                    if doubts > SLACK {
                        return last;
                    }
                }
                // missing: it may go on afterwards
                None => {}
            }
        }
    }

    /// True if the exchange can begin or end between two frames: one of the two is missing, they touch, or going on exchanged is the shorter way.
    fn breaks(&self, [a, b]: [usize; 2], inside: usize, outside: Option<usize>) -> bool {
        let Some(outside) = outside else { return true };
        let (Some(a_in), Some(b_in)) = (self.tracks.at(a, inside), self.tracks.at(b, inside)) else { return true };
        let (Some(a_out), Some(b_out)) = (self.tracks.at(a, outside), self.tracks.at(b, outside)) else { return true };
        let (kept, crossed) = (distance(a_in, a_out) + distance(b_in, b_out), distance(a_in, b_out) + distance(b_in, a_out));
        distance(a_in, b_in) < TOUCHING_MM || crossed < 0.7 * kept
    }
}

impl Swap {
    /// True if the other one is the same exchange, or another one of one of the two at the same time.
    pub fn overlaps(&self, other: &Self) -> bool {
        other.markers.iter().any(|&marker| self.takes(marker, other.start, other.end))
    }

    /// True if the stray piece is of one of the two, at the same time.
    pub fn touches(&self, stray: &Stray) -> bool {
        self.takes(stray.marker, stray.start, stray.end)
    }

    fn takes(&self, marker: usize, start: usize, end: usize) -> bool {
        self.markers.contains(&marker) && self.start < end && start < self.end
    }
}
