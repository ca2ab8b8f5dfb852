//! Gaps as they really come: those of other takes, laid over takes of which everything is known.

use super::Case;
use formats::Take;
use mocap_repair::input::{Reading, open};
use mocap_repair::repair::neighbours;
use mocap_repair::runs::runs;
use std::collections::BTreeMap;
use std::path::Path;

/// The kind of these cases.
pub const KIND: &str = "real";

/// A take lends its gaps if it has so many markers and frames, and so much of it is missing.
const LEAST_MARKERS: usize = 12;
const LEAST_FRAMES: usize = 100;
const LEAST_MISSING: f64 = 0.01;

/// A marker that is seen less than this is no marker of a body, in the take that lends.
const LEAST_SEEN: f64 = 0.1;

/// Cases for each take that lends.
const TRIALS: usize = 2;

/// What is missing in a take: for each marker, sorted by height, in which frames.
struct Mask {
    missing: Vec<Vec<bool>>,
}

impl Mask {
    /// `None` if the take has nothing to lend.
    fn new(take: &Take) -> Option<Self> {
        let frames = take.frames();
        let everybody = neighbours(take);
        let of = |marker: usize| (0..frames).map(|t| take.position_mm(t, marker).is_none()).collect::<Vec<bool>>();
        let missing: Vec<(usize, Vec<bool>)> = (0..take.markers.len())
            .filter(|&marker| everybody[marker])
            .map(|marker| (marker, of(marker)))
            .filter(|(_, own)| own.iter().filter(|m| !**m).count() as f64 > LEAST_SEEN * frames as f64)
            .collect();
        let all: usize = missing.iter().map(|(_, own)| own.iter().filter(|m| **m).count()).sum();
        let enough = missing.len() >= LEAST_MARKERS && frames >= LEAST_FRAMES;
        if !enough || (all as f64) < LEAST_MISSING * (missing.len() * frames) as f64 {
            return None;
        }
        let order = upwards(take, &missing.iter().map(|(marker, _)| *marker).collect::<Vec<_>>());
        Some(Self { missing: order.into_iter().map(|at| missing[at].1.clone()).collect() })
    }

    /// Whether the marker of a rank is missing in a frame; a take that is too short is played forwards and backwards.
    fn hides(&self, rank: usize, frame: usize) -> bool {
        let own = &self.missing[rank];
        let period = 2 * own.len() - 2;
        let at = frame % period;
        own[if at < own.len() { at } else { period - at }]
    }
}

/// The markers by their mean place along the axis that they spread over most, which is upright in most takes; as places in `markers`.
fn upwards(take: &Take, markers: &[usize]) -> Vec<usize> {
    let mean = |marker: usize| {
        let seen: Vec<[f64; 3]> = (0..take.frames()).filter_map(|t| take.position_mm(t, marker)).collect();
        [0, 1, 2].map(|axis| seen.iter().map(|x| x[axis]).sum::<f64>() / seen.len().max(1) as f64)
    };
    let means: Vec<[f64; 3]> = markers.iter().map(|&m| mean(m)).collect();
    let extent = |axis: usize| {
        let values = || means.iter().map(move |x| x[axis]);
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    let axis = (0..3).max_by(|&a, &b| extent(a).total_cmp(&extent(b))).unwrap_or(2);
    let mut order: Vec<usize> = (0..markers.len()).collect();
    order.sort_by(|&a, &b| means[a][axis].total_cmp(&means[b][axis]).then(a.cmp(&b)));
    order
}

/// So many of `all`, evenly spaced.
fn evenly(count: usize, all: usize) -> impl Iterator<Item = usize> {
    (0..count).map(move |k| if count > 1 { (k * (all - 1) + (count - 1) / 2) / (count - 1) } else { 0 })
}

/// Cases made of the takes in a folder, laid over `motions` in turn. Another `set` begins with another motion, at other frames.
///
/// # Errors
/// The folder cannot be read.
pub fn cases(folder: &Path, motions: &BTreeMap<String, Take>, set: usize) -> Result<Vec<Case>, String> {
    let listed = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut paths: Vec<_> = listed.filter_map(|entry| entry.ok().map(|entry| entry.path())).filter(|path| path.is_file()).collect();
    paths.sort();
    // what cannot be read lends nothing
    let masks = paths.iter().filter_map(|path| Mask::new(open(path, &Reading::default()).ok()?.document.take()));
    let motions: Vec<(&String, &Take)> = motions.iter().collect();
    let mut cases = Vec::new();
    for (number, mask) in masks.enumerate() {
        for trial in 0..TRIALS {
            let number = set + number * TRIALS + trial;
            let (motion, truth) = motions[number % motions.len()];
            let frames = truth.frames();
            let order = upwards(truth, &(0..truth.markers.len()).collect::<Vec<_>>());
            let count = order.len().min(mask.missing.len());
            let spare = mask.missing[0].len().saturating_sub(frames);
            // the golden ratio spreads the beginnings
            let first = ((number as f64 * 0.618_033_988_75).fract() * (spare + 1) as f64) as usize;
            let mut gaps = Vec::new();
            for (at, rank) in evenly(count, order.len()).zip(evenly(count, mask.missing.len())) {
                let hidden: Vec<bool> = (0..frames).map(|t| mask.hides(rank, first + t)).collect();
                // of a marker that is gone nearly always nobody could say anything
                if hidden.iter().filter(|h| **h).count() as f64 > (1.0 - LEAST_SEEN) * frames as f64 {
                    continue;
                }
                gaps.extend(runs(frames, |t| hidden[t]).into_iter().map(|(start, end)| [order[at], start, end - 1]));
            }
            if !gaps.is_empty() {
                cases.push(Case { motion: motion.clone(), kind: KIND.to_owned(), trial, gaps });
            }
        }
    }
    Ok(cases)
}
