//! What was seen of the markers and how much it weighs, what is left of it when the motion is known, and the table of that.

use crate::bones::quoted;
use crate::rig::Rig;
use crate::rig::map::Worn;
use crate::solve::ik::{Posed, Vec3};
use crate::solve::markers::{Seen, Solution};
use formats::{Origin, Take};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{self, Write};

/// How far a marker that was measured is from where a body of rigid parts has it, cm: skin moves. Walks and gymnastics have 0.9 to 1.3.
/// It is what everything else that is known of a sample is weighed against.
pub const SIGMA_CM: f64 = 1.0;

/// How far off a sample is believed to be that somebody filled or filtered, if it is not known better, cm: such files do not say.
const DERIVED_CM: f64 = 1.0;

/// What was seen, in cm, with its weights: 1 over the variance, that of the skin and that of the sample. `sigmas_mm` has standard deviations of
/// samples that are known to have been filled, by frame and column of the take; NaN if they are unknown.
pub fn weigh(take: &Take, worn: &Worn, sigmas_mm: &BTreeMap<(usize, usize), f64>) -> Seen {
    let (frames, markers) = (take.frames(), worn.markers.len());
    let mut seen = Seen { frames, markers, places: Vec::with_capacity(frames * markers), weights: Vec::with_capacity(frames * markers) };
    for frame in 0..frames {
        for (column, _, _, factor) in &worn.markers {
            let sigma_cm = match (sigmas_mm.get(&(frame, *column)), take.origin(frame, *column)) {
                (Some(sigma_mm), _) if sigma_mm.is_finite() => sigma_mm / 10.0,
                (None, Origin::Measured) => 0.0,
                _ => DERIVED_CM,
            };
            let place = take.position_mm(frame, *column).map_or(Vec3::repeat(f64::NAN), |x| Vec3::from(x) / 10.0);
            seen.places.push(place);
            seen.weights.push(factor / (SIGMA_CM * SIGMA_CM + sigma_cm * sigma_cm));
        }
    }
    seen
}

/// A take and the motion that was found for it.
#[derive(Clone, Debug)]
pub struct Fitted<'a> {
    /// The take, in the axes of the rig.
    pub take: &'a Take,
    /// Its markers.
    pub worn: &'a Worn,
    /// Where they were seen.
    pub seen: Seen,
    /// The motion.
    pub solution: Solution,
    /// For each frame and marker how far it is from where the motion has it, cm; NaN where it was not seen.
    pub residuals_cm: Vec<f64>,
}

impl<'a> Fitted<'a> {
    /// Measures what is left.
    pub fn new(take: &'a Take, worn: &'a Worn, seen: Seen, solution: Solution, rig: &Rig) -> Self {
        let mut posed = Posed::new(&rig.body.tree);
        let mut residuals_cm = vec![f64::NAN; seen.places.len()];
        for (frame, pose) in solution.poses.iter().enumerate() {
            posed.set(&rig.body.tree, pose);
            for (at, x, _) in seen.frame(frame) {
                let (_, _, marker, _) = &worn.markers[at];
                residuals_cm[frame * seen.markers + at] = (posed.parts[marker.part].point(&marker.place()) - x).norm();
            }
        }
        Self { take, worn, seen, solution, residuals_cm }
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.seen.frames
    }

    /// True if the pose depends on the marker.
    pub fn counts(&self, marker: usize) -> bool {
        self.worn.markers[marker].3 > 0.0
    }

    /// How far the markers of a frame are from the motion, cm.
    pub fn row(&self, frame: usize) -> &[f64] {
        &self.residuals_cm[frame * self.seen.markers..][..self.seen.markers]
    }

    /// The markers of a frame that were seen and count, each with its distance, cm.
    pub fn counted(&self, frame: usize) -> impl Iterator<Item = (usize, f64)> {
        self.row(frame).iter().copied().enumerate().filter(|(at, x)| x.is_finite() && self.counts(*at))
    }

    /// How many of them there are, their root mean square distance, and the worst one.
    pub fn summed(&self, frame: usize) -> (usize, f64, Option<(usize, f64)>) {
        let (mut count, mut squares) = (0_usize, 0.0);
        for (_, x) in self.counted(frame) {
            count += 1;
            squares += x * x;
        }
        (count, (squares / count as f64).sqrt(), self.counted(frame).max_by(|a, b| a.1.total_cmp(&b.1)))
    }
}

/// Writes a row for each frame: `frame` (the take's own number), `markers` (that were seen and count), `rms_cm` and `worst_cm` (their distances from where
/// the body has them), `worst` (which one that is), and for each marker `<marker>:residual_cm`. What was not seen is empty.
///
/// # Errors
/// I/O errors of `out`.
pub fn write_table(fitted: &Fitted<'_>, out: &mut dyn Write) -> io::Result<()> {
    let mut out = io::BufWriter::new(out);
    let labels: Vec<&str> = fitted.worn.markers.iter().map(|(_, label, ..)| label.as_str()).collect();
    let mut row = String::from("frame,markers,rms_cm,worst_cm,worst");
    for label in &labels {
        row.push(',');
        row.push_str(&quoted(&format!("{label}:residual_cm")));
    }
    writeln!(out, "{row}")?;
    for frame in 0..fitted.frames() {
        row.clear();
        let (count, rms_cm, worst) = fitted.summed(frame);
        let _ = write!(row, "{},{count}", fitted.take.frame_label(frame)); // a String takes everything
        let _ = match worst {
            Some((at, worst_cm)) => write!(row, ",{rms_cm:.4},{worst_cm:.4},{}", quoted(labels[at])),
            None => write!(row, ",,,"),
        };
        for x in fitted.row(frame) {
            let _ = if x.is_finite() { write!(row, ",{x:.4}") } else { write!(row, ",") };
        }
        writeln!(out, "{row}")?;
    }
    out.flush()
}
