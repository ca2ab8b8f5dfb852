//! The MCAP log of a body that was followed through clouds.
//!
//! The life of a log: [`TrackLog::create`], one [`TrackLog::frame`] after the other, [`TrackLog::finish`]. Messages are written as they come, in the
//! order of their times, and nothing is kept. Nothing can go wrong while frames are told; the first error comes from `finish`.
//! `docs/mcap-log.md` says what is in it.

mod channels;
mod layout;

use super::body::{self, Limbs, VIEWED, in_space, said};
use super::channels::timestamp;
use super::mcap::{Attachment, Ended, LogError, Up, Whole};
use super::metadata::METADATA;
use super::schema::foxglove::PointCloud;
use super::schema::{EmRound, TrackedFrame, em_round, tracked_frame};
use super::sink::Sink;
use super::{axes, is_unfinished};
use crate::report::count;
use crate::rig::Rig;
use crate::solve::ik::Vec3;
use crate::solve::track::{Beside, Cloud, Tracked, Way};
use crate::staging;
use crate::track::{Given, Seen};
use ::mcap::McapError;
use ::mcap::records::Metadata;
use channels::Channel;
use formats::Note;
use prost::Message;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Points of a cloud that are farther than this from the body are drawn as such, cm.
const BESIDE_CM: f64 = 3.0;

/// What is known before the first frame.
#[derive(Clone, Debug)]
pub struct TrackAbout {
    /// The files of the clouds as they were named, without folders.
    pub source_name: String,
    /// Frames per second.
    pub rate_hz: f64,
    /// The number of the first frame.
    pub first_frame: u32,
    /// Number of frames.
    pub frames: usize,
    /// The method that was asked for.
    pub method: String,
    /// Effective options as (name, value); written as `option.<name>`.
    pub options: Vec<(String, String)>,
    /// The least cosine between normals that fit.
    pub cosine: f64,
    /// The most frames per second on the topics that are drawn in space; all if absent.
    pub log_rate_hz: Option<f64>,
}

/// Writes the log of one sequence.
pub struct TrackLog<'a> {
    path: PathBuf,
    sink: Sink,
    rig: &'a Rig,
    about: TrackAbout,
    names: Vec<&'a str>,
    parts: Vec<usize>,
    limbs: Limbs,
    up: Up,
    cloud: PointCloud,
    /// Frames so far, and rounds of all of them.
    frames: u32,
    rounds: u64,
    /// For each part, the frame since which it is lost.
    lost: Vec<Option<u32>>,
    /// Where joints were, for the view: coordinates of each axis, m.
    sides: [Vec<f64>; 3],
    broken: Option<LogError>,
}

impl<'a> TrackLog<'a> {
    /// Begins a log that will be called `path`, in a hidden temporary file of the same folder.
    ///
    /// # Errors
    /// `path` is a folder or has no file name, or the file cannot be written.
    pub fn create(path: &Path, rig: &'a Rig, about: TrackAbout) -> Result<Self, LogError> {
        let mut log = Self {
            path: path.to_owned(),
            sink: Sink::create(path, &Channel::ALL.map(Channel::topic))?,
            names: rig.names().collect(),
            parts: rig.with_surface(),
            limbs: Limbs::new(rig),
            up: Up::Guessed(rig.up()),
            cloud: body::empty_cloud(),
            frames: 0,
            rounds: 0,
            lost: vec![None; rig.body.tree.joints()],
            sides: Default::default(),
            broken: None,
            rig,
            about,
        };
        if let Some(turn) = axes::transform(log.up) {
            log.put(Channel::Axes, 0, &turn.encode_to_vec());
        }
        let (joints, frames) = (count(log.names.len(), "joint"), count(log.about.frames, "frame"));
        log.say(
            0,
            log.about.first_frame,
            false,
            "track",
            format!("a body of {joints} is followed through {frames} by {}", log.about.method),
        );
        let notes: Vec<(bool, String)> = rig.notes.iter().map(|note: &Note| (note.matters(), note.to_string())).collect();
        for (matters, text) in notes {
            log.say(0, log.about.first_frame, matters, "body", text);
        }
        log.stop()?;
        Ok(log)
    }

    /// Tells of the next frame.
    pub fn frame(&mut self, seen: &Seen, tracked: &Tracked) {
        let frame = self.frames;
        self.frames += 1;
        if self.broken.is_some() {
            return;
        }
        let period = |share: f64| ((f64::from(frame) + share) * 1e9 / self.about.rate_hz).round() as u64;
        let now = period(0.0);
        let times: Vec<u64> = (0..tracked.rounds.len()).map(|r| period(r as f64 / tracked.rounds.len() as f64)).collect();
        let in_space = in_space(frame, self.about.rate_hz, self.about.log_rate_hz);
        self.round(seen, tracked, 0, now);
        self.put(Channel::Frames, now, &self.tracked(seen, now).encode_to_vec());
        if in_space {
            self.draw(tracked, now);
        }
        self.tell(seen, now);
        for (round, time) in times.iter().enumerate().skip(1) {
            self.round(seen, tracked, round, *time);
        }
        self.rounds += tracked.rounds.len() as u64;
        let stride = (self.about.frames / VIEWED).max(1) as u32;
        for centre in tracked.centres.iter().filter(|_| frame.is_multiple_of(stride)) {
            for (side, x) in self.sides.iter_mut().zip(centre.iter()) {
                side.push(x * 1e-2);
            }
        }
    }

    fn round(&mut self, seen: &Seen, tracked: &Tracked, at: usize, time: u64) {
        let Some(round) = tracked.rounds.get(at) else { return };
        let part = |&part: &usize| em_round::Part {
            label: self.names[part].to_owned(),
            mass: round.mass[part],
            residual_cm: round.residual_cm[part],
        };
        let message = EmRound {
            timestamp: Some(timestamp(time)),
            frame: seen.number.cast_signed(),
            round: at as u32,
            log_likelihood: round.log_likelihood,
            sigma_cm: round.sigma_cm,
            inliers: round.inliers,
            moved_cm: round.moved_cm,
            parts: self.parts.iter().map(part).collect(),
        };
        self.put(Channel::Rounds, time, &message.encode_to_vec());
    }

    fn tracked(&self, seen: &Seen, time: u64) -> TrackedFrame {
        let part = |&part: &usize| tracked_frame::Part {
            label: self.names[part].to_owned(),
            coverage: seen.coverage[part],
            residual_cm: seen.residuals_cm[part],
            lost: seen.lost[part],
        };
        let way = match seen.way {
            Way::Tracked => tracked_frame::Way::Tracked,
            Way::Searched => tracked_frame::Way::Searched,
            Way::Predicted => tracked_frame::Way::Predicted,
        };
        TrackedFrame {
            timestamp: Some(timestamp(time)),
            frame: seen.number.cast_signed(),
            way: way.into(),
            points: seen.points as u32,
            rounds: seen.rounds as u32,
            inliers: seen.inliers,
            residual_cm: seen.residual_cm,
            lost_count: self.parts.iter().filter(|&&part| seen.lost[part]).count() as u32,
            parts: self.parts.iter().map(part).collect(),
            log_likelihood: seen.log_likelihood,
            sigma_cm: seen.sigma_cm,
        }
    }

    /// Cloud, surface and skeleton.
    fn draw(&mut self, tracked: &Tracked, time: u64) {
        let (body, stamp) = (&self.rig.body, timestamp(time));
        let mut cloud = std::mem::take(&mut self.cloud);
        if let Some(seen) = &tracked.cloud {
            let turned = body.parts.iter().zip(&body.normals).map(|(&part, normal)| tracked.parts[part].rotation * normal);
            let surface = Cloud { points: body.posed(&tracked.parts).collect(), normals: turned.collect() };
            let beside = Beside::new(&surface, seen.points.iter().copied(), BESIDE_CM);
            let most = BESIDE_CM * BESIDE_CM;
            let is_body = |x: &Vec3, normal: &Vec3| beside.square(x, normal, self.about.cosine, most) < most;
            let points = seen.points.iter().zip(&seen.normals);
            body::put(&mut cloud, stamp, points.map(|(x, normal)| (*x, body::MEASURED[usize::from(!is_body(x, normal))])));
            self.put(Channel::Cloud, time, &cloud.encode_to_vec());
        }
        body::put(&mut cloud, stamp, body::surface(self.rig, &tracked.parts, &tracked.lost));
        self.put(Channel::Model, time, &cloud.encode_to_vec());
        self.cloud = cloud;
        let scene = self.limbs.scene(stamp, &tracked.parts, &tracked.centres, &tracked.lost);
        self.put(Channel::Skeleton, time, &scene.encode_to_vec());
    }

    /// What happened in this frame, in words.
    fn tell(&mut self, seen: &Seen, time: u64) {
        let number = seen.number;
        match seen.given {
            Given::Cloud => {}
            Given::Empty => self.say(time, number, true, "cloud", "the cloud has no points, the pose is predicted".to_owned()),
            Given::Missing => self.say(time, number, true, "cloud", "there is no cloud, the pose is predicted".to_owned()),
        }
        if seen.way == Way::Searched {
            self.say(time, number, false, "track", "limbs were searched".to_owned());
        }
        for part in 0..self.lost.len() {
            let name = self.names[part];
            match (self.lost[part], seen.lost.get(part) == Some(&true)) {
                (None, true) => {
                    self.lost[part] = Some(number);
                    self.say(time, number, true, name, format!("{name} is lost"));
                }
                (Some(since), false) => {
                    self.lost[part] = None;
                    self.say(time, number, false, name, format!("{name} is found again, it was lost since frame {since}"));
                }
                _ => {}
            }
        }
    }

    fn say(&mut self, time: u64, number: u32, warning: bool, name: &str, message: String) {
        let log = said(time, number, warning, name, message, &self.about.source_name);
        self.put(Channel::Log, time, &log.encode_to_vec());
    }

    fn put(&mut self, channel: Channel, time: u64, data: &[u8]) {
        if self.broken.is_none() {
            self.broken = self.sink.put(channel as usize, time, data).map_err(McapError::into).err();
        }
    }

    /// The first error so far.
    fn stop(&mut self) -> Result<(), LogError> {
        self.broken.take().map_or(Ok(()), Err)
    }

    /// Writes the rest, syncs the file and reads it back. What comes out only lacks its name.
    ///
    /// # Errors
    /// The file could not be written, or does not read back as it was written.
    pub fn finish(mut self, ended: Ended, results: &[(String, String)], mut attachments: Vec<Attachment>) -> Result<Whole, LogError> {
        self.stop()?;
        let metadata = self.metadata(ended, results);
        attachments.push(layout::attachment(self.up, std::mem::take(&mut self.sides), &self.parts, &self.names));
        self.sink.finish(&attachments, metadata)
    }

    /// Ends the log of a sequence that came to nothing, and gives it its name: it shows how far that came. What has its name already stays, unless it
    /// is such a log itself.
    pub fn leave(self, ended: Ended) -> Option<PathBuf> {
        let path = self.path.clone();
        if staging::is_there(&path) && !is_unfinished(&path) {
            return None;
        }
        self.finish(ended, &[], Vec::new()).and_then(Whole::place).ok().map(|_| path)
    }

    fn metadata(&self, ended: Ended, results: &[(String, String)]) -> Metadata {
        let about = &self.about;
        let every = about.log_rate_hz.map_or_else(|| "every frame".to_owned(), |hz| hz.to_string());
        let fixed = [
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("command", "track".to_owned()),
            ("ended", ended.word().to_owned()),
            ("source_name", about.source_name.clone()),
            ("rate_hz", about.rate_hz.to_string()),
            ("first_frame", about.first_frame.to_string()),
            ("frames", about.frames.to_string()),
            ("frames_in_log", self.frames.to_string()),
            ("rounds", self.rounds.to_string()),
            ("joints", self.names.len().to_string()),
            ("up", self.up.text()),
            ("file_unit", self.rig.unit.symbol().to_owned()),
            ("method", about.method.clone()),
            ("log_rate_hz", every),
            ("t0_ns", "0".to_owned()),
            ("frame_time_base", "frame f of the sequence, counted from 0, is at round(f * 1e9 / rate_hz) ns".to_owned()),
            (
                "round_time_base",
                "round r of the n rounds of frame f is at round((f + r / n) * 1e9 / rate_hz) ns; not a wall clock".to_owned(),
            ),
            ("units", "cm and nats in /em and /track topics, the field names say which; m in /cloud, /model and /skeleton".to_owned()),
        ];
        let mut map: BTreeMap<String, String> = fixed.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        for (what, name, sha256) in &self.rig.files {
            map.insert(format!("{what}_name"), name.clone());
            map.insert(format!("{what}_sha256"), sha256.clone());
        }
        map.extend(about.options.iter().map(|(name, value)| (format!("option.{name}"), value.clone())));
        map.extend(results.iter().map(|(name, value)| (format!("result.{name}"), value.clone())));
        Metadata { name: METADATA.to_owned(), metadata: map }
    }
}
