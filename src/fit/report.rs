//! What came of the motion, for people, for scripts, and for the exit code.

use super::{Fitted, Request, Turn};
use crate::input::Opened;
use crate::report::{count, lines, short};
use crate::rig::Rig;
use crate::rig::map::Worn;
use crate::runs::Stretch;
use crate::solve::ik::terms::Marker;
use crate::solve::markers::{Calibration, Told};
use crate::typeset::{Style, Tone};
use formats::{Note, Take, printable};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A marker that is farther than this from its place is on another one, cm ...
const STRANGE_CM: f64 = 5.0;
/// ... if it is also so many times as far as the one in the middle: then it is not the body that does not fit.
const STRANGE_TIMES: f64 = 3.0;
/// A joint that carries others is a guess if nothing was seen of it for longer than this, s: limbs are centimetres off by then ...
const GUESSED_SECS: f64 = 0.2;
/// ... and one that carries none after this: it only turns about a place that is known.
const GUESSED_END_SECS: f64 = 0.5;
/// The most names in a line.
const MOST_NAMES: usize = 12;

/// How well a marker fits.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerReport {
    /// Its label.
    pub label: String,
    /// The joint that moves it.
    pub joint: String,
    /// Frames in which it was seen.
    pub frames: usize,
    /// Root mean square distance from its place, cm; NaN if it was never seen.
    pub rms_cm: f64,
    /// The largest one, cm.
    pub worst_cm: f64,
    /// The take's number of that frame.
    pub worst_frame: i64,
    /// False if the pose does not depend on it.
    pub counts: bool,
}

/// What was found out about a body from the take.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibrated {
    /// The size of the body against that of the rig.
    pub size: f64,
    /// For each joint whose bone has a length, its name, and how long the bone is against that of the rig.
    pub bones: Vec<(String, f64)>,
    /// Root mean square distance of markers from their places, cm.
    pub rms_cm: f64,
    /// True if no size beyond that was tried.
    pub at_edge: bool,
}

impl Calibrated {
    /// What a calibration found.
    pub fn new(found: &Calibration, rig: &Rig) -> Self {
        let bones = rig.names().zip(&found.scales).filter(|(_, scale)| **scale != 1.0);
        let bones = bones.map(|(name, scale)| (name.to_owned(), scale * found.size)).collect();
        Self { size: found.size, bones, rms_cm: found.rms_cm, at_edge: found.at_edge }
    }
}

/// A joint of which nothing was seen for a while: neither its own markers nor those of what hangs on it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unseen {
    /// The joint.
    pub joint: String,
    /// When.
    pub when: Vec<Stretch>,
    /// Those of them that are so long that where the joint was is a guess.
    pub guessed: Vec<Stretch>,
    /// True if the joint that carries it is a guess in all of them as well.
    pub carried: bool,
}

/// What was done.
#[derive(Clone, Debug)]
pub struct Report {
    /// The take.
    pub input: PathBuf,
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
    /// Number of frames.
    pub frames: usize,
    /// Unit of length of the rig, and of what was written.
    pub unit: &'static str,
    /// Number of joints.
    pub joints: usize,
    /// Number of degrees of freedom.
    pub freedom: usize,
    /// How the take was turned to the axes of the rig.
    pub turned: Option<Turn>,
    /// What was found out about the body, if that was asked for.
    pub calibrated: Option<Calibrated>,
    /// The markers.
    pub markers: Vec<MarkerReport>,
    /// Markers of the map that the take does not have.
    pub absent: Vec<String>,
    /// Markers of the take on which the pose does not depend.
    pub unused: Vec<String>,
    /// Joints of which no marker says anything in any frame.
    pub unobserved: Vec<String>,
    /// Joints of which nothing was seen for a while.
    pub unseen: Vec<Unseen>,
    /// Frames in which no marker was seen at all.
    pub predicted: Vec<Stretch>,
    /// Root mean square distance of all samples, cm; NaN without any.
    pub rms_cm: f64,
    /// What was assumed or found odd.
    pub notes: Vec<Note>,
    /// How long solving took.
    pub solve_took: Duration,
    /// How long reading and solving took.
    pub took: Duration,
}

impl Report {
    /// Before anything was solved.
    pub fn new(request: &Request, rig: &Rig, opened: &Opened, turned: Option<Turn>) -> Self {
        let take = opened.document.take();
        let mut notes = rig.notes.clone();
        notes.extend(opened.notes.take());
        Self {
            input: request.input.clone(),
            output: None,
            table: None,
            log: None,
            log_error: None,
            page: None,
            would_write: request.dry_run.then(|| request.outputs().map(Path::to_path_buf).collect()),
            rate_hz: take.rate_hz,
            frames: take.frames(),
            unit: rig.unit.symbol(),
            joints: rig.body.tree.joints(),
            freedom: rig.body.tree.freedom(),
            turned,
            calibrated: None,
            markers: Vec::new(),
            absent: Vec::new(),
            unused: Vec::new(),
            unobserved: Vec::new(),
            unseen: Vec::new(),
            predicted: Vec::new(),
            rms_cm: f64::NAN,
            notes,
            solve_took: Duration::ZERO,
            took: Duration::ZERO,
        }
    }

    /// Takes in which markers there are.
    pub fn foresee(&mut self, take: &Take, worn: &Worn, rig: &Rig) {
        let names: Vec<&str> = rig.names().collect();
        self.absent.clone_from(&worn.absent);
        let markers = worn.markers.iter().map(|(column, label, marker, weight)| MarkerReport {
            label: label.clone(),
            joint: names.get(marker.part).copied().unwrap_or_default().to_owned(),
            frames: (0..take.frames()).filter(|&frame| take.position_mm(frame, *column).is_some()).count(),
            rms_cm: f64::NAN,
            worst_cm: f64::NAN,
            worst_frame: take.frame_label(0),
            counts: *weight > 0.0,
        });
        self.markers = markers.collect();
        self.unused.clone_from(&worn.strangers);
        self.unused.extend(self.markers.iter().filter(|m| !m.counts || m.frames == 0).map(|m| m.label.clone()));
    }

    /// Takes in what became of the markers.
    pub fn judge(&mut self, fitted: &Fitted<'_>, rig: &Rig) {
        let names: Vec<&str> = rig.names().collect();
        self.absent.clone_from(&fitted.worn.absent);
        self.markers = (0..fitted.worn.markers.len()).map(|at| marker(fitted, at, &names)).collect();
        self.unused.clone_from(&fitted.worn.strangers);
        self.unused.extend(self.markers.iter().filter(|m| !m.counts || m.frames == 0).map(|m| m.label.clone()));
        let (squares, samples) = self.markers.iter().filter(|m| m.counts && m.frames > 0).fold((0.0, 0.0), |(squares, samples), m| {
            let frames = m.frames as f64;
            (squares + m.rms_cm * m.rms_cm * frames, samples + frames)
        });
        self.rms_cm = (squares / samples).sqrt();
        // which joints the markers of each frame tell of
        let tree = &rig.body.tree;
        let of_map: Vec<Marker> = fitted.worn.markers.iter().map(|(_, _, marker, _)| *marker).collect();
        let told = Told::new(tree, &of_map, &fitted.seen);
        let stretches = |holds: &dyn Fn(usize) -> bool| Stretch::all(told.frames(), |frame| fitted.take.frame_label(frame), holds);
        self.predicted = stretches(&|frame| told.nothing(frame));
        for (joint, name) in names.iter().enumerate() {
            let when = stretches(&|frame| !told.of(frame, joint) && !told.nothing(frame));
            if (0..told.frames()).all(|frame| !told.of(frame, joint)) {
                self.unobserved.push((*name).to_owned());
            } else if !when.is_empty() {
                let most = if tree.children(joint) > 0 { GUESSED_SECS } else { GUESSED_END_SECS } * self.rate_hz;
                let above = tree.links[joint].parent.and_then(|parent| names.get(parent));
                let above = self.unseen.iter().find(|unseen| Some(&unseen.joint.as_str()) == above);
                let above: &[Stretch] = above.map_or(&[], |above| &above.guessed);
                let guessed = when.iter().copied().filter(|when| when.frames as f64 > most || above.contains(when));
                let guessed: Vec<Stretch> = guessed.collect();
                let carried = guessed.iter().all(|one| above.contains(one));
                self.unseen.push(Unseen { joint: (*name).to_owned(), when, guessed, carried });
            }
        }
    }

    /// The marker that fits worst of those that count.
    pub fn worst(&self) -> Option<&MarkerReport> {
        self.markers.iter().filter(|m| m.counts && m.rms_cm.is_finite()).max_by(|a, b| a.rms_cm.total_cmp(&b.rms_cm))
    }

    /// Markers that are so far from their places that they sit somewhere else, or are called like others.
    pub fn strange(&self) -> Vec<&MarkerReport> {
        let counted = || self.markers.iter().filter(|m| m.counts && m.rms_cm.is_finite());
        let mut all: Vec<f64> = counted().map(|m| m.rms_cm).collect();
        all.sort_by(f64::total_cmp);
        let middle = all.get(all.len() / 2).copied().unwrap_or_default();
        counted().filter(|m| m.rms_cm > STRANGE_CM.max(STRANGE_TIMES * middle)).collect()
    }

    /// Number of markers on which the pose depends.
    pub fn used(&self) -> usize {
        self.markers.iter().filter(|m| m.counts && m.frames > 0).count()
    }

    /// Markers of the map that the take has, but never shows.
    pub fn never_seen(&self) -> Vec<String> {
        self.markers.iter().filter(|m| m.counts && m.frames == 0).map(|m| m.label.clone()).collect()
    }

    /// Why somebody should look at it, each with what it is about: the exit code is 3 if there is any reason. Those of notes and of the log are told besides.
    pub fn reasons(&self) -> Vec<(&'static str, String)> {
        let mut reasons = Vec::new();
        let mut say = |head: &'static str, text: String| reasons.push((head, text));
        if !self.absent.is_empty() {
            say("not there", format!("markers of the map that the take does not have: {}", listed(&self.absent)));
        }
        let never = self.never_seen();
        if !never.is_empty() {
            say("not there", format!("markers of the map that are not seen in any frame: {}", listed(&never)));
        }
        if let Some(Calibrated { size, .. }) = self.calibrated.as_ref().filter(|calibrated| calibrated.at_edge) {
            let text = format!(
                "of the sizes that were tried, {:.0} % of the rig fits best and is the last one: another unit, another body, or markers on other parts?",
                100.0 * size
            );
            say("look at", text);
        }
        if self.rms_cm > STRANGE_CM {
            let text = "is far for a body that fits: another unit of length (--units), another body, or the map of another take?";
            say("look at", format!("{:.2} cm from their places (root mean square) {text}", self.rms_cm));
        }
        let strange = self.strange();
        if !strange.is_empty() {
            let names: Vec<String> = strange.iter().map(|m| m.label.clone()).collect();
            let verb = if names.len() == 1 { "is" } else { "are" };
            say("look at", format!("{} {verb} far from where the map has them: labels swapped, or another vertex?", listed(&names)));
        }
        if !self.predicted.is_empty() {
            let text =
                format!("{} without any marker: {}", count(Stretch::total(&self.predicted), "frame"), Stretch::listed(&self.predicted));
            say("predicted", text);
        }
        if !self.unobserved.is_empty() {
            say("unknown", format!("no marker tells how these joints turn: {}", listed(&self.unobserved)));
        }
        for unseen in self.unseen.iter().filter(|unseen| !unseen.guessed.is_empty() && !unseen.carried) {
            let frames = count(Stretch::total(&unseen.guessed), "frame");
            let text = format!(
                "{} and what hangs on it had no marker for long, in {frames}: {}; its pose there is a guess",
                printable(&unseen.joint),
                Stretch::listed(&unseen.guessed)
            );
            say("look at", text);
        }
        reasons
    }

    /// 3 if there is a reason to look at it, something was assumed or lost, or there is no log, else 0. (Errors have their own codes.)
    pub fn exit_code(&self) -> u8 {
        if !self.reasons().is_empty() || self.log_error.is_some() || self.notes.iter().any(Note::matters) { 3 } else { 0 }
    }

    /// Name and value pairs for the log's metadata.
    pub fn results(&self) -> Vec<(String, String)> {
        [
            ("markers_used", self.used().to_string()),
            ("markers_absent", self.absent.len().to_string()),
            ("frames_predicted", Stretch::total(&self.predicted).to_string()),
            ("joints_unobserved", self.unobserved.len().to_string()),
            ("rms_cm", if self.rms_cm.is_finite() { format!("{:.4}", self.rms_cm) } else { "none".to_owned() }),
            ("worst_marker", self.worst().map_or_else(|| "none".to_owned(), |m| m.label.clone())),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into()
    }

    /// For people.
    pub fn text(&self, style: &Style) -> String {
        let input = self.input.display().to_string();
        let mut out = match (&self.output, &self.would_write) {
            (Some(output), _) => style.way(&input, &output.display().to_string()),
            (None, Some(_)) => style.toned(Tone::Title, &format!("{input} (dry run, nothing was written)")) + "\n",
            (None, None) => String::new(),
        };
        let mut line = |head: &str, text: String| out.push_str(&style.item(head, &text));
        let seconds = self.frames as f64 / self.rate_hz;
        line("take", format!("{} at {} Hz ({seconds:.1} s)", count(self.frames, "frame"), short(self.rate_hz)));
        line("body", format!("{} with {} degrees of freedom, in {}", count(self.joints, "joint"), self.freedom, self.unit));
        if let Some((from, to)) = self.turned {
            line("turned", format!("the take has {from} up and the body has {to} up, so the take was turned"));
        }
        if let Some(Calibrated { size, bones, .. }) = &self.calibrated {
            let percent = |x: f64| format!("{:.1} %", 100.0 * x);
            let (least, most) = bones.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), (_, x)| (a.min(*x), b.max(*x)));
            let bones = if bones.is_empty() { String::new() } else { format!(", its bones {} to {}", percent(least), percent(most)) };
            line("calibrated", format!("the body has {} of the size of the rig{bones}", percent(*size)));
        }
        let all = self.used() + self.unused.len();
        let fits =
            if self.rms_cm.is_finite() { format!(", {:.2} cm from their places (root mean square)", self.rms_cm) } else { String::new() };
        line("markers", format!("{} of {all} are used{fits}", self.used()));
        if let Some(worst) = self.worst() {
            let MarkerReport { label, rms_cm, worst_cm, worst_frame, .. } = worst;
            line("worst", format!("{label}, {rms_cm:.2} cm, at most {worst_cm:.2} cm in frame {worst_frame}"));
        }
        let pace = self.frames as f64 / self.solve_took.as_secs_f64();
        if pace.is_finite() {
            line("solved", format!("{pace:.0} frames/s"));
        }
        if !self.unused.is_empty() {
            line("not used", listed(&self.unused));
        }
        for (head, text) in self.reasons() {
            line(head, text);
        }
        for unseen in &self.unseen {
            let frames = count(Stretch::total(&unseen.when), "frame");
            line("unseen", format!("{} in {frames}: {}", printable(&unseen.joint), Stretch::listed(&unseen.when)));
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

    /// As JSON lines: notes, markers, frames without markers, joints of which nothing was seen, then the summary.
    pub fn json(&self) -> String {
        self.json_of(|path| path.display().to_string())
    }

    /// The same for the log, which must not depend on where it lies: without folders.
    pub fn json_for_log(&self) -> String {
        self.json_of(|path| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default())
    }

    fn json_of(&self, name: impl Fn(&Path) -> String) -> String {
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        let mut messages: Vec<Message> =
            self.notes.iter().map(|n| Message::Note { kind: n.kind(), text: n.to_string(), matters: n.matters() }).collect();
        let strange: Vec<&str> = self.strange().iter().map(|m| m.label.as_str()).collect();
        messages.extend(self.markers.iter().map(|m| Message::Marker {
            marker: &m.label,
            joint: &m.joint,
            used: m.counts && m.frames > 0,
            frames: m.frames,
            rms_cm: finite(m.rms_cm),
            worst_cm: finite(m.worst_cm),
            worst_frame: Some(m.worst_frame).filter(|_| m.frames > 0),
            strange: strange.contains(&m.label.as_str()),
        }));
        messages.extend(self.predicted.iter().map(|&stretch| Message::Predicted { why: "no-markers", stretch }));
        for unseen in &self.unseen {
            let guessed = |stretch: &Stretch| unseen.guessed.contains(stretch);
            messages.extend(unseen.when.iter().map(|&stretch| Message::Unseen {
                joint: &unseen.joint,
                guessed: guessed(&stretch),
                stretch,
            }));
        }
        let path = |path: &Option<PathBuf>| path.as_deref().map(&name);
        messages.push(Message::Solved {
            input: name(&self.input),
            output: path(&self.output),
            table: path(&self.table),
            log: path(&self.log),
            log_error: self.log_error.as_deref(),
            report: path(&self.page),
            dry_run: self.would_write.is_some(),
            rate_hz: self.rate_hz,
            frames: self.frames,
            unit: self.unit,
            joints: self.joints,
            degrees_of_freedom: self.freedom,
            turned: self.turned.map(|(from, to)| [from.to_string(), to.to_string()]),
            calibrated: self.calibrated.as_ref(),
            markers_used: self.used(),
            markers_unused: &self.unused,
            markers_absent: &self.absent,
            rms_cm: finite(self.rms_cm),
            worst_marker: self.worst().map(|m| m.label.as_str()),
            frames_predicted: Stretch::total(&self.predicted),
            joints_unobserved: &self.unobserved,
            look_at: self.reasons().into_iter().map(|(_, text)| text).collect(),
            exit_code: self.exit_code(),
        });
        lines(&messages)
    }
}

/// What scripts are told.
#[derive(Serialize)]
#[serde(tag = "message_type", rename_all = "snake_case")]
#[allow(clippy::large_enum_variant)] // a handful, written and forgotten
enum Message<'a> {
    Note {
        kind: &'a str,
        text: String,
        matters: bool,
    },
    Marker {
        marker: &'a str,
        joint: &'a str,
        used: bool,
        frames: usize,
        rms_cm: Option<f64>,
        worst_cm: Option<f64>,
        worst_frame: Option<i64>,
        strange: bool,
    },
    Predicted {
        why: &'a str,
        #[serde(flatten)]
        stretch: Stretch,
    },
    Unseen {
        joint: &'a str,
        guessed: bool,
        #[serde(flatten)]
        stretch: Stretch,
    },
    Solved {
        input: String,
        output: Option<String>,
        table: Option<String>,
        log: Option<String>,
        log_error: Option<&'a str>,
        report: Option<String>,
        dry_run: bool,
        rate_hz: f64,
        frames: usize,
        unit: &'a str,
        joints: usize,
        degrees_of_freedom: usize,
        turned: Option<[String; 2]>,
        #[serde(skip_serializing_if = "Option::is_none")]
        calibrated: Option<&'a Calibrated>,
        markers_used: usize,
        markers_unused: &'a [String],
        markers_absent: &'a [String],
        rms_cm: Option<f64>,
        worst_marker: Option<&'a str>,
        frames_predicted: usize,
        joints_unobserved: &'a [String],
        look_at: Vec<String>,
        exit_code: u8,
    },
}

/// The first of many names, and how many more there are.
fn listed(names: &[String]) -> String {
    let shown: Vec<String> = names.iter().take(MOST_NAMES).map(|name| printable(name)).collect();
    let more = names.len() - shown.len();
    if more > 0 { format!("{} and {more} more", shown.join(", ")) } else { shown.join(", ") }
}

fn marker(fitted: &Fitted<'_>, at: usize, names: &[&str]) -> MarkerReport {
    let (_, label, marker, _) = &fitted.worn.markers[at];
    let (mut frames, mut squares, mut worst) = (0, 0.0, (f64::NAN, 0));
    for frame in 0..fitted.frames() {
        let x = fitted.row(frame)[at];
        if x.is_finite() {
            frames += 1;
            squares += x * x;
            // a worst one that is not a number yet is smaller than any
            if worst.0.is_nan() || x > worst.0 {
                worst = (x, frame);
            }
        }
    }
    MarkerReport {
        label: label.clone(),
        joint: names.get(marker.part).copied().unwrap_or_default().to_owned(),
        frames,
        rms_cm: (squares / frames as f64).sqrt(),
        worst_cm: worst.0,
        worst_frame: fitted.take.frame_label(worst.1),
        counts: fitted.counts(at),
    }
}
