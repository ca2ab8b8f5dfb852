//! Where a take is written: names that may be used, the format, the bytes, and the proof that they are right.

use crate::compression;
use crate::input::{Opened, expand, plain};
use crate::log::{self, LogError, Whole};
use crate::repair::RepairError;
use crate::staging;
use crate::verify::verify;
use formats::{Format, FormatError, Note, Notes, Origin, Samples, Stated, Take};
use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// How the output is made from the input.
#[derive(Clone, Copy)]
pub enum Way {
    /// The bytes of the input, with the filled samples in them.
    Patched,
    /// A new file from the take alone.
    New(&'static dyn Format),
}

/// The way to write `output`. Its extension decides: bytes are patched if it is the input's own or usually belongs to the input's format.
pub fn way(input: &Path, format: &'static dyn Format, output: &Path) -> Way {
    let extension =
        |path: &Path| compression::inner_name(path).extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    if extension(input) == extension(output) {
        return Way::Patched;
    }
    match formats::by_extension(&extension(output)) {
        // of several formats that share an extension, the input's is meant
        Some(usual) if format.info().extensions.first() != usual.info().extensions.first() => Way::New(usual),
        _ => Way::Patched,
    }
}

/// A take that lies in a hidden file beside its final name, whole and proven.
pub struct Written {
    /// The file; only its name is missing.
    pub file: NamedTempFile,
    /// What was assumed, lost, or found odd, from the first byte read to the last one written.
    pub notes: Notes,
    /// SHA-256 of the file that was read.
    pub sha256: String,
    /// The take as the file holds it, if filled samples came out elsewhere than they were put, as joints of rigid skeletons may.
    pub elsewhere: Option<Take>,
}

/// Writes `take` into a hidden file beside `output`, opens that again and holds it against the take.
/// With [`Way::Patched`] `take` is the take that was opened, with some samples filled.
///
/// # Errors
/// The take cannot be written so, or the written file is not what it should be.
pub fn write(way: Way, opened: Opened, take: &Take, compressed: bool, output: &Path) -> Result<Written, RepairError> {
    let Opened { format: input, document, notes, sha256, stated, .. } = opened;
    let mut file = staging::beside(output).map_err(|e| unwritable(output, &e))?;
    let format = match way {
        Way::Patched => input,
        Way::New(format) => format,
    };
    let io_error = |e: io::Error| FormatError::io(format.info().name, e);
    let written = {
        let mut out = io::BufWriter::with_capacity(1 << 20, file.as_file_mut());
        let result = compression::through(&mut out, compressed, io_error, |out| match way {
            Way::Patched => document.save(take, out, &notes),
            Way::New(format) => {
                for what in document.beyond_take().into_iter().chain(notes.take().iter().filter_map(only_kept_in_place)) {
                    notes.add(Note::LeftOut { what });
                }
                format.create(take, out, &notes)
            }
        });
        result.and_then(|()| out.flush().map_err(io_error))
    };
    written.map_err(|error| RepairError::Format { path: output.to_owned(), error })?;
    // What was stated to be missing and stays so is in the patched file as it was, and is missing only to whoever states it again.
    let open: Samples = stated.missing.iter().filter(|&(frame, marker)| take.origin(frame, marker) == Origin::Missing).collect();
    let patched = matches!(way, Way::Patched).then(|| document.leeway(&notes.take()));
    if patched.is_some() && !open.is_empty() {
        notes.add(Note::StatedStays { samples: open.len() });
    }
    let elsewhere = patched.is_some_and(|leeway| leeway.filled_mm > document.rounding_mm());
    drop(document); // the bytes that were read: there must be room for those that were written
    file.as_file().sync_all().map_err(|e| unwritable(output, &e))?;
    let back = std::fs::read(file.path()).map_err(|e| unwritable(output, &e))?;
    let back = if compressed { expand(back, output)? } else { back };
    let stated = if patched.is_some() { Stated { missing: open, ..stated } } else { Stated::default() };
    let back = verify(back, format, &stated, take, patched).map_err(|error| RepairError::Verify { path: output.to_owned(), error })?;
    let elsewhere = elsewhere.then(|| back.take().clone());
    Ok(Written { file, notes, sha256, elsewhere })
}

/// What a note told of that was left as it is, and is lost with the file that it stood in.
fn only_kept_in_place(note: &Note) -> Option<String> {
    let list = |names: &[String]| {
        let shown = names.iter().take(8).map(String::as_str).collect::<Vec<_>>().join(", ");
        if names.len() > 8 { format!("{shown} and {} more", names.len() - 8) } else { shown }
    };
    match note {
        Note::OtherColumns { names } => Some(format!("the columns {}", list(names))),
        Note::OtherBlocks { names } => Some(format!("the blocks {}", list(names))),
        Note::PartialSamples { samples } => Some(format!("the given coordinates of {samples} samples that lack others")),
        _ => None,
    }
}

/// Gives names to files that are whole under hidden ones: tables and the like first, then a log, the output last. What comes out is why the log got none.
///
/// # Errors
/// One of them but the log cannot be named so; then nothing has been.
pub fn put_in_place(
    beside: Vec<(NamedTempFile, &Path)>,
    log: Option<(&Path, Whole)>,
    (file, path): (NamedTempFile, &Path),
) -> Result<Option<LogError>, RepairError> {
    let mut placed = staging::Placed::default();
    for (file, path) in beside {
        placed.keep(path).and_then(|()| staging::publish(file, path)).map_err(|e| unwritable(path, &e))?;
    }
    let mut failed = None;
    if let Some((path, log)) = log {
        placed.keep(path).map_err(|e| unwritable(path, &e))?;
        failed = log.place().err();
    }
    staging::publish(file, path).map_err(|e| unwritable(path, &e))?;
    placed.done();
    Ok(failed)
}

/// Motion is written as BVH, whatever the name says; so it should say that.
///
/// # Errors
/// It says something else.
pub fn check_motion_name(output: &Path) -> Result<(), RepairError> {
    if compression::inner_name(output).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bvh")) {
        return Ok(());
    }
    let problem = "motion is written as BVH; give it a name that ends in .bvh".to_owned();
    Err(RepairError::Io { path: output.to_owned(), problem })
}

/// The name under which `--in-place` keeps the input.
pub fn original_name(input: &Path) -> PathBuf {
    let mut name = input.as_os_str().to_owned();
    name.push(".orig");
    name.into()
}

/// The files that are to be written, before any of them is.
pub struct Names<'a> {
    /// The take that is read.
    pub input: &'a Path,
    /// The take that is written.
    pub output: &'a Path,
    /// Other files that are read, and must not be replaced either.
    pub reads: Vec<&'a Path>,
    /// Log, table, and whatever else.
    pub beside: Vec<&'a Path>,
    /// The output is the input's own name.
    pub in_place: bool,
    /// Files that exist may be replaced.
    pub force: bool,
}

impl Names<'_> {
    /// Nothing that exists is overwritten unasked, no two names mean one file, and every folder is there.
    ///
    /// # Errors
    /// The first name that cannot be used, and why.
    pub fn check(&self) -> Result<(), RepairError> {
        let stop = |path: &Path, problem: &str| Err(RepairError::Io { path: path.to_owned(), problem: problem.to_owned() });
        let inner = compression::inner_name(self.output);
        if !self.in_place
            && let Some(extension) = inner.extension().and_then(|e| e.to_str())
            && formats::by_extension(extension).is_none()
        {
            let known: BTreeSet<String> = formats::ALL.iter().flat_map(|f| f.info().extensions).map(|e| format!(".{e}")).collect();
            let known = known.into_iter().collect::<Vec<_>>().join(", ");
            return stop(self.output, &format!("the extension .{extension} names no format that can be written; use one of: {known}"));
        }
        if !self.in_place && staging::same_file(self.input, self.output) {
            return stop(self.output, "is the input itself; give another name, or repair with --in-place");
        }
        self.check_beside()
    }

    /// The same for files whose extensions name no format of takes.
    ///
    /// # Errors
    /// The first name that cannot be used, and why.
    pub fn check_beside(&self) -> Result<(), RepairError> {
        let stop = |path: &Path, problem: &str| Err(RepairError::Io { path: path.to_owned(), problem: problem.to_owned() });
        let mut names: Vec<&Path> = Vec::new();
        if !self.in_place {
            names.push(self.output);
        }
        names.extend(&self.beside);
        let kept = original_name(self.input);
        if self.in_place {
            if kept.exists() {
                return stop(&kept, "exists already, so the original could not be kept; move it away first");
            }
            names.push(&kept);
        }
        for (at, name) in names.iter().enumerate() {
            if staging::same_file(name, self.input) {
                return stop(name, "is the input itself; give another name");
            }
            if self.reads.iter().any(|read| staging::same_file(name, read)) {
                return stop(name, "is read as well; give another name");
            }
            if names[..at].iter().any(|other| staging::same_file(other, name)) {
                return stop(name, "is named for two different files; give different names");
            }
            if name.is_dir() {
                return stop(name, "is a folder; name a file in it");
            }
            if name.exists() && !name.is_file() {
                return stop(name, "is a device or a pipe, which a file cannot take the place of; give another name");
            }
            if staging::is_there(name) && !self.force && !log::is_unfinished(name) {
                return stop(name, "exists already; give another name, or say --force to replace it");
            }
            if !staging::folder(name).is_dir() {
                return stop(name, "its folder does not exist; make it first");
            }
            // found out now rather than after an hour's work
            staging::probe(name).map_err(|e| unwritable(name, &e))?;
        }
        Ok(())
    }
}

pub(crate) fn unwritable(path: &Path, error: &io::Error) -> RepairError {
    RepairError::System { path: path.to_owned(), kind: error.kind(), problem: format!("cannot be written: {}", plain(error)) }
}
