//! Files that appear whole or not at all.
//!
//! Everything is written into a hidden temporary file in the folder of its final name, synced, and renamed.
//! A run that fails or is killed leaves nothing under a final name.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempPath};

/// A hidden temporary file in the folder of `path`, called `.<name>.<random>.part`.
///
/// # Errors
/// `path` has no file name or is a folder, or the folder cannot be written to.
pub fn beside(path: &Path) -> io::Result<NamedTempFile> {
    let Some(name) = path.file_name().filter(|_| !path.is_dir()) else {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "this is a folder; name a file in it"));
    };
    let mut hidden = OsString::from(".");
    hidden.push(name);
    hidden.push(".");
    let mut builder = tempfile::Builder::new();
    builder.prefix(&hidden).suffix(".part");
    #[cfg(unix)]
    {
        // Temporary files are private by default, but this one becomes a file like any other; the umask still applies.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder(path))
}

/// Makes sure that a file can be made in the folder of `path`, by making one and removing it.
///
/// # Errors
/// The folder cannot be written to.
pub fn probe(path: &Path) -> io::Result<()> {
    tempfile::Builder::new().prefix(".mocap-repair.").suffix(".probe").tempfile_in(folder(path)).map(drop)
}

/// True if something has this name, be it a link that leads nowhere.
pub fn is_there(path: &Path) -> bool {
    path.exists() || path.is_symlink()
}

/// The folder that holds `path`.
pub fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Syncs the temporary file and gives it its final name, replacing what had that name.
///
/// # Errors
/// The sync or the rename failed; the temporary file is gone, what had the name is still there.
pub fn publish(file: NamedTempFile, path: &Path) -> io::Result<()> {
    file.as_file().sync_all()?;
    file.persist(path).map_err(|e| e.error)?;
    Ok(())
}

/// Files that get their final names one after the other. If it is dropped before all of them have theirs, everything is as it was before.
#[derive(Debug, Default)]
pub struct Placed(Vec<(PathBuf, Option<TempPath>)>);

impl Placed {
    /// To be called before something gets the name `path`: what has it now is kept under a hidden name.
    ///
    /// # Errors
    /// It cannot be kept.
    pub fn keep(&mut self, path: &Path) -> io::Result<()> {
        let old = if path.exists() {
            let mut hidden = OsString::from(".");
            hidden.push(path.file_name().unwrap_or_default());
            hidden.push(".");
            let mut builder = tempfile::Builder::new();
            builder.prefix(&hidden).suffix(".old");
            // a second name costs nothing; file systems that have none get a copy
            let linked = builder.make_in(folder(path), |hidden| std::fs::hard_link(path, hidden));
            let kept = linked.or_else(|_| builder.make_in(folder(path), |hidden| std::fs::copy(path, hidden).map(|_| ())));
            Some(kept?.into_temp_path())
        } else {
            None
        };
        self.0.push((path.to_owned(), old));
        Ok(())
    }

    /// A file that was put where nothing was.
    pub fn added(&mut self, path: &Path) {
        self.0.push((path.to_owned(), None));
    }

    /// All have their names; what was kept goes.
    pub fn done(mut self) {
        self.0.clear();
    }
}

impl Drop for Placed {
    fn drop(&mut self) {
        for (path, old) in self.0.drain(..).rev() {
            // nothing better can be done here than to try
            let _ = match old {
                Some(old) => old.persist(&path).map_err(|e| e.error),
                None => std::fs::remove_file(&path),
            };
        }
    }
}

/// True if both names mean one file, by whatever links.
pub fn same_file(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    if let (Ok(a), Ok(b)) = (std::fs::metadata(a), std::fs::metadata(b)) {
        use std::os::unix::fs::MetadataExt;
        return (a.dev(), a.ino()) == (b.dev(), b.ino());
    }
    resolved(a) == resolved(b)
}

/// The path with its folder's links resolved, so that two names of a file that does not exist yet can be compared.
fn resolved(path: &Path) -> PathBuf {
    let folder = folder(path).canonicalize().unwrap_or_else(|_| folder(path).to_owned());
    path.canonicalize().unwrap_or_else(|_| folder.join(path.file_name().unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn place(path: &Path, text: &str, placed: &mut Placed) {
        placed.keep(path).unwrap();
        let file = beside(path).unwrap();
        std::fs::write(file.path(), text).unwrap();
        publish(file, path).unwrap();
    }

    #[test]
    fn what_was_there_comes_back_unless_all_is_done() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a"), folder.path().join("b"));
        std::fs::write(&a, "old").unwrap();
        for done in [false, true] {
            let mut placed = Placed::default();
            place(&a, "new", &mut placed);
            place(&b, "new", &mut placed);
            assert_eq!(std::fs::read_to_string(&a).unwrap(), "new");
            if done {
                placed.done();
            } else {
                drop(placed);
                assert_eq!((std::fs::read_to_string(&a).unwrap().as_str(), b.exists()), ("old", false));
            }
        }
        assert_eq!((std::fs::read_to_string(&a).unwrap().as_str(), b.exists()), ("new", true));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing hidden is left");
    }
}
