//! Where the black-outs of a body are.

use super::tracks::Tracks;

/// A run of frames in which a body is out of sight.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Blackout {
    /// First frame.
    pub start: usize,
    /// One past the last.
    pub end: usize,
    /// The markers of the body that take part.
    pub markers: Vec<usize>,
}

/// Finds the black-outs of a body. They begin and end where half of the body is seen: where less than that is left beside the dark, nothing of the
/// rest is known well enough to say how fast it went into the dark, and such errors grow over the length of a black-out.
pub fn find(tracks: &Tracks, markers: &[usize]) -> Vec<Blackout> {
    // a frame of three markers is enough to work with, but not if it says next to nothing of the body
    let least = if markers.len() >= 8 { 4 } else { 1 }.min(markers.len());
    let half = markers.len().div_ceil(2).max(least);
    let seen: Vec<usize> = (0..tracks.frames).map(|t| markers.iter().filter(|&&i| tracks.seen(t, i)).count()).collect();
    let mut found: Vec<Blackout> = Vec::new();
    let mut t = 0;
    while t < tracks.frames {
        if seen[t] >= least {
            t += 1;
            continue;
        }
        let start = seen[..t].iter().rposition(|&n| n >= half).map_or(0, |clear| clear + 1);
        let end = seen[t..].iter().position(|&n| n >= half).map_or(tracks.frames, |clear| t + clear);
        found.push(Blackout { start, end, markers: markers.to_vec() });
        t = end;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::problem;
    use super::*;

    /// Seen markers of each frame, ten in all, as runs of (frames, seen), and the black-outs.
    #[test]
    fn the_dark_ends_where_half_of_the_body_is_seen() {
        for (runs, expected) in [
            (&[(20, 10)][..], &[][..]),
            (&[(20, 10), (5, 4), (20, 10)], &[]),
            (&[(20, 10), (5, 3), (20, 5)], &[(20, 25)]),
            (&[(20, 10), (4, 4), (5, 3), (6, 4), (20, 5)], &[(20, 35)]),
            (&[(20, 10), (4, 4), (5, 3), (6, 4), (5, 0), (20, 5)], &[(20, 40)]),
            (&[(20, 10), (5, 3), (1, 5), (6, 4), (5, 0), (20, 5)], &[(20, 25), (26, 37)]),
            (&[(3, 4), (2, 0), (40, 10), (2, 1), (3, 4)], &[(0, 5), (45, 50)]),
        ] {
            let seen: Vec<usize> = runs.iter().flat_map(|&(frames, seen)| vec![seen; frames]).collect();
            let take = problem((seen.len(), 10), 100.0, |t, i| [t as f64, i as f64, 0.0], |t, i| i < seen[t]);
            let found = find(&Tracks::new(&take), &(0..10).collect::<Vec<_>>());
            assert_eq!(found.iter().map(|b| (b.start, b.end)).collect::<Vec<_>>(), expected, "{runs:?}");
        }
    }
}
