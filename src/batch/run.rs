//! Takes are handed out, tried again or put aside, and every one of them is accounted for.
//!
//! As many threads as the engine has slots do the same: get the next take, look whether it is done already, run it, write down what became of it.
//! What they share is small, and does not grow with the number of takes.

use super::engine::{Allowed, Attempt, Engine};
use super::job::{Job, TakeResult, Verdict};
use super::ledger::{self, Ended, How, Ledger, Outcome, Record, Stop, TakeRecord, Try};
use super::plan::{Header, PlannedTake};
use super::session::known;
use super::sidecar::Summary;
use super::store::Place;
use super::take::{Check, check};
use super::{BatchError, memory};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A take that may go better another time is tried this many times more.
pub const RETRIES: usize = 3;

/// If more than [`TOO_MANY`] of this many takes fail, something else than takes is wrong.
const FIRST: u64 = 200;

/// A fifth of [`FIRST`].
const TOO_MANY: u64 = FIRST / 5;

/// If so many takes in a row fail for what is around them, a disk or a network is gone.
const IN_A_ROW: u64 = 40;

/// How long the first retry of something that may go better another time waits; each one after that four times longer.
const PAUSE: Duration = Duration::from_millis(250);

/// Where takes come from.
pub trait Supply: Send {
    /// The next one.
    fn next(&mut self) -> Next;
    /// Something around a take kept it from being repaired.
    fn failed(&mut self, _path: &str) {}
}

/// What a [`Supply`] has.
pub enum Next {
    /// This.
    Take(Box<PlannedTake>),
    /// Something to be told; ask again at once.
    Remark(String),
    /// Nothing at the moment; ask again after this time.
    Later(Duration),
    /// Nothing any more.
    End,
    /// The rest cannot be read.
    Broken(BatchError),
}

/// What holds for a whole run.
pub struct Settings<'a> {
    /// What is said in the plan.
    pub header: &'a Header,
    /// Where outputs go.
    pub out: &'a Place,
    /// Below that, the folder for files that have not got their names yet.
    pub work: String,
    /// Replace outputs that are there and do not come from a batch.
    pub force: bool,
    /// Try takes again that were put aside.
    pub retry: bool,
    /// Go on however many fail.
    pub keep_going: bool,
    /// Tries that take longer are ended.
    pub timeout: Option<Duration>,
    /// Why outputs cannot be put where they belong any more, if that is so.
    pub gone: &'a (dyn Fn() -> Option<String> + Sync),
    /// Takes that were put aside before, by [`known`](super::session::known), and why.
    pub quarantined: BTreeMap<String, String>,
}

/// Somebody who is told what happens.
pub trait Watcher: Sync {
    /// A slot begins with a take; `tried` times it was tried before.
    fn started(&self, _slot: usize, _take: &PlannedTake, _tried: usize) {}
    /// What a slot is doing.
    fn phase(&self, _slot: usize, _text: &str) {}
    /// What became of a take.
    fn finished(&self, _slot: usize, _record: &TakeRecord, _summary: Option<&Summary>) {}
    /// Something that is about no take in particular.
    fn remark(&self, _text: &str) {}
    /// The run will end early, and why.
    fn stopping(&self, _stop: Stop, _why: &str) {}
}

/// What is shared.
struct Shared<'a> {
    ledger: &'a mut Ledger,
    totals: Ended,
    /// Takes that ran, up to [`FIRST`], and how many of them came to nothing.
    ran: u64,
    bad: u64,
    /// Takes that failed one after the other.
    in_a_row: u64,
    running: usize,
    number: u64,
    stop: Option<(Stop, String)>,
    broken: Option<BatchError>,
}

/// Runs all takes of a supply, and says how it ended.
///
/// # Errors
/// The plan or the ledger is broken.
pub fn run(
    settings: &Settings<'_>,
    engine: &dyn Engine,
    supply: &mut dyn Supply,
    ledger: &mut Ledger,
    watcher: &dyn Watcher,
    interrupt: &AtomicBool,
) -> Result<(Ended, String), BatchError> {
    let none = Ended { time: String::new(), stop: Stop::Complete, done: 0, remarked: 0, skipped: 0, quarantined: 0, failed: 0 };
    let supply = Mutex::new(supply);
    let shared = Mutex::new(Shared { ledger, totals: none, ran: 0, bad: 0, in_a_row: 0, running: 0, number: 0, stop: None, broken: None });
    std::thread::scope(|scope| {
        for slot in 0..engine.slots() {
            let worker = Worker { settings, engine, supply: &supply, shared: &shared, watcher, interrupt, slot };
            scope.spawn(move || worker.go());
        }
    });
    let shared = shared.into_inner().unwrap_or_else(PoisonError::into_inner);
    let Shared { ledger, totals, stop, broken, .. } = shared;
    let (stop, why) = stop.unwrap_or((Stop::Complete, String::new()));
    let ended = Ended { time: ledger::now(), stop, ..totals };
    let closed = ledger.add(&Record::Ended(ended.clone()));
    match (broken, closed) {
        (Some(error), _) => Err(error),
        // that the disk is full is told already
        (None, Err(error)) if stop == Stop::Complete => Err(error.into()),
        _ => Ok((ended, why)),
    }
}

struct Worker<'a, 'b, 's> {
    settings: &'a Settings<'a>,
    engine: &'a dyn Engine,
    /// Looking for the next take may take a while, and is nobody's business who has one.
    supply: &'a Mutex<&'s mut dyn Supply>,
    shared: &'a Mutex<Shared<'b>>,
    watcher: &'a dyn Watcher,
    interrupt: &'a AtomicBool,
    slot: usize,
}

impl<'b> Worker<'_, 'b, '_> {
    fn shared(&self) -> std::sync::MutexGuard<'_, Shared<'b>> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn go(&self) {
        while let Some((number, take)) = self.next() {
            let finished = self.one(number, &take);
            if matches!(&finished, Ok(Some((TakeRecord { outcome: Outcome::Failed, .. }, _)))) {
                self.supply.lock().unwrap_or_else(PoisonError::into_inner).failed(&take.path);
            }
            let mut shared = self.shared();
            shared.running -= 1;
            match finished {
                Ok(Some((record, summary))) => {
                    if let Err(error) = shared.ledger.add(&Record::Take(record.clone())) {
                        let full = error.kind == super::store::Kind::Full;
                        self.stop(&mut shared, if full { Stop::DiskFull } else { Stop::Engine }, error.to_string());
                    }
                    self.watcher.finished(self.slot, &record, summary.as_ref());
                    self.count(&mut shared, &record);
                }
                Ok(None) => {} // given up with everything else; the next run does it
                Err(error) => self.stop(&mut shared, Stop::Engine, error.to_string()),
            }
        }
    }

    /// The next take, with its number in this run.
    fn next(&self) -> Option<(u64, PlannedTake)> {
        loop {
            {
                let mut shared = self.shared();
                if self.interrupt.load(Ordering::Relaxed) {
                    self.stop(&mut shared, Stop::Interrupted, "interrupted".to_owned());
                }
                if shared.stop.is_some() {
                    self.engine.last_ones(shared.running);
                    return None;
                }
            }
            let next = self.supply.lock().unwrap_or_else(PoisonError::into_inner).next();
            let mut shared = self.shared();
            match next {
                Next::Take(take) => {
                    shared.running += 1;
                    shared.number += 1;
                    return Some((shared.number, *take));
                }
                Next::End => {
                    self.engine.last_ones(shared.running);
                    return None;
                }
                Next::Broken(error) => {
                    self.stop(&mut shared, Stop::Engine, error.to_string());
                    shared.broken = Some(error);
                    return None;
                }
                Next::Remark(text) => {
                    drop(shared);
                    self.watcher.remark(&text);
                }
                Next::Later(pause) => {
                    drop(shared);
                    self.pause(pause);
                }
            }
        }
    }

    /// Sleeps, but not through an interrupt.
    fn pause(&self, pause: Duration) {
        let until = Instant::now() + pause;
        while Instant::now() < until && !self.interrupt.load(Ordering::Relaxed) {
            std::thread::sleep(until.saturating_duration_since(Instant::now()).min(Duration::from_millis(50)));
        }
    }

    fn stop(&self, shared: &mut Shared<'_>, stop: Stop, why: String) {
        if shared.stop.is_none() {
            self.watcher.stopping(stop, &why);
            shared.stop = Some((stop, why));
            if matches!(stop, Stop::DiskFull | Stop::Engine) {
                self.engine.abandon();
            } else {
                self.engine.wind_down();
            }
        }
    }

    fn count(&self, shared: &mut Shared<'_>, record: &TakeRecord) {
        let totals = &mut shared.totals;
        match record.outcome {
            Outcome::Done => {
                totals.done += 1;
                totals.remarked += u64::from(record.exit_code == Some(3));
            }
            Outcome::Skipped => {
                totals.skipped += 1;
                totals.remarked += u64::from(record.exit_code == Some(3));
            }
            Outcome::Quarantined => totals.quarantined += 1,
            Outcome::Failed => totals.failed += 1,
        }
        shared.in_a_row = if record.outcome == Outcome::Failed { shared.in_a_row + 1 } else { 0 };
        if shared.in_a_row >= IN_A_ROW && !self.settings.keep_going {
            let why = record.reason.as_deref().unwrap_or("no reason given");
            self.stop(shared, Stop::Engine, format!("{IN_A_ROW} takes in a row could not be read or written, the last one because: {why}"));
        }
        let fresh = !record.tries.is_empty() || record.outcome == Outcome::Failed;
        if fresh && shared.ran < FIRST {
            shared.ran += 1;
            shared.bad += u64::from(matches!(record.outcome, Outcome::Quarantined | Outcome::Failed));
            if shared.bad > TOO_MANY && !self.settings.keep_going {
                let why = format!(
                    "{} of the first {} takes failed, the last one because: {}; if that is as it should be, say --keep-going",
                    shared.bad,
                    shared.ran,
                    record.reason.as_deref().unwrap_or("no reason given")
                );
                self.stop(shared, Stop::TooManyFailures, why);
            }
        }
    }

    /// One take, until it is done, put aside or given up; `None` if that is not its own fault.
    fn one(&self, number: u64, take: &PlannedTake) -> Result<Option<(TakeRecord, Option<Summary>)>, BatchError> {
        let settings = self.settings;
        let identity = take.identity(settings.header);
        let mut record = TakeRecord {
            time: ledger::now(),
            path: take.path.clone(),
            output: take.output.clone(),
            key: take.key(settings.header),
            planned: Some(identity.clone()),
            outcome: Outcome::Quarantined,
            exit_code: None,
            reason: take.problem.clone(),
            tries: Vec::new(),
            elapsed_secs: 0.0,
            peak_bytes: None,
            bytes: take.bytes,
        };
        if take.problem.is_some() {
            return Ok(Some((record, None)));
        }
        self.watcher.started(self.slot, take, 0);
        let header = settings.header;
        match check(settings.out, take, &header.config_sha256, &header.version, header.wanted) {
            Ok(Check::Done(sidecar)) => {
                record.outcome = Outcome::Skipped;
                record.exit_code = Some(sidecar.exit_code);
                record.key = Some(sidecar.key);
                return Ok(Some((record, Some(sidecar.summary))));
            }
            Ok(Check::Changed(reason)) => {
                record.outcome = Outcome::Failed;
                record.reason = Some(reason);
                return Ok(Some((record, None)));
            }
            // whoever runs it will meet the same error, and say so
            Ok(Check::ToDo) | Err(_) => {}
        }
        if let Some(reason) = settings.quarantined.get(&known(&identity, &take.path)).filter(|_| !settings.retry) {
            record.reason = Some(reason.clone());
            return Ok(Some((record, None)));
        }
        if let Some(problem) = (settings.gone)() {
            return Err(BatchError::again(problem));
        }
        let began = Instant::now();
        let mut alone = false;
        loop {
            let allowed = Allowed { timeout: settings.timeout, memory_bytes: memory::estimate(take), alone };
            let attempt =
                self.engine.run(self.job(number, record.tries.len(), take), allowed, &|text| self.watcher.phase(self.slot, text))?;
            self.clear(number, record.tries.len());
            let given_up = self.shared().stop.as_ref().is_some_and(|(stop, _)| matches!(stop, Stop::DiskFull | Stop::Engine));
            let judged = judge(&attempt);
            if given_up && !matches!(judged, Judged::Done(_)) {
                return Ok(None);
            }
            let result = attempt.result.clone();
            record.tries.push(Try {
                ended: attempt.ended,
                code: attempt.code,
                signal: attempt.signal,
                reason: judged.reason(),
                elapsed_secs: attempt.elapsed.as_secs_f64(),
            });
            record.time = ledger::now();
            record.elapsed_secs = began.elapsed().as_secs_f64();
            record.exit_code = attempt.code.and_then(|code| u8::try_from(code).ok());
            record.reason = judged.reason();
            record.peak_bytes = result.as_ref().and_then(|result| result.peak_bytes);
            if let Some(key) = result.as_ref().and_then(|result| result.key.clone()) {
                record.key = Some(key);
            }
            match judged {
                Judged::Done(outcome) => record.outcome = outcome,
                Judged::Bad(_) => record.outcome = Outcome::Quarantined,
                Judged::Failed(_) => record.outcome = Outcome::Failed,
                Judged::Full(reason) => {
                    self.stop(&mut self.shared(), Stop::DiskFull, reason);
                    record.outcome = Outcome::Failed;
                }
                Judged::Again { memory, reason } => {
                    let interrupted = self.interrupt.load(Ordering::Relaxed);
                    // one that had all the memory there is will want more than that again
                    if record.tries.len() <= RETRIES && !interrupted && !(memory && alone) {
                        // a system without memory ends somebody so
                        alone |= memory || attempt.signal == Some(9);
                        self.watcher.started(self.slot, take, record.tries.len());
                        if attempt.ended == How::Exit {
                            self.pause(PAUSE * 4u32.pow(record.tries.len() as u32 - 1));
                        }
                        continue;
                    }
                    if interrupted {
                        return Ok(None);
                    }
                    record.outcome = Outcome::Quarantined;
                    record.reason = Some(format!("tried {} times, the last time: {reason}", record.tries.len()));
                }
            }
            return Ok(Some((record, result.and_then(|result| result.summary))));
        }
    }

    /// Where a try makes its files: nobody who was thought to be gone may meddle with the next one.
    fn work(&self, number: u64, tried: usize) -> String {
        format!("{}/{number}-{tried}", self.settings.work)
    }

    /// Removes what a try left that was ended from outside.
    fn clear(&self, number: u64, tried: usize) {
        if let Some(folder) = self.settings.out.folder() {
            let _ = std::fs::remove_dir_all(folder.join(self.work(number, tried))); // mostly it is gone; else the next run tries again
        }
    }

    fn job(&self, number: u64, tried: usize, take: &PlannedTake) -> Job {
        let Settings { header, out, force, .. } = self.settings;
        Job {
            take: take.clone(),
            out: out.shown().to_owned(),
            work: self.work(number, tried),
            config: header.config.clone(),
            config_sha256: header.config_sha256.clone(),
            files: header.files.clone(),
            wanted: header.wanted,
            threads: 1,
            memory_bytes: None,
            force: *force,
        }
    }
}

/// What a try means.
enum Judged {
    Done(Outcome),
    Bad(String),
    Failed(String),
    Full(String),
    Again { memory: bool, reason: String },
}

impl Judged {
    fn reason(&self) -> Option<String> {
        match self {
            Self::Done(_) => None,
            Self::Bad(reason) | Self::Failed(reason) | Self::Full(reason) | Self::Again { reason, .. } => Some(reason.clone()),
        }
    }
}

/// The code tells, and what the process said: if one of them is missing, it did not end as it should.
fn judge(attempt: &Attempt) -> Judged {
    let again = |reason: String| Judged::Again { memory: attempt.ended == How::Memory, reason };
    let told = if attempt.told.is_empty() { String::new() } else { format!(": {}", formats::printable(&attempt.told)) };
    match (attempt.ended, &attempt.result) {
        (How::Exit, Some(TakeResult { outcome, reason, exit_code, .. }))
            if attempt.code == Some(i32::from(outcome.exit_code(*exit_code))) =>
        {
            let reason = reason.clone().unwrap_or_else(|| "no reason given".to_owned());
            match outcome {
                Verdict::Done => Judged::Done(Outcome::Done),
                Verdict::Skipped => Judged::Done(Outcome::Skipped),
                Verdict::BadInput => Judged::Bad(reason),
                Verdict::Failed => Judged::Failed(reason),
                Verdict::DiskFull => Judged::Full(reason),
                Verdict::Again => Judged::Again { memory: false, reason },
                Verdict::OutOfMemory => Judged::Again { memory: true, reason },
            }
        }
        (How::Exit, _) => again(format!("ended with exit code {}{told}", attempt.code.map_or("none".to_owned(), |code| code.to_string()))),
        (How::Signal, _) => again(format!("was ended by signal {}{told}", attempt.signal.unwrap_or(0))),
        (How::Timeout, _) => again(format!("was not done after {:.0} s and was ended", attempt.elapsed.as_secs_f64())),
        (How::Memory, _) => again(format!("wanted more memory than there is{told}")),
        (How::Lost, _) => again(format!("whoever ran it is gone{told}")),
    }
}
