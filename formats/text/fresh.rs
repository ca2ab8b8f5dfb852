//! What writers of new files share: which columns, how numbers, times and labels are spelled.
//!
//! Numbers have the fewest digits that read back as the same number; missing samples are empty cells.

use super::clock::simplest_rate;
use super::number;
use crate::note::listed;
use crate::{FormatError, FormatInfo, Notes, Origin, Place, Role, Take};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, BufWriter, Write};

/// What is written for 0 where all three coordinates are 0.
pub(crate) const NOT_THE_ORIGIN: f64 = 1e-6;

/// The columns of the take that can be written: its markers. What of the rest every file of nothing but positions lacks is noted.
///
/// # Errors
/// The take has no markers or no frames.
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

/// Which labels a format cannot hold, and how they are changed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spelling {
    /// Letters that become `_`.
    pub odd: fn(char) -> bool,
    /// What these letters are.
    pub odd_are: &'static str,
    /// True if blanks at the ends are cut off, because a reader would do so.
    pub trimmed: bool,
    /// What an empty label becomes, before its number; `None` if it may be empty.
    pub empty: Option<&'static str>,
    /// The most letters.
    pub longest: usize,
    /// True if no two labels may be the same.
    pub unique: bool,
}

/// For a header with quotes that is read line by line.
pub(crate) const LINES: Spelling = Spelling {
    odd: char::is_control,
    odd_are: "tabs, line ends or other control characters",
    trimmed: false,
    empty: None,
    longest: usize::MAX,
    unique: false,
};

/// For a header without quotes.
pub(crate) const PLAIN: Spelling = Spelling { trimmed: true, empty: Some("unlabelled_"), ..LINES };

impl Spelling {
    /// The label as the format can hold it. Adds why it is another one, if it is.
    fn spell(&self, column: usize, label: &str, why: &mut Vec<String>) -> String {
        let mut reason = |text: String| {
            if !why.contains(&text) {
                why.push(text);
            }
        };
        let plain: String = label.chars().take(self.longest).map(|c| if (self.odd)(c) { '_' } else { c }).collect();
        if let Some(empty) = self.empty
            && (label.is_empty() || self.trimmed && plain.trim().is_empty())
        {
            reason("are empty".to_owned());
            return format!("{empty}{}", column + 1);
        }
        if plain.len() < label.len() && label.chars().count() > self.longest {
            reason(format!("have more than {} letters", self.longest));
        }
        if plain.chars().ne(label.chars().take(self.longest)) {
            reason(format!("have {} in them", self.odd_are));
        }
        if self.trimmed && plain.trim().len() < plain.len() {
            reason("have blanks at their ends".to_owned());
            return plain.trim().to_owned();
        }
        plain
    }
}

/// Labels as a format can hold them.
pub(crate) struct Spelled {
    /// All of them, in their order.
    pub labels: Vec<String>,
    /// What was changed and why, as a sentence; `None` if nothing was.
    pub told: Option<String>,
}

/// The labels of these columns as a format can hold them; what was changed is noted.
pub(crate) fn labels(
    info: &FormatInfo,
    spelling: &Spelling,
    take: &Take,
    columns: &[usize],
    reserved: &[String],
    notes: &Notes,
) -> Vec<String> {
    let all: Vec<(usize, &str)> =
        columns.iter().map(|&column| (column, take.markers.get(column).map_or("", |m| m.label.as_str()))).collect();
    let spelled = spelled(spelling, &all, reserved, "labels");
    if let Some(told) = spelled.told {
        notes.changed(info, told);
    }
    spelled.labels
}

/// Labels, each with its place in the take, as a format can hold them. `what` they are is said where they change.
///
/// A changed label is unlike all others of the file, and unlike `reserved`. A label that need not be changed keeps its name before others get it.
pub(crate) fn spelled(spelling: &Spelling, all: &[(usize, &str)], reserved: &[String], what: &str) -> Spelled {
    let mut why = Vec::new();
    let mut taken: BTreeSet<String> = reserved.iter().cloned().collect();
    // the label, and whether it may stay as it is
    let mut labels: Vec<(String, bool)> = Vec::with_capacity(all.len());
    for &(column, label) in all {
        let spelled = spelling.spell(column, label, &mut why);
        let same = spelled == label;
        let stays = same && (taken.insert(spelled.clone()) || !spelling.unique);
        let clashes = "are called like others";
        if same && !stays && !why.iter().any(|w| w == clashes) {
            why.push(clashes.to_owned());
        }
        labels.push((spelled, stays));
    }
    let mut next: BTreeMap<String, usize> = BTreeMap::new();
    let mut changed = Vec::new();
    for (label, _) in labels.iter_mut().filter(|(_, stays)| !stays) {
        let plain = label.clone();
        while !taken.insert(label.clone()) {
            let count = next.entry(plain.clone()).or_insert(1);
            *count += 1;
            *label = format!("{plain}_{count}");
        }
        changed.push(label.clone());
    }
    let told = (!changed.is_empty())
        .then(|| format!("{} {what} that {} were changed: now called {}", changed.len(), why.join(" or "), listed(&changed)));
    Spelled { labels: labels.into_iter().map(|(label, _)| label).collect(), told }
}

/// A position in the take's unit, as it is written into a new table. One at exactly `0 0 0` is moved by a millionth of the unit,
/// because readers, ours among them, may take that for a gap. `None` if the sample is missing.
pub(crate) fn cells(take: &Take, frame: usize, column: usize) -> Option<[f64; 3]> {
    let values = take.position_mm(frame, column)?.map(|mm| in_unit(mm, take.unit.mm()));
    Some(if values == [0.0; 3] { [NOT_THE_ORIGIN, 0.0, 0.0] } else { values })
}

/// Writes a new file through a buffer, to its end.
///
/// # Errors
/// An I/O error of `out`.
pub(crate) fn buffered(
    info: &FormatInfo,
    out: &mut dyn Write,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), FormatError> {
    let mut out = BufWriter::with_capacity(1 << 16, out);
    write(&mut out).and_then(|()| out.flush()).map_err(|e| FormatError::io(info.name, e))
}

/// Three cells, each behind its separator.
pub(crate) fn write_position(take: &Take, frame: usize, column: usize, out: &mut dyn Write) -> io::Result<()> {
    let Some(cells) = cells(take, frame, column) else { return write!(out, ",,,") };
    for cell in cells {
        write!(out, ",{cell}")?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Marker, TakeBuilder};

    static INFO: FormatInfo = FormatInfo { name: "table", summary: "", extensions: &[], holds_gaps: true };

    fn changed(spelling: &Spelling, from: &[&str]) -> (Vec<String>, Vec<String>) {
        let take = TakeBuilder::new(from.iter().copied().map(Marker::new).collect(), 1, 100.0).build();
        let notes = Notes::new();
        let columns: Vec<usize> = (0..from.len()).collect();
        let labels = labels(&INFO, spelling, &take, &columns, &["origin".to_owned()], &notes);
        (labels, notes.take().iter().map(ToString::to_string).collect())
    }

    #[test]
    fn changed_labels_are_unlike_all_others() {
        let unique = Spelling { unique: true, longest: 3, ..PLAIN };
        for (spelling, from, to, note) in [
            (&PLAIN, &["A", "A", "b c"][..], &["A", "A", "b c"][..], None),
            (&PLAIN, &["", "unlabelled_1"], &["unlabelled_1_2", "unlabelled_1"], Some("are empty were changed: now called unlabelled_1_2")),
            (&PLAIN, &["a\tb", "a_b", "a\nb"], &["a_b_2", "a_b", "a_b_3"], None),
            (&PLAIN, &[" A ", "A"], &["A_2", "A"], Some("1 labels that have blanks at their ends were changed: now called A_2")),
            (
                &LINES,
                &["", " A", "x\ny"],
                &["", " A", "x_y"],
                Some("1 labels that have tabs, line ends or other control characters in them"),
            ),
            (&unique, &["A", "A", "A_2"], &["A", "A_3", "A_2"], Some("1 labels that are called like others were changed: now called A_3")),
            (&unique, &["long", "lon"], &["lon_2", "lon"], Some("1 labels that have more than 3 letters were changed")),
            (&Spelling { unique: true, ..LINES }, &["origin"], &["origin_2"], Some("are called like others")),
        ] {
            let (labels, notes) = changed(spelling, from);
            assert_eq!(labels, to);
            if let Some(text) = note {
                assert!(notes.len() == 1 && notes.iter().all(|n| n.contains(text)), "{notes:?}");
            }
        }
    }
}
