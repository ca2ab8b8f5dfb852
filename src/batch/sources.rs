//! Where takes come from: folders, patterns, single files, lists, buckets.
//!
//! A file is a take if its extension (behind which `.zst` may stand) names a format. Everything else is counted and told.
//! Files and folders whose names begin with a dot are not looked at, nor are output folders of batches.

use super::store::{Place, StoreError};
use super::{BatchError, OWN_FOLDER};
use crate::compression;
use crate::input::{hash_file, hex, plain};
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// What makes a name a pattern.
const WILD: [char; 3] = ['*', '?', '['];

/// A take that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// Its name in the batch, with `/`.
    pub path: String,
    /// An absolute path, or an address in a bucket.
    pub source: String,
    /// Size.
    pub bytes: u64,
    /// When it was last changed, nanoseconds since 1970.
    pub modified_ns: Option<u64>,
    /// What its bucket calls this version of it.
    pub version: Option<String>,
    /// Why it cannot even be tried.
    pub problem: Option<String>,
}

/// What was found.
#[derive(Debug, Default)]
pub struct Findings {
    /// The takes.
    pub takes: Vec<Found>,
    /// Files that are no takes, by their extensions.
    pub others: BTreeMap<String, u64>,
    /// Folders that are outputs of batches.
    pub outputs: Vec<PathBuf>,
    /// What could not be looked into, and why.
    pub unreadable: Vec<String>,
}

/// Looks for takes in everything that is named. With more than one source, names begin with that of the source.
///
/// # Errors
/// A source is not there, or a bucket cannot be listed.
pub fn find(sources: &[String]) -> Result<Findings, BatchError> {
    let mut findings = Findings::default();
    let several = sources.len() > 1;
    let folders: BTreeSet<PathBuf> =
        sources.iter().filter(|source| !is_address(source)).filter_map(|source| local(source).ok()?.canonicalize().ok()).collect();
    let names = told_apart(&folders);
    for source in sources {
        let named = |name: Option<String>| if several { name.map_or(String::new(), |name| name + "/") } else { String::new() };
        if is_address(source) {
            find_in_bucket(source, &named, &mut findings)?;
            continue;
        }
        let path = local(source)?;
        if path.is_dir() {
            let path = path.canonicalize().map_err(|e| BatchError::at(&path, plain(&e)))?;
            if let Some(output) = output_around(&path) {
                findings.outputs.push(output);
                continue;
            }
            let prefix = named(names.get(&path).cloned());
            walk(&path, &path, &prefix, &mut findings);
        } else if path.exists() {
            let root = path.parent().unwrap_or(Path::new("")).to_owned();
            findings.add(&path, &root, "", &path.metadata().map_err(|e| BatchError::at(&path, plain(&e)))?);
        } else if source.contains(WILD) {
            find_by_pattern(source, &named, &mut findings)?;
        } else {
            return Err(BatchError::at(
                &path,
                "no such file or folder; name a folder, a take, a pattern in quotes or the address of a bucket",
            ));
        }
    }
    findings.settle();
    Ok(findings)
}

/// The last parts of each folder's name that are enough to tell them apart: `takes` and `scans`, or `day 1/takes` and `day 2/takes`.
fn told_apart(folders: &BTreeSet<PathBuf>) -> BTreeMap<PathBuf, String> {
    let last = |folder: &Path, parts: usize| {
        let all: Vec<_> = folder.iter().map(|part| part.to_string_lossy().into_owned()).filter(|part| part != "/").collect();
        all[all.len().saturating_sub(parts)..].join("/")
    };
    let most = folders.iter().map(|folder| folder.iter().count()).max().unwrap_or(1);
    let apart = (1..=most).find(|&parts| folders.iter().map(|folder| last(folder, parts)).collect::<BTreeSet<_>>().len() == folders.len());
    folders.iter().map(|folder| (folder.clone(), last(folder, apart.unwrap_or(most)))).collect()
}

/// The output folder of a batch that this folder lies in, or is.
fn output_around(folder: &Path) -> Option<PathBuf> {
    folder.ancestors().find(|around| around.join(OWN_FOLDER).is_dir()).map(Path::to_owned)
}

/// The lines of a list: one source each, `#` begins a comment. Names begin below what all of them have in common.
///
/// # Errors
/// The list cannot be read, or what it names is not there.
pub fn find_listed(list: &Path) -> Result<Findings, BatchError> {
    let bytes = crate::input::read(list).map_err(BatchError::from)?;
    let text =
        String::from_utf8(bytes).map_err(|_| BatchError::at(list, "is not UTF-8 text; a list has one path or address on each line"))?;
    let folder = list.parent().unwrap_or(Path::new(""));
    let mut findings = Findings::default();
    for (at, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        if is_address(line) {
            let before = findings.takes.len();
            find_in_bucket(line, &|_| String::new(), &mut findings)?;
            for take in findings.takes.iter_mut().skip(before) {
                take.path = after_scheme(&take.source).to_owned();
            }
            continue;
        }
        let of_line = |problem: &str| BatchError::at(list, format!("line {}: {line}: {problem}", at + 1));
        let path = if line.starts_with("file://") { local(line)? } else { absolute(&folder.join(line))? };
        let root = Path::new("/");
        match path.metadata() {
            Ok(metadata) if metadata.is_dir() => walk(&path, root, "", &mut findings),
            Ok(metadata) => findings.add(&path, root, "", &metadata),
            Err(_) if line.contains(WILD) => {
                let pattern = path.to_str().ok_or_else(|| of_line("is not UTF-8 text"))?;
                let literal = pattern.find(WILD).and_then(|wild| pattern.get(..wild)).unwrap_or_default();
                let literal = literal.rfind('/').and_then(|end| literal.get(..=end)).unwrap_or("/");
                fitting(pattern, Path::new(literal), root, "", &mut findings).map_err(|e| of_line(&e.text))?;
            }
            Err(error) => return Err(of_line(&plain(&error))),
        }
    }
    let common = common_folders(findings.takes.iter().map(|take| take.path.as_str()));
    for take in &mut findings.takes {
        take.path.drain(..common);
    }
    findings.settle();
    Ok(findings)
}

/// The length of the folders that all paths begin with, the last `/` included.
fn common_folders<'a>(mut paths: impl Iterator<Item = &'a str>) -> usize {
    let Some(first) = paths.next() else { return 0 };
    let folder = |path: &str| path.rfind('/').map_or(0, |end| end + 1);
    paths.fold(folder(first), |common, path| {
        let alike = first.bytes().zip(path.bytes()).take(common).take_while(|(a, b)| a == b).count();
        folder(first.get(..alike).unwrap_or_default())
    })
}

/// True if the extension names a format of takes.
pub fn is_take(name: &Path) -> bool {
    let inner = compression::inner_name(name);
    inner.extension().and_then(|e| e.to_str()).is_some_and(|extension| formats::by_extension(extension).is_some())
}

/// All takes below a folder. `root`: what names are taken from.
pub fn walk(folder: &Path, root: &Path, prefix: &str, findings: &mut Findings) {
    let hidden = |entry: &walkdir::DirEntry| entry.depth() > 0 && entry.file_name().as_encoded_bytes().starts_with(b".");
    let mut entries = walkdir::WalkDir::new(folder).follow_links(true).sort_by_file_name().into_iter();
    while let Some(entry) = entries.next() {
        match entry {
            Ok(entry) if hidden(&entry) => {
                if entry.file_type().is_dir() {
                    entries.skip_current_dir();
                }
            }
            Ok(entry) if entry.file_type().is_dir() => {
                // a link may lead into the middle of one
                let output = if entry.path_is_symlink() {
                    entry.path().canonicalize().ok().and_then(|path| output_around(&path))
                } else {
                    entry.path().join(OWN_FOLDER).is_dir().then(|| entry.path().to_owned())
                };
                if let Some(output) = output {
                    findings.outputs.push(output);
                    entries.skip_current_dir();
                }
            }
            Ok(entry) if entry.file_type().is_file() => match entry.metadata() {
                Ok(metadata) => findings.add(entry.path(), root, prefix, &metadata),
                Err(error) => findings.unreadable.push(format!("{}: {error}", entry.path().display())),
            },
            Ok(_) => {} // a device, a pipe
            Err(error) => findings.unreadable.push(error.to_string()),
        }
    }
}

fn find_by_pattern(source: &str, named: &impl Fn(Option<String>) -> String, findings: &mut Findings) -> Result<(), BatchError> {
    let literal = source.find(WILD).and_then(|wild| source.get(..wild)).unwrap_or_default();
    let root = absolute(Path::new(literal.rfind('/').and_then(|end| literal.get(..=end)).unwrap_or(".")))?;
    let prefix = named(root.file_name().map(|name| name.to_string_lossy().into_owned()));
    fitting(source, &root, &root, &prefix, findings)
}

/// Everything that fits a pattern. `literal`: the folder before its first wild character; `root`: what names are taken from.
fn fitting(pattern: &str, literal: &Path, root: &Path, prefix: &str, findings: &mut Findings) -> Result<(), BatchError> {
    let wrong = |problem: String| BatchError::at(Path::new(pattern), problem);
    let mut matched = false;
    for path in glob::glob(pattern).map_err(|e| wrong(format!("is no pattern: {e}")))? {
        matched = true;
        match path {
            Ok(path) => {
                let path = absolute(&path)?;
                if findings.leaves_out(&path, literal) {
                    continue;
                }
                match path.metadata() {
                    Ok(metadata) if metadata.is_dir() => walk(&path, root, prefix, findings),
                    Ok(metadata) => findings.add(&path, root, prefix, &metadata),
                    Err(error) => findings.unreadable.push(format!("{}: {}", path.display(), plain(&error))),
                }
            }
            Err(error) => findings.unreadable.push(error.to_string()),
        }
    }
    if matched { Ok(()) } else { Err(wrong("fits nothing".to_owned())) }
}

fn find_in_bucket(source: &str, named: &impl Fn(Option<String>) -> String, findings: &mut Findings) -> Result<(), BatchError> {
    let trimmed = source.trim_end_matches('/');
    let last = trimmed.rsplit('/').next().unwrap_or_default();
    if is_take(Path::new(last))
        && let Some((parent, name)) = trimmed.rsplit_once('/')
    {
        let entry = Place::parse(parent)?.entry(name)?;
        let entry = entry.ok_or_else(|| BatchError::at(Path::new(source), "no such object; is the name right?"))?;
        findings.takes.push(Found {
            path: name.to_owned(),
            source: trimmed.to_owned(),
            bytes: entry.bytes,
            modified_ns: None,
            version: entry.version,
            problem: None,
        });
        return Ok(());
    }
    let place = Place::parse(trimmed)?;
    let prefix = named(Some(last.to_owned()));
    let before = findings.takes.len();
    let mut outputs: BTreeSet<String> = BTreeSet::new();
    place.list(&mut |entry| {
        let entry = match entry {
            Ok(entry) => entry,
            Err(error) => {
                findings.unreadable.push(error.to_string());
                return Ok(());
            }
        };
        if let Some(end) =
            entry.name.find(&format!("{OWN_FOLDER}/")).filter(|end| *end == 0 || entry.name.get(..*end).is_some_and(|n| n.ends_with('/')))
        {
            outputs.insert(entry.name.get(..end).unwrap_or_default().to_owned());
        }
        if entry.name.split('/').any(|part| part.starts_with('.')) {
            return Ok::<(), StoreError>(());
        }
        if !is_take(Path::new(&entry.name)) {
            findings.count(Path::new(&entry.name));
            return Ok(());
        }
        findings.takes.push(Found {
            path: format!("{prefix}{}", entry.name),
            source: format!("{trimmed}/{}", entry.name),
            bytes: entry.bytes,
            modified_ns: None,
            version: entry.version,
            problem: None,
        });
        Ok(())
    })?;
    let below =
        |take: &Found| outputs.iter().any(|output| take.source.get(trimmed.len() + 1..).is_some_and(|name| name.starts_with(output)));
    let mut at = 0;
    findings.takes.retain(|take| {
        at += 1;
        at <= before || !below(take)
    });
    findings.outputs.extend(outputs.iter().map(|output| PathBuf::from(format!("{trimmed}/{output}"))));
    Ok(())
}

/// True for `s3://...` and the like, but not for files.
pub fn is_address(source: &str) -> bool {
    source.contains("://") && !source.starts_with("file://")
}

fn after_scheme(address: &str) -> &str {
    address.split_once("://").map_or(address, |(_, rest)| rest)
}

/// The absolute path of a file or folder that was typed, be it as `file://`.
///
/// # Errors
/// It is no path.
pub fn local(source: &str) -> Result<PathBuf, BatchError> {
    if source.starts_with("file://") {
        return Ok(Place::parse(source)?.folder().map(Path::to_owned).unwrap_or_default());
    }
    absolute(Path::new(source))
}

fn absolute(path: &Path) -> Result<PathBuf, BatchError> {
    std::path::absolute(path).map_err(|e| BatchError::at(path, plain(&e)))
}

/// When a file was last changed, in nanoseconds since 1970.
pub fn modified_ns(metadata: &Metadata) -> Option<u64> {
    let since = metadata.modified().ok().and_then(|time: SystemTime| time.duration_since(UNIX_EPOCH).ok())?;
    u64::try_from(since.as_nanos()).ok()
}

impl Findings {
    /// True for what [`walk`] would not have come to below `root`: names that begin with a dot, and outputs of batches.
    fn leaves_out(&mut self, path: &Path, root: &Path) -> bool {
        let mut folder = root.to_owned();
        for part in path.strip_prefix(root).unwrap_or(path) {
            if folder.join(OWN_FOLDER).is_dir() {
                if !self.outputs.contains(&folder) {
                    self.outputs.push(folder);
                }
                return true;
            }
            if part.as_encoded_bytes().starts_with(b".") {
                return true;
            }
            folder.push(part);
        }
        false
    }

    fn add(&mut self, path: &Path, root: &Path, prefix: &str, metadata: &Metadata) {
        if !is_take(path) {
            self.count(path);
            return;
        }
        if !metadata.is_file() {
            self.unreadable.push(format!("{}: is no file", path.display()));
            return;
        }
        let inside = path.strip_prefix(root).unwrap_or(path);
        let name = inside.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/");
        let (mut name, mut problem) = (format!("{prefix}{}", name.trim_start_matches('/')), None);
        if path.to_str().is_none() {
            // such names differ in what cannot be written down
            name.push('~');
            name.push_str(&hex(&Sha256::digest(path.as_os_str().as_encoded_bytes()))[..8]);
            problem = Some("its name is not UTF-8 text, so it cannot be written into a plan; rename it".to_owned());
        }
        self.takes.push(Found {
            path: name,
            source: path.to_string_lossy().into_owned(),
            bytes: metadata.len(),
            modified_ns: modified_ns(metadata),
            version: None,
            problem,
        });
    }

    fn count(&mut self, name: &Path) {
        let extension = name.extension().map_or("none".to_owned(), |e| format!(".{}", e.to_string_lossy().to_lowercase()));
        *self.others.entry(extension).or_default() += 1;
    }

    /// Sorted by path; what was named twice is there once.
    fn settle(&mut self) {
        self.takes.sort_by(|a, b| (&a.source, &a.path).cmp(&(&b.source, &b.path)));
        self.takes.dedup_by(|later, kept| later.source == kept.source);
        self.takes.sort_by(|a, b| (&a.path, &a.source).cmp(&(&b.path, &b.source)));
        // takes of one name from different sources must not be one take
        let mut before = String::new();
        for take in &mut self.takes {
            if take.path == before {
                let mark = hex(&Sha256::digest(&take.source));
                let end = take.path.rfind('/').map_or(0, |end| end + 1);
                take.path.insert_str(end, &format!("{}~", &mark[..8]));
            } else {
                before.clone_from(&take.path);
            }
        }
    }
}

/// SHA-256 of each take that lies in a folder and can be read, on all cores.
pub fn hashes(takes: &[Found]) -> Vec<Option<String>> {
    takes
        .par_iter()
        .map(|take| {
            if is_address(&take.source) || take.problem.is_some() || take.bytes > formats::LARGEST_FILE {
                return None;
            }
            hash_file(Path::new(&take.source)).ok().map(|(sha256, _)| sha256)
        })
        .collect()
}
