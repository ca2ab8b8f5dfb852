//! What the readers of this project make of a file, for programs that compare it with what other readers make of it.
//!
//! ```text
//! dump take FILE            the take, to standard output
//! dump floats FILE NEW      the same file with floats instead of integers; nothing is written if there is nothing to convert
//! dump create FILE NEW      a new file from nothing but the take, in the format that the extension of NEW names
//! ```
//!
//! A take is a line of JSON (`frames`, `rate_hz`, `first_frame`, `unit_mm`, `labels`, `outputs`, `notes`), then for every frame and column
//! three little-endian 64-bit floats in mm (NaN where missing), then for every frame and column a byte: 0 missing, 1 measured, 2 derived.
#![allow(clippy::print_stderr)] // a small program of its own

use formats::{Notes, Origin, Role, Take};
use mocap_repair::input::Reading;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

type Failure = Box<dyn std::error::Error>;

fn dump(take: &Take, notes: &Notes, out: &mut dyn Write) -> Result<(), Failure> {
    let head = serde_json::json!({
        "frames": take.frames(),
        "rate_hz": take.rate_hz,
        "first_frame": take.first_frame,
        "unit_mm": take.unit.mm(),
        "labels": take.markers.iter().map(|m| &m.label).collect::<Vec<_>>(),
        "outputs": take.markers.iter().map(|m| m.role == Role::ModelOutput).collect::<Vec<_>>(),
        "notes": notes.take().iter().map(formats::Note::kind).collect::<Vec<_>>(),
    });
    writeln!(out, "{head}")?;
    let samples = || (0..take.frames()).flat_map(|f| (0..take.markers.len()).map(move |m| (f, m)));
    for (frame, marker) in samples() {
        for x in take.position_mm(frame, marker).unwrap_or([f64::NAN; 3]) {
            out.write_all(&x.to_le_bytes())?;
        }
    }
    for (frame, marker) in samples() {
        let origin = match take.origin(frame, marker) {
            Origin::Missing => 0,
            Origin::Measured => 1,
            Origin::Derived | Origin::Repaired => 2,
        };
        out.write_all(&[origin])?;
    }
    Ok(out.flush()?)
}

fn run(arguments: &[&str]) -> Result<(), Failure> {
    let (what, file, new) = match arguments {
        ["take", file] => ("take", file, None),
        [what @ ("floats" | "create"), file, new] => (*what, file, Some(Path::new(*new))),
        _ => return Err("usage: dump take FILE, dump floats FILE NEW, dump create FILE NEW".into()),
    };
    let opened = mocap_repair::input::open(Path::new(file), &Reading::default())?;
    let take = opened.document.take();
    match (what, new) {
        ("floats", Some(new)) => {
            if let Some(bytes) = opened.document.as_floats()? {
                std::fs::write(new, bytes)?;
            }
        }
        (_, Some(new)) => {
            let format = new.extension().and_then(|e| e.to_str()).and_then(formats::by_extension).ok_or("no such format")?;
            format.create(take, &mut std::fs::File::create(new)?, &Notes::new())?;
        }
        _ => dump(take, &opened.notes, &mut std::io::BufWriter::new(std::io::stdout().lock()))?,
    }
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match run(&arguments.iter().map(String::as_str).collect::<Vec<_>>()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
