//! `mocap-repair batch`: what can be typed, and what it means.

#![allow(clippy::print_stderr)] // how far a batch is, where there is no terminal

mod args;

pub(super) use args::BatchCommand;

use super::args::RepairArgs;
use super::{Cli, config, parse};
use crate::batch::BatchError;
use crate::batch::engine::Engine;
use crate::batch::engine::local::Local;
use crate::batch::engine::ray::{Ray, Wish};
use crate::batch::fleet::{self, Plans};
use crate::batch::job::{Job, Said, TakeResult, Verdict};
use crate::batch::ledger::{self, Begun, Ledger, Stop};
use crate::batch::plan::{Header, Plan, Shard, Wanted};
use crate::batch::planning::{Way, plan, sha256_of};
use crate::batch::progress::{Json, Live, Plain, Silent, Tally};
use crate::batch::run::{Next, Settings, Supply, Watcher, run};
use crate::batch::session::{self, Session};
use crate::batch::sources::{find, find_listed};
use crate::batch::status::Status;
use crate::batch::store::Place;
use crate::batch::take::{self, Files};
use crate::batch::watch::Watched;
use crate::batch::{memory, sources, told};
use crate::repair::Request;
use crate::report::count;
use crate::solve::Observer;
use crate::typeset::Style;
use args::{EngineArg, EngineArgs, FleetArgs, PlanArgs, RunArgs, StatusArgs, WatchArgs, WayArgs};
use clap::{ArgMatches, CommandFactory, FromArgMatches};
use std::ffi::OsString;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Does what a command says and returns the exit code.
pub(super) fn command(command: &BatchCommand, interrupt: &AtomicBool, heed: fn()) -> u8 {
    let json = match command {
        BatchCommand::Plan(args) => args.json,
        BatchCommand::Run(args) => args.engine.json,
        BatchCommand::Watch(args) => args.engine.json,
        BatchCommand::Status(args) => args.json,
        BatchCommand::Report(_) | BatchCommand::Take => false,
    };
    let done = match command {
        BatchCommand::Take => return run_take(),
        BatchCommand::Plan(args) => run_plan(args).map(|(code, text)| {
            super::print(&text);
            code
        }),
        BatchCommand::Run(args) => {
            heed();
            run_batch(args, interrupt)
        }
        BatchCommand::Watch(args) => {
            heed();
            run_watch(args, interrupt)
        }
        BatchCommand::Status(args) => run_status(args),
        BatchCommand::Report(args) => run_report(args),
    };
    done.unwrap_or_else(|(text, code)| {
        super::fail(&text, json);
        code
    })
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
        if let Some(key) = for_one_take(args) {
            let config = self.config.as_deref().unwrap_or(Path::new("")).display();
            return Err((format!("{config}: {key} is for single takes; a batch has --fills, --reports and --no-log"), 2));
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

/// An option that is for one take and not for many, if one was said.
fn for_one_take(args: &RepairArgs) -> Option<&'static str> {
    let single = [
        ("fills", args.fills.is_some()),
        ("log", args.log.is_some()),
        ("report", args.report.is_some()),
        ("dry-run", args.dry_run),
        ("timings", args.timings), // outputs would differ from run to run
    ];
    single.iter().find(|(_, said)| *said).map(|(key, _)| *key)
}

/// What the options of a plan, as they stand there now, make of a command line; with its definition, built.
fn parsed(config: &str) -> Result<(clap::Command, ArgMatches), String> {
    let bare = ["mocap-repair".into(), "--print-config".into()];
    let mut command = Cli::command();
    let given = command.try_get_matches_from_mut(&bare).map_err(|e| e.to_string())?;
    let words = config::with_text(&command, &bare, &given, config)?;
    let matches = command.try_get_matches_from_mut(words).map_err(|e| e.to_string())?;
    Ok((command, matches))
}

/// The hash of the options of a plan, as they stand there now.
fn key_of_options(header: &Header) -> Result<String, Refused> {
    let (command, matches) = parsed(&header.config).map_err(|problem| (problem, 1))?;
    Ok(sha256_of(&config::effective(&command, &matches), &header.files))
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
    // a plan may have been written by anybody, and these name files to write
    let (mut command, alone) = parsed(text)?;
    if let Some(key) = RepairArgs::from_arg_matches(&alone).ok().as_ref().and_then(for_one_take) {
        return Err(format!("options of the batch: {key} is for single takes; plan again"));
    }
    let given = command.try_get_matches_from_mut(&words).map_err(|e| e.to_string())?;
    let words = config::with_text(&command, &words, &given, text)?;
    let matches = command.try_get_matches_from_mut(words).map_err(|e| e.to_string())?;
    let args = RepairArgs::from_arg_matches(&matches).map_err(|e| e.to_string())?;
    Ok(Request { config: config::effective(&command, &matches), ..args.request() })
}

pub(super) fn run_plan(args: &PlanArgs) -> Result<(u8, String), Refused> {
    let way = args.way.way()?;
    let (findings, sources) = {
        let _waiting = super::waiting("looking for takes and reading them", args.json);
        match &args.list {
            Some(list) => (find_listed(list).map_err(refused)?, vec![list.display().to_string()]),
            None => (find(&args.sources).map_err(refused)?, args.sources.iter().map(|source| settled(source)).collect()),
        }
    };
    let planned = plan(&findings, &sources, &way, &args.output, args.force).map_err(refused)?;
    let text = if args.json {
        told::plan_json(&planned, &findings, &args.output)
    } else {
        told::plan_text(&planned, &findings, &args.output, &Style::of_stdout())
    };
    let whole = planned.problems.is_empty() && planned.unread.is_empty() && findings.unreadable.is_empty();
    Ok((if whole { 0 } else { 3 }, text))
}

/// A source as it stands in a plan: folders with their full names.
fn settled(source: &str) -> String {
    if sources::is_address(source) {
        return source.to_owned();
    }
    sources::local(source).map_or_else(|_| source.to_owned(), |path| path.to_string_lossy().into_owned())
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

impl EngineArgs {
    fn engine(&self) -> Result<Box<dyn Engine>, Refused> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let jobs = self.jobs.map(|jobs| jobs as usize);
        let program = std::env::current_exe().map_err(|e| (format!("this program cannot be found: {e}"), 1))?;
        Ok(match self.engine {
            EngineArg::Local => Box::new(Local::new(program, jobs.unwrap_or(cores + 1), self.memory.unwrap_or_else(memory::available))),
            EngineArg::Ray => {
                let (python, address, memory_bytes) = (self.python.clone(), self.ray_address.clone(), self.memory);
                Box::new(Ray::start(&Wish { python, program, address, jobs, memory_bytes }).map_err(refused)?)
            }
        })
    }

    /// Runs what a supply has, tells whoever is to be told, and returns the exit code. `of`: what it is a run of.
    fn run(&self, header: &Header, out: &Place, of: &Of<'_>, supply: &mut dyn Supply, interrupt: &AtomicBool) -> Result<u8, Refused> {
        let session = Session::open(out, of.session, of.group).map_err(refused)?;
        if let Some((plan, sha256)) = of.plan {
            session::keep_plan(out, plan, sha256).map_err(refused)?;
        }
        let engine = {
            let _waiting = super::waiting("starting", self.json || self.quiet);
            self.engine()?
        };
        let begun = Begun {
            time: ledger::now(),
            host: session::host(),
            pid: std::process::id(),
            version: header.version.clone(),
            plan: of.plan.map(|(_, sha256)| sha256.to_owned()),
            shard: of.shard.index,
            shards: of.shard.count,
            engine: engine.name().to_owned(),
            jobs: engine.slots(),
            takes: header.takes,
            bytes: header.bytes,
        };
        let mut ledger = Ledger::begin(out, of.name, of.shard, begun).map_err(|e| refused(e.into()))?;
        let settings = Settings {
            header,
            out,
            work: format!("{}/{:04}", session.work, ledger.attempt),
            force: self.force,
            retry: self.retry,
            keep_going: self.keep_going,
            timeout: self.timeout,
            quarantined: session.quarantined.clone(),
            gone: &|| session.gone(out),
        };
        let (began, over) = (Instant::now(), AtomicBool::new(false));
        let tally = Tally::new(header.takes, header.bytes);
        let to_stderr = |line: &str| eprintln!("mocap-repair: {line}");
        let mut go = |watcher: &dyn Watcher| run(&settings, engine.as_ref(), supply, &mut ledger, watcher, interrupt);
        let ended = if self.json {
            go(&Json::new(tally, &super::print))
        } else if self.quiet {
            go(&Silent)
        } else if let Some(live) = Live::new(engine.slots(), tally.clone()) {
            std::thread::scope(|scope| {
                scope.spawn(|| live.draw_until(&|| over.load(Ordering::Relaxed), &|| interrupt.load(Ordering::Relaxed)));
                let _over = Over(&over);
                go(&live)
            })
        } else {
            go(&Plain::new(tally, &to_stderr))
        };
        drop((engine, settings));
        session.close(out);
        let (ended, why) = ended.map_err(refused)?;
        let code = exit_code(&ended, of.plan.is_none());
        if self.json {
            super::print(&told::run_json(&ended, &why, out.shown(), began.elapsed(), code));
        } else if !self.quiet {
            super::print(&told::run_text(&ended, &why, of.from, out.shown(), began.elapsed(), &Style::of_stdout()));
        } else if ended.stop != Stop::Complete && (of.plan.is_some() || ended.stop != Stop::Interrupted) {
            super::fail(&why, false);
        }
        Ok(code)
    }
}

/// Says when it is dropped, however that comes, that nothing more is to be drawn.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// What a run is a run of.
struct Of<'a> {
    /// What nobody else may do at the same time.
    session: &'a str,
    /// What others may do a part of at the same time.
    group: &'a str,
    /// What its ledgers are called by.
    name: &'a str,
    /// What people are told that it was made from.
    from: &'a str,
    plan: Option<(&'a Path, &'a str)>,
    shard: Shard,
}

pub(super) fn run_batch(args: &RunArgs, interrupt: &AtomicBool) -> Result<u8, Refused> {
    let shard = args.shard.unwrap_or(Shard::ALL);
    let out = place(&args.out)?;
    let (header, sha256, takes, bytes) = session::survey(&args.plan, shard, &out).map_err(refused)?;
    session::check(&args.plan, &header, &out).map_err(refused)?;
    for file in &header.files {
        file.check().map_err(|problem| (problem, 1))?;
    }
    if key_of_options(&header)? != header.config_sha256 {
        let problem = "its options are not those that its hash is of: it was changed; plan again";
        return Err((format!("{}: {problem}", args.plan.display()), 1));
    }
    let mut supply = FromPlan(Plan::open(&args.plan, shard).map_err(refused)?);
    let of = Of {
        session: &format!("{}-of-{}", shard.index, shard.count),
        group: &format!("{}-of-{}", &sha256[..8], shard.count),
        name: &sha256[..8],
        from: &args.plan.display().to_string(),
        plan: Some((&args.plan, &sha256)),
        shard,
    };
    args.engine.run(&Header { takes, bytes, ..header }, &out, &of, &mut supply, interrupt)
}

pub(super) fn run_watch(args: &WatchArgs, interrupt: &AtomicBool) -> Result<u8, Refused> {
    let way = args.way.way()?;
    let folder = sources::local(&args.folder).map_err(refused)?;
    if sources::is_address(&args.folder) || !folder.is_dir() {
        return Err((format!("{}: is no folder that can be watched", args.folder), 1));
    }
    let out = place(&args.out)?;
    let sources = vec![folder.to_string_lossy().into_owned()];
    session::check_sources(&sources, &out).map_err(refused)?;
    let (files, config_sha256) = way.settle().map_err(refused)?;
    let header = Header {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        config_sha256,
        files,
        config: way.config,
        wanted: way.wanted,
        sources,
        takes: 0,
        bytes: 0,
    };
    let mut supply = Watched::new(&folder, &out, args.settle, args.every, args.once).map_err(refused)?;
    let of = Of { session: "watch", group: "watch", name: "watch", from: &args.folder, plan: None, shard: Shard::ALL };
    let code = args.engine.run(&header, &out, &of, &mut supply, interrupt)?;
    Ok(if code == 0 && supply.is_troubled() { 3 } else { code })
}

pub(super) fn run_status(args: &StatusArgs) -> Result<u8, Refused> {
    let out = place(&args.out)?;
    let status = Status::read(&out).map_err(refused)?;
    super::print(&if args.json { status.json() } else { status.text(&out, &Style::of_stdout()) });
    Ok(status.exit_code())
}

pub(super) fn run_report(args: &FleetArgs) -> Result<u8, Refused> {
    let plans = match args.plan.as_deref() {
        None => Plans::Last,
        Some("all") => Plans::All,
        Some(sha256) => Plans::Of(sha256.to_owned()),
    };
    let collected = fleet::collect(&place(&args.out)?, &plans).map_err(refused)?;
    let written = fleet::write(collected.rows(), &collected.about, &args.output, args.force).map_err(refused)?;
    super::print(&format!("{} and {}: {}\n", written.html.display(), written.csv.display(), count(written.takes as usize, "take")));
    if let Some((sidecars, error)) = collected.unread() {
        super::fail(&format!("{error} ({} cannot be read; their numbers are missing)", count(sidecars, "sidecar")), false);
        return Ok(3);
    }
    Ok(0)
}

/// `endless`: somebody has to end it at some time, which is as it should be.
fn exit_code(ended: &ledger::Ended, endless: bool) -> u8 {
    match ended.stop {
        Stop::Interrupted if endless => exit_code(&ledger::Ended { stop: Stop::Complete, ..ended.clone() }, false),
        // somebody has to do something about them first
        Stop::Complete if ended.failed > 0 => 1,
        Stop::Complete if ended.remarked + ended.quarantined + ended.failed > 0 => 3,
        Stop::Complete => 0,
        Stop::Interrupted | Stop::DiskFull | Stop::Engine => 75,
        Stop::TooManyFailures => 1,
    }
}

/// The output folder by its full name, since processes may run elsewhere; or the bucket.
fn place(out: &str) -> Result<Place, Refused> {
    let name = if sources::is_address(out) {
        out.to_owned()
    } else {
        let path = sources::local(out).map_err(refused)?;
        path.to_str().map(str::to_owned).ok_or_else(|| (format!("{out}: its name is not UTF-8 text; choose another --out"), 1))?
    };
    Place::parse(&name).map_err(|e| refused(e.into()))
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
    if let Some(most) = job.memory_bytes {
        std::thread::spawn(move || stay_below(most));
    }
    let _ = rayon::ThreadPoolBuilder::new().num_threads(job.threads.max(1)).build_global(); // only ever asked here
    let result = take::run(&job, &request_of, &mut Phases);
    let code = result.outcome.exit_code(result.exit_code);
    super::print(&crate::report::lines(&[Said::Result(result)]));
    code
}

/// Ends the process when it takes more memory than it may, before the system ends somebody.
fn stay_below(most: u64) {
    while let Some(bytes) = memory::taken() {
        if bytes > most {
            let reason = format!("took more than {}, which is what it may take; see --memory", told::size(most));
            let result = TakeResult { peak_bytes: Some(bytes), ..TakeResult::refused(Verdict::OutOfMemory, reason) };
            let code = result.outcome.exit_code(None);
            super::print(&crate::report::lines(&[Said::Result(result)]));
            std::process::exit(code.into());
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
}

/// Says what is being done.
struct Phases;

impl Observer for Phases {
    fn phase(&mut self, doing: &str) {
        super::print(&crate::report::lines(&[Said::Phase { text: doing.to_owned() }]));
    }
}
