//! From a path to an opened take.

use crate::compression;
use crate::missing;
use crate::repair::RepairError;
use formats::{Document, Format, FormatError, Note, Notes, Samples, Stated};
use sha2::{Digest, Sha256};
use std::io;
use std::path::Path;

/// What the user states about a file, and how it is to be opened.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// Rate and unit.
    pub stated: Stated,
    /// Samples that are missing, as `--missing` has them; see [`missing::resolve`].
    pub missing: Vec<String>,
    /// Samples that count as missing because they were dropped, by frame and column.
    pub dropped: Samples,
    /// Take integers for floating-point numbers, so that every filled value fits.
    pub float: bool,
}

impl Reading {
    /// The tables that `--missing` names.
    pub fn tables(&self) -> impl Iterator<Item = &Path> {
        self.missing.iter().map(Path::new).filter(|path| missing::names_table(path))
    }
}

impl From<Stated> for Reading {
    fn from(stated: Stated) -> Self {
        Self { stated, ..Self::default() }
    }
}

/// An opened take with what was learned on the way.
pub struct Opened {
    /// The file's format.
    pub format: &'static dyn Format,
    /// The opened file.
    pub document: Box<dyn Document>,
    /// What was assumed or found odd.
    pub notes: Notes,
    /// SHA-256 of the file as it lies there, hexadecimal.
    pub sha256: String,
    /// What was stated, with the samples that `--missing` named and those that were dropped.
    pub stated: Stated,
    /// The file is compressed.
    pub compressed: bool,
}

/// Reads and opens a file, expanded if it is compressed.
///
/// # Errors
/// It cannot be read, is of no known format, is damaged, or does not have what `--missing` names.
pub fn open(path: &Path, reading: &Reading) -> Result<Opened, RepairError> {
    let wrong = |error: FormatError| RepairError::Format { path: path.to_owned(), error };
    let bytes = read(path)?;
    let sha256 = hex(&Sha256::digest(&bytes));
    let compressed = compression::is_compressed(&bytes);
    let bytes = expand(bytes, path)?;
    let name = compression::inner_name(path);
    let extension = name.extension().and_then(|e| e.to_str());
    let head = &bytes[..bytes.len().min(4096)];
    let format = formats::detect(head, extension).map_err(|error| RepairError::Detect { path: path.to_owned(), error })?;
    let again = if reading.missing.is_empty() { None } else { Some(bytes.clone()) };
    let mut notes = Notes::new();
    let mut stated = reading.stated.clone();
    let drop_from = |stated: &mut Stated| reading.dropped.iter().for_each(|(frame, marker)| stated.missing.insert(frame, marker));
    drop_from(&mut stated);
    let mut document = format.open(bytes, &stated, &notes).map_err(wrong)?;
    if let Some(bytes) = again {
        // Which samples are meant is known only when the take is.
        let missing = missing::resolve(&reading.missing, document.take());
        stated.missing = missing.map_err(|error| RepairError::Missing { path: path.to_owned(), error })?;
        drop_from(&mut stated);
        notes = Notes::new();
        document = format.open(bytes, &stated, &notes).map_err(wrong)?;
    }
    if reading.float
        && let Some(floats) = document.as_floats().map_err(wrong)?
    {
        notes = Notes::new();
        document = format.open(floats, &stated, &notes).map_err(wrong)?;
        notes.add(Note::Floats);
    }
    Ok(Opened { format, document, notes, sha256, stated, compressed })
}

/// The content of a file: expanded if its bytes are compressed.
///
/// # Errors
/// It is damaged, expands to too much, or is named as if it were compressed and is not.
pub fn expand(bytes: Vec<u8>, path: &Path) -> Result<Vec<u8>, RepairError> {
    let wrong = |problem: String| RepairError::Io { path: path.to_owned(), problem };
    if compression::is_compressed(&bytes) {
        return compression::expand(&bytes).map_err(wrong);
    }
    if compression::is_named(path) {
        return Err(wrong("is named .zst, but its content is not compressed with Zstandard; rename it after its content".to_owned()));
    }
    Ok(bytes)
}

/// Reads a whole file.
///
/// # Errors
/// It is not there, is a folder, is too large, or may not be read.
pub fn read(path: &Path) -> Result<Vec<u8>, RepairError> {
    let wrong = |problem: String| RepairError::Io { path: path.to_owned(), problem };
    let refused =
        |e: io::Error| RepairError::System { path: path.to_owned(), kind: e.kind(), problem: format!("cannot be read: {}", plain(&e)) };
    let metadata = std::fs::metadata(path).map_err(refused)?;
    if metadata.is_dir() {
        return Err(wrong("is a folder; name one file in it".to_owned()));
    }
    if metadata.len() > formats::LARGEST_FILE {
        return Err(wrong(format!("has {} bytes, the largest file that is read has {}", metadata.len(), formats::LARGEST_FILE)));
    }
    std::fs::read(path).map_err(refused)
}

/// An I/O error without the library's additions.
pub(crate) fn plain(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::PermissionDenied => "permission denied".to_owned(),
        io::ErrorKind::NotFound => "no such file or folder".to_owned(),
        _ => error.to_string(),
    }
}

/// SHA-256, hexadecimal, and size of a file, read block by block.
pub(crate) fn hash_file(path: &Path) -> io::Result<(String, u64)> {
    let mut file = std::fs::File::open(path)?;
    let (mut hasher, mut block, mut bytes) = (Sha256::new(), vec![0; 1 << 18], 0);
    loop {
        let read = io::Read::read(&mut file, &mut block)?;
        if read == 0 {
            return Ok((hex(&hasher.finalize()), bytes));
        }
        hasher.update(block.get(..read).unwrap_or_default());
        bytes += read as u64;
    }
}

/// Bytes as lower-case hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, b| {
        let _ = std::fmt::Write::write_fmt(&mut text, format_args!("{b:02x}")); // a String takes everything
        text
    })
}
