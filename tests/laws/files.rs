//! From file to file, through [`mocap_repair::repair::repair`].

use crate::{Hole, WALKERS, cases, hidden, holes, same_where_known, walk_of};
use formats::{Format, Notes, Origin, Stated, Take, TakeBuilder, Unit};
use mocap_repair::gaps::Policy;
use mocap_repair::repair::{Request, repair};
use mocap_repair::report::Report;
use mocap_repair::solve::lds::Hidden;
use mocap_repair::solve::{Method, Settings};
use mocap_repair::suspects::Treatment;
use proptest::prelude::*;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use tempfile::TempDir;

/// What a run left in its folder.
struct Ran {
    report: Report,
    output: Vec<u8>,
    log: Vec<u8>,
    fills: Vec<u8>,
}

/// Repairs `bytes`, a file of the format with this extension, in a folder of its own.
fn run(bytes: &[u8], extension: &str, method: Method) -> Ran {
    run_stated(bytes, extension, method, Stated::default())
}

/// The same with something stated about the file.
fn run_stated(bytes: &[u8], extension: &str, method: Method, stated: Stated) -> Ran {
    let folder = TempDir::new().unwrap();
    let name = |file: &str| folder.path().join(file);
    let (input, output) = (name(&format!("walk.{extension}")), name(&format!("repaired.{extension}")));
    std::fs::write(&input, bytes).unwrap();
    let request = Request {
        input: input.clone(),
        output: output.clone(),
        in_place: false,
        log: Some(name("walk.mcap")),
        fills: Some(name("fills.csv")),
        page: Some(name("walk.html")),
        bones: None,
        force: false,
        dry_run: false,
        timings: false,
        log_rate_hz: None,
        log_source: false,
        method,
        settings: Settings { hidden: Hidden::Count(6), ..Settings::default() },
        iterations: 4,
        tolerance: 1e-6,
        seed: 0,
        policy: Policy::default(),
        wearer: None,
        markers: Vec::new(),
        reading: stated.into(),
        reads: Vec::new(),
        config: String::new(),
        outliers: Treatment::Told,
    };
    let report = repair(&request, &mut (), &AtomicBool::new(false)).unwrap();
    let read = |path: &Path| std::fs::read(path).unwrap();
    assert_eq!(read(&input), bytes, "the input is never written");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 5, "and nothing lies about");
    Ran { report, output: read(&output), log: read(&name("walk.mcap")), fills: read(&name("fills.csv")) }
}

fn created(take: &Take, format: &dyn Format) -> Vec<u8> {
    let mut bytes = Vec::new();
    format.create(take, &mut bytes, &Notes::new()).unwrap();
    bytes
}

/// A walk with holes, some of its samples derived, in any unit; its ends are seen.
fn takes() -> impl Strategy<Value = Take> {
    (1..100_u64, 20..60_usize, holes(8, 15), prop::sample::select(Unit::ALL.to_vec()), 0..70_000_i64).prop_map(
        |(seed, frames, holes, unit, first): (u64, usize, Vec<Hole>, Unit, i64)| {
            let take = hidden(&walk_of(&WALKERS, frames, seed), &holes);
            let mut other = TakeBuilder::new(take.markers.clone(), frames, take.rate_hz).unit(unit).first_frame(first).up(take.up);
            for frame in 0..frames {
                for marker in 0..take.markers.len() {
                    let origin = if (frame + marker) % 11 == 0 { Origin::Derived } else { Origin::Measured };
                    if let Some(p) = take.position_mm(frame, marker) {
                        other.set(frame, marker, p, origin);
                    }
                }
            }
            other.build()
        },
    )
}

fn methods() -> impl Strategy<Value = Method> {
    prop::sample::select(Method::ALL.to_vec())
}

/// The knee of a leg is stated missing for some frames: rows of other frames stay as they are, and the file opens as what was promised.
#[test]
fn joints_stated_missing_are_filled_in_a_bvh() {
    let text = include_str!("../../fixtures/bvh/odd/leg.bvh");
    let knee = 2; // after Hips and LeftUpLeg
    let gap = 8..12_usize;
    let stated = Stated { missing: gap.clone().map(|frame| (frame, knee)).collect(), unit: Some(Unit::Centimetre), ..Stated::default() };
    let ran = run_stated(text.as_bytes(), "bvh", Method::Spline, stated);
    assert_eq!(ran.report.samples.len(), gap.len());
    let after = String::from_utf8(ran.output).unwrap();
    let rows = |text: &str| text.lines().map(str::to_owned).collect::<Vec<_>>();
    let (before, after) = (rows(text), rows(&after));
    let first = before.iter().position(|line| line.starts_with("Frame Time")).unwrap() + 1;
    assert_eq!(before.len(), after.len());
    for (at, (was, is)) in before.iter().zip(&after).enumerate() {
        if at < first || !gap.contains(&(at - first)) {
            assert_eq!(was, is, "line {at}");
        }
    }
    assert_ne!(before, after, "the knee moved");
}

/// Bytes per sample of a C3D of floats.
const SAMPLE: usize = 16;

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn only_the_records_of_filled_samples_change_in_a_c3d(take in takes(), method in methods()) {
        let before = created(&take, &formats::c3d::C3d);
        let ran = run(&before, "c3d", method);
        prop_assert_eq!(ran.output.len(), before.len());
        // word 9 of the header is the number of the first block of data, counted from 1
        let data = 512 * (usize::from(u16::from_le_bytes([before[16], before[17]])) - 1);
        prop_assert_eq!(&ran.output[..data], &before[..data]);
        let records = before[data..].chunks(SAMPLE).zip(ran.output[data..].chunks(SAMPLE));
        prop_assert_eq!(records.len(), take.frames() * take.markers.len());
        let mut filled = 0;
        for (at, (was, is)) in records.enumerate() {
            let missing = take.origin(at / take.markers.len(), at % take.markers.len()) == Origin::Missing;
            prop_assert_eq!(was != is, missing, "record {}", at);
            // a filled sample says of itself that nobody measured it
            prop_assert!(!missing || is[12..] == [0; 4], "record {}: {:?}", at, is);
            filled += usize::from(missing);
        }
        prop_assert_eq!(ran.report.samples.len(), filled);
    }

    #[test]
    fn only_empty_cells_change_in_a_csv(take in takes(), method in methods()) {
        let before = created(&take, &formats::csv::Csv);
        let ran = run(&before, "csv", method);
        let lines = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap().lines().map(str::to_owned).collect::<Vec<_>>();
        let (before, after) = (lines(&before), lines(&ran.output));
        prop_assert_eq!((&before[0], before.len()), (&after[0], after.len()));
        for (frame, (was, is)) in before.iter().zip(&after).skip(1).enumerate() {
            let (was, is): (Vec<&str>, Vec<&str>) = (was.split(',').collect(), is.split(',').collect());
            prop_assert_eq!(was.len(), is.len());
            // two cells in front: the frame's number and its time
            for (cell, (was, is)) in was.iter().zip(&is).enumerate() {
                if cell >= 2 && take.origin(frame, (cell - 2) / 3) == Origin::Missing {
                    prop_assert!(was.is_empty() && is.parse::<f64>().is_ok_and(f64::is_finite), "frame {}, cell {}: {:?}", frame, cell, is);
                } else {
                    prop_assert_eq!(was, is, "frame {}, cell {}", frame, cell);
                }
            }
        }
    }

    #[test]
    fn the_same_request_gives_the_same_bytes(take in takes(), method in methods()) {
        for format in formats::ALL {
            let bytes = created(&take, *format);
            let (a, b) = (run(&bytes, format.info().extensions[0], method), run(&bytes, format.info().extensions[0], method));
            prop_assert!(a.output == b.output, "{}: the takes differ", format.info().name);
            prop_assert!(a.log == b.log, "{}: the logs differ", format.info().name);
            prop_assert!(a.fills == b.fills && !a.fills.is_empty(), "{}: the tables of filled samples differ", format.info().name);
        }
    }

    #[test]
    fn the_output_opens_as_the_repaired_take(take in takes(), method in methods()) {
        for format in formats::ALL {
            let bytes = created(&take, *format);
            let ran = run(&bytes, format.info().extensions[0], method);
            let open = |bytes: Vec<u8>| format.open(bytes, &Stated::default(), &Notes::new()).unwrap();
            let (before, after) = (open(bytes), open(ran.output));
            prop_assert!(same_where_known(before.take(), after.take()), "{}", format.info().name);
            for sample in &ran.report.samples {
                let p = after.take().position_mm(sample.frame, sample.marker).unwrap();
                let near = |axis: usize| {
                    (p[axis] - sample.position_mm[axis]).abs() <= after.rounding_mm() + 1.2e-7 * sample.position_mm[axis].abs()
                };
                prop_assert!((0..3).all(near), "{}: {:?} became {:?}", format.info().name, sample, p);
            }
        }
    }

    #[test]
    fn a_file_without_gaps_stays_as_it_is(seed in 1..100_u64, frames in 2..30_usize, method in methods()) {
        let take = walk_of(&WALKERS, frames, seed);
        for format in formats::ALL {
            let bytes = created(&take, *format);
            let ran = run(&bytes, format.info().extensions[0], method);
            prop_assert!(ran.output == bytes, "{}", format.info().name);
            prop_assert!(ran.report.samples.is_empty() && ran.report.gaps.is_empty());
        }
    }
}
