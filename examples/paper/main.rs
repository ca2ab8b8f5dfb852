//! The experiment of the BoLeRO paper with the methods of this crate: Eq. 13 over its 90 trials and its two worked examples.
//!
//! `cargo run --release --example paper -- --help`; `docs/paper.md` says what it shows.
//! The motions are not part of this repository: `cases` looks for them.
//!
//! - `cases`: what is hidden where
//! - `trial`: hide, fill, compare
//! - `example`: the bones of the worked examples
//! - `table`, `scatter`, `lengths`: what is shown, with `svg` for the pictures

mod cases;
mod example;
mod lengths;
mod scatter;
mod svg;
mod table;
mod trial;

use cases::{Case, Kind};
use clap::Parser;
use example::Example;
use indicatif::{ProgressBar, ProgressStyle};
use mocap_repair::solve::Method;
use rayon::prelude::*;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use trial::{Trial, attempt};

/// Where the tables of the document begin and end.
const TABLES: [&str; 2] = ["<!-- tables -->\n", "<!-- /tables -->"];

/// Runs the experiment of the BoLeRO paper: prints its tables as Markdown, writes its pictures as SVG.
#[derive(Parser)]
struct Args {
    /// Methods to compare [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = method)]
    methods: Vec<Method>,
    /// Motions to look at [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    motions: Vec<String>,
    /// At most so many trials of each motion; worked examples run anyway
    #[arg(long, value_name = "N", default_value_t = 10)]
    trials: usize,
    /// Folder for the pictures; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "docs/paper")]
    out: PathBuf,
    /// Replace the tables of this document, too; for the whole experiment only
    #[arg(long, value_name = "FILE.md", conflicts_with_all = ["methods", "motions", "trials"])]
    doc: Option<PathBuf>,
}

fn method(text: &str) -> Result<Method, String> {
    Method::parse(text).ok_or_else(|| format!("expected one of: {}", Method::ALL.map(Method::name).join(", ")))
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            let _ = writeln!(std::io::stderr(), "paper: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<(), String> {
    let methods = if args.methods.is_empty() { Method::ALL.to_vec() } else { args.methods.clone() };
    // a document without its markers should not be found out after minutes
    let document = args.doc.as_deref().map(|path| Ok::<_, String>((path, read(path)?))).transpose()?;
    if let Some((path, text)) = &document {
        replace(text, "").map_err(|problem| format!("{}: {problem}", path.display()))?;
    }
    let (cases, takes) = cases::load(&args.motions, args.trials)?;
    let bar = ProgressBar::new(cases.len() as u64).with_style(
        ProgressStyle::with_template("{pos} of {len} cases, {elapsed} {wide_bar}").map_err(|error| format!("progress bar: {error}"))?,
    );
    let one = |case: &Case| {
        let take = takes.get(&case.motion).ok_or_else(|| format!("{}: no such motion was read", case.motion))?;
        let trial = attempt(case, take, &methods);
        bar.inc(1);
        trial
    };
    // the longest motions first, so that no core ends up alone with one of them
    let mut order: Vec<&Case> = cases.iter().collect();
    order.sort_by_key(|case| std::cmp::Reverse(takes.get(&case.motion).map_or(0, formats::Take::frames)));
    let mut trials: Vec<Trial> = order.into_par_iter().map(one).collect::<Vec<_>>().into_iter().collect::<Result<_, String>>()?;
    bar.finish_and_clear();
    trials.sort_by_key(|trial| cases.iter().position(|case| *case == trial.case));
    let (examples, trials): (Vec<Trial>, Vec<Trial>) = trials.into_iter().partition(|trial| trial.case.kind == Kind::Paper);
    let examples: Vec<Example<'_>> =
        examples.iter().filter_map(|trial| Some(Example::new(trial, takes.get(&trial.case.motion)?))).collect::<Result<_, _>>()?;

    let tables = table::tables(&trials, &examples, &takes, &methods);
    std::fs::create_dir_all(&args.out).map_err(|error| format!("{}: {error}", args.out.display()))?;
    if let Some(picture) = scatter::scatter(&trials, &methods) {
        write(&args.out.join("scatter.svg"), &picture)?;
    }
    for example in &examples {
        write(&args.out.join(format!("{}.svg", example.trial.case.motion)), &lengths::lengths(example))?;
    }
    if let Some((path, text)) = document {
        write(path, &replace(&text, &tables)?)?;
    }
    std::io::stdout().write_all(tables.as_bytes()).map_err(|error| format!("standard output: {error}"))
}

/// The document with other tables between its markers.
fn replace(document: &str, tables: &str) -> Result<String, String> {
    let [begin, end] = TABLES;
    let found = document.split_once(begin).and_then(|(before, rest)| Some((before, rest.split_once(end)?.1)));
    let (before, after) =
        found.ok_or_else(|| format!("expected a line {} and after it a line {end} to put the tables between", begin.trim_end()))?;
    Ok(format!("{before}{begin}\n{tables}\n{end}{after}"))
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        use clap::CommandFactory as _;
        Args::command().debug_assert();
        assert!(Args::try_parse_from(["paper", "--doc", "docs/paper.md"]).is_ok());
        assert!(Args::try_parse_from(["paper", "--doc", "docs/paper.md", "--trials", "1"]).is_err(), "part of it is not the experiment");
    }

    #[test]
    fn tables_replace_tables() {
        let document = "before\n\n<!-- tables -->\nold\n<!-- /tables -->\n\nafter\n";
        let written = replace(document, "new\n");
        assert_eq!(written.as_deref(), Ok("before\n\n<!-- tables -->\n\nnew\n\n<!-- /tables -->\n\nafter\n"));
        assert_eq!(replace(&written.clone().unwrap_or_default(), "new\n"), written);
        assert!(replace("before\n<!-- tables -->\n", "new\n").is_err_and(|problem| problem.contains("<!-- /tables -->")));
    }
}
