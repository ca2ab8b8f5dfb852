//! The MCAP log: a file that shows how a repair went, for Foxglove, Lichtblick and whoever reads MCAP.
//!
//! What is in it, in which units and when, is described in `docs/mcap-log.md`; the channels are listed in `channels.rs`.
//! The life of a log: [`McapLog::create`], then it observes the stages of one repair, then [`McapLog::finish`].
//!
//! The messages of the iterations are small, so they wait in memory and are merged with those of the frames at the end, in the order of
//! their times. Hence the solver's loop does no I/O.
//! Until the end the file has a temporary name next to the final one.
//! A run that is killed, or drops the log, leaves the final name as it was.

use super::channels::{Channel, tick_ns, timestamp};
use super::events::{self, Event};
use super::frames::{Frames, Shown};
use super::metadata::{Stage, metadata};
use super::sink::{Sink, Topic};
use super::{BoneResiduals, axes, describe, layout, schema};
use crate::report::count;
use crate::solve::{Observer, Outcome, Start, Step};
use crate::staging;
use ::mcap::McapError;
use formats::Direction;
use prost::Message;
use rayon::prelude::*;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tempfile::NamedTempFile;

/// The highest frame rate for which two iterations never fall on the same nanosecond.
const HIGHEST_RATE_HZ: f64 = 1e9;

/// Frames whose messages are made at once, on all cores, before they are written.
const BLOCK: usize = 256;

/// What is known about a repair before it starts. All of it goes into the metadata record, except where stated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct About {
    /// The file that was read, without folders: the log of a take must not depend on where the take lies.
    pub source_name: String,
    /// SHA-256 of that file, as lower-case hexadecimal digits.
    pub source_sha256: String,
    /// Frames per second. Iterations are spaced by it as well.
    pub rate_hz: f64,
    /// The file's own number of frame 0.
    pub first_frame: i64,
    /// Number of frames.
    pub frames: usize,
    /// Number of markers of the take.
    pub markers: usize,
    /// Number of bones.
    pub bones: usize,
    /// Which axis points up.
    pub up: Up,
    /// Unit of length of the file, such as `mm`.
    pub unit: String,
    /// Seed of the random numbers.
    pub seed: u64,
    /// The method that was asked for. The metadata also names the method of each stage.
    pub method: String,
    /// Effective options as (name, value); written as `option.<name>`. If a name occurs twice, the last value counts.
    pub options: Vec<(String, String)>,
    /// True to write computing times into `elapsed_s`. Then the same input no longer gives the same bytes.
    pub timings: bool,
}

/// Which axis of a take points up, and who says so.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Up {
    /// The file.
    Stated(Direction),
    /// The shape of what moves.
    Guessed(Direction),
    /// Nobody.
    #[default]
    Unknown,
}

impl Up {
    /// The axis, if there is one.
    pub fn direction(self) -> Option<Direction> {
        match self {
            Self::Stated(direction) | Self::Guessed(direction) => Some(direction),
            Self::Unknown => None,
        }
    }

    /// In words.
    pub fn text(self) -> String {
        match self {
            Self::Stated(direction) => direction.to_string(),
            Self::Guessed(direction) => format!("{direction} (guessed)"),
            Self::Unknown => "not stated".to_owned(),
        }
    }
}

/// How the repair ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ended {
    /// The take was written.
    #[default]
    Done,
    /// Somebody stopped it; no take was written.
    Interrupted,
    /// It broke down; no take was written.
    Failed,
}

impl Ended {
    /// One word, for the metadata.
    pub fn word(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Interrupted => "interrupted",
            Self::Failed => "failed",
        }
    }
}

/// What is known about a repair when it is over.
#[derive(Clone, Debug, Default)]
pub struct Closing<'a> {
    /// How it ended.
    pub ended: Ended,
    /// Results as (name, value); written into the metadata record as `result.<name>`. If a name occurs twice, the last value counts.
    pub results: Vec<(String, String)>,
    /// Files to put into the log, in this order, before those that the log makes itself.
    pub attachments: Vec<Attachment>,
    /// The take itself, for the topics with one message per frame.
    pub shown: Option<Shown<'a>>,
    /// What is to be told in words, besides the course of the iterations.
    pub events: Vec<Event>,
}

/// A file inside the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// File name.
    pub name: String,
    /// Media type, such as `application/json`.
    pub media_type: String,
    /// Content.
    pub bytes: Vec<u8>,
}

/// A log that was written, checked, and has its final name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// Number of messages, over all topics.
    pub messages: u64,
    /// Size of the file.
    pub bytes: u64,
}

/// A log that was written and checked, and still has a hidden name. Dropped, it is gone.
#[derive(Debug)]
pub struct Whole {
    path: PathBuf,
    file: NamedTempFile,
    written: Written,
}

impl Whole {
    /// A log that was proven.
    pub(super) fn new(path: PathBuf, file: NamedTempFile, written: Written) -> Self {
        Self { path, file, written }
    }

    /// Gives the log its name, replacing what had that name before.
    ///
    /// # Errors
    /// It could not be renamed; what had the name before is still there.
    pub fn place(self) -> Result<Written, LogError> {
        self.file.persist(&self.path).map_err(|e| e.error)?;
        Ok(self.written)
    }
}

/// Why a log could not be written. The path is added once, by the caller.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The take cannot be put on a time axis, or the name cannot be that of a log.
    #[error("{0}")]
    Unsupported(String),
    /// The file could not be written or read back.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The MCAP library refused.
    #[error("mcap: {0}")]
    Mcap(#[source] McapError),
    /// The file was written, but reading it back gives something else.
    #[error("the log was written but does not read back: {0}; nothing was put in place, try another disk")]
    Check(String),
}

impl From<McapError> for LogError {
    fn from(error: McapError) -> Self {
        // The library's text for an I/O error does not say what happened; the error inside does.
        match error {
            McapError::Io(error) => Self::Io(error),
            other => Self::Mcap(other),
        }
    }
}

/// A message that waits to be written.
#[derive(Debug)]
struct Waiting {
    channel: Channel,
    log_time: u64,
    data: Vec<u8>,
}

/// Writes the MCAP log of one repair.
///
/// [`create`](Self::create) it, let it observe every stage of the repair, then [`finish`](Self::finish) it.
/// One that is dropped unfinished leaves nothing behind.
/// Nothing can go wrong while it observes; errors come from `create` and `finish`.
#[derive(Debug)]
pub struct McapLog {
    path: PathBuf,
    file: NamedTempFile,
    about: About,
    waiting: Vec<Waiting>,
    /// Iterations with a likelihood so far, over all stages.
    iterations: u32,
    stages: Vec<Stage>,
    /// What models gave reason to say, in the order of iterations.
    told: Vec<Event>,
    /// The bones of the stage at hand, made at its first iteration.
    bones: Option<BoneResiduals>,
    /// Log-likelihood of the previous iteration of the stage at hand, in nats.
    before: Option<f64>,
    /// When the first stage began; stays `None` without timings.
    began: Option<Instant>,
}

impl McapLog {
    /// Begins a log that will be called `path`, in a hidden temporary file of the same folder.
    ///
    /// # Errors
    /// The frame rate makes no time axis, `path` is a folder or has no file name, or the folder cannot be written to.
    pub fn create(path: &Path, about: About) -> Result<Self, LogError> {
        if !(about.rate_hz > 0.0 && about.rate_hz <= HIGHEST_RATE_HZ) {
            return Err(LogError::Unsupported(format!(
                "the frame rate is {} Hz, a log needs one above 0 and up to {HIGHEST_RATE_HZ}; say it with --rate",
                about.rate_hz
            )));
        }
        if path.is_dir() || path.file_name().is_none() {
            return Err(LogError::Unsupported("a folder was found where the log should be written; name a file".to_owned()));
        }
        Ok(Self {
            path: path.to_owned(),
            file: staging::beside(path)?,
            about,
            waiting: Vec::new(),
            iterations: 0,
            stages: Vec::new(),
            told: Vec::new(),
            bones: None,
            before: None,
            began: None,
        })
    }

    /// Writes everything, syncs the file, reads it back, and only then gives it its name, replacing what had that name before.
    ///
    /// # Errors
    /// The file could not be written, does not read back as it was written, or could not be renamed. What had the name before is still there.
    pub fn finish(self, closing: &Closing<'_>) -> Result<Written, LogError> {
        self.write(closing)?.place()
    }

    /// Writes everything, syncs the file and reads it back. What comes out only lacks its name.
    ///
    /// # Errors
    /// The file could not be written, or does not read back as it was written.
    pub fn write(mut self, closing: &Closing<'_>) -> Result<Whole, LogError> {
        let about = &self.about;
        let mut attachments = closing.attachments.clone();
        if let Some(shown) = &closing.shown {
            attachments.push(describe::attachment(about, shown));
            attachments.push(layout::attachment(about, shown, &self.stages));
        }
        let metadata = metadata(about, self.iterations, &self.stages, closing);
        let frames = closing.shown.map(|shown| Frames::new(shown, about.rate_hz));
        let mut waiting = std::mem::take(&mut self.waiting);
        waiting.extend(axes::transform(about.up).map(|m| Waiting { channel: Channel::Axes, log_time: 0, data: m.encode_to_vec() }));
        let events = self.told.iter().chain(&closing.events).map(|event| {
            let log_time = tick_ns(event.frame as u32, about.rate_hz);
            Waiting { channel: Channel::Log, log_time, data: events::message(event, about, timestamp(log_time)).encode_to_vec() }
        });
        waiting.extend(events);
        // stable: what was told first stays first
        waiting.sort_by_key(|w| (w.log_time, w.channel as u8));

        let topics =
            Channel::ALL.map(|channel| Topic { name: channel.topic(), schema: channel.schema(), descriptor: channel.descriptor() });
        let mut sink = Sink::over(&self.path, self.file, &topics)?;
        write(&mut sink, &waiting, frames.as_ref(), about.rate_hz)?;
        sink.finish(&attachments, metadata)
    }

    /// The path that the log will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Queues a message. Called in the order of `log_time`.
    fn add(&mut self, channel: Channel, log_time: u64, message: &impl Message) {
        self.waiting.push(Waiting { channel, log_time, data: message.encode_to_vec() });
    }

    /// Notes what the beginning or end of a model gives reason to say.
    fn say(&mut self, iteration: u32, warning: bool, name: &str, message: String) {
        self.told.push(Event { frame: iteration as usize, warning, name: name.to_owned(), message });
    }
}

/// Writes all messages. `waiting` is sorted by time.
fn write(sink: &mut Sink, waiting: &[Waiting], frames: Option<&Frames<'_>>, rate_hz: f64) -> Result<(), LogError> {
    let mut put = |channel: Channel, log_time: u64, data: &[u8]| sink.put(channel as usize, log_time, data);
    let mut waiting = waiting.iter().peekable();
    let count = frames.map_or(0, Frames::count);
    let make = |block: usize| -> Vec<Vec<(Channel, Vec<u8>)>> {
        let Some(frames) = frames else { return Vec::new() };
        (block..count.min(block + BLOCK))
            .into_par_iter()
            .with_min_len(32)
            .map_init(|| frames.scratch(), |scratch, frame| frames.encode(frame, scratch))
            .collect()
    };
    let mut made = make(0);
    for block in (0..count).step_by(BLOCK) {
        // while one block is compressed and written, the next one is made
        let (written, next) = rayon::join(
            || -> Result<(), McapError> {
                for (frame, messages) in (block..).zip(&made) {
                    let log_time = tick_ns(frame as u32, rate_hz);
                    for (channel, data) in messages {
                        // what happened at this moment is told where its channel stands among those of the frame
                        let here = (log_time, *channel as u8);
                        while let Some(w) = waiting.next_if(|w| (w.log_time, w.channel as u8) <= here) {
                            put(w.channel, w.log_time, &w.data)?;
                        }
                        put(*channel, log_time, data)?;
                    }
                }
                Ok(())
            },
            || make(block + BLOCK),
        );
        written?;
        made = next;
    }
    for w in waiting {
        put(w.channel, w.log_time, &w.data)?;
    }
    Ok(())
}

impl Observer for McapLog {
    fn started(&mut self, start: &Start<'_>) {
        self.stages.push(Stage { number: start.stage, method: start.method, step_limit: start.step_limit, end: None, likelihood: false });
        self.bones = None;
        self.before = None;
        if self.about.timings && self.began.is_none() {
            self.began = Some(Instant::now());
        }
        // a model that is followed by another was asked for advice, and may stop where it likes
        if let Some(ended) = self.told.last_mut().filter(|_| start.stage > 0) {
            ended.warning = false;
        }
        let limit = start.step_limit;
        self.say(self.iterations, false, start.method, format!("model {} begins: {}, at most {limit} steps", start.stage, start.method));
    }

    fn stepped(&mut self, step: &Step<'_>) {
        // A method without a likelihood gets no messages: the numbers could only be invented.
        let Some(log_likelihood) = step.progress.log_likelihood else { return };
        let log_time = tick_ns(self.iterations, self.about.rate_hz);
        let likelihood = schema::EmLikelihood {
            timestamp: Some(timestamp(log_time)),
            stage: step.stage,
            iteration: step.iteration,
            log_likelihood,
            delta: self.before.map_or(0.0, |before| log_likelihood - before),
            // Viewers pair x and y by index, so a number that does not exist still needs its place.
            rms_residual_mm: step.progress.rms_residual_mm.unwrap_or(f64::NAN),
            elapsed_s: self.began.map_or(0.0, |began| began.elapsed().as_secs_f64()),
            converged: step.converged,
            iteration_of_log: self.iterations,
            largest_move_mm: step.progress.largest_move_mm,
            method: self.stages.last().map_or("", |s| s.method).to_owned(),
        };
        let bones = self.bones.get_or_insert_with(|| BoneResiduals::new(step.problem));
        let residuals = schema::EmBoneResiduals {
            timestamp: Some(timestamp(log_time)),
            stage: step.stage,
            iteration: step.iteration,
            bones: bones
                .of(step.problem, step.estimate)
                .map(|residual| schema::em_bone_residuals::Bone {
                    label: residual.label.to_owned(),
                    value: residual.rms_mm,
                    max_mm: residual.max_mm,
                    length_mm: residual.bone.length_mm,
                    length_sd_mm: residual.bone.spread_mm,
                    frames: residual.frames,
                })
                .collect(),
            iteration_of_log: self.iterations,
        };
        self.add(Channel::Likelihood, log_time, &likelihood);
        self.add(Channel::BoneResiduals, log_time, &residuals);
        if let Some(stage) = self.stages.last_mut() {
            stage.likelihood = true;
        }
        self.before = Some(log_likelihood);
        self.iterations += 1;
    }

    fn stopped(&mut self, outcome: &Outcome) {
        let Some(stage) = self.stages.last_mut() else { return };
        let error = outcome.error.as_ref().map(ToString::to_string);
        let method = stage.method;
        let mut text = format!("model {} ends: {} after {}", stage.number, outcome.stop.word(), count(outcome.steps as usize, "step"));
        if let Some(error) = &error {
            text = format!("{text}: {error}");
        }
        stage.end = Some((outcome.stop.word(), outcome.steps, error));
        // at its last iteration, if it had any of its own
        let last = if self.before.is_some() { self.iterations.saturating_sub(1) } else { self.iterations };
        self.say(last, !outcome.stop.settled(), method, text);
    }
}
