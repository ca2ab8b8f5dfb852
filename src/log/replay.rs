//! Reads a log from its first record to its last, for those who show it again.

use super::LogReadError;
use super::channels::Channel;
use super::check::each_record;
use super::cloud::{Point, points};
use super::mcap::LogError;
use super::metadata::METADATA;
use super::schema::foxglove::PointCloud;
use super::schema::{EmBoneResiduals, EmLikelihood, MarkerStates};
use ::mcap::McapError;
use ::mcap::records::Record;
use prost::Message;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

/// What a log tells, in its own order: messages by time, then attachments, then the metadata.
pub(crate) enum Told {
    /// An iteration.
    Likelihood(EmLikelihood),
    /// The bones of the iteration that was told last.
    BoneResiduals(EmBoneResiduals),
    /// A frame begins.
    MarkerStates(MarkerStates),
    /// Known markers of the frame as they were read.
    Raw(Vec<Point>),
    /// Known markers of the frame as they were written.
    Repaired(Vec<Point>),
    /// A file: its name and content.
    Attachment(String, Vec<u8>),
    /// The metadata record.
    Metadata(BTreeMap<String, String>),
}

/// Tells everything that is in the log, except what the page does not need. Memory does not grow with the file.
///
/// # Errors
/// The file cannot be read, or is no whole MCAP file with messages of ours; or what `tell` says.
pub(crate) fn replay(path: &Path, tell: &mut dyn FnMut(Told) -> Result<(), String>) -> Result<(), LogReadError> {
    let mut topics: BTreeMap<u16, Channel> = BTreeMap::new();
    let file = File::open(path)?;
    let done = each_record(file, &mut |record| {
        let told = match record {
            Record::Channel(channel) => {
                if let Some(known) = Channel::ALL.into_iter().find(|known| known.topic() == channel.topic) {
                    topics.insert(channel.id, known);
                }
                return Ok(());
            }
            Record::Message { header, data } => match topics.get(&header.channel_id) {
                Some(channel) => message(*channel, &data)?,
                None => return Ok(()),
            },
            Record::Attachment { header, data, .. } => Some(Told::Attachment(header.name, data.into_owned())),
            Record::Metadata(record) if record.name == METADATA => Some(Told::Metadata(record.metadata)),
            _ => return Ok(()),
        };
        told.map_or(Ok(()), |told| tell(told).map_err(LogError::Unsupported))
    });
    done.map_err(|error| match error {
        LogError::Io(error) => LogReadError::Io(error),
        LogError::Mcap(McapError::BadMagic) => LogReadError::Broken("it does not begin as one".to_owned()),
        other => LogReadError::Broken(other.to_string()),
    })
}

/// A message that the page needs, or `None`.
fn message(channel: Channel, data: &[u8]) -> Result<Option<Told>, LogError> {
    let wrong = |what: &dyn std::fmt::Display| LogError::Unsupported(format!("a message of {} cannot be read: {what}", channel.topic()));
    let cloud = || {
        let cloud = PointCloud::decode(data).map_err(|e| wrong(&e))?;
        points(&cloud).ok_or_else(|| wrong(&"its points are not as a repair writes them"))
    };
    Ok(Some(match channel {
        Channel::Likelihood => Told::Likelihood(EmLikelihood::decode(data).map_err(|e| wrong(&e))?),
        Channel::BoneResiduals => Told::BoneResiduals(EmBoneResiduals::decode(data).map_err(|e| wrong(&e))?),
        Channel::MarkerState => Told::MarkerStates(MarkerStates::decode(data).map_err(|e| wrong(&e))?),
        Channel::Raw => Told::Raw(cloud()?),
        Channel::Repaired => Told::Repaired(cloud()?),
        Channel::Axes | Channel::BoneLengths | Channel::Skeleton | Channel::Log => return Ok(None),
    }))
}
