//! The story of one sequence of clouds, from top to bottom: a body is followed through it, and becomes a BVH file.
//!
//! Read the rig, find the files, follow, write to hidden files, prove, rename. Clouds are read ahead of the solver by threads of their own, and the
//! log is written behind it by another one.

mod report;
mod seen;
mod sequence;

use crate::error::Left;
use crate::log::{Attachment, Ended, LogError, TrackAbout, TrackLog};
use crate::output::{Names, check_motion_name, put_in_place, unwritable};
use crate::page::{Page, TrackFigure};
use crate::repair::RepairError;
use crate::report::short;
use crate::rig::bvh::Poses;
use crate::rig::{Rig, RigFiles, read_rig};
use crate::solve::Observer;
use crate::solve::ik::Vec3;
use crate::solve::track::{Body, Cloud, Method, Settings, Tracked, Tracker, middle};
use crate::staging;
use formats::Note;
use formats::bvh::Order;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;

pub use report::{Lost, Report};
pub use seen::{Given, Seen, word, write_table};
pub use sequence::{Clouds, Frame, Pattern, Sequence};

/// Who waits is told this often how far it is.
const TELL_EVERY: Duration = Duration::from_millis(250);

/// Frames that wait for the log, at most.
const BEHIND: usize = 16;

/// What is wanted.
#[derive(Clone, Debug)]
pub struct Request {
    /// The clouds. Never written, as all that is read.
    pub clouds: Pattern,
    /// The first frame; the first one that has a file if absent.
    pub first: Option<u32>,
    /// The last frame; the last one that has a file if absent.
    pub last: Option<u32>,
    /// The body.
    pub rig: RigFiles,
    /// How it is followed.
    pub settings: Settings,
    /// Frames per second, which clouds do not tell.
    pub rate_hz: f64,
    /// The order of rotation channels.
    pub order: Order,
    /// The BVH file to write.
    pub output: PathBuf,
    /// The table of frames to write.
    pub table: PathBuf,
    /// The log to write, if any.
    pub log: Option<PathBuf>,
    /// The most frames per second that the log draws in space; all if absent.
    pub log_rate_hz: Option<f64>,
    /// The report to look at, if any.
    pub page: Option<PathBuf>,
    /// Replace files that exist.
    pub force: bool,
    /// Look and tell, follow and write nothing.
    pub dry_run: bool,
}

/// A sequence that was followed to its end.
#[derive(Debug, Default)]
struct Followed {
    poses: Poses,
    frames: Vec<Seen>,
    /// What was assumed or found odd in clouds, each once.
    notes: Vec<Note>,
    /// What the report to look at draws, if it is wanted.
    figure: Option<TrackFigure>,
    /// Where the log takes frames from.
    to_log: Option<SyncSender<(Seen, Tracked)>>,
}

/// Follows a body through a sequence of clouds.
///
/// # Errors
/// A file cannot be read or written, or `interrupt` became true. Then no file was written.
pub fn track(request: &Request, watch: &mut dyn Observer, interrupt: &AtomicBool) -> Result<Report, RepairError> {
    let began = Instant::now();
    watch.phase("reading the body and looking for clouds");
    let sequence = Sequence::find(&request.clouds, request.first, request.last)?;
    request.check_names(&sequence)?;
    let rig = read_rig(&request.rig)?;
    let mut report = Report::new(request, &rig);
    if request.dry_run {
        let first = sequence.first_cloud(rig.unit.cm())?;
        report.notes.extend(first.into_iter().flat_map(|frame| frame.notes));
        report.foresee(&sequence);
        return Ok(report);
    }
    let log = start_log(request, &rig, &sequence, &mut report);
    let (mut followed, log) = follow(request, &rig, &sequence, log, watch, interrupt)?;
    report.took = began.elapsed();
    report.notes.append(&mut followed.notes);
    report.judge(&followed.frames, &rig);
    watch.phase("writing and checking the motion");
    write_out(request, &rig, &mut followed, log, report)
}

/// Begins the log. That it cannot be written does not keep the body from being followed: it is reported.
fn start_log<'a>(request: &Request, rig: &'a Rig, sequence: &Sequence, report: &mut Report) -> Option<TrackLog<'a>> {
    let path = request.log.as_ref()?;
    match TrackLog::create(path, rig, request.about(sequence)) {
        Ok(log) => Some(log),
        Err(error) => {
            report.log_failed(path, &error);
            None
        }
    }
}

/// Goes through the sequence, frame by frame. The log is written by a thread of its own, a few frames behind.
fn follow<'a>(
    request: &Request,
    rig: &Rig,
    sequence: &Sequence,
    mut log: Option<TrackLog<'a>>,
    watch: &mut dyn Observer,
    interrupt: &AtomicBool,
) -> Result<(Followed, Option<TrackLog<'a>>), RepairError> {
    let followed = std::thread::scope(|scope| {
        let figure = request.page.as_ref().map(|_| TrackFigure::new(rig, sequence.frames()));
        let mut followed = Followed { figure, ..Followed::default() };
        if let Some(log) = &mut log {
            let (to_log, done) = sync_channel::<(Seen, Tracked)>(BEHIND);
            followed.to_log = Some(to_log);
            scope.spawn(move || done.iter().for_each(|(seen, tracked)| log.frame(&seen, &tracked)));
        }
        let mut tracker = Tracker::new(&rig.body, rig.limits.as_ref(), rig.start.clone(), request.settings);
        // what was pushed comes out in the same order, but perhaps later
        let mut pushed = VecDeque::new();
        let (began, mut told) = (Instant::now(), Instant::now());
        let mut told_size = false;
        for frame in sequence.read(rig.unit.cm(), scope) {
            if interrupt.load(Ordering::Relaxed) {
                return Err(Stopped::Interrupted);
            }
            let Frame { number, cloud, notes } = frame.map_err(Stopped::Failed)?;
            followed.note(notes);
            let given = match &cloud {
                None => Given::Missing,
                Some(cloud) if cloud.points.is_empty() => Given::Empty,
                Some(_) => Given::Cloud,
            };
            if given == Given::Cloud && !told_size {
                told_size = true;
                if let Some(problem) = cloud.as_ref().and_then(|cloud| of_another_size(cloud, &rig.body)) {
                    return Err(Stopped::Failed(RepairError::Io { path: request.clouds.path(number), problem }));
                }
            }
            pushed.push_back((number, given));
            followed.take(rig, &mut pushed, tracker.push(cloud));
            if told.elapsed() > TELL_EVERY {
                told = Instant::now();
                let (done, all) = (followed.frames.len(), sequence.frames());
                let pace = done as f64 / began.elapsed().as_secs_f64();
                watch.phase(&format!("tracking: {done} of {all} frames, {pace:.0} frames/s"));
            }
        }
        followed.take(rig, &mut pushed, tracker.finish());
        if tracker.turned() {
            followed.notes.push(Note::Assumed { text: "the normals of the clouds point inwards, they are turned".to_owned() });
        }
        followed.to_log = None; // which ends the log's thread
        Ok(followed)
    });
    match followed {
        Ok(followed) => Ok((followed, log)),
        Err(Stopped::Interrupted) => {
            let log = Left(log.and_then(|log| log.leave(Ended::Interrupted)));
            Err(RepairError::Interrupted { path: PathBuf::from(request.clouds.typed()), log })
        }
        Err(Stopped::Failed(error)) => Err(error),
    }
}

/// A cloud that is this many times as large as the body, or as small, is in another unit.
const ANOTHER_UNIT: f64 = 5.0;

/// What is wrong with a cloud whose size has nothing to do with that of the body. Half of the points are looked at: others may be far away.
fn of_another_size(cloud: &Cloud, body: &Body) -> Option<String> {
    let spread = |points: &[Vec3]| {
        let middle = middle(points.iter().copied());
        let mut distances: Vec<f64> = points.iter().map(|x| (x - middle).norm()).collect();
        let half = distances.len() / 2;
        *distances.select_nth_unstable_by(half, f64::total_cmp).1
    };
    let (cloud, body) = (spread(&cloud.points), spread(&body.vertices));
    let alike = cloud < ANOTHER_UNIT * body && body < ANOTHER_UNIT * cloud;
    (!alike).then(|| {
        let (cloud, body) = (short(cloud), short(body));
        format!(
            "half of the points are within {cloud} cm, but half of the body within {body} cm: the clouds are in another unit than the rig, \
             or no clouds of it; both have to be in the unit that --unit says"
        )
    })
}

/// Why a sequence was not followed to its end.
enum Stopped {
    Interrupted,
    Failed(RepairError),
}

impl Followed {
    /// Keeps notes, each once.
    fn note(&mut self, notes: Vec<Note>) {
        for note in notes {
            if !self.notes.contains(&note) {
                self.notes.push(note);
            }
        }
    }

    /// Keeps frames that are done.
    fn take(&mut self, rig: &Rig, pushed: &mut VecDeque<(u32, Given)>, done: Vec<Tracked>) {
        for tracked in done {
            let Some((number, given)) = pushed.pop_front() else { continue };
            self.poses.push(rig, &tracked.pose, &tracked.centres);
            let seen = Seen::new(number, given, &tracked);
            if let Some(figure) = &mut self.figure {
                figure.push(&tracked);
            }
            if let Some(to_log) = &self.to_log {
                // the log's thread takes frames until there are no more
                let _ = to_log.send((seen.clone(), tracked));
            }
            self.frames.push(seen);
        }
    }
}

/// Writes everything under hidden names, proves it, and puts it in place: the motion last.
fn write_out(
    request: &Request,
    rig: &Rig,
    followed: &mut Followed,
    log: Option<TrackLog<'_>>,
    mut report: Report,
) -> Result<Report, RepairError> {
    let motion = followed.poses.stage(rig, request.rate_hz, request.order, &request.output)?;
    let table = stage_table(&request.table, &followed.frames, rig)?;
    let mut beside = vec![(table, request.table.as_path())];
    let mut whole = None;
    if let (Some(log), Some(path)) = (log, &request.log) {
        let told = Report {
            output: Some(request.output.clone()),
            table: Some(request.table.clone()),
            log: Some(path.clone()),
            page: request.page.clone(),
            ..report.clone()
        };
        let attachment = Attachment {
            name: "report.jsonl".to_owned(),
            media_type: "application/jsonl".to_owned(),
            bytes: told.json_for_log().into_bytes(),
        };
        match log.finish(Ended::Done, &report.results(), vec![attachment]) {
            Ok(log) => whole = Some((path, log)),
            Err(error) => report.log_failed(path, &error),
        }
    }

    if let (Some(path), Some(figure)) = (&request.page, followed.figure.take()) {
        let page = Page::of_track(figure, rig, &report, &followed.frames, &request.source_name(), request.options());
        let staged = page.stage(path).and_then(|file| file.as_file().sync_all().map(|()| file));
        beside.push((staged.map_err(|e| unwritable(path, &e))?, path));
    }
    let log_path = whole.as_ref().map(|(path, _)| (*path).clone());
    match put_in_place(beside, whole.map(|(path, log)| (path.as_path(), log)), (motion, &request.output))? {
        Some(error) => log_path.iter().for_each(|path| report.log_failed(path, &error)),
        None => report.log = log_path,
    }
    report.table = Some(request.table.clone());
    report.page.clone_from(&request.page);
    report.output = Some(request.output.clone());
    Ok(report)
}

fn stage_table(path: &Path, frames: &[Seen], rig: &Rig) -> Result<NamedTempFile, RepairError> {
    let staged = staging::beside(path).and_then(|mut file| {
        write_table(frames, rig, &mut file)?;
        file.as_file().sync_all()?;
        Ok(file)
    });
    staged.map_err(|e| unwritable(path, &e))
}

impl Request {
    /// No file that is read is written, and nothing that exists is overwritten unasked.
    fn check_names(&self, sequence: &Sequence) -> Result<(), RepairError> {
        check_motion_name(&self.output)?;
        let rig = self.rig.all().into_iter().map(|(_, path)| path);
        Names {
            input: &self.rig.skeleton,
            output: &self.output,
            reads: rig.skip(1).chain(sequence.paths()).collect(),
            beside: self.outputs().skip(1).collect(),
            in_place: false,
            force: self.force,
        }
        .check_beside()
    }

    /// The files to write, the motion first.
    fn outputs(&self) -> impl Iterator<Item = &Path> {
        let beside = [Some(self.table.as_path()), self.log.as_deref(), self.page.as_deref()];
        [self.output.as_path()].into_iter().chain(beside.into_iter().flatten())
    }

    /// The files of the clouds as they were named, without folders.
    fn source_name(&self) -> String {
        Path::new(self.clouds.typed()).file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
    }

    /// What the log is to know beforehand.
    fn about(&self, sequence: &Sequence) -> TrackAbout {
        TrackAbout {
            source_name: self.source_name(),
            rate_hz: self.rate_hz,
            first_frame: sequence.first,
            frames: sequence.frames(),
            method: self.method_name().to_owned(),
            options: self.options(),
            cosine: self.settings.cosine,
            log_rate_hz: self.log_rate_hz,
        }
    }

    /// The options that shape the result, by name, for the records.
    fn options(&self) -> Vec<(String, String)> {
        let Settings { sigma0_cm, sigma_end_cm, cosine, outlier, rounds, .. } = self.settings;
        let ball = if self.rig.swing_twist { "swing-twist" } else { "cones" };
        [
            ("sigma0", sigma0_cm.to_string()),
            ("sigma_end", sigma_end_cm.to_string()),
            ("nthresh", cosine.to_string()),
            ("eoutlier", outlier.to_string()),
            ("rounds", rounds.to_string()),
            ("cst_ball", ball.to_owned()),
            ("order", self.order.name().to_ascii_lowercase()),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into()
    }

    /// The name of the method, as on the command line.
    pub fn method_name(&self) -> &'static str {
        match self.settings.method {
            Method::Planes => "planes",
            Method::Report => "report",
        }
    }
}

impl Report {
    fn log_failed(&mut self, path: &Path, error: &LogError) {
        self.log_error = Some(format!("{}: {error}", path.display()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo::actor::Actor;
    use crate::solve::ik::Tree;

    #[test]
    fn clouds_in_another_unit_are_noticed() {
        let actor = Actor::new(1);
        let points = |list: &[[f64; 3]]| list.iter().map(|x| Vec3::from(*x)).collect::<Vec<_>>();
        let vertices = points(&actor.mesh.vertices);
        let body = Body::new(Tree::new(&actor.skeleton, 1.0), vertices.clone(), Vec::new(), Vec::new(), actor.parts.clone());
        for (scale, alike) in [(0.01, false), (0.1, false), (0.5, true), (1.0, true), (2.0, true), (10.0, false), (0.0, false)] {
            let mut cloud = Cloud { points: vertices.iter().map(|x| x * scale).collect(), normals: Vec::new() };
            // other things in the cloud
            cloud.points.extend((0..500).map(|at| Vec3::new(f64::from(at), 1000.0, 500.0)));
            assert_eq!(of_another_size(&cloud, &body).is_none(), alike, "{scale}");
        }
    }
}
