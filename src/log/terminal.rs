//! A progress line on the terminal, for somebody who waits. Written to standard error, gone when the work is done.

use crate::solve::{Observer, Outcome, Start, Step};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::Path;

/// Shows the stage at hand: iteration, likelihood, how far things still move.
pub struct Terminal {
    name: String,
    bar: Option<ProgressBar>,
}

impl Terminal {
    /// For the repair of this take.
    pub fn new(input: &Path) -> Self {
        Self { name: input.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(), bar: None }
    }
}

impl Observer for Terminal {
    fn started(&mut self, start: &Start<'_>) {
        let bar = ProgressBar::new(u64::from(start.step_limit));
        if let Ok(style) = ProgressStyle::with_template("{prefix} {bar:20} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        bar.set_prefix(format!("{} {}", self.name, start.method));
        self.bar = Some(bar);
    }

    fn stepped(&mut self, step: &Step<'_>) {
        if let Some(bar) = &self.bar {
            if let Some(log_likelihood) = step.progress.log_likelihood {
                bar.set_message(format!("log-likelihood {log_likelihood:.0}, moved {:.2} mm", step.progress.largest_move_mm));
            }
            bar.inc(1);
        }
    }

    fn stopped(&mut self, _outcome: &Outcome) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}
