//! C3D: the binary format of <https://www.c3d.org>, read and patched; and written anew as Intel floats.
//!
//! `docs/formats/c3d.md` says what is read, written and assumed, and what real files do.
//! [`Document::save`] copies the file and replaces the bytes of filled samples, so everything that this code does not understand (analog
//! samples, events, force platforms, groups of other programs, trailing bytes) stays as it was by construction.

mod beyond;
mod create;
mod floats;
mod layout;
mod parameters;
mod points;
mod processor;
#[cfg(test)]
mod tests;

use crate::{
    Direction, Document, Format, FormatError, FormatInfo, Marker, Match, Note, Notes, Origin, Role, Stated, Take, TakeBuilder, Unit,
};
use layout::{Layout, Storage};
use parameters::Parameters;
use processor::Processor;
use std::collections::BTreeSet;
use std::io::Write;

/// The name in errors.
const NAME: &str = "c3d";

/// Taken where the file has no rate.
const ASSUMED_RATE_HZ: f64 = 100.0;

/// The lists of POINT that name model outputs (angles, forces, ...) among the points.
/// MODELED_MARKERS are positions in space, and stay markers.
const OUTPUT_LISTS: [&str; 6] = ["ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS"];

static INFO: FormatInfo = FormatInfo {
    name: NAME,
    summary: "C3D (c3d.org), points of Intel, DEC and MIPS files, floats and integers",
    extensions: &["c3d"],
    holds_gaps: true,
};

/// The C3D format.
#[derive(Debug)]
pub struct C3d;

impl Format for C3d {
    fn info(&self) -> &'static FormatInfo {
        &INFO
    }

    fn sniff(&self, head: &[u8]) -> Match {
        let (Some(&block), Some(&0x50)) = (head.first(), head.get(1)) else { return Match::No };
        // Text whose second letter is a P.
        if head.iter().take(512).all(|&b| matches!(b, b'\t' | b'\n' | b'\r' | 0x20..0x7f)) {
            return Match::No;
        }
        match head.get(usize::from(block).saturating_sub(1) * 512 + 3).copied().and_then(Processor::from_byte) {
            Some(_) if block >= 2 => Match::Certain,
            _ => Match::Maybe,
        }
    }

    fn open(&self, bytes: Vec<u8>, stated: &Stated, notes: &Notes) -> Result<Box<dyn Document>, FormatError> {
        let parameters = Parameters::read(&bytes, notes)?;
        let layout = layout::choose(&parameters, &bytes, notes)?;
        let markers = markers(&parameters, layout.points, notes);
        let roles: Vec<Role> = markers.iter().map(|m| m.role).collect();
        let unit = stated.unit.unwrap_or_else(|| unit(&parameters, &roles, notes));
        let rate_hz = stated.rate_hz.unwrap_or_else(|| rate_hz(&parameters, notes));
        let up = parameters.texts("POINT", "Y_SCREEN").and_then(|t| Direction::parse(t.first()?));
        let step_mm = layout.step_mm(unit.mm());
        let builder = TakeBuilder::new(markers, layout.frames, rate_hz)
            .first_frame(layout.first_frame)
            .unit(unit)
            .up(up)
            .missing(&stated.missing)
            .multiples_of_mm(step_mm);
        let (take, largest_mm) = points::read(&layout, &bytes, builder, &roles, (step_mm, unit.mm()), notes);
        let beyond = beyond::parameters(&parameters);
        Ok(Box::new(C3dDocument { bytes, layout, take, largest_mm, beyond }))
    }

    fn create(&self, take: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
        create::create(take, out, notes)
    }
}

/// The columns, with what POINT:LABELS and the lists of model outputs say about them.
fn markers(p: &Parameters<'_>, points: usize, notes: &Notes) -> Vec<Marker> {
    let mut labels = p.continued_texts("POINT", "LABELS");
    if labels.len() != points {
        notes.add(Note::LabelCount { labels: labels.len(), columns: points });
    }
    labels.resize(points, String::new());
    let outputs: BTreeSet<String> =
        OUTPUT_LISTS.iter().flat_map(|list| p.continued_texts("POINT", list)).filter(|name| !name.is_empty()).collect();
    notes.duplicate_labels(labels.iter().map(String::as_str));
    let markers: Vec<Marker> = labels
        .into_iter()
        .map(|label| {
            let marker = Marker::new(label);
            // The lists name outputs with or without the subject's prefix.
            let output = outputs.contains(&marker.label) || outputs.contains(marker.name());
            Marker { role: if output { Role::ModelOutput } else { Role::Marker }, ..marker }
        })
        .collect();
    let columns = markers.iter().filter(|m| m.role == Role::ModelOutput).count();
    if columns > 0 {
        notes.add(Note::ModelOutputs { columns });
    }
    markers
}

/// The unit of length, millimetres unless the file says something else.
fn unit(p: &Parameters<'_>, roles: &[Role], notes: &Notes) -> Unit {
    let written = p.texts("POINT", "UNITS").unwrap_or_default().into_iter().find(|t| !t.trim().is_empty());
    let assumed = Unit::Millimetre;
    match written.as_deref().map(|text| (text, Unit::parse(text))) {
        Some((_, Some(unit))) => return unit,
        _ if !roles.contains(&Role::Marker) => {}
        Some((written, None)) => notes.add(Note::UnitUnknown { written: written.to_owned(), unit: assumed }),
        None => notes.add(Note::UnitAssumed { unit: assumed }),
    }
    assumed
}

/// Frames per second: the parameter, else the header, else a guess.
fn rate_hz(p: &Parameters<'_>, notes: &Notes) -> f64 {
    let good = |x: &f64| crate::is_a_rate(*x);
    let parameter = p.number("POINT", "RATE").filter(good);
    let header = Some(f64::from(p.header.rate)).filter(good);
    match (parameter, header) {
        (Some(parameter), Some(header)) => {
            if (parameter - header).abs() > 1e-6 * parameter {
                let text = format!("POINT:RATE is {parameter} Hz, the header says {header} Hz; took {parameter} Hz");
                notes.add(Note::Contradiction { text });
            }
            parameter
        }
        (Some(rate), None) | (None, Some(rate)) => rate,
        (None, None) => {
            notes.add(Note::RateAssumed { rate_hz: ASSUMED_RATE_HZ });
            ASSUMED_RATE_HZ
        }
    }
}

/// An opened C3D: its bytes, and where the samples lie in them.
#[derive(Debug)]
struct C3dDocument {
    bytes: Vec<u8>,
    layout: Layout,
    take: Take,
    largest_mm: f64,
    /// What the parameters tell of that is not in the take.
    beyond: Vec<String>,
}

impl Document for C3dDocument {
    fn take(&self) -> &Take {
        &self.take
    }

    fn save(&self, repaired: &Take, out: &mut dyn Write, notes: &Notes) -> Result<(), FormatError> {
        if repaired.frames() != self.take.frames() || repaired.markers.len() != self.take.markers.len() {
            return Err(FormatError::unsupported(
                NAME,
                crate::Place::Whole,
                "the repaired take has another size than the file it goes into",
            ));
        }
        let mm = self.take.unit.mm();
        let mut patches = Vec::new();
        for frame in 0..repaired.frames() {
            for marker in 0..repaired.markers.len() {
                // What the file holds is never overwritten, whatever the take says.
                if repaired.origin(frame, marker) != Origin::Repaired || self.take.origin(frame, marker) != Origin::Missing {
                    continue;
                }
                let Some(position_mm) = repaired.position_mm(frame, marker) else { continue };
                let place = || format!("{} in frame {}", repaired.display_label(marker), repaired.frame_label(frame));
                patches.push(points::patch(&self.layout, frame, marker, position_mm, mm, place)?);
            }
        }
        if self.layout.storage == Storage::Integer && !patches.is_empty() {
            notes.add(Note::Rounded { step_mm: self.layout.scale * mm });
        }
        // All patches are known and possible before the first byte is written. They come in the order of the file.
        let mut out = std::io::BufWriter::new(out);
        let mut written = 0;
        for patch in &patches {
            let before = self.bytes.get(written..patch.offset).unwrap_or(&[]);
            out.write_all(before).and_then(|()| out.write_all(patch.bytes())).map_err(|e| FormatError::io(NAME, e))?;
            written = patch.offset + patch.bytes().len();
        }
        out.write_all(self.bytes.get(written..).unwrap_or(&[])).and_then(|()| out.flush()).map_err(|e| FormatError::io(NAME, e))
    }

    fn beyond_take(&self) -> Vec<String> {
        let residuals = beyond::has_residuals(&self.layout, &self.bytes).then(|| "residuals and cameras of the samples".to_owned());
        self.beyond.iter().cloned().chain(residuals).collect()
    }

    fn as_floats(&self) -> Result<Option<Vec<u8>>, FormatError> {
        floats::convert(&self.layout, &self.bytes)
    }

    fn rounding_mm(&self) -> f64 {
        let mm = self.take.unit.mm();
        match self.layout.storage {
            // Half a step, or a whole one for a position that would have become the origin.
            Storage::Integer => self.layout.scale * mm * (1.0 + 1e-9),
            // Half a unit in the last place of a number up to eight times the largest in the file, and at least 80 m.
            Storage::Float => self.largest_mm.max(10_000.0) * 4.0 * f64::from(f32::EPSILON) + f64::from(points::NOT_THE_ORIGIN) * mm,
        }
    }
}
