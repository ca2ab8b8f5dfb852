//! Bones: what experts filled is moved so that distances are as they were seen, whole gaps at once.
//!
//! Experts say where a marker is and how far that may be off; bones say how far apart markers are and how much that varies.
//! The error of the experts and the length of a bone are processes in time that are known at both edges of a gap, so the fill joins what was seen
//! and nothing jumps from frame to frame. The problem is that of [`band`](crate::solve::lds::step::band), here in metres as there.

use super::tracks::{Tracks, distance};
use crate::solve::forest;
use crate::solve::lds::step::band::{Block, End, Episode, Neighbour, Tie, Time, Unknown, Vectors};
use crate::solve::lds::step::residual;
use crate::solve::{Bone, Gap};
use nalgebra::Vector3;
use rayon::prelude::*;

/// How long the error of experts lasts, in seconds.
const LASTS_S: f64 = 0.2;

/// Experts are not believed to be surer than this, mm.
const LEAST_SIGMA_MM: f64 = 0.3;

/// Bones are not believed to be stiffer than this, mm.
const LEAST_SPREAD_MM: f64 = 1.0;

/// Factor on the spread of a bone to a marker that is seen: experts look at that marker, so they know most of what the bone says.
const KNOWN_ALREADY: f64 = 5.0;

/// A bone is heard if it contradicts the experts by no more than this many standard deviations.
const CREDIBLE: f64 = 8.0;

/// The most Gauss-Newton steps.
const MOST_STEPS: usize = 20;

/// What bones demand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stiffness {
    /// They give by the spread that each really shows.
    #[default]
    Soft,
    /// They keep their lengths exactly where they do not contradict each other.
    Hard,
}

/// Which gaps are moved together, and by which bones. Fixed for a take.
pub struct Adjustment {
    bones: Vec<Bone>,
    /// Of each bone, how much of its length lasts from frame to frame.
    lasting: Vec<f64>,
    /// Of each bone, true if it has the length that was seen: then experts know it, and one that contradicts them by far is not believed.
    as_seen: Vec<bool>,
    episodes: Vec<Together>,
}

/// Gaps that bones connect.
struct Together {
    first: usize,
    /// For each frame, the markers that are missing.
    markers: Vec<Vec<usize>>,
    /// For each frame, the bones at them.
    bones: Vec<Vec<usize>>,
    /// Factor on the spread of each bone of the take.
    slack: Vec<f64>,
}

impl Adjustment {
    /// Sorts the gaps of `tracks` by the bones between them.
    pub fn new(tracks: &Tracks, bones: &[Bone], rate_hz: f64) -> Self {
        let bones: Vec<Bone> = bones.iter().filter(|b| b.length_mm > 0.0 && tracks.live(b.a) && tracks.live(b.b)).copied().collect();
        let gaps = tracks.gaps(|_, _| false);
        let (lasting, mean): (Vec<f64>, Vec<f64>) = bones.par_iter().map(|bone| lasting(tracks, bone, rate_hz)).unzip();
        let as_seen: Vec<bool> =
            bones.iter().zip(mean).map(|(bone, mean)| (bone.length_mm - mean).abs() <= 2.0 * bone.spread_mm.max(LEAST_SPREAD_MM)).collect();
        let episodes = together(&gaps, &bones).iter().map(|own| Together::new(&gaps, own, &bones, &as_seen)).collect();
        Self { bones, lasting, as_seen, episodes }
    }

    /// Moves what is filled in `tracks`.
    pub fn apply(&self, tracks: &mut Tracks, rate_hz: f64, stiffness: Stiffness) {
        let moved: Vec<Vectors> = self
            .episodes
            .par_iter()
            .map(|own| {
                let episode = self.episode(own, tracks, rate_hz, stiffness == Stiffness::Soft);
                let start = episode.blocks.iter().map(|b| b.unknowns.iter().map(|u| u.expected).collect()).collect();
                match stiffness {
                    Stiffness::Soft => episode.soft(start, MOST_STEPS),
                    Stiffness::Hard => episode.hard(start).0,
                }
            })
            .collect();
        for (own, moved) in self.episodes.iter().zip(moved) {
            for (at, (markers, places)) in own.markers.iter().zip(moved).enumerate() {
                for (&i, x) in markers.iter().zip(places) {
                    let t = own.first + at;
                    let place = (x * 1000.0).into();
                    // whoever was moved farther than he may be off was surer than he should have been
                    let sigma = tracks.sigma(t, i).max(distance(place, tracks.place(t, i)));
                    tracks.put(t, i, place, sigma);
                }
            }
        }
    }

    fn episode(&self, own: &Together, tracks: &Tracks, rate_hz: f64, soft: bool) -> Episode {
        let place = |t: usize, i: usize| Vector3::from(tracks.place(t, i)) / 1000.0;
        let rho = (-1.0 / (LASTS_S * rate_hz)).exp();
        let fresh = 1.0 / (1.0 - rho * rho);
        let missing = |t: usize, i: usize| !tracks.seen(t, i);
        // a bone that experts contradict by far leads to a sample that is not its marker's
        let credible = |t: usize, k: usize| {
            let bone = &self.bones[k];
            let far = (distance(tracks.place(t, bone.a), tracks.place(t, bone.b)) - bone.length_mm).abs();
            let spread = own.slack[k] * bone.spread_mm.hypot(LEAST_SPREAD_MM);
            far <= CREDIBLE * spread.hypot(tracks.sigma(t, bone.a)).hypot(tracks.sigma(t, bone.b))
        };
        let heard: Vec<Vec<usize>> = own
            .bones
            .iter()
            .enumerate()
            .map(|(at, bones)| bones.iter().copied().filter(|&k| !soft || !self.as_seen[k] || credible(own.first + at, k)).collect())
            .collect();
        let blocks = own
            .markers
            .iter()
            .enumerate()
            .map(|(at, markers)| {
                let t = own.first + at;
                let mut block = Block::default();
                for &i in markers {
                    let sigma = |t: usize| tracks.sigma(t, i).max(LEAST_SIGMA_MM) / 1000.0 / 3f64.sqrt();
                    let (now, mut time) = (sigma(t), Time::<Vector3<f64>>::default());
                    // an autoregressive process whose size follows the predicted error; at the edges the error is 0
                    let before = t.checked_sub(1);
                    time.own = if before.is_some() { fresh } else { 1.0 } / (now * now);
                    if let Some(before) = before.filter(|&b| missing(b, i)) {
                        time.before = own.markers[at - 1].iter().position(|&j| j == i);
                        time.link = rho * fresh / (now * sigma(before));
                    }
                    if t + 1 < tracks.frames {
                        time.own += rho * rho * fresh / (now * now);
                    }
                    block.unknowns.push(Unknown { sample: 0, expected: place(t, i), time });
                }
                let end = |i: usize| markers.iter().position(|&j| j == i).map_or_else(|| End::Fixed(place(t, i)), End::Free);
                for &k in &heard[at] {
                    let bone = &self.bones[k];
                    let length = bone.length_mm / 1000.0;
                    let spread = own.slack[k] * bone.spread_mm.hypot(LEAST_SPREAD_MM) / 1000.0;
                    let longest = residual::LONGEST * bone.spread_mm.hypot(LEAST_SPREAD_MM) / 1000.0;
                    let beside = |t: Option<usize>, at: Option<usize>| {
                        let Some(t) = t.filter(|&t| t < tracks.frames) else { return Neighbour::None };
                        if tracks.seen(t, bone.a) && tracks.seen(t, bone.b) {
                            let seen = distance(tracks.place(t, bone.a), tracks.place(t, bone.b)) / 1000.0;
                            return Neighbour::Known((seen - length).clamp(-longest, longest));
                        }
                        let slot = at.and_then(|at| heard.get(at)).and_then(|bones| bones.iter().position(|&other| other == k));
                        slot.map_or(Neighbour::None, Neighbour::Unknown)
                    };
                    let time = Time::new(
                        spread * spread,
                        self.lasting[k],
                        beside(t.checked_sub(1), at.checked_sub(1)),
                        beside(Some(t + 1), Some(at + 1)),
                    );
                    block.ties.push(Tie { ends: [end(bone.a), end(bone.b)], length, time });
                }
                block
            })
            .collect();
        Episode { blocks }
    }
}

/// How much of a bone's deviation from its mean length lasts from frame to frame, and its median length, mm.
fn lasting(tracks: &Tracks, bone: &Bone, rate_hz: f64) -> (f64, f64) {
    let length = |t: usize| {
        (tracks.seen(t, bone.a) && tracks.seen(t, bone.b)).then(|| distance(tracks.place(t, bone.a), tracks.place(t, bone.b)) / 1000.0)
    };
    let lengths: Vec<Option<f64>> = (0..tracks.frames).map(length).collect();
    let mean = lengths.iter().flatten().sum::<f64>() / lengths.iter().flatten().count().max(1) as f64;
    let found: Vec<Option<Vector3<f64>>> = lengths.iter().map(|l| l.map(|l| Vector3::new(l - mean, 0.0, 0.0))).collect();
    // labels that were swapped for a while must not make the length another
    let mut sorted: Vec<f64> = lengths.into_iter().flatten().collect();
    sorted.sort_by(f64::total_cmp);
    (residual::correlation(&found, rate_hz), sorted.get(sorted.len() / 2).map_or(0.0, |median| 1000.0 * median))
}

/// Gaps that bones connect while both last, by their index.
fn together(gaps: &[Gap], bones: &[Bone]) -> Vec<Vec<usize>> {
    let mut trees: Vec<usize> = (0..gaps.len()).collect();
    let of = |marker: usize| {
        let from = gaps.partition_point(|g| g.marker < marker);
        let to = gaps.partition_point(|g| g.marker <= marker);
        from..to
    };
    for bone in bones {
        let (a, b) = (of(bone.a), of(bone.b));
        let mut low = b.start;
        for g in a {
            while low < b.end && gaps[low].end <= gaps[g].start {
                low += 1;
            }
            for h in (low..b.end).take_while(|&h| gaps[h].start < gaps[g].end) {
                let (x, y) = (forest::root(&mut trees, g), forest::root(&mut trees, h));
                trees[x.max(y)] = x.min(y);
            }
        }
    }
    let mut groups: Vec<Vec<usize>> = vec![Vec::new(); gaps.len()];
    for g in 0..gaps.len() {
        groups[forest::root(&mut trees, g)].push(g);
    }
    groups.retain(|g| !g.is_empty());
    groups
}

impl Together {
    /// `as_seen`: bones of the length that was seen.
    fn new(gaps: &[Gap], own: &[usize], bones: &[Bone], as_seen: &[bool]) -> Self {
        let first = own.iter().map(|&g| gaps[g].start).min().unwrap_or(0);
        let last = own.iter().map(|&g| gaps[g].end).max().unwrap_or(first);
        let mut markers = vec![Vec::new(); last - first];
        for &g in own {
            for t in gaps[g].start..gaps[g].end {
                markers[t - first].push(gaps[g].marker);
            }
        }
        let at = |here: &Vec<usize>| (0..bones.len()).filter(|&k| here.contains(&bones[k].a) || here.contains(&bones[k].b)).collect();
        let at_frames: Vec<Vec<usize>> = markers.iter().map(at).collect();
        // one factor for a bone all the time, or its length would not be one process
        let (mut frames, mut both) = (vec![0usize; bones.len()], vec![0usize; bones.len()]);
        for (here, own) in markers.iter().zip(&at_frames) {
            for &k in own {
                frames[k] += 1;
                both[k] += usize::from(here.contains(&bones[k].a) && here.contains(&bones[k].b));
            }
        }
        let known = |k: usize| as_seen[k] && 2 * both[k] <= frames[k];
        let slack = (0..bones.len()).map(|k| if known(k) { KNOWN_ALREADY } else { 1.0 }).collect();
        Self { first, markers, bones: at_frames, slack }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::problem;
    use super::*;
    use crate::random::{Random, Stream};
    use std::f64::consts::PI;

    const RATE_HZ: f64 = 100.0;
    const FRAMES: usize = 200;
    const GAP: std::ops::Range<usize> = 80..120;

    fn bone(a: usize, b: usize, length_mm: f64, spread_mm: f64) -> Bone {
        Bone { a, b, length_mm, spread_mm }
    }

    #[test]
    fn gaps_belong_together_if_bones_lead_from_one_to_another() {
        let mut random = Random::new(7, Stream::Gaps);
        let mut sizes = [0; 3];
        for _ in 0..200 {
            let markers = random.whole(2, 7);
            let mut gaps = Vec::new();
            for marker in 0..markers {
                let mut t = random.whole(0, 15);
                for _ in 0..random.whole(0, 5) {
                    let end = t + random.whole(1, 12);
                    gaps.push(Gap { marker, start: t, end });
                    t = end + random.whole(1, 20);
                }
            }
            let bones: Vec<Bone> = (0..random.whole(0, 7))
                .map(|_| (random.whole(0, markers), random.whole(0, markers)))
                .filter(|(a, b)| a != b)
                .map(|(a, b)| bone(a, b, 1.0, 1.0))
                .collect();
            let tied = |x: &Gap, y: &Gap| {
                let joined = bones.iter().any(|b| (b.a, b.b) == (x.marker, y.marker) || (b.b, b.a) == (x.marker, y.marker));
                joined && x.start < y.end && y.start < x.end
            };
            // the least number that is handed on until nothing changes
            let mut expected: Vec<usize> = (0..gaps.len()).collect();
            for _ in 0..gaps.len() {
                for g in 0..gaps.len() {
                    let around = (0..gaps.len()).filter(|&h| tied(&gaps[g], &gaps[h])).map(|h| expected[h]);
                    expected[g] = around.fold(expected[g], usize::min);
                }
            }
            let found = together(&gaps, &bones);
            let mut of = vec![usize::MAX; gaps.len()];
            for group in &found {
                sizes[group.len().min(3) - 1] += 1;
                for &g in group {
                    assert_eq!(of[g], usize::MAX, "in two groups");
                    of[g] = group[0];
                }
            }
            assert_eq!(of, expected, "{gaps:?} with {bones:?}");
        }
        assert!(sizes.iter().all(|&n| n > 20), "{sizes:?}");
    }

    /// Four markers of a stiff body that walks and turns; 0 is missing in the gap, and 1 in its second half.
    fn place(t: usize, i: usize) -> [f64; 3] {
        const SHAPE: [[f64; 3]; 4] = [[150.0, 0.0, 0.0], [0.0, 120.0, 10.0], [-90.0, 0.0, 60.0], [0.0, -60.0, -110.0]];
        let (sin, cos) = (t as f64 / 40.0).sin_cos();
        let [x, y, z] = SHAPE[i];
        [cos * x - sin * y + 8.0 * t as f64, sin * x + cos * y, z + 900.0]
    }

    fn tracks() -> Tracks {
        Tracks::new(&problem((FRAMES, 4), RATE_HZ, place, |t, i| match i {
            0 => !GAP.contains(&t),
            1 => !(GAP.start + 20..GAP.end).contains(&t),
            _ => true,
        }))
    }

    fn between(i: usize, j: usize) -> f64 {
        distance(place(0, i), place(0, j))
    }

    /// Fills both gaps with what is true plus an error that `error` says.
    fn fill(tracks: &mut Tracks, error: impl Fn(usize) -> [f64; 3]) {
        for gap in tracks.gaps(|_, _| false) {
            for t in gap.start..gap.end {
                let (x, off) = (place(t, gap.marker), if gap.marker == 0 { error(t) } else { [0.0; 3] });
                tracks.put(t, gap.marker, [0, 1, 2].map(|axis| x[axis] + off[axis]), 6.0);
            }
        }
    }

    #[test]
    fn a_fill_that_keeps_the_bones_stays() {
        let mut tracks = tracks();
        fill(&mut tracks, |_| [0.0; 3]);
        let bones = [bone(0, 1, between(0, 1), 0.5), bone(0, 2, between(0, 2), 2.0), bone(1, 3, between(1, 3), 0.0)];
        let adjustment = Adjustment::new(&tracks, &bones, RATE_HZ);
        for stiffness in [Stiffness::Soft, Stiffness::Hard] {
            let mut moved = tracks.clone();
            adjustment.apply(&mut moved, RATE_HZ, stiffness);
            for (t, i) in (0..FRAMES).flat_map(|t| (0..4).map(move |i| (t, i))) {
                let off = distance(moved.place(t, i), place(t, i));
                assert!(off < 1e-6, "{stiffness:?}: marker {i} in frame {t} was moved by {off} mm");
                assert_eq!(moved.sigma(t, i), tracks.sigma(t, i), "what is predicted is not the bones' to say");
            }
        }
    }

    #[test]
    fn a_hard_bone_is_met_and_a_soft_one_pulls() {
        let wave = |t: usize| [9.0 * (t as f64 / 3.0).sin(), 5.0, -12.0 * (t as f64 / 9.0).cos()];
        let length = between(0, 2);
        let mut filled = tracks();
        fill(&mut filled, wave);
        // of another length than was seen, so that nobody knew it
        for length in [length, length - 25.0] {
            let adjustment = Adjustment::new(&filled, &[bone(0, 2, length, 1.0)], RATE_HZ);
            let worst =
                |tracks: &Tracks| GAP.map(|t| (distance(tracks.place(t, 0), tracks.place(t, 2)) - length).abs()).fold(0.0, f64::max);
            let off = [Stiffness::Soft, Stiffness::Hard].map(|stiffness| {
                let mut moved = filled.clone();
                adjustment.apply(&mut moved, RATE_HZ, stiffness);
                for t in (0..FRAMES).filter(|t| !GAP.contains(t)) {
                    assert_eq!(moved.place(t, 0), place(t, 0), "frame {t} was seen");
                }
                worst(&moved)
            });
            assert!(off[1] < 0.01, "{} mm off a hard bone of {length} mm", off[1]);
            assert!(off[0] < worst(&filled), "{} mm off a soft bone of {length} mm, {} mm before", off[0], worst(&filled));
        }
    }

    /// A fill that bulges out and is right at both edges: bones press it flat, and tear it nowhere.
    #[test]
    fn a_fill_joins_what_was_seen() {
        let bulge = |t: usize| {
            let share = (t + 1 - GAP.start) as f64 / (GAP.len() + 1) as f64;
            [15.0, 10.0, 20.0].map(|x| x * (PI * share).sin().powi(2))
        };
        let mut filled = tracks();
        fill(&mut filled, bulge);
        let bones = [bone(0, 2, between(0, 2), 0.5), bone(0, 3, between(0, 3), 0.5), bone(0, 1, between(0, 1), 0.5)];
        let adjustment = Adjustment::new(&filled, &bones, RATE_HZ);
        let mut moved = filled.clone();
        adjustment.apply(&mut moved, RATE_HZ, Stiffness::Soft);
        let error = |tracks: &Tracks, t: usize| Vector3::from(tracks.place(t, 0)) - Vector3::from(place(t, 0));
        let jump = |tracks: &Tracks| (1..FRAMES).map(|t| (error(tracks, t) - error(tracks, t - 1)).norm()).fold(0.0, f64::max);
        let worst = |tracks: &Tracks| GAP.map(|t| error(tracks, t).norm()).fold(0.0, f64::max);
        assert!(worst(&moved) < 0.8 * worst(&filled), "{} mm, {} mm before", worst(&moved), worst(&filled));
        assert!(jump(&moved) <= jump(&filled), "jumps by {} mm, by {} mm before", jump(&moved), jump(&filled));
    }
}
