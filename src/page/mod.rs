//! The report to look at: one HTML file that needs nothing but a browser.
//!
//! [`Page`] is everything that it shows. It is made of a repair in memory ([`Page::of_repair`]) or of a log ([`Page::of_log`]);
//! both go through the numbers and words that the log holds, and give the same page. [`Page::write`] makes the file.
//! What happens in the browser is in `src/page/web/`, with the libraries in `src/page/vendor/`; `docs/report.md` is for readers.

mod curves;
mod html;
mod of_repair;
mod pack;
mod positions;
mod told;

pub use curves::{Curve, Curves, Iteration};
pub use of_repair::Repaired;
pub use positions::{Positions, Sample, State};
pub use told::{Bones, Note, Part, Share, Stage, Summary};

use serde::Serialize;
use std::collections::BTreeMap;

/// Of a gap's explanation, no more neighbours and experts than this are shown for each stretch: takes with ten thousand gaps exist.
const MOST_REASONS: usize = 4;

/// Two markers of constant distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bone {
    /// One end, as an index into [`Page::markers`].
    pub a: u32,
    /// The other end.
    pub b: u32,
    /// Expected length, mm.
    pub length_mm: f64,
    /// Its standard deviation where both ends were measured, mm.
    pub spread_mm: f64,
}

/// One gap.
#[derive(Clone, Debug, PartialEq, Serialize)]
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
    pub size_mm: Option<f64>,
    /// In words.
    pub text: String,
    /// True if the samples were taken for missing.
    pub dropped: bool,
}

/// What the page says about the take.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Take {
    /// Frames per second.
    pub rate_hz: f64,
    /// Number of frames.
    pub frames: u32,
    /// The file's own number of frame 0.
    pub first_frame: i64,
    /// By how much the file's own numbers go up from frame to frame.
    pub frame_step: i64,
    /// The unit that the file is written in.
    pub unit: String,
    /// The axis that points up, such as `+z`, if the file says so.
    pub up: Option<String>,
    /// Labels of the markers; model outputs are not among them.
    pub markers: Vec<String>,
    /// Pairs of constant distance.
    pub bones: Vec<Bone>,
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
    pub take: Take,
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
    /// The samples.
    #[serde(skip)]
    pub positions: Positions,
}

impl Page {
    /// The page as a file: HTML in UTF-8. Equal pages give equal bytes.
    pub fn write(&self) -> String {
        html::write(self)
    }

    /// Takes over what the report told. Gaps come marker by marker, so that a label which occurs twice leads to the right column.
    fn tell(&mut self, told: told::Told) {
        let mut at = (0, i64::MIN);
        for gap in told.gaps {
            let markers = &self.take.markers;
            let fits = |m: usize| markers.get(m).is_some_and(|label| *label == gap.marker);
            let from = if gap.first_frame > at.1 { at.0 } else { at.0 + 1 };
            let Some(marker) = (from..markers.len()).find(|&m| fits(m)) else { continue };
            at = (marker, gap.last_frame);
            let step = if self.take.frame_step == 0 { 1 } else { self.take.frame_step };
            let start = gap.first_frame.saturating_sub(self.take.first_frame) / step;
            let explanation = gap.explanation.into_iter().map(|mut part| {
                part.neighbours.truncate(MOST_REASONS);
                part.experts.truncate(MOST_REASONS);
                part
            });
            self.gaps.push(Gap {
                marker: marker as u32,
                start: u32::try_from(start).unwrap_or(0),
                frames: gap.frames,
                open: gap.open,
                sigma_mm: gap.worst_sigma_mm,
                explanation: explanation.collect(),
            });
        }
        self.notes = told.notes;
        self.summary = told.summary.unwrap_or_default();
    }
}
