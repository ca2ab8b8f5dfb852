//! What the log tells in words: one line at the moment of the take that it is about.

use super::mcap::About;
use super::schema::foxglove::{Log, log::Level};
use crate::report::GapReport;
use crate::solve::Gap;
use crate::suspects::SuspectReport;
use prost_types::Timestamp;

/// A line of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// The frame that it is about, counted from 0; an iteration has the moment of the frame of its number.
    pub frame: usize,
    /// True if somebody should look.
    pub warning: bool,
    /// The marker, or the method.
    pub name: String,
    /// What happened.
    pub message: String,
}

impl Event {
    /// What is to be known about the whole take.
    pub fn note(matters: bool, message: String) -> Self {
        Self { frame: 0, warning: matters, name: "take".to_owned(), message }
    }
}

/// Where gaps begin and end, and what became of them.
pub fn of_gaps(gaps: &[Gap], reports: &[GapReport]) -> Vec<Event> {
    gaps.iter()
        .zip(reports)
        .flat_map(|(gap, report)| {
            let frames = crate::report::count(report.frames, "frame");
            let span = format!("gap {}, {frames}, {} to {}", report.gap, report.first_frame, report.last_frame);
            let fate = match (report.why, report.worst_sigma_mm) {
                (Some(why), _) => format!("left open: {}", why.reason()),
                (None, Some(sigma_mm)) => format!("filled, predicted error up to {sigma_mm:.1} mm"),
                (None, None) => "filled".to_owned(),
            };
            let event =
                |frame: usize, message: String| Event { frame, warning: report.why.is_some(), name: report.marker.clone(), message };
            [event(gap.start, format!("{span}: {fate}")), event(gap.end - 1, format!("gap {} ends", report.gap))]
        })
        .collect()
}

/// Samples that no body makes: one line each, at its first frame.
pub fn of_suspects(suspects: &[SuspectReport]) -> Vec<Event> {
    suspects
        .iter()
        .map(|suspect| {
            let fate = match (suspect.dropped, suspect.ignored) {
                (true, _) => "dropped",
                (false, true) => "left as it is, and not used to fill others",
                (false, false) => "left as it is",
            };
            Event {
                frame: suspect.start,
                warning: true,
                name: suspect.marker.clone(),
                message: format!("{}: {} ({fate})", suspect.kind, suspect.text),
            }
        })
        .collect()
}

/// The event as a message.
pub(super) fn message(event: &Event, about: &About, time: Timestamp) -> Log {
    let level = if event.warning { Level::Warning } else { Level::Info };
    let line = about.first_frame.saturating_add_unsigned(event.frame as u64);
    Log {
        timestamp: Some(time),
        level: level.into(),
        message: event.message.clone(),
        name: event.name.clone(),
        file: about.source_name.clone(),
        line: u32::try_from(line).unwrap_or(0),
    }
}
