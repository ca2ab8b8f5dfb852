//! Suspects as they are told: to people in sentences, to scripts in lines.

use super::{Kind, Suspect, Treatment};
use crate::report::count;
use formats::Take;
use serde::Serialize;

/// So many of a kind are named in a summary.
const NAMED: usize = 3;

/// One suspect by the file's own names and numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SuspectReport {
    /// `spike`, `excursion`, `jump`, `ghost` or `swap`; see [`Kind`].
    pub kind: &'static str,
    /// Label of the marker.
    pub marker: String,
    /// Label of the marker that it changed places with; of swaps only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub with: Option<String>,
    /// Column of the marker, counted from 0: labels may occur twice.
    pub column: usize,
    /// Column of the one that it changed places with; of swaps only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub with_column: Option<usize>,
    /// First frame, the file's number.
    pub first_frame: i64,
    /// Last frame, the file's number.
    pub last_frame: i64,
    /// Number of samples, those that are missing in between not counted.
    pub samples: usize,
    /// The farthest that it is off the path, mm; of a swap, how far the two are apart.
    pub size_mm: f64,
    /// True if its samples were made gaps.
    pub dropped: bool,
    /// True if its samples were left as they are, but nothing was filled from them.
    pub ignored: bool,
    /// All this in a sentence.
    pub text: String,
    /// First frame, from 0.
    #[serde(skip)]
    pub(crate) start: usize,
    /// For counting: both sides of a swap are one.
    #[serde(skip)]
    counts: bool,
}

impl SuspectReport {
    /// One report per suspect. `take` is the one that they were found in.
    pub fn all(suspects: &[Suspect], take: &Take, treatment: Treatment) -> Vec<Self> {
        let tell = |s: &Suspect| Self {
            kind: s.kind.word(),
            marker: take.display_label(s.marker),
            with: s.with.map(|with| take.display_label(with)),
            column: s.marker,
            with_column: s.with,
            first_frame: take.frame_label(s.start),
            last_frame: take.frame_label(s.end.saturating_sub(1)),
            samples: s.samples(take).count(),
            size_mm: (s.size_mm * 10.0).round() / 10.0,
            dropped: treatment == Treatment::Dropped,
            ignored: treatment == Treatment::Ignored,
            text: s.sentence(take),
            start: s.start,
            counts: s.with.is_none_or(|with| s.marker < with),
        };
        suspects.iter().map(tell).collect()
    }

    /// `LKNE/RKNE, 812 to 860`
    fn name(&self) -> String {
        let with = self.with.as_ref().map_or_else(String::new, |with| format!("/{with}"));
        format!("{}{with}, {}", self.marker, frames(self.first_frame, self.last_frame))
    }
}

impl Suspect {
    /// What is wrong, in a sentence without a full stop: `LKNE is up to 84 mm off its path and comes back, frames 812 to 815`.
    pub fn sentence(&self, take: &Take) -> String {
        let name = take.display_label(self.marker);
        let (first, last) = (take.frame_label(self.start), take.frame_label(self.end.saturating_sub(1)));
        let when = format!("{} {}", if first == last { "frame" } else { "frames" }, frames(first, last));
        let mm = format!("{:.0} mm", self.size_mm);
        match (self.kind, self.with) {
            (Kind::Swap, Some(with)) => {
                format!("{name} has changed places with {}, {mm} away, {when}", take.display_label(with))
            }
            (Kind::Jump, _) => format!("{name} is up to {mm} off where its neighbours expect it, {when}"),
            (Kind::Ghost, _) => format!("{name} is up to {mm} off its path beside a gap, {when}"),
            (Kind::Excursion | Kind::Spike | Kind::Swap, _) => format!("{name} is up to {mm} off its path and comes back, {when}"),
        }
    }
}

fn frames(first: i64, last: i64) -> String {
    if first == last { first.to_string() } else { format!("{first} to {last}") }
}

/// Suspects in a few words, a line for each kind, the largest by name: `1 swap (LKNE/RKNE, 812 to 860)`.
pub fn summary(suspects: &[SuspectReport]) -> Vec<String> {
    let of_kind = |kind: Kind| {
        let mut own: Vec<&SuspectReport> = suspects.iter().filter(|s| s.kind == kind.word() && s.counts).collect();
        own.sort_by(|a, b| b.size_mm.total_cmp(&a.size_mm)); // stable
        let mut names: Vec<String> = own.iter().take(NAMED).map(|s| s.name()).collect();
        if own.len() > NAMED {
            names.push("...".to_owned());
        }
        (!own.is_empty()).then(|| format!("{} ({})", count(own.len(), kind.word()), names.join("; ")))
    };
    Kind::ALL.into_iter().filter_map(of_kind).collect()
}

/// Suspects for people: what stands before each line, and the line.
pub fn text(suspects: &[SuspectReport], dry_run: bool) -> Vec<(&'static str, String)> {
    if suspects.is_empty() {
        return Vec::new();
    }
    if suspects.iter().any(|s| s.dropped) {
        // never silently: one by one
        let head = |at: usize| {
            if at > 0 {
                ""
            } else if dry_run {
                "would drop"
            } else {
                "dropped"
            }
        };
        return suspects.iter().enumerate().map(|(at, s)| (head(at), s.text.clone())).collect();
    }
    let mut lines: Vec<(&str, String)> = summary(suspects).into_iter().map(|line| ("", line)).collect();
    if let Some(first) = lines.first_mut() {
        first.0 = "suspect";
    }
    let way = if suspects.iter().any(|s| s.ignored) {
        "nothing was filled from them; --drop-outliers makes them gaps"
    } else {
        "look at them, fill without them (--ignore-outliers), or make them gaps (--drop-outliers)"
    };
    lines.push(("", way.to_owned()));
    lines
}
