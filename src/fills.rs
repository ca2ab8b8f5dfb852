//! The filled samples: written into the take, and as a table for whoever wants to know each of them.

use crate::gaps::Open;
use crate::solve::auto::LEAST_SEEN;
use crate::solve::{Estimate, Gap, Method, Problem};
use formats::{Origin, Take, TakeBuilder};
use std::collections::BTreeMap;
use std::io::{self, Write};

/// A sample that was filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filled {
    /// Counted from 0.
    pub frame: usize,
    /// Column of the take.
    pub marker: usize,
    /// Index of its gap in the list of gaps.
    pub gap: usize,
    /// Position, mm.
    pub position_mm: [f64; 3],
    /// Predicted standard deviation of the 3-D error, mm; NaN if the method cannot say.
    pub sigma_mm: f64,
}

/// Fills the gaps that were decided for, whole or not at all, and returns their samples, gap by gap.
/// A gap for which the estimate has a hole, or is less sure than `max_sigma_mm`, stays open, and its decision says why.
pub fn fill(
    take: &mut Take,
    problem: &Problem,
    estimate: &Estimate,
    gaps: &[Gap],
    decisions: &mut [Result<(), Open>],
    max_sigma_mm: Option<f64>,
) -> Vec<Filled> {
    let mut filled = Vec::new();
    for ((at, gap), decision) in gaps.iter().enumerate().zip(decisions) {
        if decision.is_err() {
            continue;
        }
        let samples: Option<Vec<Filled>> = problem.columns.binary_search(&gap.marker).ok().and_then(|column| {
            (gap.start..gap.end)
                .map(|frame| {
                    let k = problem.missing.binary_search(&(frame, column)).ok()?;
                    let position_mm = *estimate.positions_mm.get(k)?;
                    position_mm.iter().all(|x| x.is_finite()).then(|| Filled {
                        frame,
                        marker: gap.marker,
                        gap: at,
                        position_mm,
                        sigma_mm: estimate.sigma_mm.get(k).copied().unwrap_or(f64::NAN),
                    })
                })
                .collect()
        });
        match samples {
            // an error that is not known may be any
            Some(samples) if max_sigma_mm.is_some_and(|most| samples.iter().any(|s| s.sigma_mm.is_nan() || s.sigma_mm > most)) => {
                *decision = Err(Open::TooUnsure);
            }
            Some(samples) => {
                for mut s in samples {
                    take.fill(s.frame, s.marker, s.position_mm);
                    // what the file gives of a partial sample stays, so the take knows better than the estimate
                    s.position_mm = take.position_mm(s.frame, s.marker).unwrap_or(s.position_mm);
                    filled.push(s);
                }
            }
            None => {
                let seen = (0..take.frames()).filter(|&frame| take.position_mm(frame, gap.marker).is_some()).take(LEAST_SEEN).count();
                *decision = Err(if seen < LEAST_SEEN { Open::TooFewSeen } else { Open::Unsolved });
            }
        }
    }
    filled
}

/// Brings filled samples, and the repaired take, to where the written file has them. What they were moved by adds to their predicted error.
pub fn as_written(samples: &mut [Filled], repaired: Take, written: &Take) -> Take {
    let mut moved = TakeBuilder::from(repaired);
    for s in samples {
        let Some(position_mm) = written.position_mm(s.frame, s.marker) else { continue };
        let by_mm = position_mm.iter().zip(s.position_mm).map(|(is, was)| (is - was).powi(2)).sum::<f64>().sqrt();
        s.position_mm = position_mm;
        s.sigma_mm = s.sigma_mm.hypot(by_mm);
        moved.set(s.frame, s.marker, position_mm, Origin::Repaired);
    }
    moved.build()
}

/// Writes one row per filled sample: `frame_index` (from 0), `frame` (the file's number), `marker`, `x`, `y`, `z` (mm), `sigma_mm` (empty if unknown),
/// `gap` (from 1), `method`.
///
/// # Errors
/// I/O errors of `out`.
pub fn write(samples: &[Filled], take: &Take, method: Method, out: &mut dyn Write) -> io::Result<()> {
    let mut text = io::BufWriter::new(out);
    writeln!(text, "frame_index,frame,marker,x,y,z,sigma_mm,gap,method")?;
    for s in samples {
        let [x, y, z] = s.position_mm;
        let sigma = if s.sigma_mm.is_finite() { format!("{:.3}", s.sigma_mm) } else { String::new() };
        let label = crate::bones::quoted(&take.display_label(s.marker));
        writeln!(text, "{},{},{label},{x:.4},{y:.4},{z:.4},{sigma},{},{}", s.frame, take.frame_label(s.frame), s.gap + 1, method.name())?;
    }
    text.flush()
}

/// Reads from a table that [`write`] made how sure its samples are: by frame, counted from 0, and column of the take, the standard deviation in mm, NaN where
/// it is unknown.
///
/// # Errors
/// It is no such table, or not of this take; the text begins with the line.
pub fn read_sigmas(text: &[u8], take: &Take) -> Result<BTreeMap<(usize, usize), f64>, String> {
    let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(text);
    let header = reader.headers().map_err(|_| "line 1: not text in CSV form".to_owned())?.clone();
    let column = |name: &str| {
        let found = header.iter().position(|cell| cell.trim_start_matches('\u{feff}') == name);
        found.ok_or_else(|| format!("line 1: the header has no column {name}; expected is a table that --fills wrote"))
    };
    let (frame, marker, sigma) = (column("frame_index")?, column("marker")?, column("sigma_mm")?);
    let columns: BTreeMap<String, usize> = (0..take.markers.len()).rev().map(|m| (take.display_label(m), m)).collect();
    let mut sigmas = BTreeMap::new();
    for (at, record) in reader.records().enumerate() {
        let line = at as u64 + 2;
        let record = record.map_err(|e| format!("line {}: not text in CSV form", e.position().map_or(line, csv::Position::line)))?;
        let line = record.position().map_or(line, csv::Position::line);
        let cell = |column: usize| record.get(column).unwrap_or_default();
        let Some(frame) = cell(frame).parse::<usize>().ok().filter(|frame| *frame < take.frames()) else {
            return Err(format!(
                "line {line}: frame_index \"{}\" is no frame of the take, which has 0 to {}",
                cell(frame),
                take.frames().max(1) - 1
            ));
        };
        let Some(&marker) = columns.get(cell(marker)) else {
            return Err(format!("line {line}: marker \"{}\" is not in the take", cell(marker)));
        };
        let sigma = match cell(sigma) {
            "" => f64::NAN,
            text => match text.parse::<f64>() {
                Ok(sigma) if sigma >= 0.0 && sigma.is_finite() => sigma,
                _ => return Err(format!("line {line}: sigma_mm \"{text}\" is not a standard deviation in mm")),
            },
        };
        sigmas.insert((frame, marker), sigma);
    }
    Ok(sigmas)
}
