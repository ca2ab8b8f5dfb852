//! What a repair did, for scripts: one JSON document per line.

use super::{BoneJudgement, GapReport, Report, StageReport};
use crate::repair::Request;
use crate::suspects::SuspectReport;
use serde::Serialize;
use std::path::Path;

impl Report {
    /// The report as JSON lines: notes, suspects, gaps, then the summary.
    pub fn json(&self) -> String {
        let written = [&self.output, &self.log, &self.fills, &self.page].map(|path| path.as_deref());
        self.json_of(written, |path| path.display().to_string())
    }

    /// The same for the log of the repair, which is written when only the names of files are missing.
    /// Folders are left out: a log must not depend on where it lies.
    pub fn json_for_log(&self, request: &Request) -> String {
        let name = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        self.json_of([Some(&request.output), request.log.as_deref(), self.fills.as_deref(), self.page.as_deref()], name)
    }

    /// `written`: the take, the log, the table and the report to look at. `name` says how a file is called.
    fn json_of(&self, written: [Option<&Path>; 4], name: impl Fn(&Path) -> String) -> String {
        #[derive(Serialize)]
        #[serde(tag = "message_type", rename_all = "snake_case")]
        #[allow(clippy::large_enum_variant)] // a handful, written and forgotten
        enum Message<'a> {
            Note {
                kind: &'a str,
                text: String,
                matters: bool,
            },
            Suspect(&'a SuspectReport),
            Gap(&'a GapReport),
            Summary {
                input: String,
                output: Option<String>,
                log: Option<String>,
                log_error: Option<&'a str>,
                fills: Option<String>,
                #[serde(skip_serializing_if = "Option::is_none")]
                report: Option<String>,
                dry_run: bool,
                format: &'a str,
                rate_hz: f64,
                frames: usize,
                markers: usize,
                bones: usize,
                method: &'a str,
                stages: &'a [StageReport],
                suspects: usize,
                samples_suspect: usize,
                samples_dropped: usize,
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
        let [output, log, fills, report] = written.map(|path| path.map(&name));
        let mut messages: Vec<Message> =
            self.notes.iter().map(|n| Message::Note { kind: n.kind(), text: n.to_string(), matters: n.matters() }).collect();
        messages.extend(self.suspects.iter().map(Message::Suspect));
        messages.extend(self.gaps.iter().map(Message::Gap));
        messages.push(Message::Summary {
            input: name(&self.input),
            output,
            log,
            log_error: self.log_error.as_deref(),
            fills,
            report,
            dry_run: self.dry_run,
            format: self.format,
            rate_hz: self.rate_hz,
            frames: self.frames,
            markers: self.markers,
            bones: self.bones,
            method: self.method,
            stages: &self.stages,
            suspects: self.suspects.len(),
            samples_suspect: self.suspects.iter().map(|s| s.samples).sum(),
            samples_dropped: self.suspects.iter().filter(|s| s.dropped).map(|s| s.samples).sum(),
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
