//! Files that want to do harm: every fixture, damaged in many ways, must open or be refused, without a panic, a hang, or much memory.
//!
//! `MOCAP_MUTATIONS` says how many damaged files are tried in all (20,000 if it is not set), and `MOCAP_HOSTILITY_TABLE=1` prints the figures
//! of `docs/reliability.md`. `MOCAP_HOSTILITY_DUMP=FOLDER` writes the damaged C3D files there instead, for other readers to be tried on.
//! What must hold is in `formats/fuzz/checks.rs`, which the fuzz targets share; their corpus is replayed here as well.
#![allow(clippy::unwrap_used, clippy::print_stdout, clippy::print_stderr)] // A test program: it fails by panicking, and prints figures.

#[path = "../../formats/fuzz/checks.rs"]
mod checks;
mod mutate;

use formats::{Notes, Stated};
use libtest_mimic::{Arguments, Failed, Trial};
use mutate::{Random, mutate};
use peak_alloc::PeakAlloc;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Memory that a file may cost: this many times its size ...
const TIMES_ITS_SIZE: usize = 20;
/// ... and this much, in bytes.
const AND_ALWAYS: usize = 64 << 20;
/// A file that takes longer hangs, and the whole program is ended, because there is no other way out. A slow machine is no hang.
const HANG: Duration = Duration::from_secs(20);
/// How many files are tried if nobody says it.
const MUTATIONS: usize = 20_000;

/// What was seen of one format.
#[derive(Clone, Copy, Debug, Default)]
struct Figures {
    tried: usize,
    opened: usize,
    slowest: Duration,
    /// Peak memory beyond the 20-fold of the file, at most.
    most_memory: usize,
}

static ALL: Mutex<Vec<(String, Figures)>> = Mutex::new(Vec::new());

/// When the present file was begun, in ms since the start of the program, and 0 between files.
static BEGUN: AtomicU64 = AtomicU64::new(0);

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files below `folder`, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            if entry.path().is_dir() { folders.push(entry.path()) } else { found.push(entry.path()) }
        }
    }
    found.retain(|path| path.extension().is_none_or(|e| e != "md"));
    found.sort();
    found
}

/// Runs the checks on one file, and says what it cost.
fn one(bytes: &[u8], figures: &mut Figures, program: Instant) -> Result<(), String> {
    BEGUN.store(program.elapsed().as_millis() as u64 + 1, Ordering::Relaxed);
    let opens = || {
        let format = formats::detect(bytes.get(..bytes.len().min(4096)).unwrap_or(bytes), None);
        let take = format.is_ok_and(|format| format.open(bytes.to_vec(), &Stated::default(), &Notes::new()).is_ok());
        take || formats::rig::read_mesh(bytes, &Notes::new()).is_ok() || formats::rig::read_skeleton(bytes, &Notes::new()).is_ok()
    };
    let checks =
        [("open_any", checks::open_any as fn(&[u8]) -> Result<(), String>), ("roundtrip", checks::roundtrip), ("rigs", checks::rigs)];
    for (name, check) in checks {
        MEMORY.reset_peak_usage();
        let before = MEMORY.current_usage();
        let begun = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| check(bytes)));
        let took = begun.elapsed();
        let cost = MEMORY.peak_usage().saturating_sub(before);
        figures.slowest = figures.slowest.max(took);
        figures.most_memory = figures.most_memory.max(cost.saturating_sub(TIMES_ITS_SIZE * bytes.len()));
        if cost > TIMES_ITS_SIZE * bytes.len() + AND_ALWAYS {
            return Err(format!("{name}: {cost} bytes of memory for a file of {}", bytes.len()));
        }
        result.map_err(|_| format!("{name}: it panics"))?.map_err(|e| format!("{name}: {e}"))?;
    }
    figures.tried += 1;
    figures.opened += usize::from(catch_unwind(opens).unwrap_or(false));
    BEGUN.store(0, Ordering::Relaxed);
    Ok(())
}

/// Tries `count` damaged versions of the fixtures of a format.
fn mutations(name: &str, fixtures: &[PathBuf], count: usize, program: Instant) -> Result<(), Failed> {
    let seeds: Vec<Vec<u8>> = fixtures.iter().map(|path| std::fs::read(path).unwrap()).collect();
    let mut figures = Figures::default();
    let mut random = Random::new(name.bytes().fold(1, |sum, b| sum * 31 + u64::from(b)));
    for at in 0..count {
        let which = at % seeds.len();
        let other = &seeds[random.below(seeds.len())];
        let damaged = mutate(&seeds[which], other, &mut random);
        one(&damaged, &mut figures, program).map_err(|e| {
            let kept = std::env::temp_dir().join(format!("hostile-{name}-{at}"));
            std::fs::write(&kept, &damaged).unwrap();
            format!("{e}; {} damaged, kept as {}", fixtures[which].display(), kept.display())
        })?;
    }
    ALL.lock().unwrap().push((name.to_owned(), figures));
    Ok(())
}

fn replay(path: &Path, program: Instant) -> Result<(), Failed> {
    Ok(one(&std::fs::read(path)?, &mut Figures::default(), program)?)
}

/// Ends the program if one file takes too long.
fn watch(program: Instant) {
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_millis(500));
            let begun = BEGUN.load(Ordering::Relaxed);
            if begun > 0 && program.elapsed().saturating_sub(Duration::from_millis(begun)) > HANG {
                eprintln!("a file takes longer than {} s", HANG.as_secs());
                std::process::exit(101);
            }
        }
    });
}

/// Writes 45 cuts inside the data and 300 files with four damaged bytes of one C3D, as the figures about other readers were measured.
fn dump(folder: &Path) {
    let seed = std::fs::read(root().join("fixtures/c3d/good/created.c3d")).unwrap();
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("whole.c3d"), &seed).unwrap();
    let data = (usize::from(u16::from_le_bytes([seed[16], seed[17]])) - 1) * 512;
    for i in 0..45 {
        let cut = data + 1 + (seed.len() - data - 2) * i / 44;
        std::fs::write(folder.join(format!("cut_{i:02}.c3d")), &seed[..cut]).unwrap();
    }
    let mut random = Random::new(4);
    for i in 0..300 {
        std::fs::write(folder.join(format!("bytes_{i:03}.c3d")), mutate::four_bytes(&seed, &mut random)).unwrap();
    }
}

fn main() {
    if let Some(folder) = std::env::var_os("MOCAP_HOSTILITY_DUMP") {
        return dump(Path::new(&folder));
    }
    let program = Instant::now();
    watch(program);
    std::panic::set_hook(Box::new(|_| {})); // what panics is reported by the test, once
    let all: usize = std::env::var("MOCAP_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(MUTATIONS);
    let mut trials = Vec::new();
    for name in formats::ALL.iter().map(|format| format.info().name).chain(["rig"]) {
        let mut fixtures = files(&root().join("fixtures").join(name));
        // what is refused as it is seldom gets far
        fixtures.retain(|path| path.components().any(|c| c.as_os_str() == "good" || c.as_os_str() == "odd"));
        let count = all.div_ceil(formats::ALL.len());
        trials.push(Trial::test(format!("{name}: {count} damaged files"), move || mutations(name, &fixtures, count, program)));
    }
    for folder in ["fixtures", "formats/fuzz/corpus"] {
        let all = files(&root().join(folder));
        assert!(all.len() > 100, "{folder} holds only {} files", all.len());
        for path in all {
            let name = path.strip_prefix(root()).unwrap().display().to_string();
            trials.push(Trial::test(name, move || replay(&path, program)));
        }
    }
    // memory is measured for the whole process, so one at a time
    let arguments = Arguments { test_threads: Some(1), ..Arguments::from_args() };
    let conclusion = libtest_mimic::run(&arguments, trials);
    if std::env::var_os("MOCAP_HOSTILITY_TABLE").is_some() {
        println!(
            "\n| format | damaged files | opened | refused | slowest | memory beyond 20 × the file |\n| --- | --- | --- | --- | --- | --- |"
        );
        for (name, f) in ALL.lock().unwrap().iter() {
            let (ms, mb) = (f.slowest.as_millis(), f.most_memory as f64 / f64::from(1 << 20));
            println!("| {name} | {} | {} | {} | {ms} ms | {mb:.1} MB |", f.tried, f.opened, f.tried - f.opened);
        }
    }
    conclusion.exit();
}
