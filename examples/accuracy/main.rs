//! How accurate a method is on gaps cut into whole takes, and what each ingredient of `auto` is worth.
//!
//! `cargo run --release --example accuracy -- --help`; `docs/accuracy.md` says what it shows.
//! The takes and the list of occlusions are not part of this repository: they are looked for at `../shared`, or where `MOCAP_SHARED` says.

mod masks;

use clap::Parser;
use formats::{Stated, Take, TakeBuilder, Unit};
use mocap_repair::bones;
use mocap_repair::input::open;
use mocap_repair::repair::neighbours;
use mocap_repair::solve::auto::Recipe;
use mocap_repair::solve::{Limits, Method, Problem, Settings};
use mocap_repair::suspects;
use rayon::prelude::*;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The database recorded its motions at this rate; the CSV files do not say so.
const RATE_HZ: f64 = 120.0;

/// Hides what a list of occlusions says, fills it, and prints how far off the fill is.
#[derive(Parser)]
struct Args {
    /// The method
    #[arg(long, default_value = "auto", value_parser = |text: &str| Method::parse(text).ok_or("unknown"))]
    method: Method,
    /// Lists of occlusions (JSON) [default: the one beside the takes]
    #[arg(long, value_name = "FILE")]
    cases: Vec<PathBuf>,
    /// Takes the gaps of all takes in this folder instead of a list
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["cases", "kinds", "trials"])]
    masks: Option<PathBuf>,
    /// With --masks: another set of the kind
    #[arg(long, value_name = "N", default_value_t = 0, requires = "masks")]
    set: usize,
    /// Kinds of occlusion
    #[arg(long, value_delimiter = ',', default_value = "single,limb,scattered,blackout,paper")]
    kinds: Vec<String>,
    /// Only trials below this number
    #[arg(long, default_value_t = usize::MAX)]
    trials: usize,
    /// Leave ingredients of auto out
    #[arg(long, value_delimiter = ',')]
    without: Vec<String>,
    /// Fill nothing from samples that no body makes
    #[arg(long)]
    ignore_outliers: bool,
    /// Print each case
    #[arg(long)]
    each: bool,
}

/// One occlusion case as the list writes it.
#[derive(Clone, Deserialize)]
struct Case {
    motion: String,
    kind: String,
    trial: usize,
    /// Column, first and last hidden frame.
    gaps: Vec<[usize; 3]>,
}

/// How far off a fill is.
struct Score {
    rmse_mm: f64,
    /// Root mean squares of error and of predicted error, and how many errors lie within twice the predicted one.
    calibration: f64,
    within: f64,
    /// How far the bones are off: in filled frames, and in those that were seen, mean absolute, mm.
    bones: [f64; 2],
    seconds: f64,
}

fn main() -> ExitCode {
    match work(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            let _ = writeln!(std::io::stderr(), "accuracy: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn work(args: &Args) -> Result<(), String> {
    let shared = std::env::var_os("MOCAP_SHARED").map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let lists = if args.cases.is_empty() { vec![shared.join("bench/cases.json")] } else { args.cases.clone() };
    let mut recipe = Recipe::default();
    for name in &args.without {
        recipe.leave_out(name).map_err(|known| format!("--without {name}: expected one of: {known}"))?;
    }
    let mut out = std::io::stdout().lock();
    let takes = takes(&shared.join("data/cmu9"))?;
    let (lists, kinds) = match &args.masks {
        Some(folder) => (vec![(folder, masks::cases(folder, &takes, args.set)?)], vec![masks::KIND.to_owned()]),
        None => (lists.iter().map(|list| Ok((list, listed(list, args)?))).collect::<Result<Vec<_>, String>>()?, args.kinds.clone()),
    };
    for (list, cases) in &lists {
        let take = |case: &Case| takes.get(&case.motion).ok_or_else(|| format!("{}: there is no take {}", list.display(), case.motion));
        let scores: Vec<Score> = cases.par_iter().map(|case| judge(case, take(case)?, args, &recipe)).collect::<Result<_, _>>()?;
        let mut print = |text: String| writeln!(out, "{text}").map_err(|e| e.to_string());
        print(format!("{} {}", list.display(), args.without.join(",")))?;
        if args.each {
            for (case, score) in cases.iter().zip(&scores) {
                let [marker, first, last] = case.gaps[0];
                print(format!(
                    "{} {} {}: {:.2} mm, calibration {:.2}, {} frames of {marker} from {first}",
                    case.motion,
                    case.kind,
                    case.trial,
                    score.rmse_mm,
                    score.calibration,
                    last + 1 - first
                ))?;
            }
        }
        for kind in &kinds {
            let own: Vec<&Score> = cases.iter().zip(&scores).filter(|(c, _)| c.kind == *kind).map(|(_, s)| s).collect();
            if own.is_empty() {
                continue;
            }
            let mean = |f: &dyn Fn(&Score) -> f64| own.iter().map(|s| f(s)).sum::<f64>() / own.len() as f64;
            let at = |share: f64, f: &dyn Fn(&Score) -> f64| {
                let mut values: Vec<f64> = own.iter().map(|s| f(s)).collect();
                values.sort_by(f64::total_cmp);
                let place = share * (values.len() - 1) as f64;
                let (low, high) = (values[place.floor() as usize], values[place.ceil() as usize]);
                low + (high - low) * place.fract()
            };
            print(format!(
                "{kind:10} {:4} median {:6.2} mean {:6.2} p90 {:6.2} mm | error/sigma {:.2}, within 2 sigma {:.2} | bones {:.2} (seen {:.2}) mm | {:.2} s",
                own.len(),
                at(0.5, &|s| s.rmse_mm),
                mean(&|s| s.rmse_mm),
                at(0.9, &|s| s.rmse_mm),
                at(0.5, &|s| s.calibration),
                mean(&|s| s.within),
                mean(&|s| s.bones[0]),
                mean(&|s| s.bones[1]),
                mean(&|s| s.seconds)
            ))?;
        }
    }
    Ok(())
}

/// The takes in a folder, by their names.
fn takes(folder: &Path) -> Result<BTreeMap<String, Take>, String> {
    let stated = Stated { rate_hz: Some(RATE_HZ), unit: Some(Unit::Millimetre), ..Stated::default() };
    let mut takes = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))? {
        let path = entry.map_err(|e| format!("{}: {e}", folder.display()))?.path();
        if path.extension().is_some_and(|e| e == "csv") {
            let opened = open(&path, &stated.clone().into()).map_err(|e| e.to_string())?;
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            takes.insert(name, opened.document.take().clone());
        }
    }
    if takes.is_empty() {
        return Err(format!("{}: there are no takes", folder.display()));
    }
    Ok(takes)
}

/// The cases that a list has of the kinds that are asked for.
fn listed(list: &Path, args: &Args) -> Result<Vec<Case>, String> {
    let text = std::fs::read_to_string(list).map_err(|e| format!("{}: {e}", list.display()))?;
    let cases: Vec<Case> = serde_json::from_str(&text).map_err(|e| format!("{}: {e}", list.display()))?;
    Ok(cases.into_iter().filter(|c| args.kinds.contains(&c.kind) && (c.trial < args.trials || c.kind == "paper")).collect())
}

fn judge(case: &Case, truth: &Take, args: &Args, recipe: &Recipe) -> Result<Score, String> {
    let mut builder = TakeBuilder::from(truth.clone());
    for &[marker, first, last] in &case.gaps {
        for frame in first..=last {
            builder.hide(frame, marker);
        }
    }
    let mut holed = builder.build();
    let hidden: BTreeSet<(usize, usize)> =
        case.gaps.iter().flat_map(|&[marker, first, last]| (first..=last).map(move |frame| (frame, marker))).collect();
    let everybody = neighbours(&holed);
    if args.ignore_outliers {
        let suspects = suspects::find(&holed, &bones::find(&holed, &everybody));
        holed = holed.without(&suspects::samples(&suspects, &holed));
    }
    let began = std::time::Instant::now();
    let problem = Problem::new(&holed, &everybody, &bones::find(&holed, &everybody));
    let settings = Settings { recipe: *recipe, ..Settings::default() };
    let estimate = args.method.solve(&problem, &settings, &Limits::default(), &mut ()).estimate;
    let seconds = began.elapsed().as_secs_f64();
    let (mut squares, mut variances, mut within) = (0.0, 0.0, 0usize);
    for (k, &(t, column)) in problem.missing.iter().enumerate() {
        if !hidden.contains(&(t, problem.columns[column])) {
            continue; // an outlier that was ignored
        }
        let real = truth.position_mm(t, problem.columns[column]).ok_or("a case hides what the take does not have")?;
        let found = estimate.positions_mm[k];
        let error = (0..3).map(|axis| (real[axis] - found[axis]).powi(2)).sum::<f64>();
        squares += error;
        variances += estimate.sigma_mm[k].powi(2);
        within += usize::from(error.sqrt() <= 2.0 * estimate.sigma_mm[k]);
    }
    let n = hidden.len() as f64;
    let place = |t: usize, i: usize| {
        problem
            .missing
            .binary_search(&(t, i))
            .map_or_else(|_| problem.position_mm(t, i).unwrap_or([f64::NAN; 3]), |k| estimate.positions_mm[k])
    };
    let (mut off, mut counts) = ([0.0; 2], [0usize; 2]);
    for bone in &problem.bones {
        for t in 0..problem.frames() {
            let (a, b) = (place(t, bone.a), place(t, bone.b));
            let length = (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt();
            let seen = usize::from(problem.observed(t, bone.a) && problem.observed(t, bone.b));
            off[seen] += (length - bone.length_mm).abs();
            counts[seen] += 1;
        }
    }
    Ok(Score {
        rmse_mm: (squares / n).sqrt(),
        calibration: (squares / variances).sqrt(),
        within: within as f64 / n,
        bones: [off[0] / counts[0].max(1) as f64, off[1] / counts[1].max(1) as f64],
        seconds,
    })
}
