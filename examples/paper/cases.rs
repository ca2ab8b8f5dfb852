//! The motions and the occlusions, from a folder that is not part of this repository.

use formats::{Stated, Take, Unit};
use mocap_repair::input;
use mocap_repair::solve::Gap;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The database recorded these motions at this rate; its CSV files do not say so.
const RATE_HZ: f64 = 120.0;

/// What a case is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One marker hidden in one random segment: the paper's statistical test.
    Single,
    /// Two neighbouring markers hidden: the paper's worked examples.
    Paper,
}

/// Samples of one motion that are hidden.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Name of the motion, as the database has it.
    pub motion: String,
    /// What the case is for.
    pub kind: Kind,
    /// Counts the cases of one kind and motion, from 0.
    pub trial: usize,
    /// What is hidden: columns of the take, frames from 0.
    pub hidden: Vec<Gap>,
}

/// A case as the list writes it.
#[derive(Deserialize)]
struct Listed {
    motion: String,
    kind: String,
    trial: usize,
    /// Column, first and last hidden frame.
    gaps: Vec<[usize; 3]>,
}

/// `MOCAP_SHARED`, or `../shared` beside the repository.
fn shared() -> PathBuf {
    std::env::var_os("MOCAP_SHARED").map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from)
}

/// The cases of this experiment in the order of the list, and the motions they need. Empty `motions` means all of them.
///
/// # Errors
/// The folder is not there, a file is damaged, a motion is unknown, or a case hides what its motion does not have.
pub fn load(motions: &[String], trials: usize) -> Result<(Vec<Case>, BTreeMap<String, Take>), String> {
    let folder = shared();
    let list = folder.join("bench/cases.json");
    let text = std::fs::read_to_string(&list).map_err(|error| {
        format!(
            "{}: {error}; expected the list of occlusions there and the nine motions of the CMU database as {}; put them into that folder, \
             or name another one with the environment variable MOCAP_SHARED",
            list.display(),
            folder.join("data/cmu9/*.csv").display()
        )
    })?;
    let all = parse(&text).map_err(|problem| format!("{}: {problem}", list.display()))?;
    if let Some(unknown) = motions.iter().find(|motion| all.iter().all(|case| case.motion != **motion)) {
        let mut known: Vec<&str> = all.iter().map(|case| case.motion.as_str()).collect();
        known.dedup();
        return Err(format!("--motions {unknown}: no case is about it; expected one of: {}", known.join(", ")));
    }
    let wanted = |case: &Case| motions.is_empty() || motions.contains(&case.motion);
    // a limit on the trials is for haste; the worked examples are two only
    let cases: Vec<Case> = all.into_iter().filter(|case| wanted(case) && (case.kind == Kind::Paper || case.trial < trials)).collect();
    let mut takes = BTreeMap::new();
    for case in &cases {
        let path = folder.join("data/cmu9").join(format!("{}.csv", case.motion));
        if !takes.contains_key(&case.motion) {
            let stated = Stated { rate_hz: Some(RATE_HZ), unit: Some(Unit::Millimetre), ..Stated::default() };
            let opened = input::open(&path, &stated.into()).map_err(|error| error.to_string())?;
            takes.insert(case.motion.clone(), opened.document.take().clone());
        }
        if let Some(take) = takes.get(&case.motion) {
            check(case, take).map_err(|problem| format!("{}: {problem}", path.display()))?;
        }
    }
    Ok((cases, takes))
}

/// Reads the list and leaves out the kinds that the paper does not have.
fn parse(text: &str) -> Result<Vec<Case>, String> {
    let listed: Vec<Listed> = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let mut cases = Vec::new();
    for Listed { motion, kind, trial, gaps } in listed {
        let kind = match kind.as_str() {
            "single" => Kind::Single,
            "paper" => Kind::Paper,
            _ => continue,
        };
        let gap = |&[marker, first, last]: &[usize; 3]| {
            if first > last {
                return Err(format!("{motion} trial {trial} hides frames {first} to {last}; the last comes before the first"));
            }
            Ok(Gap { marker, start: first, end: last + 1 })
        };
        let hidden = gaps.iter().map(gap).collect::<Result<_, _>>()?;
        cases.push(Case { motion, kind, trial, hidden });
    }
    Ok(cases)
}

/// Every sample that is hidden must be there, or its error could not be measured.
fn check(case: &Case, take: &Take) -> Result<(), String> {
    for gap in &case.hidden {
        if let Some(frame) = (gap.start..gap.end).find(|&frame| take.position_mm(frame, gap.marker).is_none()) {
            return Err(format!(
                "a case hides marker {} in frame {frame}; the file has {} markers, {} frames, and no such sample",
                gap.marker,
                take.markers.len(),
                take.frames()
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mocap_repair::demo::walk;

    #[test]
    fn the_list_names_the_last_hidden_frame_too() {
        let text = r#"[{"motion": "a", "kind": "single", "trial": 3, "gaps": [[36, 82, 119]]},
                       {"motion": "a", "kind": "limb", "trial": 0, "gaps": [[1, 2, 3]]}]"#;
        let hidden = vec![Gap { marker: 36, start: 82, end: 120 }];
        assert_eq!(parse(text), Ok(vec![Case { motion: "a".into(), kind: Kind::Single, trial: 3, hidden }]));
        assert!(parse(&text.replace("119", "81")).is_err_and(|problem| problem.contains("frames 82 to 81")));
    }

    #[test]
    fn a_case_hides_what_is_there() {
        let take = walk(60, 120.0, 1);
        let case = |end| Case { motion: "a".into(), kind: Kind::Single, trial: 0, hidden: vec![Gap { marker: 2, start: 50, end }] };
        assert_eq!(check(&case(60), &take), Ok(()));
        assert!(check(&case(61), &take).is_err_and(|problem| problem.contains("frame 60")));
    }
}
