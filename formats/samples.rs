//! Sets of samples.

use std::collections::BTreeSet;

/// A set of samples: frames counted from 0, and markers by their column.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Samples(BTreeSet<(usize, usize)>);

impl Samples {
    /// No samples.
    pub const fn new() -> Self {
        Self(BTreeSet::new())
    }

    /// Adds the sample of `marker` in `frame`.
    pub fn insert(&mut self, frame: usize, marker: usize) {
        self.0.insert((frame, marker));
    }

    /// True if the sample of `marker` in `frame` is one of them.
    pub fn contains(&self, frame: usize, marker: usize) -> bool {
        !self.0.is_empty() && self.0.contains(&(frame, marker))
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Frame and marker of each, frame by frame.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize)> {
        self.0.iter().copied()
    }
}

impl FromIterator<(usize, usize)> for Samples {
    fn from_iter<I: IntoIterator<Item = (usize, usize)>>(samples: I) -> Self {
        Self(samples.into_iter().collect())
    }
}
