//! What the page keeps of every take: a few numbers as streams, and texts that are kept once however many takes they are said of.

use super::{FleetRow, folder_of};
use crate::batch::ledger::Outcome;
use crate::batch::sidecar::{NoteSaid, Summary};
use crate::page::pack::{Packer, push};
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::UNIX_EPOCH;

/// Texts of notes that the page carries, in bytes. Of notes beyond, only the kind is told: they stand in the sidecars.
const MOST_NOTES: usize = 8 << 20;

/// The longest text of a note or a reason, in bytes.
const LONGEST_TEXT: usize = 700;

/// Predicted errors and errors of bones are kept in steps of this.
pub(super) const STEP_MM: f64 = 0.01;

/// Texts, each kept once.
#[derive(Debug, Default)]
pub(super) struct Texts {
    index: BTreeMap<String, u32>,
}

impl Texts {
    pub(super) fn index(&mut self, text: &str) -> u32 {
        if let Some(&index) = self.index.get(text) {
            return index;
        }
        let index = self.index.len() as u32;
        self.index.insert(text.to_owned(), index);
        index
    }

    pub(super) fn len(&self) -> usize {
        self.index.len()
    }

    pub(super) fn get(&self, text: &str) -> Option<u32> {
        self.index.get(text).copied()
    }

    /// In the order in which they came.
    pub(super) fn into_list(self) -> Vec<String> {
        let mut list = vec![String::new(); self.index.len()];
        for (text, index) in self.index {
            list[index as usize] = text;
        }
        list
    }
}

/// Notes, each kept once.
#[derive(Debug, Default)]
struct Notes {
    index: BTreeMap<(bool, String, String), u32>,
    bytes: usize,
    /// Some are told by their kinds alone.
    cut: bool,
}

impl Notes {
    fn index(&mut self, note: &NoteSaid) -> u32 {
        let mut key = (note.matters, note.kind.clone(), shortened(&note.text));
        if let Some(&index) = self.index.get(&key) {
            return index;
        }
        if self.bytes + key.2.len() > MOST_NOTES {
            self.cut = true;
            key.2.clear();
        }
        self.bytes += key.2.len();
        let next = self.index.len() as u32;
        *self.index.entry(key).or_insert(next)
    }
}

/// A note as the page has it.
#[derive(Clone, Debug, Default, Serialize)]
struct Note {
    matters: bool,
    kind: String,
    text: String,
}

fn shortened(text: &str) -> String {
    if text.len() <= LONGEST_TEXT {
        return text.to_owned();
    }
    let end = (0..=LONGEST_TEXT).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
    format!("{} …", &text[..end])
}

macro_rules! streams {
    ($($(#[$doc:meta])* $name:ident),+ $(,)?) => {
        /// One number for each take. In those that may not be known, 0 is not known, and everything else is one more than it is.
        #[derive(Debug, Default)]
        struct Streams { $($(#[$doc])* $name: Vec<u8>),+ }

        impl Streams {
            fn pack(&self, packer: &mut Packer) {
                $(packer.add_bytes(stringify!($name), &self.$name);)+
            }
        }
    };
}

streams! {
    /// 0 done, 1 done with something to look at, 2 quarantined, 3 failed, 4 not yet done.
    state,
    /// 1: it has a report, 2: a log, 4: it was done already when the last run came by, 8: the numbers of its repair are known.
    flags,
    exit_code,
    tries,
    elapsed_ms,
    peak_kib,
    bytes,
    /// Seconds since 1970.
    time,
    folder,
    reason,
    format,
    method,
    /// Frames in a thousand seconds.
    rate,
    frames,
    markers,
    bones,
    samples,
    missing,
    filled,
    gaps,
    open,
    longest,
    suspects,
    sigma,
    bone_worst,
    bone_rms,
    worst_bone,
    /// How many, then which.
    notes,
}

/// All takes.
#[derive(Debug, Default)]
pub(super) struct Takes {
    paths: Vec<String>,
    /// Names of outputs that are called otherwise than their takes.
    outputs: BTreeMap<usize, String>,
    streams: Streams,
    folders: Texts,
    reasons: Texts,
    formats: Texts,
    methods: Texts,
    bones: Texts,
    notes: Notes,
}

/// All takes, as the page has them.
#[derive(Serialize)]
pub(super) struct TakesModel {
    paths: Vec<String>,
    outputs: BTreeMap<usize, String>,
    folders: Vec<String>,
    reasons: Vec<String>,
    formats: Vec<String>,
    methods: Vec<String>,
    worst_bones: Vec<String>,
    notes: Vec<Note>,
    notes_cut: bool,
    step_mm: f64,
}

impl Takes {
    pub(super) fn add(&mut self, row: &FleetRow, shared_folders: usize) {
        let at = self.paths.len();
        self.paths.push(row.path.clone());
        if row.output != row.path {
            self.outputs.insert(at, row.output.clone());
        }
        let sidecar = row.sidecar.as_ref();
        let exit_code = row.exit_code.or(sidecar.map(|sidecar| sidecar.exit_code));
        let state = match row.outcome {
            Some(Outcome::Done | Outcome::Skipped) => i64::from(exit_code.is_some_and(|code| code != 0)),
            Some(Outcome::Quarantined) => 2,
            Some(Outcome::Failed) => 3,
            None => 4,
        };
        let skipped = row.outcome == Some(Outcome::Skipped);
        let flags = [row.report, row.log, skipped, sidecar.is_some()];
        let flags = flags.iter().enumerate().map(|(bit, set)| i64::from(*set) << bit).sum();
        let time = row.time.as_deref().and_then(|time| humantime::parse_rfc3339(time).ok());
        let time = time.and_then(|time| time.duration_since(UNIX_EPOCH).ok()).map(|since| since.as_secs());
        let s = &mut self.streams;
        push(&mut s.state, state);
        push(&mut s.flags, flags);
        push(&mut s.exit_code, known(exit_code));
        push(&mut s.tries, row.tries as i64);
        push(&mut s.elapsed_ms, known(row.elapsed_secs.map(|secs| steps(secs, 1e-3))));
        push(&mut s.peak_kib, known(row.peak_bytes.map(|bytes| bytes.div_ceil(1024))));
        push(&mut s.bytes, row.bytes as i64);
        push(&mut s.time, known(time));
        push(&mut s.folder, i64::from(self.folders.index(folder_of(&row.path, shared_folders))));
        push(&mut s.reason, known(row.reason.as_deref().map(|reason| self.reasons.index(&shortened(reason)))));

        let nothing = Summary::default();
        let sum = sidecar.map_or(&nothing, |sidecar| &sidecar.summary);
        push(&mut s.format, known(sidecar.map(|_| self.formats.index(&sum.format))));
        push(&mut s.method, known(sidecar.map(|_| self.methods.index(&sum.method))));
        push(&mut s.rate, steps(sum.rate_hz, 1e-3) as i64);
        for (stream, number) in [
            (&mut s.frames, sum.frames as u64),
            (&mut s.markers, sum.markers as u64),
            (&mut s.bones, sum.bones as u64),
            (&mut s.samples, sum.samples),
            (&mut s.missing, sum.samples_missing),
            (&mut s.filled, sum.samples_filled),
            (&mut s.gaps, sum.gaps as u64),
            (&mut s.open, sum.gaps_left_open as u64),
            (&mut s.longest, sum.longest_gap as u64),
            (&mut s.suspects, sum.suspects as u64),
        ] {
            push(stream, number as i64);
        }
        push(&mut s.sigma, known(sum.worst_sigma_mm.map(|mm| steps(mm, STEP_MM))));
        push(&mut s.bone_worst, known(sum.bone_worst_mm.map(|mm| steps(mm, STEP_MM))));
        push(&mut s.bone_rms, known(sum.bone_rms_mm.map(|mm| steps(mm, STEP_MM))));
        push(&mut s.worst_bone, known(sum.worst_bone.as_deref().map(|bone| self.bones.index(bone))));
        let notes = sidecar.map_or(&[][..], |sidecar| &sidecar.notes);
        push(&mut s.notes, notes.len() as i64);
        for note in notes {
            push(&mut s.notes, i64::from(self.notes.index(note)));
        }
    }

    /// Adds the numbers to those of the page, and gives the texts.
    pub(super) fn pack(self, packer: &mut Packer) -> TakesModel {
        self.streams.pack(packer);
        let mut notes = vec![Note::default(); self.notes.index.len()];
        for ((matters, kind, text), index) in self.notes.index {
            notes[index as usize] = Note { matters, kind, text };
        }
        TakesModel {
            paths: self.paths,
            outputs: self.outputs,
            folders: self.folders.into_list(),
            reasons: self.reasons.into_list(),
            formats: self.formats.into_list(),
            methods: self.methods.into_list(),
            worst_bones: self.bones.into_list(),
            notes,
            notes_cut: self.notes.cut,
            step_mm: STEP_MM,
        }
    }
}

/// One more than the number, or 0 if there is none.
pub(super) fn known<T: TryInto<i64>>(number: Option<T>) -> i64 {
    number.map_or(0, |number| number.try_into().unwrap_or(i64::MAX - 1) + 1)
}

/// How many steps there are in a number; none in what is no number.
pub(super) fn steps(number: f64, step: f64) -> u64 {
    (number / step).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_are_kept_once_and_only_so_many() {
        let note = |text: String| NoteSaid { kind: "k".to_owned(), text, matters: true };
        let mut notes = Notes::default();
        assert_eq!((notes.index(&note("a".to_owned())), notes.index(&note("b".to_owned())), notes.index(&note("a".to_owned()))), (0, 1, 0));
        for at in 0..20_000 {
            notes.index(&note(format!("{at:0600}")));
        }
        let bytes: usize = notes.index.keys().map(|(_, _, text)| text.len()).sum();
        assert!(notes.cut && bytes <= MOST_NOTES && bytes == notes.bytes, "{bytes}");
        assert_eq!(notes.index(&note("never seen".repeat(60))), notes.index(&note("nor this".repeat(70))));
    }

    #[test]
    fn what_is_not_known_is_not_nought() {
        assert_eq!((known(None::<u64>), known(Some(0u64)), known(Some(u64::MAX))), (0, 1, i64::MAX));
        assert_eq!((steps(4.704, 0.01), steps(f64::NAN, 0.01), steps(-1.0, 0.01)), (470, 0, 0));
        assert_eq!(shortened(&"ä".repeat(600)).len(), 700 + " …".len());
    }
}
