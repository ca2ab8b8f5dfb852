//! Damaged copies of tables, for the tests of those who read them.
#![allow(clippy::unwrap_used, clippy::indexing_slicing)]

use crate::{Format, Notes, Stated};

/// Opens so many copies of `seeds` with bytes changed, added, cut out or cut off, and returns how many could be opened.
/// Each is an error or a take, never a panic; an unchanged save gives the same bytes, and a changed one can be opened as `again` says.
#[track_caller]
pub fn survive(format: &dyn Format, seeds: &[&str], alphabet: &[u8], rounds: usize, again: &Stated) -> usize {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 33) as usize % below.max(1)
    };
    let mut opened = 0;
    for round in 0..rounds {
        let mut bytes = seeds[round % seeds.len()].as_bytes().to_vec();
        for _ in 0..=random(3) {
            let at = random(bytes.len());
            match random(4) {
                0 => bytes[at] = alphabet[random(alphabet.len())],
                1 => bytes.insert(at, alphabet[random(alphabet.len())]),
                2 => drop(bytes.drain(at..(at + random(9)).min(bytes.len()))),
                _ if random(3) == 0 => bytes.truncate(at.max(1)),
                _ => {}
            }
            if bytes.is_empty() {
                break;
            }
        }
        format.sniff(&bytes);
        let Ok(document) = format.open(bytes.clone(), &Stated::default(), &Notes::new()) else { continue };
        opened += 1;
        let mut out = Vec::new();
        document.save(document.take(), &mut out, &Notes::new()).unwrap();
        assert_eq!(out, bytes);
        let mut take = document.take().clone();
        let markers = take.markers.len();
        for (f, m) in (0..take.frames()).flat_map(|f| (0..markers).map(move |m| (f, m))).take(500) {
            take.fill(f, m, [1.0, 2.0, 3.0]);
        }
        let mut out = Vec::new();
        document.save(&take, &mut out, &Notes::new()).unwrap();
        let opened_again = format.open(out, again, &Notes::new());
        assert!(opened_again.is_ok(), "{:?}: {:?}", String::from_utf8_lossy(&bytes), opened_again.err().map(|e| e.to_string()));
    }
    opened
}
