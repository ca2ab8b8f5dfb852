//! CSV exports of OptiTrack Motive, format versions 1.2 to 1.25.
//!
//! | file | holds |
//! | --- | --- |
//! | `head` | the line of settings and the header lines |
//! | `create` | a new file |
//!
//! Markers are read; rigid bodies, bones, and the places where these expect their markers are noted and left alone.

mod create;
mod head;

use crate::text::{self, Said, save, wide};
use crate::{Document, Format, FormatError, FormatInfo, Match, Note, Notes, Place, Stated, Take};
use head::{Head, Length};
use save::TextDocument;
use std::io::Write;

const NAME: &str = "motive";
const INFO: FormatInfo = FormatInfo { name: NAME, summary: "CSV exports of OptiTrack Motive", extensions: &["csv"], holds_gaps: true };

/// Rates that differ by more than this part of themselves are different rates; times are rounded.
const SAME_RATE: f64 = 0.01;

/// The format.
#[derive(Clone, Copy, Debug)]
pub struct Motive;

impl Format for Motive {
    fn info(&self) -> &'static FormatInfo {
        &INFO
    }

    fn sniff(&self, head: &[u8]) -> Match {
        if head::separator(head).is_some() { Match::Certain } else { Match::No }
    }

    fn open(&self, bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
        open(bytes, stated, notes).map_err(|e| text::named(NAME, e))
    }

    fn create(&self, take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
        create::create(take, out, notes)
    }
}

fn open(bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
    let head = Head::read(&bytes)?;
    let unit = match (&head.length, stated.unit) {
        (Length::Known(unit), _) => Some(*unit),
        (Length::Unknown(written), None) => {
            let text =
                format!("Length Units are \"{written}\", expected Millimeters, Centimeters or Meters; export it again in one of these");
            return Err(FormatError::unsupported(NAME, Place::Line { line: 1, column: None }, text));
        }
        _ => None,
    };
    let rows = wide::read(&bytes, &head.sheet, &head.markers, &stated.missing)?;
    let present = rows.table.frames() as u64;
    if let (Some(rate_hz), None) = (head.rate_hz, stated.rate_hz)
        && let Ok(Some(timed_hz)) = rows.clock.rate_hz(rows.frame_step, true, &Notes::new())
        && (timed_hz / rate_hz - 1.0).abs() > SAME_RATE
    {
        let text = format!("the first line says {rate_hz} Hz, the times say {timed_hz} Hz; {rate_hz} Hz was taken (say it with --rate)");
        notes.add(Note::Assumed { text });
    }
    let said = Said { unit, rate_hz: head.rate_hz };
    let (take, opened) = text::finish(bytes, &head.sheet, rows, said, stated, notes)?;
    if let Some(claimed) = head.frames.filter(|claimed| *claimed != present) {
        notes.add(Note::FrameCount { claimed, present });
    }
    if head.expected_places {
        let text = "the file holds no measured markers; the places where bodies expect their markers were taken as the markers";
        notes.add(Note::Assumed { text: text.to_owned() });
    }
    if !head.others.is_empty() {
        notes.add(Note::OtherColumns { names: head.others });
    }
    Ok(Box::new(TextDocument { format: NAME, take, opened, beyond: Vec::new() }))
}

#[cfg(test)]
mod tests;
