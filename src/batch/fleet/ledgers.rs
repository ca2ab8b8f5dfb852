//! What the ledgers say: the newest record of each take, and the runs that there were.

use super::Attempt;
use crate::batch::ledger::{Begun, Ended, Outcome, Stop, TakeRecord};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// What is kept of a record.
#[derive(Clone, Debug)]
pub(super) struct Said {
    /// When: time, then the number of the attempt. Of two at the same time the one that was read last counts.
    when: (Duration, u32),
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

    /// Takes in a record of a ledger of this name.
    pub(super) fn add(&mut self, record: TakeRecord, ledger: &str) {
        let attempt = ledger.rsplit('-').next().and_then(|number| number.parse().ok()).unwrap_or(0);
        let said = Said {
            when: (moment(&record.time), attempt),
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
        let is_newest = self.newest.as_ref().is_none_or(|newest| newest.when <= said.when);
        let before = if is_newest { self.newest.replace(said) } else { Some(said) };
        if let Some(before) = before.filter(|before| before.outcome == Outcome::Done)
            && self.done.as_ref().is_none_or(|done| done.when <= before.when)
        {
            self.done = Some(Box::new(before));
        }
    }
}

/// The runs that ledgers tell of.
#[derive(Debug, Default)]
pub(super) struct Ledgers {
    /// From when, until when.
    runs: Vec<(Duration, Duration, Attempt)>,
    /// The ledger that is being read, if its run counts.
    now: Option<String>,
}

impl Ledgers {
    /// A ledger begins; `counts`: its run is told of.
    pub(super) fn begin(&mut self, ledger: &str, begun: Begun, counts: bool) {
        self.now = counts.then(|| ledger.to_owned());
        if !counts {
            return;
        }
        let time = moment(&begun.time);
        let attempt = Attempt {
            last: begun.time.clone(),
            begun: begun.time,
            host: begun.host,
            engine: begun.engine,
            jobs: begun.jobs,
            shard: begun.shard,
            shards: begun.shards,
            version: begun.version,
            ..Attempt::default()
        };
        self.runs.push((time, time, attempt));
    }

    /// The run that a record of this ledger is of, at this time.
    fn run(&mut self, ledger: &str, time: &str) -> Option<&mut Attempt> {
        let (_, last, attempt) = self.runs.last_mut().filter(|_| self.now.as_deref() == Some(ledger))?;
        if moment(time) >= *last {
            *last = moment(time);
            time.clone_into(&mut attempt.last);
        }
        Some(attempt)
    }

    /// A take was accounted for.
    pub(super) fn count(&mut self, ledger: &str, record: &TakeRecord) {
        let Some(attempt) = self.run(ledger, &record.time) else { return };
        match record.outcome {
            Outcome::Done => attempt.done += 1,
            Outcome::Skipped => attempt.skipped += 1,
            Outcome::Quarantined => attempt.quarantined += 1,
            Outcome::Failed => attempt.failed += 1,
        }
    }

    /// The run ended.
    pub(super) fn end(&mut self, ledger: &str, ended: &Ended) {
        if let Some(attempt) = self.run(ledger, &ended.time) {
            attempt.stop = Some(word(ended.stop).to_owned());
        }
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
