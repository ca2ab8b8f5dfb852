//! The MCAP log: a file that shows how a repair went, for Foxglove, Lichtblick and whoever reads MCAP.
//!
//! What is in it, in which units and when, is described in `docs/mcap-log.md`; the channels are listed in `channels.rs`.
//! The life of a log: [`McapLog::create`], then it observes the stages of one repair, then [`McapLog::finish`].
//!
//! The messages of the iterations are small, so they wait in memory and are written in one go at the end, in the order of their times.
//! Hence the solver's loop does no I/O, and a channel with one message per frame can be merged in without breaking that order.
//! Until the end the file has a temporary name next to the final one.
//! A run that fails, is killed, or drops the log leaves the final name as it was.

use super::channels::{Channel, tick_ns, timestamp};
use super::check::{Expected, check};
use super::{BoneResiduals, schema};
use crate::solve::{Observer, Outcome, Start, Step};
use crate::staging;
use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{Compression, McapError, WriteOptions, Writer};
use prost::Message;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::time::Instant;
use tempfile::NamedTempFile;

/// Name of the metadata record.
pub const METADATA: &str = "mocap-repair";

/// The highest frame rate for which two iterations never fall on the same nanosecond.
const HIGHEST_RATE_HZ: f64 = 1e9;

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
    /// Seed of the random numbers.
    pub seed: u64,
    /// The method that was asked for. The metadata also names the method of each stage.
    pub method: String,
    /// Effective options as (name, value); written as `option.<name>`. If a name occurs twice, the last value counts.
    pub options: Vec<(String, String)>,
    /// True to write computing times into `elapsed_s`. Then the same input no longer gives the same bytes.
    pub timings: bool,
}

/// What is known about a repair when it is over.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Closing {
    /// Results as (name, value); written into the metadata record as `result.<name>`. If a name occurs twice, the last value counts.
    pub results: Vec<(String, String)>,
    /// Files to put into the log, in this order.
    pub attachments: Vec<Attachment>,
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
    /// Counts the messages of the channel, from 0.
    sequence: u32,
    log_time: u64,
    data: Vec<u8>,
}

/// What happened in one stage.
#[derive(Debug)]
struct Stage {
    number: u32,
    method: &'static str,
    step_limit: u32,
    /// Why it stopped, how many steps it took, and what broke. `None` while it runs.
    end: Option<(&'static str, u32, Option<String>)>,
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
            bones: None,
            before: None,
            began: None,
        })
    }

    /// Writes everything, syncs the file, reads it back, and only then gives it its name, replacing what had that name before.
    ///
    /// # Errors
    /// The file could not be written, does not read back as it was written, or could not be renamed. What had the name before is still there.
    pub fn finish(mut self, closing: &Closing) -> Result<Written, LogError> {
        let metadata = Metadata { name: METADATA.to_owned(), metadata: self.metadata(closing) };
        write(self.file.as_file_mut(), &self.waiting, &metadata, closing)?;
        self.file.as_file().sync_all()?;
        let expected = Expected {
            messages: Channel::ALL.map(|c| (c.topic(), self.waiting.iter().filter(|w| w.channel == c).count() as u64)).into(),
            attachments: closing.attachments.len() as u64,
            metadata,
        };
        check(self.file.path(), &expected).map_err(|error| match error {
            LogError::Mcap(error) => LogError::Check(error.to_string()),
            other => other,
        })?;
        let bytes = self.file.as_file().metadata()?.len();
        self.file.persist(&self.path).map_err(|e| e.error)?;
        Ok(Written { messages: self.waiting.len() as u64, bytes })
    }

    /// Queues a message. Called in the order of `log_time`.
    fn add(&mut self, channel: Channel, log_time: u64, message: &impl Message) {
        self.waiting.push(Waiting { channel, sequence: self.iterations, log_time, data: message.encode_to_vec() });
    }

    /// The metadata record. Ordered, so that equal runs give equal bytes.
    fn metadata(&self, closing: &Closing) -> BTreeMap<String, String> {
        let about = &self.about;
        let mut map: BTreeMap<String, String> = BTreeMap::new();
        let mut put = |key: &str, value: String| map.insert(key.to_owned(), value);
        put("version", env!("CARGO_PKG_VERSION").to_owned());
        put("source_name", about.source_name.clone());
        put("source_sha256", about.source_sha256.clone());
        put("rate_hz", about.rate_hz.to_string());
        put("first_frame", about.first_frame.to_string());
        put("frames", about.frames.to_string());
        put("markers", about.markers.to_string());
        put("bones", about.bones.to_string());
        put("t0_ns", "0".to_owned());
        put("frame_time_base", "frame f of the take, counted from 0, is at round(f * 1e9 / rate_hz) ns".to_owned());
        put(
            "iteration_time_base",
            "iteration k of the log, counted from 0 over all stages, is at round(k * 1e9 / rate_hz) ns; not a wall clock".to_owned(),
        );
        put("units", "mm, s and nats in /em topics; the field names say which".to_owned());
        put("seed", about.seed.to_string());
        put("method", about.method.clone());
        put("timings", about.timings.to_string());
        put("iterations", self.iterations.to_string());
        put("stages", self.stages.len().to_string());
        let stops: Vec<&str> = self.stages.iter().map(|s| s.end.as_ref().map_or("unfinished", |e| e.0)).collect();
        put("stop_reason", stops.join(", "));
        for stage in &self.stages {
            let mut put = |key: &str, value: String| put(&format!("stage.{}.{key}", stage.number), value);
            put("method", stage.method.to_owned());
            put("step_limit", stage.step_limit.to_string());
            if let Some((stop, steps, error)) = &stage.end {
                put("stop_reason", (*stop).to_owned());
                put("steps", steps.to_string());
                if let Some(error) = error {
                    put("error", error.clone());
                }
            }
        }
        for (name, value) in &about.options {
            put(&format!("option.{name}"), value.clone());
        }
        for (name, value) in &closing.results {
            put(&format!("result.{name}"), value.clone());
        }
        map
    }
}

/// Writes the whole file. All channels are declared, also those without messages, so that a reader always finds the same topics.
fn write(file: &mut File, waiting: &[Waiting], metadata: &Metadata, closing: &Closing) -> Result<(), LogError> {
    // Everything that decides about bytes is stated here, whatever the defaults of the library become.
    let mut writer = WriteOptions::new()
        .profile("")
        .library(concat!("mocap-repair/", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Zstd))
        .compression_level(0) // zstd's own default
        .compression_threads(0) // the default follows the machine, and the bytes follow the number
        .chunk_size(Some(1 << 20))
        .create(BufWriter::new(file))?;
    let mut ids = Vec::with_capacity(Channel::ALL.len());
    for channel in Channel::ALL {
        let schema = writer.add_schema(channel.schema(), "protobuf", channel.descriptor())?;
        ids.push((channel, writer.add_channel(schema, channel.topic(), "protobuf", &BTreeMap::new())?));
    }
    for message in waiting {
        let Some(&(_, channel_id)) = ids.iter().find(|(channel, _)| *channel == message.channel) else {
            return Err(LogError::Check(format!("the channel {} was not declared", message.channel.topic())));
        };
        let header = MessageHeader { channel_id, sequence: message.sequence, log_time: message.log_time, publish_time: message.log_time };
        writer.write_to_known_channel(&header, &message.data)?;
    }
    for attachment in &closing.attachments {
        writer.attach(&::mcap::Attachment {
            log_time: 0,
            create_time: 0, // a wall clock would make every log different
            name: attachment.name.clone(),
            media_type: attachment.media_type.clone(),
            data: attachment.bytes.as_slice().into(),
        })?;
    }
    writer.write_metadata(metadata)?;
    writer.finish()?;
    flush(writer)?;
    Ok(())
}

/// Empties the buffer between library and file, whose errors would be lost if it were just dropped.
fn flush(writer: Writer<BufWriter<&mut File>>) -> io::Result<()> {
    writer.into_inner().into_inner().map_err(io::IntoInnerError::into_error)?;
    Ok(())
}

impl Observer for McapLog {
    fn started(&mut self, start: &Start<'_>) {
        self.stages.push(Stage { number: start.stage, method: start.method, step_limit: start.step_limit, end: None });
        self.bones = None;
        self.before = None;
        if self.about.timings && self.began.is_none() {
            self.began = Some(Instant::now());
        }
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
        self.before = Some(log_likelihood);
        self.iterations += 1;
    }

    fn stopped(&mut self, outcome: &Outcome) {
        if let Some(stage) = self.stages.last_mut() {
            stage.end = Some((outcome.stop.word(), outcome.steps, outcome.error.as_ref().map(ToString::to_string)));
        }
    }
}
