//! The take marker by marker, which is how paths are followed, and a little arithmetic of points.

pub(super) use crate::bones::distance;
use crate::runs::runs;
use formats::{Role, Take};

/// A position in mm.
pub(super) type Point = [f64; 3];

/// The paths of the markers that somebody named.
#[derive(Clone)]
pub(super) struct Tracks {
    pub rate_hz: f64,
    pub frames: usize,
    /// Which column of the take each path is.
    pub columns: Vec<usize>,
    /// Path by path, frame by frame; NaN where the sample is missing.
    paths: Vec<Vec<Point>>,
    /// How far all markers together go from each frame to the next.
    steps: Vec<Point>,
}

impl Tracks {
    /// All markers, except those that a program numbered because nobody had named them; unless there are no others.
    pub fn new(take: &Take) -> Self {
        let markers = || (0..take.markers.len()).filter(|&m| take.markers[m].role == Role::Marker);
        let mut columns: Vec<usize> = markers().filter(|&m| !nameless(take.markers[m].name())).collect();
        if columns.is_empty() {
            columns = markers().collect();
        }
        let path = |&m: &usize| (0..take.frames()).map(|f| take.position_mm(f, m).unwrap_or([f64::NAN; 3])).collect();
        let paths: Vec<Vec<Point>> = columns.iter().map(path).collect();
        let steps = (1..take.frames().max(1)).map(|frame| mean_step(&paths, frame)).collect();
        Self { rate_hz: take.rate_hz, frames: take.frames(), paths, columns, steps }
    }

    /// How far a marker usually goes against all others from one frame to the next, around a frame, mm.
    pub fn pace(&self, marker: usize, frame: usize) -> f64 {
        let step = |to: usize| {
            let from = to.checked_sub(1)?;
            Some(distance(minus(self.at(marker, to)?, self.at(marker, from)?), *self.steps.get(from)?))
        };
        let mut steps: Vec<f64> = (frame.saturating_sub(3)..frame + 4).filter_map(step).collect();
        quantile(&mut steps, 0.5).unwrap_or(0.0)
    }

    /// Number of paths.
    pub fn len(&self) -> usize {
        self.paths.len()
    }

    /// Where a marker was seen; `None` also outside the take.
    pub fn at(&self, marker: usize, frame: usize) -> Option<Point> {
        self.paths[marker].get(frame).copied().filter(|p| !p[0].is_nan())
    }

    /// The same with a frame that may lie before the take.
    pub fn near(&self, marker: usize, frame: usize, by: isize) -> Option<Point> {
        frame.checked_add_signed(by).and_then(|f| self.at(marker, f))
    }

    /// Forgets a sample.
    pub fn hide(&mut self, marker: usize, frame: usize) {
        self.paths[marker][frame] = [f64::NAN; 3];
    }

    /// Maximal runs of seen frames of a marker, half-open.
    pub fn seen(&self, marker: usize) -> Vec<(usize, usize)> {
        runs(self.frames, |frame| self.at(marker, frame).is_some())
    }

    /// At least one frame, at most `secs`.
    pub fn frames_in(&self, secs: f64) -> usize {
        ((secs * self.rate_hz).round() as usize).max(1)
    }
}

/// The mean step into a frame of all markers that are seen there and before.
fn mean_step(paths: &[Vec<Point>], frame: usize) -> Point {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for path in paths {
        let step = minus(path[frame], path[frame - 1]);
        if !step[0].is_nan() {
            sum = std::array::from_fn(|k| sum[k] + step[k]);
            count += 1.0;
        }
    }
    if count > 0.0 { sum.map(|x| x / count) } else { sum }
}

/// Labels of trajectories that no person named: `*12`, `Unlabeled 1034`, `Unnamed_3`, `U-15`, or nothing at all.
fn nameless(name: &str) -> bool {
    let name = name.trim().to_ascii_lowercase();
    let numbered = |rest: &str| !rest.is_empty() && rest.chars().all(|c| c.is_ascii_digit() || "-_ *".contains(c));
    name.starts_with('*')
        || numbered(&name)
        || name.is_empty()
        || ["unlabel", "unlabl", "unnamed", "unidentified", "ghost", "uname*", "no name"].iter().any(|start| name.starts_with(start))
        || name.strip_prefix("u-").or_else(|| name.strip_prefix("u_")).is_some_and(numbered)
}

pub(super) fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn length(a: Point) -> f64 {
    (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt()
}

/// `(1 - share) a + share b`
pub(super) fn between(a: Point, b: Point, share: f64) -> Point {
    std::array::from_fn(|k| a[k] + share * (b[k] - a[k]))
}

/// The value below which this share of the values lies; `None` of none.
pub(super) fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let at = (share * last as f64).round() as usize;
    Some(*values.select_nth_unstable_by(at, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_nobody_gave() {
        for (name, is) in [
            ("*12", true),
            ("", true),
            ("Unlabeled 1034", true),
            ("Unlabeled1034", true),
            ("U-15", true),
            ("17", true),
            ("UPPER", false),
            ("U1", false),
            ("LKNE", false),
            ("M1", false),
        ] {
            assert_eq!(nameless(name), is, "{name}");
        }
    }
}
