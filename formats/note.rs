//! What happened that is not an error.
//!
//! A note is written for the person who reads the summary, and decides with [`Note::matters`] whether the exit code says "look at this".

use crate::{FormatInfo, Unit};
use std::cell::RefCell;
use std::collections::BTreeSet;

/// Something that a reader or a writer assumed, found odd, or could not keep.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Note {
    /// The file names no unit; this one was taken.
    UnitAssumed {
        /// The unit taken.
        unit: Unit,
    },
    /// The file names a unit that we do not know.
    UnitUnknown {
        /// As written.
        written: String,
        /// The unit taken instead.
        unit: Unit,
    },
    /// The file names no frame rate; this one was taken.
    RateAssumed {
        /// Hz.
        rate_hz: f64,
    },
    /// Zero coordinates were read as missing.
    ZeroReadAsMissing {
        /// How many samples.
        samples: usize,
    },
    /// Samples flagged missing hold old coordinates, which were not believed.
    StaleCoordinates {
        /// How many samples.
        samples: usize,
    },
    /// Every sample is flagged missing although many hold coordinates.
    AllFlaggedMissing {
        /// How many samples hold coordinates.
        with_coordinates: usize,
        /// How many samples there are.
        samples: usize,
    },
    /// A fourth word that is neither a residual nor a flag; the coordinates were believed.
    ResidualGarbage {
        /// How many samples.
        samples: usize,
    },
    /// The file claims another number of frames than it holds.
    FrameCount {
        /// What the file claims.
        claimed: u64,
        /// What is there.
        present: u64,
    },
    /// Two places of the file contradict each other.
    Contradiction {
        /// What is written where, and which was taken.
        text: String,
    },
    /// Two places of the file contradict each other about what the samples mean; one was taken.
    Assumed {
        /// What is written where, and which was taken, and why.
        text: String,
    },
    /// A part of the file cannot be read; the samples can.
    Damaged {
        /// Which part, where, and what that means.
        text: String,
    },
    /// Labels and columns differ in number.
    LabelCount {
        /// Labels in the file.
        labels: usize,
        /// Columns in the file.
        columns: usize,
    },
    /// A label occurs more than once.
    DuplicateLabels {
        /// The labels that occur again.
        labels: Vec<String>,
    },
    /// Columns that hold results instead of markers; left as they are.
    ModelOutputs {
        /// How many columns.
        columns: usize,
    },
    /// Samples of which only some coordinates are given; they count as missing, the given coordinates are kept as written.
    PartialSamples {
        /// How many samples.
        samples: usize,
    },
    /// Columns that are neither coordinates nor frame numbers nor times; left as they are.
    OtherColumns {
        /// Their names.
        names: Vec<String>,
    },
    /// Blocks of the file that hold no markers; left as they are.
    OtherBlocks {
        /// Their names.
        names: Vec<String>,
    },
    /// The file numbers its frames in steps; its rows were counted as consecutive frames.
    FrameStep {
        /// The difference between the numbers of neighbouring frames.
        step: i64,
    },
    /// Filled positions were rounded to what the file can store.
    Rounded {
        /// The step in mm.
        step_mm: f64,
    },
    /// Integers were taken for floating-point numbers, as asked for.
    Floats,
    /// Filled joints are elsewhere in the written file, because its bones are rigid.
    NotRealised {
        /// How many samples.
        samples: usize,
        /// How far the worst of them is off.
        worst_mm: f64,
    },
    /// Samples that were stated to be missing stay open, so the file still holds what it held.
    StatedStays {
        /// How many samples.
        samples: usize,
    },
    /// A new file was made, which does not have something that stood in the file that was read.
    LeftOut {
        /// What it is.
        what: String,
    },
    /// The written format cannot hold something that the take has.
    NotExpressible {
        /// The format's name.
        format: &'static str,
        /// What was left out.
        what: String,
    },
    /// Something of the take is otherwise in the written file, because the format cannot hold it as it is.
    Changed {
        /// The format's name.
        format: &'static str,
        /// What was changed, as a sentence.
        what: String,
    },
}

/// From here on it matters that filled joints are elsewhere, mm.
const FAR_OFF_MM: f64 = 5.0;

impl Note {
    /// True if something was lost or assumed, so that a person should look: exit code 3.
    pub fn matters(&self) -> bool {
        match self {
            Self::UnitAssumed { .. }
            | Self::UnitUnknown { .. }
            | Self::RateAssumed { .. }
            | Self::AllFlaggedMissing { .. }
            | Self::FrameCount { .. }
            | Self::Assumed { .. }
            | Self::Damaged { .. }
            | Self::StatedStays { .. }
            | Self::LeftOut { .. }
            | Self::NotExpressible { .. }
            | Self::Changed { .. } => true,
            Self::NotRealised { worst_mm, .. } => *worst_mm >= FAR_OFF_MM,
            Self::ZeroReadAsMissing { .. }
            | Self::StaleCoordinates { .. }
            | Self::ResidualGarbage { .. }
            | Self::Contradiction { .. }
            | Self::LabelCount { .. }
            | Self::DuplicateLabels { .. }
            | Self::ModelOutputs { .. }
            | Self::PartialSamples { .. }
            | Self::OtherColumns { .. }
            | Self::OtherBlocks { .. }
            | Self::FrameStep { .. }
            | Self::Rounded { .. }
            | Self::Floats => false,
        }
    }

    /// A name for the kind of note that scripts can rely on.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::UnitAssumed { .. } => "unit-assumed",
            Self::UnitUnknown { .. } => "unit-unknown",
            Self::RateAssumed { .. } => "rate-assumed",
            Self::ZeroReadAsMissing { .. } => "zero-read-as-missing",
            Self::StaleCoordinates { .. } => "stale-coordinates",
            Self::AllFlaggedMissing { .. } => "all-flagged-missing",
            Self::ResidualGarbage { .. } => "residual-garbage",
            Self::FrameCount { .. } => "frame-count",
            Self::Contradiction { .. } => "contradiction",
            Self::Assumed { .. } => "assumed",
            Self::Damaged { .. } => "damaged",
            Self::LabelCount { .. } => "label-count",
            Self::DuplicateLabels { .. } => "duplicate-labels",
            Self::ModelOutputs { .. } => "model-outputs",
            Self::PartialSamples { .. } => "partial-samples",
            Self::OtherColumns { .. } => "other-columns",
            Self::OtherBlocks { .. } => "other-blocks",
            Self::FrameStep { .. } => "frame-step",
            Self::Rounded { .. } => "rounded",
            Self::Floats => "floats",
            Self::NotRealised { .. } => "not-realised",
            Self::StatedStays { .. } => "stated-stays",
            Self::LeftOut { .. } => "left-out",
            Self::NotExpressible { .. } => "not-expressible",
            Self::Changed { .. } => "changed",
        }
    }
}

/// Text as it can be printed in one line: control characters, with which a damaged file could take over a terminal, become escapes.
pub fn printable(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut out, c| {
        if c.is_control() || turns_text(c) {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
        out
    })
}

/// Characters without a shape that change the order or the lines of the text around them.
fn turns_text(c: char) -> bool {
    matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}')
}

impl std::fmt::Display for Note {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&printable(&Raw(self).to_string()))
    }
}

/// The text with what stood in the file as it stood there.
struct Raw<'a>(&'a Note);

impl std::fmt::Display for Raw<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Note::UnitAssumed { unit } => write!(f, "the file names no unit, {} assumed (say it with --units)", unit.symbol()),
            Note::UnitUnknown { written, unit } => {
                write!(f, "the unit \"{written}\" is unknown, {} assumed (say it with --units)", unit.symbol())
            }
            Note::RateAssumed { rate_hz } => write!(f, "the file names no frame rate, {rate_hz} Hz assumed (say it with --rate)"),
            Note::ZeroReadAsMissing { samples } => write!(f, "{samples} samples at exactly 0 0 0 were read as missing"),
            Note::StaleCoordinates { samples } => {
                write!(f, "{samples} samples are flagged missing but still hold coordinates, which were not believed")
            }
            Note::AllFlaggedMissing { with_coordinates, samples } => write!(
                f,
                "all {samples} samples are flagged missing although {with_coordinates} hold coordinates: whoever wrote this file marked \
                 everything as not measured, so there is nothing to fill from; export it again with its residuals"
            ),
            Note::ResidualGarbage { samples } => {
                write!(f, "{samples} samples have a residual that makes no sense; their coordinates were believed")
            }
            Note::FrameCount { claimed, present } => write!(f, "the file claims {claimed} frames and holds {present}"),
            Note::Contradiction { text } | Note::Assumed { text } | Note::Damaged { text } => f.write_str(text),
            Note::LabelCount { labels, columns } => write!(f, "{labels} labels for {columns} columns"),
            Note::DuplicateLabels { labels } => write!(f, "labels that occur more than once: {}", labels.join(", ")),
            Note::ModelOutputs { columns } => write!(f, "{columns} columns are model outputs, not markers; left as they are"),
            Note::PartialSamples { samples } => {
                write!(f, "{samples} samples have only some of their coordinates; they count as missing, what is given stays as written")
            }
            Note::OtherColumns { names } => write!(f, "columns that are no markers were left as they are: {}", listed(names)),
            Note::OtherBlocks { names } => write!(f, "blocks that hold no markers were left as they are: {}", listed(names)),
            Note::FrameStep { step } => {
                write!(f, "the frame numbers go up in steps of {step}; the rows were counted as consecutive frames")
            }
            Note::Rounded { step_mm } => write!(f, "filled positions are rounded to the file's own step of {step_mm} mm"),
            Note::Floats => f.write_str("coordinates stored as integers become floating-point numbers"),
            Note::NotRealised { samples, worst_mm } if *worst_mm >= FAR_OFF_MM => write!(
                f,
                "{samples} filled positions could not be put into the file, because its bones are rigid and known joints stay; the worst is \
                 {worst_mm:.3} mm off"
            ),
            Note::NotRealised { samples, worst_mm } => write!(
                f,
                "{samples} filled positions are nearly but not quite in the file, because its bones are rigid and known joints stay; the worst is \
                 {worst_mm:.3} mm off"
            ),
            Note::StatedStays { samples } => {
                write!(
                    f,
                    "{samples} samples that are stated missing or dropped stay open, and the file still holds in their place what it held"
                )
            }
            Note::LeftOut { what } => write!(f, "not in the new file: {what}"),
            Note::NotExpressible { format, what } => write!(f, "{format} cannot hold {what}; left out"),
            Note::Changed { what, .. } => f.write_str(what),
        }
    }
}

/// The first of many names, and how many more there are.
pub(crate) fn listed(names: &[impl AsRef<str>]) -> String {
    let shown: Vec<&str> = names.iter().take(8).map(AsRef::as_ref).collect();
    let more = if names.len() > shown.len() { format!(" and {} more", names.len() - shown.len()) } else { String::new() };
    shown.join(", ") + &more
}

/// Collects notes from places that hold it by shared reference.
#[derive(Debug, Default)]
pub struct Notes(RefCell<Vec<Note>>);

impl Notes {
    /// An empty collection.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a note. The same note is kept once.
    pub fn add(&self, note: Note) {
        let mut notes = self.0.borrow_mut();
        if !notes.contains(&note) {
            notes.push(note);
        }
    }

    /// Notes each thing that `format` cannot hold.
    pub fn not_expressible(&self, format: &FormatInfo, what: impl Into<String>) {
        self.add(Note::NotExpressible { format: format.name, what: what.into() });
    }

    /// Notes something that is otherwise in a file of `format` than in the take; `what` is a sentence.
    pub fn changed(&self, format: &FormatInfo, what: impl Into<String>) {
        self.add(Note::Changed { format: format.name, what: what.into() });
    }

    /// Notes labels that occur more than once, in the order in which they come again. Empty ones are no labels.
    pub(crate) fn duplicate_labels<'a>(&self, labels: impl Iterator<Item = &'a str>) {
        let (mut seen, mut twice) = (BTreeSet::new(), BTreeSet::new());
        let labels: Vec<String> = labels.filter(|l| !l.is_empty() && !seen.insert(*l) && twice.insert(*l)).map(str::to_owned).collect();
        if !labels.is_empty() {
            self.add(Note::DuplicateLabels { labels });
        }
    }

    /// The notes so far, oldest first.
    pub fn take(&self) -> Vec<Note> {
        self.0.borrow().clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_off_is_said_otherwise_than_nearly() {
        let note = |worst_mm| Note::NotRealised { samples: 3, worst_mm };
        assert!(!note(4.9).matters() && note(4.9).to_string().contains("nearly but not quite"));
        let far = "3 filled positions could not be put into the file, because its bones are rigid and known joints stay; the worst is 5.000 mm off";
        assert_eq!((note(5.0).matters(), note(5.0).to_string()), (true, far.to_owned()));
    }

    #[test]
    fn nothing_in_a_text_can_move_the_text_around_it() {
        assert_eq!(printable("L\u{202e}KNE\u{2066}\u{1b}[2J\u{2028}"), "L\\u{202e}KNE\\u{2066}\\u{1b}[2J\\u{2028}");
        assert_eq!(printable("膝 ÄÖ é"), "膝 ÄÖ é");
    }

    #[test]
    fn many_names_are_cut_short() {
        let names: Vec<String> = (0..11).map(|n| n.to_string()).collect();
        assert_eq!(listed(&names), "0, 1, 2, 3, 4, 5, 6, 7 and 3 more");
        assert_eq!(listed(&["A", "B"]), "A, B");
    }
}
