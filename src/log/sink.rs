//! An MCAP file while it is written: its topics, messages in the order of their times, attachments, one metadata record, and the proof.
//!
//! All logs are written here, so that all of them have the same bytes for the same content.

use super::check::{Expected, check};
use super::mcap::{Attachment, LogError, Whole, Written};
use crate::staging;
use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{Compression, McapError, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// What is written about one thing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Topic {
    pub name: &'static str,
    /// Full name of the message.
    pub schema: &'static str,
    /// The message's `FileDescriptorSet`, imports included.
    pub descriptor: &'static [u8],
}

/// A log under a hidden name, open for messages.
pub(super) struct Sink {
    path: PathBuf,
    file: NamedTempFile,
    writer: Writer<BufWriter<File>>,
    /// For each topic, its name, its number in the file, and its messages so far.
    topics: Vec<(&'static str, u16, u64)>,
}

impl Sink {
    /// Begins a log that will be called `path`. All topics are declared, also those that get no messages, so that a reader always finds the same ones.
    pub fn create(path: &Path, topics: &[Topic]) -> Result<Self, LogError> {
        if path.is_dir() || path.file_name().is_none() {
            return Err(LogError::Unsupported("a folder was found where the log should be written; name a file".to_owned()));
        }
        Self::over(path, staging::beside(path)?, topics)
    }

    /// The same in a file that is there already, empty.
    pub fn over(path: &Path, file: NamedTempFile, topics: &[Topic]) -> Result<Self, LogError> {
        // Everything that decides about bytes is stated here, whatever the defaults of the library become.
        let mut writer = WriteOptions::new()
            .profile("")
            .library(concat!("mocap-repair/", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(1) // against zstd's default of 3: a fifth quicker, 6 % larger
            .compression_threads(0) // the default follows the machine, and the bytes follow the number
            .chunk_size(Some(1 << 20))
            .create(BufWriter::new(file.as_file().try_clone()?))?;
        let mut schemas: BTreeMap<&str, u16> = BTreeMap::new();
        let mut declared = Vec::with_capacity(topics.len());
        for topic in topics {
            let schema = match schemas.get(topic.schema) {
                Some(schema) => *schema,
                None => writer.add_schema(topic.schema, "protobuf", topic.descriptor)?,
            };
            schemas.insert(topic.schema, schema);
            declared.push((topic.name, writer.add_channel(schema, topic.name, "protobuf", &BTreeMap::new())?, 0));
        }
        Ok(Self { path: path.to_owned(), file, writer, topics: declared })
    }

    /// Writes a message of the topic with this place. Times only grow.
    pub fn put(&mut self, topic: usize, log_time: u64, data: &[u8]) -> Result<(), McapError> {
        let (_, channel_id, count) = &mut self.topics[topic];
        let header = MessageHeader { channel_id: *channel_id, sequence: *count as u32, log_time, publish_time: log_time };
        *count += 1;
        self.writer.write_to_known_channel(&header, data)
    }

    /// Writes what belongs to the whole log, syncs the file and reads it back. What comes out only lacks its name.
    pub fn finish(self, attachments: &[Attachment], metadata: Metadata) -> Result<Whole, LogError> {
        let Self { path, file, mut writer, topics } = self;
        for attachment in attachments {
            writer.attach(&::mcap::Attachment {
                log_time: 0,
                create_time: 0, // a wall clock would make every log different
                name: attachment.name.clone(),
                media_type: attachment.media_type.clone(),
                data: attachment.bytes.as_slice().into(),
            })?;
        }
        writer.write_metadata(&metadata)?;
        writer.finish()?;
        flush(writer)?;
        file.as_file().sync_all()?;
        let messages = topics.iter().map(|(_, _, count)| count).sum();
        let messages_of = topics.iter().map(|(name, _, count)| (*name, *count)).collect();
        check(file.path(), &Expected { messages: messages_of, attachments: attachments.len() as u64, metadata }).map_err(|error| {
            match error {
                LogError::Mcap(error) => LogError::Check(error.to_string()),
                other => other,
            }
        })?;
        let bytes = file.as_file().metadata()?.len();
        Ok(Whole::new(path, file, Written { messages, bytes }))
    }
}

/// Empties the buffer between library and file, whose errors would be lost if it were just dropped.
fn flush(writer: Writer<BufWriter<File>>) -> io::Result<()> {
    writer.into_inner().into_inner().map_err(io::IntoInnerError::into_error)?;
    Ok(())
}
