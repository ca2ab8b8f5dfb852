//! The bone step over whole gaps: against processes written out, against an optimiser that knows only the cost, and on bones that cannot be met.

use crate::chance::Chance;
use crate::near;
use mocap_repair::solve::lds::step::band::{Block, End, Episode, MET_M, Neighbour, Tie, Time, Unknown, Vectors};
use nalgebra::{DMatrix, DVector, Vector3};

fn random(chance: &mut Chance, scale: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| scale * chance.normal())
}

/// `count` markers missing over `frames` frames, tied to a fixed marker and to each other in a chain; seen on both sides.
fn chain(chance: &mut Chance, count: usize, frames: usize, rho: f64) -> (Episode, Vectors) {
    let (variance, spread) = (0.01f64.powi(2), 0.004);
    let edges: Vec<[Vector3<f64>; 2]> = (0..count).map(|_| [random(chance, 0.01), random(chance, 0.01)]).collect();
    let ends: Vec<[f64; 2]> = (0..count).map(|_| [0.003 * chance.normal(), 0.003 * chance.normal()]).collect();
    let mut blocks = Vec::new();
    let mut start = Vec::new();
    for t in 0..frames {
        let beside = |i: usize, known: &dyn Fn(usize) -> Neighbour<Vector3<f64>>| {
            let before = if t == 0 { known(0) } else { Neighbour::Unknown(i) };
            let after = if t + 1 == frames { known(1) } else { Neighbour::Unknown(i) };
            (before, after)
        };
        let mut block = Block::default();
        for (i, edge) in edges.iter().enumerate() {
            let place = Vector3::new(0.3 * (i + 1) as f64, 0.05 * (0.2 * t as f64 + i as f64).sin(), 0.02 * t as f64 / frames as f64);
            let (before, after) = beside(i, &|side| Neighbour::Known(edge[side]));
            let expected = place + random(chance, 0.01);
            block.unknowns.push(Unknown { sample: i, expected, time: Time::new(variance, rho, before, after) });
            let other = if i == 0 { End::Fixed(Vector3::new(0.0, 0.0, 0.01 * t as f64 / frames as f64)) } else { End::Free(i - 1) };
            let before = if t == 0 { Neighbour::Known(ends[i][0]) } else { Neighbour::Unknown(i) };
            let after = if t + 1 == frames { Neighbour::Known(ends[i][1]) } else { Neighbour::Unknown(i) };
            block.ties.push(Tie { ends: [End::Free(i), other], length: 0.31, time: Time::new(spread * spread, rho, before, after) });
        }
        start.push(block.unknowns.iter().map(|u| u.expected).collect());
        blocks.push(block);
    }
    (Episode { blocks }, start)
}

/// Without bones the step is the expectation of the process given both edges.
#[test]
fn without_bones_the_residual_is_a_bridge() {
    for (seed, frames, rho) in [(1, 1, 0.7), (2, 9, 0.9), (3, 40, 0.99), (4, 12, 0.05)] {
        let mut chance = Chance::new(seed);
        let (a, b) = (random(&mut chance, 0.01), random(&mut chance, 0.01));
        let blocks = (0..frames)
            .map(|t| {
                let before = if t == 0 { Neighbour::Known(a) } else { Neighbour::Unknown(0) };
                let after = if t + 1 == frames { Neighbour::Known(b) } else { Neighbour::Unknown(0) };
                let time = Time::new(1e-4, rho, before, after);
                Block { unknowns: vec![Unknown { sample: t, expected: Vector3::new(1.0, t as f64, 0.0), time }], ties: Vec::new() }
            })
            .collect();
        let episode = Episode { blocks };
        let found = episode.soft(vec![vec![Vector3::zeros()]; frames], 60);
        // the dense Gaussian: covariances rho^|s - t|
        let kernel = |s: f64, t: f64| f64::powf(rho, (s - t).abs());
        let last = frames as f64;
        let across = kernel(-1.0, last);
        for (t, found) in found.iter().enumerate() {
            let (near_a, near_b) = (kernel(t as f64, -1.0), kernel(t as f64, last));
            let rest = 1.0 - across * across;
            let expected = a * ((near_a - across * near_b) / rest) + b * ((near_b - across * near_a) / rest);
            let off = found[0] - Vector3::new(1.0, t as f64, 0.0) - expected;
            assert!(off.amax() < 1e-9, "{frames} frames, rho {rho}: frame {t} off by {off}");
        }
    }
}

/// The quadratic form that `Time` writes down is the inverse of the covariance of the process given its edges.
#[test]
fn a_process_has_the_precision_of_its_covariance() {
    let (frames, rho, variance) = (7, 0.8f64, 2.5);
    for (open_before, open_after) in [(false, false), (true, false), (false, true), (true, true)] {
        let edge = |open: bool| if open { Neighbour::None } else { Neighbour::Known(0.0) };
        let mut precision = DMatrix::zeros(frames, frames);
        for t in 0..frames {
            let before = if t == 0 { edge(open_before) } else { Neighbour::Unknown(0) };
            let after = if t + 1 == frames { edge(open_after) } else { Neighbour::Unknown(0) };
            let time: Time<f64> = Time::new(variance, rho, before, after);
            precision[(t, t)] = time.own;
            if t > 0 {
                precision[(t, t - 1)] = -time.link;
                precision[(t - 1, t)] = -time.link;
            }
        }
        let all = DMatrix::from_fn(frames + 2, frames + 2, |r, c| variance * rho.powf((r as f64 - c as f64).abs()));
        let inner = all.view((1, 1), (frames, frames)).into_owned();
        let known: Vec<usize> = [(0, open_before), (frames + 1, open_after)].iter().filter(|(_, open)| !open).map(|(k, _)| *k).collect();
        let cross = all.select_columns(&known).rows(1, frames).into_owned();
        let edges = all.select_rows(&known).select_columns(&known);
        let given = if known.is_empty() { inner } else { inner - &cross * edges.try_inverse().unwrap() * cross.transpose() };
        let product = precision * given;
        assert!((product - DMatrix::<f64>::identity(frames, frames)).amax() < 1e-9, "{open_before} {open_after}");
    }
}

/// Soft bones: no small change of the solution costs less, and a descent that knows only the cost, begun elsewhere, ends no lower.
#[test]
fn soft_bones_end_where_the_cost_is_least() {
    for (seed, count, frames, rho) in [(1, 1, 5, 0.6), (2, 2, 8, 0.9), (3, 3, 4, 0.95), (4, 2, 1, 0.5)] {
        let mut chance = Chance::new(seed);
        let (episode, start) = chain(&mut chance, count, frames, rho);
        let found = episode.soft(start.clone(), 200);
        let residuals = |positions: &Vectors| -> Vectors {
            let less = |(block, own): (&Block, &Vec<Vector3<f64>>)| block.unknowns.iter().zip(own).map(|(u, x)| x - u.expected).collect();
            episode.blocks.iter().zip(positions).map(less).collect()
        };
        let flat = |positions: &Vectors| -> Vec<f64> { positions.iter().flatten().flat_map(|x| x.iter().copied()).collect() };
        let cost = |x: &[f64]| {
            let mut values = x.chunks_exact(3).map(Vector3::from_column_slice);
            let positions: Vectors = start.iter().map(|own| own.iter().map(|_| values.next().unwrap()).collect()).collect();
            episode.cost(&residuals(&positions))
        };
        let best = cost(&flat(&found));
        for _ in 0..200 {
            let scale = [1e-3, 1e-4, 1e-5][chance.between(0.0, 3.0) as usize % 3];
            let moved: Vec<f64> = flat(&found).iter().map(|x| x + scale * chance.normal()).collect();
            assert!(cost(&moved) > best - 1e-3, "seed {seed}: a move of {scale} m gains {}", best - cost(&moved));
        }
        // nonlinear conjugate directions by coordinates: slow, and knows nothing of bones
        let mut x: Vec<f64> = flat(&start).iter().map(|x| x + 0.003 * chance.normal()).collect();
        let mut pace = vec![1e-3; x.len()];
        let mut value = cost(&x);
        for _ in 0..3000 {
            for k in 0..x.len() {
                for sign in [1.0, -1.0] {
                    let before = x[k];
                    x[k] += sign * pace[k];
                    let now = cost(&x);
                    if now < value {
                        value = now;
                        pace[k] *= 1.6;
                        break;
                    }
                    x[k] = before;
                    if sign < 0.0 {
                        pace[k] *= 0.5;
                    }
                }
                pace[k] = pace[k].max(1e-9);
            }
        }
        assert!(best <= value + 1e-2, "seed {seed}: settled at {best}, a search by coordinates at {value}");
    }
}

/// Hard bones that can be met are met, and among the positions that meet them the found one is nearest to what is expected: moves along the constraints cost more.
#[test]
fn hard_bones_are_met_over_whole_gaps() {
    for (seed, count, frames) in [(1, 1, 10), (2, 2, 6), (3, 3, 5)] {
        let mut chance = Chance::new(seed);
        let (episode, start) = chain(&mut chance, count, frames, 0.9);
        let (found, violation) = episode.hard(start);
        assert!(violation < MET_M, "seed {seed}: off by {violation} m");
        let n = 3 * count * frames;
        // constraints and slope of the rest of the cost by differences
        let free = {
            let mut free = episode.clone();
            for block in &mut free.blocks {
                block.ties.clear();
            }
            free
        };
        let flat: Vec<f64> = found.iter().flatten().flat_map(|x| x.iter().copied()).collect();
        let residuals = |x: &[f64]| -> Vectors {
            let mut values = x.chunks_exact(3).map(Vector3::from_column_slice);
            episode.blocks.iter().map(|b| b.unknowns.iter().map(|u| values.next().unwrap() - u.expected).collect()).collect()
        };
        let lengths = |x: &[f64]| -> Vec<f64> {
            episode
                .blocks
                .iter()
                .zip(residuals(x))
                .flat_map(|(b, own)| b.ties.iter().map(|tie| b.off(tie, &own)).collect::<Vec<_>>())
                .collect()
        };
        let step = 1e-6;
        let mut slope = DVector::zeros(n);
        let mut directions = DMatrix::zeros(n, count * frames);
        for k in 0..n {
            let at = |sign: f64| {
                let mut moved = flat.clone();
                moved[k] += sign * step;
                (free.cost(&residuals(&moved)), lengths(&moved))
            };
            let ((up, long), (down, short)) = (at(1.0), at(-1.0));
            slope[k] = (up - down) / (2.0 * step);
            for (row, (a, b)) in long.iter().zip(&short).enumerate() {
                directions[(k, row)] = (a - b) / (2.0 * step);
            }
        }
        let left = &slope - &directions * directions.clone().svd(true, true).solve(&slope, 1e-9).unwrap();
        assert!(left.norm() < 1e-3 * slope.norm(), "seed {seed}: {} of {} is left", left.norm(), slope.norm());
    }
}

fn lone(expected: Vector3<f64>, fixed: &[(Vector3<f64>, f64)]) -> Episode {
    let time = Time { own: 1e4, ..Time::default() };
    let tie = |(x, length): &(Vector3<f64>, f64)| Tie {
        ends: [End::Free(0), End::Fixed(*x)],
        length: *length,
        time: Time { own: 1e6, ..Time::default() },
    };
    Episode { blocks: vec![Block { unknowns: vec![Unknown { sample: 0, expected, time }], ties: fixed.iter().map(tie).collect() }] }
}

/// Bones that contradict each other or what was seen: the violation is shared as least squares share it, and is reported; nothing hangs, nothing is NaN.
#[test]
fn bones_that_cannot_be_met_end_in_the_least_violation() {
    let x = Vector3::new;
    // the seen ends are 1 m apart, the bones 0.4 m and 0.4 m long: 0.1 m is missing on each side
    let (found, violation) =
        lone(x(0.45, 0.02, 0.0), &[(x(0.0, 0.0, 0.0), 0.4), (x(1.0, 0.0, 0.0), 0.4)]).hard(vec![vec![x(0.45, 0.02, 0.0)]]);
    assert!((found[0][0] - x(0.5, 0.0, 0.0)).amax() < 0.01, "{}", found[0][0]);
    near("the violation", violation, 0.1, 1e-2);
    // the same bone twice, with two lengths
    let (found, violation) = lone(x(0.5, 0.0, 0.0), &[(x(0.0, 0.0, 0.0), 0.4), (x(0.0, 0.0, 0.0), 0.5)]).hard(vec![vec![x(0.5, 0.0, 0.0)]]);
    assert!((found[0][0].norm() - 0.45).abs() < 1e-2 && (violation - 0.05).abs() < 1e-2, "{} {violation}", found[0][0]);
    // redundant: the same bone three times
    let same = (x(0.0, 0.0, 0.0), 0.4);
    let (found, violation) = lone(x(0.5, 0.1, 0.0), &[same, same, same]).hard(vec![vec![x(0.5, 0.1, 0.0)]]);
    assert!(violation < MET_M && (found[0][0].norm() - 0.4).abs() < MET_M, "{violation}");
    // collinear and just within reach: the constraint surfaces touch
    let (_, violation) = lone(x(0.4, 0.05, 0.0), &[(x(0.0, 0.0, 0.0), 0.5), (x(1.0, 0.0, 0.0), 0.5)]).hard(vec![vec![x(0.4, 0.05, 0.0)]]);
    assert!(violation < 1e-3, "{violation}");
    // begun in the very place of the other end, which has no direction
    let (found, _) = lone(x(0.0, 0.0, 0.0), &[(x(0.0, 0.0, 0.0), 0.4)]).hard(vec![vec![x(0.0, 0.0, 0.0)]]);
    assert!(found[0][0].iter().all(|x| x.is_finite()));
    // six bones at one marker, consistent
    let truth = x(0.1, 0.2, 0.3);
    let mut chance = Chance::new(5);
    let seen: Vec<(Vector3<f64>, f64)> = (0..6).map(|_| random(&mut chance, 0.5)).map(|p| (p, (truth - p).norm())).collect();
    let begin = truth + x(0.02, -0.01, 0.015);
    let (found, violation) = lone(begin, &seen).hard(vec![vec![begin]]);
    assert!(violation < MET_M && (found[0][0] - truth).amax() < 1e-5, "{violation} {}", found[0][0]);
}
