//! The story of one take, from file to file. Read [`repair`] first.

use crate::bones;
use crate::error::Left;
use crate::gaps::{Open, Policy, gaps};
use crate::input::{Opened, Reading, hex, open, read};
use crate::log::{self, About, Attachment, Closing, Ended, Event, LogError, McapLog, Shown, Up};
use crate::output::{self, Names, Written, original_name, unwritable};
use crate::page::{Curves, Page};
use crate::pattern::matches;
use crate::report::{GapReport, Report, StageReport};
use crate::rig::wearer::WearerFiles;
use crate::solve::auto::Stiffness;
use crate::solve::body::guess_up;
use crate::solve::lds::{EStep, Hidden, Init};
use crate::solve::{Bone, Gap, Limits, Method, Observer, Outcome, Problem, Settings, Solved, Stop};
use crate::suspects::{self, SuspectReport, Treatment};
use crate::{compression, fills, staging};
use formats::{Direction, Role, Take};
use sha2::{Digest, Sha256};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use tempfile::NamedTempFile;

pub use crate::error::RepairError;

/// What is wanted.
#[derive(Clone, Debug)]
#[allow(clippy::struct_excessive_bools)] // each is a switch of its own
pub struct Request {
    /// The take to read. Never written, except that `in_place` puts the repaired file under its name.
    pub input: PathBuf,
    /// The file to write; not used with `dry_run`.
    pub output: PathBuf,
    /// Replace the input by the repaired take, and keep the input as `<name>.orig`.
    pub in_place: bool,
    /// The log to write, if any.
    pub log: Option<PathBuf>,
    /// The table of filled samples to write, if any.
    pub fills: Option<PathBuf>,
    /// The report to look at, if any.
    pub page: Option<PathBuf>,
    /// A file of bones that overrules those found.
    pub bones: Option<PathBuf>,
    /// Replace files that exist.
    pub force: bool,
    /// Read, decide and report, but solve and write nothing.
    pub dry_run: bool,
    /// Write computing times into the log.
    pub timings: bool,
    /// The most frames per second on the topics of the log that are drawn in space; all if absent.
    pub log_rate_hz: Option<f64>,
    /// Put the input into the log.
    pub log_source: bool,
    /// How to fill.
    pub method: Method,
    /// Settings of the method.
    pub settings: Settings,
    /// The most EM iterations.
    pub iterations: u32,
    /// Relative change of the log-likelihood that counts as none.
    pub tolerance: f64,
    /// Seed of the random numbers, for methods that draw some.
    pub seed: u64,
    /// Which gaps are filled.
    pub policy: Policy,
    /// The body that wears the markers, for methods that need one.
    pub wearer: Option<WearerFiles>,
    /// Patterns of the markers whose gaps are filled; all if empty.
    pub markers: Vec<String>,
    /// What the user states about the file.
    pub reading: Reading,
    /// Other files that are read, such as tables: none of them may be replaced.
    pub reads: Vec<PathBuf>,
    /// The options that shape the result, those that nobody said included, as the TOML that `--config` reads: for the records.
    pub config: String,
    /// What becomes of suspect samples.
    pub outliers: Treatment,
}

/// Repairs one take: the main job.
///
/// # Errors
/// Whatever keeps the output from being written whole; then no file was written at all.
pub fn repair(request: &Request, watch: &mut dyn Observer, interrupt: &AtomicBool) -> Result<Report, RepairError> {
    if !request.dry_run {
        request.names().check()?;
    }
    let name = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    watch.phase(&format!("reading {}", name(&request.input)));
    let opened = open(&request.input, &request.reading)?;
    watch.phase("looking for suspects, bones and gaps");
    let Searched { opened, evidence, bones, suspects, raw } = search(request, opened)?;
    let before = opened.document.take();
    let found = gaps(before);
    let asked_for = asked_for(request, before)?;
    let settings = request.settings_for(&opened)?;
    let mut decisions: Vec<Result<(), Open>> = found.iter().map(|gap| request.policy.decide(gap, before, asked_for[gap.marker])).collect();
    let mut report = Report::new(request, &opened, &bones, request.bones.is_some());
    report.suspects = suspects;
    if request.dry_run {
        report.gaps = GapReport::all(&found, &decisions, before, &[]);
    } else {
        let mut repaired = before.clone();
        let problem = Problem::new(&evidence, &neighbours(before), &bones);
        let about = about(request, &opened, &bones, up(before, &problem));
        let mut log = start_log(request, about.clone(), &mut report);
        let mut curves = request.page.is_some().then(Curves::default);
        if decisions.iter().any(Result::is_ok) && problem.markers() > 0 {
            let meter = watch.meter();
            let limits = Limits {
                steps: request.iterations,
                tolerance: request.tolerance,
                interrupt: Some(interrupt),
                meter: meter.as_deref(),
                ..Limits::default()
            };
            let solved = request.method.solve(&problem, &settings, &limits, &mut (&mut log, (&mut curves, &mut *watch)));
            if interrupt.load(Ordering::Relaxed) {
                let log = log.and_then(|log| leave_log(log, &raw, &bones, request, Ended::Interrupted));
                return Err(RepairError::Interrupted { path: request.input.clone(), log: Left(log) });
            }
            if let Err(problem) = accept(&solved) {
                let log = log.and_then(|log| leave_log(log, &raw, &bones, request, Ended::Failed));
                return Err(RepairError::Solve { path: request.input.clone(), method: request.method.name(), problem, log: Left(log) });
            }
            report.stages = solved.stages.iter().map(StageReport::new).collect();
            let estimate = &solved.estimate;
            report.samples = fills::fill(&mut repaired, &problem, estimate, &found, &mut decisions, request.policy.max_sigma_mm);
            repaired.filled_by = Some(request.method.name().to_owned());
            report.explain(&problem, &solved.explanations, before);
        } else {
            for decision in decisions.iter_mut().filter(|d| d.is_ok()) {
                *decision = Err(Open::Unsolved);
            }
        }
        report.gaps = GapReport::all(&found, &decisions, before, &report.samples);
        report.attach_explanations(&found);
        drop((problem, evidence)); // as large as the take, and of no more use
        watch.phase(&format!("writing and checking {}", name(&request.output)));
        let found = Found { gaps: &found, bones: &bones, raw: &raw, about, curves };
        return write_out(request, opened, repaired, found, log, report, watch);
    }
    report.notes = opened.notes.take();
    Ok(report)
}

/// A solver that broke down is an error; one that merely ran out of steps is not.
fn accept(solved: &Solved) -> Result<(), String> {
    match solved.outcome() {
        Some(Outcome { stop: Stop::Failed, error, .. }) => {
            Err(error.as_ref().map_or_else(|| "no reason given".to_owned(), ToString::to_string))
        }
        _ => Ok(()),
    }
}

/// Ends the log of a repair that came to nothing: it shows how far that came. What has its name already stays, unless it is such a log itself.
fn leave_log(log: McapLog, take: &Take, bones: &[Bone], request: &Request, ended: Ended) -> Option<PathBuf> {
    let path = log.path().to_owned();
    if staging::is_there(&path) && !log::is_unfinished(&path) {
        return None;
    }
    let shown = Shown { raw: take, repaired: None, bones, samples: &[], log_rate_hz: request.log_rate_hz };
    let message = format!("the repair was {}, no take was written", ended.word());
    let events = vec![Event { frame: 0, warning: true, name: request.method.name().to_owned(), message }];
    // that there is no log either is no news to somebody who has just been told that there is no take
    log.finish(&Closing { ended, shown: Some(shown), events, ..Closing::default() }).ok().map(|_| path)
}

/// Columns that take part in solving, and between which bones are looked for: all markers.
pub fn neighbours(take: &Take) -> Vec<bool> {
    take.markers.iter().map(|m| m.role == Role::Marker).collect()
}

/// A take after the search for samples that no body makes.
struct Searched {
    opened: Opened,
    /// What fills are made from: the take, without what is ignored.
    evidence: Take,
    /// The bones of that.
    bones: Vec<Bone>,
    suspects: Vec<SuspectReport>,
    /// The take as it was read, with what is dropped.
    raw: Take,
}

/// Looks for samples that no body makes, and opens the take again without them if they are to be dropped.
fn search(request: &Request, opened: Opened) -> Result<Searched, RepairError> {
    let take = opened.document.take();
    let bones = chosen_bones(request, take)?;
    let found = suspects::find(take, &bones);
    let raw = take.clone(); // shares its positions
    let samples = suspects::samples(&found, take);
    let suspects = SuspectReport::all(&found, take, request.outliers);
    if found.is_empty() || request.outliers == Treatment::Told {
        let evidence = take.clone();
        return Ok(Searched { opened, evidence, bones, suspects, raw });
    }
    if request.outliers == Treatment::Ignored {
        let evidence = take.without(&samples);
        let bones = chosen_bones(request, &evidence)?;
        return Ok(Searched { opened, evidence, bones, suspects, raw });
    }
    let sha256 = opened.sha256;
    drop(opened.document); // there must be room for it once only
    let opened = open(&request.input, &Reading { dropped: samples, ..request.reading.clone() })?;
    if opened.sha256 != sha256 {
        return Err(changed(&request.input));
    }
    let evidence = opened.document.take().clone();
    let bones = chosen_bones(request, &evidence)?;
    Ok(Searched { opened, evidence, bones, suspects, raw })
}

/// The bones: those that the user stated, else those that are found.
fn chosen_bones(request: &Request, take: &Take) -> Result<Vec<Bone>, RepairError> {
    let Some(path) = &request.bones else {
        return Ok(bones::find(take, &neighbours(take)));
    };
    let wrong = |error| RepairError::Bones { path: path.clone(), error };
    let stated = bones::parse(&read(path)?).map_err(wrong)?;
    bones::resolve(&stated, take).map_err(wrong)
}

/// For each column, whether its gaps may be filled.
fn asked_for(request: &Request, take: &Take) -> Result<Vec<bool>, RepairError> {
    let mut asked = vec![request.markers.is_empty(); take.markers.len()];
    for pattern in &request.markers {
        let mut fits = false;
        for (column, marker) in take.markers.iter().enumerate() {
            if marker.role == Role::Marker && (matches(pattern, &marker.label) || matches(pattern, marker.name())) {
                asked[column] = true;
                fits = true;
            }
        }
        if !fits {
            let labels = (0..take.markers.len()).map(|m| take.display_label(m)).collect::<Vec<_>>().join(", ");
            return Err(RepairError::NoSuchMarker { path: request.input.clone(), pattern: pattern.clone(), labels });
        }
    }
    Ok(asked)
}

/// Which axis points up, for those who look at the take.
fn up(take: &Take, problem: &Problem) -> Up {
    match take.up {
        Some(up) => Up::Stated(up),
        None if problem.markers() < 3 => Up::Unknown,
        None => Up::Guessed(Direction { axis: guess_up(problem), positive: true }),
    }
}

/// What is known beforehand, for the log and the report to look at.
fn about(request: &Request, opened: &Opened, bones: &[Bone], up: Up) -> About {
    let take = opened.document.take();
    About {
        source_name: request.input.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
        source_sha256: opened.sha256.clone(),
        rate_hz: take.rate_hz,
        first_frame: take.first_frame,
        frames: take.frames(),
        markers: take.markers.len(),
        bones: bones.len(),
        up,
        unit: take.unit.symbol().to_owned(),
        seed: request.seed,
        method: request.method.name().to_owned(),
        options: request.options(),
        timings: request.timings,
    }
}

/// Begins the log. That the log cannot be written does not keep the take from being repaired: it is reported.
fn start_log(request: &Request, about: About, report: &mut Report) -> Option<McapLog> {
    let path = request.log.as_ref()?;
    match McapLog::create(path, about) {
        Ok(log) => Some(log),
        Err(error) => {
            report.log_failed(path, &error);
            None
        }
    }
}

/// What was found in a take, and what was seen while it was repaired.
struct Found<'a> {
    gaps: &'a [Gap],
    bones: &'a [Bone],
    raw: &'a Take,
    about: About,
    curves: Option<Curves>,
}

/// Writes the output, proves it, and puts everything in place: the table and the log first, the output last.
fn write_out(
    request: &Request,
    opened: Opened,
    mut repaired: Take,
    Found { gaps, bones, raw, about, curves }: Found<'_>,
    log: Option<McapLog>,
    mut report: Report,
    watch: &mut dyn Observer,
) -> Result<Report, RepairError> {
    let target = &request.output;
    let way = output::way(&request.input, opened.format, target);
    // what replaces a compressed file is compressed, whatever its name
    let compressed = compression::is_named(target) || (request.in_place && opened.compressed);
    let Written { file, notes, sha256, elsewhere } = output::write(way, opened, &repaired, compressed, target)?;
    if let Some(written) = elsewhere {
        repaired = fills::as_written(&mut report.samples, repaired, &written);
    }
    report.judge_bones(bones, &repaired, request.hard());
    report.notes = notes.take();

    let mut beside: Vec<(&Path, NamedTempFile)> = Vec::new();
    if let Some(path) = &request.fills {
        let mut table = staging::beside(path).map_err(|e| unwritable(path, &e))?;
        fills::write(&report.samples, &repaired, request.method, &mut table).map_err(|e| unwritable(path, &e))?;
        beside.push((path, table));
    }
    let shown = Shown { raw, repaired: Some(&repaired), bones, samples: &report.samples, log_rate_hz: request.log_rate_hz };
    if let (Some(path), Some(curves)) = (&request.page, &curves) {
        watch.phase("writing the report");
        let page = Page::of_repair(&about, shown, &report.json_for_log(request), curves);
        let written = page.map_err(io::Error::other).and_then(|page| page.stage(path));
        beside.push((path, written.map_err(|e| unwritable(path, &e))?));
    }
    let mut whole = None;
    if let (Some(log), Some(path)) = (log, &request.log) {
        watch.phase("writing the log");
        let mut events = log::of_gaps(gaps, &report.gaps);
        events.extend(log::of_suspects(&report.suspects));
        events.extend(report.notes.iter().map(|note| Event::note(note.matters(), note.to_string())));
        let closing = Closing {
            ended: Ended::Done,
            results: report.results(),
            attachments: attachments(request, &report, &sha256)?,
            shown: Some(shown),
            events,
        };
        match log.write(&closing) {
            Ok(log) => whole = Some((path, log)),
            Err(error) => report.log_failed(path, &error),
        }
    }
    for (path, file) in &beside {
        file.as_file().sync_all().map_err(|e| unwritable(path, &e))?;
    }

    // From here on everything is written; what remains are names, the take's last.
    let mut placed = staging::Placed::default();
    for (path, file) in beside {
        placed.keep(path).and_then(|()| staging::publish(file, path)).map_err(|e| unwritable(path, &e))?;
    }
    if let Some((path, log)) = whole {
        placed.keep(path).map_err(|e| unwritable(path, &e))?;
        match log.place() {
            Ok(_) => report.log = Some(path.clone()),
            Err(error) => report.log_failed(path, &error),
        }
    }
    if request.in_place {
        // whoever may not read the original may not read the repaired take either
        let same = std::fs::metadata(&request.input).and_then(|input| file.as_file().set_permissions(input.permissions()));
        same.map_err(|e| unwritable(target, &e))?;
        let kept = original_name(&request.input);
        keep_original(&request.input, &kept, &sha256)?;
        placed.added(&kept);
    }
    staging::publish(file, target).map_err(|e| unwritable(target, &e))?;
    placed.done();
    report.output = Some(target.clone());
    Ok(report)
}

/// The files that go into the log: the options, the report, and the input if it is wanted.
fn attachments(request: &Request, report: &Report, sha256: &str) -> Result<Vec<Attachment>, RepairError> {
    let bytes = report.json_for_log(request).into_bytes();
    let mut files = vec![
        Attachment {
            name: "config.toml".to_owned(),
            media_type: "application/toml".to_owned(),
            bytes: request.config.clone().into_bytes(),
        },
        Attachment { name: "report.jsonl".to_owned(), media_type: "application/jsonl".to_owned(), bytes },
    ];
    if request.log_source {
        let bytes = read(&request.input)?;
        if hex(&Sha256::digest(&bytes)) != sha256 {
            return Err(changed(&request.input));
        }
        let name = request.input.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        files.push(Attachment { name, media_type: "application/octet-stream".to_owned(), bytes });
    }
    Ok(files)
}

/// The input is no longer what was read.
fn changed(input: &Path) -> RepairError {
    let problem = "was changed by someone else while it was repaired; nothing was written, run it again".to_owned();
    RepairError::Io { path: input.to_owned(), problem }
}

/// Copies the input to `kept`, whole or not at all, and only if it still is what was read.
fn keep_original(input: &Path, kept: &Path, sha256: &str) -> Result<(), RepairError> {
    let copied = staging::beside(kept).and_then(|file| {
        std::fs::copy(input, file.path())?;
        file.as_file().sync_all()?;
        Ok((hex(&Sha256::digest(std::fs::read(file.path())?)), file))
    });
    let (copied_sha256, file) = copied.map_err(|e| unwritable(kept, &e))?;
    if copied_sha256 != sha256 {
        return Err(changed(input));
    }
    file.persist_noclobber(kept).map_err(|e| unwritable(kept, &e.error))?;
    Ok(())
}

impl Request {
    /// The files to write.
    fn names(&self) -> Names<'_> {
        let beside = [&self.log, &self.fills, &self.page].into_iter().filter_map(|path| path.as_deref()).collect();
        let reads = self.reads.iter().map(PathBuf::as_path).collect();
        Names { input: &self.input, reads, output: &self.output, beside, in_place: self.in_place, force: self.force }
    }

    /// The settings, with the body that wears the take's markers if the method needs one.
    fn settings_for(&self, opened: &Opened) -> Result<Settings, RepairError> {
        let Some(files) = self.wearer.as_ref().filter(|_| self.method.needs_body()) else { return Ok(self.settings.clone()) };
        let (wearer, notes) = files.wearer(opened, &self.input, &self.reading)?;
        for note in notes {
            opened.notes.add(note);
        }
        Ok(Settings { wearer: Some(wearer), ..self.settings.clone() })
    }

    /// True if bones are to keep their lengths exactly.
    pub fn hard(&self) -> bool {
        self.method == Method::BoleroHc || (self.method == Method::Auto && self.settings.stiffness == Stiffness::Hard)
    }

    /// The options that shape the result, by name, for the records.
    pub fn options(&self) -> Vec<(String, String)> {
        let mut options = vec![
            (
                "hidden".to_owned(),
                match self.settings.hidden {
                    Hidden::Count(count) => count.to_string(),
                    Hidden::Energy(share) => format!("energy {share}"),
                },
            ),
            ("lambda".to_owned(), self.settings.lambda.map_or_else(|| "spread".to_owned(), |l| l.to_string())),
            ("e_step".to_owned(), if self.settings.e_step == EStep::Imputing { "imputing" } else { "exact" }.to_owned()),
            ("start".to_owned(), format!("{:?}", self.settings.start).to_lowercase()),
            (
                "init".to_owned(),
                match self.settings.init {
                    Init::Components => "pca".to_owned(),
                    Init::Random(seed) => format!("random {seed}"),
                },
            ),
            ("noise".to_owned(), format!("{:?}", self.settings.noise).to_lowercase()),
            ("step".to_owned(), format!("{:?}", self.settings.step).to_lowercase()),
            ("constant_term".to_owned(), self.settings.constant.to_string()),
            ("iterations".to_owned(), self.iterations.to_string()),
            ("tolerance".to_owned(), self.tolerance.to_string()),
            ("extrapolate".to_owned(), self.policy.extrapolate.to_string()),
            ("bones".to_owned(), format!("{:?}", self.settings.stiffness).to_lowercase()),
            ("max_sigma".to_owned(), self.policy.max_sigma_mm.map_or_else(|| "none".to_owned(), |s| s.to_string())),
            ("max_gap".to_owned(), self.policy.max_gap.map_or_else(|| "none".to_owned(), |g| g.to_string())),
        ];
        if !self.markers.is_empty() {
            options.push(("markers".to_owned(), self.markers.join(",")));
        }
        match self.outliers {
            Treatment::Told => {}
            Treatment::Ignored => options.push(("outliers".to_owned(), "ignored".to_owned())),
            Treatment::Dropped => options.push(("outliers".to_owned(), "dropped".to_owned())),
        }
        options
    }
}

impl Report {
    fn log_failed(&mut self, path: &Path, error: &LogError) {
        self.log_refused = if let LogError::Io(error) = error { Some(error.kind()) } else { None };
        self.log_error = Some(format!("{}: {error}", path.display()));
    }
}
