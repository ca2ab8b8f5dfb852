//! What was done when, by whom: append-only records, one file for each attempt at a shard.
//!
//! A run that is killed leaves a torn last line, which is not read. Nothing is ever changed or removed.

use super::plan::Shard;
use super::store::{Kind, Mode, Place, StoreError};
use super::{BatchError, OWN_FOLDER};
use crate::input::plain;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

/// Records are safe on the disk after this time at the latest ...
const SYNC: Duration = Duration::from_secs(1);

/// ... and in a bucket, where each time makes another object, after this.
const SEND: Duration = Duration::from_secs(10);

/// The longest line that is read, in bytes.
const LONGEST_LINE: u64 = 1 << 20;

/// The largest part of a ledger in a bucket, in bytes.
const LARGEST_PART: u64 = 64 << 20;

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

/// Where the ledgers are, below the output folder.
pub fn folder() -> String {
    format!("{OWN_FOLDER}/ledger")
}

/// The present time in UTC (RFC 3339).
pub fn now() -> String {
    humantime::format_rfc3339_millis(std::time::SystemTime::now()).to_string()
}

/// A ledger that is being written.
pub struct Ledger {
    /// Its number among those of its shard.
    pub attempt: u32,
    sink: Sink,
    since: Instant,
    torn: bool,
}

enum Sink {
    File(File),
    /// Objects do not grow: each part is one of its own.
    Bucket {
        place: Place,
        name: String,
        part: u32,
        waiting: Vec<u8>,
    },
}

impl Ledger {
    /// Begins the next attempt at a shard. `of`: what it is an attempt at, for the name.
    ///
    /// # Errors
    /// The output folder or bucket cannot be written to.
    pub fn begin(out: &Place, of: &str, shard: Shard, begun: Begun) -> Result<Self, StoreError> {
        let place = out.join(&folder())?;
        if let Some(folder) = place.folder() {
            std::fs::create_dir_all(folder).map_err(|e| of_file(&e))?;
        }
        let stem = format!("{of}-{}-of-{}-", shard.index, shard.count);
        let mut attempt = 1;
        place.list(&mut |entry| {
            let entry = entry?;
            let number = entry.name.strip_prefix(&stem).and_then(|rest| rest.get(..4)?.parse::<u32>().ok());
            attempt = attempt.max(number.map_or(1, |number| number + 1));
            Ok(())
        })?;
        let first = crate::report::lines(&[Record::Begun(begun)]);
        loop {
            let name = format!("{stem}{attempt:04}");
            let sink = if place.folder().is_some() {
                let file = format!("{name}.jsonl");
                place.write(&file, first.as_bytes(), Mode::Create)?.then(|| open_to_append(&place, &file)).transpose()?.map(Sink::File)
            } else {
                place.write(&format!("{name}/00000.jsonl"), first.as_bytes(), Mode::Create)?.then(|| Sink::Bucket {
                    place: place.clone(),
                    name,
                    part: 1,
                    waiting: Vec::new(),
                })
            };
            // somebody else took the number
            let Some(sink) = sink else {
                attempt += 1;
                continue;
            };
            return Ok(Self { attempt, sink, since: Instant::now(), torn: false });
        }
    }

    /// Adds a record.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn add(&mut self, record: &Record) -> Result<(), StoreError> {
        let line = crate::report::lines(std::slice::from_ref(record));
        // what is only told again can wait
        let matters = match record {
            Record::Take(take) => matches!(take.outcome, Outcome::Quarantined | Outcome::Failed) && !take.tries.is_empty(),
            Record::Begun(_) | Record::Ended(_) => true,
        };
        match &mut self.sink {
            Sink::File(file) => {
                // after a line that was cut off by a full disk comes a new one
                let line = if self.torn { format!("\n{line}") } else { line };
                self.torn = true;
                file.write_all(line.as_bytes()).map_err(|e| of_file(&e))?;
                self.torn = false;
                if matters || self.since.elapsed() > SYNC {
                    file.sync_data().map_err(|e| of_file(&e))?;
                    self.since = Instant::now();
                }
            }
            Sink::Bucket { waiting, .. } => {
                waiting.extend_from_slice(line.as_bytes());
                if matters || self.since.elapsed() > SEND {
                    self.send()?;
                }
            }
        }
        Ok(())
    }

    fn send(&mut self) -> Result<(), StoreError> {
        if let Sink::Bucket { place, name, part, waiting } = &mut self.sink
            && !waiting.is_empty()
        {
            place.write(&format!("{name}/{part:05}.jsonl"), waiting, Mode::Replace)?;
            *part += 1;
            waiting.clear();
            self.since = Instant::now();
        }
        Ok(())
    }
}

fn open_to_append(place: &Place, file: &str) -> Result<File, StoreError> {
    let path = place.folder().unwrap_or(Path::new("")).join(file);
    File::options().append(true).open(path).map_err(|e| of_file(&e))
}

fn of_file(error: &std::io::Error) -> StoreError {
    let kind = if crate::error::is_full(error.kind()) { Kind::Full } else { Kind::Other };
    StoreError { place: "the ledger".to_owned(), kind, problem: format!("cannot be written: {}", plain(error)) }
}

/// All records of all ledgers of an output folder or bucket, oldest attempts first. `each` gets the name of the ledger with every record.
///
/// # Errors
/// A ledger cannot be read.
pub fn read_all(out: &Place, each: &mut dyn FnMut(&str, Record)) -> Result<(), BatchError> {
    let place = out.join(&folder())?;
    let mut names = Vec::new();
    if place.folder().is_some_and(|folder| !folder.exists()) {
        return Ok(());
    }
    place.list(&mut |entry| {
        let entry = entry?;
        if Path::new(&entry.name).extension().is_some_and(|e| e == "jsonl") && !entry.name.starts_with('.') {
            names.push(entry.name);
        }
        Ok(())
    })?;
    names.sort();
    for name in names {
        let of = name.split('/').next().unwrap_or_default().trim_end_matches(".jsonl").to_owned();
        let mut told = |lines: &mut dyn BufRead| read_lines(lines, &mut |record| each(&of, record));
        if let Some(folder) = place.folder() {
            let path = folder.join(&name);
            let file = File::open(&path).map_err(|e| BatchError::at(&path, format!("cannot be read: {}", plain(&e))))?;
            told(&mut BufReader::new(file)).map_err(|e| BatchError::at(&path, format!("cannot be read: {}", plain(&e))))?;
        } else if let Some(bytes) = place.read(&name, LARGEST_PART)? {
            told(&mut bytes.as_slice()).map_err(|e| BatchError::at(Path::new(&name), plain(&e)))?;
        }
    }
    Ok(())
}

/// What is no record is left out: the torn end of a ledger whose run was killed.
fn read_lines(mut lines: &mut dyn BufRead, each: &mut dyn FnMut(Record)) -> std::io::Result<()> {
    let mut line = Vec::new();
    loop {
        line.clear();
        if Read::by_ref(&mut lines).take(LONGEST_LINE).read_until(b'\n', &mut line)? == 0 {
            return Ok(());
        }
        if let Ok(record) = serde_json::from_slice(&line) {
            each(record);
        }
    }
}
