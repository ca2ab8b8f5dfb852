//! What is kept of every frame when its cloud is gone, and the table of it.

use crate::bones::quoted;
use crate::rig::Rig;
use crate::solve::track::{Tracked, Way};
use std::fmt::Write as _;
use std::io::{self, Write};

/// Whether a frame has a cloud.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Given {
    /// Points to follow.
    #[default]
    Cloud,
    /// A file without points.
    Empty,
    /// No file.
    Missing,
}

/// A frame that has been tracked, in numbers. Lists have one entry for each joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// Its number, as in the name of the file.
    pub number: u32,
    /// Whether it has a cloud.
    pub given: Given,
    /// How it came to its pose.
    pub way: Way,
    /// Number of points.
    pub points: usize,
    /// Rounds of EM.
    pub rounds: usize,
    /// Log-likelihood of the cloud before the last round's step, nats; NaN without a cloud.
    pub log_likelihood: f64,
    /// Standard deviation of the mixture in the last round, cm; NaN without a cloud.
    pub sigma_cm: f64,
    /// The share of the points that belong to the body; NaN without a cloud.
    pub inliers: f64,
    /// Root mean square distance of those points from their vertices, cm; NaN without any.
    pub residual_cm: f64,
    /// For each part, the share of its surface with points beside it; NaN for joints without a surface, and without a cloud.
    pub coverage: Vec<f64>,
    /// For each part, the root mean square distance of its points, cm; NaN if there are none.
    pub residuals_cm: Vec<f64>,
    /// For each part, whether it is lost.
    pub lost: Vec<bool>,
}

impl Seen {
    /// Of a frame.
    pub fn new(number: u32, given: Given, tracked: &Tracked) -> Self {
        let last = tracked.rounds.last();
        let residual_cm = last.map_or(f64::NAN, |round| {
            let parts = || round.mass.iter().zip(&round.residual_cm).filter(|(mass, residual)| **mass > 0.0 && residual.is_finite());
            let squares: f64 = parts().map(|(mass, residual)| mass * residual * residual).sum();
            (squares / parts().map(|(mass, _)| mass).sum::<f64>()).sqrt()
        });
        Self {
            number,
            given,
            way: tracked.way,
            points: tracked.cloud.as_ref().map_or(0, |cloud| cloud.points.len()),
            rounds: tracked.rounds.len(),
            log_likelihood: last.map_or(f64::NAN, |round| round.log_likelihood),
            sigma_cm: last.map_or(f64::NAN, |round| round.sigma_cm),
            inliers: if last.is_some() { tracked.inliers } else { f64::NAN },
            residual_cm,
            coverage: tracked.coverage.clone(),
            residuals_cm: tracked.residual_cm.clone(),
            lost: tracked.lost.clone(),
        }
    }
}

/// How a frame came to its pose, in one word.
pub fn word(way: Way) -> &'static str {
    match way {
        Way::Tracked => "tracked",
        Way::Searched => "searched",
        Way::Predicted => "predicted",
    }
}

/// Writes a row for each frame: `frame`, `way`, `points`, `rounds`, `log_likelihood` (nats), `sigma_cm`, `inliers`, `residual_cm`, and for each part
/// with a surface `<part>:coverage`, `<part>:residual_cm`, `<part>:lost` (0 or 1). What is not known is empty.
///
/// # Errors
/// I/O errors of `out`.
pub fn write_table(frames: &[Seen], rig: &Rig, out: &mut dyn Write) -> io::Result<()> {
    let mut out = io::BufWriter::new(out);
    let names: Vec<&str> = rig.names().collect();
    let parts = rig.with_surface();
    let mut row = String::from("frame,way,points,rounds,log_likelihood,sigma_cm,inliers,residual_cm");
    for &part in &parts {
        for column in ["coverage", "residual_cm", "lost"] {
            row.push(',');
            row.push_str(&quoted(&format!("{}:{column}", names[part])));
        }
    }
    writeln!(out, "{row}")?;
    let put = |row: &mut String, value: f64, decimals: usize| {
        row.push(',');
        if value.is_finite() {
            let _ = write!(row, "{value:.decimals$}"); // a String takes everything
        }
    };
    for seen in frames {
        row.clear();
        let _ = write!(row, "{},{},{},{}", seen.number, word(seen.way), seen.points, seen.rounds);
        for (value, decimals) in [(seen.log_likelihood, 3), (seen.sigma_cm, 4), (seen.inliers, 4), (seen.residual_cm, 4)] {
            put(&mut row, value, decimals);
        }
        for &part in &parts {
            put(&mut row, seen.coverage[part], 4);
            put(&mut row, seen.residuals_cm[part], 4);
            row.push_str(if seen.lost[part] { ",1" } else { ",0" });
        }
        writeln!(out, "{row}")?;
    }
    out.flush()
}
