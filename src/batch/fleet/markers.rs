//! What is missing of each marker, over all takes and by folder: which camera set-up loses which marker.
//!
//! Markers count under their names without a subject's prefix; those that nobody named count as one.

use super::takes::{STEP_MM, Texts, known, steps};
use crate::batch::sidecar::{MarkerSummary, Sidecar};
use crate::page::pack::{Packer, push};
use serde::Serialize;
use std::collections::BTreeMap;

/// Names that are told apart. Takes of unlabelled trajectories have thousands, and nobody reads them.
const MOST_NAMES: usize = 2000;

/// Folders that are told apart.
const MOST_FOLDERS: usize = 2000;

/// What markers without a name are called.
const UNLABELLED: &str = "unlabelled";

/// What is called by none of the names that are told apart.
const FURTHER: &str = "all others";

/// One marker, somewhere.
#[derive(Clone, Debug, Default, PartialEq)]
struct Cell {
    takes: u64,
    samples: u64,
    missing: u64,
    missing_secs: f64,
    gaps: u64,
    filled: u64,
    longest_ms: u64,
    sigma: Option<u64>,
}

impl Cell {
    fn add(&mut self, marker: &MarkerSummary, frames: u64, rate_hz: f64) {
        self.samples += frames;
        self.missing += marker.missing;
        self.gaps += marker.gaps as u64;
        self.filled += marker.filled;
        self.sigma = self.sigma.max(marker.worst_sigma_mm.map(|mm| steps(mm, STEP_MM)));
        if rate_hz > 0.0 {
            self.missing_secs += marker.missing as f64 / rate_hz;
            self.longest_ms = self.longest_ms.max(steps(marker.longest as f64 / rate_hz, 1e-3));
        }
    }

    fn pack(&self, bytes: &mut Vec<u8>) {
        for number in [
            self.takes as i64,
            self.samples as i64,
            self.missing as i64,
            steps(self.missing_secs, 1e-3) as i64,
            self.gaps as i64,
            self.filled as i64,
            self.longest_ms as i64,
            known(self.sigma),
        ] {
            push(bytes, number);
        }
    }
}

/// One marker over all takes.
#[derive(Clone, Debug, Default)]
struct Marker {
    all: Cell,
    /// How often the longest gap of a take was so long, in ms to three digits; takes without a gap do not count.
    longest: BTreeMap<u32, u32>,
    /// The take that lacks most of it: the share, and which.
    worst: Option<(f64, u64)>,
}

impl Marker {
    fn median_ms(&self) -> Option<u32> {
        let count: u32 = self.longest.values().sum();
        let mut before = 0;
        self.longest
            .iter()
            .find(|(_, times)| {
                before += **times;
                2 * before >= count
            })
            .map(|(ms, _)| *ms)
    }
}

/// All markers.
#[derive(Debug, Default)]
pub(super) struct Markers {
    names: Texts,
    each: Vec<Marker>,
    folders: Texts,
    /// By folder and name.
    cells: BTreeMap<(u32, u32), Cell>,
}

/// What the page has of them besides numbers.
#[derive(Serialize)]
pub(super) struct MarkersModel {
    names: Vec<String>,
    folders: Vec<String>,
}

impl Markers {
    /// Takes in a take, which is the `row`th.
    pub(super) fn add(&mut self, folder: &str, sidecar: &Sidecar, row: u64) {
        let (frames, rate_hz) = (sidecar.summary.frames as u64, sidecar.summary.rate_hz);
        let folder = limited(&mut self.folders, folder, MOST_FOLDERS);
        // a name may be there twice, for two subjects
        let mut here: BTreeMap<u32, Cell> = BTreeMap::new();
        for marker in &sidecar.markers {
            let name = limited(&mut self.names, name_of(&marker.label), MOST_NAMES);
            here.entry(name).or_default().add(marker, frames, rate_hz);
        }
        self.each.resize_with(self.names.len(), Marker::default);
        for (name, cell) in here {
            for whole in [&mut self.each[name as usize].all, self.cells.entry((folder, name)).or_default()] {
                whole.takes += 1;
                whole.samples += cell.samples;
                whole.missing += cell.missing;
                whole.missing_secs += cell.missing_secs;
                whole.gaps += cell.gaps;
                whole.filled += cell.filled;
                whole.longest_ms = whole.longest_ms.max(cell.longest_ms);
                whole.sigma = whole.sigma.max(cell.sigma);
            }
            let marker = &mut self.each[name as usize];
            if cell.gaps > 0 {
                *marker.longest.entry(three_digits(cell.longest_ms)).or_default() += 1;
            }
            let share = if cell.samples > 0 { cell.missing as f64 / cell.samples as f64 } else { 0.0 };
            if share > marker.worst.map_or(0.0, |(worst, _)| worst) {
                marker.worst = Some((share, row));
            }
        }
    }

    /// Adds the numbers to those of the page, and gives the names.
    pub(super) fn pack(self, packer: &mut Packer) -> MarkersModel {
        let mut all = Vec::new();
        for marker in &self.each {
            marker.all.pack(&mut all);
            push(&mut all, known(marker.median_ms()));
            push(&mut all, known(marker.worst.map(|(_, row)| row)));
        }
        packer.add_bytes("all_of_marker", &all);
        let mut cells = Vec::new();
        for ((folder, name), cell) in &self.cells {
            push(&mut cells, i64::from(*folder));
            push(&mut cells, i64::from(*name));
            cell.pack(&mut cells);
        }
        packer.add_bytes("cells", &cells);
        MarkersModel { names: self.names.into_list(), folders: self.folders.into_list() }
    }
}

/// Its number among `texts`, or that of [`FURTHER`] if there are so many already.
fn limited(texts: &mut Texts, text: &str, most: usize) -> u32 {
    match texts.get(text) {
        Some(index) => index,
        None if texts.len() + 1 < most => texts.index(text),
        None => texts.index(FURTHER),
    }
}

/// A label without a subject's prefix, as [`formats::Marker::name`] has it; labels that only count, such as `*12` and `#3`, are none.
fn name_of(label: &str) -> &str {
    let name = label.rsplit_once(':').map_or(label, |(_, name)| name);
    let counts = |rest: &str| rest.bytes().all(|b| b.is_ascii_digit());
    if name.is_empty() || name.strip_prefix(['*', '#']).is_some_and(counts) { UNLABELLED } else { name }
}

/// Rounded, so that there are not too many different ones.
fn three_digits(ms: u64) -> u32 {
    let ms = u32::try_from(ms).unwrap_or(u32::MAX);
    let mut step = 1;
    while ms / step >= 1000 {
        step *= 10;
    }
    ms / step * step
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::sidecar::Summary;

    fn take(markers: &[(&str, u64, usize, usize)]) -> Sidecar {
        let markers = markers.iter().map(|&(label, missing, gaps, longest)| MarkerSummary {
            label: label.to_owned(),
            missing,
            gaps,
            longest,
            filled: missing,
            worst_sigma_mm: (missing > 0).then_some(missing as f64 / 10.0),
        });
        Sidecar {
            markers: markers.collect(),
            summary: Summary { rate_hz: 100.0, frames: 1000, ..Summary::default() },
            ..super::super::tests::sidecar()
        }
    }

    #[test]
    fn prefixes_do_not_count() {
        for (label, name) in [
            ("LKNE", "LKNE"),
            ("Subj:LKNE", "LKNE"),
            ("a:b:LKNE", "LKNE"),
            ("*12", UNLABELLED),
            ("S:*1", UNLABELLED),
            ("#3", UNLABELLED),
            ("S:", UNLABELLED),
            ("*A", "*A"),
            ("C7", "C7"),
        ] {
            assert_eq!(name_of(label), name, "{label}");
        }
    }

    #[test]
    fn markers_are_added_up_by_name_and_by_folder() {
        let mut markers = Markers::default();
        markers.add("A", &take(&[("X:LKNE", 100, 2, 60), ("Y:LKNE", 0, 0, 0), ("X:RKNE", 10, 1, 10)]), 0);
        markers.add("B", &take(&[("LKNE", 500, 1, 500), ("RKNE", 0, 0, 0)]), 1);
        markers.add("B", &take(&[("LKNE", 20, 1, 20)]), 2);
        let name = |name: &str| markers.names.get(name).unwrap_or(99) as usize;
        let knee = &markers.each[name("LKNE")];
        let expected =
            Cell { takes: 3, samples: 4000, missing: 620, missing_secs: 6.2, gaps: 4, filled: 620, longest_ms: 5000, sigma: Some(5000) };
        assert_eq!(knee.all, expected);
        assert_eq!((knee.median_ms(), knee.worst), (Some(600), Some((0.5, 1))));
        let cell = &markers.cells[&(1, name("LKNE") as u32)];
        assert_eq!((cell.takes, cell.samples, cell.missing), (2, 2000, 520));
        assert_eq!(markers.cells[&(0, name("LKNE") as u32)].samples, 2000);
        assert_eq!(markers.each[name("RKNE")].median_ms(), Some(100));
    }

    #[test]
    fn names_without_end_end() {
        let mut markers = Markers::default();
        for at in 0..3000 {
            markers.add(&format!("f{at}"), &take(&[(&format!("m{at}"), 1, 1, 1)]), at);
        }
        assert_eq!((markers.names.len(), markers.folders.len()), (MOST_NAMES, MOST_FOLDERS));
        assert_eq!(markers.each.iter().map(|marker| marker.all.takes).sum::<u64>(), 3000);
        assert!(markers.names.get(FURTHER).is_some());
        assert_eq!(
            (three_digits(999), three_digits(1234), three_digits(98_765), three_digits(u64::MAX)),
            (999, 1230, 98_700, 4_290_000_000)
        );
    }
}
