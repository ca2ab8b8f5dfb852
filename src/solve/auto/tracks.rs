//! The table that experts read: every sample seen or filled, and how rigidly markers hang together.

pub(super) use crate::bones::distance;
use crate::runs::runs;
use crate::solve::{Gap, Problem, forest};

/// A marker that was seen in fewer frames than this is not filled and helps nobody.
pub const LEAST_SEEN: usize = 5;

/// Distances between markers are taken from about this many frames, evenly over the take.
const FRAMES_LOOKED_AT: usize = 1500;

/// A pair seen together in fewer frames than this has no known spread.
const LEAST_TOGETHER: usize = 10;

/// Markers with different prefixes hang together if a pair of them was seen together this often, with a distance of at most this and that spread.
const LEAST_JOINED: usize = 50;
const JOINED_DISTANCE_MM: f64 = 600.0;
const JOINED_SPREAD_MM: f64 = 25.0;

/// The spread of a pair about which nothing is known, mm: far beyond that of any other.
pub const UNKNOWN_MM: f64 = 1e6;

/// Markers × frames without holes: what was seen, and what is believed of the rest.
#[derive(Clone, Debug)]
pub struct Tracks {
    /// Number of frames.
    pub frames: usize,
    /// Number of markers.
    pub markers: usize,
    /// Position of each marker in each frame, frame by frame, mm.
    places_mm: Vec<[f64; 3]>,
    /// Standard deviation of the 3-D error, mm; 0 for what was seen.
    sigma_mm: Vec<f64>,
    /// What was seen.
    seen: Vec<bool>,
    /// Markers that take part.
    live: Vec<bool>,
}

impl Tracks {
    /// What was seen, with straight lines across the gaps (the nearest sample held at the take's ends).
    pub fn new(problem: &Problem) -> Self {
        let (frames, markers) = (problem.frames(), problem.markers());
        let mut places_mm = vec![[0.0; 3]; frames * markers];
        let mut seen = vec![false; frames * markers];
        let mut live = vec![false; markers];
        for i in 0..markers {
            let own: Vec<usize> = (0..frames).filter(|&t| problem.observed(t, i)).collect();
            live[i] = own.len() >= LEAST_SEEN;
            for &t in &own {
                seen[t * markers + i] = true;
            }
            let mut next = 0;
            for t in 0..frames {
                while own.get(next).is_some_and(|&u| u < t) {
                    next += 1;
                }
                let at = |u: usize| problem.position_mm(u, i).unwrap_or_default();
                places_mm[t * markers + i] = match (next.checked_sub(1).and_then(|k| own.get(k)), own.get(next)) {
                    (_, Some(&u)) if u == t => at(u),
                    (Some(&a), Some(&b)) => {
                        let share = (t - a) as f64 / (b - a) as f64;
                        let (from, to) = (at(a), at(b));
                        std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]))
                    }
                    (Some(&only), None) | (None, Some(&only)) => at(only),
                    (None, None) => [0.0; 3],
                };
            }
        }
        Self { frames, markers, places_mm, sigma_mm: vec![0.0; frames * markers], seen, live }
    }

    /// Position, mm.
    #[inline]
    pub fn place(&self, t: usize, i: usize) -> [f64; 3] {
        self.places_mm[t * self.markers + i]
    }

    /// Standard deviation of the 3-D error, mm; 0 for what was seen.
    #[inline]
    pub fn sigma(&self, t: usize, i: usize) -> f64 {
        self.sigma_mm[t * self.markers + i]
    }

    /// True if the sample was seen.
    #[inline]
    pub fn seen(&self, t: usize, i: usize) -> bool {
        self.seen[t * self.markers + i]
    }

    /// True if the marker was seen often enough to take part.
    pub fn live(&self, i: usize) -> bool {
        self.live[i]
    }

    /// Replaces a sample that was not seen.
    pub fn put(&mut self, t: usize, i: usize, place_mm: [f64; 3], sigma_mm: f64) {
        let at = t * self.markers + i;
        debug_assert!(!self.seen[at], "what was seen stays");
        self.places_mm[at] = place_mm;
        self.sigma_mm[at] = sigma_mm;
    }

    /// The share of a run of frames in which a marker is missing.
    pub fn missing_share(&self, i: usize, start: usize, end: usize) -> f64 {
        (start..end).filter(|&t| !self.seen(t, i)).count() as f64 / (end - start).max(1) as f64
    }

    /// The gaps of the markers that take part, marker by marker, without samples that are `left_out`.
    pub fn gaps(&self, left_out: impl Fn(usize, usize) -> bool) -> Vec<Gap> {
        let of = |marker| {
            let missing = |t| !self.seen(t, marker) && !left_out(t, marker);
            runs(self.frames, missing).into_iter().map(move |(start, end)| Gap { marker, start, end })
        };
        (0..self.markers).filter(|&i| self.live[i]).flat_map(of).collect()
    }
}

/// How two markers keep together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Mean distance, mm.
    pub distance_mm: f64,
    /// Standard deviation of the distance, mm; [`UNKNOWN_MM`] if they were hardly seen together.
    pub spread_mm: f64,
    /// In how many of the frames that were looked at both were seen.
    pub together: usize,
}

/// Every pair of markers, over frames in which both were seen.
#[derive(Clone, Debug)]
pub struct Pairs {
    markers: usize,
    pairs: Vec<Pair>,
}

impl Pairs {
    /// From what was seen.
    pub fn new(tracks: &Tracks) -> Self {
        let m = tracks.markers;
        let stride = (tracks.frames / FRAMES_LOOKED_AT).max(1);
        let unknown = Pair { distance_mm: 0.0, spread_mm: UNKNOWN_MM, together: 0 };
        let mut pairs = vec![unknown; m * m];
        let mut distances = Vec::new();
        for i in 0..m {
            for j in 0..i {
                distances.clear();
                for t in (0..tracks.frames).step_by(stride) {
                    if tracks.seen(t, i) && tracks.seen(t, j) {
                        distances.push(distance(tracks.place(t, i), tracks.place(t, j)));
                    }
                }
                let together = distances.len();
                let n = together.max(1) as f64;
                let mean = distances.iter().sum::<f64>() / n;
                let variance = distances.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n;
                let known = together >= LEAST_TOGETHER;
                let pair = Pair { distance_mm: mean, spread_mm: if known { variance.sqrt() } else { UNKNOWN_MM }, together };
                pairs[i * m + j] = pair;
                pairs[j * m + i] = pair;
            }
        }
        Self { markers: m, pairs }
    }

    /// Which body each marker belongs to, counted from 0. Labels with the same prefix belong to one body, and prefixes whose markers hang together
    /// do, too: a prefix may name a subject or a segment of one. Pairs of different bodies lose their spread.
    pub fn bodies(&mut self, tracks: &Tracks, prefixes: &[usize]) -> Vec<usize> {
        let m = self.markers;
        let looked_at = tracks.frames.div_ceil((tracks.frames / FRAMES_LOOKED_AT).max(1));
        let mut trees: Vec<usize> = (0..=prefixes.iter().copied().max().unwrap_or(0)).collect();
        for i in 0..m {
            for j in 0..i {
                let pair = self.get(i, j);
                let often = pair.together >= LEAST_JOINED.max(looked_at / 10);
                if often && pair.spread_mm <= JOINED_SPREAD_MM && pair.distance_mm <= JOINED_DISTANCE_MM {
                    let (a, b) = (forest::root(&mut trees, prefixes[i]), forest::root(&mut trees, prefixes[j]));
                    trees[a.max(b)] = a.min(b);
                }
            }
        }
        let roots: Vec<usize> = prefixes.iter().map(|&p| forest::root(&mut trees, p)).collect();
        let mut order: Vec<usize> = Vec::new();
        let bodies: Vec<usize> = roots
            .into_iter()
            .map(|root| {
                order.iter().position(|&r| r == root).unwrap_or_else(|| {
                    order.push(root);
                    order.len() - 1
                })
            })
            .collect();
        for i in 0..m {
            for j in 0..m {
                if bodies[i] != bodies[j] {
                    self.pairs[i * m + j].spread_mm = UNKNOWN_MM;
                }
            }
        }
        bodies
    }

    /// One pair.
    #[inline]
    pub fn get(&self, i: usize, j: usize) -> Pair {
        self.pairs[i * self.markers + j]
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::random::{Random, Stream};
    use formats::{Marker, Origin, TakeBuilder};

    /// A problem without bones: where `place` puts each marker in each frame, as far as `seen` says that it was seen.
    pub fn problem(
        (frames, markers): (usize, usize),
        rate_hz: f64,
        place: impl Fn(usize, usize) -> [f64; 3],
        seen: impl Fn(usize, usize) -> bool,
    ) -> Problem {
        let mut take = TakeBuilder::new((0..markers).map(|i| Marker::new(format!("M{i}"))).collect(), frames, rate_hz);
        for t in 0..frames {
            for i in (0..markers).filter(|&i| seen(t, i)) {
                take.set(t, i, place(t, i), Origin::Measured);
            }
        }
        Problem::new(&take.build(), &vec![true; markers], &[])
    }

    #[test]
    fn gaps_are_the_runs_of_what_is_missing_and_not_left_out() {
        let mut random = Random::new(1, Stream::Gaps);
        for _ in 0..20 {
            let (frames, markers) = (random.whole(8, 60), random.whole(1, 6));
            let mask: Vec<bool> = (0..frames * markers).map(|_| random.between(0.0, 1.0) < 0.7).collect();
            let out: Vec<bool> = (0..frames).map(|_| random.between(0.0, 1.0) < 0.2).collect();
            // every marker is there, and the first one is seen too rarely to take part
            let seen = |t: usize, i: usize| if i == 0 { t < LEAST_SEEN - 1 } else { t < LEAST_SEEN || mask[t * markers + i] };
            let tracks = Tracks::new(&problem((frames, markers), 100.0, |t, i| [t as f64, i as f64, 0.0], seen));
            let gaps = tracks.gaps(|t, _| out[t]);
            let mut covered = vec![false; frames * markers];
            for gap in &gaps {
                assert!(gap.start < gap.end && gap.marker > 0, "{gap:?}");
                for t in gap.start..gap.end {
                    assert!(!covered[t * markers + gap.marker], "{gap:?} overlaps another");
                    covered[t * markers + gap.marker] = true;
                }
            }
            for t in 0..frames {
                for i in 0..markers {
                    assert_eq!(covered[t * markers + i], i > 0 && !seen(t, i) && !out[t], "frame {t}, marker {i}");
                }
            }
            let maximal = |w: &[Gap]| w[0].marker < w[1].marker || (w[0].marker == w[1].marker && w[0].end < w[1].start);
            assert!(gaps.windows(2).all(maximal), "{gaps:?}");
        }
    }

    #[test]
    fn holes_begin_as_straight_lines_and_ends_are_held() {
        let tracks = Tracks::new(&problem((20, 1), 100.0, |t, _| [(t * t) as f64, 1.0, -2.0], |t, _| matches!(t, 2..=5 | 9..=12)));
        for (t, x) in [(0, 4.0), (2, 4.0), (6, 39.0), (8, 67.0), (9, 81.0), (19, 144.0)] {
            let [found, ..] = tracks.place(t, 0);
            assert!((found - x).abs() < 1e-12, "frame {t}: {found}, not {x}");
        }
        assert!((0..20).all(|t| tracks.place(t, 0)[1..] == [1.0, -2.0] && tracks.sigma(t, 0) == 0.0));
    }

    #[test]
    fn pairs_are_of_one_body_and_of_what_was_seen_of_both() {
        // of the second prefix, marker 2 keeps its distance from the first one's and marker 4 does not
        let place = |t: usize, i: usize| match i {
            1 => [if t.is_multiple_of(2) { 110.0 } else { 100.0 }, 0.0, 0.0],
            4 => [300.0 + 10.0 * t as f64, 0.0, 0.0],
            _ => [100.0 * i as f64, 0.0, 0.0],
        };
        for (frames, bodies) in [(40, [0, 0, 1, 0, 1]), (60, [0, 0, 0, 0, 0])] {
            let tracks = Tracks::new(&problem((frames, 5), 100.0, place, |t, i| i != 3 || t < LEAST_TOGETHER - 1));
            let mut pairs = Pairs::new(&tracks);
            assert_eq!(pairs.bodies(&tracks, &[0, 0, 1, 0, 1]), bodies, "prefixes that hang together are one body");
            let pair = pairs.get(0, 1);
            assert!((pair.distance_mm - 105.0).abs() < 1e-9 && (pair.spread_mm - 5.0).abs() < 1e-9 && pair.together == frames, "{pair:?}");
            assert_eq!(pair, pairs.get(1, 0));
            assert_eq!([pairs.get(0, 2), pairs.get(4, 1)].map(|p| p.spread_mm >= UNKNOWN_MM), [frames == 40; 2]);
            assert_eq!((pairs.get(0, 3).spread_mm, pairs.get(0, 3).together), (UNKNOWN_MM, LEAST_TOGETHER - 1), "hardly seen together");
        }
    }
}
