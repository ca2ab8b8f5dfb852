//! From what a batch left in its output folder to what is told of each take.
//!
//! Plans and ledgers are read at once: of each take a few hundred bytes are kept. Sidecars are read one after the other while the takes are
//! gone through, some at a time on all cores, and forgotten.

use super::ledgers::{Ledgers, Told};
use super::{About, FleetError, FleetRow, Planned};
use crate::batch::ledger::Outcome;
use crate::batch::sidecar::{self, Sidecar};
use crate::input::plain;
use rayon::prelude::*;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::io::{self, Read as _};
use std::path::{Component, Path, PathBuf};

/// Where everything about running lies, below the output folder.
const RUNNING: &str = ".mocap-repair";

/// Sidecars that are read at a time.
const AT_A_TIME: usize = 256;

/// The output folder, wherever it is. Names are those below it, with `/`.
pub trait Tree: Sync {
    /// Names of the files that lie in a folder, in order; none if it is not there.
    ///
    /// # Errors
    /// It cannot be read.
    fn files(&self, folder: &str) -> Result<Vec<String>, FleetError>;

    /// What is in a file; `None` if it is not there or larger than `limit` bytes.
    ///
    /// # Errors
    /// It cannot be read.
    fn read(&self, name: &str, limit: u64) -> Result<Option<Vec<u8>>, FleetError>;

    /// True if a file is there. `listed`: its sidecar says that it was written, which is enough where looking is dear.
    fn is_there(&self, name: &str, listed: bool) -> bool;

    /// What it is called.
    fn name(&self) -> String;

    /// The folder, if it is one that a page can link into.
    fn folder(&self) -> Option<PathBuf>;
}

/// A folder on a disk.
#[derive(Clone, Debug)]
pub struct Folder(pub PathBuf);

impl Folder {
    /// The file of a name, if the name does not lead out of the folder.
    fn file(&self, name: &str) -> Option<PathBuf> {
        let path = Path::new(name);
        (!name.is_empty() && path.components().all(|part| matches!(part, Component::Normal(_)))).then(|| self.0.join(path))
    }
}

impl Tree for Folder {
    fn files(&self, folder: &str) -> Result<Vec<String>, FleetError> {
        let path = self.0.join(folder);
        let entries = match std::fs::read_dir(&path) {
            Ok(entries) => entries,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(e) => return Err(FleetError::at(path.display(), format!("cannot be read: {}", plain(&e)))),
        };
        let mut names: Vec<String> = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
        names.sort();
        Ok(names)
    }

    fn read(&self, name: &str, limit: u64) -> Result<Option<Vec<u8>>, FleetError> {
        let Some(path) = self.file(name) else { return Ok(None) };
        let mut bytes = Vec::new();
        match std::fs::File::open(&path).and_then(|file| file.take(limit.saturating_add(1)).read_to_end(&mut bytes)) {
            Ok(_) => Ok((bytes.len() as u64 <= limit).then_some(bytes)),
            Err(e) if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => Ok(None),
            Err(e) => Err(FleetError::at(path.display(), format!("cannot be read: {}", plain(&e)))),
        }
    }

    fn is_there(&self, name: &str, _: bool) -> bool {
        self.file(name).is_some_and(|path| path.is_file())
    }

    fn name(&self) -> String {
        let full = self.0.canonicalize().unwrap_or_else(|_| self.0.clone());
        full.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    }

    fn folder(&self) -> Option<PathBuf> {
        Some(self.0.clone())
    }
}

/// What is known of a take before its sidecar is read.
#[derive(Clone, Debug, Default)]
struct Known {
    output: String,
    bytes: u64,
    told: Told,
}

/// What a batch left.
pub struct Collected<'a> {
    tree: &'a dyn Tree,
    /// What holds for all takes.
    pub about: About,
    takes: BTreeMap<String, Known>,
}

/// Reads plans and ledgers. With `plan`, the beginning of a plan's SHA-256, only what it plans is told of.
///
/// # Errors
/// They cannot be read, no batch ran here, or none has this plan.
pub fn collect<'a>(tree: &'a dyn Tree, plan: Option<&str>) -> Result<Collected<'a>, FleetError> {
    let mut about = About { name: tree.name(), folder: tree.folder(), ..About::default() };
    let mut takes: BTreeMap<String, Known> = BTreeMap::new();
    let mut spoilt = Vec::new();
    for name in jsonl(tree, "plans")? {
        let short = name.trim_end_matches(".jsonl").to_owned();
        if plan.is_some_and(|wanted| !wanted.starts_with(&short) && !short.starts_with(wanted)) {
            continue;
        }
        let bytes = tree.read(&format!("{RUNNING}/plans/{name}"), u64::MAX)?.unwrap_or_default();
        match planned(short.clone(), &bytes, &mut takes) {
            Some(planned) => about.plans.push(planned),
            None => spoilt.push(short),
        }
    }
    if let Some(wanted) = plan.filter(|_| about.plans.is_empty()) {
        return Err(FleetError::at(about.name, format!("has no plan {wanted}; without --plan the report is about all plans")));
    }
    let mut ledgers = Ledgers::default();
    for name in jsonl(tree, "ledger")? {
        if plan.is_some() && !about.plans.iter().any(|planned| name.starts_with(&planned.name)) {
            continue;
        }
        ledgers.add(&name, &tree.read(&format!("{RUNNING}/ledger/{name}"), u64::MAX)?.unwrap_or_default());
    }
    (about.attempts, about.wall_secs, about.done_in_runs) = ledgers.runs();
    for (path, told) in ledgers.takes {
        let known = takes.entry(path).or_default();
        if let Some(newest) = &told.newest {
            known.output.clone_from(&newest.output);
            known.bytes = newest.bytes;
        }
        known.told = told;
    }
    if takes.is_empty() && about.plans.is_empty() && about.attempts.is_empty() {
        return Err(FleetError::at(
            about.name,
            "is no output folder of a batch: it has neither plans nor records; name the folder that batch run was given with --out",
        ));
    }
    if ledgers.unread > 0 {
        about.remarks.push(format!("{} of the ledgers cannot be read and are left out", lines(ledgers.unread)));
    }
    for name in spoilt {
        about.remarks.push(format!("the plan {name} cannot be read: what it plans and nobody began is not told of"));
    }
    about.shared_folders = shared_folders(takes.keys().map(String::as_str));
    Ok(Collected { tree, about, takes })
}

fn lines(number: u64) -> String {
    if number == 1 { "1 line".to_owned() } else { format!("{number} lines") }
}

fn jsonl(tree: &dyn Tree, folder: &str) -> Result<Vec<String>, FleetError> {
    let mut names = tree.files(&format!("{RUNNING}/{folder}"))?;
    names.retain(|name| name.strip_suffix(".jsonl").is_some_and(|stem| !stem.is_empty() && !name.starts_with('.')));
    Ok(names)
}

/// Reads a plan and adds its takes; `None` if it has no header. Fields that are not needed here may be there or not.
fn planned(name: String, bytes: &[u8], takes: &mut BTreeMap<String, Known>) -> Option<Planned> {
    #[derive(Deserialize)]
    #[serde(default)]
    #[derive(Default)]
    struct Header {
        version: String,
        config: String,
        config_sha256: String,
        sources: Vec<String>,
        takes: u64,
    }
    #[derive(Deserialize)]
    struct Take {
        path: String,
        output: String,
        bytes: u64,
    }
    let mut lines = bytes.split(|b| *b == b'\n');
    let header: Header = serde_json::from_slice(lines.next()?).ok()?;
    for take in lines.filter_map(|line| serde_json::from_slice::<Take>(line).ok()) {
        takes.insert(take.path, Known { output: take.output, bytes: take.bytes, told: Told::default() });
    }
    let Header { version, config, config_sha256, sources, takes } = header;
    Some(Planned { name, version, config, config_sha256, sources, takes })
}

/// How many of the first folders are the same in all paths.
fn shared_folders<'a>(mut paths: impl Iterator<Item = &'a str>) -> usize {
    fn folders(path: &str) -> Vec<&str> {
        let mut parts: Vec<&str> = path.split('/').collect();
        parts.pop();
        parts
    }
    let mut shared = folders(paths.next().unwrap_or_default());
    for path in paths {
        let same = shared.iter().zip(folders(path)).take_while(|(a, b)| *a == b).count();
        shared.truncate(same);
    }
    shared.len()
}

impl Collected<'_> {
    /// Number of takes.
    pub fn takes(&self) -> usize {
        self.takes.len()
    }

    /// The takes in the order of their paths. Sidecars are read while they are gone through; one that cannot be read is as one that is not there.
    pub fn rows(&self) -> impl Iterator<Item = FleetRow> + '_ {
        let mut takes = self.takes.iter();
        std::iter::from_fn(move || {
            let some: Vec<_> = takes.by_ref().take(AT_A_TIME).collect();
            (!some.is_empty()).then(|| some.into_par_iter().map(|(path, known)| self.row(path, known)).collect::<Vec<_>>())
        })
        .flatten()
    }

    fn row(&self, path: &str, known: &Known) -> FleetRow {
        let mut row = FleetRow { path: path.to_owned(), output: known.output.clone(), bytes: known.bytes, ..FleetRow::default() };
        let Some(newest) = &known.told.newest else { return row };
        row.outcome = Some(newest.outcome);
        row.exit_code = newest.exit_code;
        row.reason.clone_from(&newest.reason);
        row.time = Some(newest.time.clone());
        if let Some(repair) = known.told.repair() {
            row.tries = repair.tries;
            row.elapsed_secs = Some(repair.elapsed_secs);
            row.peak_bytes = repair.peak_bytes;
        }
        if !matches!(newest.outcome, Outcome::Done | Outcome::Skipped) {
            return row; // what may lie there is of another repair
        }
        let bytes = self.tree.read(&format!("{}.{}", row.output, sidecar::EXTENSION), sidecar::LARGEST).ok().flatten();
        row.sidecar =
            bytes.and_then(|bytes| Sidecar::parse(&bytes)).filter(|sidecar| newest.key.as_ref().is_none_or(|key| *key == sidecar.key));
        let name = row.output.rsplit('/').next().unwrap_or_default();
        let is_there = |extension: &str| {
            let listed =
                row.sidecar.as_ref().is_some_and(|sidecar| sidecar.outputs.iter().any(|file| file.name == format!("{name}.{extension}")));
            self.tree.is_there(&format!("{}.{extension}", row.output), listed)
        };
        (row.report, row.log) = (is_there("html"), is_there("mcap"));
        row
    }
}
