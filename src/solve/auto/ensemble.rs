//! One gap: experts predict it, simulated gaps judge them, and their mean weighed by that evidence fills it.

use super::blackout::{Context, curve, curve_kinds};
use super::body::Body;
use super::experts::{self, ALL, Base, Family, Situation, Spec};
use super::features::{Local, Part, lag_frames, spread};
use super::frame::{Core, Pose};
use super::kriging::{Process, Smoothness};
use super::simulate::{Seen, Simulation};
use super::stack::{Expert, combine};
use super::tracks::{Pairs, Tracks, UNKNOWN_MM};
use super::{Explanation, Recipe};
use crate::solve::{Gap, Problem};
use nalgebra::DMatrix;

/// A limb is missing if so many of the four most rigid neighbours are.
pub const LIMB: usize = 2;

/// Markers that make the frame of the trunk.
const TRUNK: usize = 8;

/// Up to this many frames at 120 Hz a curve through the marker's own samples is asked, too.
const MOST_CURVE: f64 = 30.0;

/// The standard deviation of a fill that nothing could be said about, mm.
const UNJUDGED_MM: f64 = 50.0;

/// Frames from the edge of a gap at which the marker's own track is looked at, at 120 Hz.
pub const CONTEXT: [usize; 8] = [1, 2, 3, 5, 8, 12, 17, 24];

/// A marker that is missing in this share of a gap helps nobody there: what is believed of it came from the same neighbours.
const ABSENT: f64 = 0.9;

/// What 1 mm of distance costs against 1 mm of spread when neighbours compete.
const DISTANCE_COST: f64 = 0.02;

/// Rows that experts learn from, at most, for one gap.
const ROWS: usize = 600;

/// Positions within a simulated gap at which errors are taken, at most.
const POSITIONS: usize = 6;

/// Experts that are combined, at most.
const COMBINED: usize = 32;

/// What is common to all gaps of a sweep.
pub struct Scene<'a> {
    /// What is believed now.
    pub tracks: &'a Tracks,
    /// How markers keep together.
    pub pairs: &'a Pairs,
    /// For each marker, where it was seen.
    pub seen: &'a [Seen],
    /// Rate over 120 Hz.
    pub scale: f64,
    /// 0 in the first sweep, when nothing is known about what was filled.
    pub sweep: u32,
    /// What is used.
    pub recipe: &'a Recipe,
    /// Gaps of limbs that are shorter than this, in frames, are filled like others.
    pub long_limb: usize,
    /// The problem, and what the model of the whole body says about it.
    pub problem: &'a Problem,
    /// See [`Body`].
    pub body: &'a Body,
}

/// What fills a gap.
#[derive(Clone, Debug)]
pub struct Filling {
    /// One position per frame, mm.
    pub places_mm: Vec<[f64; 3]>,
    /// Standard deviation of the 3-D error, mm.
    pub sigma_mm: Vec<f64>,
    /// Log-likelihood of the simulated gaps under the combined prediction, in nats, and how many samples that is.
    pub likelihood: (f64, usize),
    /// The markers that experts looked at.
    pub neighbours: Vec<usize>,
    /// Why it came out so.
    pub explanation: Explanation,
}

/// The kriging of what regressions leave: processes with their length scales in frames at 120 Hz.
fn processes(scale: f64) -> [Process; 4] {
    let process = |frames: f64, smoothness, nugget| Process { smoothness, scale: frames * scale, nugget };
    [
        process(8.0, Smoothness::Once, 0.02),
        process(16.0, Smoothness::Once, 0.01),
        process(32.0, Smoothness::Once, 0.003),
        process(48.0, Smoothness::Twice, 1e-5),
    ]
}

/// Context offsets at this rate. The frames right beside a gap always belong to it.
pub fn context(scale: f64) -> Vec<usize> {
    let mut offsets: Vec<usize> = CONTEXT.iter().map(|&k| if k == 1 { 1 } else { lag_frames(k, scale) }).collect();
    offsets.dedup();
    offsets
}

impl Scene<'_> {
    /// Neighbours of a gap's marker, best first, and how many of the four most rigid ones are missing with it.
    pub fn order(&self, gap: &Gap) -> (Vec<usize>, usize) {
        let (i, tracks) = (gap.marker, self.tracks);
        let mut scored: Vec<(f64, usize)> = Vec::new();
        let mut rigid: Vec<(f64, bool)> = Vec::new();
        for j in (0..tracks.markers).filter(|&j| j != i && tracks.live(j)) {
            let pair = self.pairs.get(i, j);
            if pair.spread_mm >= UNKNOWN_MM {
                continue;
            }
            let absent = tracks.missing_share(j, gap.start, gap.end);
            let stiff = pair.spread_mm + DISTANCE_COST * pair.distance_mm;
            rigid.push((stiff, absent >= ABSENT));
            if absent >= ABSENT {
                continue;
            }
            let doubt = if self.sweep == 0 {
                200.0 * absent
            } else {
                let sum: f64 = (gap.start..gap.end).map(|t| tracks.sigma(t, j).powi(2)).sum();
                (sum / gap.frames() as f64).sqrt() + 5.0 * absent
            };
            scored.push((stiff + doubt, j));
        }
        scored.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        rigid.sort_by(|a, b| a.0.total_cmp(&b.0));
        let limb = rigid.iter().take(4).filter(|r| r.1).count();
        (scored.into_iter().map(|(_, j)| j).collect(), limb)
    }

    /// The marker's own samples nearest to the gap, ascending.
    fn edges(&self, gap: &Gap, offsets: &[usize]) -> Vec<usize> {
        let seen = &self.seen[gap.marker];
        let (before, after) = (seen.rank(gap.start), seen.rank(gap.end));
        let mut edges: Vec<usize> = offsets.iter().filter_map(|&k| before.checked_sub(k).map(|at| seen.frames[at])).collect();
        edges.reverse();
        edges.extend(offsets.iter().filter_map(|&k| seen.frames.get(after + k - 1)));
        edges
    }

    /// Fills one gap.
    pub fn fill(&self, gap: &Gap) -> Filling {
        let (tracks, seen, scale) = (self.tracks, &self.seen[gap.marker], self.scale);
        let (mut order, missing_with_it) = self.order(gap);
        order.truncate(ALL);
        if order.len() < 3 {
            order.clear();
        }
        let offsets = context(scale);
        let edges = self.edges(gap, &offsets);
        let simulation = Simulation::new(seen, gap.frames());
        let again = order.iter().take(24).any(|&j| self.seen[j].frames.len() < self.seen[j].len());
        let situation = match missing_with_it {
            _ if self.sweep == 0 && again => Situation::Draft,
            _ if self.sweep + 1 < self.recipe.sweeps && again => Situation::Sketch,
            LIMB.. if self.recipe.limbs && gap.frames() >= self.long_limb => Situation::Limb,
            _ if again => Situation::Crowded,
            _ => Situation::Plain,
        };
        let families = self.families(situation, order.len());

        // frames that take part
        let stride = lag_frames(3, scale).max(seen.frames.len().div_ceil(ROWS));
        let learn: Vec<usize> = seen.frames.iter().copied().step_by(stride).collect();
        let inside: Vec<usize> = (gap.start..gap.end).collect();
        let positions: Vec<usize> = spread(simulation.frames, POSITIONS);
        let before = edges.iter().filter(|&&t| t < gap.start).count();
        let mut around: Vec<isize> = offsets.iter().take(before).rev().map(|&k| -(k as isize)).collect();
        around.extend(offsets.iter().take(edges.len() - before).map(|&k| (simulation.frames + k - 1) as isize));
        let starts: Vec<(usize, usize)> =
            simulation.blocks.iter().enumerate().flat_map(|(b, block)| block.starts.iter().map(move |&s| (b, s))).collect();
        let judged: Vec<usize> = starts.iter().flat_map(|&(_, s)| positions.iter().map(move |&p| s + p)).collect();
        let within = |t: isize| t.clamp(0, tracks.frames as isize - 1) as usize;
        let beside: Vec<usize> = starts.iter().flat_map(|&(_, s)| around.iter().map(move |&k| within(s as isize + k))).collect();
        let hidden: Vec<std::ops::Range<usize>> = simulation
            .blocks
            .iter()
            .map(|b| learn.partition_point(|&t| t < b.hidden.start)..learn.partition_point(|&t| t < b.hidden.end))
            .collect();
        let weight: Vec<f64> = judged.iter().map(|&t| if tracks.seen(t, gap.marker) { 1.0 } else { 0.0 }).collect();

        // experts differ in how they carry what is left at the edges into the gap, too
        let times = |frames: &[usize]| frames.iter().map(|&t| t as f64).collect::<Vec<f64>>();
        let around_times: Vec<f64> = around.iter().map(|&t| t as f64).collect();
        let kernels = if self.recipe.kriging { processes(scale).to_vec() } else { Vec::new() };
        let carries: Vec<Carry> = kernels
            .iter()
            .map(|k| Carry { real: k.weights(&times(&edges), &times(&inside)), simulated: k.weights(&around_times, &times(&positions)) })
            .collect();
        let adjacent = before > 0 && before < edges.len() && edges[before - 1] + 1 == gap.start && edges[before] == gap.end;
        let curves: Vec<Carry> = if adjacent && gap.frames() as f64 <= MOST_CURVE * scale {
            let real = Context { before, offsets: edges.iter().map(|&t| t as isize - gap.start as isize).collect() };
            let simulated = Context { before, offsets: around.clone() };
            let frames: Vec<f64> = (0..gap.frames()).map(|k| k as f64).collect();
            let one = |&kind: &Option<Process>| Carry {
                real: curve(&real, &frames, gap.frames(), kind),
                simulated: curve(&simulated, &times(&positions), simulation.frames, kind),
            };
            curve_kinds(scale).iter().map(one).collect()
        } else {
            Vec::new()
        };
        let case = Case {
            curves,
            gap,
            learn,
            inside,
            edges,
            judged,
            beside,
            starts,
            hidden,
            weight,
            carries,
            stride,
            noise: self.noise(gap, &order),
            pessimism: situation.pessimism(),
        };

        if simulation.count() < 4 {
            let local = self.local(&case, &order, Base::Nearest(5), &[]);
            return self.without_evidence(&case, &local);
        }
        let mut experts: Vec<Expert> = Vec::new();
        for family in &families {
            self.ask(&case, &order, family, &mut experts);
        }
        if experts.is_empty() {
            let local = self.local(&case, &order, Base::Nearest(5), &[]);
            return self.without_evidence(&case, &local);
        }
        if !case.curves.is_empty() {
            self.ask_time(&case, &mut experts);
        }
        if situation == Situation::Limb && self.recipe.body {
            experts.extend(self.ask_body(&case));
        }
        let combined = combine(&experts, &case, if self.recipe.stacking { COMBINED } else { 1 }, self.recipe.consensus);
        self.finish(&case, &order, &experts, &combined, &simulation, &positions)
    }

    /// The experts for a gap, as far as there are neighbours for them.
    fn families(&self, situation: Situation, neighbours: usize) -> Vec<Family> {
        if neighbours < 3 {
            return vec![Family { base: Base::Nearest(0), specs: vec![Spec { name: "track", parts: Vec::new(), prior: 1.0 }] }];
        }
        let mut families = experts::families(situation);
        families.retain(|f| self.recipe.frames || f.base == Base::Nearest(5));
        for family in &mut families {
            family.specs.retain(|spec| {
                self.recipe.bent || !spec.parts.iter().any(|p| matches!(p, Part::Near { .. } | Part::Products(_) | Part::Bumps { .. }))
            });
            for spec in &mut family.specs {
                for part in &mut spec.parts {
                    *part = part.capped(neighbours);
                }
            }
        }
        if neighbours < 8
            && situation != Situation::Draft
            && let Some(first) = families.first_mut()
        {
            first.specs.push(Spec { name: "rigid", parts: Vec::new(), prior: 1.0 });
        }
        families
    }

    /// Neighbours in a local frame, in all frames that `parts` look at.
    pub(super) fn local(&self, case: &Case, order: &[usize], base: Base, parts: &[Part]) -> Local {
        let tracks = self.tracks;
        let mut wanted = vec![false; tracks.frames];
        let mut lags: Vec<usize> = parts.iter().map(|p| p.lag()).filter(|&lag| lag > 0).map(|lag| lag_frames(lag, self.scale)).collect();
        lags.sort_unstable();
        lags.dedup();
        for &t in case.learn.iter().chain(&case.inside).chain(&case.edges).chain(&case.judged).chain(&case.beside) {
            wanted[t] = true;
            for &lag in &lags {
                wanted[t.saturating_sub(lag)] = true;
                wanted[(t + lag).min(tracks.frames - 1)] = true;
            }
        }
        let wanted: Vec<usize> = (0..tracks.frames).filter(|&t| wanted[t]).collect();
        let most = parts.iter().map(|p| p.neighbours()).max().unwrap_or(0).min(order.len());
        let poses = self.poses(case, order, base, &wanted);
        Local::new(tracks, &order[..most], &wanted, poses, &case.learn, self.scale)
    }

    /// Local frames of the gap's neighbours.
    fn poses(&self, case: &Case, order: &[usize], base: Base, wanted: &[usize]) -> Vec<Pose> {
        let tracks = self.tracks;
        let first = self.sweep == 0;
        let (core, weights): (Vec<usize>, Vec<f64>) = match base {
            Base::Nearest(count) => {
                let core = order[..order.len().min(count)].to_vec();
                let weights = core.iter().map(|&j| 1.0 / (0.3 + self.pairs.get(case.gap.marker, j).spread_mm)).collect();
                (core, weights)
            }
            Base::Trunk => {
                let core = self.trunk(case.gap, order);
                let weights = vec![1.0; core.len()];
                (core, weights)
            }
        };
        if core.len() < 3 {
            return vec![Pose::world_frame(); wanted.len()];
        }
        let trust = |sigma: f64| if first || base == Base::Trunk { 0.05 } else { 1.0 / (1.0 + sigma / 3.0) };
        let whole: Vec<usize> = case.learn.iter().copied().filter(|&t| core.iter().all(|&j| tracks.seen(t, j))).collect();
        let learn = if whole.len() >= 10 { &whole } else { &case.learn };
        Core { tracks, markers: &core, weights: &weights, trust: &trust }.poses(wanted, learn)
    }

    /// The markers that keep together best among those that are there.
    fn trunk(&self, gap: &Gap, order: &[usize]) -> Vec<usize> {
        let there: Vec<usize> = order.iter().copied().filter(|&j| self.tracks.missing_share(j, gap.start, gap.end) < 0.5).collect();
        let best = |&j: &usize| {
            let mut near: Vec<(f64, usize)> = there.iter().filter(|&&k| k != j).map(|&k| (self.pairs.get(j, k).spread_mm, k)).collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            near.truncate(TRUNK - 1);
            let mean = near.iter().map(|n| n.0).sum::<f64>() / near.len().max(1) as f64;
            (mean, j, near)
        };
        let found = there.iter().map(best).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.map_or_else(Vec::new, |(_, j, near)| std::iter::once(j).chain(near.into_iter().map(|n| n.1)).collect())
    }

    /// Variance of the noise of each neighbour's local coordinates in the gap, mm²: what is known about those that are filled there.
    fn noise(&self, gap: &Gap, order: &[usize]) -> Vec<f64> {
        let one = |&j: &usize| {
            let frames = gap.start..gap.end;
            if self.sweep == 0 {
                400.0 * self.tracks.missing_share(j, gap.start, gap.end)
            } else {
                frames.map(|t| self.tracks.sigma(t, j).powi(2)).sum::<f64>() / gap.frames() as f64 / 3.0
            }
        };
        order.iter().flat_map(|j| [one(j); 3]).collect()
    }

    /// Hardly any data: the local track carried on by kriging, and little said about the error.
    fn without_evidence(&self, case: &Case, local: &Local) -> Filling {
        let gap = case.gap;
        let own: Vec<[f64; 3]> = case.edges.iter().map(|&t| local.pose(t).to_local(self.tracks.place(t, gap.marker))).collect();
        let mean: [f64; 3] = std::array::from_fn(|axis| own.iter().map(|x| x[axis]).sum::<f64>() / own.len().max(1) as f64);
        let process = Process { smoothness: Smoothness::Once, scale: 32.0 * self.scale, nugget: 0.003 };
        let known: Vec<f64> = case.edges.iter().map(|&t| t as f64).collect();
        let wanted: Vec<f64> = case.inside.iter().map(|&t| t as f64).collect();
        let weights = process.weights(&known, &wanted);
        let place = |(k, &t): (usize, &usize)| {
            let x = std::array::from_fn(|axis| {
                mean[axis] + own.iter().enumerate().map(|(e, x)| weights[(e, k)] * (x[axis] - mean[axis])).sum::<f64>()
            });
            local.pose(t).to_world(x)
        };
        let explanation = Explanation {
            gap: *gap,
            neighbours: Vec::new(),
            experts: vec![("held".to_owned(), 1.0, f64::NAN)],
            simulated: 0,
            simulated_frames: 0,
            predicted_mm: UNJUDGED_MM,
        };
        Filling {
            places_mm: case.inside.iter().enumerate().map(place).collect(),
            sigma_mm: vec![UNJUDGED_MM; gap.frames()],
            likelihood: (0.0, 0),
            neighbours: Vec::new(),
            explanation,
        }
    }
}

/// One gap with the frames that matter for it.
pub struct Case<'a> {
    /// The gap itself.
    pub gap: &'a Gap,
    /// What is learned from.
    pub learn: Vec<usize>,
    /// The gap.
    pub inside: Vec<usize>,
    /// Where the marker was seen next to it.
    pub edges: Vec<usize>,
    /// Where errors are taken, simulated gap by simulated gap.
    pub judged: Vec<usize>,
    /// Around simulated gaps, as `edges` are around the gap.
    pub beside: Vec<usize>,
    /// Block and first frame of each simulated gap.
    pub starts: Vec<(usize, usize)>,
    /// For each block, what of `learn` is hidden.
    pub hidden: Vec<std::ops::Range<usize>>,
    /// 1 where the marker was seen in `judged`, else 0.
    pub weight: Vec<f64>,
    /// Curves through the marker's own samples, for short gaps: edges × frames.
    pub curves: Vec<Carry>,
    /// What is carried in from the edges, by each process.
    pub carries: Vec<Carry>,
    /// Every so many of the seen frames are learned from.
    pub stride: usize,
    /// Variance of the noise of each neighbour's local coordinates in the gap, mm².
    pub noise: Vec<f64>,
    /// Factor from errors on simulated gaps to predicted ones.
    pub pessimism: f64,
}

impl Case<'_> {
    /// Frames of a simulated gap at which errors are taken.
    pub fn positions(&self) -> usize {
        self.judged.len() / self.starts.len().max(1)
    }

    /// Number of errors.
    pub fn total(&self) -> f64 {
        self.weight.iter().sum::<f64>().max(1.0)
    }
}

/// The kriging weights of one process: edges × frames of the gap, and the same for simulated gaps.
pub struct Carry {
    /// For the gap.
    pub real: DMatrix<f64>,
    /// For simulated gaps.
    pub simulated: DMatrix<f64>,
}
