//! The story of one take of labelled markers, from top to bottom: the motion of a body that wears them becomes a BVH file.
//!
//! Read the rig and the take, find out where markers sit, weigh what was seen, solve, write to hidden files, prove, rename.
//! How the motion is solved for is [`crate::solve::markers`]' business.

mod report;
mod seen;

use crate::error::RepairError;
use crate::fills;
use crate::input::{Opened, Reading, expand, open, read};
use crate::log::{FitAbout, write_fit_log};
use crate::output::{Names, check_motion_name, put_in_place, unwritable};
use crate::page::Page;
use crate::rig::bvh::Poses;
use crate::rig::map::Worn;
use crate::rig::unit::{note, other_unit};
use crate::rig::wearer::WearerFiles;
use crate::rig::{Rig, read_rig};
use crate::solve::Observer;
use crate::solve::ik::Posed;
use crate::solve::ik::terms::Marker;
use crate::solve::markers::{Settings, solve};
use crate::staging;
use formats::bvh::Order;
use formats::{Direction, Stated, Take};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub use report::{Calibrated, MarkerReport, Report, Unseen};
pub use seen::{Fitted, SIGMA_CM, weigh, write_table};

/// What is wanted.
#[derive(Clone, Debug)]
pub struct Request {
    /// The take. Never written, as all that is read.
    pub input: PathBuf,
    /// What the user states about it.
    pub reading: Reading,
    /// The body, and where the markers sit on it.
    pub wearer: WearerFiles,
    /// The table of samples that were filled, with how sure they are.
    pub fills: Option<PathBuf>,
    /// How the motion is solved for.
    pub settings: Settings,
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
    /// Look and tell, solve and write nothing.
    pub dry_run: bool,
}

/// Solves for the motion of a body from the markers that it wears.
///
/// # Errors
/// A file cannot be read or written, or the files do not belong together. Then no file was written.
pub fn fit(request: &Request, watch: &mut dyn Observer) -> Result<Report, RepairError> {
    let began = Instant::now();
    request.check_names()?;
    watch.phase("reading the body and the take");
    let mut rig = read_rig(&request.wearer.rig)?;
    let mut opened = open(&request.input, &request.reading)?;
    let mut worn = request.wearer.worn(&rig, opened.document.take())?;
    if let Some(unit) = other_unit(&rig, &worn, &opened, &request.input, &request.reading)? {
        let stated = Stated { unit: Some(unit), ..request.reading.stated.clone() };
        opened = open(&request.input, &Reading { stated, ..request.reading.clone() })?;
        opened.notes.add(note(unit));
    }
    let sigmas = request.sigmas(opened.document.take())?;
    let turn = opened.document.take().up.map(|from| (from, rig.up())).filter(|(from, to)| from != to);
    let turned = turn.map(|(from, to)| opened.document.take().turned(from, to));
    let take = turned.as_ref().unwrap_or(opened.document.take());
    if worn.markers.iter().all(|(column, ..)| (0..take.frames()).all(|frame| take.position_mm(frame, *column).is_none())) {
        let problem =
            "no marker of the body is seen in any frame, so there is no motion to solve for; is another file meant, or another --map?";
        return Err(RepairError::Io { path: request.input.clone(), problem: problem.to_owned() });
    }
    if request.dry_run {
        let mut report = Report::new(request, &rig, &opened, turn);
        report.foresee(take, &worn, &rig);
        return Ok(report);
    }
    let mut calibrated = None;
    if request.wearer.calibrate {
        watch.phase("finding out where markers sit");
        let seen = weigh(take, &worn, &sigmas);
        calibrated = Some(request.wearer.calibrate(&mut rig, &mut worn, &seen)?);
    }
    watch.phase("solving for the motion");
    let solving = Instant::now();
    let fitted = solved(request, &rig, take, &worn, &sigmas);
    let mut report = Report::new(request, &rig, &opened, turn);
    report.calibrated = calibrated.map(|found| Calibrated::new(&found, &rig));
    report.solve_took = solving.elapsed();
    report.judge(&fitted, &rig);
    report.took = began.elapsed();
    watch.phase("writing and checking the motion");
    write_out(request, &rig, &opened, &fitted, report)
}

/// The motion, and how far markers are from where it has them.
fn solved<'a>(request: &Request, rig: &Rig, take: &'a Take, worn: &'a Worn, sigmas: &BTreeMap<(usize, usize), f64>) -> Fitted<'a> {
    let seen = weigh(take, worn, sigmas);
    let markers: Vec<Marker> = worn.markers.iter().map(|(_, _, marker, _)| *marker).collect();
    let solution = solve(&rig.body.tree, rig.limits.as_ref(), &markers, &seen, &request.settings);
    Fitted::new(take, worn, seen, solution, rig)
}

/// Writes everything under hidden names, proves it, and puts it in place: the motion last.
fn write_out(request: &Request, rig: &Rig, opened: &Opened, fitted: &Fitted<'_>, mut report: Report) -> Result<Report, RepairError> {
    let mut poses = Poses::default();
    let mut posed = Posed::new(&rig.body.tree);
    for pose in &fitted.solution.poses {
        posed.set(&rig.body.tree, pose);
        poses.push(rig, pose, &posed.centres);
    }
    let motion = poses.stage(rig, opened.document.take().rate_hz, request.order, &request.output)?;
    drop(poses);
    let table = staging::beside(&request.table).and_then(|mut file| {
        write_table(fitted, &mut file)?;
        file.as_file().sync_all()?;
        Ok(file)
    });
    let table = table.map_err(|e| unwritable(&request.table, &e))?;
    let mut beside = vec![(table, request.table.as_path())];
    let mut whole = None;
    if let Some(path) = &request.log {
        let told = Report {
            output: Some(request.output.clone()),
            table: Some(request.table.clone()),
            log: Some(path.clone()),
            page: request.page.clone(),
            ..report.clone()
        };
        match write_fit_log(path, rig, &request.about(opened), fitted, &told) {
            Ok(log) => whole = Some((path.as_path(), log)),
            Err(error) => report.log_error = Some(format!("{}: {error}", path.display())),
        }
    }
    if let Some(path) = &request.page {
        let page = Page::of_fit(rig, &report, fitted, request.about(opened));
        let staged = page.stage(path).and_then(|file| file.as_file().sync_all().map(|()| file));
        beside.push((staged.map_err(|e| unwritable(path, &e))?, path));
    }
    let log = whole.as_ref().map(|(path, _)| path.to_path_buf());
    match put_in_place(beside, whole, (motion, &request.output))? {
        Some(error) => report.log_error = log.map(|path| format!("{}: {error}", path.display())),
        None => report.log = log,
    }
    report.table = Some(request.table.clone());
    report.page.clone_from(&request.page);
    report.output = Some(request.output.clone());
    Ok(report)
}

impl Request {
    /// No file that is read is written, and nothing that exists is overwritten unasked.
    fn check_names(&self) -> Result<(), RepairError> {
        check_motion_name(&self.output)?;
        Names {
            input: &self.input,
            output: &self.output,
            reads: self.wearer.all().chain(self.fills.as_deref()).chain(self.reading.tables()).collect(),
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

    /// What the log is to know.
    fn about(&self, opened: &Opened) -> FitAbout {
        let bare = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let ball = if self.wearer.rig.swing_twist { "swing-twist" } else { "cones" };
        let mut options = vec![
            ("map".to_owned(), self.wearer.map.as_deref().map_or_else(|| "labels".to_owned(), bare)),
            ("calibrate".to_owned(), self.wearer.calibrate.to_string()),
            ("order".to_owned(), self.order.name().to_ascii_lowercase()),
            ("cst_ball".to_owned(), ball.to_owned()),
            ("smooth".to_owned(), self.settings.smooth.to_string()),
        ];
        options.extend(self.fills.iter().map(|path| ("fills".to_owned(), bare(path))));
        FitAbout { source_name: bare(&self.input), source_sha256: opened.sha256.clone(), options, log_rate_hz: self.log_rate_hz }
    }

    /// How sure filled samples are, mm.
    fn sigmas(&self, take: &Take) -> Result<BTreeMap<(usize, usize), f64>, RepairError> {
        let Some(path) = &self.fills else { return Ok(BTreeMap::new()) };
        fills::read_sigmas(&expand(read(path)?, path)?, take).map_err(|problem| RepairError::Io { path: path.clone(), problem })
    }
}

/// Which way a take was turned: what pointed along the first one points along the second one.
pub type Turn = (Direction, Direction);
