//! What is told while a batch runs: a line for each worker and one for all, lines for scripts, or a line now and then.

use super::ledger::{Outcome, Stop, TakeRecord};
use super::plan::PlannedTake;
use super::run::Watcher;
use super::sidecar::Summary;
use crate::report::{count, lines};
use crate::typeset::{Style, Tone, columns, cut, is_dumb, rounded};
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// At most so many workers have a line.
const MOST_LINES: usize = 16;

/// How often lines are drawn anew.
const TICK: Duration = Duration::from_millis(200);

/// Without a terminal, how often a line is written.
const NOW_AND_THEN: Duration = Duration::from_secs(30);

/// How far a batch has come.
#[derive(Clone, Debug)]
pub struct Tally {
    /// Number and size of all takes; 0 if nobody knows.
    takes: u64,
    bytes: u64,
    done: u64,
    skipped: u64,
    quarantined: u64,
    failed: u64,
    /// Size of the takes that are accounted for, and of those of them that ran.
    bytes_settled: u64,
    bytes_run: u64,
    began: Instant,
}

impl Tally {
    /// Before anything was done.
    pub fn new(takes: u64, bytes: u64) -> Self {
        let began = Instant::now();
        Self { takes, bytes, done: 0, skipped: 0, quarantined: 0, failed: 0, bytes_settled: 0, bytes_run: 0, began }
    }

    fn add(&mut self, record: &TakeRecord) {
        match record.outcome {
            Outcome::Done => self.done += 1,
            Outcome::Skipped => self.skipped += 1,
            Outcome::Quarantined => self.quarantined += 1,
            Outcome::Failed => self.failed += 1,
        }
        self.bytes_settled += record.bytes;
        if !record.tries.is_empty() {
            self.bytes_run += record.bytes;
        }
    }

    fn settled(&self) -> u64 {
        self.done + self.skipped + self.quarantined + self.failed
    }

    /// Seconds until all takes are accounted for, if those that are left take as long as those that ran.
    fn left_secs(&self) -> Option<f64> {
        let secs = self.began.elapsed().as_secs_f64();
        let left = self.bytes.saturating_sub(self.bytes_settled);
        (self.bytes > 0 && self.bytes_run > 0 && secs > 1.0).then(|| secs * left as f64 / self.bytes_run as f64)
    }

    /// In words: `612 of 1000 takes, 12 put aside, about 4 min left`.
    fn text(&self) -> String {
        let of = if self.takes > 0 {
            format!("{} of {}", self.settled(), count(self.takes as usize, "take"))
        } else {
            count(self.settled() as usize, "take")
        };
        let mut parts = vec![of];
        for (number, what) in [(self.skipped, "done before"), (self.quarantined, "put aside"), (self.failed, "failed")] {
            if number > 0 {
                parts.push(format!("{number} {what}"));
            }
        }
        parts.extend(self.left_secs().map(|secs| format!("about {} left", rounded(secs))));
        parts.join(", ")
    }

    fn share(&self) -> f64 {
        if self.bytes > 0 { self.bytes_settled as f64 / self.bytes as f64 } else { 0.0 }
    }
}

/// A take that did not go well, in a line.
fn trouble(record: &TakeRecord) -> Option<String> {
    let what = match record.outcome {
        Outcome::Quarantined => "put aside",
        Outcome::Failed => "failed",
        Outcome::Done | Outcome::Skipped => return None,
    };
    let reason = record.reason.as_deref().unwrap_or("no reason given");
    Some(formats::printable(&format!("{}: {what}: {reason}", record.path)))
}

/// Lines on a terminal at standard error, gone when it is dropped. Takes that do not go well stay there.
pub struct Live {
    all: MultiProgress,
    total: ProgressBar,
    slots: Vec<Slot>,
    tally: Mutex<Tally>,
    style: Style,
}

struct Slot {
    bar: ProgressBar,
    doing: Mutex<Option<Doing>>,
}

struct Doing {
    path: String,
    tried: usize,
    phase: String,
    since: Instant,
}

impl Live {
    /// A terminal that can be drawn on; `None` if there is none.
    pub fn new(slots: usize, tally: Tally) -> Option<Self> {
        if !std::io::stderr().is_terminal() || is_dumb() {
            return None;
        }
        let all = MultiProgress::with_draw_target(ProgressDrawTarget::stderr_with_hz(10));
        let style = ProgressStyle::with_template("{msg}").ok()?;
        let slots = (0..slots.min(MOST_LINES))
            .map(|_| Slot { bar: all.add(ProgressBar::no_length().with_style(style.clone())), doing: Mutex::new(None) })
            .collect();
        let total = all.add(ProgressBar::no_length().with_style(style));
        Some(Self { all, total, slots, tally: Mutex::new(tally), style: Style::of_stderr() })
    }

    /// Draws everything until `over` says so. To be called by a thread of its own.
    pub fn draw_until(&self, over: &dyn Fn() -> bool, interrupted: &dyn Fn() -> bool) {
        let mut told = false;
        while !over() {
            if !told && interrupted() {
                let _ = self.all.println("interrupted: takes that run are brought to their end; interrupt again to end at once");
                told = true;
            }
            self.draw();
            std::thread::sleep(TICK);
        }
    }

    fn draw(&self) {
        let room = self.style.columns.saturating_sub(1);
        for slot in &self.slots {
            let doing = slot.doing.lock().unwrap_or_else(PoisonError::into_inner);
            slot.bar.set_message(doing.as_ref().map_or(String::new(), |doing| doing.line(room, &self.style)));
        }
        let tally = self.tally.lock().unwrap_or_else(PoisonError::into_inner).clone();
        self.total.set_message(total_line(&tally, room, &self.style));
    }
}

impl Doing {
    fn line(&self, room: usize, style: &Style) -> String {
        let again = if self.tried > 0 { format!(" (try {})", self.tried + 1) } else { String::new() };
        let secs = format!("  {:.0} s", self.since.elapsed().as_secs_f64());
        let name = cut(&self.path, room.saturating_sub(columns(&secs) + columns(&again)).min(room * 3 / 5), style.ascii);
        let left = room.saturating_sub(columns(&name) + columns(&again) + columns(&secs) + 2);
        // two or three characters of what it does tell nobody anything
        let phase = if left < 8 { String::new() } else { format!("  {}", style.toned(Tone::Quiet, &cut(&self.phase, left, style.ascii))) };
        format!("{name}{again}{phase}{secs}")
    }
}

fn total_line(tally: &Tally, room: usize, style: &Style) -> String {
    let text = tally.text();
    let length = room.saturating_sub(columns(&text) + 2).min(30);
    if tally.takes == 0 || length < 5 {
        return cut(&text, room, style.ascii);
    }
    let full = ((tally.share() * length as f64) as usize).min(length);
    let (done, rest) = if style.ascii { ("#", ".") } else { ("█", "░") };
    format!("{}{}  {text}", done.repeat(full), style.toned(Tone::Quiet, &rest.repeat(length - full)))
}

impl Watcher for Live {
    fn started(&self, slot: usize, take: &PlannedTake, tried: usize) {
        if let Some(slot) = self.slots.get(slot) {
            let doing = Doing { path: formats::printable(&take.path), tried, phase: String::new(), since: Instant::now() };
            *slot.doing.lock().unwrap_or_else(PoisonError::into_inner) = Some(doing);
        }
    }

    fn phase(&self, slot: usize, text: &str) {
        if let Some(slot) = self.slots.get(slot)
            && let Some(doing) = slot.doing.lock().unwrap_or_else(PoisonError::into_inner).as_mut()
        {
            doing.phase = formats::printable(text);
        }
    }

    fn finished(&self, slot: usize, record: &TakeRecord, _: Option<&Summary>) {
        if let Some(slot) = self.slots.get(slot) {
            *slot.doing.lock().unwrap_or_else(PoisonError::into_inner) = None;
        }
        self.tally.lock().unwrap_or_else(PoisonError::into_inner).add(record);
        if let Some(line) = trouble(record) {
            let _ = self.all.println(line); // a terminal that is gone is no reason to stop
        }
    }

    fn remark(&self, text: &str) {
        let _ = self.all.println(formats::printable(text));
    }

    fn stopping(&self, stop: Stop, why: &str) {
        if stop != Stop::Interrupted {
            let _ = self.all.println(formats::printable(&format!("stopping: {why}")));
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        let _ = self.all.clear();
    }
}

/// A line of text or JSON goes somewhere.
pub type Print<'a> = dyn Fn(&str) + Sync + 'a;

/// Where there is no terminal: takes that do not go well, and now and then how far it is.
pub struct Plain<'a> {
    print: &'a Print<'a>,
    tally: Mutex<(Tally, Instant)>,
}

impl<'a> Plain<'a> {
    /// `print`: to standard error.
    pub fn new(tally: Tally, print: &'a Print<'a>) -> Self {
        Self { print, tally: Mutex::new((tally, Instant::now())) }
    }
}

impl Watcher for Plain<'_> {
    fn finished(&self, _: usize, record: &TakeRecord, _: Option<&Summary>) {
        if let Some(line) = trouble(record) {
            (self.print)(&line);
        }
        let mut shared = self.tally.lock().unwrap_or_else(PoisonError::into_inner);
        shared.0.add(record);
        if shared.1.elapsed() >= NOW_AND_THEN {
            shared.1 = Instant::now();
            (self.print)(&shared.0.text());
        }
    }

    fn remark(&self, text: &str) {
        (self.print)(&formats::printable(text));
    }

    fn stopping(&self, _: Stop, why: &str) {
        (self.print)(&formats::printable(&format!("stopping: {why}")));
    }
}

/// What scripts are told, one line each.
pub struct Json<'a> {
    print: &'a Print<'a>,
    tally: Mutex<Tally>,
}

#[derive(Serialize)]
#[serde(tag = "message_type", rename_all = "snake_case")]
enum Event<'a> {
    TakeStarted {
        worker: usize,
        path: &'a str,
        bytes: u64,
        tried: usize,
    },
    TakePhase {
        worker: usize,
        text: &'a str,
    },
    TakeFinished {
        worker: usize,
        record: &'a TakeRecord,
        summary: Option<&'a Summary>,
        takes_settled: u64,
        takes: u64,
        bytes_settled: u64,
        bytes: u64,
        left_secs: Option<f64>,
    },
    Remark {
        text: &'a str,
    },
    Stopping {
        stop: Stop,
        reason: &'a str,
    },
}

impl<'a> Json<'a> {
    /// `print`: to standard output.
    pub fn new(tally: Tally, print: &'a Print<'a>) -> Self {
        Self { print, tally: Mutex::new(tally) }
    }

    fn say(&self, event: &Event<'_>) {
        (self.print)(&lines(std::slice::from_ref(event)));
    }
}

impl Watcher for Json<'_> {
    fn started(&self, worker: usize, take: &PlannedTake, tried: usize) {
        self.say(&Event::TakeStarted { worker, path: &take.path, bytes: take.bytes, tried });
    }

    fn phase(&self, worker: usize, text: &str) {
        self.say(&Event::TakePhase { worker, text });
    }

    fn finished(&self, worker: usize, record: &TakeRecord, summary: Option<&Summary>) {
        let mut tally = self.tally.lock().unwrap_or_else(PoisonError::into_inner);
        tally.add(record);
        self.say(&Event::TakeFinished {
            worker,
            record,
            summary,
            takes_settled: tally.settled(),
            takes: tally.takes,
            bytes_settled: tally.bytes_settled,
            bytes: tally.bytes,
            left_secs: tally.left_secs(),
        });
    }

    fn remark(&self, text: &str) {
        self.say(&Event::Remark { text });
    }

    fn stopping(&self, stop: Stop, reason: &str) {
        self.say(&Event::Stopping { stop, reason });
    }
}

/// Nobody is told anything.
pub struct Silent;

impl Watcher for Silent {}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(outcome: Outcome, bytes: u64) -> TakeRecord {
        TakeRecord {
            time: String::new(),
            path: "a\u{1b}[2Jb.c3d".to_owned(),
            output: String::new(),
            key: None,
            planned: None,
            outcome,
            exit_code: None,
            reason: Some("cut off".to_owned()),
            tries: Vec::new(),
            elapsed_secs: 0.0,
            peak_bytes: None,
            bytes,
        }
    }

    #[test]
    fn a_tally_says_what_is_there() {
        let mut tally = Tally::new(4, 100);
        assert_eq!(tally.text(), "0 of 4 takes");
        for (outcome, bytes) in [(Outcome::Done, 40), (Outcome::Skipped, 10), (Outcome::Quarantined, 25)] {
            tally.add(&record(outcome, bytes));
        }
        assert_eq!(tally.text(), "3 of 4 takes, 1 done before, 1 put aside");
        assert!((tally.share() - 0.75).abs() < 1e-12);
        let style = Style { ascii: true, columns: 80, ..Style::plain() };
        assert_eq!(total_line(&tally, 79, &style), format!("{}{}  {}", "#".repeat(22), ".".repeat(8), tally.text()));
        assert!(columns(&total_line(&tally, 20, &style)) <= 20);
    }

    #[test]
    fn trouble_is_told_without_what_would_disturb_the_terminal() {
        let line = trouble(&record(Outcome::Quarantined, 1)).unwrap_or_default();
        assert!(line.ends_with("put aside: cut off") && !line.contains('\u{1b}'), "{line}");
        assert_eq!(trouble(&record(Outcome::Done, 1)), None);
    }

    #[test]
    fn a_worker_has_one_line() {
        let doing = Doing { path: "a long name of a take ".repeat(5), tried: 1, phase: "reading it".repeat(9), since: Instant::now() };
        for room in [30, 60, 100] {
            let style = Style { ascii: true, columns: room + 1, ..Style::plain() };
            let line = doing.line(room, &style);
            assert!(columns(&line) <= room, "{room}: {line}");
            assert!(line.contains("(try 2)") && line.ends_with(" s"), "{line}");
        }
    }
}
