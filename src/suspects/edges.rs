//! Edges: where a path is not continued by the next frame.
//!
//! Half the third difference of a path over two frames on either side is what remains when speed and acceleration are taken away.
//! Impacts leave much of it, too: a heel that hits the floor, a hand that claps.
//! But they leave it to all markers of a limb, so it is taken once from the path as the cameras saw it, and once from the path among the partners.
//! An edge is where both are far above what is usual for this marker, over the whole take and at that time.

use super::tracks::{Point, Tracks, length, minus, quantile};
use super::witness::{ALL, Those, Witness};

/// A break of the path between `frame - 1` and `frame`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edge {
    pub frame: usize,
    /// How far the path is broken, mm.
    pub size_mm: f64,
    /// The same, less where fewer frames say so, mm.
    pub firm_mm: f64,
}

/// The least break that is an edge, mm, where partners are witnesses.
const LEAST_MM: f64 = 8.0;
/// An edge is this many times what the path usually shows ...
const TIMES_USUAL: f64 = 7.0;
/// ... and this many times what it shows around that frame.
const TIMES_AROUND: f64 = 4.5;
/// It is also this share of how far the marker goes from frame to frame against the body: partners that bend explain that much less of it.
const SHARE_OF_PACE: f64 = 0.35;
/// The same without witnesses, where only the path speaks.
const ALONE_MM: f64 = 25.0;
const ALONE_TIMES_USUAL: f64 = 25.0;
const ALONE_TIMES_AROUND: f64 = 12.0;
/// What is around a frame, in seconds on either side, but never fewer than so many frames.
const AROUND_SECS: f64 = 0.1;
const AROUND_FRAMES: usize = 6;
/// How much larger a break has to be where frames on one side only show it, because their errors add up.
const ONE_SIDED: f64 = 1.5;
/// So many frames show what is usual.
const LOOKED_AT: usize = 400;

/// A break of a path, and by what thresholds grow where it is seen from fewer frames.
#[derive(Clone, Copy, Debug)]
struct Break {
    mm: f64,
    gain: f64,
}

impl Break {
    fn edge(self, frame: usize) -> Edge {
        Edge { frame, size_mm: self.mm, firm_mm: self.mm / self.gain }
    }
}

/// How far the path breaks before frame 0 of `path`, which gives positions from -3 to 2.
fn broken(path: impl Fn(isize) -> Option<Point>) -> Option<Break> {
    let (last, first) = (path(-1)?, path(0)?);
    let jump = minus(first, last);
    let steps = (path(-2).map(|p| minus(last, p)), path(1).map(|p| minus(p, first)));
    let (mm, gain) = match steps {
        (Some(before), Some(after)) => (length(std::array::from_fn(|k| jump[k] - 0.5 * (before[k] + after[k]))), 1.0),
        (None, Some(after)) => one_sided(jump, after, path(2).zip(path(1)).map(|(p, q)| minus(p, q))),
        (Some(before), None) => one_sided(jump, before, path(-2).zip(path(-3)).map(|(p, q)| minus(p, q))),
        (None, None) => (length(jump), 3.0),
    };
    Some(Break { mm, gain })
}

/// With frames on one side only, the speed there is taken for steady or for steadily changing, whichever makes less of the jump.
fn one_sided(jump: Point, near: Point, far: Option<Point>) -> (f64, f64) {
    let steady = length(minus(jump, near));
    match far {
        Some(far) => (steady.min(length(std::array::from_fn(|k| jump[k] - 2.0 * near[k] + far[k]))), ONE_SIDED),
        None => (steady, 1.5 * ONE_SIDED),
    }
}

/// The edges of one marker's path.
pub(super) struct Edges<'a> {
    path: &'a Tracks,
    witness: &'a Witness<'a>,
    marker: usize,
    usual_mm: f64,
    usual_among_mm: f64,
}

impl<'a> Edges<'a> {
    /// Looks at what is usual. The path is looked at in `path`, partners in the tracks of `witness`.
    pub fn new(path: &'a Tracks, witness: &'a Witness<'a>, marker: usize) -> Self {
        let mut edges = Self { path, witness, marker, usual_mm: 0.0, usual_among_mm: 0.0 };
        let stride = (path.frames / LOOKED_AT).max(1);
        let mut own: Vec<f64> =
            (0..path.frames).step_by(stride).filter_map(|f| edges.own(f)).filter(|b| b.gain == 1.0).map(|b| b.mm).collect();
        edges.usual_mm = quantile(&mut own, 0.5).unwrap_or(0.0);
        let mut among: Vec<f64> =
            (0..path.frames).step_by(stride).filter_map(|f| edges.among(f, ALL)).filter(|b| b.gain == 1.0).map(|b| b.mm).collect();
        edges.usual_among_mm = quantile(&mut among, 0.5).unwrap_or(0.0);
        edges
    }

    /// What is usual among the partners, mm.
    pub fn usual_among_mm(&self) -> f64 {
        self.usual_among_mm
    }

    /// The break of the path as it was seen.
    fn own(&self, frame: usize) -> Option<Break> {
        broken(|by| self.path.near(self.marker, frame, by))
    }

    /// The break of the path among the partners.
    /// Partners that come or go meanwhile do not count, or they would break it.
    fn among(&self, frame: usize, those: Those) -> Option<Break> {
        let steady = self.witness.steady(self.marker, self.looked_at(frame));
        broken(|by| {
            let point = self.path.near(self.marker, frame, by)?;
            if by == 0 {
                Some(point)
            } else {
                self.witness.carried(self.marker, point, frame.checked_add_signed(by)?, frame, those & steady)
            }
        })
    }

    /// The frames that a break is seen from: two on either side, or three on one where there is a gap on the other.
    fn looked_at(&self, frame: usize) -> impl Iterator<Item = usize> + Clone {
        let seen = move |by: isize| self.path.near(self.marker, frame, by).is_some();
        let (first, last) = match (seen(-2), seen(1)) {
            (true, true) => (-2, 1),
            (false, true) => (-1, 2),
            (true, false) => (-3, 0),
            (false, false) => (-1, 0),
        };
        (first..=last).filter(move |&by| seen(by)).filter_map(move |by| frame.checked_add_signed(by))
    }

    /// The least break that any set of partners leaves, each of which may be wrong itself.
    fn least_among(&self, frame: usize) -> Option<f64> {
        let all = self.among(frame, ALL)?.mm;
        let without = (0..self.witness.of(self.marker).len()).filter_map(|at| self.among(frame, ALL & !(1 << at)));
        Some(without.map(|b| b.mm).fold(all, f64::min))
    }

    /// What `of` shows around a frame, the frame itself and its neighbours left out.
    fn around(&self, frame: usize, of: impl Fn(usize) -> Option<Break>) -> f64 {
        let reach = self.path.frames_in(AROUND_SECS).clamp(AROUND_FRAMES, 4 * AROUND_FRAMES);
        let step = (reach / AROUND_FRAMES).max(1);
        let others = (3..3 + reach).step_by(step).flat_map(|by| [frame.checked_sub(by), Some(frame + by)]);
        let mut breaks: Vec<f64> = others.flatten().filter_map(of).map(|b| b.mm / b.gain).collect();
        quantile(&mut breaks, 0.5).unwrap_or(0.0)
    }

    /// The break between `frame - 1` and `frame`, if it is an edge.
    pub fn at(&self, frame: usize) -> Option<Edge> {
        let own = self.own(frame)?;
        // cheap, and false nearly always
        if own.mm < own.gain * LEAST_MM.max(0.5 * TIMES_USUAL * self.usual_mm.min(LEAST_MM)) {
            return None;
        }
        let Some(among) = self.among(frame, ALL) else {
            let least = ALONE_MM.max(ALONE_TIMES_USUAL * self.usual_mm);
            let high = own.gain == 1.0 && own.mm > least && own.mm > ALONE_TIMES_AROUND * self.around(frame, |f| self.own(f));
            return high.then_some(own.edge(frame));
        };
        let least = among.gain * LEAST_MM.max(TIMES_USUAL * self.usual_among_mm);
        let least = least.max(SHARE_OF_PACE * self.path.pace(self.marker, frame));
        let high = among.mm > least
            && among.mm > among.gain * TIMES_AROUND * self.around(frame, |f| self.among(f, ALL))
            && self.least_among(frame).is_some_and(|mm| mm > least && mm > 0.5 * among.mm);
        high.then_some(among.edge(frame))
    }

    /// All edges, in order.
    pub fn all(&self) -> Vec<Edge> {
        let found: Vec<Edge> = (1..self.path.frames).filter_map(|frame| self.at(frame)).collect();
        // a break shows half of itself in the frames before and after
        let near = |edge: &Edge, frame: usize| found.iter().find(|e| e.frame == frame).is_some_and(|e| e.size_mm * 0.6 > edge.size_mm);
        found.iter().filter(|e| !near(e, e.frame - 1) && !near(e, e.frame + 1)).copied().collect()
    }
}
