//! What the search for spikes and swaps finds of faults that were put into clean takes, and what it finds that was not put there.
//!
//! `cargo run --release --example suspects`; `docs/suspects.md` has the table that it prints.
//! Besides the takes of `demo` it uses some of the takes that are looked for at `../shared`, or where `MOCAP_SHARED` says, and says so if they are not there.

mod faults;
mod fills;

use clap::Parser;
use faults::{Dice, Fault, decimated, put};
use formats::{Stated, Take, Unit};
use mocap_repair::bones;
use mocap_repair::demo::walk;
use mocap_repair::input::open;
use mocap_repair::repair::neighbours;
use mocap_repair::solve::Method;
use mocap_repair::suspects::{self, Kind};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The takes of the database in which nothing is found: what is found in the others was looked at, and is mostly real.
const CLEAN: [&str; 5] = ["127_07", "132_32", "132_43", "132_46", "141_04"];

/// Puts faults into clean takes and prints how many are found.
#[derive(Parser)]
struct Args {
    /// How often each sort of fault is put into each take
    #[arg(long, default_value_t = 3)]
    rounds: u64,
    /// Print the faults that are missed, and what is found and was not put there
    #[arg(long)]
    each: bool,
    /// Only faults with this in their name
    #[arg(long, default_value = "")]
    only: String,
    /// Instead: what faults cost the fills of other markers with this method, and what dropping suspects gives back
    #[arg(long, value_parser = |text: &str| Method::parse(text).ok_or("unknown"))]
    fills: Option<Method>,
}

const FAULTS: [Fault; 20] = [
    Fault::Spike(10.0),
    Fault::Spike(20.0),
    Fault::Spike(50.0),
    Fault::Spike(100.0),
    Fault::Spike(300.0),
    Fault::Excursion(30.0),
    Fault::Excursion(50.0),
    Fault::Excursion(100.0),
    Fault::Excursion(300.0),
    Fault::Ghost(20.0),
    Fault::Ghost(50.0),
    Fault::Ghost(100.0),
    Fault::Swap(30.0, 50.0),
    Fault::Swap(50.0, 100.0),
    Fault::Swap(100.0, 200.0),
    Fault::Swap(200.0, 600.0),
    Fault::SwapInGaps(50.0, 100.0),
    Fault::SwapInGaps(100.0, 150.0),
    Fault::SwapInGaps(150.0, 250.0),
    Fault::SwapInGaps(250.0, 600.0),
];

/// What was put in and what was found.
#[derive(Default)]
struct Tally {
    put: usize,
    found: usize,
    /// As a swap of the right two.
    named: usize,
    findings: usize,
    wrong: usize,
    samples: usize,
}

fn takes() -> Vec<(String, Take)> {
    let mut takes: Vec<(String, Take)> = (1..=5).map(|seed| (format!("walk {seed}"), walk(900, 120.0, seed))).collect();
    let shared = std::env::var_os("MOCAP_SHARED").map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    for name in CLEAN {
        let path = shared.join("data/cmu9").join(format!("{name}.csv"));
        let stated = Stated { rate_hz: Some(120.0), unit: Some(Unit::Millimetre), ..Stated::default() };
        match open(&path, &stated.into()) {
            Ok(opened) => takes.push((name.to_owned(), opened.document.take().clone())),
            Err(error) => {
                let _ = writeln!(std::io::stderr(), "left out: {error}");
            }
        }
    }
    takes
}

fn look(take: &Take) -> Vec<suspects::Suspect> {
    suspects::find(take, &bones::find(take, &neighbours(take)))
}

fn main() -> std::io::Result<()> {
    let args = Args::parse();
    let mut out = std::io::stdout().lock();
    let takes = takes();
    if let Some(method) = args.fills {
        return fills::table(&takes, args.rounds, method, &mut out);
    }
    for step in [1, 4] {
        let takes: Vec<(&str, Take)> = takes.iter().map(|(name, take)| (name.as_str(), decimated(take, step))).collect();
        let clean: Vec<usize> = takes.iter().map(|(_, take)| look(take).len()).collect();
        let samples: usize = takes.iter().map(|(_, take)| take.frames() * take.markers.len()).sum();
        writeln!(out, "\n{} Hz: {} found in {samples} clean samples\n", 120 / step, clean.iter().sum::<usize>())?;
        writeln!(
            out,
            "| fault | put in | found | as a swap of the two | findings | not put there | per 100,000 samples |\n|---|---|---|---|---|---|---|"
        )?;
        for fault in FAULTS.into_iter().filter(|f| f.name().contains(&args.only)) {
            let mut tally = Tally::default();
            for (at, (name, take)) in takes.iter().enumerate() {
                for round in 0..args.rounds {
                    let (wrong, faults) = put(take, fault, &mut Dice::new(1000 * at as u64 + round));
                    let found = look(&wrong);
                    tally.samples += take.frames() * take.markers.len();
                    for fault in &faults {
                        tally.put += 1;
                        let (mut all, mut hit, mut named) = (0, 0, 0);
                        for &marker in &fault.markers {
                            for frame in fault.frames.clone() {
                                all += 1;
                                let here = |s: &&suspects::Suspect| s.marker == marker && (s.start..s.end).contains(&frame);
                                let suspect = found.iter().find(here);
                                hit += usize::from(suspect.is_some());
                                let partner = suspect.filter(|s| s.kind == Kind::Swap).and_then(|s| s.with);
                                named += usize::from(partner.is_some_and(|with| with != marker && fault.markers.contains(&with)));
                            }
                        }
                        tally.found += usize::from(2 * hit >= all);
                        tally.named += usize::from(2 * named >= all);
                        if args.each && 2 * hit < all {
                            let labels = fault.markers.iter().map(|&m| take.display_label(m)).collect::<Vec<_>>().join("/");
                            writeln!(out, "  missed in {name}, {round}: {labels} {:?}, {hit} of {all}", fault.frames)?;
                        }
                    }
                    for suspect in &found {
                        tally.findings += 1;
                        let put = |frame| faults.iter().any(|f| f.markers.contains(&suspect.marker) && f.frames.contains(&frame));
                        let right = suspect.samples(&wrong).filter(|&(frame, _)| put(frame)).count();
                        let false_one = 2 * right < suspect.samples(&wrong).count();
                        tally.wrong += usize::from(false_one);
                        if args.each && false_one {
                            writeln!(out, "  not put into {name}, {round}: {:?}, {}", suspect.kind, suspect.sentence(&wrong))?;
                        }
                    }
                }
            }
            let share = |part: usize| format!("{:.1} %", 100.0 * part as f64 / tally.put.max(1) as f64);
            let swap = matches!(fault, Fault::Swap(..) | Fault::SwapInGaps(..));
            let named = if swap { share(tally.named) } else { String::new() };
            let rate = 1e5 * tally.wrong as f64 / tally.samples.max(1) as f64;
            let Tally { put, found, findings, wrong, .. } = tally;
            writeln!(out, "| {} | {put} | {} | {named} | {findings} | {wrong} | {rate:.2} |", fault.name(), share(found))?;
        }
    }
    Ok(())
}
