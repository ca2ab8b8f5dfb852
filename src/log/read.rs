//! Reads what a log holds besides its messages.

use super::mcap::Ended;
use super::metadata::METADATA;
use super::{check, layout};
use crate::input::plain;
use crate::output::{Names, unwritable};
use crate::repair::RepairError;
use crate::staging;
use ::mcap::Summary;
use ::mcap::records::{AttachmentIndex, MetadataIndex};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// The longest attachment or metadata record that is read, in bytes.
const LONGEST: u64 = 1 << 30;

/// Why something could not be read from a log.
#[derive(Debug, thiserror::Error)]
pub enum LogReadError {
    /// The file could not be read.
    #[error("cannot be read: {}", plain(.0))]
    Io(#[from] io::Error),
    /// It is no whole MCAP file.
    #[error("is no MCAP log, or is not whole: {0}; a log is written by a repair, beside its output")]
    Broken(String),
    /// It is somebody else's log.
    #[error("is an MCAP file, but not the log of a repair: it has no {0}; a log is written by a repair, beside its output")]
    NotOurs(String),
    /// It is the log of a command that makes its page itself.
    #[error("is the log of {0}, of which no report can be made afterwards; run {0} with --report FILE.html, which makes it")]
    OfCommand(String),
}

/// The content of the attachment called `name`.
///
/// # Errors
/// The file is not there, is not an MCAP file, or has no such attachment.
pub fn attachment(path: &Path, name: &str) -> Result<Vec<u8>, LogReadError> {
    let (mut file, summary) = open(path)?;
    let Some(AttachmentIndex { offset, length, .. }) = summary.attachment_indexes.iter().find(|index| index.name == name) else {
        return Err(LogReadError::NotOurs(format!("attachment called {name}")));
    };
    let bytes = part(&mut file, *offset, *length)?;
    let record = ::mcap::parse_record(::mcap::records::op::ATTACHMENT, body(&bytes)?).map_err(|e| broken(&e))?;
    match record {
        ::mcap::records::Record::Attachment { data, .. } => Ok(data.into_owned()),
        _ => Err(LogReadError::Broken("an attachment is something else".to_owned())),
    }
}

/// Writes the layout that was made with a log into a file of its own.
///
/// # Errors
/// The log has none, or the file cannot be written.
pub fn extract_layout(log: &Path, output: &Path, force: bool) -> Result<(), RepairError> {
    Names { input: log, output, reads: vec![], beside: vec![], in_place: false, force }.check_beside()?;
    let bytes = attachment(log, layout::NAME).map_err(|error| RepairError::Log { path: log.to_owned(), error })?;
    let written = staging::beside(output).and_then(|mut file| {
        file.write_all(&bytes)?;
        staging::publish(file, output)
    });
    written.map_err(|e| unwritable(output, &e))
}

/// True if the file is the log of a repair that came to nothing: nobody needs it once there is a better one.
pub fn is_unfinished(path: &Path) -> bool {
    let ended = || -> Option<String> {
        let (mut file, summary) = open(path).ok()?;
        let MetadataIndex { offset, length, .. } = summary.metadata_indexes.iter().find(|index| index.name == METADATA)?;
        let bytes = part(&mut file, *offset, *length).ok()?;
        match ::mcap::parse_record(::mcap::records::op::METADATA, body(&bytes).ok()?).ok()? {
            ::mcap::records::Record::Metadata(record) => record.metadata.get("ended").cloned(),
            _ => None,
        }
    };
    path.is_file() && ended().is_some_and(|ended| [Ended::Interrupted, Ended::Failed].iter().any(|e| e.word() == ended))
}

fn open(path: &Path) -> Result<(File, Summary), LogReadError> {
    let mut file = File::open(path)?;
    match check::read_summary(&mut file) {
        Ok(Some(summary)) => Ok((file, summary)),
        Ok(None) => Err(LogReadError::Broken("it has no summary".to_owned())),
        Err(error) => Err(LogReadError::Broken(error.to_string())),
    }
}

/// `length` bytes from `offset`: allocated only as far as the file has them.
fn part(file: &mut File, offset: u64, length: u64) -> Result<Vec<u8>, LogReadError> {
    let end = file.metadata()?.len();
    if length > LONGEST || offset.checked_add(length).is_none_or(|last| last > end) {
        return Err(LogReadError::Broken(format!("its index speaks of {length} bytes at {offset}, it has {end}")));
    }
    file.seek(SeekFrom::Start(offset))?;
    let mut bytes = vec![0; length as usize];
    file.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// A record without its opcode and its length.
fn body(record: &[u8]) -> Result<&[u8], LogReadError> {
    record.get(9..).ok_or_else(|| LogReadError::Broken("a record is too short".to_owned()))
}

fn broken(error: &::mcap::McapError) -> LogReadError {
    LogReadError::Broken(error.to_string())
}
