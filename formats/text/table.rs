//! The table that both shapes end in, and what has to be judged by looking at all of it: gaps written as zeros, and the unit of length.

use crate::{Marker, Note, Notes, Origin, Role, Take, TakeBuilder, Unit};
use std::collections::BTreeSet;

/// A take whose markers spread over less than this is taken as metres, if nobody says the unit.
/// A hand spreads over 100 mm, a stadium over 200 m.
const LARGEST_EXTENT_IN_METRES: f64 = 20.0;
/// How far from the origin a marker is, in extents of the take, when it is far from there.
const FAR: f64 = 0.05;
/// How far from the origin the middle of the take is, in extents of the take, when the origin is no place among the markers.
const OFF_CENTRE: f64 = 0.3;
/// A median is taken over this many samples at most.
const SAMPLES_FOR_A_MEDIAN: usize = 100_000;

/// A cell that is to be written if its sample is filled. Only these keep their place in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Blank {
    /// Where the text to be replaced begins.
    pub start: u64,
    /// How long it is; 0 in an empty cell.
    pub len: u32,
    /// Frame of the take.
    pub frame: u32,
    /// Marker of the take.
    pub marker: u32,
    /// 0, 1, 2.
    pub axis: u8,
    /// True if the cell stands in quotes.
    pub quoted: bool,
    /// True if the cell holds a zero, which may or may not stand for a gap.
    pub zero: bool,
    /// True if the cell holds a number, which is replaced only if its sample is stated missing.
    pub given: bool,
}

/// Everything that the rows said, in the unit of the file.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    /// The columns.
    pub markers: Vec<Marker>,
    /// Frames × markers, frame by frame; NaN where any coordinate is missing.
    pub samples: Vec<[f64; 3]>,
    /// The cells that may be filled, in the order of the file.
    pub blanks: Vec<Blank>,
    /// Samples that have some coordinates only: index into [`Table::samples`], and what is given, NaN for the rest.
    pub partial: Vec<(usize, [f64; 3])>,
    /// The file's own number of the first frame.
    pub first_frame: i64,
}

impl Table {
    /// Closes the row of samples that begins at `from`: samples with some coordinates only become missing, zeros that do not come in threes are positions.
    /// `blanks_from` is where the row's cells begin in [`Table::blanks`].
    pub fn close_row(&mut self, from: usize, blanks_from: usize) {
        let Some(row_blanks) = self.blanks.get(blanks_from..) else { return };
        if row_blanks.is_empty() {
            return;
        }
        if row_blanks.iter().any(|b| b.zero) {
            let row = self.samples.get(from..).unwrap_or_default();
            let tail = self.blanks.split_off(blanks_from);
            let is_gap = |b: &Blank| !b.zero || row.get(b.marker as usize).is_some_and(|s| *s == [0.0; 3]);
            self.blanks.extend(tail.into_iter().filter(is_gap));
        }
        // cells of model outputs are not among the blanks
        let fillable: BTreeSet<u32> = self.blanks.get(blanks_from..).unwrap_or_default().iter().map(|b| b.marker).collect();
        for (marker, sample) in self.samples.get_mut(from..).unwrap_or_default().iter_mut().enumerate() {
            let given = sample.iter().filter(|v| !v.is_nan()).count();
            if (1..3).contains(&given) {
                if fillable.contains(&(marker as u32)) {
                    self.partial.push((from.saturating_add(marker), *sample));
                }
                *sample = [f64::NAN; 3];
            }
        }
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.samples.len().checked_div(self.markers.len()).unwrap_or(0)
    }

    /// Judges zeros and unit, and hands over the take with the cells that may be filled.
    /// `unit` is what somebody stated: the user, or else the file.
    pub fn finish(mut self, unit: Option<Unit>, rate_hz: f64, frame_step: i64, notes: &Notes) -> (Take, Vec<Blank>) {
        self.judge_zeros(notes);
        let unit = unit.unwrap_or_else(|| {
            let metres = self.extent().is_some_and(|extent| extent < LARGEST_EXTENT_IN_METRES);
            let unit = if metres { Unit::Metre } else { Unit::Millimetre };
            notes.add(Note::UnitAssumed { unit });
            unit
        });
        if !self.partial.is_empty() {
            notes.add(Note::PartialSamples { samples: self.partial.len() });
        }
        let outputs = self.markers.iter().filter(|m| m.role == Role::ModelOutput).count();
        if outputs > 0 {
            notes.add(Note::ModelOutputs { columns: outputs });
        }
        let frames = self.frames();
        let columns = self.markers.len().max(1);
        let scale: Vec<f64> = self.markers.iter().map(|m| if m.role == Role::Marker { unit.mm() } else { 1.0 }).collect();
        let mut builder = TakeBuilder::new(self.markers, frames, rate_hz).first_frame(self.first_frame).frame_step(frame_step).unit(unit);
        for (frame, row) in self.samples.chunks_exact(columns).enumerate() {
            for (marker, (sample, scale)) in row.iter().zip(&scale).enumerate() {
                builder.set(frame, marker, sample.map(|v| v * scale), Origin::Measured);
            }
        }
        for (index, given) in self.partial {
            let scale = scale.get(index % columns).copied().unwrap_or(1.0);
            builder.set_partly(index / columns, index % columns, given.map(|v| v * scale));
        }
        (builder.build(), self.blanks)
    }

    /// Decides whether samples at exactly 0 0 0 are gaps. They are all gaps or all positions, because one program wrote them.
    ///
    /// A run of zeros *jumps* if the marker's samples just before and behind it are far from the origin.
    /// Where nine runs in ten jump, zeros are gaps.
    /// A marker that is at zero from first to last gives no such evidence: it is the origin of the coordinates, or was never seen.
    /// Then zeros are gaps if the middle of the take lies away from the origin.
    fn judge_zeros(&mut self, notes: &Notes) {
        let zeros = self.blanks.iter().filter(|b| b.zero).count() / 3;
        if zeros == 0 {
            return;
        }
        let size = self.extent().unwrap_or(0.0);
        let (runs, jumps) = self.zero_runs(FAR * size);
        let gaps = if runs > 0 { jumps * 10 >= runs * 9 } else { self.median_from_origin().is_some_and(|d| d > OFF_CENTRE * size) };
        if gaps {
            self.take_zeros_as_gaps(notes);
        } else {
            self.blanks.retain(|b| !b.zero);
        }
    }

    /// Makes all samples at exactly 0 0 0 gaps, for formats that say so.
    pub fn take_zeros_as_gaps(&mut self, notes: &Notes) {
        let columns = self.markers.len().max(1);
        let mut samples = 0;
        for (i, sample) in self.samples.iter_mut().enumerate() {
            let marker = self.markers.get(i % columns);
            if *sample == [0.0; 3] && marker.is_some_and(|m| m.role == Role::Marker) {
                *sample = [f64::NAN; 3];
                samples += 1;
            }
        }
        for blank in &mut self.blanks {
            blank.zero = false; // they are gaps, and nobody has to judge them any more
        }
        if samples > 0 {
            notes.add(Note::ZeroReadAsMissing { samples });
        }
    }

    /// How many runs of zeros have a known neighbour, and how many of these have neighbours beyond `far` only.
    fn zero_runs(&self, far: f64) -> (usize, usize) {
        let columns = self.markers.len();
        let (mut runs, mut jumps) = (0, 0);
        for (marker, _) in self.markers.iter().enumerate().filter(|(_, m)| m.role == Role::Marker) {
            let mut before = [f64::NAN; 3];
            let mut in_run = false;
            let mut borders: Vec<f64> = Vec::new();
            let track = self.samples.iter().skip(marker).step_by(columns.max(1));
            // one more, missing sample closes a run at the end
            for &sample in track.chain([&[f64::NAN; 3]]) {
                let zero = sample == [0.0; 3];
                if zero && !in_run {
                    borders.push(norm(before));
                } else if !zero && in_run {
                    borders.push(norm(sample));
                    borders.retain(|d| !d.is_nan());
                    runs += usize::from(!borders.is_empty());
                    jumps += usize::from(!borders.is_empty() && borders.iter().all(|d| *d > far));
                    borders.clear();
                }
                in_run = zero;
                before = sample;
            }
        }
        (runs, jumps)
    }

    /// The diagonal of the box around the markers of a frame: its median over the frames that show at least two markers.
    /// If no frame does, the median distance of a sample from the origin; `None` if nothing is there at all.
    fn extent(&self) -> Option<f64> {
        let mut diagonals: Vec<f64> = Vec::new();
        let stride = (self.frames() / SAMPLES_FOR_A_MEDIAN).max(1);
        for row in self.samples.chunks_exact(self.markers.len().max(1)).step_by(stride) {
            let (mut low, mut high, mut seen) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], 0);
            for (sample, _) in row.iter().zip(&self.markers).filter(|(s, m)| is_position(s) && m.role == Role::Marker) {
                seen += 1;
                for ((low, high), value) in low.iter_mut().zip(&mut high).zip(sample) {
                    *low = low.min(*value);
                    *high = high.max(*value);
                }
            }
            if seen > 1 {
                diagonals.push(norm([high[0] - low[0], high[1] - low[1], high[2] - low[2]]));
            }
        }
        median(diagonals).or_else(|| self.median_distance())
    }

    fn median_distance(&self) -> Option<f64> {
        median(self.some_positions().map(|s| norm(*s)).collect())
    }

    /// How far the median position of all samples is from the origin.
    fn median_from_origin(&self) -> Option<f64> {
        let axis = |a: usize| median(self.some_positions().filter_map(|s| s.get(a).copied()).collect());
        Some(norm([axis(0)?, axis(1)?, axis(2)?]))
    }

    fn some_positions(&self) -> impl Iterator<Item = &[f64; 3]> {
        let columns = self.markers.len().max(1);
        let stride = (self.samples.len() / SAMPLES_FOR_A_MEDIAN).max(1);
        // a stride that shares no factor with the number of markers meets them all
        let stride = (stride..=stride + columns).find(|s| gcd(*s as u64, columns as u64) == 1).unwrap_or(1);
        let marker = move |i: usize| self.markers.get(i % columns).is_some_and(|m| m.role == Role::Marker);
        self.samples.iter().enumerate().step_by(stride).filter(move |(i, s)| is_position(s) && marker(*i)).map(|(_, s)| s)
    }
}

/// True for a sample that is neither missing nor a zero in doubt.
fn is_position(sample: &[f64; 3]) -> bool {
    !sample.iter().any(|v| v.is_nan()) && *sample != [0.0; 3]
}

fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    values.sort_by(f64::total_cmp);
    values.get(middle).copied()
}

/// Greatest common divisor.
pub(crate) fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}
