//! Progress on the terminal, for somebody who waits. Written to standard error, gone when the work is done.
//!
//! Whoever works only says where it is; a thread of its own draws ten times a second what was said last.

use crate::solve::{Meter, Observer, Outcome, Progress, Start, Step};
use crate::typeset::{Style, Tone, columns, cut, is_dumb, rounded};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::fmt::Write;
use std::io::IsTerminal;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often it is drawn.
const TICK: Duration = Duration::from_millis(100);

/// Work that is done sooner shows nothing at all.
const PATIENCE: Duration = Duration::from_millis(300);

/// No time is promised from less than this share of the work ...
const LEAST_SHARE: f64 = 0.02;

/// ... nor from less than this many seconds of it.
const LEAST_SECS: f64 = 1.0;

/// Shows what is being done: the stage with its steps, its likelihood, how far things still move and how long it may take; or the work between stages.
pub struct Terminal {
    bar: ProgressBar,
    shown: Arc<Mutex<Shown>>,
    meter: Arc<Meter>,
}

/// What was said last.
struct Shown {
    style: Style,
    began: Instant,
    doing: Doing,
}

enum Doing {
    Phase { what: String, since: Instant },
    Stage { stage: Stage, since: Instant },
}

/// A stage as far as it has come.
struct Stage {
    method: &'static str,
    limit: u32,
    steps: u32,
    /// Seconds from the beginning to the end of the last step.
    stepped_secs: f64,
    last: Option<Progress>,
    /// Change of the log-likelihood by the last step.
    change: Option<f64>,
    /// It counts within its steps.
    counts: bool,
}

impl Terminal {
    /// A terminal at standard error that can be drawn on; `None` if there is none.
    pub fn new() -> Option<Self> {
        if !std::io::stderr().is_terminal() || is_dumb() {
            return None;
        }
        let now = Instant::now();
        let phase = Doing::Phase { what: String::new(), since: now };
        let shown = Arc::new(Mutex::new(Shown { style: Style::of_stderr(), began: now, doing: phase }));
        let terminal = Self {
            bar: ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10)),
            shown,
            meter: Arc::new(Meter::default()),
        };
        terminal.lines(1);
        terminal.bar.enable_steady_tick(TICK);
        Some(terminal)
    }

    /// From now on so many lines are drawn.
    fn lines(&self, lines: usize) {
        let template = ["{first}", "{first}\n{second}"][lines - 1];
        let Ok(mut style) = ProgressStyle::with_template(template) else { return };
        for (at, key) in ["first", "second"].into_iter().enumerate() {
            let (shown, meter) = (Arc::clone(&self.shown), Arc::clone(&self.meter));
            style = style.with_key(key, move |_: &ProgressState, out: &mut dyn Write| {
                let shown = shown.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(line) = shown.lines(Instant::now(), meter.read()).get(at) {
                    let _ = out.write_str(line); // what is not drawn now is drawn with the next tick
                }
            });
        }
        self.bar.set_style(style);
    }

    fn say(&self, doing: Doing) {
        let lines = if matches!(doing, Doing::Stage { .. }) { 2 } else { 1 };
        self.meter.begin(0);
        self.shown.lock().unwrap_or_else(PoisonError::into_inner).doing = doing;
        self.lines(lines);
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

impl Observer for Terminal {
    fn started(&mut self, start: &Start<'_>) {
        let stage =
            Stage { method: start.method, limit: start.step_limit, steps: 0, stepped_secs: 0.0, last: None, change: None, counts: false };
        self.say(Doing::Stage { stage, since: Instant::now() });
    }

    fn stepped(&mut self, step: &Step<'_>) {
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        if let Doing::Stage { stage, since } = &mut shown.doing {
            stage.counts |= self.meter.read().1 > 0;
            stage.stepped(step.progress, since.elapsed().as_secs_f64());
        }
        // before anything is drawn: a step that is done must not count twice
        self.meter.begin(0);
    }

    fn stopped(&mut self, _outcome: &Outcome) {
        self.phase("going on");
    }

    fn phase(&mut self, doing: &str) {
        self.say(Doing::Phase { what: doing.to_owned(), since: Instant::now() });
    }

    fn meter(&self) -> Option<Arc<Meter>> {
        Some(Arc::clone(&self.meter))
    }
}

impl Shown {
    /// What is drawn at a moment, given how far the step at hand has come.
    fn lines(&self, now: Instant, counted: (usize, usize)) -> Vec<String> {
        if now.duration_since(self.began) < PATIENCE {
            return Vec::new();
        }
        match &self.doing {
            Doing::Phase { what, since } => {
                let turning: &[&str] = if self.style.ascii {
                    &["|", "/", "-", "\\"]
                } else {
                    &["⠋", "⠙", "⠹", "⠸", "⠼", "⠴", "⠦", "⠧", "⠇", "⠏"]
                };
                let at = (now.duration_since(*since).as_millis() / TICK.as_millis()) as usize % turning.len();
                let counted = if counted.1 > 0 { format!(", {} of {}", counted.0, counted.1) } else { String::new() };
                let room = self.style.columns.saturating_sub(3 + counted.len());
                vec![format!("{} {}{counted}", turning[at], cut(what, room, self.style.ascii))]
            }
            Doing::Stage { stage, since } => stage.lines(now.duration_since(*since).as_secs_f64(), counted, &self.style),
        }
    }
}

impl Stage {
    fn stepped(&mut self, progress: &Progress, secs: f64) {
        self.change = self.last.and_then(|last| Some(progress.log_likelihood? - last.log_likelihood?));
        self.last = Some(*progress);
        self.steps += 1;
        self.stepped_secs = secs;
    }

    /// How much is done if all steps are taken: grows, and never beyond 1.
    fn share(&self, (done, all): (usize, usize)) -> f64 {
        let within = if all > 0 { done as f64 / all as f64 } else { 0.0 };
        ((f64::from(self.steps) + within) / f64::from(self.limit.max(1))).min(1.0)
    }

    fn counts_now(&self, (_, all): (usize, usize)) -> bool {
        self.counts || all > 0
    }

    /// Seconds that are left if all steps are taken, `secs` after the beginning.
    fn left_secs(&self, secs: f64, counted: (usize, usize)) -> Option<f64> {
        let mean = (self.steps > 0).then(|| self.stepped_secs / f64::from(self.steps));
        let rest = f64::from(self.limit.saturating_sub(self.steps));
        if !self.counts_now(counted) {
            return mean.filter(|_| self.stepped_secs >= LEAST_SECS).map(|mean| (rest * mean - (secs - self.stepped_secs)).max(0.0));
        }
        // Steps that count are few and differ: the one at hand tells about itself and those to come, as soon as it tells anything.
        let (spent, share) = (secs - self.stepped_secs, counted.0 as f64 / counted.1.max(1) as f64);
        let one = if spent >= LEAST_SECS && share >= LEAST_SHARE { Some(spent / share) } else { mean };
        one.map(|one| (one * (rest - share)).max(0.0))
    }

    /// Two lines: how far and how long; likelihood and how far things moved.
    fn lines(&self, secs: f64, counted: (usize, usize), style: &Style) -> Vec<String> {
        let within = if counted.1 > 0 { format!(" ({} of {} gaps)", counted.0, counted.1) } else { String::new() };
        let steps = match (self.steps, counted.1) {
            (0, 0) => String::new(),
            (steps, _) => format!("{steps}/{}", self.limit),
        };
        // EM mostly converges long before its last step
        let bound = if self.counts_now(counted) { "about" } else { "at most" };
        let left = self.left_secs(secs, counted).map(|left| format!("{bound} {} left", rounded(left))).unwrap_or_default();
        let room = style.columns.saturating_sub(1);
        let mut after: Vec<String> = [steps + &within, left].into_iter().filter(|text| !text.is_empty()).collect();
        let taken = |after: &[String]| columns(self.method) + after.iter().map(|text| 2 + columns(text)).sum::<usize>();
        if taken(&after) + 8 > room && counted.1 > 0 {
            after[0] = format!("{}/{}", self.steps, self.limit);
        }
        if taken(&after) + 2 > room && after.len() > 1 {
            after.pop();
        }
        let length = room.saturating_sub(taken(&after) + 2).min(30);
        let full = ((self.share(counted) * length as f64) as usize).min(length);
        let (done, rest) = if style.ascii { ("#", ".") } else { ("█", "░") };
        let first = format!(
            "{}  {}{}{}",
            style.toned(Tone::Title, self.method),
            done.repeat(full),
            style.toned(Tone::Quiet, &rest.repeat(length - full)),
            after.iter().fold(String::new(), |text, more| text + "  " + more)
        );
        let Some(last) = &self.last else { return vec![first] };
        let said = |names: [&str; 2], digits: usize| {
            let change = self.change.map(|change| format!(" ({change:+.digits$})")).unwrap_or_default();
            let likelihood = last.log_likelihood.map(|value| format!("{} {value:.digits$}{change}", names[0]));
            // where nothing was before, nothing moved
            let moved = (last.largest_move_mm > 0.0).then(|| format!("{} {:.2} mm", names[1], last.largest_move_mm));
            [likelihood, moved].into_iter().flatten().collect::<Vec<_>>().join(", ")
        };
        let blank = " ".repeat(columns(self.method) + 2);
        let long = format!("{blank}{}", said(["log-likelihood", "largest move"], 1));
        let second = if columns(&long) <= room { long } else { cut(&said(["ln L", "moved"], 0), room, style.ascii) };
        vec![first, style.toned(Tone::Quiet, &second)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn progress(log_likelihood: Option<f64>, largest_move_mm: f64) -> Progress {
        Progress { log_likelihood, rms_residual_mm: None, largest_move_mm, rms_move_mm: 0.0, done: false }
    }

    fn stage(limit: u32) -> Stage {
        Stage { method: "bolero-sc", limit, steps: 0, stepped_secs: 0.0, last: None, change: None, counts: false }
    }

    #[test]
    fn a_stage_tells_steps_likelihood_moves_and_the_longest_time() {
        let style = Style::plain();
        let mut em = stage(10);
        let empty = "░".repeat(30);
        assert_eq!(em.lines(0.5, (0, 0), &style), [format!("bolero-sc  {empty}")]);
        em.stepped(&progress(Some(-2000.0), 41.5), 2.0);
        em.stepped(&progress(Some(-1988.5), 7.25), 4.0);
        let (done, rest) = ("█".repeat(6), "░".repeat(24));
        let said = "           log-likelihood -1988.5 (+11.5), largest move 7.25 mm";
        assert_eq!(em.lines(4.0, (0, 0), &style), [format!("bolero-sc  {done}{rest}  2/10  at most 20 s left"), said.to_owned()]);
        // the time runs on between steps, and not below nothing
        assert_eq!(em.left_secs(5.5, (0, 0)), Some(14.5));
        assert_eq!(em.left_secs(99.0, (0, 0)), Some(0.0));
    }

    #[test]
    fn a_sweep_tells_its_gaps() {
        let style = Style { ascii: true, ..Style::plain() };
        let mut auto = Stage { method: "auto", ..stage(3) };
        assert_eq!(auto.lines(0.5, (1, 93), &style), ["auto  ..............................  0/3 (1 of 93 gaps)"]);
        auto.stepped(&progress(None, 3.0), 6.0);
        let lines = auto.lines(9.0, (45, 90), &style);
        assert_eq!(lines, ["auto  ###############...............  1/3 (45 of 90 gaps)  about 9 s left", "      largest move 3.00 mm"]);
    }

    #[test]
    fn shares_only_grow() {
        let mut auto = stage(3);
        let mut before = 0.0;
        for _ in 0..3 {
            for counted in [(0, 0), (0, 4), (3, 4), (4, 4)] {
                let share = auto.share(counted);
                assert!(share >= before || counted == (0, 0), "{share} after {before}");
                before = share.max(before);
            }
            auto.stepped(&progress(None, 0.0), 1.0);
            assert!(auto.share((0, 0)) >= before);
        }
        assert_eq!(auto.share((1, 2)), 1.0);
    }

    #[test]
    fn every_line_fits_a_narrow_terminal() {
        for columns_there in [40, 60, 80, 200] {
            let style = Style { columns: columns_there, ..Style::plain() };
            let mut long = stage(100_000);
            for step in 0..3 {
                long.stepped(&progress(Some(-123_456_789.0 + f64::from(step)), 12_345.678), 100.0 * f64::from(step + 1));
            }
            for counted in [(0, 0), (12_345, 99_999)] {
                for line in long.lines(301.0, counted, &style) {
                    assert!(columns(&line) < columns_there, "{} columns: {line}", columns(&line));
                }
            }
        }
    }
}
