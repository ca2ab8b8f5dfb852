//! What a repair did, for scripts: one JSON document per line.

use super::{BoneJudgement, GapReport, Report, StageReport};
use serde::Serialize;
use std::path::PathBuf;

impl Report {
    /// The report as JSON lines: notes, gaps, then the summary.
    pub fn json(&self) -> String {
        #[derive(Serialize)]
        #[serde(tag = "message_type", rename_all = "snake_case")]
        #[allow(clippy::large_enum_variant)] // a handful, written and forgotten
        enum Message<'a> {
            Note {
                kind: &'a str,
                text: String,
                matters: bool,
            },
            Gap(&'a GapReport),
            Summary {
                input: String,
                output: Option<String>,
                log: Option<String>,
                log_error: Option<&'a str>,
                fills: Option<String>,
                dry_run: bool,
                format: &'a str,
                rate_hz: f64,
                frames: usize,
                markers: usize,
                bones: usize,
                method: &'a str,
                stages: &'a [StageReport],
                gaps: usize,
                gaps_left_open: usize,
                samples_missing: usize,
                samples_filled: usize,
                longest_gap: usize,
                worst_sigma_mm: Option<f64>,
                bone_judgement: Option<&'a BoneJudgement>,
                exit_code: u8,
            },
        }
        let path = |p: &Option<PathBuf>| p.as_ref().map(|p| p.display().to_string());
        let mut messages: Vec<Message> =
            self.notes.iter().map(|n| Message::Note { kind: n.kind(), text: n.to_string(), matters: n.matters() }).collect();
        messages.extend(self.gaps.iter().map(Message::Gap));
        messages.push(Message::Summary {
            input: self.input.display().to_string(),
            output: path(&self.output),
            log: path(&self.log),
            log_error: self.log_error.as_deref(),
            fills: path(&self.fills),
            dry_run: self.dry_run,
            format: self.format,
            rate_hz: self.rate_hz,
            frames: self.frames,
            markers: self.markers,
            bones: self.bones,
            method: self.method,
            stages: &self.stages,
            gaps: self.gaps.len(),
            gaps_left_open: self.open_gaps().count(),
            samples_missing: self.missing_samples(),
            samples_filled: self.samples.len(),
            longest_gap: self.gaps.iter().map(|g| g.frames).max().unwrap_or(0),
            worst_sigma_mm: self.gaps.iter().filter_map(|g| g.worst_sigma_mm).reduce(f64::max),
            bone_judgement: self.bone_judgement.as_ref(),
            exit_code: self.exit_code(),
        });
        lines(&messages)
    }
}

/// One JSON document per line.
pub fn lines<T: Serialize>(messages: &[T]) -> String {
    let mut out = String::new();
    for message in messages {
        // plain structs of numbers and strings always serialise
        if let Ok(text) = serde_json::to_string(message) {
            out.push_str(&text);
            out.push('\n');
        }
    }
    out
}
