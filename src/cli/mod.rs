//! What was typed, the help text, and what is printed. The only file that prints.
#![allow(clippy::print_stdout, clippy::print_stderr)] // this is where output belongs

mod args;
mod batch;
mod config;
mod fit;
mod man;
mod rig;
mod track;

use crate::bones;
use crate::convert::convert;
use crate::demo::actor::{BodyOptions, write_body};
use crate::demo::{DemoOptions, write_demo};
use crate::fit::{Report as FitReport, fit as fit_markers};
use crate::input::{Reading, open};
use crate::inspect::Inspection;
use crate::log::{self, Terminal};
use crate::page;
use crate::repair::{RepairError, Request, neighbours, repair};
use crate::report::lines;
use crate::solve::auto::Stiffness;
use crate::solve::{Method, Observer};
use crate::track::{Report as TrackReport, track as track_clouds};
use crate::typeset::{Style, Tone, settle_colours};
use args::{BonesArg, ConvertArgs, DemoKind, LayoutArgs, RepairArgs, ReportArgs, StatedArgs, rate};
use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand, error::ErrorKind};
use clap_complete::Shell;
use fit::SolveArgs;
use formats::printable;
use serde::Serialize;
use std::ffi::OsString;
use std::io::{ErrorKind as ErrorKindIo, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use track::TrackArgs;

const USAGE: &str = "\
mocap-repair [OPTIONS] <IN> --output <OUT>
       mocap-repair <COMMAND>";

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
#[command(name = "mocap-repair", version, override_usage = USAGE, after_help = AFTER_HELP, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
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
        /// Show all markers of the gap map, all gaps and all bones, however many
        #[arg(long)]
        all: bool,
        /// Draw with ASCII characters only [default: by the locale]
        #[arg(long)]
        ascii: bool,
        /// One JSON document per take, which has everything
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
    /// Follow a body with a skeleton through clouds of points, one for each frame, and write its motion as BVH
    #[command(after_help = track::AFTER_HELP)]
    Track(Box<TrackArgs>),
    /// Find the motion of a body with a skeleton from the labelled markers that it wears, and write it as BVH
    #[command(after_help = fit::AFTER_HELP)]
    Solve(Box<SolveArgs>),
    /// Many takes: plan them, repair them, account for each
    #[command(subcommand)]
    Batch(batch::BatchCommand),
    /// Take the layout for Foxglove or Lichtblick out of a log
    Layout(LayoutArgs),
    /// Make the report to look at from the log of a repair: one HTML file for any browser
    Report(ReportArgs),
    /// Print a script that completes command lines in a shell
    Completions {
        /// The shell
        #[arg(value_enum)]
        shell: Shell,
    },
    /// Print the manual page, or write it and those of the subcommands into a folder
    Man {
        /// Folder to write all pages to; made if it is not there
        #[arg(short, long, value_name = "DIR")]
        output: Option<PathBuf>,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
    /// Make a synthetic recording of a walking figure: a take, or a body in clouds of points
    Demo {
        /// Folder to write to; made if it is not there
        #[arg(short, long, value_name = "DIR")]
        output: PathBuf,
        /// What to make
        #[arg(long, default_value = "take")]
        kind: DemoKind,
        /// Number of frames [default: 900; of a body 60]
        #[arg(long, value_parser = clap::value_parser!(u32).range(60..=200_000))]
        frames: Option<u32>,
        /// Frames per second [default: 120; of a body 30]
        #[arg(long, value_name = "HZ", value_parser = rate)]
        rate: Option<f64>,
        /// Another seed makes another walk
        #[arg(long, default_value_t = DemoOptions::default().seed)]
        seed: u64,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
}

/// Parses the command line, does what it says and returns the exit code.
/// `heed` is called before work that looks at `interrupt`: from then on an interrupt must do no more than set it.
pub fn main(interrupt: &AtomicBool, heed: fn()) -> u8 {
    match run(interrupt, heed) {
        0 if LOST.load(Ordering::Relaxed) => 1,
        code => code,
    }
}

fn run(interrupt: &AtomicBool, heed: fn()) -> u8 {
    settle_colours();
    let words: Vec<OsString> = std::env::args_os().collect();
    let (cli, matches, command) = match parse(&words) {
        Ok(parsed) => parsed,
        Err(Refused::Typed(error)) => {
            let code = if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) { 0 } else { 2 };
            // a closed pipe is no reason to fail while failing
            let _ = error.print();
            return code;
        }
        Err(Refused::Config { problem, json }) => {
            fail(&problem, json);
            return 2;
        }
    };
    match cli.command {
        Some(Command::Inspect { inputs, stated, all, ascii, json }) => {
            let style = Style::of_stdout();
            inspect(&inputs, &stated.reading(), (!json).then_some((Style { ascii: ascii || style.ascii, ..style }, all)))
        }
        Some(Command::Bones { input, stated }) => print_bones(&input, &stated.reading()),
        Some(Command::Convert(args)) => run_convert(&args),
        Some(Command::Track(args)) => {
            heed();
            run_track(&args, interrupt)
        }
        Some(Command::Solve(args)) => run_solve(&args),
        Some(Command::Batch(command)) => batch::command(&command, interrupt, heed),
        Some(Command::Layout(args)) => written(log::extract_layout(&args.log, &args.output, args.force)),
        Some(Command::Report(args)) => written(page::report_of_log(&args.log, &args.output, args.force)),
        Some(Command::Demo { output, kind, frames, rate, seed, force }) => {
            let frames = frames.map(|frames| frames as usize);
            listed(match kind {
                DemoKind::Take => {
                    let usual = DemoOptions::default();
                    let (frames, rate_hz) = (frames.unwrap_or(usual.frames), rate.unwrap_or(usual.rate_hz));
                    write_demo(&output, &DemoOptions { frames, rate_hz, seed, ..usual }, force)
                }
                DemoKind::Body => {
                    let usual = BodyOptions::default();
                    let (frames, rate_hz) = (frames.unwrap_or(usual.frames), rate.unwrap_or(usual.rate_hz));
                    write_body(&output, &BodyOptions { frames, rate_hz, seed }, force)
                }
            })
        }
        Some(Command::Completions { shell }) => {
            print(&completions(shell));
            0
        }
        Some(Command::Man { output, force }) => manual(output.as_deref(), force),
        None => {
            heed();
            run_repair(&cli.repair, &command, &matches, interrupt)
        }
    }
}

/// The script for a shell.
fn completions(shell: Shell) -> String {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "mocap-repair", &mut script);
    // The generator for bash calls a subcommand by two names if the program's has a hyphen, and then completes nothing after it.
    String::from_utf8_lossy(&script).replace("mocap__subcmd__repair", "mocap__repair")
}

/// Why a command line cannot be followed.
enum Refused {
    /// What was typed is wrong, or asks for help.
    Typed(clap::Error),
    /// What a file of `--config` says is wrong; `json`: it is to be told to a script.
    Config { problem: String, json: bool },
}

/// What was typed, with what `--config` says where nothing was typed.
/// Also returns the definition of the command line, built.
fn parse(words: &[OsString]) -> Result<(Cli, ArgMatches, clap::Command), Refused> {
    let mut command = Cli::command();
    let mut matches = command.try_get_matches_from_mut(words).map_err(Refused::Typed)?;
    if matches.subcommand_name().is_none()
        && let Some(path) = matches.get_one::<PathBuf>("config")
    {
        let words = config::with_file(&command, words, &matches, path)
            .map_err(|problem| Refused::Config { problem, json: matches.get_flag("json") })?;
        matches = command.try_get_matches_from_mut(words).map_err(Refused::Typed)?;
    }
    let cli = Cli::from_arg_matches(&matches).map_err(|error| Refused::Typed(error.format(&mut command)))?;
    Ok((cli, matches, command))
}

fn manual(folder: Option<&Path>, force: bool) -> u8 {
    let command = Cli::command();
    let printed = match folder {
        Some(folder) => man::write(&command, folder, force)
            .map(|pages| pages.iter().fold(String::new(), |text, page| text + &page.display().to_string() + "\n"))
            .map_err(|error| error.to_string()),
        None => man::pages(&command)
            .map(|pages| pages.first().map(|(_, page)| String::from_utf8_lossy(page).into_owned()).unwrap_or_default())
            .map_err(|error| error.to_string()),
    };
    match printed {
        Ok(text) => {
            print(&text);
            0
        }
        Err(error) => {
            fail(&error, false);
            1
        }
    }
}

fn run_repair(args: &RepairArgs, command: &clap::Command, matches: &ArgMatches, interrupt: &AtomicBool) -> u8 {
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
    if args.print_config {
        print(&config::commented(command, matches));
        return 0;
    }
    let request = Request { config: config::effective(command, matches), ..args.request() };
    let mut terminal = watching(args.quiet || args.json);
    let result = repair(&request, &mut terminal, interrupt);
    drop(terminal);
    match result {
        Ok(report) => {
            if args.json {
                print(&report.json());
            } else if !args.quiet {
                let style = Style::of_stdout();
                print(&report.text(&style));
                if args.explain {
                    print(&format!("\n{}", report.explanation_text(&style)));
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
    let conversion = args.conversion();
    let waiting = waiting(&format!("converting {}", conversion.input.display()), args.quiet || args.json);
    let converted = convert(&conversion);
    drop(waiting);
    match converted {
        Ok(converted) => {
            if args.json {
                print(&converted.json());
            } else if !args.quiet {
                print(&converted.text(&Style::of_stdout()));
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

fn run_track(args: &TrackArgs, interrupt: &AtomicBool) -> u8 {
    if let Some(text) = args.contradiction() {
        let _ = Cli::command().error(ErrorKind::ArgumentConflict, text).print();
        return 2;
    }
    let mut terminal = watching(args.quiet || args.json);
    let tracked = track_clouds(&args.request(), &mut terminal, interrupt);
    drop(terminal);
    told(tracked, args.json, args.quiet, &(TrackReport::json, TrackReport::text, TrackReport::exit_code))
}

fn run_solve(args: &SolveArgs) -> u8 {
    let request = args.request();
    let mut terminal = watching(args.quiet || args.json);
    let fitted = fit_markers(&request, &mut terminal);
    drop(terminal);
    told(fitted, args.json, args.quiet, &(FitReport::json, FitReport::text, FitReport::exit_code))
}

/// Says for scripts, for people or not at all what came of a motion, and returns the exit code. `of` is how: as JSON, as text, as a code.
fn told<R>(
    result: Result<R, RepairError>,
    json: bool,
    quiet: bool,
    of: &(impl Fn(&R) -> String, impl Fn(&R, &Style) -> String, impl Fn(&R) -> u8),
) -> u8 {
    match result {
        Ok(report) => {
            if json {
                print(&of.0(&report));
            } else if !quiet {
                print(&of.1(&report, &Style::of_stdout()));
            }
            of.2(&report)
        }
        Err(error) => {
            fail(&error.to_string(), json);
            1
        }
    }
}

/// `set`: how it is set for people, and whether everything is shown; `None` for scripts.
fn inspect(inputs: &[PathBuf], reading: &Reading, set: Option<(Style, bool)>) -> u8 {
    let mut code = 0;
    for (at, path) in inputs.iter().enumerate() {
        let inspected = {
            let _waiting = waiting(&format!("reading {}", path.display()), set.is_none());
            open(path, reading).map(|opened| Inspection::new(path, &opened))
        };
        match (inspected, &set) {
            (Ok(inspection), None) => print(&inspection.json()),
            (Ok(inspection), Some((style, all))) => {
                print(&format!("{}{}", if at > 0 { "\n" } else { "" }, inspection.text(style, *all)));
            }
            (Err(error), _) => {
                fail(&error.to_string(), set.is_none());
                code = 1;
            }
        }
    }
    code
}

/// Progress on a terminal, unless it is not to be shown.
fn watching(silent: bool) -> Option<Terminal> {
    if silent { None } else { Terminal::new() }
}

/// The same for work that has no parts: it is shown until it is dropped.
fn waiting(doing: &str, silent: bool) -> Option<Terminal> {
    let mut terminal = watching(silent);
    terminal.phase(doing);
    terminal
}

fn print_bones(path: &Path, reading: &Reading) -> u8 {
    let found = {
        let _waiting = waiting(&format!("looking for bones in {}", path.display()), false);
        open(path, reading).map(|opened| {
            let take = opened.document.take();
            bones::write(&bones::find(take, &neighbours(take)), take)
        })
    };
    match found {
        Ok(bones) => {
            print(&bones);
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

/// The exit code of a command that says which files it wrote.
fn listed(result: Result<Vec<PathBuf>, RepairError>) -> u8 {
    match result {
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
        eprintln!("{} {}", Style::of_stderr().toned(Tone::Alarm, "mocap-repair:"), printable(error));
    }
}

/// True if something that was to be printed is lost.
static LOST: AtomicBool = AtomicBool::new(false);

/// Prints to standard output; a reader that has gone away is not our failure, a full disk is.
fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKindIo::BrokenPipe => {
            LOST.store(true, Ordering::Relaxed);
            eprintln!("mocap-repair: standard output: cannot be written: {error}");
        }
        _ => {}
    }
}
