//! How well bodies are followed through clouds of points: the method of the report "Markerless Motion Capture in the Operating Room" and the default.
//!
//! `cargo run --release --example kineben -- --help`; `docs/kineben.md` says what it shows.
//!
//! - `variants`: who is followed, doing what, seen how
//! - `score`: how far joints are from the truth
//! - `real`: sequences from files

mod real;
mod score;
#[cfg(test)]
mod tests;
mod variants;

use clap::Parser;
use mocap_repair::solve::track::{Method, Settings};
use score::{Score, by_joint, follow, score};
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use variants::{ALL, Sequence};

/// Follows synthetic actors through clouds of points and prints how far their joints are from the truth, as Markdown.
#[derive(Parser)]
struct Args {
    /// Also the sequences in the folders of this one
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Only variants whose names contain this
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
    /// Tell of each which frame was lost first, in how many limbs were searched and found, and the mean of each joint
    #[arg(long)]
    each: bool,
    /// Only the default method
    #[arg(long)]
    default_only: bool,
    /// Begin with this frame, though the pose at the beginning stays that of the first one
    #[arg(long, value_name = "N", default_value_t = 0)]
    skip: usize,
    /// Another seed for all of them
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
}

fn main() -> ExitCode {
    match print(&Args::parse(), &mut io::stdout().lock()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            let _ = writeln!(io::stderr(), "{problem}");
            ExitCode::FAILURE
        }
    }
}

fn print(args: &Args, out: &mut dyn Write) -> Result<(), String> {
    let unwritable = |e: io::Error| e.to_string();
    let methods: &[(&str, Method)] = &[("default", Method::Planes), ("`report`", Method::Report)];
    let methods = &methods[..if args.default_only { 1 } else { 2 }];
    let titles: Vec<String> = methods.iter().map(|(name, _)| format!(" {name}: mean / p95 / max cm | frames > 5 cm |")).collect();
    writeln!(out, "| sequence | frames |{}", titles.concat())
        .and_then(|()| writeln!(out, "| --- | --- |{}", " --- | --- |".repeat(methods.len())))
        .map_err(unwritable)?;
    let mut put = |name: &str, mut sequence: Sequence| {
        sequence.clouds.drain(..args.skip.min(sequence.clouds.len()));
        sequence.joints.drain(..args.skip.min(sequence.joints.len()));
        let sequence = &sequence;
        let scores = methods.iter().map(|&(_, method)| {
            let tracked = follow(sequence, Settings::of(method));
            let score = score(&sequence.body.tree, &sequence.joints, &tracked);
            if args.each {
                let joints: Vec<String> = by_joint(&sequence.joints, &tracked).iter().map(|off| format!("{off:.2}")).collect();
                let first = score.first_lost.map_or_else(String::new, |frame| format!(", first lost: {frame}"));
                let searched = 100.0 * score.searched;
                let told = format!("astray in silence {:.2} %, false alarms {:.2} %", 100.0 * score.silent, 100.0 * score.false_alarms);
                let _ =
                    writeln!(io::stderr(), "{name}, {method:?}: searched in {searched:.1} %{first}; {told}; joints: {}", joints.join(" "));
            }
            cells(score)
        });
        let cells = scores.collect::<Vec<_>>().join(" | ");
        writeln!(out, "| {name} | {} | {cells} |", sequence.clouds.len()).and_then(|()| out.flush()).map_err(unwritable)
    };
    for variant in ALL.iter().filter(|variant| variant.name.contains(&args.only)) {
        let variant = variants::Variant { seed: args.seed.unwrap_or(variant.seed), ..*variant };
        put(variant.name, variant.sequence())?;
    }
    let Some(data) = &args.data else { return Ok(()) };
    let entries = std::fs::read_dir(data).map_err(|e| format!("{}: {e}", data.display()))?;
    let mut folders: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_dir()).collect();
    folders.sort();
    for folder in folders {
        let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        if name.contains(&args.only) {
            put(&format!("`{name}`, from files"), real::read(&folder)?)?;
        }
    }
    Ok(())
}

/// Two cells of the table.
fn cells(score: Score) -> String {
    let Score { mean_cm, p95_cm, worst_cm, lost, .. } = score;
    format!("{mean_cm:.2} / {p95_cm:.1} / {worst_cm:.1} | {:.0} %", 100.0 * lost)
}
