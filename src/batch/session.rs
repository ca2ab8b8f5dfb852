//! An output folder or bucket in use: one run at a time for each shard, its ledger, its hidden files, and what was put aside before.

use super::ledger::{self, How, Outcome, Record, TakeRecord, Try};
use super::plan::{Header, Plan, PlannedTake, Shard};
use super::store::{Mode, Place};
use super::{BatchError, OWN_FOLDER};
use crate::input::plain;
use sha2::{Digest, Sha256};
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
    /// Which folder it is, if the system can tell.
    identity: Option<(u64, u64)>,
    locks: Vec<File>,
}

impl Session {
    /// Takes the folder for what is called `name`, such as a shard. `group`: others of the same group may work there at the same time.
    ///
    /// # Errors
    /// Somebody else works on that shard, or on something else, or the folder cannot be used.
    pub fn open(out: &Place, name: &str, group: &str) -> Result<Self, BatchError> {
        let work = format!("{OWN_FOLDER}/staging/{name}");
        let mut locks = Vec::new();
        if let Some(folder) = out.folder() {
            let own = folder.join(OWN_FOLDER);
            for made in ["ledger", "locks", "plans", "staging"] {
                let made = own.join(made);
                std::fs::create_dir_all(&made).map_err(|e| BatchError::io(&made, "cannot be made", &e))?;
            }
            locks.extend(grouped(&own.join("locks"), group)?);
            let lock = locked(&own.join("locks").join(name), name)?;
            if lock.is_some() {
                // what a run left that was killed
                remove(&folder.join(&work))?;
            }
            locks.extend(lock);
        }
        // Ledgers come in no order of time. Of takes that went well it is enough to know when: sixteen bytes for each.
        let mut aside: BTreeMap<String, (u64, String)> = BTreeMap::new();
        let mut well: BTreeMap<u64, u64> = BTreeMap::new();
        ledger::read_all(out, &mut |_, record| {
            let Record::Take(take) = record else { return };
            let Some(identity) = &take.planned else { return };
            let (name, time) = (known(identity, &take.path), stamp(&take.time));
            if take.outcome == Outcome::Quarantined && stays(&take) {
                if aside.get(&name).is_none_or(|before| before.0 <= time) {
                    aside.insert(name, (time, take.reason.unwrap_or_default()));
                }
            } else {
                let last = well.entry(short(&name)).or_default();
                *last = time.max(*last);
            }
        })?;
        aside.retain(|name, (time, _)| well.get(&short(name)).is_none_or(|last| last < time));
        let quarantined = aside.into_iter().map(|(name, (_, reason))| (name, reason)).collect();
        let identity = out.folder().and_then(|folder| identity(&folder.join(OWN_FOLDER)));
        Ok(Self { work, quarantined, identity, locks })
    }

    /// Why outputs cannot be put where they belong any more: the folder was there when the session began.
    pub fn gone(&self, out: &Place) -> Option<String> {
        let folder = out.folder()?;
        let there = identity(&folder.join(OWN_FOLDER));
        (there.is_none() || there != self.identity)
            .then(|| format!("{out}: is not the folder any more that it was when the run began; is the disk still connected?"))
    }

    /// Removes what is of no more use.
    pub fn close(self, out: &Place) {
        if let Some(folder) = out.folder() {
            let _ = remove(&folder.join(&self.work)); // the next run tries again
        }
        drop(self.locks);
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

/// Reads the copy that [`keep_plan`] made: what holds for all takes, and each take with that.
///
/// # Errors
/// It is not there, or is no plan.
pub fn kept_plan(out: &Place, sha256: &str, each: &mut dyn FnMut(&Header, PlannedTake)) -> Result<Header, BatchError> {
    let name = format!("{OWN_FOLDER}/plans/{sha256}.jsonl");
    let temporary = |e| BatchError { text: format!("a temporary file cannot be made: {e}"), again: true };
    let copy = tempfile::NamedTempFile::new().map_err(temporary)?;
    let path = if let Some(folder) = out.folder() {
        folder.join(&name)
    } else {
        out.fetch(&name, copy.path())?;
        copy.path().to_owned()
    };
    let plan = Plan::open(&path, Shard::ALL)?;
    let header = plan.header.clone();
    for take in plan {
        each(&header, take?);
    }
    Ok(header)
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
/// It is no whole plan, or one of its takes would be its own output.
pub fn survey(plan: &Path, shard: Shard, out: &Place) -> Result<(Header, String, u64, u64), BatchError> {
    let header = Plan::open(plan, shard)?.header;
    let (takes, bytes) = Plan::totals(plan, shard, &|take| {
        let itself = match out.folder() {
            Some(folder) => Path::new(&take.source) == folder.join(&take.output),
            None => take.source == format!("{out}/{}", take.output),
        };
        let problem = "is the take that is read, and would be the output; choose another --out";
        if itself { Err(BatchError::at(Path::new(&take.source), problem)) } else { Ok(()) }
    })?;
    Ok((header, Plan::sha256(plan)?, takes, bytes))
}

/// What a take that was put aside is known by: takes of one content and different names are different takes, because names decide about formats.
pub fn known(identity: &str, path: &str) -> String {
    format!("{identity}\n{path}")
}

/// A file that only one process holds, on one machine or on several that share a file system which locks files.
/// `None` where the file system knows no locks.
fn locked(path: &Path, name: &str) -> Result<Option<File>, BatchError> {
    let file = File::options().read(true).write(true).create(true).truncate(false).open(path);
    let mut file = file.map_err(|e| BatchError::io(path, "cannot be made", &e))?;
    match file.try_lock() {
        Ok(()) => {
            let who = format!("process {} on {}", std::process::id(), host());
            // says to others who it is; nothing depends on it
            let _ = file.set_len(0).and_then(|()| file.write_all(who.as_bytes()));
            Ok(Some(file))
        }
        Err(TryLockError::WouldBlock) => {
            let mut who = String::new();
            let _ = file.rewind().and_then(|()| file.read_to_string(&mut who));
            let who = if who.is_empty() { "another process".to_owned() } else { who };
            Err(BatchError::again(format!("{}: {who} works on {name}; wait until it has ended", path.display())))
        }
        Err(TryLockError::Error(_)) => Ok(None),
    }
}

/// A lock that all of one group hold together, and that nobody of another group may hold at the same time: two plans, or one in two divisions
/// into shards, would do each other's work again.
fn grouped(folder: &Path, group: &str) -> Result<Option<File>, BatchError> {
    let name = format!("{group}.group");
    for other in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_group = Path::new(&other.file_name()).extension().is_some_and(|e| e == "group");
        if is_group && other.file_name() != name.as_str() && File::open(other.path()).is_ok_and(|file| is_held(&file)) {
            let problem = "another plan, or another division into shards, is being run here; wait until it has ended";
            return Err(BatchError::again(format!("{}: {problem}", other.path().display())));
        }
    }
    let path = folder.join(name);
    let file =
        File::options().write(true).create(true).truncate(false).open(&path).map_err(|e| BatchError::io(&path, "cannot be made", &e))?;
    Ok(file.try_lock_shared().is_ok().then_some(file))
}

fn is_held(file: &File) -> bool {
    matches!(file.try_lock(), Err(TryLockError::WouldBlock))
}

/// True for takes that will not go better next time. Where the system or a bucket refused, or a machine was lost, the next run tries again.
fn stays(take: &TakeRecord) -> bool {
    let around = |one: &Try| one.ended == How::Lost || (one.ended == How::Exit && one.code == Some(75));
    take.tries.last().is_none_or(|last| !around(last))
}

/// Which file or folder it is, whatever its name.
fn identity(path: &Path) -> Option<(u64, u64)> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        std::fs::metadata(path).ok().map(|data| (data.dev(), data.ino()))
    }
    #[cfg(not(unix))]
    {
        path.is_dir().then_some((0, 0))
    }
}

/// A time in UTC (RFC 3339) as a number that grows.
fn stamp(time: &str) -> u64 {
    let digits = time.bytes().filter(u8::is_ascii_digit).chain(std::iter::repeat(b'0')).take(17);
    digits.fold(0, |number, digit| number * 10 + u64::from(digit - b'0'))
}

/// Eight bytes that stand for a name.
fn short(name: &str) -> u64 {
    Sha256::digest(name).iter().take(8).fold(0, |number, byte| (number << 8) | u64::from(*byte))
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
