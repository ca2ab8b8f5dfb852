//! What was typed, the help text, and what is printed. The only file that prints.
#![allow(clippy::print_stdout, clippy::print_stderr)] // this is where output belongs

mod args;

use crate::bones;
use crate::convert::convert;
use crate::demo::{DemoOptions, write_demo};
use crate::input::{Reading, open};
use crate::inspect::Inspection;
use crate::log::{self, Terminal};
use crate::page;
use crate::repair::{RepairError, neighbours, repair};
use crate::report::lines;
use crate::solve::Method;
use crate::solve::auto::Stiffness;
use args::{BonesArg, ConvertArgs, LayoutArgs, RepairArgs, ReportArgs, StatedArgs, rate};
use clap::{CommandFactory, Parser, Subcommand, error::ErrorKind};
use formats::printable;
use serde::Serialize;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

const AFTER_HELP: &str = "\
Exit codes:
  0  every gap is filled and the log is complete
  1  failed; no output was written
  2  the command line was wrong
  3  the output exists, but look at it: a gap was left open, something was assumed or lost,
     the iteration did not converge, or there is no log";

const CONVERT_AFTER_HELP: &str = "\
Exit codes:
  0  everything is in the written file
  1  failed; no output was written
  2  the command line was wrong
  3  the output exists, but something was lost or assumed";

/// Fills the gaps of motion-capture takes so that bones keep their lengths, and leaves everything else as it was.
#[derive(Debug, Parser)]
#[command(name = "mocap-repair", version, after_help = AFTER_HELP, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    repair: RepairArgs,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Say what is in takes: rate, frames, units, markers, gaps, bones, oddities
    Inspect {
        /// Takes to look at
        #[arg(required = true, value_name = "IN")]
        inputs: Vec<PathBuf>,
        #[command(flatten)]
        stated: StatedArgs,
        /// One JSON document per take
        #[arg(long)]
        json: bool,
    },
    /// Print the bones that are found in a take, in the form that --bones reads
    Bones {
        /// The take
        #[arg(value_name = "IN")]
        input: PathBuf,
        #[command(flatten)]
        stated: StatedArgs,
    },
    /// Write a take in another format, unit or orientation, and say what that one cannot hold
    #[command(after_help = CONVERT_AFTER_HELP)]
    Convert(ConvertArgs),
    /// Take the layout for Foxglove or Lichtblick out of a log
    Layout(LayoutArgs),
    /// Make the report to look at from the log of a repair: one HTML file for any browser
    Report(ReportArgs),
    /// Make a synthetic take of a walking figure: its truth, and the same with gaps, as C3D and CSV
    Demo {
        /// Folder to write to; made if it is not there
        #[arg(short, long, value_name = "DIR")]
        output: PathBuf,
        /// Number of frames
        #[arg(long, default_value_t = DemoOptions::default().frames as u32, value_parser = clap::value_parser!(u32).range(60..=200_000))]
        frames: u32,
        /// Frames per second
        #[arg(long, value_name = "HZ", default_value_t = DemoOptions::default().rate_hz, value_parser = rate)]
        rate: f64,
        /// Another seed makes another walk
        #[arg(long, default_value_t = DemoOptions::default().seed)]
        seed: u64,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
}

/// Parses the command line, does what it says and returns the exit code.
pub fn main(interrupt: &AtomicBool) -> u8 {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let code = if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) { 0 } else { 2 };
            // a closed pipe is no reason to fail while failing
            let _ = error.print();
            return code;
        }
    };
    match cli.command {
        Some(Command::Inspect { inputs, stated, json }) => inspect(&inputs, &stated.reading(), json),
        Some(Command::Bones { input, stated }) => print_bones(&input, &stated.reading()),
        Some(Command::Convert(args)) => run_convert(&args),
        Some(Command::Layout(args)) => written(log::extract_layout(&args.log, &args.output, args.force)),
        Some(Command::Report(args)) => written(page::report_of_log(&args.log, &args.output, args.force)),
        Some(Command::Demo { output, frames, rate, seed, force }) => {
            demo(&output, &DemoOptions { frames: frames as usize, rate_hz: rate, seed, ..DemoOptions::default() }, force)
        }
        None => run_repair(&cli.repair, interrupt),
    }
}

fn run_repair(args: &RepairArgs, interrupt: &AtomicBool) -> u8 {
    if args.inputs.len() > 1 {
        let text = format!("{} takes were named; repair one at a time, each with its own -o", args.inputs.len());
        let _ = Cli::command().error(ErrorKind::TooManyValues, text).print();
        return 2;
    }
    if args.method != Method::Auto && args.bones.contains(&BonesArg::Stiffness(Stiffness::Hard)) {
        let text =
            format!("--bones hard is for --method auto, not {}; exact bones are also what --method bolero-hc has", args.method.name());
        let _ = Cli::command().error(ErrorKind::ArgumentConflict, text).print();
        return 2;
    }
    let request = args.request();
    let mut terminal = (std::io::stderr().is_terminal() && !args.quiet && !args.json).then(|| Terminal::new(&request.input));
    let result = repair(&request, &mut terminal, interrupt);
    drop(terminal);
    match result {
        Ok(report) => {
            if args.json {
                print(&report.json());
            } else if !args.quiet {
                print(&report.text());
                if args.explain {
                    print(&format!("\n{}", report.explanation_text()));
                }
            }
            report.exit_code()
        }
        Err(error) => {
            fail(&error.to_string(), args.json);
            1
        }
    }
}

fn run_convert(args: &ConvertArgs) -> u8 {
    match convert(&args.conversion()) {
        Ok(converted) => {
            if args.json {
                print(&converted.json());
            } else if !args.quiet {
                print(&converted.text());
            }
            converted.exit_code()
        }
        Err(error) => {
            // here --units is what is written
            fail(&error.to_string().replace("--units", "--from-units"), args.json);
            1
        }
    }
}

fn inspect(inputs: &[PathBuf], reading: &Reading, json: bool) -> u8 {
    let mut code = 0;
    for (at, path) in inputs.iter().enumerate() {
        match open(path, reading) {
            Ok(opened) => {
                let inspection = Inspection::new(path, &opened);
                if json {
                    print(&inspection.json());
                } else {
                    print(&format!("{}{}", if at > 0 { "\n" } else { "" }, inspection.text()));
                }
            }
            Err(error) => {
                fail(&error.to_string(), json);
                code = 1;
            }
        }
    }
    code
}

fn print_bones(path: &Path, reading: &Reading) -> u8 {
    match open(path, reading) {
        Ok(opened) => {
            let take = opened.document.take();
            print(&bones::write(&bones::find(take, &neighbours(take)), take));
            0
        }
        Err(error) => {
            fail(&error.to_string(), false);
            1
        }
    }
}

/// The exit code of a command that writes a file and says nothing.
fn written(result: Result<(), RepairError>) -> u8 {
    match result {
        Ok(()) => 0,
        Err(error) => {
            fail(&error.to_string(), false);
            1
        }
    }
}

fn demo(folder: &Path, options: &DemoOptions, force: bool) -> u8 {
    match write_demo(folder, options, force) {
        Ok(files) => {
            for file in files {
                print(&format!("{}\n", file.display()));
            }
            0
        }
        Err(error) => {
            fail(&error.to_string(), false);
            1
        }
    }
}

/// One line on standard error, or one JSON line on standard output.
fn fail(error: &str, json: bool) {
    #[derive(Serialize)]
    #[serde(tag = "message_type", rename = "error")]
    struct Message {
        text: String,
    }
    if json {
        print(&lines(&[Message { text: error.to_owned() }]));
    } else {
        eprintln!("mocap-repair: {}", printable(error));
    }
}

/// Prints to standard output; a reader that has gone away is not our failure.
fn print(text: &str) {
    let _ = std::io::stdout().lock().write_all(text.as_bytes());
}
