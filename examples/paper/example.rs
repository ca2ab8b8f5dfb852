//! The two worked examples: how long the bones at the hidden markers are.

use crate::trial::{Fill, Trial};
use formats::Take;
use std::ops::Range;

/// Motions of the worked examples and the bones that Fig. 1 and 3 show of them.
const SHOWN: [(&str, [(&str, &str); 3]); 2] = [
    ("127_07", [("RTHI", "RKNE"), ("RKNE", "RSHN"), ("RSHN", "RANK")]),
    ("132_43", [("RUPA", "RELB"), ("RELB", "RFRM"), ("RFRM", "RWRA")]),
];

/// A worked example, filled.
#[derive(Debug)]
pub struct Example<'a> {
    /// The case with what every method made of it.
    pub trial: &'a Trial,
    /// The motion as it was.
    pub truth: &'a Take,
    /// Frames from the first to the last hidden one.
    pub gap: Range<usize>,
    /// The bones to look at.
    pub bones: Vec<Shown>,
}

/// A bone of which one end or both are hidden.
#[derive(Clone, Debug)]
pub struct Shown {
    /// `RTHI–RKNE`.
    pub name: String,
    /// Columns of its ends.
    pub ends: (usize, usize),
    /// Its mean length outside the gap, mm: what the paper constrains it to.
    pub length_mm: f64,
}

impl<'a> Example<'a> {
    /// Finds the bones.
    ///
    /// # Errors
    /// No bones are known for this motion, or it lacks a marker.
    pub fn new(trial: &'a Trial, truth: &'a Take) -> Result<Self, String> {
        let motion = trial.case.motion.as_str();
        let (_, pairs) = SHOWN.iter().find(|(name, _)| *name == motion).ok_or_else(|| {
            format!("{motion} is listed as a worked example of the paper; expected one of: {}", SHOWN.map(|(name, _)| name).join(", "))
        })?;
        let start = trial.case.hidden.iter().map(|gap| gap.start).min().unwrap_or(0);
        let gap = start..trial.case.hidden.iter().map(|gap| gap.end).max().unwrap_or(start);
        let column = |label: &str| {
            let found = truth.markers.iter().position(|marker| marker.name() == label);
            found.ok_or_else(|| format!("{motion} has no marker {label}, of which the paper shows a bone"))
        };
        let shown = |(a, b): &(&str, &str)| {
            let ends = (column(a)?, column(b)?);
            let lengths = (0..truth.frames()).filter(|frame| !gap.contains(frame)).filter_map(|frame| length(truth, ends, frame));
            let length_mm = mean(lengths).ok_or_else(|| format!("{motion}: {a} and {b} are never seen together outside the gap"))?;
            Ok(Shown { name: format!("{a}–{b}"), ends, length_mm })
        };
        let bones = pairs.iter().map(shown).collect::<Result<_, String>>()?;
        Ok(Self { trial, truth, gap, bones })
    }

    /// The original, then every method with the takes that they filled. The original has no method.
    pub fn takes(&self) -> impl Iterator<Item = (Option<&Fill>, &Take)> {
        std::iter::once((None, self.truth)).chain(self.trial.fills.iter().filter_map(|fill| Some((Some(fill), fill.take.as_ref()?))))
    }

    /// How far a bone is from its mean length within the gap: the mean of the absolute differences, mm.
    pub fn deviation_mm(&self, bone: &Shown, take: &Take) -> Option<f64> {
        mean(self.gap.clone().filter_map(|frame| length(take, bone.ends, frame)).map(|length| (length - bone.length_mm).abs()))
    }
}

/// Length in mm of a bone in one frame.
pub fn length(take: &Take, ends: (usize, usize), frame: usize) -> Option<f64> {
    let (a, b) = (take.position_mm(frame, ends.0)?, take.position_mm(frame, ends.1)?);
    Some(a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt())
}

/// `None` of nothing.
pub fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::cases::{Case, Kind};
    use formats::{Marker, Origin, TakeBuilder};
    use mocap_repair::solve::Gap;

    #[test]
    fn bones_are_held_against_their_length_outside_the_gap() {
        let labels = ["s:RTHI", "s:RKNE", "s:RSHN", "s:RANK"];
        let mut builder = TakeBuilder::new(labels.map(Marker::new).to_vec(), 4, 120.0);
        // the thigh is 10 long outside, and 10 + 3, 10 - 1 within
        for (frame, thigh) in [10.0, 13.0, 9.0, 10.0].into_iter().enumerate() {
            for (marker, z) in [0.0, thigh, 30.0, 40.0].into_iter().enumerate() {
                builder.set(frame, marker, [0.0, 0.0, z], Origin::Measured);
            }
        }
        let truth = builder.build();
        let hidden = vec![Gap { marker: 1, start: 1, end: 3 }];
        let case = Case { motion: "127_07".into(), kind: Kind::Paper, trial: 0, hidden };
        let trial = Trial { case, markers: String::new(), fills: Vec::new() };
        let example = Example::new(&trial, &truth).unwrap();
        assert_eq!(example.gap, 1..3);
        let found: Vec<_> =
            example.bones.iter().map(|b| (b.name.as_str(), b.length_mm, example.deviation_mm(b, &truth).unwrap())).collect();
        assert_eq!(found, [("RTHI–RKNE", 10.0, 2.0), ("RKNE–RSHN", 20.0, 2.0), ("RSHN–RANK", 10.0, 0.0)]);
        let other = Trial { case: Case { motion: "132_43".into(), ..trial.case }, ..trial };
        assert!(Example::new(&other, &truth).is_err_and(|problem| problem.contains("no marker RUPA")));
    }
}
