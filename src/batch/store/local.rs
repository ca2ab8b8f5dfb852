//! A place that is a folder.

use super::{Entry, Kind, Mode, StoreError, is_unfinished, join};
use crate::staging;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempPath};

/// How much of a file is read at once.
const BLOCK: usize = 1 << 20;

/// The path of what has this name, which has been [checked](super::Place).
pub(super) fn path(folder: &Path, name: &str) -> PathBuf {
    // part by part, for the separators of the system
    folder.join(name.split('/').collect::<PathBuf>())
}

fn shown(path: &Path) -> String {
    path.display().to_string()
}

/// Something that nobody else calls a file.
pub(super) fn random_name() -> String {
    use std::hash::{BuildHasher, RandomState};
    // every state has other keys, taken from the system's randomness
    format!("{:x}-{:016x}", std::process::id(), RandomState::new().hash_one(std::time::SystemTime::now()))
}

/// True for errors that only say that there is no such file, for instance because its folder is a file.
fn is_not_there(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

/// Lists files with one open handle for each folder on the way down, and nothing else in memory.
pub(super) fn list(folder: &Path, each: &mut dyn FnMut(Result<Entry, StoreError>) -> Result<(), StoreError>) -> Result<(), StoreError> {
    let top = fs::read_dir(folder).map_err(|error| StoreError::io(shown(folder), "listed", &error))?;
    // what is being read, with its name and a slash
    let mut open = vec![(String::new(), top)];
    while let Some((within, entries)) = open.last_mut() {
        let entry = match entries.next() {
            None => {
                open.pop();
                continue;
            }
            Some(Ok(entry)) => entry,
            Some(Err(error)) => {
                let place = join(&shown(folder), within);
                // such a folder says the same for ever
                open.pop();
                each(Err(StoreError::io(place, "listed", &error)))?;
                continue;
            }
        };
        let path = entry.path();
        let odd = |kind, problem: &str| StoreError { place: shown(&path), kind, problem: problem.to_owned() };
        let found = match entry.file_name().to_str() {
            None => Some(Err(odd(Kind::Unsupported, "the name is not Unicode, and cannot stand in a plan; rename it"))),
            Some(name) => {
                let name = format!("{within}{name}");
                match entry.file_type() {
                    Ok(kind) if kind.is_dir() => match fs::read_dir(&path) {
                        Ok(entries) => {
                            open.push((name + "/", entries));
                            None
                        }
                        Err(error) if is_not_there(&error) => None,
                        Err(error) => Some(Err(StoreError::io(shown(&path), "listed", &error))),
                    },
                    Ok(_) if is_unfinished(&name) => None,
                    Ok(kind) => match fs::metadata(&path) {
                        Ok(data) if data.is_file() => {
                            Some(Ok(Entry { name, bytes: data.len(), modified: data.modified().ok(), version: None }))
                        }
                        Ok(data) if data.is_dir() => {
                            Some(Err(odd(Kind::Unsupported, "is a link to a folder, and is not followed; name that folder itself")))
                        }
                        Ok(_) => Some(Err(odd(Kind::Unsupported, "is neither a file nor a folder; remove it or leave it out"))),
                        Err(_) if kind.is_symlink() => {
                            Some(Err(odd(Kind::NotFound, "is a link that leads nowhere; fetch what it stands for, or remove it")))
                        }
                        Err(error) if is_not_there(&error) => None,
                        Err(error) => Some(Err(StoreError::io(shown(&path), "looked at", &error))),
                    },
                    Err(error) if is_not_there(&error) => None,
                    Err(error) => Some(Err(StoreError::io(shown(&path), "looked at", &error))),
                }
            }
        };
        if let Some(found) = found {
            each(found)?;
        }
    }
    Ok(())
}

/// The file of that name, opened; None if it is not there.
fn open(path: &Path) -> Result<Option<File>, StoreError> {
    match File::open(path) {
        Ok(file) => Ok(Some(file)),
        Err(error) if is_not_there(&error) => Ok(None),
        Err(error) => Err(StoreError::io(shown(path), "read", &error)),
    }
}

pub(super) fn read(folder: &Path, name: &str, limit: u64) -> Result<Option<Vec<u8>>, StoreError> {
    let path = path(folder, name);
    let Some(file) = open(&path)? else { return Ok(None) };
    let mut bytes = Vec::new();
    // one more, to see that there is more
    let length =
        (&file).take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| StoreError::io(shown(&path), "read", &e))? as u64;
    if length > limit {
        let length = file.metadata().map_or(length, |data| data.len().max(length));
        return Err(StoreError::too_large(shown(&path), length, limit));
    }
    Ok(Some(bytes))
}

/// Hands over a file block by block; false if it is not there.
pub(super) fn blocks(folder: &Path, name: &str, each: &mut dyn FnMut(&[u8]) -> Result<(), StoreError>) -> Result<bool, StoreError> {
    let path = path(folder, name);
    let Some(mut file) = open(&path)? else { return Ok(false) };
    let mut block = vec![0; BLOCK];
    loop {
        match file.read(&mut block) {
            Ok(0) => return Ok(true),
            Ok(length) => each(&block[..length])?,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(StoreError::io(shown(&path), "read", &error)),
        }
    }
}

pub(super) fn fetch(folder: &Path, name: &str, to: &Path) -> Result<(), StoreError> {
    let path = path(folder, name);
    if staging::same_file(&path, to) {
        return Err(StoreError { place: shown(&path), kind: Kind::Other, problem: "is where it is to be copied to".into() });
    }
    // nothing is overwritten with what is not there
    open(&path)?.ok_or_else(|| not_there(&path))?;
    into_file(to, |each| blocks(folder, name, each))?.then_some(()).ok_or_else(|| not_there(&path))
}

fn not_there(path: &Path) -> StoreError {
    StoreError::io(shown(path), "read", &io::ErrorKind::NotFound.into())
}

/// Makes a file of the blocks that `from` hands over. No file is left unless `from` says true.
pub(super) fn into_file(
    to: &Path,
    from: impl FnOnce(&mut dyn FnMut(&[u8]) -> Result<(), StoreError>) -> Result<bool, StoreError>,
) -> Result<bool, StoreError> {
    let failed = |error: io::Error| StoreError::io(shown(to), "written", &error);
    let mut file = File::create(to).map_err(failed)?;
    let whole = from(&mut |block| file.write_all(block).map_err(failed));
    if !matches!(whole, Ok(true)) {
        drop(file);
        // half a file is of no use to anybody
        let _ = fs::remove_file(to);
    }
    whole
}

/// True if it has its name now; false if something else has it and shall keep it.
fn outcome(path: &Path, done: io::Result<()>, mode: Mode) -> Result<bool, StoreError> {
    match done {
        Ok(()) => {
            sync_folder(path);
            Ok(true)
        }
        Err(error) if mode == Mode::Create && error.kind() == io::ErrorKind::AlreadyExists => Ok(false),
        Err(error) => Err(StoreError::io(shown(path), "written", &error)),
    }
}

/// Makes a name survive a loss of power, on systems that need and allow it.
fn sync_folder(path: &Path) {
    #[cfg(unix)]
    if let Ok(folder) = File::open(staging::folder(path)) {
        // some network file systems cannot; the file is there all the same
        let _ = folder.sync_all();
    }
    #[cfg(not(unix))]
    let _ = path;
}

fn make_folder(path: &Path) -> Result<(), StoreError> {
    let folder = staging::folder(path);
    fs::create_dir_all(folder).map_err(|error| {
        // a file where a folder should be is said to exist already, which helps nobody
        let error = if error.kind() == io::ErrorKind::AlreadyExists { io::ErrorKind::NotADirectory.into() } else { error };
        StoreError::io(shown(folder), "made a folder", &error)
    })
}

pub(super) fn put(folder: &Path, name: &str, from: &Path, mode: Mode) -> Result<bool, StoreError> {
    let path = path(folder, name);
    let of_from = |error: &io::Error| StoreError::io(shown(from), "read", error);
    let mut source = File::open(from).map_err(|error| of_from(&error))?;
    make_folder(&path)?;
    if mode == Mode::Create && staging::is_there(&path) {
        return Ok(false);
    }
    source.sync_all().map_err(|error| of_from(&error))?;
    let moved = match mode {
        Mode::Replace => fs::rename(from, &path),
        Mode::Create => rename_to_new(from, &path),
    };
    match moved {
        Err(error) if error.kind() == io::ErrorKind::CrossesDevices => {
            let mut copy = staging::beside(&path).map_err(|error| StoreError::io(shown(&path), "written", &error))?;
            io::copy(&mut source, copy.as_file_mut()).map_err(|error| StoreError::io(shown(&path), "written", &error))?;
            let there = publish(copy, &path, mode)?;
            if there {
                // it is where it should be; what is left of it elsewhere is not worth an error
                let _ = fs::remove_file(from);
            }
            Ok(there)
        }
        moved => outcome(&path, moved, mode),
    }
}

/// Renames unless something has the name. Says what `rename` says, or that it exists already.
fn rename_to_new(from: &Path, to: &Path) -> io::Result<()> {
    let mut from = TempPath::try_from_path(from)?;
    from.disable_cleanup(true);
    match from.persist_noclobber(to) {
        Ok(()) => Ok(()),
        Err(failed) => match failed.error.kind() {
            // a file system that can neither rename on a condition nor give a file two names, such as exFAT: one look, then rename
            io::ErrorKind::PermissionDenied | io::ErrorKind::Unsupported | io::ErrorKind::InvalidInput if !staging::is_there(to) => {
                fs::rename(&failed.path, to)
            }
            _ => Err(failed.error),
        },
    }
}

fn publish(file: NamedTempFile, path: &Path, mode: Mode) -> Result<bool, StoreError> {
    let done = match mode {
        Mode::Replace => staging::publish(file, path),
        Mode::Create => file.as_file().sync_all().and_then(|()| {
            let mut temporary = file.into_temp_path();
            let done = rename_to_new(&temporary, path);
            // it has gone to its name
            temporary.disable_cleanup(done.is_ok());
            done
        }),
    };
    outcome(path, done, mode)
}

pub(super) fn write(folder: &Path, name: &str, bytes: &[u8], mode: Mode) -> Result<bool, StoreError> {
    let path = path(folder, name);
    make_folder(&path)?;
    if mode == Mode::Create && staging::is_there(&path) {
        return Ok(false);
    }
    let written = staging::beside(&path).and_then(|mut file| file.write_all(bytes).map(|()| file));
    publish(written.map_err(|error| StoreError::io(shown(&path), "written", &error))?, &path, mode)
}

pub(super) fn remove(folder: &Path, name: &str) -> Result<(), StoreError> {
    let path = path(folder, name);
    match fs::remove_file(&path) {
        Err(error) if !is_not_there(&error) => Err(StoreError::io(shown(&path), "removed", &error)),
        _ => Ok(()),
    }
}

pub(super) fn entry(folder: &Path, name: &str) -> Result<Option<Entry>, StoreError> {
    let path = path(folder, name);
    match fs::metadata(&path) {
        Ok(data) if data.is_file() => {
            Ok(Some(Entry { name: name.to_owned(), bytes: data.len(), modified: data.modified().ok(), version: None }))
        }
        Ok(_) => Ok(None),
        Err(error) if is_not_there(&error) => Ok(None),
        Err(error) => Err(StoreError::io(shown(&path), "looked at", &error)),
    }
}
