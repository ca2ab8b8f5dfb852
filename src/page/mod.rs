//! The report to look at: one HTML file that needs nothing but a browser.
//!
//! [`Page`] is everything that it shows. It is made of a repair in memory ([`Page::of_repair`]) or of a log ([`Page::of_log`]);
//! both go through the numbers and words that the log holds, and give the same page. A body that was followed has one as well
//! ([`Page::of_track`], [`Page::of_fit`]).
//! [`Page::write`] makes the file.
//! What happens in the browser is in `src/page/web/`, with the libraries in `src/page/vendor/`; `docs/report.md` is for readers.

mod curves;
pub(crate) mod html;
mod of_body;
mod of_fit;
mod of_log;
mod of_repair;
mod of_track;
pub(crate) mod pack;
mod positions;
mod told;

pub use curves::{Curve, Curves, Iteration};
pub use of_body::{Event, Followed, Series, Tile};
pub use of_log::report_of_log;
pub use of_track::{ByPart, TrackFigure};
pub use positions::{Positions, State, Track};
pub use told::{Bones, Note, Part, Share, Stage, Summary};

use crate::log::Description;
use crate::staging;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;
use tempfile::NamedTempFile;

/// Of a gap's explanation, no more neighbours and experts than this are shown for each stretch: takes with ten thousand gaps exist.
const MOST_REASONS: usize = 4;

/// One gap.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Gap {
    /// Index into [`Page::markers`].
    pub marker: u32,
    /// First missing frame, counted from 0.
    pub start: u32,
    /// Number of missing frames.
    pub frames: u32,
    /// Why it stays open, as one word.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open: Option<String>,
    /// Largest predicted error, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_mm: Option<f64>,
    /// Why it was filled as it was.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub explanation: Vec<Part>,
}

/// Samples that no body makes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Suspect {
    /// `spike`, `swap`, ...
    pub kind: String,
    /// Index into [`Page::markers`].
    pub marker: u32,
    /// The marker it changed places with, if it did.
    pub other: Option<u32>,
    /// First frame, counted from 0.
    pub start: u32,
    /// Number of frames.
    pub frames: u32,
    /// How far it is off, mm.
    pub size_mm: f64,
    /// In words.
    pub text: String,
    /// True if the samples were taken for missing.
    pub dropped: bool,
    /// True if nothing was filled from the samples.
    pub ignored: bool,
}

/// Everything that is shown, wherever it comes from.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Page {
    /// Version of the program that repaired the take.
    pub version: String,
    /// Name of the file that was read, without folders.
    pub source_name: String,
    /// Its SHA-256 in hexadecimal digits.
    pub source_sha256: String,
    /// The method that was asked for.
    pub method: String,
    /// Seed of the random numbers.
    pub seed: String,
    /// Effective options by name.
    pub options: BTreeMap<String, String>,
    /// The take.
    pub take: Description,
    /// What was assumed, odd or lost.
    pub notes: Vec<Note>,
    /// Gaps, marker by marker.
    pub gaps: Vec<Gap>,
    /// Spikes, swaps, and the like.
    pub suspects: Vec<Suspect>,
    /// The whole in numbers.
    pub summary: Summary,
    /// The models that have a likelihood, with their iterations.
    pub curves: Vec<Curve>,
    /// Labels of the bones of [`curves`](Self::curves).
    pub curve_bones: Vec<String>,
    /// What there is to tell of a body that was followed, instead of gaps and of a solver.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub followed: Option<Followed>,
    /// The samples.
    #[serde(skip)]
    pub positions: Positions,
}

impl Page {
    /// The page as a file: HTML in UTF-8. Equal pages give equal bytes.
    pub fn write(&self) -> String {
        html::write(self)
    }

    /// The file in a hidden place beside its final name.
    ///
    /// # Errors
    /// The folder of `path` cannot be written to.
    pub fn stage(&self, path: &Path) -> io::Result<NamedTempFile> {
        let mut file = staging::beside(path)?;
        file.write_all(self.write().as_bytes())?;
        Ok(file)
    }

    /// Takes over what the report told. Its gaps are those of the positions, one by one and in the same order: labels may occur twice.
    fn tell(&mut self, told: told::Told) -> Result<(), String> {
        let gaps = self.positions.gaps();
        if gaps.len() != told.gaps.len() || gaps.iter().zip(&told.gaps).any(|(a, b)| a.frames != b.frames) {
            return Err(format!("the report tells of {} gaps, the take has {}", told.gaps.len(), gaps.len()));
        }
        self.gaps = gaps
            .into_iter()
            .zip(told.gaps)
            .map(|(found, mut told)| {
                for part in &mut told.explanation {
                    part.neighbours.truncate(MOST_REASONS);
                    part.experts.truncate(MOST_REASONS);
                }
                Gap { open: told.open, sigma_mm: told.worst_sigma_mm, explanation: told.explanation, ..found }
            })
            .collect();
        let markers = self.take.markers.len();
        let index = |column: usize| (column < markers).then_some(column as u32);
        let step = if self.take.frame_step == 0 { 1 } else { self.take.frame_step };
        let frame = |label: i64| (label.saturating_sub(self.take.first_frame) / step).clamp(0, self.take.frames as i64) as u32;
        let suspects = told.suspects.into_iter().filter_map(|s| {
            Some(Suspect {
                marker: index(s.column)?,
                other: s.with_column.and_then(index),
                start: frame(s.first_frame),
                frames: frame(s.last_frame).saturating_sub(frame(s.first_frame)) + 1,
                kind: s.kind,
                size_mm: s.size_mm,
                text: s.text,
                dropped: s.dropped,
                ignored: s.ignored,
            })
        });
        self.suspects = suspects.collect();
        self.notes = told.notes;
        self.summary = told.summary.unwrap_or_default();
        Ok(())
    }

    /// What there is to tell of a repair that came to nothing; `ended` is why.
    fn unfinished(&self, ended: &str) -> told::Told {
        let gaps = self.positions.gaps();
        let samples_missing = gaps.iter().map(|gap| u64::from(gap.frames)).sum();
        let summary = Summary { samples_missing, gaps_left_open: gaps.len() as u32, ..Summary::default() };
        let note = Note { text: format!("the repair was {ended}, no take was written"), matters: true };
        let gap = |gap: Gap| told::Gap { frames: gap.frames, open: Some(ended.to_owned()), ..told::Gap::default() };
        told::Told { notes: vec![note], gaps: gaps.into_iter().map(gap).collect(), suspects: Vec::new(), summary: Some(summary) }
    }
}
