//! Gaps: maximal runs of missing samples, and the decision which of them are filled.

use crate::runs::runs;
use crate::solve::Gap;
use formats::{Origin, Role, Take};

/// All gaps of the take's markers (model outputs have none), marker by marker.
pub fn gaps(take: &Take) -> Vec<Gap> {
    let of = |marker| {
        let missing = move |frame| take.origin(frame, marker) == Origin::Missing;
        runs(take.frames(), missing).into_iter().map(move |(start, end)| Gap { marker, start, end })
    };
    (0..take.markers.len()).filter(|&marker| take.markers[marker].role == Role::Marker).flat_map(of).collect()
}

/// Why a gap stays open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Open {
    /// The marker never appears: there is nothing to fill from.
    NeverSeen,
    /// The gap reaches the first or last frame.
    AtEnd,
    /// It is longer than the user allows.
    TooLong,
    /// The user did not ask for this marker.
    NotAskedFor,
    /// The marker was seen in too few frames to predict it from.
    TooFewSeen,
    /// The fill is less sure than the user wants, or the method cannot say how sure it is.
    TooUnsure,
    /// The method could not say anything.
    Unsolved,
}

impl Open {
    /// The reason in words, with the way out.
    pub fn reason(self) -> &'static str {
        match self {
            Self::NeverSeen => "the marker never appears",
            Self::AtEnd => "reaches the first or last frame (fill it with --extrapolate)",
            Self::TooLong => "longer than --max-gap",
            Self::NotAskedFor => "not among --markers",
            Self::TooFewSeen => "the marker was seen in too few frames to predict it from",
            Self::TooUnsure => "less sure than --max-sigma",
            Self::Unsolved => "the method found no position",
        }
    }

    /// The reason as one word, for scripts.
    pub fn word(self) -> &'static str {
        match self {
            Self::NeverSeen => "never-seen",
            Self::AtEnd => "at-end",
            Self::TooLong => "too-long",
            Self::NotAskedFor => "not-asked-for",
            Self::TooFewSeen => "too-few-seen",
            Self::TooUnsure => "too-unsure",
            Self::Unsolved => "unsolved",
        }
    }
}

/// What the user allows.
#[derive(Clone, Debug, Default)]
pub struct Policy {
    /// The longest gap that is filled, in frames; longer ones stay open whole.
    pub max_gap: Option<usize>,
    /// Fill gaps that reach the first or last frame.
    pub extrapolate: bool,
    /// The largest predicted error of a sample with which a gap is filled, mm; otherwise it stays open whole.
    pub max_sigma_mm: Option<f64>,
}

impl Policy {
    /// Decides about one gap. `asked_for` says whether the user wants this marker filled.
    ///
    /// # Errors
    /// Why it stays open.
    pub fn decide(&self, gap: &Gap, take: &Take, asked_for: bool) -> Result<(), Open> {
        if gap.frames() == take.frames() {
            return Err(Open::NeverSeen);
        }
        if !asked_for {
            return Err(Open::NotAskedFor);
        }
        if !self.extrapolate && (gap.start == 0 || gap.end == take.frames()) {
            return Err(Open::AtEnd);
        }
        if self.max_gap.is_some_and(|most| gap.frames() > most) {
            return Err(Open::TooLong);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use formats::{Marker, TakeBuilder};

    fn take(rows: &[&str]) -> Take {
        let markers = rows.iter().enumerate().map(|(k, _)| Marker::new(format!("M{k}"))).collect();
        let mut b = TakeBuilder::new(markers, rows[0].len(), 100.0);
        for (m, row) in rows.iter().enumerate() {
            for (f, _) in row.chars().enumerate().filter(|&(_, c)| c == '#') {
                b.set(f, m, [1.0; 3], Origin::Measured);
            }
        }
        b.build()
    }

    #[test]
    fn gaps_are_maximal_runs() {
        let found = gaps(&take(&["##..#.#", "..###..", ".......", "#######"]));
        let spans: Vec<_> = found.iter().map(|g| (g.marker, g.start, g.end)).collect();
        assert_eq!(spans, [(0, 2, 4), (0, 5, 6), (1, 0, 2), (1, 5, 7), (2, 0, 7)]);
    }

    #[test]
    fn the_policy_leaves_whole_gaps_open() {
        let t = take(&["##...#.#", "..######", "........"]);
        let all = gaps(&t);
        let decide = |policy: &Policy| all.iter().map(|g| policy.decide(g, &t, g.marker != 9)).collect::<Vec<_>>();
        assert_eq!(decide(&Policy::default()), [Ok(()), Ok(()), Err(Open::AtEnd), Err(Open::NeverSeen)]);
        assert_eq!(
            decide(&Policy { max_gap: Some(2), extrapolate: true, ..Policy::default() }),
            [Err(Open::TooLong), Ok(()), Ok(()), Err(Open::NeverSeen)]
        );
        assert_eq!(Policy::default().decide(&all[0], &t, false), Err(Open::NotAskedFor));
    }
}
