//! The frame rate, from a column of times.

use super::NAME;
use super::number::{self, Numbers};
use super::scan::{Cell, decode, excerpt};
use crate::{FormatError, Note, Notes, Place};

/// Times in seconds go up by less than this from frame to frame. A larger step is in another unit, or no time at all.
const LARGEST_STEP_SECS: f64 = 1.0;

/// One time of the file.
#[derive(Clone, Copy, Debug)]
struct Stamp {
    /// Frame, counted from any number.
    frame: i64,
    /// As the file writes it.
    time: f64,
    line: u64,
}

/// Collects the times of frames.
#[derive(Clone, Debug)]
pub(super) struct Clock {
    numbers: Numbers,
    unit_secs: Option<f64>,
    stamps: Vec<Stamp>,
    /// The first cell that holds no number.
    unreadable: Option<(u64, String)>,
}

impl Clock {
    /// No times so far. `unit_secs`: how many seconds one unit of the column is, if the header says it.
    pub fn new(separator: u8, unit_secs: Option<f64>) -> Self {
        Self { numbers: Numbers::new(separator), unit_secs, stamps: Vec::new(), unreadable: None }
    }

    /// Takes in the time of a frame.
    pub fn tick(&mut self, frame: i64, cell: &Cell<'_>, line: u64) {
        if let Ok(Some(time)) = self.numbers.read(cell) {
            self.stamps.push(Stamp { frame, time, line });
        } else if self.unreadable.is_none() {
            self.unreadable = Some((line, decode(cell)));
        }
    }

    /// Brings the times of a table in any order into the order of frames, the first of each frame only.
    pub fn sort(&mut self) {
        self.stamps.sort_by_key(|s| s.frame);
        self.stamps.dedup_by_key(|s| s.frame);
    }

    /// Most decimals of a time.
    pub fn decimals(&self) -> usize {
        self.numbers.most_decimals()
    }

    /// The time that `frame` has at `rate_hz` frames per second, in the unit of the column.
    pub fn time_of(&self, frame: i64, frame_step: i64, rate_hz: f64) -> Option<f64> {
        let first = self.stamps.first()?;
        let frames = (frame as f64 - first.frame as f64) / frame_step as f64;
        Some(first.time + frames / rate_hz / self.unit_secs.unwrap_or(1.0))
    }

    /// Frames per second; `None` if the column does not tell, after a note that says why.
    ///
    /// `frame_step` is the difference of the numbers of neighbouring frames.
    /// `numbered` is true if the file numbers its frames, so that an odd time is an odd time and not a lost row.
    ///
    /// # Errors
    /// Rows seem to be lost.
    pub fn rate_hz(&self, frame_step: i64, numbered: bool, notes: &Notes) -> Result<Option<f64>, FormatError> {
        let unused = |why: String| {
            notes.add(Note::Contradiction { text: format!("the time column was not used: {why}") });
            Ok(None)
        };
        if let Some((line, text)) = &self.unreadable {
            return unused(format!("\"{}\" in line {line} is not a number", excerpt(text)));
        }
        let (Some(first), Some(last)) = (self.stamps.first(), self.stamps.last()) else { return Ok(None) };
        let frames = (last.frame as f64 - first.frame as f64) / frame_step as f64;
        if frames < 1.0 {
            return Ok(None); // one frame has no rate, and that is nobody's fault
        }
        let step = (last.time - first.time) / frames;
        if step <= 0.0 {
            return unused("it does not go up".to_owned());
        }
        if self.unit_secs.is_none() && step >= LARGEST_STEP_SECS {
            return unused(format!(
                "it goes up by {step} from frame to frame, which are hardly seconds; name it \"time (ms)\" or the like"
            ));
        }
        let unit_secs = self.unit_secs.unwrap_or(1.0);
        let decimals = self.decimals();
        let rounding = number::step(decimals);
        let usual = self.median_step(frame_step).unwrap_or(step);
        for (a, b) in self.stamps.iter().zip(self.stamps.iter().skip(1)) {
            let between = (b.frame as f64 - a.frame as f64) / frame_step as f64;
            if ((b.time - a.time) / between - usual).abs() <= 0.5 * usual + rounding {
                continue;
            }
            if numbered {
                let text = format!(
                    "the time goes from {} to {} in line {}, the usual step is {usual:.decimals$}; frames were taken as equally spaced",
                    a.time, b.time, b.line
                );
                notes.add(Note::Contradiction { text });
                return Ok(Some(1.0 / (usual * unit_secs)));
            }
            let text = format!(
                "the time goes from {} to {}, the usual step is {usual:.decimals$}: rows seem to be missing; add them with empty cells, \
                 or say --rate to take the rows as equally spaced",
                a.time, b.time
            );
            return Err(FormatError::malformed(NAME, Place::Line { line: b.line, column: None }, text));
        }
        Ok(Some(simplest_rate(first.time * unit_secs, last.time * unit_secs, frames, rounding * unit_secs)))
    }

    fn median_step(&self, frame_step: i64) -> Option<f64> {
        let mut steps: Vec<f64> = self
            .stamps
            .iter()
            .zip(self.stamps.iter().skip(1))
            .map(|(a, b)| (b.time - a.time) / ((b.frame as f64 - a.frame as f64) / frame_step as f64))
            .collect();
        let middle = steps.len() / 2;
        steps.sort_by(f64::total_cmp);
        steps.get(middle).copied().filter(|s| *s > 0.0)
    }
}

/// The rate with the fewest decimals among those that the rounded times of the first and the last frame allow.
///
/// Times are in seconds, `rounding` is the step of their last decimal.
/// 0.00000 and 4.16667 after 100 steps are 24 Hz, not 23.99998 Hz.
pub(crate) fn simplest_rate(first: f64, last: f64, frames: f64, rounding: f64) -> f64 {
    let span = last - first;
    let rate = frames / span;
    let slack = rate * (rounding + 2.0 * f64::EPSILON * last.abs().max(first.abs())) / span;
    (0..16)
        .filter_map(|decimals| format!("{rate:.decimals$}").parse::<f64>().ok())
        .find(|simple| *simple > 0.0 && (simple - rate).abs() <= slack)
        .unwrap_or(rate)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn clock(times: &[&str], unit_secs: Option<f64>) -> Clock {
        let mut clock = Clock::new(b';', unit_secs);
        for (i, text) in (0..).zip(times) {
            let cell = Cell { text: text.as_bytes(), start: 0, quoted: false, ends_row: false };
            clock.tick(i, &cell, i.unsigned_abs() + 2);
        }
        clock
    }

    #[test]
    fn rates_from_rounded_times() {
        let at = |rate: f64, decimals: usize, frames: usize| {
            let times: Vec<String> = (0..frames).map(|i| format!("{:.decimals$}", i as f64 / rate)).collect();
            clock(&times.iter().map(String::as_str).collect::<Vec<_>>(), None).rate_hz(1, false, &Notes::new()).unwrap().unwrap()
        };
        assert_eq!(at(24.0, 5, 101), 24.0);
        assert_eq!(at(120.0, 4, 600), 120.0);
        assert_eq!(at(59.94, 6, 900), 59.94);
        assert_eq!(at(100.0, 2, 50), 100.0);
        assert_eq!(at(107.53, 15, 300), 107.53);
        assert!((at(120.0, 2, 1000) - 120.0).abs() < 0.3, "times that repeat because they are rounded");
    }

    #[test]
    fn times_in_other_units_and_shapes() {
        let rate = |times: &[&str], unit, numbered| {
            let notes = Notes::new();
            let rate = clock(times, unit).rate_hz(1, numbered, &notes);
            (rate.map_err(|e| e.to_string()), notes.take().iter().map(ToString::to_string).collect::<Vec<_>>())
        };
        assert_eq!(rate(&["0", "10", "20"], Some(1e-3), false), (Ok(Some(100.0)), vec![]));
        assert_eq!(rate(&["0,00", "0,01", "0,02"], None, false), (Ok(Some(100.0)), vec![]));
        assert_eq!(rate(&["0.5"], None, false), (Ok(None), vec![]));
        let unused = |why: &str| (Ok(None), vec![format!("the time column was not used: {why}")]);
        assert_eq!(
            rate(&["0", "10", "20"], None, false),
            unused("it goes up by 10 from frame to frame, which are hardly seconds; name it \"time (ms)\" or the like")
        );
        assert_eq!(rate(&["00:01", "00:02"], None, false), unused("\"00:01\" in line 2 is not a number"));
        assert_eq!(rate(&["3", "2"], None, false), unused("it does not go up"));
        let lost = ["0", "0.01", "0.02", "0.05", "0.06"];
        assert_eq!(
            rate(&lost, None, false).0.unwrap_err(),
            "csv: the time goes from 0.02 to 0.05, the usual step is 0.01: rows seem to be missing; add them with empty cells, \
             or say --rate to take the rows as equally spaced (line 5)"
        );
        let (rate, notes) = rate(&lost, None, true);
        assert!((rate.unwrap().unwrap() - 100.0).abs() < 1e-9);
        assert_eq!(
            notes,
            ["the time goes from 0.02 to 0.05 in line 5, the usual step is 0.01; frames were taken as equally spaced".to_owned()]
        );
    }
}
