//! What is in a take: for people and scripts that want to know before they repair.

mod map;
mod text;

use crate::bones;
use crate::gaps::gaps;
use crate::input::Opened;
use crate::repair::neighbours;
use crate::report::lines;
use crate::solve::Gap;
use crate::suspects::{self, SuspectReport, Treatment};
use formats::{Note, Origin};
use serde::Serialize;
use std::path::Path;

/// What is in one file.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "message_type", rename = "inspect")]
pub struct Inspection {
    file: String,
    format: &'static str,
    frames: usize,
    first_frame: i64,
    rate_hz: f64,
    duration_s: f64,
    unit: &'static str,
    up: Option<String>,
    markers: Vec<MarkerLine>,
    model_outputs: usize,
    samples_missing: usize,
    samples_derived: usize,
    suspects: Vec<SuspectReport>,
    gaps: Vec<GapLine>,
    bones: Vec<BoneLine>,
    notes: Vec<NoteLine>,
}

#[derive(Clone, Debug, Serialize)]
struct MarkerLine {
    label: String,
    missing: usize,
    gaps: usize,
    longest_gap: usize,
}

#[derive(Clone, Debug, Serialize)]
struct GapLine {
    marker: String,
    first_frame: i64,
    last_frame: i64,
    frames: usize,
    /// Place of the marker among the markers.
    #[serde(skip)]
    at: usize,
}

#[derive(Clone, Debug, Serialize)]
struct BoneLine {
    a: String,
    b: String,
    length_mm: f64,
    spread_mm: f64,
}

#[derive(Clone, Debug, Serialize)]
struct NoteLine {
    kind: &'static str,
    text: String,
    matters: bool,
}

impl Inspection {
    /// Looks at an opened file.
    pub fn new(path: &Path, opened: &Opened) -> Self {
        let take = opened.document.take();
        let include = neighbours(take);
        let found = gaps(take);
        let bones = bones::find(take, &include);
        let mut markers: Vec<(usize, MarkerLine)> = (0..take.markers.len())
            .filter(|&m| include[m])
            .map(|m| (m, MarkerLine { label: take.display_label(m), missing: 0, gaps: 0, longest_gap: 0 }))
            .collect();
        for gap in &found {
            if let Ok(at) = markers.binary_search_by_key(&gap.marker, |(m, _)| *m) {
                let line = &mut markers[at].1;
                line.missing += gap.frames();
                line.gaps += 1;
                line.longest_gap = line.longest_gap.max(gap.frames());
            }
        }
        let derived = (0..take.frames())
            .map(|f| (0..take.markers.len()).filter(|&m| include[m] && take.origin(f, m) == Origin::Derived).count())
            .sum();
        Self {
            file: path.display().to_string(),
            format: opened.format.info().name,
            frames: take.frames(),
            first_frame: take.first_frame,
            rate_hz: take.rate_hz,
            duration_s: take.duration_secs(),
            unit: take.unit.symbol(),
            up: take.up.map(|d| d.to_string()),
            model_outputs: include.iter().filter(|&&i| !i).count(),
            samples_missing: found.iter().map(Gap::frames).sum(),
            samples_derived: derived,
            gaps: found
                .iter()
                .map(|g| GapLine {
                    at: markers.partition_point(|(m, _)| *m < g.marker),
                    marker: take.display_label(g.marker),
                    first_frame: take.frame_label(g.start),
                    last_frame: take.frame_label(g.end - 1),
                    frames: g.frames(),
                })
                .collect(),
            suspects: SuspectReport::all(&suspects::find(take, &bones), take, Treatment::Told),
            bones: bones
                .iter()
                .map(|b| BoneLine {
                    a: take.display_label(b.a),
                    b: take.display_label(b.b),
                    length_mm: (b.length_mm * 100.0).round() / 100.0,
                    spread_mm: (b.spread_mm * 100.0).round() / 100.0,
                })
                .collect(),
            notes: opened
                .notes
                .take()
                .iter()
                .map(|n: &Note| NoteLine { kind: n.kind(), text: n.to_string(), matters: n.matters() })
                .collect(),
            markers: markers.into_iter().map(|(_, line)| line).collect(),
        }
    }

    /// As one JSON line.
    pub fn json(&self) -> String {
        lines(std::slice::from_ref(self))
    }
}
