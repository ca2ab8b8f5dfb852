//! The report on a whole batch: one page and one table.
//!
//! [`collect`] reads what a batch left: plans, ledgers and sidecars. [`write()`] goes through it once, take by take, and keeps of each take
//! a few numbers; the page shows them as they are, and what it adds up it adds up in the browser. Only what there is of single markers is
//! added up here (`markers.rs`). What happens in the browser is in `web/`; `docs/batch-report.md` is for readers.

pub mod collect;
mod ledgers;
mod link;
mod markers;
mod page;
mod sheet;
mod takes;

pub use collect::{Collected, Plans, collect};

use super::BatchError;
use super::ledger::Outcome;
use super::sidecar::Sidecar;
use crate::staging::{self, Placed};
use serde::Serialize;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// What there is to tell of a take.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FleetRow {
    /// Its name in the batch, with `/`.
    pub path: String,
    /// The name of its output below the output folder, with `/`.
    pub output: String,
    /// What became of it; `None` if it is not yet done.
    pub outcome: Option<Outcome>,
    /// Exit code of the last try.
    pub exit_code: Option<u8>,
    /// Why it is not done.
    pub reason: Option<String>,
    /// How often it was tried.
    pub tries: usize,
    /// How long that took, all tries together.
    pub elapsed_secs: Option<f64>,
    /// The most memory that the last try took.
    pub peak_bytes: Option<u64>,
    /// Size of the input.
    pub bytes: u64,
    /// When this was said, in UTC (RFC 3339).
    pub time: Option<String>,
    /// What its repair left; `None` if it is not done, or if what lies there is of another repair.
    pub sidecar: Option<Sidecar>,
    /// A report of its own lies beside the output.
    pub report: bool,
    /// A log lies beside the output.
    pub log: bool,
}

/// What holds for the whole batch.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct About {
    /// What the output folder is called.
    pub name: String,
    /// Where it is; `None` for a bucket, into which a page cannot link.
    #[serde(skip)]
    pub folder: Option<PathBuf>,
    /// How many of the first folders of a path all takes share: what they are told apart by begins behind them.
    pub shared_folders: usize,
    /// The plans, the one that was run first to the front.
    pub plans: Vec<Planned>,
    /// Runs of the batch, in the order in which they began.
    pub attempts: Vec<Attempt>,
    /// How long any of them ran, in seconds.
    pub wall_secs: f64,
    /// Takes that were done in this time.
    pub done_in_runs: u64,
    /// What could not be read.
    pub remarks: Vec<String>,
}

/// What a plan says of all its takes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Planned {
    /// Name of the copy, the beginning of its SHA-256.
    pub name: String,
    /// Version of the program.
    pub version: String,
    /// The options, as TOML.
    pub config: String,
    /// SHA-256 of the options.
    pub config_sha256: String,
    /// Where the takes were looked for.
    pub sources: Vec<String>,
    /// Number of takes.
    pub takes: u64,
}

/// A run of the batch or of a part of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Attempt {
    /// When it began, in UTC (RFC 3339).
    pub begun: String,
    /// When it last said something.
    pub last: String,
    /// Where.
    pub host: String,
    /// `local` or `ray`.
    pub engine: String,
    /// Takes that were worked on at a time.
    pub jobs: usize,
    /// Which part, counted from 0.
    pub shard: u32,
    /// Number of parts.
    pub shards: u32,
    /// Version of the program.
    pub version: String,
    /// Takes that were done.
    pub done: u64,
    /// Takes that were done already.
    pub skipped: u64,
    /// Takes that cannot be done.
    pub quarantined: u64,
    /// Takes that failed.
    pub failed: u64,
    /// Why it ended, as one word; `None` if it did not end in an orderly way, or still runs.
    pub stop: Option<String>,
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// The page.
    pub html: PathBuf,
    /// The table.
    pub csv: PathBuf,
    /// Takes in it.
    pub takes: u64,
    /// Of these, takes that are done but of which no sidecar tells.
    pub without_numbers: u64,
}

/// Writes the page and, beside it, the table. Takes come in the order of their paths. Equal takes give equal bytes.
///
/// # Errors
/// The page is to have the name of a table, one of the files is there already and `force` is not given, or they cannot be written.
pub fn write(rows: impl Iterator<Item = FleetRow>, about: &About, out_html: &Path, force: bool) -> Result<Written, BatchError> {
    let csv = out_html.with_extension("csv");
    let unwritable = |path: &Path, e: &io::Error| BatchError::io(path, "cannot be written", e);
    if csv == out_html {
        return Err(BatchError::at(
            out_html,
            "is the name of the table, which is written beside the page; give the page a name that ends in .html",
        ));
    }
    for path in [out_html, &csv] {
        let sidecar = super::naming::beside(&path.to_string_lossy(), super::sidecar::EXTENSION);
        if Path::new(&sidecar).exists() || super::sources::is_take(out_html) {
            return Err(BatchError::at(path, "is the name of a take; give another name"));
        }
        if staging::is_there(path) && !force {
            return Err(BatchError::at(path, "exists already; give another name, or say --force to replace it"));
        }
    }
    let mut page_file = staging::beside(out_html).map_err(|e| unwritable(out_html, &e))?;
    let csv_file = staging::beside(&csv).map_err(|e| unwritable(&csv, &e))?;

    let mut sheet = sheet::Sheet::new(io::BufWriter::new(csv_file)).map_err(|e| unwritable(&csv, &e))?;
    let mut takes = takes::Takes::default();
    let mut markers = markers::Markers::default();
    let mut written = Written { html: out_html.to_owned(), csv: csv.clone(), ..Written::default() };
    for row in rows {
        let done = matches!(row.outcome, Some(Outcome::Done | Outcome::Skipped));
        written.without_numbers += u64::from(done && row.sidecar.is_none());
        sheet.add(&row).map_err(|e| unwritable(&csv, &e))?;
        if let Some(sidecar) = &row.sidecar {
            markers.add(folder_of(&row.path, about.shared_folders), sidecar, written.takes);
        }
        takes.add(&row, about.shared_folders);
        written.takes += 1;
    }
    let csv_file = sheet.finish().map_err(|e| unwritable(&csv, &e))?;
    let base = about.folder.as_deref().and_then(|folder| link::between(staging::folder(out_html), folder));
    let text = page::page(about, base.as_deref(), takes, markers);
    page_file.write_all(text.as_bytes()).map_err(|e| unwritable(out_html, &e))?;

    let mut placed = Placed::default();
    for (file, path) in [(csv_file, csv.as_path()), (page_file, out_html)] {
        placed.keep(path).map_err(|e| unwritable(path, &e))?;
        staging::publish(file, path).map_err(|e| unwritable(path, &e))?;
    }
    placed.done();
    Ok(written)
}

/// The folder that a take is told apart by: the first one that not all takes share. Nothing for a take beside those folders.
fn folder_of(path: &str, shared: usize) -> &str {
    let mut folders: Vec<&str> = path.split('/').collect();
    folders.pop();
    folders.get(shared).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests;
