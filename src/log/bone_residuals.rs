//! How well an estimate keeps the lengths of the bones.
//!
//! A bone is judged where filling can have hurt it: in the frames in which at least one of its ends is missing from the problem.
//! Frames in which both ends were observed would only dilute the number, and no solver may change them.

use super::names;
use crate::solve::{Bone, Estimate, Problem};
use rayon::prelude::*;

/// Where the ends of a bone are found in a frame. Numbers are places in [`Problem::missing`], which also knows the frame.
#[derive(Clone, Copy, Debug)]
enum Touched {
    /// End a is missing, b was observed.
    A(u32),
    /// End b is missing, a was observed.
    B(u32),
    /// Both ends are missing.
    Both(u32, u32),
}

/// The bones of a problem, each with the frames that an estimate can touch.
///
/// Made once for a problem and asked after every step: asking costs one distance for each touched frame.
#[derive(Debug)]
pub struct BoneResiduals {
    bones: Vec<Judged>,
}

#[derive(Debug)]
struct Judged {
    label: String,
    bone: Bone,
    touched: Vec<Touched>,
}

/// How far one bone is from its length, over the frames in which that can be said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual<'a> {
    /// Names of the two ends, unique among the bones of the problem.
    pub label: &'a str,
    /// The bone as the problem has it.
    pub bone: &'a Bone,
    /// Root mean square of |distance − length|, in mm. 0 without frames.
    pub rms_mm: f64,
    /// The largest |distance − length|, in mm. 0 without frames.
    pub max_mm: f64,
    /// The number of frames in which at least one end is missing and both ends are known by now.
    pub frames: u32,
}

impl BoneResiduals {
    /// Looks up the touched frames of every bone: frames with a missing sample × bones comparisons.
    pub fn new(problem: &Problem) -> Self {
        let mut bones: Vec<Judged> = labels(problem)
            .into_iter()
            .zip(&problem.bones)
            .map(|(label, bone)| Judged { label, bone: *bone, touched: Vec::new() })
            .collect();
        // For each column, its place in `missing` if it is missing from the frame at hand.
        let mut place_of: Vec<Option<u32>> = vec![None; problem.markers()];
        for frame in 0..problem.frames() {
            let places = problem.missing_in(frame);
            if places.is_empty() {
                continue;
            }
            place_of.fill(None);
            for place in places {
                place_of[problem.missing[place].1] = Some(place as u32); // 2^32 missing samples would need 100 GB for the problem alone
            }
            for judged in &mut bones {
                match (place_of[judged.bone.a], place_of[judged.bone.b]) {
                    (None, None) => {}
                    (Some(a), None) => judged.touched.push(Touched::A(a)),
                    (None, Some(b)) => judged.touched.push(Touched::B(b)),
                    (Some(a), Some(b)) => judged.touched.push(Touched::Both(a, b)),
                }
            }
        }
        Self { bones }
    }

    /// The residual of every bone, in the order of [`Problem::bones`]. `problem` is the one that `self` was made for.
    pub fn of<'a>(&'a self, problem: &'a Problem, estimate: &'a Estimate) -> impl Iterator<Item = Residual<'a>> {
        let judge = |judged: &'a Judged| {
            let (mut sum, mut max_mm, mut frames) = (0.0, 0.0, 0);
            for touched in &judged.touched {
                if let Some(distance_mm) = distance_mm(problem, estimate, &judged.bone, *touched) {
                    let off_mm = (distance_mm - judged.bone.length_mm).abs();
                    sum += off_mm * off_mm;
                    max_mm = f64::max(max_mm, off_mm);
                    frames += 1;
                }
            }
            let rms_mm = if frames == 0 { 0.0 } else { (sum / f64::from(frames)).sqrt() };
            Residual { label: &judged.label, bone: &judged.bone, rms_mm, max_mm, frames }
        };
        self.bones.par_iter().map(judge).collect::<Vec<_>>().into_iter()
    }
}

/// The distance between the ends of a bone in mm, `None` if an end is still open.
fn distance_mm(problem: &Problem, estimate: &Estimate, bone: &Bone, touched: Touched) -> Option<f64> {
    let filled = |place: u32| estimate.positions_mm.get(place as usize).copied().filter(|p| p.iter().all(|x| x.is_finite()));
    let seen = |place: u32, column: usize| problem.position_mm(problem.missing[place as usize].0, column);
    let (a, b) = match touched {
        Touched::A(place) => (filled(place)?, seen(place, bone.b)?),
        Touched::B(place) => (seen(place, bone.a)?, filled(place)?),
        Touched::Both(a, b) => (filled(a)?, filled(b)?),
    };
    Some(((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt())
}

/// `NAMEA-NAMEB` for each bone, never the same twice.
fn labels(problem: &Problem) -> Vec<String> {
    let end = |column: usize| {
        let marker = problem.columns.get(column).copied().unwrap_or(column);
        names::end(problem.names.get(column).map_or("", String::as_str), marker)
    };
    names::unique(problem.bones.iter().map(|bone| format!("{}-{}", end(bone.a), end(bone.b))))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use formats::{Marker, Origin, TakeBuilder};

    const OPEN: [f64; 3] = [f64::NAN; 3];

    fn bone(a: usize, b: usize, length_mm: f64) -> Bone {
        Bone { a, b, length_mm, spread_mm: 0.5 }
    }

    /// Columns P (at x = 0), Q (at x = 100) and R (at x = 300), four frames, with `hidden` (frame, column) missing.
    fn problem(names: [&str; 3], hidden: &[(usize, usize)], bones: &[Bone]) -> Problem {
        let mut take = TakeBuilder::new(names.map(Marker::new).to_vec(), 4, 100.0);
        for frame in 0..4 {
            for (column, x) in [0.0, 100.0, 300.0].into_iter().enumerate() {
                take.set(frame, column, [x, 0.0, 0.0], Origin::Measured);
            }
        }
        for &(frame, column) in hidden {
            take.hide(frame, column);
        }
        Problem::new(&take.build(), &[true; 3], bones)
    }

    fn estimate(positions_mm: &[[f64; 3]]) -> Estimate {
        Estimate { positions_mm: positions_mm.to_vec(), sigma_mm: vec![f64::NAN; positions_mm.len()] }
    }

    fn rms(residuals: &[f64]) -> f64 {
        (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt()
    }

    fn judge(problem: &Problem, positions_mm: &[[f64; 3]]) -> Vec<(f64, f64, u32)> {
        BoneResiduals::new(problem).of(problem, &estimate(positions_mm)).map(|r| (r.rms_mm, r.max_mm, r.frames)).collect()
    }

    #[test]
    fn either_end_or_both_may_be_missing() {
        // Q is missing from frame 1, P from frame 2, both from frame 3; R never.
        let p = problem(["P", "Q", "R"], &[(1, 1), (2, 0), (3, 0), (3, 1)], &[bone(0, 1, 100.0), bone(1, 2, 200.0), bone(0, 2, 300.0)]);
        let found = judge(&p, &[[103.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 30.0], [0.0, 40.0, 30.0]]);
        let off = (300.0_f64.powi(2) + 40.0_f64.powi(2) + 30.0_f64.powi(2)).sqrt() - 200.0;
        assert_eq!(found[0], (rms(&[3.0, 4.0, 60.0]), 60.0, 3));
        assert_eq!(found[1], (rms(&[3.0, off]), off, 2));
        let off = (300.0_f64.powi(2) + 30.0_f64.powi(2)).sqrt() - 300.0;
        assert_eq!(found[2], (rms(&[4.0, off]), 4.0, 2));
    }

    #[test]
    fn open_samples_are_no_frames() {
        let p = problem(["P", "Q", "R"], &[(0, 0), (1, 0)], &[bone(0, 1, 100.0), bone(1, 2, 200.0)]);
        assert_eq!(judge(&p, &[OPEN, [-2.0, 0.0, 0.0]]), [(2.0, 2.0, 1), (0.0, 0.0, 0)]);
        assert_eq!(judge(&p, &[OPEN, [f64::INFINITY, 0.0, 0.0]]), [(0.0, 0.0, 0); 2]);
        assert_eq!(judge(&p, &[]), [(0.0, 0.0, 0); 2], "an estimate that is too short knows nothing");
    }

    #[test]
    fn without_gaps_there_is_nothing_to_judge() {
        assert_eq!(judge(&problem(["P", "Q", "R"], &[], &[bone(0, 1, 90.0)]), &[]), [(0.0, 0.0, 0)]);
    }

    #[test]
    fn labels_are_unique_and_never_empty() {
        let bones = [bone(0, 1, 1.0), bone(0, 1, 1.0), bone(1, 2, 1.0), bone(0, 2, 1.0)];
        let of = |names| BoneResiduals::new(&problem(names, &[], &bones)).bones.into_iter().map(|b| b.label).collect::<Vec<_>>();
        assert_eq!(of(["P", "Q", "R"]), ["P-Q", "P-Q (2)", "Q-R", "P-R"]);
        assert_eq!(of(["S:P", "", "P"]), ["P-#2", "P-#2 (2)", "#2-P", "P-P"]);
    }

    #[test]
    fn a_label_that_was_made_unique_is_not_taken_twice() {
        let names = ["P", "Q", "Q (2)"];
        let p = problem(names, &[], &[bone(0, 2, 1.0), bone(0, 1, 1.0), bone(0, 1, 1.0)]);
        assert_eq!(labels(&p), ["P-Q (2)", "P-Q", "P-Q (3)"]);
    }
}
