//! Samples that no body makes: spikes, excursions, ghosts beside gaps, and labels that change places.
//!
//! A fill that leans on such a sample is worse than a gap, so they are looked for before anything is filled.
//! Nothing is changed here: what is found is told, and becomes a gap only if the user says so.
//!
//! A sample is suspect if two witnesses contradict it: its own path, and the markers to which it keeps its distance.
//! Both are needed, because either alone is wrong too often: a heel that hits the floor breaks its path, and a swapped partner breaks a distance.
//! Everything that counts as large is so against what the same take usually shows, besides a floor in millimetres.
//!
//! - [`tracks`]: the take marker by marker
//! - [`witness`]: what the partners of a marker say
//! - [`edges`]: where a path breaks
//! - [`pieces`]: which of the pieces between edges and gaps do not belong
//! - [`swaps`]: which of them are somebody else's
//! - [`turn`]: how clouds of points turn
//! - [`told`]: what people and scripts are told

mod edges;
mod pieces;
mod swaps;
#[cfg(test)]
mod tests;
mod told;
mod tracks;
mod turn;
mod witness;

pub use told::{SuspectReport, summary, text};

use crate::solve::Bone;
use edges::Edges;
use formats::{Samples, Take};
use pieces::{Path, Stray, short_frames, some_frames};
use rayon::prelude::*;
use swaps::{Afar, Swap};
use tracks::{Tracks, distance, length, minus, quantile};
use witness::Witness;

/// A take with fewer frames than this is not looked at: it cannot show what is usual.
const LEAST_FRAMES: usize = 12;

/// A take with more markers than this is not looked at: every pair of them would be, and no body has so many.
const MOST_MARKERS: usize = 1500;

/// Suspects blind their partners, so a marker is looked at once more without them, at most so often.
const ROUNDS: usize = 2;

/// Two strays move together if their distance changes by less than this share of what they are off.
const KEPT_SHARE: f64 = 0.2;

/// What is wrong with a stretch of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A few frames off the path and back.
    Spike,
    /// More than a few.
    Excursion,
    /// Off the path from its beginning or to its end, without a way back that was seen.
    Jump,
    /// A few frames off the path beside a gap or an end of the take.
    Ghost,
    /// Two markers that carry each other's label.
    Swap,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Spike, Self::Excursion, Self::Jump, Self::Ghost, Self::Swap];

    /// As a word: `spike`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Spike => "spike",
            Self::Excursion => "excursion",
            Self::Jump => "jump",
            Self::Ghost => "ghost",
            Self::Swap => "swap",
        }
    }
}

/// What becomes of suspects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Treatment {
    /// They are told, and count as measured.
    #[default]
    Told,
    /// They stay as they are, but nothing is filled from them.
    Ignored,
    /// They become gaps.
    Dropped,
}

/// A stretch of samples that no body makes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suspect {
    /// What is wrong.
    pub kind: Kind,
    /// Column of the take.
    pub marker: usize,
    /// First frame, from 0.
    pub start: usize,
    /// One past the last frame. Samples in between may be missing.
    pub end: usize,
    /// The farthest that it is off the path, mm; of a swap, how far the two are apart.
    pub size_mm: f64,
    /// Column of the marker that it changed places with; of swaps only.
    pub with: Option<usize>,
}

impl Suspect {
    /// The samples of it that the take has.
    pub fn samples<'a>(&self, take: &'a Take) -> impl Iterator<Item = (usize, usize)> + use<'a> {
        let marker = self.marker;
        (self.start..self.end.min(take.frames())).filter(move |&f| take.position_mm(f, marker).is_some()).map(move |f| (f, marker))
    }
}

/// All samples of some suspects.
pub fn samples(suspects: &[Suspect], take: &Take) -> Samples {
    suspects.iter().flat_map(|s| s.samples(take)).collect()
}

/// The suspects of a take, by frame and marker. `bones` are those of the take, as [`crate::bones::find`] has them.
pub fn find(take: &Take, bones: &[Bone]) -> Vec<Suspect> {
    if take.frames() < LEAST_FRAMES || !take.rate_hz.is_finite() || take.rate_hz <= 0.0 {
        return Vec::new();
    }
    let tracks = Tracks::new(take);
    if tracks.len() > MOST_MARKERS {
        return Vec::new();
    }
    let witness = Witness::new(&tracks, bones);
    let mut found = Found::default();
    let everyone: Vec<usize> = (0..tracks.len()).collect();
    found.look(&tracks, &witness, &everyone);
    for _ in 1..ROUNDS {
        if found.strays.is_empty() && found.swaps.is_empty() {
            break;
        }
        let mut clean = tracks.clone();
        found.hide(&mut clean);
        let witness = witness.seen_in(&clean);
        // only those can be judged otherwise that have a suspect among themselves and their partners
        let touched: Vec<usize> =
            (0..tracks.len()).filter(|&m| found.names(m) || witness.of(m).iter().any(|p| found.names(p.marker))).collect();
        found.look(&tracks, &witness, &touched);
    }
    found.settle(&tracks, &witness);
    found.suspects(&tracks)
}

/// What was found so far.
#[derive(Default)]
struct Found {
    strays: Vec<Stray>,
    swaps: Vec<Swap>,
    /// The frames in which each marker jumps.
    edges: Vec<Vec<usize>>,
}

impl Found {
    /// Looks at some markers (again).
    fn look(&mut self, tracks: &Tracks, witness: &Witness, markers: &[usize]) {
        let look = |&marker: &usize| {
            let edges = Edges::new(tracks, witness, marker);
            let all = edges.all();
            (Path { tracks, witness, marker }.strays(&all, edges.usual_among_mm()), all.iter().map(|e| e.frame).collect())
        };
        let (strays, edges): (Vec<Vec<Stray>>, Vec<Vec<usize>>) = markers.par_iter().map(look).unzip();
        self.edges.resize(tracks.len(), Vec::new());
        for (&marker, edges) in markers.iter().zip(edges) {
            self.edges[marker] = edges;
        }
        self.strays.retain(|s| !markers.contains(&s.marker));
        self.strays.extend(strays.into_iter().flatten());
        self.strays.sort_by_key(|s| (s.start, s.marker, s.end));
        // first those that are known to the frame
        let mut swaps = swaps::crossings(&self.edges, tracks);
        let others = Afar::new(tracks, witness).swaps().into_iter().chain(swaps::among(&self.strays, tracks, witness));
        for swap in others {
            if !swaps.iter().any(|s| s.overlaps(&swap)) {
                swaps.push(swap);
            }
        }
        self.swaps = swaps;
    }

    /// Gives up strays that their partners share.
    fn settle(&mut self, tracks: &Tracks, witness: &Witness) {
        let together: Vec<bool> = self.strays.iter().map(|s| self.moves_with_another(s, tracks, witness)).collect();
        let mut together = together.into_iter();
        self.strays.retain(|_| together.next() == Some(false));
    }

    /// True if a partner strays at the same time, the same way, and the two keep their distance: then it is the body that moves.
    fn moves_with_another(&self, stray: &Stray, tracks: &Tracks, witness: &Witness) -> bool {
        let swapped = self.swaps.iter().any(|s| s.touches(stray));
        let apart = |other: &Stray, frame: usize| Some(distance(tracks.at(stray.marker, frame)?, tracks.at(other.marker, frame)?));
        let off = |s: &Stray, frame: usize| {
            let expected = Path { tracks, witness, marker: s.marker }.expected(frame, s.left, s.right)?;
            Some(minus(tracks.at(s.marker, frame)?, expected))
        };
        let keeps = |other: &Stray| -> Option<bool> {
            let frames = some_frames(stray.start.max(other.start), stray.end.min(other.end), 9);
            let mut inside: Vec<f64> = frames.iter().filter_map(|&f| apart(other, f)).collect();
            let outside = [stray.left, other.left, stray.right, other.right];
            let mut outside: Vec<f64> = outside.into_iter().flatten().filter_map(|f| apart(other, f)).collect();
            let change = (quantile(&mut inside, 0.5)? - quantile(&mut outside, 0.5)?).abs();
            let middle = frames[frames.len() / 2];
            let (a, b) = (off(stray, middle)?, off(other, middle)?);
            let same_way = (0..3).map(|k| a[k] * b[k]).sum::<f64>() > 0.5 * length(a) * length(b);
            Some(same_way && change < KEPT_SHARE * stray.size_mm.min(other.size_mm))
        };
        let others = self.strays.iter().filter(|other| {
            other.marker != stray.marker
                && other.start < stray.end
                && stray.start < other.end
                && witness.of(stray.marker).iter().any(|p| p.marker == other.marker)
        });
        !swapped && others.into_iter().any(|other| keeps(other) == Some(true))
    }

    fn names(&self, marker: usize) -> bool {
        self.strays.iter().any(|s| s.marker == marker) || self.swaps.iter().any(|s| s.markers.contains(&marker))
    }

    fn hide(&self, tracks: &mut Tracks) {
        for stray in &self.strays {
            (stray.start..stray.end).for_each(|f| tracks.hide(stray.marker, f));
        }
        for swap in &self.swaps {
            for marker in swap.markers {
                (swap.start..swap.end).for_each(|f| tracks.hide(marker, f));
            }
        }
    }

    fn suspects(self, tracks: &Tracks) -> Vec<Suspect> {
        let mut suspects = Vec::new();
        let column = |marker: usize| tracks.columns[marker];
        for swap in &self.swaps {
            for [own, other] in [swap.markers, [swap.markers[1], swap.markers[0]]] {
                let Swap { start, end, size_mm, .. } = *swap;
                suspects.push(Suspect { kind: Kind::Swap, marker: column(own), start, end, size_mm, with: Some(column(other)) });
            }
        }
        for stray in &self.strays {
            if self.swaps.iter().any(|s| s.touches(stray)) {
                continue;
            }
            let short = stray.end - stray.start <= short_frames(tracks);
            let open = stray.left.is_none() || stray.right.is_none();
            let kind = match (short, stray.beside_gap, open) {
                (true, true, _) => Kind::Ghost,
                (true, false, false) => Kind::Spike,
                (false, _, false) => Kind::Excursion,
                (_, _, true) => Kind::Jump,
            };
            let Stray { marker, start, end, size_mm, .. } = *stray;
            suspects.push(Suspect { kind, marker: column(marker), start, end, size_mm, with: None });
        }
        suspects.sort_by_key(|s| (s.start, s.marker, s.end, s.kind));
        suspects
    }
}
