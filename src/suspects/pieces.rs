//! Pieces: what lies between gaps and edges, and which of them do not belong to the path.
//!
//! The pieces that are kept are those with the most frames among all that continue each other;
//! what is left between them has to be off the way from the last frame before it to the first one after it, or it is kept after all.

use super::edges::Edge;
use super::tracks::{Point, Tracks, between, distance, length, quantile};
use super::witness::{ALL, Drift, Witness};
use std::ops::Range;

/// A stretch of a path that does not belong to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stray {
    pub marker: usize,
    /// Half-open.
    pub start: usize,
    pub end: usize,
    /// The last frame before it and the first one after it that do belong.
    pub left: Option<usize>,
    pub right: Option<usize>,
    /// It begins or ends at a gap or at an end of the take.
    pub beside_gap: bool,
    /// The farthest that it is off the path, mm.
    pub size_mm: f64,
}

/// What a piece begins with.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Border {
    /// Nothing was seen before it.
    Gap,
    Edge(Edge),
}

#[derive(Clone, Copy, Debug)]
struct Piece {
    start: usize,
    end: usize,
    border: Border,
}

/// What it costs to keep two pieces that do not continue each other, as a share of the frames seen.
const BREACH: f64 = 0.35;
/// A piece looks back at most so many pieces for the one that it continues.
const REACH: usize = 10;
/// Two pieces continue each other if they are no farther apart than this share of the edges between them ...
const SHARE_OF_EDGE: f64 = 0.4;
/// ... or this many times what the marker usually drifts in that time.
const TIMES_DRIFT: f64 = 4.0;
/// Across a gap without an edge, they do unless they are this far apart, mm, and so many times what is usual.
const ACROSS_MM: f64 = 60.0;
const ACROSS_TIMES_DRIFT: f64 = 6.0;
/// Without witnesses a path is continued over this time only.
const ALONE_SECS: f64 = 0.07;
const ALONE_FRAMES: usize = 6;
/// A stray piece is off by at least this share of its edges.
const OFF_SHARE: f64 = 0.5;
/// ... and one that is long by not much more than they are, because it is the edges that say so.
const MOST_OFF_SHARE: f64 = 2.0;
/// Smaller edges, mm, do not make a long piece stray.
const LONG_EDGE_MM: f64 = 16.0;
/// The same against what the path usually shows.
const LONG_TIMES_USUAL: f64 = 14.0;
/// What is off by less than this, mm, is not worth a look.
const LEAST_MM: f64 = 8.0;
/// Pieces at a gap or an end of the take need no other evidence than their edge if they are as short as this.
const SHORT_SECS: f64 = 0.05;
const SHORT_FRAMES: usize = 5;
/// Longer ones have to be this many times as far from where the marker usually is as those that are kept, and farther by so much, mm.
const LEVEL_TIMES: f64 = 2.0;
const LEVEL_MM: f64 = 15.0;
/// In so many frames of a piece it is looked at.
const LOOKED_AT: usize = 21;
/// So many frames are asked where the marker usually is.
pub(super) const ANCHORS: usize = 9;

/// One marker's path and all that is needed to judge it.
pub(super) struct Path<'a> {
    pub tracks: &'a Tracks,
    pub witness: &'a Witness<'a>,
    pub marker: usize,
}

/// Frames of `start..end`, about evenly, at most `most` of them, both ends among them.
pub(super) fn some_frames(start: usize, end: usize, most: usize) -> Vec<usize> {
    let count = (end - start).min(most);
    (0..count).map(|k| if count > 1 { start + k * (end - start - 1) / (count - 1) } else { start }).collect()
}

/// As many frames as count as short at this rate.
pub(super) fn short_frames(tracks: &Tracks) -> usize {
    tracks.frames_in(SHORT_SECS).max(SHORT_FRAMES)
}

impl Path<'_> {
    fn at(&self, frame: usize) -> Option<Point> {
        self.tracks.at(self.marker, frame)
    }

    /// Where the marker is in `frame` if it was carried by its partners from the frames on either side, or from one of them.
    /// Without witnesses: where a cubic through two frames on either side goes, if they are near.
    pub fn expected(&self, frame: usize, left: Option<usize>, right: Option<usize>) -> Option<Point> {
        let carried = |from: Option<usize>| self.witness.carried(self.marker, self.at(from?)?, from?, frame, ALL);
        match (left, right, carried(left), carried(right)) {
            (Some(l), Some(r), Some(p), Some(q)) => Some(between(p, q, (frame - l) as f64 / (r - l) as f64)),
            (_, _, Some(p), None) | (_, _, None, Some(p)) => Some(p),
            (Some(l), Some(r), None, None) if r - l <= 1 + self.tracks.frames_in(ALONE_SECS).max(ALONE_FRAMES) => self.cubic(frame, l, r),
            _ => None,
        }
    }

    fn cubic(&self, frame: usize, left: usize, right: usize) -> Option<Point> {
        let (p, q) = (self.at(left)?, self.at(right)?);
        let span = (right - left) as f64;
        let share = (frame - left) as f64 / span;
        let before = left.checked_sub(1).and_then(|f| self.at(f));
        let after = self.at(right + 1);
        Some(std::array::from_fn(|k| {
            let chord = q[k] - p[k];
            let (start, end) = (before.map_or(chord, |b| span * (p[k] - b[k])), after.map_or(chord, |a| span * (a[k] - q[k])));
            let (s2, s3) = (share * share, share * share * share);
            p[k] + (s3 - 2.0 * s2 + share) * start + (3.0 * s2 - 2.0 * s3) * chord + (s3 - s2) * end
        }))
    }

    /// How far the marker is from where it is expected, mm.
    fn off(&self, frame: usize, left: Option<usize>, right: Option<usize>) -> Option<f64> {
        Some(distance(self.at(frame)?, self.expected(frame, left, right)?))
    }

    /// The distance, mm, of where the marker is in `frame` from where it is in most of the frames `anchors`, among its partners.
    pub fn level(&self, point: Point, frame: usize, anchors: &[usize]) -> Option<f64> {
        let from = |&a: &usize| Some(distance(point, self.witness.carried(self.marker, self.at(a)?, a, frame, ALL)?));
        let mut distances: Vec<f64> = anchors.iter().filter_map(from).collect();
        if distances.len() < anchors.len().div_ceil(2) { None } else { quantile(&mut distances, 0.5) }
    }

    fn pieces(&self, edges: &[Edge]) -> Vec<Piece> {
        let mut pieces = Vec::new();
        for (start, end) in self.tracks.seen(self.marker) {
            let mut piece = Piece { start, end, border: Border::Gap };
            for edge in edges.iter().filter(|e| (start + 1..end).contains(&e.frame)) {
                pieces.push(Piece { end: edge.frame, ..piece });
                piece = Piece { start: edge.frame, end, border: Border::Edge(*edge) };
            }
            pieces.push(piece);
        }
        pieces
    }

    /// True if the path goes on from the end of one piece to the start of another. `edge_mm`: the least edge that was left out with what is between them.
    fn continues(&self, from: &Piece, to: &Piece, edge_mm: Option<f64>, drift: &Drift, usual_mm: f64) -> bool {
        let (left, right) = (from.end - 1, to.start);
        let frames = right - left;
        let off = self.witness.unexplained(self.tracks, self.marker, left, right).map(length);
        match (off, edge_mm) {
            (Some(off), Some(edge)) => off <= (SHARE_OF_EDGE * edge).max(TIMES_DRIFT * drift.within(frames)).max(9.0 * usual_mm),
            (Some(off), None) => off <= ACROSS_MM.max(ACROSS_TIMES_DRIFT * drift.within(frames)),
            (None, None) => true,
            (None, Some(edge)) => {
                let near = frames <= 1 + self.tracks.frames_in(ALONE_SECS).max(ALONE_FRAMES);
                let (Some(p), Some(q), true) = (self.at(left), self.at(right), near) else { return false };
                let speed = |a: usize, b: usize| Some(super::tracks::minus(self.at(b)?, self.at(a)?));
                let before = left.checked_sub(1).filter(|f| *f >= from.start).and_then(|f| speed(f, left));
                let after = speed(right, right + 1).filter(|_| right + 1 < to.end);
                let speeds = [before, after];
                let count = speeds.iter().flatten().count().max(1) as f64;
                let off = std::array::from_fn(|k| q[k] - p[k] - frames as f64 * speeds.iter().flatten().map(|v| v[k]).sum::<f64>() / count);
                length(off) <= SHARE_OF_EDGE * edge
            }
        }
    }

    /// The stretches that do not belong to the path. `usual_mm`: how far it is usually broken among the partners.
    pub fn strays(&self, edges: &[Edge], usual_mm: f64) -> Vec<Stray> {
        let pieces = self.pieces(edges);
        if pieces.len() < 2 {
            return Vec::new();
        }
        let drift = self.witness.drift(self.marker);
        let seen: usize = pieces.iter().map(|p| p.end - p.start).sum();
        let breach = BREACH * seen as f64;
        let mut best: Vec<(f64, Option<usize>)> = Vec::with_capacity(pieces.len());
        for (q, to) in pieces.iter().enumerate() {
            let mut choice = (0.0, None);
            for p in (q.saturating_sub(REACH)..q).rev() {
                let direct = p + 1 == q;
                let between =
                    pieces[p + 1..=q].iter().filter_map(|x| if let Border::Edge(edge) = x.border { Some(edge.size_mm) } else { None });
                let edge = between.reduce(f64::min);
                let fits = match (direct, to.border) {
                    (true, Border::Edge(_)) => false,
                    _ => self.continues(&pieces[p], to, edge, &drift, usual_mm),
                };
                let score = best[p].0 - if fits { 0.0 } else { breach };
                if score > choice.0 {
                    choice = (score, Some(p));
                }
            }
            best.push((choice.0 + (to.end - to.start) as f64, choice.1));
        }
        let mut kept = Vec::new();
        let mut last = (0..pieces.len()).max_by(|&a, &b| best[a].0.total_cmp(&best[b].0).then(b.cmp(&a)));
        while let Some(at) = last {
            kept.push(at);
            last = best[at].1;
        }
        kept.reverse();
        let anchors: Vec<usize> = Self::anchors(&kept.iter().map(|&k| (pieces[k].start, pieces[k].end)).collect::<Vec<_>>());
        let mut strays = Vec::new();
        let mut at = 0;
        for next in kept.iter().copied().map(Some).chain([None]) {
            let end = next.unwrap_or(pieces.len());
            if at < end {
                strays.extend(self.judge(&pieces, &kept, at..end, &anchors, usual_mm));
            }
            at = end + 1;
        }
        strays
    }

    /// Some frames of the kept pieces, evenly.
    pub fn anchors(kept: &[(usize, usize)]) -> Vec<usize> {
        let frames: Vec<usize> = kept.iter().flat_map(|&(start, end)| start..end).collect();
        (0..ANCHORS.min(frames.len())).map(|k| frames[(2 * k + 1) * frames.len() / (2 * ANCHORS.min(frames.len()))]).collect()
    }

    /// The pieces `out` were left out: are they off the path?
    fn judge(&self, pieces: &[Piece], kept: &[usize], out: Range<usize>, anchors: &[usize], usual_mm: f64) -> Vec<Stray> {
        let Range { start: from, end: to } = out;
        let own = &pieces[from..to];
        let short = own[own.len() - 1].end - own[0].start <= short_frames(self.tracks);
        // what is long cannot lean on what is short
        let leans = |mut side: Box<dyn Iterator<Item = &usize> + '_>| {
            let frames = side.try_fold(0, |sum, &k| {
                let sum = sum + pieces[k].end - pieces[k].start;
                if sum > short_frames(self.tracks) { Err(()) } else { Ok(sum) }
            });
            short || frames.is_err()
        };
        let before = leans(Box::new(kept.iter().rev().filter(|&&k| k < from)));
        let after = leans(Box::new(kept.iter().filter(|&&k| k >= to)));
        let left = from.checked_sub(1).filter(|_| before).map(|k| pieces[k].end - 1);
        let right = pieces.get(to).filter(|_| after).map(|p| p.start);
        // a side that nothing but an edge parts from what is kept
        let entered = if let Border::Edge(edge) = own[0].border { Some(edge) } else { None };
        let leaves = pieces.get(to).and_then(|p| if let Border::Edge(edge) = p.border { Some(edge) } else { None });
        let edges: Vec<Edge> = entered.into_iter().chain(leaves).collect();
        let (start, end) = (own[0].start, own[own.len() - 1].end);
        let beside_gap = entered.is_none() || leaves.is_none();
        let looked_at = some_frames(start, end, LOOKED_AT);
        let mut offs: Vec<f64> = looked_at.iter().filter_map(|&f| self.off(f, left, right)).collect();
        let size_mm = offs.iter().copied().fold(0.0, f64::max);
        let Some(middle) = quantile(&mut offs, 0.5) else { return Vec::new() };
        let least = edges.iter().map(|e| e.size_mm).reduce(f64::min).map_or(ACROSS_MM, |mm| OFF_SHARE * mm);
        let most = edges.iter().map(|e| e.size_mm).reduce(f64::max).unwrap_or(f64::INFINITY);
        if middle < least || size_mm < LEAST_MM {
            return Vec::new();
        }
        // what is long has to come and to go as far as it is off
        if !short {
            let firm = edges.iter().all(|e| e.firm_mm > LONG_EDGE_MM.max(LONG_TIMES_USUAL * usual_mm)) && middle < MOST_OFF_SHARE * most;
            let ends = [(start, left, entered), (end - 1, right, leaves)];
            let steps = ends.iter().all(|&(frame, side, edge)| {
                let (Some(Edge { size_mm: mm, .. }), Some(_)) = (edge, side) else { return true };
                self.off(frame, left, right).is_some_and(|off| off > OFF_SHARE * mm && off < 2.0 * mm)
            });
            if !firm || !steps {
                return Vec::new();
            }
        }
        // entered and left, or short: that is enough
        let sure = (entered.is_some() && leaves.is_some() && left.is_some() && right.is_some()) || (short && !edges.is_empty());
        if !sure {
            let levels = |frames: &[usize]| -> Option<f64> {
                let mut levels: Vec<f64> = frames.iter().filter_map(|&f| self.level(self.at(f)?, f, anchors)).collect();
                quantile(&mut levels, 0.5)
            };
            let (Some(here), Some(usual)) = (levels(&looked_at), levels(anchors)) else { return Vec::new() };
            if here < LEVEL_TIMES * usual + LEVEL_MM || here < least || here > MOST_OFF_SHARE * most {
                return Vec::new();
            }
        }
        // a gap within it parts it
        let mut strays: Vec<Stray> = Vec::new();
        for piece in own {
            match strays.last_mut() {
                Some(last) if last.end == piece.start => last.end = piece.end,
                _ => strays.push(Stray { marker: self.marker, start: piece.start, end: piece.end, left, right, beside_gap, size_mm }),
            }
        }
        strays
    }
}
