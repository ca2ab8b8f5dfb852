//! What was done when, by whom: append-only records, one file for each attempt at a shard.
//!
//! A run that is killed leaves a torn last line, which is not read. Nothing is ever changed or removed.

use serde::{Deserialize, Serialize};

/// A line of a ledger.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message_type", rename_all = "snake_case")]
pub enum Record {
    /// An attempt began.
    Begun(Begun),
    /// A take was accounted for.
    Take(TakeRecord),
    /// The attempt ended in an orderly way.
    Ended(Ended),
}

/// The beginning of an attempt.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Begun {
    /// When, in UTC (RFC 3339).
    pub time: String,
    /// Where.
    pub host: String,
    /// Process.
    pub pid: u32,
    /// Version of the program.
    pub version: String,
    /// SHA-256 of the plan; absent for a folder that is watched.
    pub plan: Option<String>,
    /// Counted from 0.
    pub shard: u32,
    /// Number of shards.
    pub shards: u32,
    /// `local` or `ray`.
    pub engine: String,
    /// Takes that are worked on at a time.
    pub jobs: usize,
    /// Takes of the shard.
    pub takes: u64,
    /// Their size.
    pub bytes: u64,
}

/// What became of a take.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TakeRecord {
    /// When, in UTC (RFC 3339).
    pub time: String,
    /// Name of the take in its batch, with `/`.
    pub path: String,
    /// Name of its output, below the output folder, with `/`.
    pub output: String,
    /// See [`super::sidecar::key`]; absent if the input could not be read.
    pub key: Option<String>,
    /// What identifies input and options before the input is read.
    pub planned: Option<String>,
    /// What became of it.
    pub outcome: Outcome,
    /// The exit code of the last try.
    pub exit_code: Option<u8>,
    /// Why it is not done.
    pub reason: Option<String>,
    /// Every try that ran, the last one included.
    pub tries: Vec<Try>,
    /// All of them together.
    pub elapsed_secs: f64,
    /// The most memory that the last try took.
    pub peak_bytes: Option<u64>,
    /// Size of the input.
    pub bytes: u64,
}

/// What became of a take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Repaired; exit code 0, or 3 if there is something to look at.
    Done,
    /// It was done already: key and outputs are as they should be.
    Skipped,
    /// It cannot be repaired, or three more tries came to nothing; it is not tried again.
    Quarantined,
    /// Something around it kept it from being repaired; the next run tries again.
    Failed,
}

/// One try.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Try {
    /// How it ended.
    pub ended: How,
    /// Exit code.
    pub code: Option<i32>,
    /// Signal.
    pub signal: Option<i32>,
    /// Why.
    pub reason: Option<String>,
    /// How long it took.
    pub elapsed_secs: f64,
}

/// How a try ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum How {
    /// By itself.
    Exit,
    /// By a signal.
    Signal,
    /// It took too long and was ended.
    Timeout,
    /// It wanted more memory than there is.
    Memory,
    /// Whoever ran it is gone.
    Lost,
}

/// The orderly end of an attempt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ended {
    /// When, in UTC (RFC 3339).
    pub time: String,
    /// Why.
    pub stop: Stop,
    /// Takes by what became of them.
    pub done: u64,
    /// Of these, takes with something to look at.
    pub remarked: u64,
    /// See [`Outcome::Skipped`].
    pub skipped: u64,
    /// See [`Outcome::Quarantined`].
    pub quarantined: u64,
    /// See [`Outcome::Failed`].
    pub failed: u64,
}

/// Why an attempt ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// There is nothing more to do.
    Complete,
    /// Somebody stopped it.
    Interrupted,
    /// There is no room for outputs.
    DiskFull,
    /// Too many of the first takes failed.
    TooManyFailures,
    /// The engine is gone.
    Engine,
}
