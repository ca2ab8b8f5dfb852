//! Runs: stretches of places of which the same is true.

use serde::Serialize;

/// The most stretches that are told to people; scripts and tables have all.
const MOST_STRETCHES: usize = 8;

/// Frames in a row, by their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Stretch {
    /// The first one.
    pub first_frame: i64,
    /// The last one.
    pub last_frame: i64,
    /// How many.
    pub frames: usize,
}

impl Stretch {
    /// All stretches of the `count` frames of which something holds. `number` is what a frame, counted from 0, is called.
    pub fn all(count: usize, number: impl Fn(usize) -> i64, holds: impl Fn(usize) -> bool) -> Vec<Self> {
        let stretch = |(start, end): (usize, usize)| Self { first_frame: number(start), last_frame: number(end - 1), frames: end - start };
        runs(count, holds).into_iter().map(stretch).collect()
    }

    fn text(&self) -> String {
        if self.frames == 1 { self.first_frame.to_string() } else { format!("{}-{}", self.first_frame, self.last_frame) }
    }

    /// Some stretches, as `3, 7-9 and 2 more`.
    pub fn listed(stretches: &[Self]) -> String {
        let shown: Vec<String> = stretches.iter().take(MOST_STRETCHES).map(Self::text).collect();
        let more = stretches.len().saturating_sub(MOST_STRETCHES);
        if more > 0 { format!("{} and {more} more", shown.join(", ")) } else { shown.join(", ") }
    }

    /// Frames of all of them.
    pub fn total(stretches: &[Self]) -> usize {
        stretches.iter().map(|stretch| stretch.frames).sum()
    }
}

/// Maximal runs of places below `count` for which `holds`, in order, half-open.
pub fn runs(count: usize, holds: impl Fn(usize) -> bool) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let mut start = None;
    for place in 0..=count {
        match (place < count && holds(place), start) {
            (true, None) => start = Some(place),
            (false, Some(from)) => {
                found.push((from, place));
                start = None;
            }
            _ => {}
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_maximal() {
        for (row, expected) in
            [("", vec![]), (".", vec![]), ("#", vec![(0, 1)]), ("##..#.#", vec![(0, 2), (4, 5), (6, 7)]), (".##.", vec![(1, 3)])]
        {
            let row = row.as_bytes();
            assert_eq!(runs(row.len(), |place| row[place] == b'#'), expected);
        }
    }
}
