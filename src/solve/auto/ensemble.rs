//! One gap: experts predict it, simulated gaps judge them, and their mean weighed by that evidence fills it.

use super::body::Body;
use super::experts::{self, ALL, Base, Family, Situation, Spec};
use super::features::{Features, Local, Part, lag_frames, spread};
use super::frame::{Core, Pose};
use super::kriging::{Process, Smoothness};
use super::ridge::{Fit, Sums};
use super::simulate::{Seen, Simulation};
use super::tracks::{Pairs, Tracks, UNKNOWN_MM};
use super::{Explanation, Recipe};
use crate::solve::{Gap, Problem};
use crate::solve::kernel::dot;
use nalgebra::{DMatrix, DVector, Vector3};

/// A limb is missing if so many of the four most rigid neighbours are.
pub const LIMB: usize = 2;

/// Markers that make the frame of the trunk.
const TRUNK: usize = 8;

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

/// Errors on simulated gaps against those in real ones, measured over several hundred gaps of takes with known truth: with a gap, a whole block
/// around it is kept from being learned, so simulated gaps are harder.
const PESSIMISM: f64 = 0.85;

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

/// Context offsets at this rate.
pub fn context(scale: f64) -> Vec<usize> {
    let mut offsets: Vec<usize> = CONTEXT.iter().map(|&k| ((k as f64 * scale).round() as usize).max(1)).collect();
    offsets.dedup();
    offsets
}

/// Squared length of three columns that belong together.
fn squares(e: &[f64]) -> f64 {
    e.iter().map(|x| x * x).sum()
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
            LIMB.. if self.recipe.limbs => Situation::Limb,
            _ if self.sweep == 0 && again => Situation::Draft,
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
        let case =
            Case { gap, learn, inside, edges, judged, beside, starts, hidden, weight, carries, stride, noise: self.noise(gap, &order) };

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
    fn local(&self, case: &Case, order: &[usize], base: Base, parts: &[Part]) -> Local {
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

    /// Asks a family of experts.
    fn ask(&self, case: &Case, order: &[usize], family: &Family, experts: &mut Vec<Expert>) {
        let tracks = self.tracks;
        let marker = case.gap.marker;
        let parts: Vec<Part> = family.specs.iter().flat_map(|s| s.parts.iter().copied()).collect();
        let local = self.local(case, order, family.base, &parts);
        let own = |t: usize| local.pose(t).to_local(tracks.place(t, marker));
        let mut mean = [0.0; 3];
        for &t in &case.learn {
            let x = own(t);
            for axis in 0..3 {
                mean[axis] += x[axis] / case.learn.len() as f64;
            }
        }
        let target = |frames: &[usize]| {
            let values = frames.iter().flat_map(|&t| {
                let x = own(t);
                [x[0] - mean[0], x[1] - mean[1], x[2] - mean[2]]
            });
            DMatrix::from_iterator(3, frames.len(), values)
        };
        let targets =
            Targets { learn: target(&case.learn), judged: target(&case.judged), beside: target(&case.beside), edges: target(&case.edges) };
        let mut groups: Vec<Vec<&Spec>> = Vec::new();
        for spec in &family.specs {
            // nested sets of places share their sums
            let plain = |s: &Spec| matches!(s.parts[..], [] | [Part::Place(_)]);
            match groups.iter_mut().find(|g| plain(g[0]) && plain(spec)) {
                Some(group) => group.push(spec),
                None => groups.push(vec![spec]),
            }
        }
        for group in &groups {
            let Some(widest) = group.iter().max_by_key(|s| s.parts.first().map_or(0, |p| p.neighbours())) else { continue };
            let features = Features::new(&local, &widest.parts, &case.learn);
            let d = features.count();
            let mut table = DMatrix::zeros(d + 3, case.learn.len());
            table.rows_mut(0, d).copy_from(&features.table(&case.learn));
            table.rows_mut(d, 3).copy_from(&targets.learn);
            let sums = Sums::new(&table, &case.hidden);
            let tables = Tables {
                inside: features.table(&case.inside),
                edges: features.table(&case.edges),
                judged: features.table(&case.judged),
                beside: features.table(&case.beside),
            };
            for spec in group {
                let used = if group.len() > 1 { 1 + spec.parts.first().map_or(0, |p| 3 * p.neighbours()) } else { d };
                let mut noise = vec![0.0; used - 1];
                let places = if let Some(Part::Place(k)) = spec.parts.first() { 3 * k } else { 0 };
                noise[..places].copy_from_slice(&case.noise[..places]);
                let Some(fit) = sums.fit(used, spec.prior, &noise, self.recipe.stiffness * self.scale / case.stride as f64) else {
                    continue;
                };
                let doubt: f64 = (1..used).map(|k| noise[k - 1] * fit.all.row(k).norm_squared()).sum();
                self.carry(case, spec, family.base, &local, mean, &fit, &tables, &targets, doubt, experts);
            }
        }
    }

    /// What the model of the whole body says, if it can be judged.
    fn ask_body(&self, case: &Case) -> Option<Expert> {
        let gap = case.gap;
        let said = self.body.prediction(self.problem, gap)?;
        let mut errors = DMatrix::zeros(3, case.judged.len());
        let mut known = vec![false; case.judged.len()];
        for (((mut column, &t), w), known) in errors.column_iter_mut().zip(&case.judged).zip(&case.weight).zip(&mut known) {
            let Some(x) = self.body.said(t, gap.marker).filter(|_| *w > 0.0) else { continue };
            let real = self.tracks.place(t, gap.marker);
            column.copy_from_slice(&[real[0] - x[0], real[1] - x[1], real[2] - x[2]]);
            *known = true;
        }
        let total = known.iter().filter(|k| **k).count() as f64;
        let prediction = DMatrix::from_iterator(3, said.len(), said.into_iter().flatten());
        let score = squares(errors.as_slice()) / total;
        (total > 0.0).then_some(Expert { name: "body", base: Base::Nearest(0), carry: 0, prediction, errors, doubt: 0.0, score, total, known })
    }

    /// What one regression says, with each way to carry what is left at the edges into the gap.
    #[allow(clippy::too_many_arguments)] // one step of a chain
    fn carry(
        &self,
        case: &Case,
        spec: &Spec,
        base: Base,
        local: &Local,
        mean: [f64; 3],
        fit: &Fit,
        tables: &Tables,
        targets: &Targets,
        doubt: f64,
        experts: &mut Vec<Expert>,
    ) {
        let used = fit.all.nrows();
        let predict = |beta: &DMatrix<f64>, table: &DMatrix<f64>, from: usize, count: usize| linear(beta, table, used, from, count);
        // what is left in and around the simulated gaps, out of block
        let (p, c) = (case.positions(), case.beside.len() / case.starts.len());
        let mut left = targets.judged.clone();
        let mut left_beside = targets.beside.clone();
        for (n, &(block, _)) in case.starts.iter().enumerate() {
            let beta = &fit.without[block];
            left.columns_mut(n * p, p).zip_apply(&predict(beta, &tables.judged, n * p, p), |x, y| *x -= y);
            left_beside.columns_mut(n * c, c).zip_apply(&predict(beta, &tables.beside, n * c, c), |x, y| *x -= y);
        }
        let plain = predict(&fit.all, &tables.inside, 0, case.inside.len());
        let edge_left = &targets.edges - predict(&fit.all, &tables.edges, 0, case.edges.len());
        for carry in 0..=case.carries.len() {
            let mut errors = left.clone();
            let mut prediction = plain.clone();
            if let Some(carry) = carry.checked_sub(1).map(|k| &case.carries[k]) {
                for n in 0..case.starts.len() {
                    let step = left_beside.columns(n * c, c) * &carry.simulated;
                    errors.columns_mut(n * p, p).zip_apply(&step, |x, y| *x -= y);
                }
                prediction += &edge_left * &carry.real;
            }
            // families have frames of their own, so they meet in the world's
            for ((mut column, w), &t) in errors.column_iter_mut().zip(&case.weight).zip(&case.judged) {
                let turned = local.pose(t).direction_to_world(Vector3::new(column[0], column[1], column[2])) * *w;
                column.copy_from(&turned);
            }
            for (mut column, &t) in prediction.column_iter_mut().zip(&case.inside) {
                let x = local.pose(t).to_world([column[0] + mean[0], column[1] + mean[1], column[2] + mean[2]]);
                column.copy_from_slice(&x);
            }
            let score = squares(errors.as_slice()) / case.total() + doubt;
            experts.push(Expert { name: spec.name, base, carry, prediction, errors, doubt, score, total: case.total(), known: case.weight.iter().map(|w| *w > 0.0).collect() });
        }
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

    /// From the combination to positions and standard deviations.
    fn finish(
        &self,
        case: &Case,
        order: &[usize],
        experts: &[Expert],
        shares: &[(usize, f64)],
        simulation: &Simulation,
        positions: &[usize],
    ) -> Filling {
        let (length, p) = (case.inside.len(), positions.len());
        let prediction = mix(shares, experts, |e| &e.prediction);
        let errors = mixed_errors(shares, experts);
        let doubt: f64 = shares.iter().map(|&(e, share)| share * experts[e].doubt).sum();
        // at each position: error of the combination, and how far experts are apart, over the simulated gaps
        let mut count = vec![0.0; p];
        let (mut square, mut apart) = (vec![0.0; p], vec![0.0; p]);
        for (n, w) in case.weight.iter().enumerate() {
            let at = n % p;
            count[at] += w;
            square[at] += squares(errors.column(n).as_slice());
            for &(e, share) in shares.iter().filter(|&&(e, _)| experts[e].known[n]) {
                apart[at] += share * (experts[e].errors.column(n) - errors.column(n)).norm_squared();
            }
        }
        let at_position: Vec<f64> = (0..p).map(|k| (square[k] / f64::max(count[k], 1.0) + doubt).sqrt()).collect();
        let apart: Vec<f64> = (0..p).map(|k| (apart[k] / f64::max(count[k], 1.0)).sqrt()).collect();
        let knots: Vec<f64> = positions.iter().map(|&x| x as f64).collect();
        let mut sigma_mm = Vec::with_capacity(length);
        for k in 0..length {
            let at = (k as f64 + 0.5) / length as f64 * simulation.frames as f64 - 0.5;
            let now = prediction.column(k);
            let spread: f64 = shares.iter().map(|&(e, share)| share * (experts[e].prediction.column(k) - now).norm_squared()).sum();
            let usual = interpolate(&knots, &apart, at).max(0.05);
            let strange = if self.recipe.spread { (spread.sqrt() / usual).max(1.0) } else { 1.0 };
            sigma_mm.push(PESSIMISM * interpolate(&knots, &at_position, at) * strange + 0.05);
        }
        let mut likelihood = (0.0, 0);
        for (n, _) in case.weight.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let variance = (at_position[n % p] + 0.05).powi(2) / 3.0;
            likelihood.0 -= 1.5 * (std::f64::consts::TAU * variance).ln() + 0.5 * squares(errors.column(n).as_slice()) / variance;
            likelihood.1 += 1;
        }
        let predicted_mm = (sigma_mm.iter().map(|s| s * s).sum::<f64>() / length as f64).sqrt();
        let mut named: Vec<(String, f64, f64)> =
            shares.iter().filter(|s| s.1 > 0.0).map(|&(e, share)| (experts[e].label(), share, experts[e].score.sqrt())).collect();
        named.sort_by(|a, b| b.1.total_cmp(&a.1));
        let explanation = Explanation {
            gap: *case.gap,
            neighbours: order.to_vec(),
            experts: named,
            simulated: simulation.count(),
            simulated_frames: simulation.frames,
            predicted_mm,
        };
        let places_mm = prediction.column_iter().map(|x| [x[0], x[1], x[2]]).collect();
        Filling { places_mm, sigma_mm, likelihood, neighbours: order.to_vec(), explanation }
    }
}

/// One gap with the frames that matter for it.
struct Case<'a> {
    gap: &'a Gap,
    /// What is learned from.
    learn: Vec<usize>,
    /// The gap.
    inside: Vec<usize>,
    /// Where the marker was seen next to it.
    edges: Vec<usize>,
    /// Where errors are taken, simulated gap by simulated gap.
    judged: Vec<usize>,
    /// Around simulated gaps, as `edges` are around the gap.
    beside: Vec<usize>,
    /// Block and first frame of each simulated gap.
    starts: Vec<(usize, usize)>,
    /// For each block, what of `learn` is hidden.
    hidden: Vec<std::ops::Range<usize>>,
    /// 1 where the marker was seen in `judged`, else 0.
    weight: Vec<f64>,
    carries: Vec<Carry>,
    /// Every so many of the seen frames are learned from.
    stride: usize,
    /// Variance of the noise of each neighbour's local coordinates in the gap, mm².
    noise: Vec<f64>,
}

impl Case<'_> {
    /// Frames of a simulated gap at which errors are taken.
    fn positions(&self) -> usize {
        self.judged.len() / self.starts.len().max(1)
    }

    /// Number of errors.
    fn total(&self) -> f64 {
        self.weight.iter().sum::<f64>().max(1.0)
    }
}

/// The kriging weights of one process: edges × frames of the gap, and the same for simulated gaps.
struct Carry {
    real: DMatrix<f64>,
    simulated: DMatrix<f64>,
}

/// Features × frames.
struct Tables {
    inside: DMatrix<f64>,
    edges: DMatrix<f64>,
    judged: DMatrix<f64>,
    beside: DMatrix<f64>,
}

/// The marker in local coordinates, minus its mean: 3 × frames.
struct Targets {
    learn: DMatrix<f64>,
    edges: DMatrix<f64>,
    judged: DMatrix<f64>,
    beside: DMatrix<f64>,
}

/// What an expert says about the gap, and how it did on simulated ones.
struct Expert {
    name: &'static str,
    base: Base,
    /// 0: nothing is carried in from the edges; else by that process.
    carry: usize,
    /// 3 × frames, mm.
    prediction: DMatrix<f64>,
    /// 3 × judged samples, mm.
    errors: DMatrix<f64>,
    /// Variance from the noise of what it looks at, mm².
    doubt: f64,
    /// Mean square error with that, mm².
    score: f64,
    /// How many errors those are.
    total: f64,
    /// For each judged sample, true if the error is known; it is 0 if not.
    known: Vec<bool>,
}

impl Expert {
    fn label(&self) -> String {
        let carry = ["", "+8", "+16", "+32", "+48"][self.carry.min(4)];
        match self.base {
            Base::Nearest(0) => format!("{}{carry}", self.name),
            Base::Nearest(count) => format!("{}@{count}{carry}", self.name),
            Base::Trunk => format!("{}@trunk{carry}", self.name),
        }
    }
}

/// `betaᵀ table` for some columns of a table: 3 × count.
fn linear(beta: &DMatrix<f64>, table: &DMatrix<f64>, used: usize, from: usize, count: usize) -> DMatrix<f64> {
    let height = table.nrows();
    let mut out = DMatrix::zeros(3, count);
    for (out, column) in out.as_mut_slice().chunks_exact_mut(3).zip(table.as_slice()[from * height..].chunks_exact(height)) {
        for (x, beta) in out.iter_mut().zip(beta.as_slice().chunks_exact(used)) {
            *x = dot(beta, &column[..used]);
        }
    }
    out
}

/// The weighed sum of what experts say.
fn mix<'e>(shares: &[(usize, f64)], experts: &'e [Expert], what: impl Fn(&'e Expert) -> &'e DMatrix<f64>) -> DMatrix<f64> {
    let mut sum = DMatrix::zeros(3, what(&experts[0]).ncols());
    for &(e, share) in shares {
        crate::solve::kernel::axpy(sum.as_mut_slice(), share, what(&experts[e]).as_slice());
    }
    sum
}

/// The error of the weighed mean; where an expert's error is not known, that of the mean of the others.
fn mixed_errors(shares: &[(usize, f64)], experts: &[Expert]) -> DMatrix<f64> {
    let mut errors = mix(shares, experts, |e| &e.errors);
    for (n, mut column) in errors.column_iter_mut().enumerate() {
        let silent: f64 = shares.iter().filter(|&&(e, _)| !experts[e].known[n]).map(|s| s.1).sum();
        if silent > 0.0 && silent < 1.0 {
            column /= 1.0 - silent;
        }
    }
    errors
}

/// The best mean of the best experts, by the covariance of their errors, shrunk strongly towards equal shares.
/// Of each regression only the best way to carry counts: the others would say the same again.
///
/// With `consensus`, experts that depart from the mean in the gap more than they did in simulated gaps lose what they gained: they extrapolate.
fn combine(experts: &[Expert], case: &Case, most: usize, consensus: bool) -> Vec<(usize, f64)> {
    let mut penalties = vec![0.0; experts.len()];
    let mut shares = weigh(experts, &penalties, most);
    if consensus {
        let prediction = mix(&shares, experts, |e| &e.prediction);
        let errors = mixed_errors(&shares, experts);
        let apart = |a: &DMatrix<f64>, b: &DMatrix<f64>| a.as_slice().iter().zip(b.as_slice()).map(|(x, y)| (x - y) * (x - y)).sum::<f64>();
        for (penalty, expert) in penalties.iter_mut().zip(experts) {
            let here = apart(&expert.prediction, &prediction) / case.inside.len() as f64;
            let own = expert.errors.column_iter().zip(errors.column_iter()).zip(&expert.known).filter(|(_, known)| **known);
            let there = own.map(|((e, mean), _)| (e - mean).norm_squared()).sum::<f64>() / expert.total;
            *penalty = (here - there).max(0.0);
        }
        shares = weigh(experts, &penalties, most);
    }
    shares
}

fn weigh(experts: &[Expert], penalties: &[f64], most: usize) -> Vec<(usize, f64)> {
    let mut best: Vec<usize> = (0..experts.len()).collect();
    let score = |e: usize| experts[e].score + penalties[e];
    best.sort_by(|&a, &b| score(a).total_cmp(&score(b)).then(a.cmp(&b)));
    let mut taken: Vec<(&str, Base)> = Vec::new();
    best.retain(|&e| {
        let key = (experts[e].name, experts[e].base);
        let new = !taken.contains(&key);
        if new {
            taken.push(key);
        }
        new
    });
    best.truncate(most);
    let m = best.len();
    let mut covariance = DMatrix::zeros(m, m);
    for a in 0..m {
        for b in 0..=a {
            let both = experts[best[a]].total.min(experts[best[b]].total);
            let value = dot(experts[best[a]].errors.as_slice(), experts[best[b]].errors.as_slice()) / both;
            covariance[(a, b)] = value;
            covariance[(b, a)] = value;
        }
        covariance[(a, a)] += experts[best[a]].doubt + penalties[best[a]];
    }
    let ridge = covariance.trace() / m as f64 + 1e-6;
    for k in 0..m {
        covariance[(k, k)] += ridge;
    }
    let ones = DVector::from_element(m, 1.0);
    let mut shares: Vec<f64> = covariance.cholesky().map_or(vec![1.0; m], |c| c.solve(&ones).iter().map(|x| x.max(0.0)).collect());
    let sum: f64 = shares.iter().sum();
    for s in &mut shares {
        *s /= sum;
    }
    best.into_iter().zip(shares).collect()
}

/// Straight lines through `(knots, values)`, held outside.
pub fn interpolate(knots: &[f64], values: &[f64], at: f64) -> f64 {
    let next = knots.partition_point(|&k| k < at);
    match (next.checked_sub(1), knots.get(next)) {
        (Some(before), Some(_)) => {
            let share = (at - knots[before]) / (knots[next] - knots[before]);
            values[before] + share * (values[next] - values[before])
        }
        (Some(before), None) => values[before],
        (None, _) => values.first().copied().unwrap_or(f64::NAN),
    }
}
