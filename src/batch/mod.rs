//! Many takes: planned, repaired each in a process of its own, and accounted for.
//!
//! - [`sources`], [`naming`], [`planning`]: which takes there are and what their outputs are called; [`plan`]: that as a file
//! - [`store`]: folders and buckets
//! - [`run`]: takes are handed out, tried again or put aside; [`engine`]: who runs them
//! - [`take`]: one take, from its input to its place; [`job`]: what is said to its process
//! - [`sidecar`]: what a finished take leaves beside its output; [`ledger`]: what was done when, append-only
//! - [`fleet`]: the report on all of them, one page and one table
//! - [`session`]: an output folder in use; [`memory`]: how much there is

pub mod engine;
pub mod fleet;
pub mod job;
pub mod ledger;
pub mod memory;
pub mod naming;
pub mod plan;
pub mod planning;
pub mod progress;
pub mod run;
pub mod session;
pub mod sidecar;
pub mod sources;
pub mod status;
pub mod store;
pub mod take;
pub mod told;
pub mod watch;

use crate::repair::RepairError;
use std::path::Path;
use store::{Kind, StoreError};

/// The folder below an output folder that holds everything about running, and no take.
pub const OWN_FOLDER: &str = ".mocap-repair";

/// Why a batch cannot go on.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{text}")]
pub struct BatchError {
    /// What was found, what was expected, where, the way out.
    pub text: String,
    /// The same command may work another time.
    pub again: bool,
}

impl BatchError {
    /// About a file or folder.
    pub fn at(path: &Path, problem: impl std::fmt::Display) -> Self {
        Self { text: format!("{}: {problem}", path.display()), again: false }
    }

    /// The system did not let something be done; a full disk may have room another time.
    pub fn io(path: &Path, problem: &str, error: &std::io::Error) -> Self {
        let text = format!("{}: {problem}: {}", path.display(), crate::input::plain(error));
        Self { text, again: crate::error::is_full(error.kind()) }
    }

    /// What may be otherwise another time.
    pub fn again(text: String) -> Self {
        Self { text, again: true }
    }
}

impl From<StoreError> for BatchError {
    fn from(error: StoreError) -> Self {
        Self { text: error.to_string(), again: matches!(error.kind, Kind::Again | Kind::Full) }
    }
}

impl From<RepairError> for BatchError {
    fn from(error: RepairError) -> Self {
        Self { text: error.to_string(), again: false }
    }
}
