//! The table that experts read: every sample seen or filled, and how rigidly markers hang together.

use crate::solve::{Gap, Problem};

/// A marker that was seen in fewer frames than this is not filled and helps nobody.
pub const LEAST_SEEN: usize = 5;

/// Distances between markers are taken from about this many frames, evenly over the take.
const FRAMES_LOOKED_AT: usize = 1500;

/// A pair seen together in fewer frames than this has no known spread.
const LEAST_TOGETHER: usize = 10;

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
        let mut gaps = Vec::new();
        for marker in (0..self.markers).filter(|&i| self.live[i]) {
            let mut start = None;
            for t in 0..=self.frames {
                let missing = t < self.frames && !self.seen(t, marker) && !left_out(t, marker);
                match (missing, start) {
                    (true, None) => start = Some(t),
                    (false, Some(from)) => {
                        gaps.push(Gap { marker, start: from, end: t });
                        start = None;
                    }
                    _ => {}
                }
            }
        }
        gaps
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
    /// From what was seen. Pairs of different `bodies` have no known spread.
    pub fn new(tracks: &Tracks, bodies: &[usize]) -> Self {
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
                let known = together >= LEAST_TOGETHER && bodies[i] == bodies[j];
                let pair = Pair { distance_mm: mean, spread_mm: if known { variance.sqrt() } else { UNKNOWN_MM }, together };
                pairs[i * m + j] = pair;
                pairs[j * m + i] = pair;
            }
        }
        Self { markers: m, pairs }
    }

    /// One pair.
    #[inline]
    pub fn get(&self, i: usize, j: usize) -> Pair {
        self.pairs[i * self.markers + j]
    }
}

/// Distance of two points.
pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt()
}
