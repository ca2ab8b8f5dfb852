//! Who runs the process that repairs a take: this machine, or Ray.
//!
//! [`Engine::run`] blocks; as many threads call it at once as the engine has slots.

pub mod local;
pub mod ray;

use super::BatchError;
use super::job::{Job, TakeResult};
use super::ledger::How;
use std::process::Command;
use std::time::Duration;

/// How one try at a take ended.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// How.
    pub ended: How,
    /// Exit code.
    pub code: Option<i32>,
    /// Signal.
    pub signal: Option<i32>,
    /// What the process said at its end, if it said something.
    pub result: Option<TakeResult>,
    /// The end of what it wrote to standard error, or why it is lost.
    pub told: String,
    /// How long it took.
    pub elapsed: Duration,
}

/// What one try may take.
#[derive(Clone, Copy, Debug)]
pub struct Allowed {
    /// Longer tries are ended.
    pub timeout: Option<Duration>,
    /// How much memory it is thought to take, bytes.
    pub memory_bytes: u64,
    /// Nothing else is to run at the same time.
    pub alone: bool,
}

/// Something that runs takes.
pub trait Engine: Sync {
    /// `local`, `ray`.
    fn name(&self) -> &'static str;

    /// How many takes run at once.
    fn slots(&self) -> usize;

    /// Runs one take to its end. `say`: what it is doing.
    ///
    /// # Errors
    /// The engine itself is gone, so that no take can be run any more.
    fn run(&self, job: Job, allowed: Allowed, say: &(dyn Fn(&str) + Sync)) -> Result<Attempt, BatchError>;

    /// Takes that wait are not begun any more; those that run go on.
    fn wind_down(&self) {}

    /// Ends everything that runs, as soon as can be.
    fn abandon(&self);

    /// Nothing more is handed out, so that those that run may use all cores.
    fn last_ones(&self, _running: usize) {}
}

/// An interrupt from the terminal is for whoever hands out takes, and not for what it starts.
fn set_apart(command: &mut Command) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    #[cfg(not(unix))]
    let _ = command;
}
