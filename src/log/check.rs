//! Reads a log back and holds it against what was written.

use super::mcap::LogError;
use ::mcap::records::Metadata;
use ::mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions, SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use ::mcap::{Summary, parse_record, records::Record};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

/// By how many bytes a record may be longer than the whole file: chunks hold 1 MiB and one message.
const LONGEST_IN_CHUNK: usize = 64 << 20;

/// What a log must contain.
#[derive(Debug)]
pub(super) struct Expected {
    /// Number of messages of each topic. Every topic is declared, also those without messages.
    pub messages: BTreeMap<&'static str, u64>,
    /// Number of attachments.
    pub attachments: u64,
    /// The one metadata record.
    pub metadata: Metadata,
}

/// Opens the file anew, reads its summary, and reads every record of it with all checksums. Memory does not grow with the file.
pub(super) fn check(path: &Path, expected: &Expected) -> Result<(), LogError> {
    let mut file = File::open(path)?;
    let summary = read_summary(&mut file)?.ok_or_else(|| LogError::Check("the summary is missing".to_owned()))?;
    let stats = summary.stats.as_ref().ok_or_else(|| LogError::Check("the summary has no statistics".to_owned()))?;
    let topic_of: BTreeMap<u16, &str> = summary.channels.iter().map(|(id, channel)| (*id, channel.topic.as_str())).collect();

    let total: u64 = expected.messages.values().sum();
    same("messages in the summary", stats.message_count, total)?;
    same("topics", topic_of.len() as u64, expected.messages.len() as u64)?;
    same("attachments in the summary", summary.attachment_indexes.len() as u64, expected.attachments)?;
    same("metadata records in the summary", summary.metadata_indexes.len() as u64, 1)?;

    file.rewind()?;
    let found = read_records(file)?;
    same("attachments", found.attachments, expected.attachments)?;
    if found.metadata.as_slice() != std::slice::from_ref(&expected.metadata) {
        return Err(LogError::Check(format!("its {} metadata records are not the one that was written", found.metadata.len())));
    }
    for (&topic, &count) in &expected.messages {
        let of_topic = found.messages.iter().filter(|(id, _)| topic_of.get(id) == Some(&topic)).map(|(_, count)| count).sum::<u64>();
        same(&format!("messages of {topic}"), of_topic, count)?;
    }
    same("messages", found.messages.values().sum(), total)
}

fn same(what: &str, found: u64, expected: u64) -> Result<(), LogError> {
    if found == expected { Ok(()) } else { Err(LogError::Check(format!("it has {found} {what}, {expected} were written"))) }
}

/// Reads the summary through the footer, as viewers do.
pub(super) fn read_summary(file: &mut File) -> Result<Option<Summary>, LogError> {
    let mut reader = SummaryReader::new_with_options(SummaryReaderOptions::default().with_file_size(file.metadata()?.len()));
    while let Some(event) = reader.next_event() {
        match event? {
            SummaryReadEvent::ReadRequest(bytes) => {
                let read = file.read(reader.insert(bytes))?;
                reader.notify_read(read);
            }
            SummaryReadEvent::SeekRequest(to) => {
                let position = file.seek(to)?;
                reader.notify_seeked(position);
            }
        }
    }
    Ok(reader.finish())
}

/// What was found by reading from the first byte to the last.
#[derive(Debug, Default)]
struct Found {
    messages: BTreeMap<u16, u64>,
    attachments: u64,
    metadata: Vec<Metadata>,
}

/// Reads every record, with all checksums, and hands each to `tell`.
pub(super) fn each_record(file: File, tell: &mut dyn FnMut(Record<'_>) -> Result<(), LogError>) -> Result<(), LogError> {
    // A damaged length must not be allocated. A record may be longer than the file because chunks are compressed.
    let longest = usize::try_from(file.metadata()?.len()).unwrap_or(usize::MAX).saturating_add(LONGEST_IN_CHUNK);
    let mut file = BufReader::new(file);
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true)
            .with_check_finishes_after_end_magic(true)
            .with_record_length_limit(longest),
    );
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(bytes) => {
                let read = file.read(reader.insert(bytes))?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => tell(parse_record(opcode, data)?)?,
        }
    }
    Ok(())
}

/// Reads every record and insists that messages are in the order of their times.
fn read_records(file: File) -> Result<Found, LogError> {
    let mut found = Found::default();
    let mut latest = 0;
    each_record(file, &mut |record| {
        match record {
            Record::Message { header, .. } => {
                if header.log_time < latest {
                    return Err(LogError::Check(format!("a message at {} ns follows one at {latest} ns", header.log_time)));
                }
                latest = header.log_time;
                *found.messages.entry(header.channel_id).or_default() += 1;
            }
            Record::Attachment { .. } => found.attachments += 1,
            Record::Metadata(metadata) => found.metadata.push(metadata),
            _ => {}
        }
        Ok(())
    })?;
    Ok(found)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use ::mcap::{WriteOptions, records::MessageHeader};
    use std::io::{BufWriter, Write};
    use tempfile::NamedTempFile;

    fn expected(messages: u64) -> Expected {
        let map = [("key".to_owned(), "value".to_owned())].into();
        Expected { messages: [("/t", messages)].into(), attachments: 0, metadata: Metadata { name: "m".into(), metadata: map } }
    }

    /// A log with one message at each of `times`.
    fn log(times: &[u64]) -> Vec<u8> {
        let mut file = NamedTempFile::new().unwrap();
        let mut writer = WriteOptions::new().compression_threads(0).create(BufWriter::new(file.as_file_mut())).unwrap();
        let channel_id = writer.add_channel(0, "/t", "", &BTreeMap::new()).unwrap();
        for &log_time in times {
            writer.write_to_known_channel(&MessageHeader { channel_id, sequence: 0, log_time, publish_time: 0 }, &[1, 2, 3]).unwrap();
        }
        writer.write_metadata(&expected(0).metadata).unwrap();
        writer.finish().unwrap();
        writer.into_inner().into_inner().unwrap();
        std::fs::read(file.path()).unwrap()
    }

    fn complaint(bytes: &[u8], messages: u64) -> Option<String> {
        let mut file = NamedTempFile::new().unwrap();
        file.write_all(bytes).unwrap();
        check(file.path(), &expected(messages)).err().map(|e| e.to_string())
    }

    #[test]
    fn a_good_log_passes() {
        assert_eq!(complaint(&log(&[1, 2, 2]), 3), None);
        assert_eq!(complaint(&log(&[]), 0), None);
    }

    #[test]
    fn a_lost_message_is_missed() {
        assert!(complaint(&log(&[1, 2]), 3).unwrap().contains("it has 2 messages in the summary, 3 were written"));
    }

    #[test]
    fn wrong_order_is_seen() {
        assert!(complaint(&log(&[2, 1]), 2).unwrap().contains("a message at 1 ns follows one at 2 ns"));
    }

    #[test]
    fn wherever_it_is_cut_or_changed_it_is_seen() {
        let good = log(&[1, 2]);
        for length in 0..good.len() {
            assert!(complaint(&good[..length], 2).is_some(), "cut to {length} of {}", good.len());
        }
        for place in 0..good.len() {
            let mut bad = good.clone();
            bad[place] ^= 0x10;
            assert!(complaint(&bad, 2).is_some(), "changed at {place} of {}", good.len());
        }
    }
}
