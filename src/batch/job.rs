//! What is said to the process that repairs one take, and what it answers: JSON Lines on its standard input and output.

use super::plan::{OptionFile, PlannedTake, Wanted};
use super::sidecar::Summary;
use serde::{Deserialize, Serialize};

/// One take to repair: the first line on standard input. When standard input ends, the process ends at once.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "message_type", rename = "job")]
pub struct Job {
    /// The take.
    pub take: PlannedTake,
    /// The output folder or bucket.
    pub out: String,
    /// Below that, the folder for files that have not got their names yet.
    pub work: String,
    /// The options, as TOML.
    pub config: String,
    /// SHA-256 of the options.
    pub config_sha256: String,
    /// The files that options name.
    #[serde(default)]
    pub files: Vec<OptionFile>,
    /// What is written beside the repaired take.
    pub wanted: Wanted,
    /// Cores to use.
    pub threads: usize,
    /// The most memory to take.
    pub memory_bytes: Option<u64>,
    /// Replace outputs that are there and do not come from a batch.
    pub force: bool,
}

/// What the process says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message_type", rename_all = "snake_case")]
#[allow(clippy::large_enum_variant)] // one at a time, read and forgotten
pub enum Said {
    /// What it is doing.
    Phase {
        /// For people.
        text: String,
    },
    /// The last line.
    Result(TakeResult),
}

/// What became of a take.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TakeResult {
    /// What became of it.
    pub outcome: Verdict,
    /// Why it is not done.
    #[serde(default)]
    pub reason: Option<String>,
    /// What its output deserves: 0 or 3.
    #[serde(default)]
    pub exit_code: Option<u8>,
    /// The key of its output; absent if the input could not be read.
    #[serde(default)]
    pub key: Option<String>,
    /// The most memory that was taken.
    #[serde(default)]
    pub peak_bytes: Option<u64>,
    /// What was done.
    #[serde(default)]
    pub summary: Option<Summary>,
}

/// What became of a take, as its process sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It is repaired; exit code 0 or 3.
    Done,
    /// It was done already; exit code 0.
    Skipped,
    /// The input is bad, and will be next time; exit code 65.
    BadInput,
    /// Next time it may work; exit code 75.
    Again,
    /// It took more memory than it may; exit code 75.
    OutOfMemory,
    /// There is no room for the output; exit code 75.
    DiskFull,
    /// Somebody has to do something about it first; exit code 1.
    Failed,
}

impl TakeResult {
    /// Nothing came of it.
    pub fn refused(outcome: Verdict, reason: String) -> Self {
        Self { outcome, reason: Some(reason), exit_code: None, key: None, peak_bytes: None, summary: None }
    }
}

impl Verdict {
    /// The exit code of the process.
    pub fn exit_code(self, of_output: Option<u8>) -> u8 {
        match self {
            Self::Done => of_output.unwrap_or(0),
            Self::Skipped => 0,
            Self::BadInput => 65,
            Self::Again | Self::OutOfMemory | Self::DiskFull => 75,
            Self::Failed => 1,
        }
    }
}
