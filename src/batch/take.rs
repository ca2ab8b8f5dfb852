//! One take of a batch, from its input to its place in the output tree: what the process does that is started for it.
//!
//! Everything is made in a folder of its own and gets its name at the end: the sidecar first, the repaired take last.
//! Whatever happens in between, a take counts as done only if its sidecar's hashes fit what lies there.

use super::OWN_FOLDER;
use super::job::{Job, TakeResult, Verdict};
use super::memory;
use super::naming::{BESIDE, beside};
use super::plan::{PlannedTake, Wanted};
use super::sidecar::{self, InputFile, MarkerSummary, NoteSaid, OutputFile, Sidecar, Summary};
use super::sources::{is_address, modified_ns};
use super::store::{Kind, Mode, Place, StoreError};
use crate::error::is_full;
use crate::input::{hash_file, plain};
use crate::repair::{RepairError, Request, repair};
use crate::report::Report;
use crate::solve::Observer;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// The files of one repair.
#[derive(Clone, Debug)]
pub struct Files {
    /// The take.
    pub input: PathBuf,
    /// The repaired take.
    pub output: PathBuf,
    /// The log.
    pub log: Option<PathBuf>,
    /// The report to look at.
    pub page: Option<PathBuf>,
    /// The table of filled samples.
    pub fills: Option<PathBuf>,
}

/// Makes what is to be repaired out of files and options (TOML).
pub type RequestOf<'a> = dyn Fn(&Files, &str) -> Result<Request, String> + 'a;

/// Whether a take is done already.
#[derive(Debug)]
pub enum Check {
    /// Its key and the hashes of all its outputs are as they should be.
    Done(Box<Sidecar>),
    /// It is to be done.
    ToDo,
    /// Its input is not what was planned.
    Changed(String),
}

/// Looks whether a take is done: its sidecar has the right key, and everything that is wanted lies there with the right hash.
///
/// # Errors
/// The output folder or bucket does not answer.
pub fn check(out: &Place, take: &PlannedTake, config_sha256: &str, version: &str, wanted: Wanted) -> Result<Check, StoreError> {
    let sha256 = match still_planned(take) {
        Ok(sha256) => sha256,
        Err(problem) => return Ok(Check::Changed(problem)),
    };
    let Some(sidecar) = read_sidecar(out, &take.output)? else { return Ok(Check::ToDo) };
    let same_input = match &sha256 {
        Some(sha256) => sidecar.input.sha256 == *sha256,
        None => take.version.is_some() && sidecar.input.version == take.version && sidecar.input.bytes == take.bytes,
    };
    let key = sidecar::key(&sidecar.input.sha256, config_sha256, version);
    if !same_input || sidecar.key != key || sidecar.path != take.path || !has_all(&sidecar, &take.output, wanted) {
        return Ok(Check::ToDo);
    }
    let folder = take.output.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
    for output in &sidecar.outputs {
        if out.sha256(&format!("{folder}{}", output.name))? != Some((output.sha256.clone(), output.bytes)) {
            return Ok(Check::ToDo);
        }
    }
    Ok(Check::Done(Box::new(sidecar)))
}

/// The SHA-256 of a take that lies in a folder, if it still is what was planned; `None` if it is not known before it is read.
fn still_planned(take: &PlannedTake) -> Result<Option<String>, String> {
    if is_address(&take.source) {
        return Ok(None);
    }
    let path = Path::new(&take.source);
    let Some(planned) = &take.sha256 else {
        // it could not be read then; whoever opens it now will say why if it still cannot
        return Ok(hash_file(path).ok().map(|(sha256, _)| sha256));
    };
    let Ok(metadata) = std::fs::metadata(path) else { return Ok(None) };
    if metadata.len() == take.bytes && modified_ns(&metadata) == take.modified_ns {
        return Ok(Some(planned.clone()));
    }
    match hash_file(path) {
        Ok((sha256, _)) if sha256 == *planned => Ok(Some(sha256)),
        Ok(_) => Err(changed(&take.source)),
        Err(_) => Ok(None),
    }
}

fn changed(source: &str) -> String {
    format!("{source}: is not what it was when it was planned; plan again")
}

fn read_sidecar(out: &Place, output: &str) -> Result<Option<Sidecar>, StoreError> {
    Ok(out.read(&beside(output, sidecar::EXTENSION), sidecar::LARGEST)?.and_then(|bytes| Sidecar::parse(&bytes)))
}

fn has_all(sidecar: &Sidecar, output: &str, wanted: Wanted) -> bool {
    let name = file_name(output);
    let has = |name: &str| sidecar.outputs.iter().any(|file| file.name == name);
    has(name) && wanted.extensions().all(|extension| has(&beside(name, extension)))
}

/// Repairs a take and puts everything into its place.
pub fn run(job: &Job, request_of: &RequestOf<'_>, watch: &mut dyn Observer) -> TakeResult {
    let mut key = None;
    let made = make(job, request_of, watch, &mut key);
    let (outcome, reason, exit_code, summary) = match made {
        Ok((verdict, exit_code, summary)) => (verdict, None, Some(exit_code), Some(summary)),
        // the record says which take it is about
        Err((verdict, reason)) => {
            let prefix = format!("{}: ", job.take.source);
            (verdict, Some(reason.strip_prefix(&prefix).map_or(reason.clone(), str::to_owned)), None, None)
        }
    };
    TakeResult { outcome, reason, exit_code, key, peak_bytes: memory::most_taken(), summary }
}

type Refused = (Verdict, String);

fn make(
    job: &Job,
    request_of: &RequestOf<'_>,
    watch: &mut dyn Observer,
    key: &mut Option<String>,
) -> Result<(Verdict, u8, Summary), Refused> {
    let take = &job.take;
    if take.output.split('/').next() == Some(OWN_FOLDER) {
        return Err((Verdict::Failed, format!("{}: no output can lie in {OWN_FOLDER}; plan again", take.output)));
    }
    for file in &job.files {
        file.check().map_err(|problem| (Verdict::Failed, problem))?;
    }
    let version = env!("CARGO_PKG_VERSION");
    let out = Place::parse(&job.out).map_err(|e| of_store(&e))?;
    refuse_input(&out, take)?;
    // whoever hands out takes may not see what lies there, or somebody else did it in the meantime
    match check(&out, take, &job.config_sha256, version, job.wanted).map_err(|e| of_store(&e))? {
        Check::Done(sidecar) => {
            *key = Some(sidecar.key);
            return Ok((Verdict::Skipped, sidecar.exit_code, sidecar.summary));
        }
        Check::Changed(problem) => return Err((Verdict::Failed, problem)),
        Check::ToDo => {}
    }
    let before = Before::read(&out, &take.output).map_err(|e| of_store(&e))?;
    if !job.force {
        if !before.ours {
            refuse_to_replace(&out, take, job.wanted)?;
        }
        let other = before.sidecar.as_ref().map(|sidecar| &sidecar.input).filter(|input| input.source != take.source);
        if let Some(input) = other.filter(|input| take.sha256.as_ref() != Some(&input.sha256)) {
            let there = format!("{out}/{}: is the output of another take, {}", take.output, input.source);
            return Err((Verdict::Failed, format!("{there}; choose another --out, or say --force to replace it")));
        }
    }

    let work = Work::new(&out, &job.work).map_err(|e| of_io(&e, &job.out))?;
    let input = fetched(take, &work, watch)?;
    let made = work.path.join("out");
    std::fs::create_dir(&made).map_err(|e| of_io(&e, &job.out))?;
    let name = file_name(&take.output);
    let file = |wanted: bool, extension: &str| wanted.then(|| made.join(beside(name, extension)));
    let files = Files {
        input,
        output: made.join(name),
        log: file(job.wanted.log, "mcap"),
        page: file(job.wanted.report, "html"),
        fills: file(job.wanted.fills, "fills.csv"),
    };
    let request = request_of(&files, &job.config).map_err(|problem| (Verdict::Failed, problem))?;
    let report = repair(&request, watch, &AtomicBool::new(false)).map_err(|error| of_repair(&error, &files, take))?;
    *key = Some(sidecar::key(&report.input_sha256, &job.config_sha256, version));
    accept(&report, take)?;

    watch.phase("putting it in place");
    let written = [Some(&files.output), files.log.as_ref(), files.page.as_ref(), files.fills.as_ref()];
    let outputs: Result<Vec<OutputFile>, Refused> =
        written.into_iter().flatten().map(|path| output_file(path).map_err(|e| of_io(&e, &job.out))).collect();
    let sidecar = Sidecar {
        version: version.to_owned(),
        key: key.clone().unwrap_or_default(),
        path: take.path.clone(),
        input: InputFile {
            name: file_name(&take.path).to_owned(),
            source: take.source.clone(),
            bytes: take.bytes,
            sha256: report.input_sha256.clone(),
            version: take.version.clone(),
        },
        config_sha256: job.config_sha256.clone(),
        outputs: outputs?,
        exit_code: report.exit_code(),
        summary: Summary::new(&report),
        markers: MarkerSummary::all(&report),
        notes: report.notes.iter().map(|n| NoteSaid { kind: n.kind().to_owned(), text: n.to_string(), matters: n.matters() }).collect(),
        sidecar_sha256: String::new(),
    };
    // nobody's file is replaced but one of an earlier run
    let mode = if before.ours || job.force { Mode::Replace } else { Mode::Create };
    place(&out, &take.output, &made, &sidecar, &before, mode)?;
    Ok((Verdict::Done, sidecar.exit_code, sidecar.summary))
}

/// The take as a file here: itself, or a copy of what lies in a bucket.
fn fetched(take: &PlannedTake, work: &Work, watch: &mut dyn Observer) -> Result<PathBuf, Refused> {
    if !is_address(&take.source) {
        return Ok(PathBuf::from(&take.source));
    }
    watch.phase("fetching it");
    let folder = work.path.join("in");
    std::fs::create_dir(&folder).map_err(|e| of_io(&e, &take.source))?;
    let file = folder.join(file_name(&take.source));
    let (parent, name) = take.source.rsplit_once('/').unwrap_or(("", &take.source));
    Place::parse(parent).and_then(|place| place.fetch(name, &file)).map_err(|e| of_store(&e))?;
    let bytes = std::fs::metadata(&file).map_err(|e| of_io(&e, &take.source))?.len();
    if bytes == take.bytes { Ok(file) } else { Err((Verdict::Failed, changed(&take.source))) }
}

/// A repair that went well and is no good all the same.
fn accept(report: &Report, take: &PlannedTake) -> Result<(), Refused> {
    if take.sha256.as_ref().is_some_and(|planned| *planned != report.input_sha256) {
        return Err((Verdict::Failed, changed(&take.source)));
    }
    if let Some(error) = &report.log_error {
        let full = report.log_refused.is_some_and(is_full);
        return Err((if full { Verdict::DiskFull } else { Verdict::Again }, error.clone()));
    }
    let samples = report.frames * report.markers;
    if samples > 0 && report.missing_samples() == samples {
        let (frames, markers) = (report.frames, report.markers);
        let problem = format!(
            "{}: no marker was ever seen: all {markers} are missing in all {frames} frames, so there is nothing to fill from",
            take.source
        );
        return Err((Verdict::BadInput, problem));
    }
    Ok(())
}

/// Gives everything its name: the sidecar first, the repaired take last.
fn place(out: &Place, output: &str, made: &Path, sidecar: &Sidecar, before: &Before, mode: Mode) -> Result<(), Refused> {
    let refused = |e: StoreError| of_store(&e);
    // What is not wanted any more goes while the sidecar is still there that says whose it is. Only names that outputs can have: a sidecar may
    // have been written by anybody.
    for extension in BESIDE {
        let name = beside(file_name(output), extension);
        let listed = |sidecar: &Sidecar| sidecar.outputs.iter().any(|file| file.name == name);
        if before.sidecar.as_ref().is_some_and(listed) && !listed(sidecar) {
            out.remove(&beside(output, extension)).map_err(refused)?;
        }
    }
    let sidecar_name = beside(output, sidecar::EXTENSION);
    let sidecar_file = made.join(file_name(&sidecar_name));
    std::fs::write(&sidecar_file, sidecar.text()).map_err(|e| of_io(&e, output))?;
    let own = output_file(&sidecar_file).map_err(|e| of_io(&e, output))?;
    let folder = output.strip_suffix(file_name(output)).unwrap_or_default();
    for file in std::iter::once(&own).chain(sidecar.outputs.iter().skip(1)).chain(sidecar.outputs.first()) {
        let name = format!("{folder}{}", file.name);
        if !out.put(&name, &made.join(&file.name), mode).map_err(refused)? {
            // another run of the same take may have been quicker, or this one before its connection broke
            let there = out.sha256(&name).map_err(refused)?;
            if there.is_none_or(|(sha256, _)| sha256 != file.sha256) {
                let mine = out.sha256(&sidecar_name).map_err(refused)?.is_some_and(|(sha256, _)| sha256 == own.sha256);
                if file.name != own.name && mine {
                    out.remove(&sidecar_name).map_err(refused)?;
                }
                return Err((Verdict::Failed, format!("{out}/{name}: was put there by somebody else in the meantime")));
            }
        }
    }
    Ok(())
}

/// What lies in the output folder from an earlier run.
struct Before {
    /// What it left, if that is whole.
    sidecar: Option<Sidecar>,
    /// What lies there comes from a batch.
    ours: bool,
}

impl Before {
    fn read(out: &Place, output: &str) -> Result<Self, StoreError> {
        let bytes = out.read(&beside(output, sidecar::EXTENSION), sidecar::LARGEST)?;
        let sidecar = bytes.as_deref().and_then(Sidecar::parse);
        // one that is damaged still says whose it is
        let ours = sidecar.is_some() || bytes.is_some_and(|bytes| bytes.starts_with(br#"{"message_type":"sidecar""#));
        Ok(Self { sidecar, ours })
    }
}

/// The input is never written, whatever is forced.
fn refuse_input(out: &Place, take: &PlannedTake) -> Result<(), Refused> {
    let names = std::iter::once(take.output.clone()).chain(BESIDE.into_iter().map(|extension| beside(&take.output, extension)));
    for name in names {
        let same = match out.folder() {
            Some(folder) => !is_address(&take.source) && crate::staging::same_file(Path::new(&take.source), &folder.join(&name)),
            None => take.source == format!("{out}/{name}"),
        };
        if same {
            return Err((Verdict::Failed, "is the take that is read; choose another --out".to_owned()));
        }
    }
    Ok(())
}

/// Nothing is replaced that does not come from a batch.
fn refuse_to_replace(out: &Place, take: &PlannedTake, wanted: Wanted) -> Result<(), Refused> {
    let beside = wanted.extensions().chain([sidecar::EXTENSION]).map(|extension| beside(&take.output, extension));
    for name in std::iter::once(take.output.clone()).chain(beside) {
        if out.exists(&name).map_err(|e| of_store(&e))? {
            let problem = format!(
                "{out}/{name}: exists already and does not come from a batch; move it away, choose another --out, or say --force to replace it"
            );
            return Err((Verdict::Failed, problem));
        }
    }
    Ok(())
}

/// A folder for files that have not got their names yet. It goes when it is dropped; what a kill leaves goes with the next run of its shard,
/// or on a machine that works for a bucket, with the next take there.
struct Work {
    path: PathBuf,
    _held: Option<(tempfile::TempDir, File)>,
}

/// What temporary folders of takes are called, and the file in each that its process holds.
const TEMPORARY: &str = "mocap-repair-take-";
const HELD: &str = "held";

impl Work {
    /// Below the output folder, so that names cost nothing; or, for a bucket, where temporary files are.
    fn new(out: &Place, name: &str) -> io::Result<Self> {
        let Some(folder) = out.folder() else {
            sweep(&std::env::temp_dir());
            let held = tempfile::Builder::new().prefix(TEMPORARY).tempdir()?;
            // whoever sees the file sees it held
            let fresh = held.path().join("fresh");
            let file = File::create(&fresh)?;
            file.lock()?;
            std::fs::rename(fresh, held.path().join(HELD))?;
            return Ok(Self { path: held.path().to_owned(), _held: Some((held, file)) });
        };
        if !folder.join(OWN_FOLDER).is_dir() {
            let problem = "the output folder is not what it was when the run began; is it still connected?";
            return Err(io::Error::new(io::ErrorKind::NotFound, problem));
        }
        let path = folder.join(name);
        if path.exists() {
            std::fs::remove_dir_all(&path)?;
        }
        std::fs::create_dir_all(&path)?;
        Ok(Self { path, _held: None })
    }
}

/// Removes temporary folders whose processes are gone. What cannot be removed is in nobody's way.
fn sweep(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name().as_encoded_bytes().starts_with(TEMPORARY.as_bytes()) && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            let held = File::open(entry.path().join(HELD));
            if held.is_ok_and(|file| file.try_lock().is_ok()) {
                let _ = std::fs::remove_dir_all(entry.path());
            }
        }
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.path); // the next run tries again
    }
}

fn file_name(path: &str) -> &str {
    path.rsplit_once('/').map_or(path, |(_, name)| name)
}

fn output_file(path: &Path) -> io::Result<OutputFile> {
    let (sha256, bytes) = hash_file(path)?;
    Ok(OutputFile { name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(), bytes, sha256 })
}

fn of_store(error: &StoreError) -> Refused {
    let verdict = match error.kind {
        Kind::Full => Verdict::DiskFull,
        Kind::Again => Verdict::Again,
        Kind::NotFound | Kind::Denied | Kind::Unsupported | Kind::Other => Verdict::Failed,
    };
    (verdict, error.to_string())
}

fn of_io(error: &io::Error, place: &str) -> Refused {
    let said = if error.get_ref().is_some() { error.to_string() } else { plain(error) };
    (of_system(error.kind()), format!("{place}: {said}"))
}

/// What the system refuses may go well another time, unless somebody has to do something first.
fn of_system(kind: io::ErrorKind) -> Verdict {
    match kind {
        kind if is_full(kind) => Verdict::DiskFull,
        io::ErrorKind::PermissionDenied | io::ErrorKind::NotFound | io::ErrorKind::ReadOnlyFilesystem => Verdict::Failed,
        _ => Verdict::Again,
    }
}

/// What is not the system's fault is the input's, unless it is about another file.
fn of_repair(error: &RepairError, files: &Files, take: &PlannedTake) -> Refused {
    let verdict = match error.system() {
        Some(kind) => of_system(kind),
        None if matches!(error, RepairError::Interrupted { .. }) => Verdict::Again,
        // a table of bones or the like is the same for all takes
        None if error.path() != files.input && error.path() != files.output => Verdict::Failed,
        None => Verdict::BadInput,
    };
    // names of copies and of hidden folders tell nobody anything
    let text = error.to_string();
    let text = text.replace(&files.input.display().to_string(), &take.source).replace(&files.output.display().to_string(), &take.output);
    (verdict, text)
}
