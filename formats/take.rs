//! The take: one recording, normalised to millimetres and seconds, in which every sample knows where it came from.
//!
//! A take says nothing about files.
//! What a file held besides its markers stays with the opened [`Document`](crate::Document), which puts a repaired take back.
//!
//! Frames are counted from 0 in here.
//! The number that the file itself gives to a frame is its *label*: [`Take::frame_label`] is the one place where the two meet.

use crate::positions::Positions;
use crate::{Grid, Samples};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Where a sample came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Origin {
    /// Reconstructed from cameras, as far as the file says.
    Measured,
    /// The file holds a position, but says that someone filled or filtered it. Never changed by us.
    Derived,
    /// Nothing is known.
    Missing,
    /// Filled in by this program.
    Repaired,
}

impl Origin {
    /// True if the file that was read held a position for this sample.
    pub fn is_known(self) -> bool {
        matches!(self, Self::Measured | Self::Derived)
    }
}

/// The unit of length that a file is written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Unit {
    /// 1 mm
    Millimetre,
    /// 10 mm
    Centimetre,
    /// 1000 mm
    Metre,
}

impl Unit {
    /// All units, in the order in which they are offered.
    pub const ALL: [Self; 3] = [Self::Millimetre, Self::Centimetre, Self::Metre];

    /// How many millimetres one of this unit is.
    pub fn mm(self) -> f64 {
        match self {
            Self::Millimetre => 1.0,
            Self::Centimetre => 10.0,
            Self::Metre => 1000.0,
        }
    }

    /// `mm`, `cm` or `m`.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Metre => "m",
        }
    }

    /// Reads a unit as files write it: `mm`, `CM`, `Meters`, `mete` (a C3D that cut the word after four letters), ...
    pub fn parse(text: &str) -> Option<Self> {
        let word = text.trim().trim_end_matches('\0').to_ascii_lowercase();
        match word.as_str() {
            "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" | "mill" => Some(Self::Millimetre),
            "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" | "cent" => Some(Self::Centimetre),
            "m" | "meter" | "meters" | "metre" | "metres" | "mete" | "metr" => Some(Self::Metre),
            _ => None,
        }
    }
}

/// A signed coordinate axis, such as the one that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Direction {
    /// 0 = x, 1 = y, 2 = z.
    pub axis: usize,
    /// False for the negative axis.
    pub positive: bool,
}

impl Direction {
    /// The positive z axis.
    pub const PLUS_Z: Self = Self { axis: 2, positive: true };
    /// The positive y axis.
    pub const PLUS_Y: Self = Self { axis: 1, positive: true };

    /// Reads `+Z`, `-x`, `Y`, ...
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim().trim_end_matches('\0').trim();
        let (positive, letter) = match text.strip_prefix('-') {
            Some(rest) => (false, rest),
            None => (true, text.strip_prefix('+').unwrap_or(text)),
        };
        let axis = match letter {
            "x" | "X" => 0,
            "y" | "Y" => 1,
            "z" | "Z" => 2,
            _ => return None,
        };
        Some(Self { axis, positive })
    }
}

impl std::fmt::Display for Direction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let sign = if self.positive { '+' } else { '-' };
        let letter = match self.axis {
            0 => 'x',
            1 => 'y',
            _ => 'z',
        };
        write!(f, "{sign}{letter}")
    }
}

/// What a column of a take is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A point on a body or a prop.
    Marker,
    /// A result that a program stored among the points (an angle, a force, a power): the file's own numbers, whatever its unit of length.
    /// Never filled, never a neighbour.
    ModelOutput,
}

/// A column of a take.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Marker {
    /// The label as the file writes it, without trailing padding. May be empty, may occur twice.
    pub label: String,
    /// What the column holds.
    pub role: Role,
}

impl Marker {
    /// A marker of this name.
    pub fn new(label: impl Into<String>) -> Self {
        Self { label: label.into(), role: Role::Marker }
    }

    /// The prefix of the label, if it has one: `subject` of `subject:LKNE`.
    pub fn prefix(&self) -> Option<&str> {
        self.label.rsplit_once(':').map(|(prefix, _)| prefix)
    }

    /// The label without a subject's prefix: `subject:LKNE` gives `LKNE`.
    pub fn name(&self) -> &str {
        self.label.rsplit_once(':').map_or(self.label.as_str(), |(_, name)| name)
    }
}

/// One recording: markers × frames, in millimetres and in the axes of its file (which are right-handed in every format we know).
///
/// Positions of [`Origin::Missing`] samples are NaN inside and `None` outside.
/// A take is made by a [`TakeBuilder`]; afterwards the only change it allows is [`Take::fill`], and [`Take::without`] makes a poorer one.
#[derive(Clone, Debug)]
pub struct Take {
    /// Frames per second.
    pub rate_hz: f64,
    /// The file's own number of frame 0.
    pub first_frame: i64,
    /// By how much the file's own numbers go up from frame to frame; nearly always 1.
    pub frame_step: i64,
    /// The unit that the file is written in. Positions in here are millimetres whatever this says.
    pub unit: Unit,
    /// The axis that points up, if the file says so.
    pub up: Option<Direction>,
    /// The method that made the [`Origin::Repaired`] samples, for formats that can say so.
    pub filled_by: Option<String>,
    /// The columns, in the file's order.
    pub markers: Vec<Marker>,
    /// As the file has them. A copy of the take shares them, because what was filled stands apart.
    positions: Arc<Positions>,
    origins: Grid<Origin>,
    /// Positions of the samples that are [`Origin::Repaired`].
    filled_mm: BTreeMap<(usize, usize), [f64; 3]>,
    /// What is given of samples that are missing in part; NaN for the coordinates that are not.
    given_mm: BTreeMap<(usize, usize), [f64; 3]>,
}

impl Take {
    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.origins.frames()
    }

    /// Seconds from frame 0 to the end of the last frame.
    pub fn duration_secs(&self) -> f64 {
        self.frames() as f64 / self.rate_hz
    }

    /// The number that the file gives to `frame`.
    pub fn frame_label(&self, frame: usize) -> i64 {
        self.first_frame.saturating_add(i64::try_from(frame).unwrap_or(i64::MAX).saturating_mul(self.frame_step))
    }

    /// Where the sample came from; `Missing` outside the table.
    pub fn origin(&self, frame: usize, marker: usize) -> Origin {
        self.origins.get(frame, marker).copied().unwrap_or(Origin::Missing)
    }

    /// The position in mm, `None` if the sample is missing.
    pub fn position_mm(&self, frame: usize, marker: usize) -> Option<[f64; 3]> {
        match self.origin(frame, marker) {
            Origin::Missing => None,
            Origin::Repaired => self.filled_mm.get(&(frame, marker)).copied(),
            Origin::Measured | Origin::Derived => self.positions.get(frame, marker),
        }
    }

    /// Writes a position into a missing sample and marks it [`Origin::Repaired`].
    /// Coordinates that the file gives although the sample as a whole is missing keep what the file gives.
    /// Returns false, and changes nothing, if the sample is not missing, is a model output, or the position is not finite.
    pub fn fill(&mut self, frame: usize, marker: usize, position_mm: [f64; 3]) -> bool {
        if !position_mm.iter().all(|x| x.is_finite()) || self.markers.get(marker).is_none_or(|m| m.role != Role::Marker) {
            return false;
        }
        let Some(origin) = self.origins.get_mut(frame, marker).filter(|origin| **origin == Origin::Missing) else { return false };
        *origin = Origin::Repaired;
        let mut position_mm = position_mm;
        if let Some(given) = self.given_mm.get(&(frame, marker)) {
            for (x, given) in position_mm.iter_mut().zip(given).filter(|(_, given)| given.is_finite()) {
                *x = *given;
            }
        }
        self.filled_mm.insert((frame, marker), position_mm);
        true
    }

    /// A copy in which these samples are missing as well. Positions are shared. Samples of model outputs do not count.
    #[must_use]
    pub fn without(&self, samples: &Samples) -> Self {
        let mut other = self.clone();
        for (frame, marker) in samples.iter().filter(|&(_, marker)| self.markers.get(marker).is_some_and(|m| m.role == Role::Marker)) {
            if let Some(origin) = other.origins.get_mut(frame, marker) {
                *origin = Origin::Missing;
            }
        }
        other
    }

    /// A name to print for a marker: its label, or its number in the file where the label is empty.
    pub fn display_label(&self, marker: usize) -> String {
        match self.markers.get(marker) {
            Some(m) if !m.label.is_empty() => crate::printable(&m.label),
            _ => format!("#{}", marker + 1),
        }
    }
}

/// Builds a take, cell by cell. Every cell is [`Origin::Missing`] until it is set.
#[derive(Clone, Debug)]
pub struct TakeBuilder {
    /// Without positions, which come when it is built.
    take: Take,
    positions: Positions,
    missing: Samples,
}

impl TakeBuilder {
    /// A take in which everything is missing, in millimetres, with first frame 1.
    pub fn new(markers: Vec<Marker>, frames: usize, rate_hz: f64) -> Self {
        let columns = markers.len();
        Self {
            take: Take {
                rate_hz,
                first_frame: 1,
                frame_step: 1,
                unit: Unit::Millimetre,
                up: None,
                filled_by: None,
                markers,
                positions: Arc::new(Positions::new(0, 0)),
                origins: Grid::filled(frames, columns, Origin::Missing),
                filled_mm: BTreeMap::new(),
                given_mm: BTreeMap::new(),
            },
            positions: Positions::new(frames, columns),
            missing: Samples::default(),
        }
    }

    /// States that these samples are missing, whatever they are set to. Samples outside the table and of model outputs do not count.
    #[must_use]
    pub fn missing(mut self, missing: &Samples) -> Self {
        self.missing = missing.clone();
        self
    }

    /// Says that coordinates will be 32-bit numbers times this many mm, so that they need less memory. Others may be set all the same.
    #[must_use]
    pub fn multiples_of_mm(mut self, step_mm: f64) -> Self {
        self.positions.expect_step(step_mm);
        self
    }

    /// Sets the file's own number of frame 0.
    #[must_use]
    pub fn first_frame(mut self, first_frame: i64) -> Self {
        self.take.first_frame = first_frame;
        self
    }

    /// Sets by how much the file's own numbers go up from frame to frame.
    #[must_use]
    pub fn frame_step(mut self, frame_step: i64) -> Self {
        self.take.frame_step = frame_step;
        self
    }

    /// Sets the unit that the file is written in.
    #[must_use]
    pub fn unit(mut self, unit: Unit) -> Self {
        self.take.unit = unit;
        self
    }

    /// Sets the frame rate, in Hz.
    #[must_use]
    pub fn rate_hz(mut self, rate_hz: f64) -> Self {
        self.take.rate_hz = rate_hz;
        self
    }

    /// Forgets what is given of samples that are missing in part.
    #[must_use]
    pub fn without_given(mut self) -> Self {
        self.take.given_mm.clear();
        self
    }

    /// Sets the axis that points up.
    #[must_use]
    pub fn up(mut self, up: Option<Direction>) -> Self {
        self.take.up = up;
        self
    }

    /// Sets a sample, in mm. A position that is not finite, or a cell outside the table, leaves the sample missing.
    /// `origin` says whether it was measured or derived.
    pub fn set(&mut self, frame: usize, marker: usize, position_mm: [f64; 3], origin: Origin) {
        if !position_mm.iter().all(|x| x.is_finite()) || origin == Origin::Missing {
            return;
        }
        if let Some(from) = self.take.origins.get_mut(frame, marker) {
            *from = origin;
            self.positions.set(frame, marker, position_mm);
        }
    }

    /// Sets a sample to multiples of `step_mm`, as [`set`](Self::set) would; cheaper if it is the step of [`multiples_of_mm`](Self::multiples_of_mm).
    #[inline]
    pub fn set_multiples(&mut self, frame: usize, marker: usize, multiples: [f32; 3], step_mm: f64, origin: Origin) {
        if !multiples.iter().all(|x| x.is_finite()) || !step_mm.is_finite() || origin == Origin::Missing {
            return;
        }
        if let Some(from) = self.take.origins.get_mut(frame, marker) {
            *from = origin;
            self.positions.set_multiples(frame, marker, multiples, step_mm);
        }
    }

    /// Says what is given, in mm, of a sample that is missing in part; NaN for the rest. The sample counts as missing.
    pub fn set_partly(&mut self, frame: usize, marker: usize, given_mm: [f64; 3]) {
        self.hide(frame, marker);
        self.take.given_mm.insert((frame, marker), given_mm);
    }

    /// Makes a sample missing again.
    pub fn hide(&mut self, frame: usize, marker: usize) {
        if let Some(from) = self.take.origins.get_mut(frame, marker) {
            *from = Origin::Missing;
        }
    }

    /// The finished take.
    pub fn build(mut self) -> Take {
        for (frame, marker) in self.missing.clone().iter() {
            if self.take.markers.get(marker).is_some_and(|m| m.role == Role::Marker) {
                self.hide(frame, marker);
            }
        }
        self.take.positions = Arc::new(self.positions);
        self.take
    }
}

impl From<Take> for TakeBuilder {
    fn from(mut take: Take) -> Self {
        let mut positions = Arc::unwrap_or_clone(std::mem::replace(&mut take.positions, Arc::new(Positions::new(0, 0))));
        for ((frame, marker), position_mm) in std::mem::take(&mut take.filled_mm) {
            positions.set(frame, marker, position_mm);
        }
        Self { take, positions, missing: Samples::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn take() -> Take {
        let mut b = TakeBuilder::new(vec![Marker::new("A:LKNE"), Marker::new("")], 3, 100.0).first_frame(7);
        b.set(0, 0, [1.0, 2.0, 3.0], Origin::Measured);
        b.set(1, 0, [f64::NAN, 2.0, 3.0], Origin::Measured);
        b.build()
    }

    #[test]
    fn fill_touches_missing_samples_only() {
        let mut t = take();
        assert!(!t.fill(0, 0, [9.0; 3]), "measured");
        assert_eq!(t.position_mm(0, 0), Some([1.0, 2.0, 3.0]));
        assert!(!t.fill(1, 0, [f64::INFINITY, 0.0, 0.0]), "not finite");
        assert!(t.fill(1, 0, [9.0; 3]));
        assert_eq!((t.origin(1, 0), t.position_mm(1, 0)), (Origin::Repaired, Some([9.0; 3])));
        assert!(!t.fill(1, 0, [8.0; 3]), "filled once is filled");
        assert!(!t.fill(3, 0, [8.0; 3]) && !t.fill(0, 2, [8.0; 3]), "outside the table");
    }

    #[test]
    fn a_poorer_copy() {
        let t = take();
        let poorer = t.without(&[(0, 0), (0, 1), (7, 7)].into_iter().collect());
        assert_eq!((poorer.position_mm(0, 0), poorer.origin(0, 0)), (None, Origin::Missing));
        assert_eq!(t.position_mm(0, 0), Some([1.0, 2.0, 3.0]));
    }

    #[test]
    fn what_is_given_of_a_partial_sample_stays() {
        let mut b = TakeBuilder::from(take());
        b.set_partly(2, 0, [f64::NAN, 5.0, f64::NAN]);
        let mut t = b.build();
        assert_eq!(t.origin(2, 0), Origin::Missing);
        assert!(t.fill(2, 0, [9.0; 3]));
        assert_eq!(t.position_mm(2, 0), Some([9.0, 5.0, 9.0]));
    }

    #[test]
    fn samples_stated_missing_are_missing() {
        let stated = [(0, 0), (9, 9)].into_iter().collect();
        let mut t = TakeBuilder::from(take()).missing(&stated).build();
        assert_eq!(t.origin(0, 0), Origin::Missing);
        assert!(t.fill(0, 0, [9.0; 3]));
    }

    #[test]
    fn nothing_that_is_not_finite_gets_in() {
        assert_eq!(take().origin(1, 0), Origin::Missing);
    }

    #[test]
    fn labels_and_frame_numbers() {
        let t = take();
        assert_eq!((t.frame_label(2), t.display_label(0), t.display_label(1)), (9, "A:LKNE".into(), "#2".into()));
        assert_eq!(t.markers[0].name(), "LKNE");
    }

    #[test]
    fn units_and_directions_as_files_write_them() {
        for (text, unit) in [("mm", Unit::Millimetre), (" M\0", Unit::Metre), ("mete", Unit::Metre), ("CM", Unit::Centimetre)] {
            assert_eq!(Unit::parse(text), Some(unit), "{text}");
        }
        assert_eq!(Unit::parse("deg"), None);
        assert_eq!(Direction::parse("-y").map(|d| d.to_string()), Some("-y".into()));
        assert_eq!(Direction::parse("up"), None);
    }
}
