//! Real files, which are not part of this repository: `../shared/data`, or wherever `MOCAP_SHARED` points.
//!
//! Each file is a test of its own: it opens as the manifest of the collection says or is refused as this file says, and saving it unchanged
//! gives the same bytes. Where the folder is absent, one ignored test says so.
#![allow(clippy::unwrap_used)] // A test program: it fails by panicking.

mod bvh;
mod c3d;
#[path = "../../formats/fuzz/checks.rs"]
#[allow(dead_code)] // the fuzz targets use the rest
mod checks;
mod kineben;
mod solved;
mod survey;
mod tables;
mod text;
mod tracked;

use formats::{Format, Notes, Origin, Stated, Take};
use libtest_mimic::{Arguments, Failed, Trial};
use mocap_repair::solve::{self, Limits, Method, Problem, Settings};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What the manifest says about a file, by the name of its column.
type Row = BTreeMap<String, String>;

/// Reads a table with quoted cells; no cell of the manifest has a line break.
fn manifest(text: &str) -> Vec<Row> {
    let cells = |line: &str| {
        let (mut cells, mut quoted) = (vec![String::new()], false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => cells.push(String::new()),
                _ => cells.last_mut().unwrap().push(c),
            }
        }
        cells
    };
    let mut lines = text.lines();
    let head = cells(lines.next().unwrap_or_default());
    lines.map(|line| head.iter().cloned().zip(cells(line)).collect()).collect()
}

fn expect<T: PartialEq + std::fmt::Debug + Copy>(what: &str, found: T, expected: T) -> Result<(), Failed> {
    if found == expected { Ok(()) } else { Err(format!("{what}: found {found:?}, expected {expected:?}").into()) }
}

fn missing(take: &Take) -> usize {
    (0..take.frames()).map(|f| (0..take.markers.len()).filter(|&m| take.origin(f, m) == Origin::Missing).count()).sum()
}

/// One of the paper's worked examples: markers hidden in a range of frames of a take.
struct Example {
    take: &'static str,
    hidden: [&'static str; 2],
    frames: std::ops::Range<usize>,
    /// Root mean square 3-D error that the default method must not exceed, mm. The authors' program reaches 31.3 and 26.1.
    bound_mm: f64,
}

const EXAMPLES: [Example; 2] = [
    Example { take: "127_07", hidden: ["RKNE", "RSHN"], frames: 24..90, bound_mm: 28.0 },
    Example { take: "132_43", hidden: ["RELB", "RFRM"], frames: 99..500, bound_mm: 25.0 },
];

fn worked_example(path: &Path, example: &Example) -> Result<(), Failed> {
    let stated = Stated { rate_hz: Some(120.0), ..Stated::default() };
    let document = formats::csv::Csv.open(std::fs::read(path)?, &stated, &Notes::new())?;
    let truth = document.take();
    let gapped = example.hidden.iter().fold(truth.clone(), |take, name| mocap_repair::demo::hide(&take, name, example.frames.clone()));
    let everybody = vec![true; truth.markers.len()];
    let problem = Problem::new(&gapped, &everybody, &mocap_repair::bones::find(&gapped, &everybody));
    let mut solver = Method::BoleroSc.solver(&problem, &Settings::default());
    let limits = Limits::default();
    let outcome = solve::run(solver.as_mut(), &problem, 0, &limits, &mut ());
    expect("stop", outcome.stop, solve::Stop::Converged)?;
    let mut squares = 0.0;
    for (&(frame, column), place) in problem.missing.iter().zip(&solver.estimate().positions_mm) {
        let was = truth.position_mm(frame, problem.columns[column]).ok_or("the truth has a hole")?;
        squares += (0..3).map(|k| (place[k] - was[k]).powi(2)).sum::<f64>();
    }
    expect("hidden samples", problem.missing.len(), 2 * example.frames.len())?;
    let rmse = (squares / problem.missing.len() as f64).sqrt();
    if rmse <= example.bound_mm { Ok(()) } else { Err(format!("{rmse:.1} mm, expected at most {} mm", example.bound_mm).into()) }
}

/// Takes with real gaps, repaired from file to file: every byte outside the 16 (or 8) bytes of a filled point equals the input's.
const REPAIRED: [&str; 3] =
    ["nimble_c3d_squat.c3d", "kineticstoolkit__data_kinematics_sprintbasket.c3d", "BTKData__Input_TDFSamples_gait9.tdf.c3d"];

fn repaired(path: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let output = folder.path().join("out.c3d");
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_mocap-repair"))
        .arg(path)
        .args(["--method", "spline", "--no-log", "--json", "-o"])
        .arg(&output)
        .output()?;
    // each of them has gaps at its ends, which stay open
    expect("exit code", run.status.code(), Some(3))?;
    let (before, after) = (std::fs::read(path)?, std::fs::read(&output)?);
    expect("bytes", after.len(), before.len())?;
    let open = |bytes: &[u8]| formats::c3d::C3d.open(bytes.to_vec(), &Stated::default(), &Notes::new());
    let (was, is) = (open(&before)?, open(&after)?);
    let (was, is) = (was.take(), is.take());
    let filled: usize = (0..was.frames())
        .map(|f| (0..was.markers.len()).filter(|&m| was.origin(f, m) == Origin::Missing && is.origin(f, m) != Origin::Missing).count())
        .sum();
    // count the points that differ by walking over the bytes point by point: no more of them than were filled
    let size = 16;
    let first = before.iter().zip(&after).position(|(a, b)| a != b).ok_or("nothing was filled")?;
    let mut touched = 0usize;
    let mut at = first;
    while let Some(next) = before.get(at..).and_then(|rest| rest.iter().zip(&after[at..]).position(|(a, b)| a != b)) {
        touched += 1;
        at += next + size; // the next difference can be no nearer than where this point ends, or it is counted twice
    }
    if touched > filled {
        return Err(format!("{touched} places of {size} bytes differ, but {filled} samples were filled").into());
    }
    for f in 0..was.frames() {
        for m in 0..was.markers.len() {
            if let Some(p) = was.position_mm(f, m) {
                expect("a known sample", is.position_mm(f, m), Some(p))?;
            }
        }
    }
    Ok(())
}

fn main() {
    let folder = std::env::var_os("MOCAP_SHARED").map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let mut trials = Vec::new();
    let mut suite = |name: &str, tests: Vec<Trial>| {
        if tests.is_empty() {
            let loud = format!("{name}: SHARED DATA IS ABSENT, NOTHING WAS TESTED (set MOCAP_SHARED; looked in {})", folder.display());
            trials.push(Trial::test(loud, || Ok(())).with_ignored_flag(true));
        }
        trials.extend(tests);
    };
    let rows = std::fs::read_to_string(folder.join("data/MANIFEST.csv")).map(|text| manifest(&text)).unwrap_or_default();
    let mut tests = Vec::new();
    let of = |extension: &str| -> Vec<Row> {
        rows.iter().filter(|row| row.get("file").is_some_and(|f| f.to_ascii_lowercase().ends_with(extension))).cloned().collect()
    };
    for row in of(".c3d") {
        let file = row.get("file").cloned().unwrap_or_default();
        let path = folder.join("data").join(&file);
        tests.push(Trial::test(file, move || c3d::c3d(&path, &row)));
    }
    if !tests.is_empty() {
        let count = tests.len();
        tests.push(Trial::test(
            "c3d: the collection is whole",
            move || if count >= 70 { Ok(()) } else { Err(format!("{count} files").into()) },
        ));
    }
    suite("c3d", tests);
    let mut tests = Vec::new();
    let mut tables: Vec<PathBuf> =
        std::fs::read_dir(folder.join("data/csv")).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    tables.sort();
    for path in tables {
        let name = format!("csv/{}", path.file_name().unwrap().to_string_lossy());
        tests.push(Trial::test(name, move || tables::table(&path)));
    }
    if !tests.is_empty() {
        let count = tests.len();
        tests.push(Trial::test("csv: the collection is whole", move || {
            expect("files", count, tables::TABLES.len() + tables::REFUSED_TABLES.len())
        }));
    }
    suite("csv", tests);
    for (extension, least) in [("trc", 16), ("tsv", 1)] {
        let mut tests = Vec::new();
        for row in &rows {
            let file = row.get("file").cloned().unwrap_or_default();
            if !file.starts_with(&format!("{extension}/")) {
                continue;
            }
            let (path, row) = (folder.join("data").join(&file), row.clone());
            tests.push(Trial::test(file, move || text::text(&path, &row, extension)));
        }
        if !tests.is_empty() {
            let count = tests.len();
            let whole = move || if count >= least { Ok(()) } else { Err(format!("{count} files").into()) };
            tests.push(Trial::test(format!("{extension}: the collection is whole"), whole));
        }
        suite(extension, tests);
    }
    let mut tests = Vec::new();
    for row in of(".bvh") {
        let file = row.get("file").cloned().unwrap_or_default();
        let path = folder.join("data").join(&file);
        tests.push(Trial::test(file, move || bvh::bvh(&path, &row)));
    }
    if !tests.is_empty() {
        let count = tests.len();
        tests.push(Trial::test(
            "bvh: the collection is whole",
            move || {
                if count >= 30 { Ok(()) } else { Err(format!("{count} files").into()) }
            },
        ));
    }
    suite("bvh", tests);
    let mut tests = Vec::new();
    for (name, clouds) in kineben::SEQUENCES {
        let path = folder.join("data/kineben").join(name);
        if path.exists() {
            tests.push(Trial::test(format!("kineben/{name}"), move || kineben::sequence(&path, clouds)));
        }
    }
    suite("rig", tests);
    let mut tests = Vec::new();
    if !rows.is_empty() {
        let (data, rows) = (folder.join("data"), rows.clone());
        tests.push(Trial::test("what becomes of every file", move || survey::survey(&data, &rows)));
    }
    suite("survey", tests);
    let mut tests = Vec::new();
    for example in &EXAMPLES {
        let path = folder.join("data/cmu9").join(format!("{}.csv", example.take));
        if path.exists() {
            tests.push(Trial::test(format!("worked example {}", example.take), move || worked_example(&path, example)));
        }
    }
    suite("worked examples", tests);
    let mut tests = Vec::new();
    for name in REPAIRED {
        let path = folder.join("data/c3d").join(name);
        if path.exists() {
            tests.push(Trial::test(format!("repaired {name}"), move || repaired(&path)));
        }
    }
    suite("repaired", tests);
    suite("tracked", tracked::trials(&folder.join("data")));
    suite("solved", solved::trials(&folder.join("data")));
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
