//! How alike two runs of a take are, by what is around them.

use super::blackout::Context;
use super::tracks::distance;

/// How far a marker's surroundings reach, mm.
const SURROUNDINGS_MM: f64 = 150.0;

/// What velocities count against positions.
const VELOCITY: f64 = 0.3;

/// Pairs of context frames from which velocities are taken, and the factor that makes of them what counts.
pub fn velocity_pairs(context: &Context, scale: f64, length: usize) -> Vec<(usize, usize, f64)> {
    let wanted: Vec<isize> =
        [1.0f64, 5.0, 12.0, 24.0].iter().map(|&k| if k <= 1.0 { 1 } else { ((k * scale).round() as isize).max(1) }).collect();
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
pub fn looks(flat: &[f64], context: &Context, pairs: &[(usize, usize, f64)], width: usize) -> Vec<f64> {
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

#[cfg(test)]
mod tests {
    use super::super::blackout::fill;
    use super::super::dark::{Blackout, find};
    use super::super::ensemble::Filling;
    use super::super::tracks::{Tracks, tests::problem};
    use super::*;

    const FRAMES: usize = 600;
    const MARKERS: usize = 9;

    /// Markers on a body that walks on; each swings with a period of its own share of 50 frames.
    fn place(t: usize, i: usize) -> [f64; 3] {
        let phase = std::f64::consts::TAU * t as f64 / 50.0;
        let wave = |k: usize, start: f64| (k as f64 * phase + start + i as f64).sin();
        let (row, column) = ((i % 3) as f64, (i / 3) as f64);
        [
            2.0 * t as f64 + 200.0 * row + 60.0 * wave(1, 0.0),
            200.0 * column + 25.0 * wave(2, 1.0),
            900.0 + 90.0 * row * column + 20.0 * wave(3, 2.0),
        ]
    }

    fn filled(dark: std::ops::Range<usize>, scale: f64, analogs: bool) -> (Blackout, Vec<Filling>) {
        let tracks = Tracks::new(&problem((FRAMES, MARKERS), 120.0 * scale, place, |t, _| !dark.contains(&t)));
        let markers: Vec<usize> = (0..MARKERS).collect();
        let found = find(&tracks, &markers);
        assert_eq!(found, [Blackout { start: dark.start, end: dark.end, markers }]);
        let flags: Vec<bool> = (0..FRAMES).map(|t| dark.contains(&t)).collect();
        let fillings = fill(&tracks, &found[0], &flags, scale, analogs);
        assert!(fillings.iter().enumerate().all(|(i, f)| f.explanation.gap.marker == i && f.places_mm.len() == dark.len()));
        (found[0].clone(), fillings)
    }

    fn error(blackout: &Blackout, fillings: &[Filling]) -> f64 {
        let squares = fillings
            .iter()
            .enumerate()
            .flat_map(|(i, f)| f.places_mm.iter().zip(blackout.start..).map(move |(&x, t)| distance(x, place(t, i)).powi(2)));
        (squares.sum::<f64>() / (fillings.len() * (blackout.end - blackout.start)) as f64).sqrt()
    }

    /// What comes back every 50 frames can be borrowed from where it was seen; a curve across 30 of them cannot know it.
    #[test]
    fn what_repeats_itself_is_borrowed() {
        let [with, without] = [true, false].map(|analogs| {
            let (blackout, fillings) = filled(300..330, 1.0, analogs);
            let predicted = (fillings.iter().map(|f| f.explanation.predicted_mm.powi(2)).sum::<f64>() / MARKERS as f64).sqrt();
            for filling in &fillings {
                let shares: f64 = filling.explanation.experts.iter().map(|e| e.1).sum();
                assert!((shares - 1.0).abs() < 1e-9 && filling.explanation.experts.iter().all(|e| e.1 > 0.0), "{shares}");
            }
            (error(&blackout, &fillings), predicted)
        });
        assert!(with.0 < 1.0, "{} mm", with.0);
        assert!(with.0 < 0.2 * without.0, "{} mm with and {} mm without", with.0, without.0);
        assert!(with.1 < without.1, "predicted {} mm with and {} mm without", with.1, without.1);
    }

    #[test]
    fn at_an_end_the_last_sight_is_held() {
        for (dark, edge) in [(FRAMES - 20..FRAMES, FRAMES - 21), (0..25, 25)] {
            let (blackout, fillings) = filled(dark, 1.0, true);
            for (i, filling) in fillings.iter().enumerate() {
                assert!(filling.places_mm.iter().all(|&x| x == place(edge, i)), "marker {i}");
                let far = |t: usize| filling.sigma_mm[t - blackout.start];
                let frames: Vec<usize> = (blackout.start..blackout.end).collect();
                for pair in frames.windows(2) {
                    assert_eq!(far(pair[0]) < far(pair[1]), edge < blackout.start, "farther away it is less sure");
                }
            }
        }
    }

    #[test]
    fn weights_fall_with_distance_and_sum_to_one() {
        let weights = normalised(&[4.0, 1.0, 9.0, 1.0], 0.7);
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(weights[1] == weights[3] && weights[1] > weights[0] && weights[0] > weights[2] && weights[2] > 0.0, "{weights:?}");
        // only distances relative to the least one count
        let far = normalised(&[400.0, 100.0, 900.0, 100.0], 0.7);
        assert!(weights.iter().zip(&far).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}
