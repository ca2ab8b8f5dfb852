//! Makes reports on batches that never were, to be looked at and measured:
//!
//! `cargo run --release --example fleet -- rows 100000 report.html` of so many takes,
//! `cargo run --release --example fleet -- tree FOLDER` of a small output folder with names that nobody wants to have.

use mocap_repair::batch::fleet::{self, About, Attempt, FleetRow, Planned, Plans};
use mocap_repair::batch::ledger::{Begun, Ended, How, Outcome, Record, Stop, TakeRecord, Try};
use mocap_repair::batch::sidecar::{InputFile, MarkerSummary, NoteSaid, OutputFile, Sidecar, Summary};
use mocap_repair::batch::store::Place;
use std::error::Error;
use std::path::Path;

const MARKERS: [&str; 41] = [
    "LFHD", "RFHD", "LBHD", "RBHD", "C7", "T10", "CLAV", "STRN", "RBAK", "LSHO", "LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN", "RSHO",
    "RUPA", "RELB", "RFRM", "RWRA", "RWRB", "RFIN", "LFWT", "RFWT", "LBWT", "RBWT", "LTHI", "LKNE", "LSHN", "LANK", "LHEE", "LTOE", "LMT5",
    "RTHI", "RKNE", "RSHN", "RANK", "RHEE", "RTOE", "RMT5",
];

const MOTIONS: [&str; 8] = ["walk", "run", "jump", "stairs", "reach", "sit to stand", "dance", "fall"];

/// Names that would do harm if any of them became markup or code, and names that mean something in links.
const HOSTILE: [&str; 8] = [
    "</script><script>document.title='owned'<",
    "<img src=x onerror=document.title='owned'>",
    "50% of #1?x=y&z",
    "Übung ä ß 日本",
    "a'b\"`${1}",
    "{{scripts}}<!--",
    "javascript:alert(1)",
    "=1+1, \"quoted\"",
];

/// A number from 0 up to 1 that is the same every time.
fn random(parts: &[usize]) -> f64 {
    let mut x = 0x9e37_79b9_7f4a_7c15_u64;
    for &part in parts {
        x = (x ^ part as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x ^= x >> 31;
        x = x.wrapping_mul(0x94d0_49bb_1331_11eb) ^ (x >> 29);
    }
    (x >> 11) as f64 / (1_u64 << 53) as f64
}

fn sidecar(path: &str, session: usize, at: usize) -> Sidecar {
    let frames = 300 + (10f64.powf(random(&[1, at]) * 1.6) * 400.0) as usize;
    let rate_hz = if session % 5 == 4 { 200.0 } else { 120.0 };
    // in every session some cameras see badly, and some takes have more gaps than others
    let bad_take = random(&[2, at]).powi(4) * 3.0;
    let markers: Vec<MarkerSummary> = MARKERS
        .iter()
        .enumerate()
        .map(|(k, label)| {
            let loss = random(&[3, session, k]).powi(6) * 0.25 * bad_take + if random(&[4, at, k]) < 0.03 { 0.01 } else { 0.0 };
            let missing = ((frames as f64 * loss * random(&[5, at, k]) * 2.0) as u64).min(frames as u64);
            let gaps = if missing == 0 { 0 } else { 1 + (missing as f64 / 40.0 * random(&[6, at, k])) as usize };
            let longest = if gaps < 2 { missing as usize } else { missing as usize / gaps + (missing as usize / 3) };
            let filled = if longest > 380 { missing - longest as u64 } else { missing };
            let sigma = (missing > 0).then(|| (longest as f64).sqrt() * (0.2 + 1.2 * random(&[7, at, k]).powi(3)));
            MarkerSummary { label: format!("Subj{session}:{label}"), missing, gaps, longest, filled, worst_sigma_mm: sigma }
        })
        .collect();
    let sum = |of: fn(&MarkerSummary) -> u64| markers.iter().map(of).sum::<u64>();
    let open = markers.iter().filter(|marker| marker.filled < marker.missing).count();
    let worst_sigma_mm = markers.iter().filter_map(|marker| marker.worst_sigma_mm).reduce(f64::max);
    let mut notes = vec![NoteSaid {
        kind: "unit_assumed".to_owned(),
        text: "the file names no unit: millimetres are assumed".to_owned(),
        matters: false,
    }];
    if open > 0 {
        notes.push(NoteSaid {
            kind: "gaps_left_open".to_owned(),
            text: format!("{open} gaps are left open: they are longer than --max-gap"),
            matters: true,
        });
    }
    if random(&[8, at]) < 0.2 {
        let samples = (random(&[9, at]) * 900.0) as u32;
        notes.push(NoteSaid {
            kind: "zero_read_as_missing".to_owned(),
            text: format!("{samples} samples at the origin were taken for missing"),
            matters: false,
        });
    }
    let summary = Summary {
        format: ["c3d", "c3d", "c3d", "trc", "csv"][session % 5].to_owned(),
        rate_hz,
        frames,
        markers: MARKERS.len(),
        bones: 76,
        method: "auto".to_owned(),
        suspects: if random(&[10, at]) < 0.07 { 1 + (random(&[11, at]) * 12.0) as usize } else { 0 },
        gaps: markers.iter().map(|marker| marker.gaps).sum(),
        gaps_left_open: open,
        samples: (frames * MARKERS.len()) as u64,
        samples_missing: sum(|marker| marker.missing),
        samples_filled: sum(|marker| marker.filled),
        longest_gap: markers.iter().map(|marker| marker.longest).max().unwrap_or(0),
        worst_sigma_mm,
        bone_worst_mm: worst_sigma_mm.map(|sigma| sigma * (0.5 + 3.0 * random(&[12, at]))),
        bone_rms_mm: worst_sigma_mm.map(|sigma| sigma * 0.3),
        worst_bone: worst_sigma_mm.map(|_| format!("{}-{}", MARKERS[at % 41], MARKERS[(at + 1) % 41])),
    };
    let name = path.rsplit('/').next().unwrap_or(path).to_owned();
    Sidecar {
        version: "0.1.0".to_owned(),
        key: format!("{at:064x}"),
        path: path.to_owned(),
        input: InputFile { name: name.clone(), source: String::new(), bytes: 1, sha256: format!("{at:064x}"), version: None },
        config_sha256: "c0ffee11".repeat(8),
        outputs: vec![OutputFile { name, bytes: 1, sha256: format!("{at:064x}") }],
        exit_code: if notes.iter().any(|note| note.matters) { 3 } else { 0 },
        summary,
        markers,
        notes,
        sidecar_sha256: String::new(), // comes when it is written
    }
}

/// The take `at` of a batch, from one of 30 sessions.
fn row(at: usize, takes: usize) -> FleetRow {
    let session = at * 30 / takes.max(1);
    let path = format!("session {:02}/S{:03} {}/trial {:05}.c3d", session + 1, at / 40, MOTIONS[at / 5 % 8], at);
    let bytes = 200_000 + (random(&[13, at]) * 4e6) as u64;
    let mut row = FleetRow { output: path.clone(), path, bytes, tries: 1, ..FleetRow::default() };
    row.time = Some(format!("2026-11-30T{:02}:{:02}:{:02}Z", 8 + at % 9, at % 60, at / 60 % 60));
    let fate = random(&[14, at]);
    if fate < 0.06 && session > 26 {
        return FleetRow { tries: 0, time: None, ..row };
    }
    row.outcome = Some(if fate < 0.063 {
        Outcome::Quarantined
    } else if fate < 0.066 {
        Outcome::Failed
    } else if fate < 0.1 {
        Outcome::Skipped
    } else {
        Outcome::Done
    });
    match row.outcome {
        Some(Outcome::Quarantined) => {
            row.exit_code = Some(65);
            let why = match at % 3 {
                0 => format!("c3d: POINT:LABELS has {} names but POINT:USED is 41 (parameters, byte 0x2a4)", at % 40),
                1 => "no marker is seen in any frame".to_owned(),
                _ => format!("c3d: the file ends after {at} bytes, its header promises more"),
            };
            row.reason = Some(format!("{}: {why}", row.path));
            row.elapsed_secs = Some(0.1);
        }
        Some(Outcome::Failed) => {
            row.reason = Some(format!("{}: has changed since it was planned; plan again", row.path));
            row.elapsed_secs = Some(0.0);
        }
        _ => {
            let sidecar = sidecar(&row.path, session, at);
            row.exit_code = Some(sidecar.exit_code);
            row.elapsed_secs =
                Some(0.3 + sidecar.summary.samples as f64 * 2e-5 * (0.4 + random(&[15, at])) * (1.0 + sidecar.summary.gaps as f64 / 60.0));
            row.peak_bytes = Some(60_000_000 + sidecar.summary.samples * 400);
            row.sidecar = Some(sidecar);
            (row.report, row.log) = (!at.is_multiple_of(3), true);
        }
    }
    row
}

fn about(takes: usize) -> About {
    let attempt = |shard: u32| Attempt {
        begun: format!("2026-11-30T08:00:0{shard}Z"),
        last: "2026-11-30T16:59:59Z".to_owned(),
        host: format!("node{shard}"),
        engine: "local".to_owned(),
        jobs: 16,
        shard,
        shards: 4,
        version: "0.1.0".to_owned(),
        done: takes as u64 / 4,
        stop: (shard > 0).then(|| "complete".to_owned()),
        ..Attempt::default()
    };
    About {
        name: "gait study, repaired".to_owned(),
        attempts: (0..4).map(attempt).collect(),
        wall_secs: 32_399.0,
        done_in_runs: takes as u64,
        plans: vec![Planned {
            name: "4be1c0de".to_owned(),
            version: "0.1.0".to_owned(),
            config: "method = \"auto\"\nmax-gap = 380\n".to_owned(),
            config_sha256: "c0ffee11".repeat(8),
            sources: vec!["/data/gait".to_owned()],
            takes: takes as u64,
        }],
        folder: Some(Path::new(".").to_owned()),
        ..About::default()
    }
}

/// An output folder with plan, ledgers, sidecars and reports, and two reports on it: in it, and elsewhere.
fn tree(folder: &Path) -> Result<(), Box<dyn Error>> {
    let out = folder.join("out #1");
    let put = |name: &str, text: &str| {
        let path = out.join(name);
        std::fs::create_dir_all(path.parent().unwrap_or(&out))?;
        std::fs::write(path, text)
    };
    let wanted = serde_json::json!({"log": true, "report": true, "fills": false});
    let header = serde_json::json!({
        "message_type": "plan", "version": "0.1.0", "config": "method = \"auto\"", "config_sha256": "c0ffee11",
        "sources": ["/data/<b>in</b>"], "takes": 68, "bytes": 1, "wanted": wanted,
    });
    let mut plan = format!("{header}\n");
    let begun = Begun {
        time: "2026-11-30T08:00:00Z".to_owned(),
        host: "<i>host</i>".to_owned(),
        version: "0.1.0".to_owned(),
        shards: 1,
        plan: Some("4be1c0de".repeat(8)),
        takes: 68,
        jobs: 2,
        engine: "local".to_owned(),
        ..Begun::default()
    };
    let mut ledger = vec![Record::Begun(begun)];
    for at in 0..68 {
        let path = match HOSTILE.get(at) {
            // a name of a file cannot have a slash in it
            Some(name) => format!("odd {}/{}.c3d", at % 2, name.replace('/', "\u{2215}")),
            None => format!("session {}/trial {at:02}.c3d", at / 20),
        };
        let planned = serde_json::json!({"message_type": "take", "path": path, "source": "/in", "output": path, "bytes": 1000 + at});
        plan += &(planned.to_string() + "\n");
        let mut sidecar = sidecar(&path, at / 20, at);
        let outcome =
            [Outcome::Done, Outcome::Quarantined, Outcome::Failed][if at == 3 || at == 20 { 1 } else { usize::from(at == 30) * 2 }];
        let done = outcome == Outcome::Done;
        if at >= 64 {
            continue; // planned, and nobody got to it
        }
        if done {
            if let Some(name) = HOSTILE.get(at) {
                sidecar.markers[0].label = format!("S:{name}");
                (*name).clone_into(&mut sidecar.notes[0].text);
                sidecar.summary.worst_bone = Some((*name).to_owned());
            }
            put(&format!("{path}.repair.json"), &sidecar.text())?;
            if at % 2 == 0 || at < 8 {
                put(&format!("{path}.html"), &format!("<!doctype html><meta charset=utf-8><title>take {at}</title>"))?;
            }
            put(&format!("{path}.mcap"), "")?;
        }
        ledger.push(Record::Take(TakeRecord {
            time: format!("2026-11-30T08:{:02}:00Z", at % 60),
            output: path.clone(),
            key: Some(sidecar.key.clone()),
            planned: None,
            outcome,
            exit_code: Some(if done { sidecar.exit_code } else { 65 }),
            reason: (!done).then(|| format!("{path}: <b>c3d</b>: the header is cut off")),
            tries: vec![Try { ended: How::Exit, code: Some(0), signal: None, reason: None, elapsed_secs: 1.5 }],
            elapsed_secs: 1.5 + at as f64 / 10.0,
            peak_bytes: Some(100_000_000),
            bytes: 1000 + at as u64,
            path,
        }));
    }
    ledger.push(Record::Ended(Ended {
        time: "2026-11-30T09:10:00Z".to_owned(),
        stop: Stop::Complete,
        done: 61,
        remarked: 0,
        skipped: 0,
        quarantined: 2,
        failed: 1,
    }));
    put(&format!(".mocap-repair/plans/{}.jsonl", "4be1c0de".repeat(8)), &plan)?;
    let lines: Result<Vec<String>, _> = ledger.iter().map(serde_json::to_string).collect();
    put(".mocap-repair/ledger/4be1c0de-0-of-1-0001.jsonl", &(lines?.join("\n") + "\n{\"message_type\":\"take\",\"ti"))?;
    let elsewhere = folder.join("elsewhere");
    std::fs::create_dir_all(&elsewhere)?;
    let collected = fleet::collect(&Place::parse(&out.to_string_lossy())?, &Plans::Last)?;
    for path in [out.join("report.html"), elsewhere.join("report.html")] {
        fleet::write(collected.rows(), &collected.about, &path, true)?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["rows", takes, path] => {
            let takes = takes.parse()?;
            fleet::write((0..takes).map(|at| row(at, takes)), &about(takes), Path::new(path), true)?;
            Ok(())
        }
        ["tree", folder] => tree(Path::new(folder)),
        _ => Err("expected: rows TAKES PAGE, or: tree FOLDER".into()),
    }
}
