//! `mocap-repair batch`: what can be typed, and what it means.

use super::args::RepairArgs;
use super::{Cli, config, parse};
use crate::batch::BatchError;
use crate::batch::engine::Engine;
use crate::batch::engine::local::Local;
use crate::batch::job::{Job, Said};
use crate::batch::ledger::{self, Begun, Stop};
use crate::batch::memory;
use crate::batch::plan::{Plan, Shard, Wanted};
use crate::batch::planning::{Way, plan};
use crate::batch::run::{Next, Settings, Supply, Watcher, run};
use crate::batch::session::{self, Session};
use crate::batch::sources::{find, find_listed};
use crate::batch::store::Place;
use crate::batch::take::{self, Files};
use crate::repair::Request;
use crate::solve::Observer;
use clap::{Args, CommandFactory, FromArgMatches, Subcommand, ValueEnum};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

pub(super) const RUN_AFTER_HELP: &str = "\
Exit codes:
  0   every take is repaired
  3   every take is accounted for, but look at them: some were put aside, or have something to look at
  75  stopped, the same command goes on: interrupted, no room on the disk, the engine is gone
  1   stopped, something has to be done first: too many of the first takes failed, or the plan cannot be run
  2   the command line was wrong";

/// `mocap-repair batch`.
#[derive(Debug, Subcommand)]
pub(super) enum BatchCommand {
    /// Find takes and write down how each is to be repaired
    Plan(PlanArgs),
    /// Repair the takes of a plan; what is done already is not done again
    #[command(after_help = RUN_AFTER_HELP)]
    Run(RunArgs),
    /// Repair one take of a batch: a job on standard input (for engines)
    #[command(hide = true)]
    Take,
}

/// `mocap-repair batch plan`.
#[derive(Debug, Args)]
pub(super) struct PlanArgs {
    /// Folders, takes, patterns in quotes, or addresses in buckets (s3://, gs://, az://, file://)
    #[arg(value_name = "SOURCE", required_unless_present = "list")]
    sources: Vec<String>,
    /// A text file with one source on each line
    #[arg(long, value_name = "FILE", conflicts_with = "sources")]
    list: Option<PathBuf>,
    /// The plan to write
    #[arg(short, long, value_name = "PLAN.jsonl")]
    output: PathBuf,
    #[command(flatten)]
    way: WayArgs,
    /// Replace a plan that exists
    #[arg(long)]
    force: bool,
    /// Say what was planned as JSON lines on standard output
    #[arg(long)]
    json: bool,
}

/// How the takes of a batch are repaired.
#[derive(Debug, Args)]
pub(super) struct WayArgs {
    /// Options for every take, as --print-config of mocap-repair writes them
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Write a report to look at for every take
    #[arg(long)]
    reports: bool,
    /// Write a table of filled samples for every take
    #[arg(long)]
    fills: bool,
    /// Write no logs
    #[arg(long)]
    no_log: bool,
}

/// How takes are run.
#[derive(Debug, Args)]
pub(super) struct EngineArgs {
    /// Takes to work on at the same time [default: as many as there are cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    jobs: Option<u32>,
    /// Who runs the takes
    #[arg(long, value_enum, default_value_t = EngineArg::Local)]
    engine: EngineArg,
    /// What all takes together may take, such as 16G [default: four fifths of what is free]
    #[arg(long, value_name = "SIZE", value_parser = memory::parse)]
    memory: Option<u64>,
    /// End a take that is not done after this time, such as 30m or 2h [default: never]
    #[arg(long, value_name = "TIME", value_parser = duration)]
    timeout: Option<Duration>,
    /// Try takes again that were put aside
    #[arg(long)]
    retry: bool,
    /// Go on however many of the first takes fail
    #[arg(long)]
    keep_going: bool,
    /// Replace files of the output folder that do not come from a batch
    #[arg(long)]
    force: bool,
    /// Say what happens as JSON lines on standard output
    #[arg(long)]
    json: bool,
    /// Print nothing unless it failed
    #[arg(short, long)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum EngineArg {
    /// Processes on this machine
    Local,
}

/// `mocap-repair batch run`.
#[derive(Debug, Args)]
pub(super) struct RunArgs {
    /// The plan
    #[arg(value_name = "PLAN.jsonl")]
    plan: PathBuf,
    /// The folder or bucket for the repaired takes; made if it is not there
    #[arg(long, value_name = "DIR")]
    out: String,
    /// Only this part of the takes, counted from 0: 0/4, 1/4, 2/4, 3/4
    #[arg(long, value_name = "I/N", value_parser = Shard::parse)]
    shard: Option<Shard>,
    #[command(flatten)]
    engine: EngineArgs,
}

fn duration(text: &str) -> Result<Duration, String> {
    let wrong = || "expected a time, such as 90s, 30m or 2h".to_owned();
    let time = humantime::parse_duration(text).or_else(|e| text.parse().map(Duration::from_secs).map_err(|_| e)).map_err(|_| wrong())?;
    if time.is_zero() { Err(wrong()) } else { Ok(time) }
}

/// What goes wrong before anything is done: the text, and the exit code.
pub(super) type Refused = (String, u8);

fn refused(error: BatchError) -> Refused {
    let code = if error.again { 75 } else { 1 };
    (error.text, code)
}

impl WayArgs {
    fn way(&self) -> Result<Way, Refused> {
        let mut words: Vec<OsString> = vec!["mocap-repair".into(), "--print-config".into()];
        if let Some(path) = &self.config {
            let path = std::path::absolute(path).map_err(|e| (format!("{}: {e}", path.display()), 1))?;
            words.extend(["--config".into(), path.into()]);
        }
        let (cli, matches, command) = parse(&words).map_err(|refused| match refused {
            super::Refused::Typed(error) => (error.to_string(), 2),
            super::Refused::Config { problem, .. } => (problem, 2),
        })?;
        let args = &cli.repair;
        let single =
            [("fills", args.fills.is_some()), ("log", args.log.is_some()), ("report", args.report.is_some()), ("dry-run", args.dry_run)];
        if let Some((key, _)) = single.iter().find(|(_, said)| *said) {
            let config = self.config.as_deref().unwrap_or(Path::new("")).display();
            return Err((format!("{config}: {key} is for one take; a batch has --fills, --reports and --no-log"), 2));
        }
        let request = args.request();
        Ok(Way {
            effective: config::effective(&command, &matches),
            config: config::settled(&command, &matches),
            files: request.reads.into_iter().filter(|path| Some(path) != args.config.as_ref()).collect(),
            wanted: Wanted { log: !self.no_log && !args.no_log, report: self.reports, fills: self.fills },
        })
    }
}

/// A take of a batch as it would have been typed.
fn request_of(files: &Files, text: &str) -> Result<Request, String> {
    let mut words: Vec<OsString> = vec!["mocap-repair".into(), "--quiet".into(), "--output".into(), files.output.clone().into()];
    for (option, path) in [("--log", &files.log), ("--report", &files.page), ("--fills", &files.fills)] {
        if let Some(path) = path {
            words.extend([option.into(), path.clone().into()]);
        }
    }
    if files.log.is_none() {
        words.push("--no-log".into());
    }
    words.extend(["--".into(), files.input.clone().into()]);
    let mut command = Cli::command();
    let given = command.try_get_matches_from_mut(&words).map_err(|e| e.to_string())?;
    let words = config::with_text(&command, &words, &given, text)?;
    let matches = command.try_get_matches_from_mut(words).map_err(|e| e.to_string())?;
    let args = RepairArgs::from_arg_matches(&matches).map_err(|e| e.to_string())?;
    Ok(Request { config: config::effective(&command, &matches), ..args.request() })
}

pub(super) fn run_plan(args: &PlanArgs) -> Result<(u8, String), Refused> {
    let way = args.way.way()?;
    let (findings, sources) = match &args.list {
        Some(list) => (find_listed(list).map_err(refused)?, vec![list.display().to_string()]),
        None => {
            let sources = args.sources.iter().map(|source| settled(source)).collect();
            (find(&args.sources).map_err(refused)?, sources)
        }
    };
    let planned = plan(&findings, &sources, &way, &args.output, args.force).map_err(refused)?;
    Ok((0, format!("{planned:#?}\n")))
}

/// A source as it stands in a plan: folders with their full names.
fn settled(source: &str) -> String {
    if crate::batch::sources::is_address(source) {
        return source.to_owned();
    }
    crate::batch::sources::local(source).map_or_else(|_| source.to_owned(), |path| path.to_string_lossy().into_owned())
}

struct FromPlan(Plan);

impl Supply for FromPlan {
    fn next(&mut self) -> Next {
        match self.0.next() {
            Some(Ok(take)) => Next::Take(Box::new(take)),
            Some(Err(error)) => Next::Broken(error),
            None => Next::End,
        }
    }
}

struct Nobody;
impl Watcher for Nobody {}

impl EngineArgs {
    fn engine(&self) -> Result<Box<dyn Engine>, Refused> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let jobs = self.jobs.map_or(cores, |jobs| jobs as usize);
        let program = std::env::current_exe().map_err(|e| (format!("this program cannot be found: {e}"), 1))?;
        Ok(match self.engine {
            EngineArg::Local => Box::new(Local::new(program, jobs, self.memory.unwrap_or_else(memory::available))),
        })
    }
}

pub(super) fn run_batch(args: &RunArgs, interrupt: &AtomicBool) -> Result<u8, Refused> {
    let shard = args.shard.unwrap_or(Shard::ALL);
    let out = Place::parse(&absolute_out(&args.out)?).map_err(|e| refused(e.into()))?;
    let (header, sha256, takes, bytes) = session::survey(&args.plan, shard).map_err(refused)?;
    session::check(&args.plan, &header, &out).map_err(refused)?;
    let engine = args.engine.engine()?;
    let session = Session::open(&out, &format!("{}-of-{}", shard.index, shard.count)).map_err(refused)?;
    session::keep_plan(&out, &args.plan, &sha256).map_err(refused)?;
    let begun = Begun {
        time: ledger::now(),
        host: session::host(),
        pid: std::process::id(),
        version: header.version.clone(),
        plan: Some(sha256.clone()),
        shard: shard.index,
        shards: shard.count,
        engine: engine.name().to_owned(),
        jobs: engine.slots(),
        takes,
        bytes,
    };
    let mut ledger = session.ledger(&out, &sha256[..8], shard, begun).map_err(refused)?;
    let settings = Settings {
        header: &header,
        out: &out,
        work: session.work.clone(),
        force: args.engine.force,
        retry: args.engine.retry,
        keep_going: args.engine.keep_going,
        timeout: args.engine.timeout,
        quarantined: session.quarantined.clone(),
    };
    let mut supply = FromPlan(Plan::open(&args.plan, shard).map_err(refused)?);
    let (ended, why) = run(&settings, engine.as_ref(), &mut supply, &mut ledger, &Nobody, interrupt).map_err(refused)?;
    session.close(&out);
    super::print(&format!("{ended:?} {why}\n"));
    Ok(exit_code(&ended))
}

fn exit_code(ended: &ledger::Ended) -> u8 {
    match ended.stop {
        Stop::Complete if ended.remarked + ended.quarantined + ended.failed > 0 => 3,
        Stop::Complete => 0,
        Stop::Interrupted | Stop::DiskFull | Stop::Engine => 75,
        Stop::TooManyFailures => 1,
    }
}

/// The output folder by its full name: processes may run elsewhere.
fn absolute_out(out: &str) -> Result<String, Refused> {
    if crate::batch::sources::is_address(out) {
        return Ok(out.to_owned());
    }
    let path = crate::batch::sources::local(out).map_err(refused)?;
    path.to_str().map(str::to_owned).ok_or_else(|| (format!("{out}: its name is not UTF-8 text; choose another --out"), 1))
}

/// One take: the job on standard input, what becomes of it on standard output. Ends when standard input ends.
pub(super) fn run_take() -> u8 {
    let mut line = String::new();
    if std::io::stdin().read_line(&mut line).is_err() || line.is_empty() {
        return 2;
    }
    let job: Job = match serde_json::from_str(&line) {
        Ok(job) => job,
        Err(error) => {
            super::fail(&format!("standard input: is no job of a batch: {error}"), false);
            return 2;
        }
    };
    std::thread::spawn(|| {
        // whoever wants the take is gone when nothing more can come
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        std::process::exit(75);
    });
    let _ = rayon::ThreadPoolBuilder::new().num_threads(job.threads.max(1)).build_global(); // only ever asked here
    let result = take::run(&job, &request_of, &mut Phases);
    let code = result.outcome.exit_code(result.exit_code);
    super::print(&crate::report::lines(&[Said::Result(result)]));
    code
}

/// Says what is being done.
struct Phases;

impl Observer for Phases {
    fn phase(&mut self, doing: &str) {
        super::print(&crate::report::lines(&[Said::Phase { text: doing.to_owned() }]));
    }
}
