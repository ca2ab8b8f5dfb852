//! The table: one row for each take, as RFC 4180 has it. What is not known is empty.

use super::FleetRow;
use crate::batch::ledger::Outcome;
use std::io::{self, BufWriter, Write as _};
use tempfile::NamedTempFile;

const COLUMNS: [&str; 33] = [
    "path",
    "output",
    "outcome",
    "exit_code",
    "reason",
    "tries",
    "elapsed_secs",
    "peak_bytes",
    "input_bytes",
    "time",
    "format",
    "method",
    "rate_hz",
    "frames",
    "markers",
    "bones",
    "samples",
    "samples_missing",
    "missing_share",
    "samples_filled",
    "gaps",
    "gaps_left_open",
    "longest_gap_frames",
    "suspects",
    "worst_sigma_mm",
    "bone_worst_mm",
    "bone_rms_mm",
    "worst_bone",
    "notes",
    "notes_that_matter",
    "note_kinds",
    "report",
    "key",
];

/// A table that is being written.
pub(super) struct Sheet(csv::Writer<BufWriter<NamedTempFile>>);

impl Sheet {
    pub(super) fn new(file: BufWriter<NamedTempFile>) -> io::Result<Self> {
        let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::CRLF).from_writer(file);
        writer.write_record(COLUMNS)?;
        Ok(Self(writer))
    }

    pub(super) fn add(&mut self, row: &FleetRow) -> io::Result<()> {
        Ok(self.0.write_record(cells(row))?)
    }

    pub(super) fn finish(self) -> io::Result<NamedTempFile> {
        let mut buffered = self.0.into_inner().map_err(csv::IntoInnerError::into_error)?;
        buffered.flush()?;
        buffered.into_inner().map_err(io::IntoInnerError::into_error)
    }
}

/// How an outcome is called, for scripts.
fn word(outcome: Option<Outcome>) -> &'static str {
    match outcome {
        Some(Outcome::Done) => "done",
        Some(Outcome::Skipped) => "skipped",
        Some(Outcome::Quarantined) => "quarantined",
        Some(Outcome::Failed) => "failed",
        None => "not_done",
    }
}

fn cells(row: &FleetRow) -> [String; COLUMNS.len()] {
    fn plain<T: ToString>(value: Option<T>) -> String {
        value.map(|value| value.to_string()).unwrap_or_default()
    }
    let sidecar = row.sidecar.as_ref();
    let summary = sidecar.map(|sidecar| &sidecar.summary);
    let share = summary.filter(|s| s.samples > 0).map(|s| (s.samples_missing as f64 / s.samples as f64 * 1e6).round() / 1e6);
    let kinds = sidecar.map(|sidecar| {
        let mut kinds: Vec<&str> = sidecar.notes.iter().map(|note| note.kind.as_str()).collect();
        kinds.sort_unstable();
        kinds.dedup();
        kinds.join(" ")
    });
    [
        row.path.clone(),
        row.output.clone(),
        word(row.outcome).to_owned(),
        plain(row.exit_code),
        plain(row.reason.as_deref()),
        if row.outcome.is_some() { row.tries.to_string() } else { String::new() },
        plain(row.elapsed_secs),
        plain(row.peak_bytes),
        row.bytes.to_string(),
        plain(row.time.as_deref()),
        plain(summary.map(|s| s.format.as_str())),
        plain(summary.map(|s| s.method.as_str())),
        plain(summary.map(|s| s.rate_hz)),
        plain(summary.map(|s| s.frames)),
        plain(summary.map(|s| s.markers)),
        plain(summary.map(|s| s.bones)),
        plain(summary.map(|s| s.samples)),
        plain(summary.map(|s| s.samples_missing)),
        plain(share),
        plain(summary.map(|s| s.samples_filled)),
        plain(summary.map(|s| s.gaps)),
        plain(summary.map(|s| s.gaps_left_open)),
        plain(summary.map(|s| s.longest_gap)),
        plain(summary.map(|s| s.suspects)),
        plain(summary.and_then(|s| s.worst_sigma_mm)),
        plain(summary.and_then(|s| s.bone_worst_mm)),
        plain(summary.and_then(|s| s.bone_rms_mm)),
        plain(summary.and_then(|s| s.worst_bone.as_deref())),
        plain(sidecar.map(|s| s.notes.len())),
        plain(sidecar.map(|s| s.notes.iter().filter(|note| note.matters).count())),
        plain(kinds),
        if row.report { format!("{}.html", row.output) } else { String::new() },
        plain(sidecar.map(|s| s.key.as_str())),
    ]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::io::Read as _;

    #[test]
    fn names_with_commas_quotes_and_line_ends_come_back() {
        let path = "a,\"b\"\r\nc/=1+1.c3d";
        let mut sheet = Sheet::new(BufWriter::new(NamedTempFile::new().unwrap())).unwrap();
        sheet.add(&FleetRow { path: path.to_owned(), bytes: 7, ..FleetRow::default() }).unwrap();
        let file = sheet.finish().unwrap();
        let mut text = String::new();
        file.reopen().unwrap().read_to_string(&mut text).unwrap();
        assert!(text.starts_with("path,output,outcome,"));
        assert!(text.contains("\r\n\"a,\"\"b\"\"\r\nc/=1+1.c3d\",,not_done,,,,,,7,"), "{text}");
        let mut back = csv::Reader::from_reader(text.as_bytes());
        let row = back.records().next().unwrap().unwrap();
        assert_eq!((row.len(), &row[0], &row[8]), (COLUMNS.len(), path, "7"));
    }

    #[test]
    fn columns_are_words_for_scripts() {
        for (at, name) in COLUMNS.iter().enumerate() {
            assert!(name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{name}");
            assert!(!COLUMNS[..at].contains(name), "{name}");
        }
    }
}
