//! What writers of new files share: which columns, how numbers, times and labels are spelled.
//!
//! Numbers have the fewest digits that read back as the same number; missing samples are empty cells.

use super::clock::simplest_rate;
use super::number;
use crate::{FormatError, FormatInfo, Notes, Origin, Place, Role, Take};
use std::io::{self, Write};

/// The columns of the take that can be written: its markers. What of the rest every table of positions lacks is noted.
///
/// # Errors
/// The take has no markers.
pub(crate) fn writable(take: &Take, info: &FormatInfo, notes: &Notes) -> Result<Vec<usize>, FormatError> {
    let columns: Vec<usize> = take.markers.iter().enumerate().filter(|(_, m)| m.role == Role::Marker).map(|(column, _)| column).collect();
    if columns.is_empty() {
        return Err(FormatError::unsupported(info.name, Place::Whole, "the take has no markers, so there is nothing to write"));
    }
    if take.frames() == 0 {
        return Err(FormatError::unsupported(info.name, Place::Whole, "the take has no frames, so there is nothing to write"));
    }
    let outputs = take.markers.len() - columns.len();
    if outputs > 0 {
        notes.not_expressible(info, format!("{outputs} columns of model outputs"));
    }
    if let Some(up) = take.up {
        notes.not_expressible(info, format!("which axis points up ({up})"));
    }
    let derived = columns.iter().map(|&c| (0..take.frames()).filter(|&f| take.origin(f, c) == Origin::Derived).count()).sum::<usize>();
    if derived > 0 {
        notes.not_expressible(info, format!("that {derived} samples were filled or filtered before"));
    }
    Ok(columns)
}

/// Labels for a header without quotes: no blanks around them, no tabs, line ends or other control characters, none empty. What was changed is noted.
pub(crate) fn plain_labels(info: &FormatInfo, take: &Take, columns: &[usize], notes: &Notes) -> Vec<String> {
    renamed(info, take, columns, notes, |number, label| {
        let label = without_control(label);
        if label.trim().is_empty() { format!("unlabelled_{}", number + 1) } else { label.trim().to_owned() }
    })
}

/// Labels for a header with quotes that is read line by line: no line ends or other control characters. What was changed is noted.
pub(crate) fn line_labels(info: &FormatInfo, take: &Take, columns: &[usize], notes: &Notes) -> Vec<String> {
    renamed(info, take, columns, notes, |_, label| without_control(label))
}

fn without_control(label: &str) -> String {
    label.chars().map(|c| if c.is_control() { '_' } else { c }).collect()
}

fn renamed(info: &FormatInfo, take: &Take, columns: &[usize], notes: &Notes, rename: impl Fn(usize, &str) -> String) -> Vec<String> {
    let mut changed = Vec::new();
    let mut labels = Vec::with_capacity(columns.len());
    for (number, marker) in columns.iter().filter_map(|&c| take.markers.get(c)).enumerate() {
        let label = rename(number, &marker.label);
        if label != marker.label {
            changed.push(label.clone());
        }
        labels.push(label);
    }
    if !changed.is_empty() {
        let names = changed.iter().take(8).map(String::as_str).collect::<Vec<_>>().join(", ");
        let more = if changed.len() > 8 { ", ..." } else { "" };
        let what = format!("{} labels that are empty or have tabs or line ends in them (now called {names}{more})", changed.len());
        notes.not_expressible(info, what);
    }
    labels
}

/// Three cells, each behind its separator.
pub(crate) fn write_position(take: &Take, frame: usize, column: usize, out: &mut dyn Write) -> io::Result<()> {
    let Some(position) = take.position_mm(frame, column) else { return write!(out, ",,,") };
    for mm in position {
        write!(out, ",{}", in_unit(mm, take.unit.mm()))?;
    }
    Ok(())
}

/// The number of units that gives `mm` back when it is multiplied by `unit_mm`, if there is one; else the nearest. Never `-0`.
pub(crate) fn in_unit(mm: f64, unit_mm: f64) -> f64 {
    let value = mm / unit_mm;
    [value, value.next_up(), value.next_down()].into_iter().find(|v| v * unit_mm == mm).unwrap_or(value) + 0.0
}

/// A cell, in quotes if a reader would otherwise see something else.
pub(crate) fn quoted(text: &str) -> String {
    let edge = |c: char| c == ' ' || c == '\t';
    let plain = !text.is_empty() && !text.contains([',', '"', '\n', '\r', ';', '\t']) && !text.starts_with(edge) && !text.ends_with(edge);
    if plain { text.to_owned() } else { format!("\"{}\"", text.replace('"', "\"\"")) }
}

/// Enough decimals of the times for the rate to be read back as it is; `None` for all that there are.
pub(crate) fn time_decimals(take: &Take) -> Option<usize> {
    let frames = take.frames().saturating_sub(1) as f64;
    [3, 6, 9, 12].into_iter().find(|&decimals| {
        let last = format!("{:.decimals$}", frames / take.rate_hz).parse::<f64>().unwrap_or(f64::NAN);
        // Two frames closer than the last decimal would look like one.
        let fine = 1.0 / take.rate_hz > 2.0 * number::step(decimals);
        fine && simplest_rate(0.0, last, frames, number::step(decimals)) == take.rate_hz
    })
}

/// The time of a frame in seconds.
pub(crate) fn time(take: &Take, frame: usize, decimals: Option<usize>) -> String {
    let secs = frame as f64 / take.rate_hz;
    decimals.map_or_else(|| format!("{secs}"), |decimals| format!("{secs:.decimals$}"))
}
