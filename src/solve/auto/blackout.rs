//! Black-outs: (nearly) every marker of a body is missing at once, so nothing but time is left to predict from.
//!
//! Experts are smooth curves of several time scales through the frames on both sides (kriging about the line across the gap), and *analogs*: other
//! runs of the same take whose frames on both sides look alike after a rigid alignment, in position and in velocity, lend what the curve left of them.
//! All are judged on runs of the take that are treated as if they were black-outs themselves, those alike counting more; the judgement is
//! half common to all markers and half each marker's own.

use super::Explanation;
use super::alike::{apart, looks, neighbourhood, normalised, velocity_pairs};
use super::dark::Blackout;
use super::ensemble::{Filling, context};
use super::features::spread;
use super::frame::nearest;
use super::kriging::{Process, Smoothness};
use super::stack::interpolate;
use super::tracks::{Tracks, distance};
use crate::solve::Gap;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use rayon::prelude::*;

/// Length scale (frames at 120 Hz) and share of noise of the curves; before them comes the straight line.
const CURVES: [(f64, f64); 5] = [(24.0, 1e-4), (24.0, 1e-6), (48.0, 1e-6), (96.0, 1e-7), (48.0, 1e-8)];

/// Reach of the context on both sides that is tried in turn, frames at 120 Hz.
const REACHES: [f64; 2] = [24.0, 12.0];

/// Fewer runs than this say nothing.
const LEAST_RUNS: usize = 16;

/// Runs that lend, and runs that are treated as black-outs, at most.
const MOST_RUNS: usize = 400;
const MOST_TESTS: usize = 60;

/// Frames inside a run at which errors are taken, at most.
const POSITIONS: usize = 8;

/// Curves from which analogs start.
const STARTS: usize = 3;

/// Widths of the analogs' weights, relative to the least distance: one for the whole body, three for each marker's surroundings.
const WHOLE_WIDTHS: [f64; 1] = [0.6];
const LOCAL_WIDTHS: [f64; 3] = [0.4, 0.6, 0.9];

/// Effective number of tests that decide.
const EFFECTIVE: f64 = 8.0;

/// How far the strangeness of tests may be from that of the black-out, as a logarithm of distances.
const STRANGENESS: f64 = 0.5;

/// Shrinkage of the error covariance towards equal shares.
const SHRINKAGE: f64 = 0.3;

/// Errors on tests against those in real black-outs, measured over several hundred of them: runs near a test may not lend to it.
const PESSIMISM: f64 = 0.9;

/// Weights below this count for nothing.
const NOTHING: f64 = 1e-4;

/// Frames around a run, relative to its first frame, ascending; `before` of them lie before it.
pub struct Context {
    /// Those frames.
    pub offsets: Vec<isize>,
    /// How many lie before it.
    pub before: usize,
}

impl Context {
    fn new(before: &[usize], after: &[usize], length: usize) -> Self {
        let mut offsets: Vec<isize> = before.iter().rev().map(|&k| -(k as isize)).collect();
        offsets.extend(after.iter().map(|&k| (length + k - 1) as isize));
        Self { offsets, before: before.len() }
    }

    fn times(&self) -> Vec<f64> {
        self.offsets.iter().map(|&k| k as f64).collect()
    }
}

/// The straight line, and curves of several scales.
pub fn curve_kinds(scale: f64) -> Vec<Option<Process>> {
    let process = |&(frames, nugget): &(f64, f64)| Some(Process { smoothness: Smoothness::Twice, scale: frames * scale, nugget });
    std::iter::once(None).chain(CURVES.iter().map(process)).collect()
}

/// The weights of a curve: context × wanted frames (relative to the first of the run).
pub fn curve(context: &Context, wanted: &[f64], length: usize, process: Option<Process>) -> DMatrix<f64> {
    let known = context.times();
    let line = |times: &[f64]| {
        let mut weights = DMatrix::zeros(known.len(), times.len());
        for (column, t) in times.iter().enumerate() {
            let share = (t + 1.0) / (length + 1) as f64;
            weights[(context.before - 1, column)] = 1.0 - share;
            weights[(context.before, column)] = share;
        }
        weights
    };
    let straight = line(wanted);
    let Some(process) = process else { return straight };
    let about = DMatrix::identity(known.len(), known.len()) - line(&known);
    straight + about * process.weights(&known, wanted)
}

/// All markers in the frames of a run and around it: frames × (3 markers), flat.
fn cut(tracks: &Tracks, markers: &[usize], start: usize, offsets: &[isize]) -> Vec<f64> {
    offsets.iter().flat_map(|&k| markers.iter().flat_map(move |&i| tracks.place((start as isize + k) as usize, i))).collect()
}

fn centroid(flat: &[f64]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for x in flat.chunks_exact(3) {
        for axis in 0..3 {
            sum[axis] += x[axis];
        }
    }
    sum.map(|s| s / (flat.len() / 3).max(1) as f64)
}

/// `out += share × from`
fn add(out: &mut [f64], share: f64, from: &[f64]) {
    crate::solve::kernel::axpy(out, share, from);
}

/// Rows (context or positions) × width, from `weights` (context × rows) and the context's rows.
fn apply(weights: &DMatrix<f64>, context: &[f64], width: usize) -> Vec<f64> {
    let mut out = vec![0.0; weights.ncols() * width];
    for (row, column) in out.chunks_exact_mut(width).zip(weights.column_iter()) {
        for (&w, from) in column.iter().zip(context.chunks_exact(width)) {
            add(row, w, from);
        }
    }
    out
}

/// Fills one black-out: one filling for each marker of the body, over all its frames. `dark` are all dark frames of the body.
pub fn fill(tracks: &Tracks, blackout: &Blackout, dark: &[bool], scale: f64, analogs: bool) -> Vec<Filling> {
    let (start, end) = (blackout.start, blackout.end);
    let length = end - start;
    let markers = &blackout.markers;
    let (frames, m) = (tracks.frames, markers.len());
    let width = 3 * m;
    let offsets = context(scale);
    let mut darker = vec![0u32; frames + 1];
    for t in 0..frames {
        darker[t + 1] = darker[t] + u32::from(dark[t]);
    }
    let clear = |from: usize, to: usize| darker[to] == darker[from];
    let mut chosen: Option<(Context, Vec<usize>)> = None;
    for reach in REACHES {
        let reach = (reach * scale).round().max(1.0) as usize;
        let before: Vec<usize> = offsets.iter().copied().filter(|&k| k <= reach.min(start)).collect();
        let after: Vec<usize> = offsets.iter().copied().filter(|&k| k <= reach.min(frames - end)).collect();
        let (Some(&first), Some(&last)) = (before.last(), after.last()) else { continue };
        if !clear(start - first, start) || !clear(end, end + last) {
            continue;
        }
        let runs: Vec<usize> =
            (first..(frames + 1).saturating_sub(length + last)).filter(|&a| clear(a - first, a + length + last)).collect();
        if runs.len() >= LEAST_RUNS {
            chosen = Some((Context::new(&before, &after, length), runs));
            break;
        }
    }
    let inside: Vec<f64> = (0..length).map(|k| k as f64).collect();
    let Some((context, runs)) = chosen else {
        return alone(tracks, blackout, dark, scale);
    };
    let positions = spread(length, POSITIONS);
    let at: Vec<f64> = positions.iter().map(|&p| p as f64).collect();
    let curves = curve_kinds(scale);
    let whole: Vec<DMatrix<f64>> = curves.iter().map(|&c| curve(&context, &inside, length, c)).collect();
    let some: Vec<DMatrix<f64>> = curves.iter().map(|&c| curve(&context, &at, length, c)).collect();

    // every run, aligned with the black-out's context
    let nr = context.offsets.len();
    let target = cut(tracks, markers, start, &context.offsets);
    let middle = centroid(&target);
    let target_centred: Vec<f64> = target.iter().enumerate().map(|(k, x)| x - middle[k % 3]).collect();
    let stride = if runs.len() > 60 { runs.len().div_ceil(MOST_RUNS).max(2) } else { 1 };
    let runs: Vec<usize> = runs.into_iter().step_by(stride).collect();
    let mut rows = context.offsets.clone();
    rows.extend(positions.iter().map(|&p| p as isize));
    let aligned: Vec<Vec<f64>> = runs
        .par_iter()
        .map(|&a| {
            let mut own = cut(tracks, markers, a, &rows);
            let centre = centroid(&own[..nr * width]);
            let mut product = Matrix3::zeros();
            for (x, y) in own[..nr * width].chunks_exact(3).zip(target_centred.chunks_exact(3)) {
                let x = Vector3::new(x[0] - centre[0], x[1] - centre[1], x[2] - centre[2]);
                product += Vector3::new(y[0], y[1], y[2]) * x.transpose();
            }
            let turn = nearest(&product);
            for x in own.chunks_exact_mut(3) {
                let y = turn * Vector3::new(x[0] - centre[0], x[1] - centre[1], x[2] - centre[2]);
                x.copy_from_slice(y.as_slice());
            }
            own
        })
        .collect();
    let tests = spread(runs.len(), MOST_TESTS);
    let p = positions.len();

    // plain curves on the tests
    let error_of = |weights: &DMatrix<f64>, run: &[f64]| -> Vec<f64> {
        let said = apply(weights, &run[..nr * width], width);
        run[nr * width..].iter().zip(said).map(|(x, y)| x - y).collect()
    };
    // expert × test × (positions × width)
    let mut errors: Vec<Vec<Vec<f64>>> =
        some.iter().map(|weights| tests.par_iter().map(|&n| error_of(weights, &aligned[n])).collect()).collect();
    let mut names: Vec<String> = curves.iter().map(|c| c.map_or("line".to_owned(), |c| format!("curve{:.0}", c.scale / scale))).collect();
    let mut predictions: Vec<Vec<f64>> = whole.iter().map(|weights| apply(weights, &target, width)).collect();

    // how alike runs are: each test against all, and the black-out itself last
    let velocity_pairs = velocity_pairs(&context, scale, length);
    let look = |flat: &[f64]| looks(flat, &context, &velocity_pairs, width);
    let all_looks: Vec<Vec<f64>> = aligned.par_iter().map(|run| look(&run[..nr * width])).collect();
    let own_look = look(&target_centred);
    let near = length as f64 + 8.0 * scale;
    let neighbourhood = neighbourhood(&target, nr, m);
    let judged: Vec<Option<usize>> = tests.iter().copied().map(Some).chain([None]).collect();
    let alike: Vec<(Vec<f64>, Vec<Vec<f64>>)> = judged
        .par_iter()
        .map(|&test| {
            let from = test.map_or(&own_look, |n| &all_looks[n]);
            let mut global = Vec::with_capacity(runs.len());
            let mut local = vec![Vec::with_capacity(runs.len()); m];
            for (n, other) in all_looks.iter().enumerate() {
                let far = if test.is_some_and(|test| (runs[n].abs_diff(runs[test]) as f64) < near) { 1e12 } else { 0.0 };
                let own = apart(from, other, m);
                global.push(own.iter().sum::<f64>() / m as f64 + far);
                for (local, weights) in local.iter_mut().zip(neighbourhood.chunks_exact(m)) {
                    local.push(crate::solve::kernel::dot(weights, &own) + far);
                }
            }
            (global, local)
        })
        .collect();
    let distances_of_tests: Vec<f64> = tests.iter().map(|&n| alike[tests.len()].0[n]).collect();

    if analogs {
        let mut order: Vec<usize> = (0..curves.len()).collect();
        let square = |e: usize| errors[e].iter().flatten().map(|x| x * x).sum::<f64>();
        let squares: Vec<f64> = (0..curves.len()).map(square).collect();
        order.sort_by(|&a, &b| squares[a].total_cmp(&squares[b]).then(a.cmp(&b)));
        let spline = through(&at, length);
        for &base in order.iter().take(STARTS) {
            let left: Vec<Vec<f64>> = aligned.par_iter().map(|run| error_of(&some[base], run)).collect();
            let count = WHOLE_WIDTHS.len() + LOCAL_WIDTHS.len();
            // for each test and the black-out: what the analogs lend, expert by expert
            let lent: Vec<Vec<Vec<f64>>> = alike
                .par_iter()
                .map(|(global, local)| {
                    let mut out = vec![vec![0.0; p * width]; count];
                    for (out, &h) in out.iter_mut().zip(&WHOLE_WIDTHS) {
                        for (w, left) in normalised(global, h).into_iter().zip(&left).filter(|(w, _)| *w > NOTHING) {
                            add(out, w, left);
                        }
                    }
                    for (out, &h) in out[WHOLE_WIDTHS.len()..].iter_mut().zip(&LOCAL_WIDTHS) {
                        for (i, local) in local.iter().enumerate() {
                            for (w, left) in normalised(local, h).into_iter().zip(&left).filter(|(w, _)| *w > NOTHING) {
                                for k in 0..p {
                                    let place = k * width + 3 * i;
                                    add(&mut out[place..place + 3], w, &left[place..place + 3]);
                                }
                            }
                        }
                    }
                    out
                })
                .collect();
            for (expert, own) in lent[tests.len()].iter().enumerate() {
                let shape = apply(&spline, own, width);
                let mut prediction = predictions[base].clone();
                add(&mut prediction, 1.0, &shape);
                predictions.push(prediction);
                let of_tests =
                    (0..tests.len()).map(|r| errors[base][r].iter().zip(&lent[r][expert]).map(|(e, l)| e - l).collect()).collect();
                errors.push(of_tests);
                names.push(format!("analog{}-{}", expert + 1, names[base]));
            }
        }
    }

    // tests that look like the black-out decide, and that are as far from everything else as it is
    let strangeness: Vec<f64> =
        alike.iter().map(|(global, _)| global.iter().copied().fold(f64::INFINITY, f64::min).max(1e-9).ln() * 0.5).collect();
    let mut width_of_tests = 1.0;
    let weights = loop {
        let mut weights = normalised(&distances_of_tests, width_of_tests);
        for (w, s) in weights.iter_mut().zip(&strangeness) {
            *w *= (-0.5 * ((s - strangeness[tests.len()]) / STRANGENESS).powi(2)).exp() + 1e-6;
        }
        let sum: f64 = weights.iter().sum();
        for w in &mut weights {
            *w /= sum;
        }
        let effective = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        if effective >= EFFECTIVE.min(0.5 * tests.len() as f64) || width_of_tests > 1e3 {
            break weights;
        }
        width_of_tests *= 1.2;
    };
    let e = errors.len();
    let own_covariance: Vec<DMatrix<f64>> = (0..m)
        .into_par_iter()
        .map(|i| {
            let mut covariance = DMatrix::zeros(e, e);
            for (r, w) in weights.iter().enumerate().filter(|(_, w)| **w > NOTHING) {
                let table = DMatrix::from_fn(3 * p, e, |k, a| errors[a][r][(k / 3) * width + 3 * i + k % 3]);
                covariance.gemm_tr(*w, &table, &table, 1.0);
            }
            covariance
        })
        .collect();
    let mut common = DMatrix::zeros(e, e);
    for own in &own_covariance {
        common += own / m as f64;
    }
    let knots: Vec<f64> = std::iter::once(-1.0).chain(at.iter().copied()).chain([length as f64]).collect();
    (0..m)
        .into_par_iter()
        .map(|i| {
            let mut covariance = (&common + &own_covariance[i]) * 0.5;
            let ridge = SHRINKAGE * covariance.trace() / e as f64 + 1e-9;
            for k in 0..e {
                covariance[(k, k)] += ridge;
            }
            let ones = DVector::from_element(e, 1.0);
            let mut shares: Vec<f64> = covariance.cholesky().map_or(vec![1.0; e], |c| c.solve(&ones).iter().map(|x| x.max(0.0)).collect());
            let sum: f64 = shares.iter().sum();
            for s in &mut shares {
                *s /= sum;
            }
            let mut places_mm = vec![[0.0; 3]; length];
            for (share, prediction) in shares.iter().zip(&predictions) {
                for (k, place) in places_mm.iter_mut().enumerate() {
                    for (axis, x) in place.iter_mut().enumerate() {
                        *x += share * prediction[k * width + 3 * i + axis];
                    }
                }
            }
            let mut squares = vec![0.0; p];
            let mut likelihood = (0.0, 0);
            let combined = |r: usize, k: usize| -> f64 {
                (0..3).map(|axis| shares.iter().zip(&errors).map(|(s, e)| s * e[r][k * width + 3 * i + axis]).sum::<f64>().powi(2)).sum()
            };
            for (r, w) in weights.iter().enumerate() {
                for (k, square) in squares.iter_mut().enumerate() {
                    *square += w * combined(r, k);
                }
            }
            for (k, square) in squares.iter().enumerate() {
                let variance = (square / 3.0).max(1e-3);
                for r in 0..tests.len() {
                    likelihood.0 -= 1.5 * (std::f64::consts::TAU * variance).ln() + 0.5 * combined(r, k) / variance;
                    likelihood.1 += 1;
                }
            }
            let errors_at: Vec<f64> = std::iter::once(0.0).chain(squares.iter().map(|s| s.sqrt())).chain([0.0]).collect();
            let sigma_mm: Vec<f64> = inside.iter().map(|&k| PESSIMISM * interpolate(&knots, &errors_at, k) + 0.05).collect();
            let predicted_mm = (sigma_mm.iter().map(|s| s * s).sum::<f64>() / length as f64).sqrt();
            let score = |a: usize| covariance_of(&common, a, p);
            let mut experts: Vec<(String, f64, f64)> =
                names.iter().cloned().zip(&shares).enumerate().map(|(a, (name, &share))| (name, share, score(a))).collect();
            experts.retain(|x| x.1 > 0.0);
            experts.sort_by(|x, y| y.1.total_cmp(&x.1));
            let gap = Gap { marker: markers[i], start, end };
            let explanation =
                Explanation { gap, neighbours: Vec::new(), experts, simulated: tests.len(), simulated_frames: length, predicted_mm };
            Filling { places_mm, sigma_mm, likelihood, neighbours: Vec::new(), explanation }
        })
        .collect()
}

/// Root mean square error of an expert over all markers, mm, from the covariance of sums over so many positions.
fn covariance_of(common: &DMatrix<f64>, expert: usize, positions: usize) -> f64 {
    (common[(expert, expert)] / positions as f64).sqrt()
}

/// The natural cubic spline through zero at both edges and values at the positions: positions × frames.
fn through(at: &[f64], length: usize) -> DMatrix<f64> {
    let knots: Vec<f64> = std::iter::once(-1.0).chain(at.iter().copied()).chain([length as f64]).collect();
    let mut out = DMatrix::zeros(at.len(), length);
    for k in 0..at.len() {
        let mut values = vec![0.0; knots.len()];
        values[k + 1] = 1.0;
        let bends = crate::solve::interpolate::bends(&knots, &values);
        for t in 0..length {
            out[(k, t)] = crate::solve::interpolate::spline_at(&knots, &values, &bends, t as f64);
        }
    }
    out
}

/// Nothing to compare with: a mean of two curves through whatever was seen on both sides; at an end of the take the last frame is held.
fn alone(tracks: &Tracks, blackout: &Blackout, dark: &[bool], scale: f64) -> Vec<Filling> {
    let (start, end) = (blackout.start, blackout.end);
    let length = end - start;
    let offsets = context(scale);
    let before: Vec<usize> = offsets.iter().copied().filter(|&k| k <= start && !dark[start - k]).collect();
    let after: Vec<usize> = offsets.iter().copied().filter(|&k| end + k <= tracks.frames && !dark[end + k - 1]).collect();
    let inside: Vec<f64> = (0..length).map(|k| k as f64).collect();
    let two_sided = !before.is_empty() && !after.is_empty();
    let context = Context::new(&before, &after, length);
    let curves: Vec<DMatrix<f64>> = if two_sided {
        let process = |frames: f64, nugget| Some(Process { smoothness: Smoothness::Twice, scale: frames * scale, nugget });
        [None, process(24.0, 1e-4), process(24.0, 1e-6), process(48.0, 1e-6)].map(|c| curve(&context, &inside, length, c)).to_vec()
    } else {
        Vec::new()
    };
    let one = |&i: &usize| {
        let track: Vec<f64> = context
            .offsets
            .iter()
            .flat_map(|&k| tracks.place((start as isize + k).clamp(0, tracks.frames as isize - 1) as usize, i))
            .collect();
        let mut places_mm = Vec::with_capacity(length);
        let mut sigma_mm = Vec::with_capacity(length);
        if two_sided {
            let said: Vec<Vec<f64>> = curves.iter().map(|c| apply(c, &track, 3)).collect();
            for k in 0..length {
                let at = |c: usize| [0, 1, 2].map(|axis| said[c][3 * k + axis]);
                let (a, b) = (at(2), at(3));
                places_mm.push([0, 1, 2].map(|axis| 0.5 * (a[axis] + b[axis])));
                sigma_mm.push(distance(b, at(1)) + 0.35 * distance(b, at(0)) + 0.5);
            }
        } else {
            let edge = if before.is_empty() { end.min(tracks.frames - 1) } else { start - 1 };
            for k in 0..length {
                places_mm.push(tracks.place(edge, i));
                sigma_mm.push(5.0 * (start + k).abs_diff(edge) as f64 / scale);
            }
        }
        let predicted_mm = (sigma_mm.iter().map(|s| s * s).sum::<f64>() / length as f64).sqrt();
        let explanation = Explanation {
            gap: Gap { marker: i, start, end },
            neighbours: Vec::new(),
            experts: vec![(if two_sided { "curves" } else { "held" }.to_owned(), 1.0, f64::NAN)],
            simulated: 0,
            simulated_frames: 0,
            predicted_mm,
        };
        Filling { places_mm, sigma_mm, likelihood: (0.0, 0), neighbours: Vec::new(), explanation }
    };
    blackout.markers.iter().map(one).collect()
}
