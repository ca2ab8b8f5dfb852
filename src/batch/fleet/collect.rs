//! From what a batch left in its output folder to what is told of each take.
//!
//! Plans and ledgers are read at once: of each take a few hundred bytes are kept. Sidecars are read while the takes are gone through, some
//! at a time on all cores, and forgotten.

use super::ledgers::{Ledgers, Told};
use super::{About, FleetRow, Planned};
use crate::batch::ledger::{self, Begun, Outcome, Record};
use crate::batch::naming::beside;
use crate::batch::session::kept_plan;
use crate::batch::sidecar::{self, Sidecar};
use crate::batch::store::{Place, StoreError};
use crate::batch::{BatchError, OWN_FOLDER};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// Sidecars that are read at a time.
const AT_A_TIME: usize = 256;

/// Which takes are told of.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Plans {
    /// Those of the plan that was run last, as `batch status` has it; of a folder that is watched, those that came.
    #[default]
    Last,
    /// Those of the plan whose SHA-256 begins like this.
    Of(String),
    /// Those of all plans, and all others that were ever done here.
    All,
}

/// What is known of a take before its sidecar is read.
#[derive(Clone, Debug, Default)]
struct Known {
    output: String,
    bytes: u64,
    /// What a record must be of; any will do if there is none.
    identity: Option<String>,
    told: Told,
}

/// What a batch left.
pub struct Collected {
    out: Place,
    /// What holds for all takes.
    pub about: About,
    takes: BTreeMap<String, Known>,
    unread: Mutex<Vec<StoreError>>,
}

/// Reads plans and ledgers.
///
/// # Errors
/// They cannot be read, no batch ran here, or none of this plan.
pub fn collect(out: &Place, plans: &Plans) -> Result<Collected, BatchError> {
    let folder = out.folder().map(|folder| folder.canonicalize().unwrap_or_else(|_| folder.to_owned()));
    let name = match &folder {
        Some(folder) => folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default(),
        None => out.shown().to_owned(),
    };
    let mut about = About { name, folder, ..About::default() };
    let chosen = chosen(out, plans)?;
    let mut takes: BTreeMap<String, Known> = BTreeMap::new();
    for sha256 in &chosen {
        about.plans.push(planned(out, sha256, *plans == Plans::All, &mut takes)?);
    }
    // of what is watched, and of everything, whatever has a record is told of
    let open = chosen.is_empty() || *plans == Plans::All;
    let mut ledgers = Ledgers::default();
    ledger::read_all(out, &mut |name, record| match record {
        Record::Take(take) => {
            if open && !takes.contains_key(&take.path) {
                takes.insert(take.path.clone(), Known { output: take.output.clone(), bytes: take.bytes, ..Known::default() });
            }
            ledgers.count(name, &take);
            let Some(known) = takes.get_mut(&take.path) else { return };
            if known.identity.is_none() || take.planned.is_none() || known.identity == take.planned {
                known.told.add(take, name);
            }
        }
        Record::Begun(begun) => {
            let counts = *plans == Plans::All || begun.plan.as_ref().map_or(chosen.is_empty(), |plan| chosen.contains(plan));
            ledgers.begin(name, begun, counts);
        }
        Record::Ended(ended) => ledgers.end(name, &ended),
    })?;
    (about.attempts, about.wall_secs, about.done_in_runs) = ledgers.runs();
    for known in takes.values_mut() {
        if let Some(newest) = &known.told.newest {
            known.output.clone_from(&newest.output);
            known.bytes = newest.bytes;
        }
    }
    about.shared_folders = shared_folders(takes.keys().map(String::as_str));
    Ok(Collected { out: out.clone(), about, takes, unread: Mutex::default() })
}

/// SHA-256 of the plans whose takes are told of, the one that was run first to the front; none for a folder that is watched.
fn chosen(out: &Place, plans: &Plans) -> Result<Vec<String>, BatchError> {
    let mut begun: Vec<Begun> = Vec::new();
    ledger::read_all(out, &mut |_, record| {
        if let Record::Begun(one) = record {
            begun.push(one);
        }
    })?;
    begun.sort_by(|a, b| a.time.cmp(&b.time));
    let Some(newest) = begun.last() else {
        return Err(BatchError { text: format!("{out}: holds no batch: there is no {OWN_FOLDER}/ledger in it"), again: false });
    };
    let mut all: Vec<String> = Vec::new();
    for sha256 in begun.iter().filter_map(|begun| begun.plan.as_ref()) {
        if !all.contains(sha256) {
            all.push(sha256.clone());
        }
    }
    match plans {
        Plans::All => Ok(all),
        Plans::Last => Ok(newest.plan.iter().cloned().collect()),
        Plans::Of(wanted) => {
            all.retain(|sha256| sha256.starts_with(wanted.as_str()));
            match all.len() {
                1 => Ok(all),
                0 => Err(BatchError { text: format!("{out}: no plan that begins with {wanted} was run here"), again: false }),
                _ => Err(BatchError { text: format!("{out}: {} plans begin with {wanted}; give more of it", all.len()), again: false }),
            }
        }
    }
}

/// Reads the copy of a plan and adds its takes.
fn planned(out: &Place, sha256: &str, any: bool, takes: &mut BTreeMap<String, Known>) -> Result<Planned, BatchError> {
    let header = kept_plan(out, sha256, &mut |header, take| {
        let identity = (!any).then(|| take.identity(header));
        takes.insert(take.path, Known { output: take.output, bytes: take.bytes, identity, told: Told::default() });
    })?;
    Ok(Planned {
        name: sha256.chars().take(8).collect(),
        version: header.version,
        config: header.config,
        config_sha256: header.config_sha256,
        sources: header.sources,
        takes: header.takes,
    })
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

impl Collected {
    /// Number of takes.
    pub fn takes(&self) -> usize {
        self.takes.len()
    }

    /// How many sidecars could not be read by now, and what was said of one.
    pub fn unread(&self) -> Option<(usize, StoreError)> {
        let unread = self.unread.lock().ok()?;
        unread.first().map(|first| (unread.len(), first.clone()))
    }

    /// The takes in the order of their paths. Sidecars are read while they are gone through; one that cannot be read is as one that is not
    /// there, and [counted](Self::unread).
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
        let bytes = self.out.read(&beside(&row.output, sidecar::EXTENSION), sidecar::LARGEST).unwrap_or_else(|error| {
            if let Ok(mut unread) = self.unread.lock() {
                unread.push(error);
            }
            None
        });
        let fits = |sidecar: &Sidecar| newest.key.as_ref().is_none_or(|key| *key == sidecar.key);
        row.sidecar = bytes.and_then(|bytes| Sidecar::parse(&bytes)).filter(fits);
        (row.report, row.log) = (self.has(&row, "html"), self.has(&row, "mcap"));
        row
    }

    /// True if a file of this extension lies beside the output of a take. In a bucket, where looking is dear, the sidecar is believed.
    fn has(&self, row: &FleetRow, extension: &str) -> bool {
        let name = beside(&row.output, extension);
        match self.out.folder() {
            Some(_) => self.out.exists(&name).unwrap_or(false),
            None => row.sidecar.as_ref().is_some_and(|sidecar| {
                sidecar
                    .outputs
                    .iter()
                    .any(|file| name.strip_suffix(file.name.as_str()).is_some_and(|before| before.is_empty() || before.ends_with('/')))
            }),
        }
    }
}
