//! An output folder or bucket in use: one run at a time for each shard, its ledger, its hidden files, and what was put aside before.

use super::ledger::{self, Begun, Ledger, Outcome, Record};
use super::plan::{Header, Plan, Shard};
use super::store::{Mode, Place};
use super::{BatchError, OWN_FOLDER};
use crate::input::plain;
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::Path;

/// An output folder in use. The lock goes when it is dropped, or with the process.
pub struct Session {
    /// Below the output folder, the folder for files that have not got their names yet.
    pub work: String,
    /// What was put aside before, by identity, and why.
    pub quarantined: BTreeMap<String, String>,
    lock: Option<File>,
}

impl Session {
    /// Takes the folder for a shard. `of`: what it is a shard of, if others must not disturb it.
    ///
    /// # Errors
    /// Somebody else works on that shard, or the folder cannot be used.
    pub fn open(out: &Place, name: &str) -> Result<Self, BatchError> {
        let work = format!("{OWN_FOLDER}/staging/{name}");
        let mut lock = None;
        if let Some(folder) = out.folder() {
            let own = folder.join(OWN_FOLDER);
            for made in ["ledger", "locks", "plans", "staging"] {
                let made = own.join(made);
                std::fs::create_dir_all(&made).map_err(|e| BatchError::io(&made, "cannot be made", &e))?;
            }
            lock = Some(locked(&own.join("locks").join(name), name)?);
            // what a run left that was killed
            remove(&folder.join(&work))?;
        }
        let mut quarantined = BTreeMap::new();
        ledger::read_all(out, &mut |_, record| {
            let Record::Take(take) = record else { return };
            let Some(identity) = take.planned else { return };
            match take.outcome {
                Outcome::Quarantined => {
                    quarantined.insert(identity, take.reason.unwrap_or_default());
                }
                Outcome::Done | Outcome::Skipped => {
                    quarantined.remove(&identity);
                }
                Outcome::Failed => {}
            }
        })?;
        Ok(Self { work, quarantined, lock })
    }

    /// Begins a ledger.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn ledger(&self, out: &Place, of: &str, shard: Shard, begun: Begun) -> Result<Ledger, BatchError> {
        Ok(Ledger::begin(out, of, shard, begun)?)
    }

    /// Removes what is of no more use.
    pub fn close(self, out: &Place) {
        if let Some(folder) = out.folder() {
            let _ = remove(&folder.join(&self.work)); // the next run tries again
        }
        drop(self.lock);
    }
}

/// Puts a copy of the plan into the output folder, for `status` and `report`.
///
/// # Errors
/// It cannot be written.
pub fn keep_plan(out: &Place, plan: &Path, sha256: &str) -> Result<(), BatchError> {
    let name = format!("{OWN_FOLDER}/plans/{sha256}.jsonl");
    if out.exists(&name)? {
        return Ok(());
    }
    // `put` takes the file it is given
    let copy =
        tempfile::Builder::new().prefix("mocap-repair-plan-").tempfile().map_err(|e| BatchError::io(plan, "cannot be copied", &e))?;
    std::fs::copy(plan, copy.path()).map_err(|e| BatchError::io(plan, "cannot be copied", &e))?;
    out.put(&name, copy.path(), Mode::Replace)?;
    Ok(())
}

/// Refuses a plan that this program cannot run, and an output folder that is an input.
///
/// # Errors
/// Such a plan or folder.
pub fn check(plan: &Path, header: &Header, out: &Place) -> Result<(), BatchError> {
    let version = env!("CARGO_PKG_VERSION");
    if header.version != version {
        return Err(BatchError::at(plan, format!("was made by version {}, and this is {version}; plan again", header.version)));
    }
    check_sources(&header.sources, out)
}

/// Refuses an output folder that is one of the sources.
///
/// # Errors
/// It is.
pub fn check_sources(sources: &[String], out: &Place) -> Result<(), BatchError> {
    for source in sources {
        let same = match out.folder() {
            Some(folder) => crate::staging::same_file(Path::new(source), folder),
            None => source.trim_end_matches('/') == out.shown(),
        };
        if same {
            return Err(BatchError { text: format!("{out}: holds the takes that are read; choose another --out"), again: false });
        }
    }
    Ok(())
}

/// The number and size of the takes of a plan's shard, with its header and hash.
///
/// # Errors
/// It is no whole plan.
pub fn survey(plan: &Path, shard: Shard) -> Result<(Header, String, u64, u64), BatchError> {
    let header = Plan::open(plan, shard)?.header;
    let (takes, bytes) = Plan::totals(plan, shard)?;
    Ok((header, Plan::sha256(plan)?, takes, bytes))
}

/// A file that only one process holds, on one machine or on several that share a file system which locks files.
fn locked(path: &Path, name: &str) -> Result<File, BatchError> {
    let wrong = |problem: String| BatchError::at(path, problem);
    let file = File::options().read(true).write(true).create(true).truncate(false).open(path);
    let mut file = file.map_err(|e| BatchError::io(path, "cannot be made", &e))?;
    match file.try_lock() {
        Ok(()) => {
            let who = format!("process {} on {}", std::process::id(), host());
            // says to others who it is; nothing depends on it
            let _ = file.set_len(0).and_then(|()| file.write_all(who.as_bytes()));
            Ok(file)
        }
        Err(TryLockError::WouldBlock) => {
            let mut who = String::new();
            let _ = file.rewind().and_then(|()| file.read_to_string(&mut who));
            let who = if who.is_empty() { "another process".to_owned() } else { who };
            Err(BatchError::again(format!("{}: {who} works on {name}; wait until it has ended", path.display())))
        }
        Err(TryLockError::Error(error)) if error.kind() == std::io::ErrorKind::Unsupported => Ok(file), // such a file system knows no locks
        Err(TryLockError::Error(error)) => Err(wrong(format!("cannot be locked: {}", plain(&error)))),
    }
}

/// The name of this machine.
pub fn host() -> String {
    sysinfo::System::host_name().unwrap_or_else(|| "unknown".to_owned())
}

fn remove(folder: &Path) -> Result<(), BatchError> {
    // a process that has not noticed yet that its run is gone may still be writing there
    for round in 0.. {
        match std::fs::remove_dir_all(folder) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                if round == 20 {
                    return Err(BatchError::at(folder, format!("cannot be removed: {}", plain(&error))));
                }
                std::thread::sleep(std::time::Duration::from_millis(50));
            }
            _ => break,
        }
    }
    Ok(())
}
