//! Motion-capture files, read into a [`Take`] and put back without touching anything else.
//!
//! A *format* ([`Format`]) turns bytes into an opened [`Document`].
//! The document holds the take and everything else that the file said; [`Document::save`] patches the repaired samples into the original bytes.
//! [`Format::create`] writes a file from nothing but a take, and notes what the format cannot hold.
//!
//! Parsing is a pure function of bytes: no file names, no clock, no global state.
//! Every byte is untrusted: parsers never index, never panic, and never allocate what a file merely declares.
//!
//! The folders beside this file are the formats; [`ALL`] is their one list.
//! To add one: write its folder, add two lines here, `fixtures/<name>/` and `docs/formats/<name>.md`.

pub mod bvh;
pub mod c3d;
pub mod csv;
mod cursor;
mod error;
mod grid;
pub mod motive;
pub mod nexus;
mod note;
mod positions;
pub mod rig;
mod samples;
mod take;
mod text;
pub mod trc;
pub mod tsv;
mod turn;

pub use error::{FormatError, Place, Problem};
pub use grid::Grid;
pub use note::{Note, Notes, printable};
pub use samples::Samples;
pub use take::{Direction, Marker, Origin, Role, Take, TakeBuilder, Unit};

use std::io::Write;

/// Every format, in the order in which they are asked.
pub static ALL: &[&dyn Format] = &[&c3d::C3d, &csv::Csv, &motive::Motive, &nexus::Nexus, &trc::Trc, &tsv::Tsv, &bvh::Bvh];

/// The largest file that is read, in bytes.
pub const LARGEST_FILE: u64 = 4 << 30;

/// True for a frame rate that a recording can have, from one frame in a quarter of an hour to a million a second; anything else in a file is
/// taken for no rate at all.
pub(crate) fn is_a_rate(rate_hz: f64) -> bool {
    (1e-3..=1e6).contains(&rate_hz)
}

/// What a format is called and what it is for.
#[derive(Debug)]
pub struct FormatInfo {
    /// Short name, as on the command line and in errors: `c3d`.
    pub name: &'static str,
    /// One line for people.
    pub summary: &'static str,
    /// File name extensions, lower case, the usual one first. Formats may share one; then the content decides.
    pub extensions: &'static [&'static str],
    /// True if a file of this format can say that a sample is missing.
    pub holds_gaps: bool,
}

/// How sure a format is that some bytes are its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Match {
    /// They are not.
    No,
    /// They may be.
    Maybe,
    /// They are.
    Certain,
}

/// What the user states about a file; it overrules what the file says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stated {
    /// Frames per second.
    pub rate_hz: Option<f64>,
    /// Unit of length.
    pub unit: Option<Unit>,
    /// Samples that are missing, whatever the file holds in their place. Saving may replace them.
    pub missing: Samples,
}

/// A file format. Asked in this order: [`sniff`](Format::sniff), then [`open`](Format::open).
pub trait Format: Sync {
    /// Name, extensions.
    fn info(&self) -> &'static FormatInfo;

    /// Judges the first bytes (up to 4096) of a file.
    fn sniff(&self, head: &[u8]) -> Match;

    /// Parses a whole file.
    ///
    /// # Errors
    /// Malformed, unsupported or too large. A reader that is unsure of units or rate assumes and notes; one that is unsure of data fails.
    fn open(&self, bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError>;

    /// Writes a new file that holds the take, in the take's own unit, and notes what the format cannot hold.
    ///
    /// # Errors
    /// Unsupported, too large, or an I/O error of `out`.
    fn create(&self, take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError>;
}

/// An opened file, with all it said.
pub trait Document: Send {
    /// The take that was read.
    fn take(&self) -> &Take;

    /// Writes the file again with the [`Origin::Repaired`] samples of `repaired` patched in and every other byte as it was.
    /// `repaired` is the take of this document with some missing samples filled.
    ///
    /// # Errors
    /// Unsupported if a filled value cannot be stored, or an I/O error of `out`.
    fn save(&self, repaired: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError>;

    /// What the file holds that is not in the take, in a few words each, such as `24 analog channels`.
    /// Saving keeps it; a new file made from the take does not have it.
    fn beyond_take(&self) -> Vec<String> {
        Vec::new()
    }

    /// The same file with coordinates stored as floating-point numbers, where this one stores them as integers and the format knows both.
    /// `None` if there is nothing to change.
    ///
    /// # Errors
    /// Unsupported, if the file cannot be converted.
    fn as_floats(&self) -> Result<Option<Vec<u8>>, FormatError> {
        Ok(None)
    }

    /// How far a filled coordinate may be from what [`save`](Document::save) stores, in mm.
    fn rounding_mm(&self) -> f64;

    /// What a check of the file that [`save`](Document::save) wrote has to allow; `notes` are those that saving left.
    ///
    /// Where samples are stored each by itself, that is nothing but the rounding of filled ones.
    fn leeway(&self, _notes: &[Note]) -> Leeway {
        Leeway { known_mm: 0.0, filled_mm: self.rounding_mm() }
    }
}

/// How near a patched file has to come to the take, where samples depend on each other, in mm.
///
/// Known samples of frames in which nothing was filled are equal bit for bit, whatever this says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leeway {
    /// Distance of known coordinates, in frames in which something was filled. 0 asks for equal bits.
    pub known_mm: f64,
    /// Distance of filled coordinates.
    pub filled_mm: f64,
}

/// Why no format was chosen.
#[derive(Debug, thiserror::Error)]
pub enum DetectError {
    /// There is nothing to read.
    #[error("the file is empty (0 bytes); expected one of: {known}")]
    Empty {
        /// Names of the formats.
        known: String,
    },
    /// No format knows these bytes.
    #[error("not a format we know: {found}; expected one of: {known}")]
    Unknown {
        /// What the file begins with.
        found: String,
        /// Names of the formats.
        known: String,
    },
    /// The name says one thing and the content another.
    #[error("named .{extension} but not {name}: {found}; rename the file after its content, or export it again")]
    Contradiction {
        /// The extension.
        extension: String,
        /// The format that the extension belongs to.
        name: &'static str,
        /// What the file begins with.
        found: String,
    },
}

/// The format that an extension (without the dot, any case) belongs to; of several the one that usually has it, else the first.
pub fn by_extension(extension: &str) -> Option<&'static dyn Format> {
    named(extension).first().copied()
}

/// The formats that an extension (without the dot, any case) may belong to.
fn named(extension: &str) -> Vec<&'static dyn Format> {
    let extension = extension.to_ascii_lowercase();
    let mut named: Vec<_> = ALL.iter().copied().filter(|f| f.info().extensions.contains(&extension.as_str())).collect();
    named.sort_by_key(|f| f.info().extensions.first() != Some(&extension.as_str())); // stable: first those that usually have it
    named
}

/// Chooses the format by content: among those that the extension (without the dot) may belong to, or among all if it belongs to none.
/// So the content decides, but must not contradict the name.
///
/// # Errors
/// Empty, unknown, or named after a format that does not know the content.
pub fn detect(head: &[u8], extension: Option<&str>) -> Result<&'static dyn Format, DetectError> {
    let known = || ALL.iter().map(|f| f.info().name).collect::<Vec<_>>().join(", ");
    if head.is_empty() {
        return Err(DetectError::Empty { known: known() });
    }
    let named: Vec<&'static dyn Format> = extension.map(named).unwrap_or_default();
    let asked = if named.is_empty() { ALL } else { named.as_slice() };
    let mut best: Option<(Match, &'static dyn Format)> = None;
    for format in asked {
        let sure = format.sniff(head);
        if sure != Match::No && best.is_none_or(|(b, _)| sure > b) {
            best = Some((sure, *format));
        }
    }
    if let (None, Some(format)) = (best, named.first()) {
        return Err(DetectError::Contradiction {
            extension: extension.unwrap_or_default().to_owned(),
            name: format.info().name,
            found: describe(head),
        });
    }
    best.map(|(_, format)| format).ok_or_else(|| DetectError::Unknown { found: describe(head), known: known() })
}

/// Says what bytes look like, for an error message.
fn describe(head: &[u8]) -> String {
    let odd = head.iter().take(256).position(|&b| !(b >= 0x20 && b != 0x7f || matches!(b, b'\n' | b'\r' | b'\t')));
    let start: String = String::from_utf8_lossy(head).chars().take(24).filter(|c| !c.is_control()).collect();
    if odd.is_none() {
        format!("it holds text that begins \"{start}\"")
    } else if let Some(at) = odd.filter(|&at| at >= 16) {
        format!("it begins as text, \"{start}\", but byte {at} is {:02x}, which no text holds", head[at])
    } else {
        let start: Vec<String> = head.iter().take(4).map(|b| format!("{b:02x}")).collect();
        format!("it begins with the bytes {}", start.join(" "))
    }
}
