//! Runs: stretches of places of which the same is true.

/// Maximal runs of places below `count` for which `holds`, in order, half-open.
pub fn runs(count: usize, holds: impl Fn(usize) -> bool) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let mut start = None;
    for place in 0..=count {
        match (place < count && holds(place), start) {
            (true, None) => start = Some(place),
            (false, Some(from)) => {
                found.push((from, place));
                start = None;
            }
            _ => {}
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_maximal() {
        for (row, expected) in
            [("", vec![]), (".", vec![]), ("#", vec![(0, 1)]), ("##..#.#", vec![(0, 2), (4, 5), (6, 7)]), (".##.", vec![(1, 3)])]
        {
            let row = row.as_bytes();
            assert_eq!(runs(row.len(), |place| row[place] == b'#'), expected);
        }
    }
}
