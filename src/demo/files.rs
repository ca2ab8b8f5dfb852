//! Writes a demonstration take to a folder.

use super::{DemoOptions, demo};
use crate::output::unwritable;
use crate::repair::RepairError;
use crate::staging;
use formats::{Format, Notes, Take};
use std::path::{Path, PathBuf};

/// Writes `walk-gaps` and `walk-truth` as C3D and CSV into `folder`, which is made if it is not there. Returns the names.
///
/// # Errors
/// A file exists and `force` is false, or the folder cannot be written to.
pub fn write_demo(folder: &Path, options: &DemoOptions, force: bool) -> Result<Vec<PathBuf>, RepairError> {
    let io = |path: &Path, problem: String| RepairError::Io { path: path.to_owned(), problem };
    std::fs::create_dir_all(folder).map_err(|e| io(folder, format!("cannot be made: {e}")))?;
    let made = demo(options);
    let mut files: Vec<(PathBuf, &Take, &dyn Format)> = Vec::new();
    for (name, take) in [("walk-gaps", &made.gaps), ("walk-truth", &made.truth)] {
        for format in ["c3d", "csv"].iter().filter_map(|e| formats::by_extension(e)) {
            files.push((folder.join(format!("{name}.{}", format.info().name)), take, format));
        }
    }
    for (path, ..) in &files {
        if path.exists() && !force {
            return Err(io(path, "exists already; give another folder, or say --force to replace it".to_owned()));
        }
    }
    for (path, take, format) in &files {
        let mut file = staging::beside(path).map_err(|e| unwritable(path, &e))?;
        let mut bytes = Vec::new();
        format.create(take, &mut bytes, &Notes::new()).map_err(|error| RepairError::Format { path: path.clone(), error })?;
        std::io::Write::write_all(&mut file, &bytes).map_err(|e| unwritable(path, &e))?;
        staging::publish(file, path).map_err(|e| unwritable(path, &e))?;
    }
    Ok(files.into_iter().map(|(path, ..)| path).collect())
}
