//! Makes `docs/gap.svg`: `cargo run --example gap_picture > docs/gap.svg`.

use formats::Take;
use mocap_repair::demo::{DemoOptions, demo, picture::gap_svg};
use std::io::Write as _;

/// The picture shows its longest gap: a foot comes down, stands, and leaves the floor again.
const MARKER: &str = "LANK";

fn main() -> std::io::Result<()> {
    let made = demo(&DemoOptions::default());
    let Some(marker) = made.gaps.markers.iter().position(|marker| marker.label == MARKER) else {
        return Err(std::io::Error::other(format!("the demonstration take has no marker {MARKER}")));
    };
    let after = straight(&made.gaps);
    let svg = gap_svg(&made.truth, &made.gaps, &after, &|_| None, marker);
    std::io::stdout().write_all(svg.as_bytes())
}

/// Fills every gap with a straight line between its ends.
fn straight(take: &Take) -> Take {
    let mut filled = take.clone();
    for marker in 0..take.markers.len() {
        let seen: Vec<(usize, [f64; 3])> =
            (0..take.frames()).filter_map(|frame| take.position_mm(frame, marker).map(|position| (frame, position))).collect();
        for pair in seen.windows(2) {
            let [(start, from), (end, to)] = [pair[0], pair[1]];
            for frame in start + 1..end {
                let x = (frame - start) as f64 / (end - start) as f64;
                filled.fill(frame, marker, std::array::from_fn(|axis| from[axis] + x * (to[axis] - from[axis])));
            }
        }
    }
    filled
}
