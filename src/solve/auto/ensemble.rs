//! One gap: experts predict it, simulated gaps judge them, and their mean weighed by that evidence fills it.

use super::features::{Features, Kind, Local, Spec, spread};
use super::frame::{Core, Pose};
use super::kriging::{Process, Smoothness};
use super::ridge::Sums;
use super::simulate::{Seen, Simulation};
use super::tracks::{Pairs, Tracks, UNKNOWN_MM};
use super::{Explanation, Recipe};
use crate::solve::Gap;
use nalgebra::{DMatrix, DVector};

/// Markers that make the local frame.
const CORE: usize = 5;

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
const COMBINED: usize = 16;

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
    /// Neighbours of a gap's marker, best first, and whether one of the most rigid ones is missing with it.
    fn order(&self, gap: &Gap) -> (Vec<usize>, bool) {
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
        let limb = rigid.iter().take(4).any(|r| r.1);
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
        let (mut order, limb) = self.order(gap);
        let offsets = context(scale);
        let edges = self.edges(gap, &offsets);
        let simulation = Simulation::new(seen, gap.frames());
        let specs: Vec<Spec> = self.recipe.specs(limb);
        let most = specs.iter().map(|s| s.neighbours).max().unwrap_or(0);
        order.truncate(most);
        if order.len() < 3 {
            order.clear();
        }

        // frames that take part
        let stride = ((3.0 * scale).round() as usize).max(1).max(seen.frames.len().div_ceil(ROWS));
        let learn: Vec<usize> = seen.frames.iter().copied().step_by(stride).collect();
        let inside: Vec<usize> = (gap.start..gap.end).collect();
        let positions: Vec<usize> = spread(simulation.frames, POSITIONS);
        let one_sided = |side: usize| edges.iter().any(|&t| if side == 0 { t < gap.start } else { t >= gap.end });
        let mut around: Vec<isize> = Vec::new();
        if one_sided(0) {
            around.extend(offsets.iter().rev().take(edges.iter().filter(|&&t| t < gap.start).count()).map(|&k| -(k as isize)));
            // the nearest ones are those that exist
            around = offsets.iter().take(around.len()).rev().map(|&k| -(k as isize)).collect();
        }
        if one_sided(1) {
            let count = edges.iter().filter(|&&t| t >= gap.end).count();
            around.extend(offsets.iter().take(count).map(|&k| (simulation.frames + k - 1) as isize));
        }
        let clamp = |t: isize| t.clamp(0, tracks.frames as isize - 1) as usize;
        let starts: Vec<(usize, usize)> =
            simulation.blocks.iter().enumerate().flat_map(|(b, block)| block.starts.iter().map(move |&s| (b, s))).collect();
        let judged: Vec<usize> = starts.iter().flat_map(|&(_, s)| positions.iter().map(move |&p| s + p)).collect();
        let beside: Vec<usize> = starts.iter().flat_map(|&(_, s)| around.iter().map(move |&k| clamp(s as isize + k))).collect();
        let mut wanted = vec![false; tracks.frames];
        for spec in &specs {
            for &t in learn.iter().chain(&inside).chain(&edges).chain(&judged).chain(&beside) {
                for u in Features::reach(spec.kind, t, tracks.frames, scale) {
                    wanted[u] = true;
                }
            }
        }
        let wanted: Vec<usize> = (0..tracks.frames).filter(|&t| wanted[t]).collect();
        let local = Local::new(tracks, &order, &wanted, self.poses(gap, &order, &wanted, &learn), &learn);
        let own = |t: usize| local.pose(t).to_local(tracks.place(t, gap.marker));
        let mut mean = [0.0; 3];
        for &t in &learn {
            let x = own(t);
            for axis in 0..3 {
                mean[axis] += x[axis] / learn.len() as f64;
            }
        }
        let target = |frames: &[usize]| {
            let values = frames.iter().flat_map(|&t| {
                let x = own(t);
                [x[0] - mean[0], x[1] - mean[1], x[2] - mean[2]]
            });
            DMatrix::from_iterator(3, frames.len(), values)
        };

        if simulation.count() < 4 {
            return self.without_evidence(gap, &edges, &local, mean);
        }

        // what was kriged: experts differ in how they carry what is left at the edges into the gap
        let times = |frames: &mut dyn Iterator<Item = isize>| frames.map(|t| t as f64).collect::<Vec<f64>>();
        let (edge_times, inside_times) = (times(&mut edges.iter().map(|&t| t as isize)), times(&mut inside.iter().map(|&t| t as isize)));
        let (around_times, position_times) = (times(&mut around.iter().copied()), times(&mut positions.iter().map(|&p| p as isize)));
        let kernels = if self.recipe.kriging { processes(scale).to_vec() } else { Vec::new() };
        let real: Vec<DMatrix<f64>> = kernels.iter().map(|k| k.weights(&edge_times, &inside_times)).collect();
        let simulated: Vec<DMatrix<f64>> = kernels.iter().map(|k| k.weights(&around_times, &position_times)).collect();

        let weight: Vec<f64> = judged.iter().map(|&t| if tracks.seen(t, gap.marker) { 1.0 } else { 0.0 }).collect();
        let total: f64 = weight.iter().sum();
        let noise = self.noise(gap, &order);
        let hidden: Vec<std::ops::Range<usize>> = simulation
            .blocks
            .iter()
            .map(|b| learn.partition_point(|&t| t < b.hidden.start)..learn.partition_point(|&t| t < b.hidden.end))
            .collect();
        let (learn_target, judged_target, beside_target, edge_target) = (target(&learn), target(&judged), target(&beside), target(&edges));

        let mut experts: Vec<Expert> = Vec::new();
        let mut groups: Vec<Vec<Spec>> = Vec::new();
        for spec in specs.iter().filter(|s| s.neighbours <= order.len()) {
            match groups.iter_mut().find(|g| g[0].kind == Kind::Linear && spec.kind == Kind::Linear) {
                Some(group) => group.push(*spec),
                None => groups.push(vec![*spec]),
            }
        }
        for group in &groups {
            let widest = group.iter().map(|s| s.neighbours).max().unwrap_or(0);
            let features = Features::new(&local, group[0].kind, widest, &learn, scale);
            let d = features.count();
            let learned = features.table(&learn);
            let mut table = DMatrix::zeros(d + 3, learn.len());
            table.rows_mut(0, d).copy_from(&learned);
            table.rows_mut(d, 3).copy_from(&learn_target);
            let sums = Sums::new(&table, &hidden);
            let (at_inside, at_edges) = (features.table(&inside), features.table(&edges));
            let (at_judged, at_beside) = (features.table(&judged), features.table(&beside));
            for spec in group {
                let used = if spec.kind == Kind::Linear { 1 + 3 * spec.neighbours } else { d };
                let mut noise_of = vec![0.0; used - 1];
                noise_of[..3 * spec.neighbours].copy_from_slice(&noise[..3 * spec.neighbours]);
                let Some(fit) = sums.fit(used, spec.prior, &noise_of, self.recipe.stiffness * scale / stride as f64) else { continue };
                let predict = |beta: &DMatrix<f64>, table: &DMatrix<f64>, from: usize, count: usize| {
                    beta.tr_mul(&table.view((0, from), (used, count)))
                };
                // what is left in and around the simulated gaps, out of block
                let (p, c) = (positions.len(), around.len());
                let mut left = judged_target.clone();
                let mut left_beside = beside_target.clone();
                for (n, &(block, _)) in starts.iter().enumerate() {
                    let beta = &fit.without[block];
                    left.columns_mut(n * p, p).zip_apply(&predict(beta, &at_judged, n * p, p), |x, y| *x -= y);
                    left_beside.columns_mut(n * c, c).zip_apply(&predict(beta, &at_beside, n * c, c), |x, y| *x -= y);
                }
                let plain = predict(&fit.all, &at_inside, 0, inside.len());
                let edge_left = &edge_target - predict(&fit.all, &at_edges, 0, edges.len());
                let doubt: f64 = (1..used).map(|k| noise_of[k - 1] * fit.all.row(k).norm_squared()).sum();
                for carry in 0..=kernels.len() {
                    let mut errors = left.clone();
                    let mut prediction = plain.clone();
                    if let Some(k) = carry.checked_sub(1) {
                        for n in 0..starts.len() {
                            let step = left_beside.columns(n * c, c) * &simulated[k];
                            errors.columns_mut(n * p, p).zip_apply(&step, |x, y| *x -= y);
                        }
                        prediction += &edge_left * &real[k];
                    }
                    for (mut column, w) in errors.column_iter_mut().zip(&weight) {
                        column *= *w;
                    }
                    let score = squares(errors.as_slice()) / total + doubt;
                    experts.push(Expert { spec: *spec, carry, prediction, errors, doubt, score });
                }
            }
        }
        if experts.is_empty() {
            return self.without_evidence(gap, &edges, &local, mean);
        }
        let combined = combine(&experts, &weight, total, if self.recipe.stacking { COMBINED } else { 1 });
        self.finish(gap, &order, &local, mean, &experts, &combined, &simulation, &positions, &weight)
    }

    /// Local frames of the gap's neighbours.
    fn poses(&self, gap: &Gap, order: &[usize], wanted: &[usize], learn: &[usize]) -> Vec<Pose> {
        if order.len() < 3 {
            return vec![Pose::world_frame(); wanted.len()];
        }
        let core = &order[..order.len().min(CORE)];
        let weights: Vec<f64> = core.iter().map(|&j| 1.0 / (0.3 + self.pairs.get(gap.marker, j).spread_mm)).collect();
        let first = self.sweep == 0;
        let trust = |sigma: f64| if first { 0.05 } else { 1.0 / (1.0 + sigma / 3.0) };
        let whole: Vec<usize> = learn.iter().copied().filter(|&t| core.iter().all(|&j| self.tracks.seen(t, j))).collect();
        let learn = if whole.len() >= 10 { &whole } else { learn };
        Core { tracks: self.tracks, markers: core, weights: &weights, trust: &trust }.poses(wanted, learn)
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
    fn without_evidence(&self, gap: &Gap, edges: &[usize], local: &Local, _mean: [f64; 3]) -> Filling {
        let own: Vec<[f64; 3]> = edges.iter().map(|&t| local.pose(t).to_local(self.tracks.place(t, gap.marker))).collect();
        let mean: [f64; 3] = std::array::from_fn(|axis| own.iter().map(|x| x[axis]).sum::<f64>() / own.len().max(1) as f64);
        let process = Process { smoothness: Smoothness::Once, scale: 32.0 * self.scale, nugget: 0.003 };
        let known: Vec<f64> = edges.iter().map(|&t| t as f64).collect();
        let wanted: Vec<f64> = (gap.start..gap.end).map(|t| t as f64).collect();
        let weights = process.weights(&known, &wanted);
        let places_mm = (gap.start..gap.end)
            .enumerate()
            .map(|(k, t)| {
                let x = std::array::from_fn(|axis| {
                    mean[axis] + own.iter().enumerate().map(|(e, x)| weights[(e, k)] * (x[axis] - mean[axis])).sum::<f64>()
                });
                local.pose(t).to_world(x)
            })
            .collect();
        Filling {
            places_mm,
            sigma_mm: vec![50.0; gap.frames()],
            likelihood: (0.0, 0),
            neighbours: Vec::new(),
            explanation: Explanation { gap: *gap, neighbours: Vec::new(), experts: Vec::new(), simulated: 0, simulated_frames: 0, predicted_mm: f64::NAN },
        }
    }

    /// From the combination to positions and standard deviations.
    #[allow(clippy::too_many_arguments)] // the last of a chain of steps
    fn finish(
        &self,
        gap: &Gap,
        order: &[usize],
        local: &Local,
        mean: [f64; 3],
        experts: &[Expert],
        combined: &Combination,
        simulation: &Simulation,
        positions: &[usize],
        weight: &[f64],
    ) -> Filling {
        let length = gap.frames();
        let p = positions.len();
        let mut prediction = DMatrix::zeros(3, length);
        let mut errors = DMatrix::zeros(3, weight.len());
        let mut doubt = 0.0;
        for &(e, share) in &combined.shares {
            prediction += &experts[e].prediction * share;
            errors += &experts[e].errors * share;
            doubt += experts[e].doubt * share;
        }
        // at each position: error of the combination, and how far experts are apart, over the simulated gaps
        let mut count = vec![0.0; p];
        let (mut square, mut apart) = (vec![0.0; p], vec![0.0; p]);
        for (n, w) in weight.iter().enumerate() {
            let at = n % p;
            count[at] += w;
            square[at] += squares(errors.column(n).as_slice());
            for &(e, share) in &combined.shares {
                apart[at] += share * (experts[e].errors.column(n) - errors.column(n)).norm_squared();
            }
        }
        let at_position: Vec<f64> = (0..p).map(|k| (square[k] / f64::max(count[k], 1.0) + doubt).sqrt()).collect();
        let apart: Vec<f64> = (0..p).map(|k| (apart[k] * p as f64 / weight.len() as f64).sqrt()).collect();
        let knots: Vec<f64> = positions.iter().map(|&x| x as f64).collect();
        let mut sigma_mm = Vec::with_capacity(length);
        let mut places_mm = Vec::with_capacity(length);
        for k in 0..length {
            let at = (k as f64 + 0.5) / length as f64 * simulation.frames as f64 - 0.5;
            let now = prediction.column(k);
            let spread: f64 = combined.shares.iter().map(|&(e, share)| share * (experts[e].prediction.column(k) - now).norm_squared()).sum();
            let usual = interpolate(&knots, &apart, at).max(0.05);
            let strange = if self.recipe.spread { (spread.sqrt() / usual).max(1.0) } else { 1.0 };
            sigma_mm.push(1.1 * interpolate(&knots, &at_position, at) * strange + 0.05);
            let x = [now[0] + mean[0], now[1] + mean[1], now[2] + mean[2]];
            places_mm.push(local.pose(gap.start + k).to_world(x));
        }
        let mut likelihood = (0.0, 0);
        for (n, w) in weight.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let variance = (1.1 * at_position[n % p] + 0.05).powi(2) / 3.0;
            likelihood.0 -= 1.5 * (std::f64::consts::TAU * variance).ln() + 0.5 * squares(errors.column(n).as_slice()) / variance;
            likelihood.1 += *w as usize;
        }
        let predicted_mm = (sigma_mm.iter().map(|s| s * s).sum::<f64>() / length as f64).sqrt();
        let explanation = Explanation {
            gap: *gap,
            neighbours: order.to_vec(),
            experts: combined.shares.iter().map(|&(e, share)| (experts[e].name(), share, experts[e].score.sqrt())).collect(),
            simulated: simulation.count(),
            simulated_frames: simulation.frames,
            predicted_mm,
        };
        Filling { places_mm, sigma_mm, likelihood, neighbours: order.to_vec(), explanation }
    }
}

/// What an expert says about the gap, and how it did on simulated ones.
struct Expert {
    spec: Spec,
    /// 0: nothing is carried in from the edges; else by that process.
    carry: usize,
    /// 3 × frames, local, relative to the mean, mm.
    prediction: DMatrix<f64>,
    /// 3 × judged samples, mm.
    errors: DMatrix<f64>,
    /// Variance from the noise of what it looks at, mm².
    doubt: f64,
    /// Mean square error with that, mm².
    score: f64,
}

impl Expert {
    fn name(&self) -> String {
        let kind = match self.spec.kind {
            Kind::Linear => "linear",
            Kind::Moving(_) => "moving",
            Kind::Bent(_) => "bent",
        };
        let carry = ["", "+8", "+16", "+32", "+48"][self.carry.min(4)];
        format!("{kind}{}{carry}", self.spec.neighbours)
    }
}

/// Shares of experts.
struct Combination {
    /// Expert and share; shares sum to 1.
    shares: Vec<(usize, f64)>,
}

/// The best mean of the best experts, by the covariance of their errors, shrunk strongly towards equal shares.
fn combine(experts: &[Expert], _weight: &[f64], total: f64, most: usize) -> Combination {
    let mut best: Vec<usize> = (0..experts.len()).collect();
    best.sort_by(|&a, &b| experts[a].score.total_cmp(&experts[b].score).then(a.cmp(&b)));
    best.truncate(most);
    let m = best.len();
    let mut covariance = DMatrix::from_fn(m, m, |a, b| {
        experts[best[a]].errors.dot(&experts[best[b]].errors) / total + if a == b { experts[best[a]].doubt } else { 0.0 }
    });
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
    Combination { shares: best.into_iter().zip(shares).collect() }
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
