//! The plan of a batch: which takes there are, and how each is repaired. JSON Lines: a header, then one line for each take, the largest first.
//!
//! Everything that shapes the output stands in the plan, so that whoever runs whichever part of it writes the same bytes.
//! It is read line by line: a run takes no more memory for a hundred thousand takes than for ten.

use super::{BatchError, sidecar};
use crate::input::{hash_file, plain};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// The longest line of a plan that is read, in bytes.
const LONGEST_LINE: u64 = 16 << 20;

/// What holds for all takes of a batch.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "message_type", rename = "plan")]
pub struct Header {
    /// Version of the program that made it, and has to run it: another one may write other bytes.
    pub version: String,
    /// The options, as TOML with full file names.
    pub config: String,
    /// SHA-256 of the options that shape the result, and of the files that they name.
    pub config_sha256: String,
    /// The files that options name.
    #[serde(default)]
    pub files: Vec<OptionFile>,
    /// What is written beside each repaired take.
    pub wanted: Wanted,
    /// Where the takes were looked for.
    pub sources: Vec<String>,
    /// Number of takes.
    pub takes: u64,
    /// Their size.
    pub bytes: u64,
}

/// A file that an option names, such as a table of bones.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OptionFile {
    /// Where it lies.
    pub path: PathBuf,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

impl OptionFile {
    /// As it is now.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn read(path: PathBuf) -> Result<Self, BatchError> {
        let (sha256, _) = hash_file(&path).map_err(|e| BatchError::at(&path, format!("cannot be read: {}", plain(&e))))?;
        Ok(Self { path, sha256 })
    }

    /// Whether it still is what was planned with.
    ///
    /// # Errors
    /// It is not, or cannot be read. The text says the way out.
    pub fn check(&self) -> Result<(), String> {
        let path = self.path.display();
        match hash_file(&self.path) {
            Ok((sha256, _)) if sha256 == self.sha256 => Ok(()),
            Ok(_) => Err(format!("{path}: is not what it was when it was planned; plan again")),
            Err(error) => Err(format!("{path}: cannot be read: {}", plain(&error))),
        }
    }
}

/// What is written beside each repaired take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wanted {
    /// The log.
    pub log: bool,
    /// The report to look at.
    pub report: bool,
    /// The table of filled samples.
    pub fills: bool,
}

impl Wanted {
    /// What is added to the name of an output for each of these.
    pub fn extensions(self) -> impl Iterator<Item = &'static str> {
        let all = [(self.log, "mcap"), (self.report, "html"), (self.fills, "fills.csv")];
        all.into_iter().filter(|(wanted, _)| *wanted).map(|(_, extension)| extension)
    }
}

/// A take that is to be repaired.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "message_type", rename = "take")]
pub struct PlannedTake {
    /// Its name in the batch, with `/`: the path below the folder or bucket that it was found in.
    pub path: String,
    /// Where it lies: an absolute path, or an address in a bucket.
    pub source: String,
    /// The name of its output below the output folder, with `/`.
    pub output: String,
    /// Size.
    pub bytes: u64,
    /// When it was last changed, nanoseconds since 1970, if it lies in a folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modified_ns: Option<u64>,
    /// SHA-256, if it was read while planning.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// What the bucket it lies in calls this version of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
    /// Why it cannot even be tried.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

impl PlannedTake {
    /// The key of its output, if the input's hash is known.
    pub fn key(&self, header: &Header) -> Option<String> {
        self.sha256.as_deref().map(|sha256| sidecar::key(sha256, &header.config_sha256, &header.version))
    }

    /// What identifies input and options before the input is read: the key, or else what is known of the input instead.
    pub fn identity(&self, header: &Header) -> String {
        self.key(header).unwrap_or_else(|| {
            let known = format!("{}\n{}\n{}", self.source, self.bytes, self.version.as_deref().unwrap_or_default());
            sidecar::key(&known, &header.config_sha256, &header.version)
        })
    }
}

/// A part of a plan: takes whose path's SHA-256 leaves this remainder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Counted from 0.
    pub index: u32,
    /// Number of shards.
    pub count: u32,
}

impl Shard {
    /// Everything.
    pub const ALL: Self = Self { index: 0, count: 1 };

    /// Reads `I/N`.
    ///
    /// # Errors
    /// It is anything else, or I is not below N. The text says what was expected.
    pub fn parse(text: &str) -> Result<Self, String> {
        let expected = "expected I/N, such as 0/4: shards count from 0, so the last of four is 3/4";
        let (index, count) = text.split_once('/').ok_or(expected)?;
        let (index, count) = (index.trim().parse().map_err(|_| expected)?, count.trim().parse().map_err(|_| expected)?);
        if index < count { Ok(Self { index, count }) } else { Err(expected.to_owned()) }
    }

    /// True if a take of this path belongs to it.
    pub fn has(self, path: &str) -> bool {
        let count = u64::from(self.count.max(1));
        Sha256::digest(path).iter().fold(0, |rest, byte| (rest * 256 + u64::from(*byte)) % count) == u64::from(self.index)
    }
}

/// A plan that is read from a file, take by take.
pub struct Plan {
    /// What holds for all takes.
    pub header: Header,
    path: PathBuf,
    lines: BufReader<File>,
    line: u64,
    shard: Shard,
}

impl Plan {
    /// Opens a plan, of which the takes of `shard` come out.
    ///
    /// # Errors
    /// It cannot be read, or is none.
    pub fn open(path: &Path, shard: Shard) -> Result<Self, BatchError> {
        let file = File::open(path).map_err(|e| BatchError::at(path, format!("cannot be read: {}", plain(&e))))?;
        let mut lines = BufReader::with_capacity(1 << 16, file);
        let first = next_line(&mut lines).map_err(|e| BatchError::at(path, e))?.unwrap_or_default();
        let header = serde_json::from_str(&first).map_err(|e| {
            BatchError::at(
                path,
                format!("is no plan of a batch: its first line is none of a plan ({e}); make one with mocap-repair batch plan"),
            )
        })?;
        Ok(Self { header, path: path.to_owned(), lines, line: 1, shard })
    }

    /// Reads all of it once: number and size of the takes of the shard.
    ///
    /// # Errors
    /// What `each` says of a take of the shard; or a line is none of a plan, or there are fewer takes than its header says, as in one that was cut off.
    pub fn totals(path: &Path, shard: Shard, each: &dyn Fn(&PlannedTake) -> Result<(), BatchError>) -> Result<(u64, u64), BatchError> {
        let all = Self::open(path, Shard::ALL)?;
        let declared = all.header.takes;
        let (mut takes, mut bytes, mut there) = (0, 0, 0);
        for take in all {
            let take = take?;
            there += 1;
            if shard.has(&take.path) {
                each(&take)?;
                takes += 1;
                bytes += take.bytes;
            }
        }
        if there != declared {
            let problem = format!(
                "has {there} takes, its first line says {declared}: it was cut off or changed; make it again with mocap-repair batch plan"
            );
            return Err(BatchError::at(path, problem));
        }
        Ok((takes, bytes))
    }

    /// SHA-256 of a plan's file.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn sha256(path: &Path) -> Result<String, BatchError> {
        hash_file(path).map(|(sha256, _)| sha256).map_err(|e| BatchError::at(path, format!("cannot be read: {}", plain(&e))))
    }
}

/// A line without its end; `None` after the last one.
fn next_line(lines: &mut impl BufRead) -> Result<Option<String>, String> {
    let mut line = String::new();
    let read = lines.by_ref().take(LONGEST_LINE).read_line(&mut line).map_err(|e| format!("cannot be read: {}", plain(&e)))?;
    if read as u64 == LONGEST_LINE {
        return Err(format!("has a line of more than {LONGEST_LINE} bytes, which no plan has"));
    }
    Ok((read > 0).then(|| line.trim_end_matches('\n').to_owned()))
}

impl Iterator for Plan {
    type Item = Result<PlannedTake, BatchError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            self.line += 1;
            let wrong = |problem: String| Some(Err(BatchError::at(&self.path, problem)));
            let line = match next_line(&mut self.lines) {
                Ok(line) => line?,
                Err(problem) => return wrong(problem),
            };
            match serde_json::from_str::<PlannedTake>(&line) {
                Ok(take) if self.shard.has(&take.path) => return Some(Ok(take)),
                Ok(_) => {}
                Err(e) => {
                    return wrong(format!("line {} is no take of a plan ({e}); make it again with mocap-repair batch plan", self.line));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_take_is_in_one_shard() {
        for count in [1, 2, 3, 7, 1000] {
            for path in ["a.c3d", "A/b c.c3d", "ü/ß.csv", ""] {
                let shards: Vec<u32> = (0..count).filter(|&index| Shard { index, count }.has(path)).collect();
                assert_eq!(shards.len(), 1, "{path} of {count}: {shards:?}");
            }
        }
        // sha256("") ends in ...7852b855, an odd number; and modulo 10 by the whole number
        assert!(Shard { index: 1, count: 2 }.has(""));
        assert!(Shard { index: 0x55, count: 256 }.has(""));
    }

    #[test]
    fn shards_are_typed_from_nought() {
        assert_eq!(Shard::parse("3/4"), Ok(Shard { index: 3, count: 4 }));
        for wrong in ["4/4", "1", "a/b", "0/0", "-1/3", "1/2/3", ""] {
            assert!(Shard::parse(wrong).unwrap_err().contains("expected I/N"), "{wrong}");
        }
    }

    #[test]
    fn the_identity_is_the_key_where_there_is_one() {
        let header = Header {
            version: "1".to_owned(),
            config: String::new(),
            config_sha256: "c".to_owned(),
            files: Vec::new(),
            wanted: Wanted::default(),
            sources: Vec::new(),
            takes: 1,
            bytes: 1,
        };
        let take = PlannedTake {
            path: "a".to_owned(),
            source: "s3://b/a".to_owned(),
            output: "a".to_owned(),
            bytes: 1,
            modified_ns: None,
            sha256: Some("s".to_owned()),
            version: None,
            problem: None,
        };
        assert_eq!(take.key(&header), Some(sidecar::key("s", "c", "1")));
        assert_eq!(Some(take.identity(&header)), take.key(&header));
        let remote = |version: &str| PlannedTake { sha256: None, version: Some(version.to_owned()), ..take.clone() }.identity(&header);
        assert_eq!(remote("1"), remote("1"));
        assert_ne!(remote("1"), remote("2"));
    }
}
