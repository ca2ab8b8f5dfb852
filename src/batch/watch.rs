//! Takes of a folder that is watched: handed out when they have stopped growing.
//!
//! The folder is looked through again and again, because file systems on the network tell nobody what happens in them.

use super::BatchError;
use super::ledger::{self, Record};
use super::naming::Names;
use super::plan::PlannedTake;
use super::planning::planned;
use super::run::{Next, Supply};
use super::sources::{Findings, Found, hashes, walk};
use super::store::Place;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How long a take waits that something around it kept from being repaired.
const AGAIN: Duration = Duration::from_secs(60);

/// The takes of a folder, as they come.
pub struct Watched {
    folder: PathBuf,
    settle: Duration,
    every: Duration,
    /// End when everything that is there was handed out.
    once: bool,
    names: Names,
    seen: BTreeMap<String, Seen>,
    ready: VecDeque<Found>,
    looked: Option<Instant>,
    /// What could not be looked into, told already or not yet.
    told: BTreeSet<String>,
    remarks: VecDeque<String>,
}

/// A take as it was when it last changed.
struct Seen {
    bytes: u64,
    modified_ns: Option<u64>,
    since: Instant,
    handed_out: bool,
}

impl Watched {
    /// A take is handed out when neither its size nor its time has changed for `settle`. The folder is looked through each time `every` has passed.
    /// Outputs keep the names that they have in `out`.
    ///
    /// # Errors
    /// The ledgers cannot be read.
    pub fn new(folder: &Path, out: &Place, settle: Duration, every: Duration, once: bool) -> Result<Self, BatchError> {
        let mut names = Names::default();
        ledger::read_all(out, &mut |_, record| {
            if let Record::Take(take) = record {
                names.reserve(&take.output, &take.path);
            }
        })?;
        Ok(Self {
            folder: folder.to_owned(),
            settle,
            every,
            once,
            names,
            seen: BTreeMap::new(),
            ready: VecDeque::new(),
            looked: None,
            told: BTreeSet::new(),
            remarks: VecDeque::new(),
        })
    }

    /// True if something could not be looked into.
    pub fn is_troubled(&self) -> bool {
        !self.told.is_empty()
    }

    /// Looks through the folder; what has stopped growing is ready.
    fn look(&mut self, now: Instant) {
        self.looked = Some(now);
        let mut findings = Findings::default();
        walk(&self.folder, &self.folder, "", &mut findings);
        for text in &findings.unreadable {
            if self.told.insert(text.clone()) {
                self.remarks.push_back(text.clone());
            }
        }
        if !self.folder.is_dir() {
            return; // a share that is away for a while; what was seen there is remembered
        }
        let mut there = BTreeMap::new();
        for found in findings.takes {
            let before = self.seen.remove(&found.path);
            let seen = match before {
                Some(seen) if seen.bytes == found.bytes && seen.modified_ns == found.modified_ns => {
                    let settled = !seen.handed_out && now.checked_duration_since(seen.since).is_some_and(|still| still >= self.settle);
                    if settled {
                        self.ready.push_back(found.clone());
                    }
                    Seen { handed_out: seen.handed_out || settled, ..seen }
                }
                _ => Seen { bytes: found.bytes, modified_ns: found.modified_ns, since: now, handed_out: false },
            };
            there.insert(found.path, seen);
        }
        // what is not there any more may come back as something else
        self.seen = there;
    }

    /// A take as it is now; `None` if it changed while it was read.
    fn planned(&mut self, found: &Found) -> Option<PlannedTake> {
        let sha256 = hashes(std::slice::from_ref(found)).pop().flatten();
        let metadata = std::fs::metadata(&found.source).ok();
        let same = metadata.is_some_and(|now| now.len() == found.bytes && super::sources::modified_ns(&now) == found.modified_ns);
        if !same && found.problem.is_none() {
            let seen = Seen { bytes: found.bytes, modified_ns: None, since: Instant::now(), handed_out: false };
            self.seen.insert(found.path.clone(), seen);
            return None;
        }
        Some(planned(found, sha256, &mut self.names))
    }
}

impl Supply for Watched {
    /// It is handed out again after a while; unless all is to end some time.
    fn failed(&mut self, path: &str) {
        if !self.once
            && let Some(seen) = self.seen.get_mut(path)
        {
            seen.since = Instant::now() + AGAIN;
            seen.handed_out = false;
        }
    }

    fn next(&mut self) -> Next {
        loop {
            if let Some(remark) = self.remarks.pop_front() {
                return Next::Remark(remark);
            }
            if let Some(found) = self.ready.pop_front() {
                if let Some(take) = self.planned(&found) {
                    return Next::Take(Box::new(take));
                }
                continue;
            }
            let now = Instant::now();
            let waited = self.looked.map(|looked| now.duration_since(looked));
            if waited.is_none_or(|waited| waited >= self.every) {
                self.look(now);
                if !self.ready.is_empty() || !self.remarks.is_empty() {
                    continue;
                }
            }
            if self.once && self.seen.values().all(|seen| seen.handed_out) {
                return Next::End;
            }
            return Next::Later(self.every.min(Duration::from_millis(500)));
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn names(watched: &mut Watched, now: Instant) -> Vec<String> {
        watched.look(now);
        let ready: Vec<Found> = watched.ready.drain(..).collect();
        ready.iter().filter_map(|found| watched.planned(found)).map(|take| take.output).collect()
    }

    #[test]
    fn takes_come_when_they_have_stopped_growing_and_again_when_they_change() {
        let (folder, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let place = Place::parse(out.path().to_str().unwrap()).unwrap();
        let settle = Duration::from_secs(10);
        let mut watched = Watched::new(folder.path(), &place, settle, Duration::ZERO, false).unwrap();
        let start = Instant::now();
        let at = |secs: u64| start + Duration::from_secs(secs);
        std::fs::write(folder.path().join("a.c3d"), "one").unwrap();
        std::fs::write(folder.path().join("notes.docx"), "no take").unwrap();
        assert!(names(&mut watched, at(0)).is_empty());
        std::fs::write(folder.path().join("a.c3d"), "longer").unwrap();
        assert!(names(&mut watched, at(9)).is_empty(), "it grew");
        assert!(names(&mut watched, at(12)).is_empty(), "ten seconds after that, not after it came");
        assert_eq!(names(&mut watched, at(20)), ["a.c3d"]);
        assert!(names(&mut watched, at(40)).is_empty(), "once");
        std::fs::write(folder.path().join("a.c3d"), "something else").unwrap();
        assert!(names(&mut watched, at(50)).is_empty());
        assert_eq!(names(&mut watched, at(60)), ["a.c3d"]);
        // one that differs in case only gets another name, whichever came first
        std::fs::write(folder.path().join("A.c3d"), "one").unwrap();
        names(&mut watched, at(70));
        let other = names(&mut watched, at(90));
        assert!(other.len() == 1 && other[0].starts_with("A~"), "{other:?}");
    }
}
