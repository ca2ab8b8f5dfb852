//! Files that appear whole or not at all.
//!
//! Everything is written into a hidden temporary file in the folder of its final name, synced, and renamed.
//! A run that fails or is killed leaves nothing under a final name.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

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
