//! What tracking did, for people, for scripts, and for the exit code.

use super::Request;
use super::seen::{Given, Seen};
use super::sequence::Sequence;
use crate::report::{count, lines, short};
use crate::rig::Rig;
use crate::runs::Stretch;
use crate::solve::track::Way;
use crate::typeset::{Style, Tone};
use formats::{Note, printable};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A part of the body that was lost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lost {
    /// The joint that moves it.
    pub part: String,
    /// When.
    pub when: Vec<Stretch>,
}

/// What was done.
#[derive(Clone, Debug)]
pub struct Report {
    /// The files of the clouds, as they were named.
    pub clouds: String,
    /// The file with the motion; `None` until it has its name.
    pub output: Option<PathBuf>,
    /// The table of frames.
    pub table: Option<PathBuf>,
    /// The log that was written.
    pub log: Option<PathBuf>,
    /// Why the log is not there although it was wanted.
    pub log_error: Option<String>,
    /// The report to look at.
    pub page: Option<PathBuf>,
    /// The files that would be written, if nothing was because nothing was to be.
    pub would_write: Option<Vec<PathBuf>>,
    /// Frames per second.
    pub rate_hz: f64,
    /// Unit of length of the rig, and of what was written.
    pub unit: &'static str,
    /// Number of joints.
    pub joints: usize,
    /// Number of degrees of freedom.
    pub freedom: usize,
    /// The method.
    pub method: &'static str,
    /// Number of frames.
    pub frames: usize,
    /// Of these, frames whose lost limbs were searched.
    pub searched: Vec<Stretch>,
    /// Frames without a file.
    pub missing: Vec<Stretch>,
    /// Frames whose file has no points.
    pub empty: Vec<Stretch>,
    /// Parts that were lost.
    pub lost: Vec<Lost>,
    /// Mean over frames of the root mean square distance of points from the body, cm; NaN without any.
    pub residual_cm: f64,
    /// Mean share of the points that belong to the body; NaN without any.
    pub inliers: f64,
    /// What was assumed or found odd.
    pub notes: Vec<Note>,
    /// How long reading and tracking took.
    pub took: Duration,
}

impl Report {
    /// Before anything was tracked.
    pub fn new(request: &Request, rig: &Rig) -> Self {
        Self {
            clouds: request.clouds.typed().to_owned(),
            output: None,
            table: None,
            log: None,
            log_error: None,
            page: None,
            would_write: request.dry_run.then(|| request.outputs().map(Path::to_path_buf).collect()),
            rate_hz: request.rate_hz,
            unit: rig.unit.symbol(),
            joints: rig.body.tree.joints(),
            freedom: rig.body.tree.freedom(),
            method: request.method_name(),
            frames: 0,
            searched: Vec::new(),
            missing: Vec::new(),
            empty: Vec::new(),
            lost: Vec::new(),
            residual_cm: f64::NAN,
            inliers: f64::NAN,
            notes: rig.notes.clone(),
            took: Duration::ZERO,
        }
    }

    /// Takes in which frames there are.
    pub fn foresee(&mut self, sequence: &Sequence) {
        self.frames = sequence.frames();
        let number = |at: usize| sequence.first + at as u32;
        self.missing = Stretch::all(self.frames, |at| number(at).into(), |at| !sequence.has(number(at)));
    }

    /// Takes in what became of the frames.
    pub fn judge(&mut self, frames: &[Seen], rig: &Rig) {
        self.frames = frames.len();
        let all = |holds: &dyn Fn(&Seen) -> bool| Stretch::all(frames.len(), |at| frames[at].number.into(), |at| holds(&frames[at]));
        self.searched = all(&|seen| seen.way == Way::Searched);
        self.missing = all(&|seen| seen.given == Given::Missing);
        self.empty = all(&|seen| seen.given == Given::Empty);
        let lost = rig
            .names()
            .enumerate()
            .map(|(part, name)| Lost { part: name.to_owned(), when: all(&|seen| seen.lost.get(part) == Some(&true)) });
        self.lost = lost.filter(|lost| !lost.when.is_empty()).collect();
        let mean = |value: fn(&Seen) -> f64| {
            let known: Vec<f64> = frames.iter().map(value).filter(|x| x.is_finite()).collect();
            known.iter().sum::<f64>() / known.len() as f64
        };
        self.residual_cm = mean(|seen| seen.residual_cm);
        self.inliers = mean(|seen| seen.inliers);
    }

    fn predicted(&self) -> usize {
        Stretch::total(&self.missing) + Stretch::total(&self.empty)
    }

    fn tracked(&self) -> usize {
        self.frames - self.predicted() - Stretch::total(&self.searched)
    }

    /// 0 if every frame was followed and nothing was assumed or lost, else 3. (Errors have their own codes.)
    pub fn exit_code(&self) -> u8 {
        let matters = self.notes.iter().any(Note::matters) || self.predicted() > 0 || !self.lost.is_empty() || self.log_error.is_some();
        if matters { 3 } else { 0 }
    }

    /// Name and value pairs for the log's metadata.
    pub fn results(&self) -> Vec<(String, String)> {
        let number = |x: f64| if x.is_finite() { format!("{x:.4}") } else { "none".to_owned() };
        [
            ("frames", self.frames.to_string()),
            ("frames_tracked", self.tracked().to_string()),
            ("frames_searched", Stretch::total(&self.searched).to_string()),
            ("frames_predicted", self.predicted().to_string()),
            ("parts_lost", self.lost.len().to_string()),
            ("residual_cm", number(self.residual_cm)),
            ("inliers", number(self.inliers)),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into()
    }

    /// For people.
    pub fn text(&self, style: &Style) -> String {
        let mut out = match (&self.output, &self.would_write) {
            (Some(output), _) => style.way(&self.clouds, &output.display().to_string()),
            (None, Some(_)) => style.toned(Tone::Title, &format!("{} (dry run, nothing was written)", self.clouds)) + "\n",
            (None, None) => String::new(),
        };
        let mut line = |head: &str, text: String| out.push_str(&style.item(head, &text));
        let seconds = self.frames as f64 / self.rate_hz;
        line("take", format!("{} at {} Hz ({seconds:.1} s), in {}", count(self.frames, "frame"), short(self.rate_hz), self.unit));
        line("body", format!("{} with {} degrees of freedom", count(self.joints, "joint"), self.freedom));
        let searched = match Stretch::total(&self.searched) {
            0 => String::new(),
            frames => format!(", {} after a search for limbs", count(frames, "frame")),
        };
        let secs = self.took.as_secs_f64();
        let pace = if secs > 0.0 { format!(", {:.0} frames/s", self.frames as f64 / secs) } else { String::new() };
        let frames = count(self.tracked() + Stretch::total(&self.searched), "frame");
        if self.would_write.is_some() {
            line("to track", format!("{frames} by {}", self.method));
        } else {
            line("tracked", format!("{frames} by {}{searched}{pace}", self.method));
        }
        if self.residual_cm.is_finite() {
            let share = 100.0 * self.inliers;
            line("points", format!("{:.2} cm from the body, {share:.0} % belong to it (means over frames)", self.residual_cm));
        }
        for (stretches, why) in [(&self.missing, "without a file"), (&self.empty, "without points")] {
            if !stretches.is_empty() {
                line("predicted", format!("{} {why}: {}", count(Stretch::total(stretches), "frame"), Stretch::listed(stretches)));
            }
        }
        for lost in &self.lost {
            line(
                "lost",
                format!("{} in {}: {}", printable(&lost.part), count(Stretch::total(&lost.when), "frame"), Stretch::listed(&lost.when)),
            );
        }
        for note in &self.notes {
            line(if note.matters() { "look at" } else { "note" }, note.to_string());
        }
        if let Some(error) = &self.log_error {
            line("no log", error.clone());
        }
        for (head, path) in [("log", &self.log), ("frames", &self.table), ("report", &self.page)] {
            out.extend(path.iter().map(|path| style.name(head, &path.display().to_string())));
        }
        out.extend(self.would_write.iter().flatten().map(|path| style.name("to write", &path.display().to_string())));
        out
    }

    /// As JSON lines: notes, gaps, lost parts, then the summary.
    pub fn json(&self) -> String {
        self.json_of(|path| path.display().to_string())
    }

    /// The same for the log, which must not depend on where it lies: without folders.
    pub fn json_for_log(&self) -> String {
        self.json_of(|path| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default())
    }

    fn json_of(&self, name: impl Fn(&Path) -> String) -> String {
        #[derive(Serialize)]
        #[serde(tag = "message_type", rename_all = "snake_case")]
        #[allow(clippy::large_enum_variant)] // a handful, written and forgotten
        enum Message<'a> {
            Note {
                kind: &'a str,
                text: String,
                matters: bool,
            },
            Predicted {
                why: &'a str,
                #[serde(flatten)]
                stretch: Stretch,
            },
            Lost {
                part: &'a str,
                #[serde(flatten)]
                stretch: Stretch,
            },
            Tracked {
                clouds: String,
                output: Option<String>,
                table: Option<String>,
                log: Option<String>,
                log_error: Option<&'a str>,
                report: Option<String>,
                dry_run: bool,
                method: &'a str,
                rate_hz: f64,
                unit: &'a str,
                joints: usize,
                degrees_of_freedom: usize,
                frames: usize,
                frames_tracked: usize,
                frames_searched: usize,
                frames_predicted: usize,
                parts_lost: Vec<&'a str>,
                residual_cm: Option<f64>,
                inliers: Option<f64>,
                exit_code: u8,
            },
        }
        let mut messages: Vec<Message> =
            self.notes.iter().map(|n| Message::Note { kind: n.kind(), text: n.to_string(), matters: n.matters() }).collect();
        for (why, stretches) in [("missing", &self.missing), ("empty", &self.empty)] {
            messages.extend(stretches.iter().map(|&stretch| Message::Predicted { why, stretch }));
        }
        for lost in &self.lost {
            messages.extend(lost.when.iter().map(|&stretch| Message::Lost { part: &lost.part, stretch }));
        }
        let path = |path: &Option<PathBuf>| path.as_deref().map(&name);
        messages.push(Message::Tracked {
            clouds: name(Path::new(&self.clouds)),
            output: path(&self.output),
            table: path(&self.table),
            log: path(&self.log),
            log_error: self.log_error.as_deref(),
            report: path(&self.page),
            dry_run: self.would_write.is_some(),
            method: self.method,
            rate_hz: self.rate_hz,
            unit: self.unit,
            joints: self.joints,
            degrees_of_freedom: self.freedom,
            frames: self.frames,
            frames_tracked: self.tracked(),
            frames_searched: Stretch::total(&self.searched),
            frames_predicted: self.predicted(),
            parts_lost: self.lost.iter().map(|lost| lost.part.as_str()).collect(),
            residual_cm: Some(self.residual_cm).filter(|x| x.is_finite()),
            inliers: Some(self.inliers).filter(|x| x.is_finite()),
            exit_code: self.exit_code(),
        });
        lines(&messages)
    }
}
