//! What faults cost the fills of other markers, and what dropping suspects gives back.

use crate::faults::{Dice, Fault, put};
use formats::{Samples, Take};
use mocap_repair::bones;
use mocap_repair::repair::neighbours;
use mocap_repair::solve::{Limits, Method, Problem, Settings};
use mocap_repair::suspects;
use std::io::{self, Write};

/// The faults that are tried.
const FAULTS: [Fault; 6] = [
    Fault::Spike(50.0),
    Fault::Spike(300.0),
    Fault::Excursion(50.0),
    Fault::Excursion(300.0),
    Fault::Swap(50.0, 150.0),
    Fault::Swap(150.0, 600.0),
];

/// Errors, mm, of the samples `asked` after a repair of `take`.
fn errors(take: &Take, asked: &Samples, truth: &Take, method: Method) -> Vec<f64> {
    let every = neighbours(take);
    let problem = Problem::new(take, &every, &bones::find(take, &every));
    let limits = Limits { steps: 100, ..Limits::default() };
    let solved = method.solve(&problem, &Settings::default(), &limits, &mut ());
    let asked_for = |(frame, marker): (usize, usize)| {
        let column = problem.columns.binary_search(&marker).ok()?;
        let at = problem.missing.binary_search(&(frame, column)).ok()?;
        let (is, was) = (solved.estimate.positions_mm.get(at)?, truth.position_mm(frame, marker)?);
        Some((0..3).map(|k| (is[k] - was[k]).powi(2)).sum::<f64>().sqrt())
    };
    asked.iter().filter_map(asked_for).collect()
}

/// Root mean square.
fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Prints a table: for each fault, the error of gaps of a neighbour that last while it does, in the clean take, with the fault, and with suspects dropped.
pub fn table(takes: &[(String, Take)], rounds: u64, method: Method, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "\n{}: error of gaps beside a fault, RMS in mm\n", method.name())?;
    writeln!(out, "| fault | samples | no fault | fault | fault dropped |\n|---|---|---|---|---|")?;
    for fault in FAULTS {
        let mut columns: [Vec<f64>; 3] = Default::default();
        for (at, (_, take)) in takes.iter().enumerate() {
            for round in 0..rounds {
                let (wrong, faults) = put(take, fault, &mut Dice::new(7000 + 1000 * at as u64 + round));
                let every = neighbours(take);
                let stiff = bones::find(take, &every);
                let mut gaps = Samples::new();
                for put in &faults {
                    // the stiffest partner of the first marker that has no fault of its own
                    let partner = |bone: &&mocap_repair::solve::Bone| [bone.a, bone.b].contains(&put.markers[0]);
                    let mut partners: Vec<(f64, usize)> = stiff
                        .iter()
                        .filter(partner)
                        .map(|b| (b.spread_mm, if b.a == put.markers[0] { b.b } else { b.a }))
                        .filter(|(_, m)| !faults.iter().any(|f| f.markers.contains(m)))
                        .collect();
                    partners.sort_by(|x, y| x.0.total_cmp(&y.0));
                    let Some(&(_, marker)) = partners.first() else { continue };
                    let (start, end) = (put.frames.start.saturating_sub(20).max(2), (put.frames.end + 20).min(take.frames() - 2));
                    (start..end).for_each(|frame| gaps.insert(frame, marker));
                }
                let with_gaps = wrong.without(&gaps);
                let every = neighbours(&with_gaps);
                let found = suspects::find(&with_gaps, &bones::find(&with_gaps, &every));
                let dropped = with_gaps.without(&suspects::samples(&found, &with_gaps));
                for (column, tried) in columns.iter_mut().zip([&take.without(&gaps), &with_gaps, &dropped]) {
                    column.extend(errors(tried, &gaps, take, method));
                }
            }
        }
        let [clean, faulty, dropped] = columns.each_ref().map(|column| rms(column));
        writeln!(out, "| {} | {} | {clean:.1} | {faulty:.1} | {dropped:.1} |", fault.name(), columns[0].len())?;
    }
    Ok(())
}
