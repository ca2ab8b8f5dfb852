//! The take as matrices. This is the only place where the one becomes the other.

use formats::{Direction, Origin, Role, Take};

/// A maximal run of missing samples of one marker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Column of the take.
    pub marker: usize,
    /// First missing frame.
    pub start: usize,
    /// One past the last missing frame.
    pub end: usize,
}

impl Gap {
    /// Number of missing frames.
    pub fn frames(&self) -> usize {
        self.end - self.start
    }
}

/// Two markers whose distance hardly changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bone {
    /// One end, as a column of the take.
    pub a: usize,
    /// The other end.
    pub b: usize,
    /// Mean distance in mm.
    pub length_mm: f64,
    /// Standard deviation of the distance over the frames in which both ends are seen, in mm.
    pub spread_mm: f64,
}

/// What a solver is given: markers × frames with holes, the gaps to fill, and the bones to keep.
///
/// Columns are those of the take's markers that take part (model outputs, markers that never appear, and markers that the user left out do not).
#[derive(Clone, Debug)]
pub struct Problem {
    /// Frames per second.
    pub rate_hz: f64,
    /// The axis that points up, if the file says so.
    pub up: Option<Direction>,
    /// For each column of the problem, its column in the take.
    pub columns: Vec<usize>,
    /// Label of each column, without a subject's prefix. Only the optional start of the body frame looks at it.
    pub names: Vec<String>,
    /// The prefix that each column's label has, counted from 0 in the order in which they appear; labels without one count as having the first.
    pub prefixes: Vec<usize>,
    /// Bones; `a` and `b` are columns of the problem.
    pub bones: Vec<Bone>,
    /// Every missing sample as (frame, column of the problem), frame by frame. The order of every [`Estimate`](super::Estimate).
    pub missing: Vec<(usize, usize)>,
    /// Shares its positions with the take that the problem was made of.
    take: Take,
    /// Samples that are hidden besides, frame by frame; empty if there are none.
    hidden: Vec<bool>,
    missing_starts: Vec<usize>,
}

impl Problem {
    /// Takes the markers for which `include` is true and which were seen at least once, with the bones between them.
    /// `bones` name columns of the take.
    pub fn new(take: &Take, include: &[bool], bones: &[Bone]) -> Self {
        let frames = take.frames();
        let columns: Vec<usize> = (0..take.markers.len())
            .filter(|&m| {
                include.get(m).copied().unwrap_or(false)
                    && take.markers.get(m).is_some_and(|marker| marker.role == Role::Marker)
                    && (0..frames).any(|f| take.position_mm(f, m).is_some())
            })
            .collect();
        let column_of = |marker: usize| columns.binary_search(&marker).ok();
        let bones = bones.iter().filter_map(|bone| Some(Bone { a: column_of(bone.a)?, b: column_of(bone.b)?, ..*bone })).collect();
        let names = columns.iter().filter_map(|&m| take.markers.get(m)).map(|m| m.name().to_owned()).collect();
        let prefixes = prefixes(take, &columns);
        let mut problem = Self {
            rate_hz: take.rate_hz,
            up: take.up,
            columns,
            names,
            prefixes,
            bones,
            missing: Vec::new(),
            take: take.clone(),
            hidden: Vec::new(),
            missing_starts: Vec::new(),
        };
        problem.list_missing();
        problem
    }

    /// The same with more samples, (frame, column), hidden.
    #[must_use]
    pub fn hiding(&self, samples: &[(usize, usize)]) -> Self {
        let mut other = self.clone();
        other.hidden.resize(self.frames() * self.markers(), false);
        for &(t, i) in samples {
            other.hidden[t * self.markers() + i] = true;
        }
        other.list_missing();
        other
    }

    /// Lists what is not seen, frame by frame.
    fn list_missing(&mut self) {
        self.missing.clear();
        self.missing_starts.clear();
        for frame in 0..self.frames() {
            self.missing_starts.push(self.missing.len());
            for column in 0..self.markers() {
                if !self.observed(frame, column) {
                    self.missing.push((frame, column));
                }
            }
        }
        self.missing_starts.push(self.missing.len());
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.take.frames()
    }

    /// Number of markers that take part.
    pub fn markers(&self) -> usize {
        self.columns.len()
    }

    /// The position in mm, `None` if the sample is missing.
    pub fn position_mm(&self, frame: usize, column: usize) -> Option<[f64; 3]> {
        if self.is_hidden(frame, column) { None } else { self.take.position_mm(frame, self.columns[column]) }
    }

    /// True if the sample was seen.
    pub fn observed(&self, frame: usize, column: usize) -> bool {
        !self.is_hidden(frame, column) && self.take.origin(frame, self.columns[column]) != Origin::Missing
    }

    fn is_hidden(&self, frame: usize, column: usize) -> bool {
        !self.hidden.is_empty() && self.hidden[frame * self.markers() + column]
    }

    /// The part of [`Problem::missing`] that belongs to `frame`, as a range of indices.
    pub fn missing_in(&self, frame: usize) -> std::ops::Range<usize> {
        self.missing_starts[frame]..self.missing_starts[frame + 1]
    }
}

fn prefixes(take: &Take, columns: &[usize]) -> Vec<usize> {
    let mut known: Vec<&str> = Vec::new();
    columns
        .iter()
        .map(|&m| {
            let Some(prefix) = take.markers.get(m).and_then(|marker| marker.prefix()).filter(|s| !s.is_empty()) else { return 0 };
            known.iter().position(|s| *s == prefix).unwrap_or_else(|| {
                known.push(prefix);
                known.len() - 1
            })
        })
        .collect()
}
