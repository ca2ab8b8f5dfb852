//! Bones: what experts filled is moved a little, so that distances are as they were seen.

use super::tracks::{Pairs, Tracks, distance};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

const PER_MARKER: usize = 4;
const MOST_SPREAD_MM: f64 = 25.0;
const MOST_DISTANCE_MM: f64 = 500.0;
const LEAST_TOGETHER: usize = 30;
const WEIGHT: f64 = 0.2;

fn partners(pairs: &Pairs, tracks: &Tracks) -> Vec<Vec<usize>> {
    let m = tracks.markers;
    let mut joined = vec![vec![false; m]; m];
    for i in (0..m).filter(|&i| tracks.live(i)) {
        let mut scored: Vec<(f64, usize)> = (0..m)
            .filter(|&j| j != i && tracks.live(j))
            .filter(|&j| {
                let p = pairs.get(i, j);
                p.together >= LEAST_TOGETHER && p.distance_mm < MOST_DISTANCE_MM && p.spread_mm < MOST_SPREAD_MM
            })
            .map(|j| (pairs.get(i, j).spread_mm, j))
            .collect();
        scored.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (_, j) in scored.into_iter().take(PER_MARKER) {
            joined[i][j] = true;
            joined[j][i] = true;
        }
    }
    joined.into_iter().map(|row| (0..m).filter(|&j| row[j]).collect()).collect()
}

/// Moves filled samples.
pub fn adjust(tracks: &mut Tracks, pairs: &Pairs) {
    let partners = partners(pairs, tracks);
    let moved: Vec<Vec<(usize, [f64; 3])>> = (0..tracks.frames).into_par_iter().with_min_len(32).map(|t| frame(tracks, pairs, &partners, t)).collect();
    for (t, own) in moved.into_iter().enumerate() {
        for (i, x) in own {
            tracks.put(t, i, x, tracks.sigma(t, i));
        }
    }
}

fn frame(tracks: &Tracks, pairs: &Pairs, partners: &[Vec<usize>], t: usize) -> Vec<(usize, [f64; 3])> {
    let free: Vec<usize> = (0..tracks.markers).filter(|&i| tracks.live(i) && !tracks.seen(t, i)).collect();
    if free.is_empty() {
        return Vec::new();
    }
    let mut now: Vec<[f64; 3]> = (0..tracks.markers).map(|i| tracks.place(t, i)).collect();
    for _ in 0..10 {
        let mut most = 0.0f64;
        for &i in &free {
            let sigma = tracks.sigma(t, i);
            let own = 3.0 / sigma.max(0.5).powi(2);
            let (start, x) = (Vector3::from(tracks.place(t, i)), Vector3::from(now[i]));
            let mut matrix = Matrix3::identity() * own;
            let mut slope = own * (x - start);
            for &j in &partners[i] {
                let pair = pairs.get(i, j);
                let weight = WEIGHT / (pair.spread_mm.powi(2) + 1.0);
                let apart = distance(now[i], now[j]) + 1e-9;
                let along = (x - Vector3::from(now[j])) / apart;
                matrix += weight * along * along.transpose();
                slope += weight * (apart - pair.distance_mm) * along;
            }
            let Some(inverse) = matrix.try_inverse() else { continue };
            let mut off = x - inverse * slope - start;
            if off.norm() > 2.0 * sigma {
                off *= 2.0 * sigma / off.norm();
            }
            let next = start + off;
            most = most.max((next - x).norm());
            now[i] = next.into();
        }
        if most < 0.01 {
            break;
        }
    }
    free.into_iter().map(|i| (i, now[i])).collect()
}
