//! The story of one sequence of clouds, from top to bottom: a body is followed through it, and becomes a BVH file.
//!
//! Read the rig, find the files, follow, write to hidden files, prove, rename. Clouds are read ahead of the solver by threads of their own, and the
//! log is written behind it by another one.

mod report;
mod seen;
mod sequence;

use crate::compression;
use crate::error::Left;
use crate::output::{Names, unwritable};
use crate::repair::RepairError;
use crate::rig::bvh::Poses;
use crate::rig::{Rig, RigFiles, read_rig};
use crate::solve::Observer;
use crate::solve::track::{Method, Settings, Tracked, Tracker};
use crate::staging;
use formats::bvh::Order;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;

pub use report::{Lost, Report, Stretch};
pub use seen::{Given, Seen, word, write_table};
pub use sequence::{Clouds, Frame, Pattern, Sequence};

/// Who waits is told this often how far it is.
const TELL_EVERY: Duration = Duration::from_millis(250);

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
    /// Replace files that exist.
    pub force: bool,
}

/// A sequence that was followed to its end.
#[derive(Debug, Default)]
struct Followed {
    poses: Poses,
    frames: Vec<Seen>,
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
    let followed = follow(request, &rig, &sequence, watch, interrupt)?;
    report.took = began.elapsed();
    report.judge(&followed.frames, &rig);
    watch.phase("writing and checking the motion");
    write_out(request, &rig, &followed, report)
}

/// Goes through the sequence, frame by frame.
fn follow(
    request: &Request,
    rig: &Rig,
    sequence: &Sequence,
    watch: &mut dyn Observer,
    interrupt: &AtomicBool,
) -> Result<Followed, RepairError> {
    std::thread::scope(|scope| {
        let mut followed = Followed::default();
        let mut tracker = Tracker::new(&rig.body, rig.limits.as_ref(), rig.start.clone(), request.settings);
        // what was pushed comes out in the same order, but perhaps later
        let mut pushed = VecDeque::new();
        let (began, mut told) = (Instant::now(), Instant::now());
        for frame in sequence.read(rig.unit.cm(), scope) {
            if interrupt.load(Ordering::Relaxed) {
                return Err(RepairError::Interrupted { path: PathBuf::from(request.clouds.typed()), log: Left(None) });
            }
            let Frame { number, cloud } = frame?;
            let given = match &cloud {
                None => Given::Missing,
                Some(cloud) if cloud.points.is_empty() => Given::Empty,
                Some(_) => Given::Cloud,
            };
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
        Ok(followed)
    })
}

impl Followed {
    /// Keeps frames that are done.
    fn take(&mut self, rig: &Rig, pushed: &mut VecDeque<(u32, Given)>, done: Vec<Tracked>) {
        for tracked in done {
            let Some((number, given)) = pushed.pop_front() else { continue };
            self.poses.push(rig, &tracked.pose, &tracked.centres);
            self.frames.push(Seen::new(number, given, &tracked));
        }
    }
}

/// Writes everything under hidden names, proves it, and puts it in place: the motion last.
fn write_out(request: &Request, rig: &Rig, followed: &Followed, mut report: Report) -> Result<Report, RepairError> {
    let motion = followed.poses.stage(rig, request.rate_hz, request.order, &request.output)?;
    let table = stage_table(&request.table, &followed.frames, rig)?;

    // From here on everything is written; what remains are names.
    let mut placed = staging::Placed::default();
    let place = |placed: &mut staging::Placed, file: NamedTempFile, path: &Path| {
        placed.keep(path).and_then(|()| staging::publish(file, path)).map_err(|e| unwritable(path, &e))
    };
    place(&mut placed, table, &request.table)?;
    staging::publish(motion, &request.output).map_err(|e| unwritable(&request.output, &e))?;
    placed.done();
    report.table = Some(request.table.clone());
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
        let inner = compression::inner_name(&self.output);
        if !inner.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bvh")) {
            let problem = "motion is written as BVH; give it a name that ends in .bvh".to_owned();
            return Err(RepairError::Io { path: self.output.clone(), problem });
        }
        let rig = self.rig.all().into_iter().map(|(_, path)| path);
        let beside = [Some(self.table.as_path()), self.log.as_deref()].into_iter().flatten().collect();
        Names {
            input: &self.rig.skeleton,
            output: &self.output,
            reads: rig.skip(1).chain(sequence.paths()).collect(),
            beside,
            in_place: false,
            force: self.force,
        }
        .check_beside()
    }

    /// The name of the method, as on the command line.
    pub fn method_name(&self) -> &'static str {
        match self.settings.method {
            Method::Planes => "planes",
            Method::Report => "report",
        }
    }
}
