//! How alike two runs of a take are, by what is around them.

use super::blackout::Context;
use super::tracks::distance;

/// How far a marker's surroundings reach, mm.
const SURROUNDINGS_MM: f64 = 150.0;

/// What velocities count against positions.
const VELOCITY: f64 = 0.3;

/// Pairs of context frames from which velocities are taken, and the factor that makes of them what counts.
pub fn velocity_pairs(context: &Context, scale: f64, length: usize) -> Vec<(usize, usize, f64)> {
    let wanted: Vec<isize> = [1.0f64, 5.0, 12.0, 24.0].iter().map(|k| ((k * scale).round() as isize).max(1)).collect();
    let before: Vec<usize> = (0..context.before).filter(|&i| wanted.contains(&-context.offsets[i])).collect();
    let after: Vec<usize> =
        (context.before..context.offsets.len()).filter(|&i| wanted.contains(&(context.offsets[i] - length as isize + 1))).collect();
    let pairs: Vec<(usize, usize)> = [before, after].iter().flat_map(|side| side.windows(2).map(|w| (w[0], w[1]))).collect();
    let count = pairs.len();
    pairs
        .into_iter()
        .map(|(i, j)| {
            let factor = length as f64 * (2.0 * VELOCITY / count as f64).sqrt() / (context.offsets[j] - context.offsets[i]) as f64;
            (i, j, factor)
        })
        .collect()
}

/// What runs are compared by: positions at both edges, and velocities, each 3 × markers.
pub fn looks(flat: &[f64], context: &Context, pairs: &[(usize, usize, f64)], _length: usize, width: usize) -> Vec<f64> {
    let row = |i: usize| &flat[i * width..(i + 1) * width];
    let mut out = row(context.before - 1).to_vec();
    out.extend_from_slice(row(context.before));
    for &(i, j, factor) in pairs {
        out.extend(row(i).iter().zip(row(j)).map(|(a, b)| factor * (b - a)));
    }
    out
}

/// Half the squared difference of two looks, marker by marker.
pub fn apart(a: &[f64], b: &[f64], m: usize) -> Vec<f64> {
    let mut out = vec![0.0; m];
    for (a, b) in a.chunks_exact(3 * m).zip(b.chunks_exact(3 * m)) {
        for (out, (a, b)) in out.iter_mut().zip(a.chunks_exact(3).zip(b.chunks_exact(3))) {
            *out += 0.5 * ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2));
        }
    }
    out
}

/// For each marker, what its surroundings count: markers × markers, each row sums to 1.
pub fn neighbourhood(target: &[f64], rows: usize, m: usize) -> Vec<f64> {
    let place = |r: usize, i: usize| [0, 1, 2].map(|axis| target[(r * m + i) * 3 + axis]);
    let mut out = vec![0.0; m * m];
    for i in 0..m {
        for j in 0..m {
            let mean = (0..rows).map(|r| distance(place(r, i), place(r, j))).sum::<f64>() / rows as f64;
            out[i * m + j] = (-0.5 * (mean / SURROUNDINGS_MM).powi(2)).exp();
        }
    }
    // weights that each marker gives away sum to 1, as in a mean over what it is near to
    for row in out.chunks_exact_mut(m) {
        let sum: f64 = row.iter().sum();
        for w in row {
            *w /= sum;
        }
    }
    out
}

/// Weights that fall with squared distances, 1 in all; `width` is relative to the least distance.
pub fn normalised(distances: &[f64], width: f64) -> Vec<f64> {
    let least = distances.iter().copied().fold(f64::INFINITY, f64::min) + 1e-9;
    let raw: Vec<f64> = distances.iter().map(|d| (-0.5 * (d - least) / (width * width * least)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    raw.into_iter().map(|w| w / sum).collect()
}
