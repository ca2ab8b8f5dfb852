//! What can be typed behind `batch`.

use crate::batch::memory;
use crate::batch::plan::Shard;
use clap::{Args, Subcommand, ValueEnum, ValueHint};
use std::path::PathBuf;
use std::time::Duration;

pub const RUN_AFTER_HELP: &str = "\
Exit codes:
  0   every take is repaired
  3   every take is accounted for, but look at them: some were put aside, or have something to look at
  75  stopped, the same command goes on: interrupted, no room on the disk, a disk or the engine is gone
  1   something has to be done first: takes failed, too many of the first ones came to nothing, or the
      plan cannot be run
  2   the command line was wrong";

/// `mocap-repair batch`.
#[derive(Debug, Subcommand)]
pub enum BatchCommand {
    /// Find takes and write down how each is to be repaired
    Plan(PlanArgs),
    /// Repair the takes of a plan; what is done already is not done again
    #[command(after_help = RUN_AFTER_HELP)]
    Run(RunArgs),
    /// Say how a batch stands
    Status(StatusArgs),
    /// Write a report on all takes: one HTML page, and one table (CSV) beside it
    Report(FleetArgs),
    /// Repair the takes of a folder as they come, when they have stopped growing
    #[command(after_help = RUN_AFTER_HELP)]
    Watch(WatchArgs),
    /// Repair one take of a batch: a job on standard input (for engines)
    #[command(hide = true)]
    Take,
}

/// `mocap-repair batch plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// Folders, takes, patterns in quotes, or addresses in buckets (s3://, gs://, az://, file://)
    #[arg(value_name = "SOURCE", required_unless_present = "list")]
    pub sources: Vec<String>,
    /// A text file with one source on each line
    #[arg(long, value_name = "FILE", conflicts_with = "sources")]
    pub list: Option<PathBuf>,
    /// The plan to write
    #[arg(short, long, value_name = "PLAN.jsonl")]
    pub output: PathBuf,
    #[command(flatten)]
    pub way: WayArgs,
    /// Replace a plan that exists
    #[arg(long)]
    pub force: bool,
    /// Say what was planned as JSON lines on standard output
    #[arg(long)]
    pub json: bool,
}

/// How the takes of a batch are repaired.
#[derive(Debug, Args)]
pub struct WayArgs {
    /// Options for every take, as --print-config of mocap-repair writes them
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// Write a report to look at for every take
    #[arg(long)]
    pub reports: bool,
    /// Write a table of filled samples for every take
    #[arg(long)]
    pub fills: bool,
    /// Write no logs
    #[arg(long)]
    pub no_log: bool,
}

/// How takes are run.
#[derive(Debug, Args)]
#[allow(clippy::struct_excessive_bools)] // each is a switch that somebody types
pub struct EngineArgs {
    /// Takes to work on at the same time [default: one more than there are cores, since one of them mostly waits for the disk; with Ray its cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub jobs: Option<u32>,
    /// Who runs the takes
    #[arg(long, value_enum, default_value_t = EngineArg::Local)]
    pub engine: EngineArg,
    /// What all takes together may take, such as 16G [default: four fifths of what is free]
    #[arg(long, value_name = "SIZE", value_parser = memory::parse)]
    pub memory: Option<u64>,
    /// End a take that is not done after this time, such as 30m or 2h [default: never]
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub timeout: Option<Duration>,
    /// The Python that has Ray
    #[arg(long, value_name = "PATH", default_value = "python3", value_hint = ValueHint::ExecutablePath, help_heading = "Ray")]
    pub python: PathBuf,
    /// A cluster that is there, such as auto or 10.0.0.1:6379 [default: one is started on this machine, for this machine only]
    #[arg(long, value_name = "ADDRESS", help_heading = "Ray")]
    pub ray_address: Option<String>,
    /// Try takes again that were put aside
    #[arg(long)]
    pub retry: bool,
    /// Go on however many of the first takes fail
    #[arg(long)]
    pub keep_going: bool,
    /// Replace files of the output folder that do not come from a batch
    #[arg(long)]
    pub force: bool,
    /// Say what happens as JSON lines on standard output
    #[arg(long)]
    pub json: bool,
    /// Print nothing unless it failed
    #[arg(short, long)]
    pub quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EngineArg {
    /// Processes on this machine
    Local,
    /// Tasks of Ray, on a cluster or on this machine
    Ray,
}

/// `mocap-repair batch status`.
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// The folder or bucket that a batch was run into
    #[arg(value_name = "DIR")]
    pub out: String,
    /// Say it as JSON lines, every take that was put aside among them
    #[arg(long)]
    pub json: bool,
}

/// `mocap-repair batch report`.
#[derive(Debug, Args)]
pub struct FleetArgs {
    /// The folder or bucket that a batch was run into
    #[arg(value_name = "DIR")]
    pub out: String,
    /// The page to write; the table beside it has the same name and .csv
    #[arg(short, long, value_name = "PAGE.html", value_hint = ValueHint::FilePath)]
    pub output: PathBuf,
    /// The takes of another plan than the one that was run last: the beginning of its SHA-256, or "all"
    #[arg(long, value_name = "SHA256")]
    pub plan: Option<String>,
    /// Replace a page and a table that exist
    #[arg(long)]
    pub force: bool,
}

/// `mocap-repair batch watch`.
#[derive(Debug, Args)]
pub struct WatchArgs {
    /// The folder to watch
    #[arg(value_name = "FOLDER")]
    pub folder: String,
    /// The folder or bucket for the repaired takes; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: String,
    /// How long a take must not have changed
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = duration)]
    pub settle: Duration,
    /// How often the folder is looked through
    #[arg(long, value_name = "TIME", default_value = "2s", value_parser = duration)]
    pub every: Duration,
    /// End when everything that is there is accounted for
    #[arg(long)]
    pub once: bool,
    #[command(flatten)]
    pub way: WayArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `mocap-repair batch run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The plan
    #[arg(value_name = "PLAN.jsonl")]
    pub plan: PathBuf,
    /// The folder or bucket for the repaired takes; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: String,
    /// Only this part of the takes, counted from 0: 0/4, 1/4, 2/4, 3/4
    #[arg(long, value_name = "I/N", value_parser = Shard::parse)]
    pub shard: Option<Shard>,
    #[command(flatten)]
    pub engine: EngineArgs,
}

fn duration(text: &str) -> Result<Duration, String> {
    let wrong = || "expected a time, such as 90s, 30m or 2h".to_owned();
    let time = humantime::parse_duration(text).or_else(|e| text.parse().map(Duration::from_secs).map_err(|_| e)).map_err(|_| wrong())?;
    if time.is_zero() { Err(wrong()) } else { Ok(time) }
}
