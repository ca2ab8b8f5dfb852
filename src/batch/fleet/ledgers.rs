//! What the ledgers say: the newest record of each take, and the runs that there were.

use super::Attempt;
use crate::batch::ledger::{Outcome, Record, Stop, TakeRecord};
use std::collections::BTreeMap;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// When something was said: time, then attempt, then line.
type When = (Duration, u64, usize);

/// What is kept of a record.
#[derive(Clone, Debug)]
pub(super) struct Said {
    when: When,
    pub(super) time: String,
    pub(super) output: String,
    pub(super) key: Option<String>,
    pub(super) outcome: Outcome,
    pub(super) exit_code: Option<u8>,
    pub(super) reason: Option<String>,
    pub(super) tries: usize,
    pub(super) elapsed_secs: f64,
    pub(super) peak_bytes: Option<u64>,
    pub(super) bytes: u64,
}

/// What is kept of a take.
#[derive(Clone, Debug, Default)]
pub(super) struct Told {
    /// The newest record.
    pub(super) newest: Option<Said>,
    /// The newest record of it being done, if that is another one.
    done: Option<Box<Said>>,
}

impl Told {
    /// What the repair took whose output is there: also if the newest record only says that it was done already.
    pub(super) fn repair(&self) -> Option<&Said> {
        let newest = self.newest.as_ref()?;
        match newest.outcome {
            Outcome::Skipped => self.done.as_deref().filter(|done| newest.key.is_some() && done.key == newest.key),
            _ => Some(newest),
        }
    }

    fn add(&mut self, said: Said) {
        let is_newest = self.newest.as_ref().is_none_or(|newest| newest.when <= said.when);
        let before = if is_newest { self.newest.replace(said) } else { Some(said) };
        if let Some(before) = before.filter(|before| before.outcome == Outcome::Done)
            && self.done.as_ref().is_none_or(|done| done.when <= before.when)
        {
            self.done = Some(Box::new(before));
        }
    }
}

/// What all ledgers say.
#[derive(Debug, Default)]
pub(super) struct Ledgers {
    /// By path.
    pub(super) takes: BTreeMap<String, Told>,
    runs: Vec<(Duration, Duration, Attempt)>,
    /// Lines that cannot be read and are not the last of their file.
    pub(super) unread: u64,
}

impl Ledgers {
    /// Takes in a ledger of this name.
    pub(super) fn add(&mut self, name: &str, bytes: &[u8]) {
        let attempt = name.trim_end_matches(".jsonl").rsplit('-').next().and_then(|number| number.parse().ok()).unwrap_or(0);
        let mut run = None;
        // whatever stands behind the last line end was torn off by a kill
        let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(&[][..], |end| &bytes[..end]);
        for (line, text) in whole.split(|b| *b == b'\n').enumerate().filter(|(_, text)| !text.trim_ascii().is_empty()) {
            match serde_json::from_slice(text) {
                Ok(Record::Begun(begun)) => {
                    self.runs.extend(run.take());
                    let (time, last) = (moment(&begun.time), begun.time.clone());
                    let attempt = Attempt {
                        begun: begun.time,
                        last,
                        host: begun.host,
                        engine: begun.engine,
                        jobs: begun.jobs,
                        shard: begun.shard,
                        shards: begun.shards,
                        version: begun.version,
                        ..Attempt::default()
                    };
                    run = Some((time, time, attempt));
                }
                Ok(Record::Take(record)) => {
                    let time = moment(&record.time);
                    if let Some(run) = &mut run {
                        count(run, time, &record);
                    }
                    let (path, said) = kept(record, (time, attempt, line));
                    self.takes.entry(path).or_default().add(said);
                }
                Ok(Record::Ended(ended)) => {
                    if let Some((_, last, attempt)) = &mut run {
                        *last = moment(&ended.time).max(*last);
                        attempt.last = ended.time;
                        attempt.stop = Some(word(ended.stop).to_owned());
                    }
                }
                Err(_) => self.unread += 1,
            }
        }
        self.runs.extend(run);
    }

    /// The runs, how long any of them ran, and how many takes were done in that time.
    pub(super) fn runs(&mut self) -> (Vec<Attempt>, f64, u64) {
        let mut runs = std::mem::take(&mut self.runs);
        runs.sort_by(|a, b| (a.0, &a.2.host, a.2.shard).cmp(&(b.0, &b.2.host, b.2.shard)));
        let (mut together, mut until) = (Duration::ZERO, Duration::ZERO);
        for (begun, last, _) in &runs {
            let from = (*begun).max(until);
            together += last.saturating_sub(from);
            until = until.max(*last);
        }
        let done = runs.iter().map(|(_, _, attempt)| attempt.done).sum();
        (runs.into_iter().map(|(_, _, attempt)| attempt).collect(), together.as_secs_f64(), done)
    }
}

fn count(run: &mut (Duration, Duration, Attempt), time: Duration, record: &TakeRecord) {
    let (_, last, attempt) = run;
    if time >= *last {
        *last = time;
        attempt.last.clone_from(&record.time);
    }
    match record.outcome {
        Outcome::Done => attempt.done += 1,
        Outcome::Skipped => attempt.skipped += 1,
        Outcome::Quarantined => attempt.quarantined += 1,
        Outcome::Failed => attempt.failed += 1,
    }
}

fn kept(record: TakeRecord, when: When) -> (String, Said) {
    let said = Said {
        when,
        time: record.time,
        output: record.output,
        key: record.key,
        outcome: record.outcome,
        exit_code: record.exit_code,
        reason: record.reason,
        tries: record.tries.len(),
        elapsed_secs: record.elapsed_secs,
        peak_bytes: record.peak_bytes,
        bytes: record.bytes,
    };
    (record.path, said)
}

/// A time since 1970; 0 for what is none.
fn moment(time: &str) -> Duration {
    humantime::parse_rfc3339(time).ok().and_then(|time: SystemTime| time.duration_since(UNIX_EPOCH).ok()).unwrap_or_default()
}

fn word(stop: Stop) -> &'static str {
    match stop {
        Stop::Complete => "complete",
        Stop::Interrupted => "interrupted",
        Stop::DiskFull => "disk_full",
        Stop::TooManyFailures => "too_many_failures",
        Stop::Engine => "engine",
    }
}
