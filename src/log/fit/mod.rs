//! The MCAP log of a motion that was solved for: [`write_fit_log`] writes it when everything is known.
//!
//! `docs/mcap-log.md` says what is in it.

mod channels;
mod layout;

use super::axes;
use super::body::{self, Limbs, VIEWED, in_space, said};
use super::channels::timestamp;
use super::mcap::{Attachment, Ended, LogError, Up, Whole};
use super::metadata::METADATA;
use super::schema::{SolveRound, SolvedFrame, solve_round, solved_frame};
use super::sink::Sink;
use crate::fit::{Fitted, Report};
use crate::report::count;
use crate::rig::Rig;
use crate::runs::Stretch;
use crate::solve::ik::{Posed, Vec3};
use crate::solve::markers::Stage;
use ::mcap::records::Metadata;
use channels::Channel;
use prost::Message;
use std::collections::BTreeMap;
use std::path::Path;

/// What the log is to know besides the motion.
#[derive(Clone, Debug)]
pub struct FitAbout {
    /// The file of the take, without folders.
    pub source_name: String,
    /// SHA-256 of that file, hexadecimal.
    pub source_sha256: String,
    /// Effective options as (name, value); written as `option.<name>`.
    pub options: Vec<(String, String)>,
    /// The most frames per second on the topics that are drawn in space; all if absent.
    pub log_rate_hz: Option<f64>,
}

/// Writes a log that will be called `path`, syncs the file and reads it back. What comes out only lacks its name.
///
/// # Errors
/// `path` is a folder or has no file name, or the file cannot be written, or does not read back as it was written.
pub fn write_fit_log(path: &Path, rig: &Rig, about: &FitAbout, fitted: &Fitted<'_>, report: &Report) -> Result<Whole, LogError> {
    let sink = Sink::create(path, &Channel::ALL.map(Channel::topic))?;
    let up = if fitted.take.up.is_some() { Up::Stated(rig.up()) } else { Up::Guessed(rig.up()) };
    let mut writer = Writer { sink, rig, about, fitted, report, up };
    writer.begin()?;
    let sides = writer.frames()?;
    let attachments = [
        Attachment {
            name: "report.jsonl".to_owned(),
            media_type: "application/jsonl".to_owned(),
            bytes: report.json_for_log().into_bytes(),
        },
        layout::attachment(up, sides, &report.markers),
    ];
    let metadata = writer.metadata();
    writer.sink.finish(&attachments, metadata)
}

struct Writer<'a> {
    sink: Sink,
    rig: &'a Rig,
    about: &'a FitAbout,
    fitted: &'a Fitted<'a>,
    report: &'a Report,
    up: Up,
}

impl Writer<'_> {
    /// Axes, and what is to be said of the whole.
    fn begin(&mut self) -> Result<(), LogError> {
        if let Some(turn) = axes::transform(self.up) {
            self.put(Channel::Axes, 0, &turn)?;
        }
        let report = self.report;
        let (markers, frames) = (count(self.fitted.worn.markers.len(), "marker"), count(self.fitted.frames(), "frame"));
        let joints = count(report.joints, "joint");
        self.say(0, 0, false, "solve", format!("a body of {joints} wears {markers} through {frames}"))?;
        for note in &report.notes {
            self.say(0, 0, note.matters(), "take", note.to_string())?;
        }
        for marker in &report.absent {
            self.say(0, 0, true, marker, format!("{marker} is in the map but not in the take"))?;
        }
        for marker in report.strange() {
            let text = format!("{} is {:.1} cm from where the map has it: labels swapped, or another vertex?", marker.label, marker.rms_cm);
            self.say(0, 0, true, &marker.label, text)?;
        }
        for joint in &report.unobserved {
            self.say(0, 0, true, joint, format!("no marker tells how {joint} turns"))?;
        }
        Ok(())
    }

    /// All frames, and the rounds that were taken between them. Returns where joints were, for the view: coordinates of each axis, m.
    fn frames(&mut self) -> Result<[Vec<f64>; 3], LogError> {
        let (fitted, rig, rate_hz) = (self.fitted, self.rig, self.fitted.take.rate_hz);
        let tree = &rig.body.tree;
        let (limbs, mut cloud, mut posed) = (Limbs::new(rig), body::empty_cloud(), Posed::new(tree));
        let frames = fitted.frames();
        let stride = (frames / VIEWED).max(1);
        let mut sides: [Vec<f64>; 3] = Default::default();
        let rounds = &fitted.solution.rounds;
        let period = |frames: f64| (frames * 1e9 / rate_hz).round() as u64;
        let times: Vec<u64> = (0..rounds.len()).map(|r| period(r as f64 / rounds.len() as f64 * frames as f64)).collect();
        let mut next = 0;
        for (frame, pose) in fitted.solution.poses.iter().enumerate() {
            let now = period(frame as f64);
            while let Some(time) = times.get(next).copied().filter(|time| *time <= now) {
                self.round(next, time)?;
                next += 1;
            }
            self.frame(frame, now)?;
            posed.set(tree, pose);
            if in_space(frame as u32, rate_hz, self.about.log_rate_hz) {
                let stamp = timestamp(now);
                body::put(
                    &mut cloud,
                    stamp,
                    fitted.seen.frame(frame).map(|(at, x, _)| (*x, body::MEASURED[usize::from(!fitted.counts(at))])),
                );
                self.put(Channel::Seen, now, &cloud)?;
                let place = |(_, _, marker, _): &(usize, String, crate::solve::ik::terms::Marker, f64)| -> Vec3 {
                    posed.parts[marker.part].point(&marker.place())
                };
                body::put(&mut cloud, stamp, fitted.worn.markers.iter().map(|worn| (place(worn), body::EXPECTED)));
                self.put(Channel::Expected, now, &cloud)?;
                body::put(&mut cloud, stamp, body::surface(rig, &posed.parts, &[]));
                self.put(Channel::Model, now, &cloud)?;
                self.put(Channel::Skeleton, now, &limbs.scene(stamp, &posed.parts, &posed.centres, &[]))?;
            }
            self.tell(frame, now)?;
            for centre in posed.centres.iter().filter(|_| frame.is_multiple_of(stride)) {
                for (side, x) in sides.iter_mut().zip(centre.iter()) {
                    side.push(x * 1e-2);
                }
            }
        }
        for (round, time) in times.iter().enumerate().skip(next) {
            self.round(round, *time)?;
        }
        Ok(sides)
    }

    fn round(&mut self, at: usize, time: u64) -> Result<(), LogError> {
        let round = self.fitted.solution.rounds[at];
        let stage = match round.stage {
            Stage::Frames => solve_round::Stage::Frames,
            Stage::Settling => solve_round::Stage::Settling,
            Stage::Trusting => solve_round::Stage::Trusting,
        };
        let message = SolveRound {
            timestamp: Some(timestamp(time)),
            round: at as u32,
            stage: stage.into(),
            energy: round.energy,
            rms_cm: round.rms_cm,
            largest_change: round.largest_change,
        };
        self.put(Channel::Rounds, time, &message)
    }

    fn frame(&mut self, frame: usize, time: u64) -> Result<(), LogError> {
        let fitted = self.fitted;
        let (count, rms_cm, worst) = fitted.summed(frame);
        let weights = &fitted.seen.weights[frame * fitted.seen.markers..];
        let markers = fitted.worn.markers.iter().zip(fitted.row(frame)).zip(weights).map(|((worn, residual_cm), weight)| {
            solved_frame::Marker { label: worn.1.clone(), residual_cm: *residual_cm, weight: *weight }
        });
        let message = SolvedFrame {
            timestamp: Some(timestamp(time)),
            frame: fitted.take.frame_label(frame),
            marker_count: count as u32,
            rms_cm,
            worst_cm: worst.map_or(f64::NAN, |(_, x)| x),
            worst: worst.map(|(at, _)| fitted.worn.markers[at].1.clone()).unwrap_or_default(),
            markers: markers.collect(),
        };
        self.put(Channel::Frames, time, &message)
    }

    /// What begins in this frame, in words.
    fn tell(&mut self, frame: usize, time: u64) -> Result<(), LogError> {
        let label = self.fitted.take.frame_label(frame);
        let begins = |when: &[Stretch]| when.iter().find(|stretch| stretch.first_frame == label).copied();
        let report = self.report;
        if let Some(stretch) = begins(&report.predicted) {
            let text = format!("no marker is seen in {}, the pose is where accelerations lead", count(stretch.frames, "frame"));
            self.say(time, frame, true, "markers", text)?;
        }
        for unseen in &report.unseen {
            if let Some(stretch) = begins(&unseen.when) {
                let text = format!("no marker tells of {} in {}", unseen.joint, count(stretch.frames, "frame"));
                self.say(time, frame, false, &unseen.joint, text)?;
            }
        }
        Ok(())
    }

    fn say(&mut self, time: u64, frame: usize, warning: bool, name: &str, message: String) -> Result<(), LogError> {
        let number = u32::try_from(self.fitted.take.frame_label(frame)).unwrap_or(0);
        let log = said(time, number, warning, name, message, &self.about.source_name);
        self.put(Channel::Log, time, &log)
    }

    fn put(&mut self, channel: Channel, time: u64, message: &impl Message) -> Result<(), LogError> {
        Ok(self.sink.put(channel as usize, time, &message.encode_to_vec())?)
    }

    fn metadata(&self) -> Metadata {
        let (about, take) = (self.about, self.fitted.take);
        let every = about.log_rate_hz.map_or_else(|| "every frame".to_owned(), |hz| hz.to_string());
        let fixed = [
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("command", "solve".to_owned()),
            ("ended", Ended::Done.word().to_owned()),
            ("source_name", about.source_name.clone()),
            ("source_sha256", about.source_sha256.clone()),
            ("rate_hz", take.rate_hz.to_string()),
            ("first_frame", take.first_frame.to_string()),
            ("frames", take.frames().to_string()),
            ("rounds", self.fitted.solution.rounds.len().to_string()),
            ("markers", self.fitted.worn.markers.len().to_string()),
            ("joints", self.report.joints.to_string()),
            ("up", self.up.text()),
            ("file_unit", self.rig.unit.symbol().to_owned()),
            ("log_rate_hz", every),
            ("t0_ns", "0".to_owned()),
            ("frame_time_base", "frame f of the take, counted from 0, is at round(f * 1e9 / rate_hz) ns".to_owned()),
            (
                "round_time_base",
                "round r of all n is at round(r / n * frames * 1e9 / rate_hz) ns; not a wall clock, and it tells of all frames".to_owned(),
            ),
            ("units", "cm in /solve topics, the field names say so; m in /markers, /model and /skeleton".to_owned()),
        ];
        let mut map: BTreeMap<String, String> = fixed.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        for (what, name, sha256) in &self.rig.files {
            map.insert(format!("{what}_name"), name.clone());
            map.insert(format!("{what}_sha256"), sha256.clone());
        }
        map.extend(about.options.iter().map(|(name, value)| (format!("option.{name}"), value.clone())));
        map.extend(self.report.results().into_iter().map(|(name, value)| (format!("result.{name}"), value)));
        Metadata { name: METADATA.to_owned(), metadata: map }
    }
}
