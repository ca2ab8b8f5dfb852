//! Makes `docs/gap.svg`: `cargo run --release --example gap_picture > docs/gap.svg`.

use mocap_repair::demo::{DemoOptions, demo, picture::gap_svg};
use mocap_repair::solve::{Limits, Method, Problem, Settings};
use mocap_repair::{bones, fills, gaps};
use std::io::Write as _;

/// The picture shows its longest gap: a foot comes down, stands, and leaves the floor again.
const MARKER: &str = "LANK";

fn main() -> std::io::Result<()> {
    let made = demo(&DemoOptions::default());
    let Some(marker) = made.gaps.markers.iter().position(|marker| marker.label == MARKER) else {
        return Err(std::io::Error::other(format!("the demonstration take has no marker {MARKER}")));
    };
    // the default method, as the command runs it
    let everybody = vec![true; made.gaps.markers.len()];
    let problem = Problem::new(&made.gaps, &everybody, &bones::find(&made.gaps, &everybody));
    let solved = Method::default().solve(&problem, &Settings::default(), &Limits::default(), &mut ());
    let found = gaps::gaps(&made.gaps);
    let mut after = made.gaps.clone();
    let samples = fills::fill(&mut after, &problem, &solved.estimate, &found, &mut vec![Ok(()); found.len()], None);
    let sigma = |frame: usize| samples.iter().find(|s| s.frame == frame && s.marker == marker).map(|s| s.sigma_mm);
    std::io::stdout().write_all(gap_svg(&made.truth, &made.gaps, &after, &sigma, marker).as_bytes())
}
