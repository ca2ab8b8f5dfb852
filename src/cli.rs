//! What was typed, the help text, and what is printed. The only file that prints.
#![allow(clippy::print_stdout, clippy::print_stderr)] // this is where output belongs

use crate::bones;
use crate::demo::{DemoOptions, write_demo};
use crate::gaps::Policy;
use crate::inspect::Inspection;
use crate::log::Terminal;
use crate::repair::{RepairError, Request, neighbours, open, repair};
use crate::report::lines;
use crate::solve::auto::{Recipe, Stiffness};
use crate::solve::lds::em::Noise;
use crate::solve::lds::step::BoneStep;
use crate::solve::lds::{EStep, Hidden, Init, Start};
use crate::solve::{Limits, Method, Settings};
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum, error::ErrorKind};
use formats::{Stated, Unit};
use serde::Serialize;
use std::ffi::OsString;
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

#[derive(Debug, Args)]
struct StatedArgs {
    /// Frame rate, if the file does not say it or says it wrong
    #[arg(long, value_name = "HZ", value_parser = rate, allow_negative_numbers = true)]
    rate: Option<f64>,
    /// Unit of length, if the file does not say it or says it wrong
    #[arg(long, value_enum)]
    units: Option<UnitArg>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum UnitArg {
    Mm,
    Cm,
    M,
}

impl StatedArgs {
    fn stated(&self) -> Stated {
        let unit = self.units.map(|u| match u {
            UnitArg::Mm => Unit::Millimetre,
            UnitArg::Cm => Unit::Centimetre,
            UnitArg::M => Unit::Metre,
        });
        Stated { rate_hz: self.rate, unit, ..Stated::default() }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum StartArg {
    Model,
    Interpolate,
    Zero,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum InitArg {
    Pca,
    Random,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum NoiseArg {
    Isotropic,
    Diagonal,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum StepArg {
    GaussNewton,
    Gradient,
}

/// What `--bones` can be given.
#[derive(Clone, Debug, PartialEq, Eq)]
enum BonesArg {
    Stiffness(Stiffness),
    File(PathBuf),
}

impl From<OsString> for BonesArg {
    fn from(text: OsString) -> Self {
        match text.to_str() {
            Some("soft") => Self::Stiffness(Stiffness::Soft),
            Some("hard") => Self::Stiffness(Stiffness::Hard),
            _ => Self::File(text.into()),
        }
    }
}

#[derive(Debug, Args)]
#[allow(clippy::struct_excessive_bools)] // each is a switch that somebody types
struct RepairArgs {
    /// The take to repair; it is never written
    #[arg(value_name = "IN", required = true, num_args = 1..)]
    inputs: Vec<PathBuf>,
    /// The repaired take; its extension may name another format
    #[arg(short, long, value_name = "OUT", required_unless_present_any = ["in_place", "dry_run"])]
    output: Option<PathBuf>,
    /// How to fill
    #[arg(long, value_name = "METHOD", default_value = Method::default().name(), value_parser = method)]
    method: Method,
    /// Dimension of the hidden state; rank of msvd
    #[arg(long, value_name = "H", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=256))]
    hidden: u32,
    /// As many hidden dimensions as hold this share of the motion's energy, for instance 0.95
    #[arg(long, value_name = "SHARE", conflicts_with = "hidden", value_parser = share)]
    energy: Option<f64>,
    /// Weight of all bones as in the paper, 1/m^4 [default: each bone by its own spread]
    #[arg(long, value_name = "L", value_parser = positive)]
    lambda: Option<f64>,
    /// The most EM iterations
    #[arg(long, value_name = "N", default_value_t = Limits::default().steps, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: u32,
    /// Stop when the log-likelihood changes by less than this share of itself
    #[arg(long, value_name = "E", default_value_t = Limits::default().tolerance, value_parser = positive)]
    tolerance: f64,
    /// The paper's E-step, which takes the present fill for measured
    #[arg(long)]
    impute: bool,
    /// Where EM begins to fill: where its first model expects the markers, on straight lines, or at each marker's mean
    /// [default: model, or interpolate with --init random]
    #[arg(long, value_enum)]
    start: Option<StartArg>,
    /// The first parameters of EM: from principal components, or drawn at random
    #[arg(long, value_enum, default_value_t = InitArg::Pca)]
    init: InitArg,
    /// Noise of the model: one variance for everything, or one for each marker and a full matrix for the states
    #[arg(long, value_enum, default_value_t = NoiseArg::Diagonal)]
    noise: NoiseArg,
    /// How soft bones are met: Gauss-Newton steps, or the paper's gradient descent, which takes each frame alone
    #[arg(long, value_enum, default_value_t = StepArg::GaussNewton)]
    step: StepArg,
    /// Let bones act as the paper prints it: each frame alone, on the fill only, nothing joined at the edges of gaps
    #[arg(long)]
    as_printed: bool,
    /// Seed for methods that draw random numbers
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Leave gaps longer than this open, whole
    #[arg(long, value_name = "FRAMES")]
    max_gap: Option<usize>,
    /// Fill gaps that reach the take's first or last frame, too
    #[arg(long)]
    extrapolate: bool,
    /// Fill these markers only (labels with or without prefix; * and ? allowed); all others still help
    #[arg(long, value_name = "PATTERN", value_delimiter = ',')]
    markers: Vec<String>,
    /// Leave gaps open, whole, of which a sample is predicted to be off by more than this
    #[arg(long, value_name = "MM", value_parser = positive)]
    max_sigma: Option<f64>,
    /// Bones to keep (CSV: marker,marker[,length in mm]) instead of those found, or how auto keeps them: soft, by the spread that each
    /// shows, or hard, exactly; may be said twice
    #[arg(long, value_name = "FILE|soft|hard")]
    bones: Vec<BonesArg>,
    /// Say for each gap which neighbours and experts filled it, and how far it may be off
    #[arg(long)]
    explain: bool,
    #[command(flatten)]
    stated: StatedArgs,
    /// Write one row per filled sample
    #[arg(long, value_name = "FILE.csv")]
    fills: Option<PathBuf>,
    /// Write the log here [default: the output's name with .mcap]
    #[arg(long, value_name = "FILE.mcap", conflicts_with = "no_log")]
    log: Option<PathBuf>,
    /// Write no log
    #[arg(long)]
    no_log: bool,
    /// Write computing times into the log (then it differs from run to run)
    #[arg(long)]
    timings: bool,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
    /// Put the repaired take under the input's name and keep the input as IN.orig
    #[arg(long, conflicts_with = "output")]
    in_place: bool,
    /// Read, decide and report; solve and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Report as JSON lines on standard output
    #[arg(long)]
    json: bool,
    /// Print nothing unless it failed
    #[arg(short, long)]
    quiet: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("expected a number above 0".to_owned()),
    }
}

/// Frame rates from one frame in a quarter of an hour to a million a second: anything else is a slip of the finger.
fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (1e-3..=1e6).contains(&x) => Ok(x),
        _ => Err("expected a number of frames per second, from 0.001 to 1000000".to_owned()),
    }
}

fn method(text: &str) -> Result<Method, String> {
    Method::parse(text).ok_or_else(|| format!("expected one of: {}", Method::ALL.map(Method::name).join(", ")))
}

/// A share of something, above 0 and at most 1.
fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x <= 1.0 => Ok(x),
        _ => Err("expected a number above 0 and at most 1".to_owned()),
    }
}

impl RepairArgs {
    fn settings(&self) -> Settings {
        let random = self.init == InitArg::Random;
        let start = match self.start {
            Some(StartArg::Interpolate) => Start::Interpolate,
            Some(StartArg::Zero) => Start::Zero,
            // what a random model expects is nowhere near the body
            None if random => Start::Interpolate,
            Some(StartArg::Model) | None => Start::Model,
        };
        Settings {
            hidden: self.energy.map_or(Hidden::Count(self.hidden as usize), Hidden::Energy),
            lambda: self.lambda,
            e_step: if self.impute { EStep::Imputing } else { EStep::Exact },
            noise: match self.noise {
                NoiseArg::Isotropic => Noise::Isotropic,
                NoiseArg::Diagonal => Noise::Diagonal,
            },
            start,
            init: if random { Init::Random(self.seed) } else { Init::Components },
            step: match self.step {
                StepArg::Gradient => BoneStep::Gradient,
                StepArg::GaussNewton if self.as_printed => BoneStep::Frame,
                StepArg::GaussNewton => BoneStep::Coupled,
            },
            constant: !self.as_printed,
            recipe: Recipe::default(),
            stiffness: self
                .bones
                .iter()
                .rev()
                .find_map(|b| if let BonesArg::Stiffness(s) = b { Some(*s) } else { None })
                .unwrap_or_default(),
        }
    }

    fn request(&self) -> Request {
        let mut input = self.inputs.first().cloned().unwrap_or_default();
        if self.in_place {
            // behind a link it is the file that is replaced, not the link
            if input.is_symlink() {
                input = input.canonicalize().unwrap_or(input);
            }
        }
        let output = self.output.clone().unwrap_or_else(|| input.clone());
        let log = if self.no_log || self.dry_run { None } else { Some(self.log.clone().unwrap_or_else(|| output.with_extension("mcap"))) };
        Request {
            in_place: self.in_place,
            log,
            fills: self.fills.clone(),
            bones: self.bones.iter().rev().find_map(|b| if let BonesArg::File(path) = b { Some(path.clone()) } else { None }),
            force: self.force,
            dry_run: self.dry_run,
            timings: self.timings,
            method: self.method,
            settings: self.settings(),
            iterations: self.iterations,
            tolerance: self.tolerance,
            seed: self.seed,
            policy: Policy { max_gap: self.max_gap, extrapolate: self.extrapolate, max_sigma_mm: self.max_sigma },
            markers: self.markers.clone(),
            stated: self.stated.stated(),
            input,
            output,
        }
    }
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
        Some(Command::Inspect { inputs, stated, json }) => inspect(&inputs, &stated.stated(), json),
        Some(Command::Bones { input, stated }) => print_bones(&input, &stated.stated()),
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
            fail(&error, args.json);
            1
        }
    }
}

fn inspect(inputs: &[PathBuf], stated: &Stated, json: bool) -> u8 {
    let mut code = 0;
    for (at, path) in inputs.iter().enumerate() {
        match open(path, stated) {
            Ok(opened) => {
                let inspection = Inspection::new(path, &opened);
                if json {
                    print(&inspection.json());
                } else {
                    print(&format!("{}{}", if at > 0 { "\n" } else { "" }, inspection.text()));
                }
            }
            Err(error) => {
                fail(&error, json);
                code = 1;
            }
        }
    }
    code
}

fn print_bones(path: &Path, stated: &Stated) -> u8 {
    match open(path, stated) {
        Ok(opened) => {
            let take = opened.document.take();
            print(&bones::write(&bones::find(take, &neighbours(take)), take));
            0
        }
        Err(error) => {
            fail(&error, false);
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
            fail(&error, false);
            1
        }
    }
}

/// One line on standard error, or one JSON line on standard output.
fn fail(error: &RepairError, json: bool) {
    #[derive(Serialize)]
    #[serde(tag = "message_type", rename = "error")]
    struct Message {
        text: String,
    }
    if json {
        print(&lines(&[Message { text: error.to_string() }]));
    } else {
        eprintln!("mocap-repair: {error}");
    }
}

/// Prints to standard output; a reader that has gone away is not our failure.
fn print(text: &str) {
    let _ = std::io::stdout().lock().write_all(text.as_bytes());
}
