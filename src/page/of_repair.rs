//! The page of a repair that is still in memory.

use super::positions::{Positions, Sample, State, metres, rounded, rounded_sigma};
use super::{Bone, Curves, Page, Take, told};
use crate::fills::Filled;
use crate::repair::{Request, neighbours};
use crate::report::Report;
use crate::solve;
use formats::Origin;

/// What a repair knows when its output is written.
pub struct Repaired<'a> {
    /// What was wanted.
    pub request: &'a Request,
    /// SHA-256 of the file that was read.
    pub sha256: &'a str,
    /// The take as the file gave it.
    pub before: &'a formats::Take,
    /// The take as it was written.
    pub after: &'a formats::Take,
    /// Bones between columns of the take.
    pub bones: &'a [solve::Bone],
    /// What was told; it holds the filled samples.
    pub report: &'a Report,
    /// What was watched.
    pub curves: &'a Curves,
}

impl Page {
    /// The page of a repair.
    ///
    /// # Errors
    /// The report's own words cannot be read back, in words.
    pub fn of_repair(repaired: &Repaired<'_>) -> Result<Self, String> {
        let Repaired { request, after: take, report, curves, .. } = repaired;
        let shown = neighbours(take);
        let columns: Vec<usize> = (0..take.markers.len()).filter(|&m| shown[m]).collect();
        let index = |column: usize| columns.binary_search(&column).ok().map(|m| m as u32);
        let bones = repaired.bones.iter().filter_map(|bone| {
            Some(Bone { a: index(bone.a)?, b: index(bone.b)?, length_mm: bone.length_mm, spread_mm: bone.spread_mm })
        });
        let mut page = Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            source_name: request.input.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            source_sha256: repaired.sha256.to_owned(),
            method: request.method.name().to_owned(),
            seed: request.seed.to_string(),
            options: request.options().into_iter().collect(),
            take: Take {
                rate_hz: take.rate_hz,
                frames: take.frames() as u32,
                first_frame: take.first_frame,
                frame_step: take.frame_step,
                unit: take.unit.symbol().to_owned(),
                up: take.up.map(|up| up.to_string()),
                markers: columns.iter().map(|&m| take.display_label(m)).collect(),
                bones: bones.collect(),
            },
            curves: curves.curves.clone(),
            curve_bones: curves.bones.clone(),
            positions: positions(repaired.before, take, &columns, &report.samples),
            ..Self::default()
        };
        page.tell(told::parse(&report.json())?);
        Ok(page)
    }
}

/// All frames of the take, and what it held before where that is something else.
fn positions(before: &formats::Take, take: &formats::Take, columns: &[usize], filled: &[Filled]) -> Positions {
    let mut positions = Positions { frames: (0..take.frames() as u32).collect(), ..Positions::default() };
    for (marker, &column) in columns.iter().enumerate() {
        let mut track = Vec::with_capacity(take.frames());
        for frame in 0..take.frames() {
            let at = take.position_mm(frame, column).map(|p| rounded(metres(p)));
            let state = match (at, take.origin(frame, column)) {
                (None, _) => State::Missing,
                (_, Origin::Repaired) => State::Filled,
                _ => State::Observed,
            };
            let raw = before.position_mm(frame, column).map(|p| rounded(metres(p)));
            if let Some(raw) = raw.filter(|_| raw != at) {
                positions.raw.push((marker as u32, frame as u32, raw));
            }
            track.push(Sample { state, at: at.unwrap_or_default(), sigma: None });
        }
        positions.tracks.push(track);
    }
    for sample in filled {
        let track = columns.binary_search(&sample.marker).ok().and_then(|m| positions.tracks.get_mut(m));
        if let Some(known) = track.and_then(|t| t.get_mut(sample.frame)).filter(|s| s.state == State::Filled) {
            known.sigma = rounded_sigma(sample.sigma_mm as f32);
        }
    }
    positions
}
