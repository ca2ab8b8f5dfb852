//! What a finished take leaves beside its output: what went in, what came out, and what is to be told.
//!
//! A sidecar says nothing about when, where or by whom it was made, so that the same take gives the same bytes whoever ran it.
//! It is put in place before the outputs are: a run that ends in between leaves a sidecar whose hashes fit nothing, and the take is done again.

use crate::report::Report;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// What is added to the name of an output.
pub const EXTENSION: &str = "repair.json";

/// The largest sidecar that is read, in bytes: thousands of markers and notes.
pub const LARGEST: u64 = 64 << 20;

/// A finished take.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message_type", rename = "sidecar")]
pub struct Sidecar {
    /// Version of the program.
    pub version: String,
    /// See [`key`].
    pub key: String,
    /// Name of the take in its batch, with `/`.
    pub path: String,
    /// The file that was read.
    pub input: InputFile,
    /// SHA-256 of the options.
    pub config_sha256: String,
    /// The files that were written, the take itself first.
    pub outputs: Vec<OutputFile>,
    /// 0 or 3.
    pub exit_code: u8,
    /// What was done.
    pub summary: Summary,
    /// Every marker of the take, in the order of its columns.
    pub markers: Vec<MarkerSummary>,
    /// What was assumed, odd or lost.
    pub notes: Vec<NoteSaid>,
    /// SHA-256 of the line as it would be without this: a sidecar that was damaged is none. The last field, so that others can be added before it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub sidecar_sha256: String,
}

/// A file that was read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputFile {
    /// Name without folder.
    pub name: String,
    /// Where it lay, as the plan says it.
    #[serde(default)]
    pub source: String,
    /// Size.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
    /// What the bucket it lies in calls this version of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
}

/// A file that was written, beside the sidecar.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputFile {
    /// Name without folder.
    pub name: String,
    /// Size.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

/// What was done to a take.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Name of the input's format.
    pub format: String,
    /// Frames per second.
    pub rate_hz: f64,
    /// Number of frames.
    pub frames: usize,
    /// Number of markers.
    pub markers: usize,
    /// Number of bones.
    pub bones: usize,
    /// How gaps were filled.
    pub method: String,
    /// Number of stretches that no body makes.
    pub suspects: usize,
    /// Number of gaps.
    pub gaps: usize,
    /// Number of gaps that stayed open.
    pub gaps_left_open: usize,
    /// Markers times frames.
    pub samples: u64,
    /// Samples that were missing.
    pub samples_missing: u64,
    /// Samples that were filled.
    pub samples_filled: u64,
    /// The longest gap, in frames.
    pub longest_gap: usize,
    /// The largest predicted standard deviation of a filled sample, mm.
    pub worst_sigma_mm: Option<f64>,
    /// How far the worst bone is off in filled frames, mm.
    pub bone_worst_mm: Option<f64>,
    /// Root mean square of that over all bones, mm.
    pub bone_rms_mm: Option<f64>,
    /// The worst bone.
    pub worst_bone: Option<String>,
}

/// What was missing of one marker.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MarkerSummary {
    /// As the file has it.
    pub label: String,
    /// Samples that were missing.
    pub missing: u64,
    /// Number of gaps.
    pub gaps: usize,
    /// The longest gap, in frames.
    pub longest: usize,
    /// Samples that were filled.
    pub filled: u64,
    /// The largest predicted standard deviation of a filled sample, mm.
    pub worst_sigma_mm: Option<f64>,
}

/// A note as it was told.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NoteSaid {
    /// What it is about, for scripts.
    pub kind: String,
    /// For people.
    pub text: String,
    /// It reached the exit code.
    pub matters: bool,
}

/// What makes a take what it is: its input, the options, and the program. Two takes of one key have the same output.
pub fn key(input_sha256: &str, config_sha256: &str, version: &str) -> String {
    hash(&format!("{input_sha256}\n{config_sha256}\n{version}\n"))
}

impl Sidecar {
    /// As it is written: one line, with its own hash.
    pub fn text(&self) -> String {
        let bare = crate::report::lines(&[Self { sidecar_sha256: String::new(), ..self.clone() }]);
        let bare = bare.trim_end();
        let open = bare.strip_suffix('}').unwrap_or(bare);
        format!("{open}{OWN}{}\"}}\n", hash(bare))
    }

    /// Reads what [`Self::text`] wrote, be it of another version; `None` if it is anything else.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let line = std::str::from_utf8(bytes).ok()?.trim_end();
        let (open, own) = line.rsplit_once(OWN)?;
        if own.strip_suffix("\"}")? != hash(&format!("{open}}}")) {
            return None;
        }
        serde_json::from_str(line).ok()
    }
}

/// How the last field begins.
const OWN: &str = ",\"sidecar_sha256\":\"";

fn hash(text: &str) -> String {
    crate::input::hex(&Sha256::digest(text))
}

impl Summary {
    /// From what a repair reports.
    pub fn new(report: &Report) -> Self {
        let judged = report.bone_judgement.as_ref();
        Self {
            format: report.format.to_owned(),
            rate_hz: report.rate_hz,
            frames: report.frames,
            markers: report.markers,
            bones: report.bones,
            method: report.method.to_owned(),
            suspects: report.suspects.len(),
            gaps: report.gaps.len(),
            gaps_left_open: report.gaps.iter().filter(|gap| gap.open.is_some()).count(),
            samples: (report.frames * report.markers) as u64,
            samples_missing: report.missing_samples() as u64,
            samples_filled: report.samples.len() as u64,
            longest_gap: report.gaps.iter().map(|gap| gap.frames).max().unwrap_or(0),
            worst_sigma_mm: report.gaps.iter().filter_map(|gap| gap.worst_sigma_mm).reduce(f64::max),
            bone_worst_mm: judged.map(|judged| judged.worst_mm),
            bone_rms_mm: judged.map(|judged| judged.rms_mm),
            worst_bone: judged.map(|judged| judged.worst_bone.clone()),
        }
    }
}

impl MarkerSummary {
    /// One for every marker of a take, from what its repair reports.
    pub fn all(report: &Report) -> Vec<Self> {
        let mut all: Vec<Self> = report.labels.iter().map(|(_, label)| Self { label: label.clone(), ..Self::default() }).collect();
        for gap in &report.gaps {
            let Ok(at) = report.labels.binary_search_by_key(&gap.column, |(column, _)| *column) else { continue };
            let Some(marker) = all.get_mut(at) else { continue };
            marker.missing += gap.frames as u64;
            marker.gaps += 1;
            marker.longest = marker.longest.max(gap.frames);
            marker.filled += if gap.open.is_none() { gap.frames as u64 } else { 0 };
            marker.worst_sigma_mm = [marker.worst_sigma_mm, gap.worst_sigma_mm].into_iter().flatten().reduce(f64::max);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn sidecar() -> Sidecar {
        Sidecar {
            version: "1".to_owned(),
            key: key("a", "b", "1"),
            path: "A/walk \"}.c3d".to_owned(),
            input: InputFile { name: "walk".to_owned(), source: "/in/walk".to_owned(), bytes: 3, sha256: "a".to_owned(), version: None },
            config_sha256: "b".to_owned(),
            outputs: Vec::new(),
            exit_code: 3,
            summary: Summary { worst_sigma_mm: Some(0.1 + 0.2), ..Summary::default() },
            markers: vec![MarkerSummary { label: "ü".to_owned(), ..MarkerSummary::default() }],
            notes: Vec::new(),
            sidecar_sha256: String::new(),
        }
    }

    #[test]
    fn what_is_written_comes_back_and_damage_does_not() {
        let text = sidecar().text();
        let back = Sidecar::parse(text.as_bytes()).unwrap();
        assert_eq!(Sidecar { sidecar_sha256: String::new(), ..back.clone() }, sidecar());
        assert_eq!(back.text(), text);
        for at in 0..text.trim_end().len() {
            let mut bytes = text.clone().into_bytes();
            bytes[at] ^= 1;
            assert_eq!(Sidecar::parse(&bytes), None, "byte {at}");
            assert_eq!(Sidecar::parse(&text.as_bytes()[..at]), None, "cut at {at}");
        }
    }

    #[test]
    fn those_of_other_versions_are_read() {
        let text = sidecar().text();
        let (open, _) = text.rsplit_once(OWN).unwrap();
        let later = format!("{open},\"of_later\":1}}");
        let line = format!("{}{OWN}{}\"}}", later.trim_end_matches('}'), hash(&later));
        assert!(Sidecar::parse(line.as_bytes()).is_some());
    }
}
