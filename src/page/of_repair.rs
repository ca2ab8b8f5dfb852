//! The page of a repair that is still in memory.

use super::positions::{Positions, State, Track, rounded, rounded_sigma};
use super::{Curves, Page, told};
use crate::log::{About, Description, Shown, columns, metres};
use formats::{Origin, Take};

impl Page {
    /// The page of a repair: what was known beforehand, the take before and after, the report as the log has it, and what was watched.
    ///
    /// # Errors
    /// The report cannot be read back, in words.
    pub fn of_repair(about: &About, shown: Shown<'_>, report: &str, curves: &Curves) -> Result<Self, String> {
        let mut page = Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            source_name: about.source_name.clone(),
            source_sha256: about.source_sha256.clone(),
            method: about.method.clone(),
            seed: about.seed.to_string(),
            options: about.options.iter().cloned().collect(),
            take: Description::new(about, &shown),
            curves: curves.curves.clone(),
            curve_bones: curves.bones.clone(),
            positions: positions(&shown),
            ..Self::default()
        };
        page.tell(told::parse(report)?)?;
        Ok(page)
    }
}

/// All frames of the take, and what it held before where that is something else.
fn positions(shown: &Shown<'_>) -> Positions {
    let (before, take) = (shown.raw, shown.repaired.unwrap_or(shown.raw));
    let columns = columns(take);
    let place = |take: &Take, frame, column| take.position_mm(frame, column).map(|p| rounded(metres(p)));
    let mut positions = Positions { frames: (0..take.frames() as u32).collect(), ..Positions::default() };
    for (marker, &column) in columns.iter().enumerate() {
        let mut track = Track::default();
        for frame in 0..take.frames() {
            track.states.push(match take.origin(frame, column) {
                Origin::Missing => State::Missing,
                Origin::Repaired => State::Filled,
                Origin::Measured | Origin::Derived => State::Observed,
            });
            let (at, raw) = (place(take, frame, column), place(before, frame, column));
            track.at.push(at.unwrap_or_default());
            if let Some(raw) = raw.filter(|_| raw != at) {
                positions.raw.push((marker as u32, frame as u32, raw));
            }
        }
        positions.tracks.push(track);
    }
    let mut samples: Vec<_> = shown.samples.iter().filter(|s| take.origin(s.frame, s.marker) == Origin::Repaired).collect();
    samples.sort_by_key(|s| (s.marker, s.frame));
    for sample in samples {
        if let Some(track) = columns.binary_search(&sample.marker).ok().and_then(|m| positions.tracks.get_mut(m)) {
            track.sigma.push(rounded_sigma(sample.sigma_mm));
        }
    }
    positions
}
