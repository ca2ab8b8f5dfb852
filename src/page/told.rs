//! What the report tells, read back from its JSON lines: the repair in memory and the log of one hand the page the same words.

use serde::{Deserialize, Serialize};

/// Something assumed, odd or lost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Note {
    /// In words.
    pub text: String,
    /// True if somebody should look at it.
    pub matters: bool,
}

/// One gap. Where it is, the positions know better.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Gap {
    /// Number of frames.
    pub frames: u32,
    /// Why it stays open, as one word.
    pub open: Option<String>,
    /// Largest predicted error, mm.
    pub worst_sigma_mm: Option<f64>,
    /// Why it was filled as it was.
    #[serde(default)]
    pub explanation: Vec<Part>,
}

/// Why a stretch of a gap was filled as it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// First frame, the file's number.
    pub first_frame: i64,
    /// Last frame, the file's number.
    pub last_frame: i64,
    /// Predicted error, root mean square, mm.
    pub predicted_mm: f64,
    /// Number of simulated gaps that judged.
    pub simulated_gaps: u32,
    /// Their length in frames.
    pub simulated_frames: u32,
    /// Labels of the markers that experts looked at, best first.
    pub neighbours: Vec<String>,
    /// Experts, largest share first.
    pub experts: Vec<Share>,
}

/// An expert's part in a fill.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// What it is.
    pub expert: String,
    /// Its share of 1.
    pub share: f64,
    /// Its error on simulated gaps, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error_mm: Option<f64>,
}

/// Samples that no body makes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Suspect {
    /// `spike`, `swap`, ...
    pub kind: String,
    /// Column of the marker, counted from 0.
    pub column: usize,
    /// Column of the marker that it changed places with.
    pub with_column: Option<usize>,
    /// First frame, the file's number.
    pub first_frame: i64,
    /// Last frame, the file's number.
    pub last_frame: i64,
    /// How far it is off, mm.
    pub size_mm: f64,
    /// True if its samples were made gaps.
    pub dropped: bool,
    /// True if its samples were left as they are, but nothing was filled from them.
    pub ignored: bool,
    /// In words.
    pub text: String,
}

/// How one model of the method ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// The model.
    pub method: String,
    /// Why it stopped.
    pub stop: String,
    /// Rounds taken.
    pub iterations: u32,
}

/// How far bones are off in frames where one of their ends was filled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bones {
    /// Root mean square, mm.
    pub rms_mm: f64,
    /// The largest, mm.
    pub worst_mm: f64,
    /// Whose it is.
    pub worst_bone: String,
    /// Root mean square where both ends were measured, mm.
    pub measured_rms_mm: f64,
}

/// The whole.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Name of the input's format.
    pub format: String,
    /// Missing samples in all gaps.
    pub samples_missing: u64,
    /// Samples that were filled.
    pub samples_filled: u64,
    /// Gaps left open.
    pub gaps_left_open: u32,
    /// Models in order.
    pub stages: Vec<Stage>,
    /// Bones, if one was touched.
    pub bone_judgement: Option<Bones>,
}

/// Everything that was told.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// Notes, in order.
    pub notes: Vec<Note>,
    /// Gaps, marker by marker.
    pub gaps: Vec<Gap>,
    /// Spikes, swaps, and the like.
    pub suspects: Vec<Suspect>,
    /// The whole, if it was told.
    pub summary: Option<Summary>,
}

/// Reads the report's JSON lines. Kinds of message that the page does not show are passed over.
///
/// # Errors
/// The first line that is not as the report writes it, in words.
pub fn parse(lines: &str) -> Result<Told, String> {
    #[derive(Deserialize)]
    #[serde(tag = "message_type", rename_all = "snake_case")]
    #[allow(clippy::large_enum_variant)] // one at a time
    enum Message {
        Note(Note),
        Gap(Gap),
        Suspect(Suspect),
        Summary(Summary),
        #[serde(other)]
        Other,
    }
    let mut told = Told::default();
    for (at, line) in lines.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        match serde_json::from_str(line).map_err(|e| format!("line {}: {e}", at + 1))? {
            Message::Note(note) => told.notes.push(note),
            Message::Gap(gap) => told.gaps.push(gap),
            Message::Suspect(suspect) => told.suspects.push(suspect),
            Message::Summary(summary) => told.summary = Some(summary),
            Message::Other => {}
        }
    }
    Ok(told)
}
