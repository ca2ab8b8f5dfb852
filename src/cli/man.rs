//! The manual pages: the help text as troff, with exit codes and examples in sections of their own.

use crate::input::plain;
use crate::repair::RepairError;
use crate::staging;
use clap::Command;
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// What one may want to do, and what to type.
const EXAMPLES: [(&str, &str); 9] = [
    ("Fill the gaps of a take; the log is written beside it, as walk.mcap.", "mocap-repair walk-gaps.c3d -o walk.c3d"),
    ("See first what is missing where.", "mocap-repair inspect walk-gaps.c3d"),
    (
        "Leave gaps of more than 120 frames open, and fills that may be off by more than 20 mm.",
        "mocap-repair in.c3d -o out.c3d --max-gap 120 --max-sigma 20",
    ),
    ("Keep the bones of a file, exactly.", "mocap-repair in.c3d -o out.c3d --bones bones.csv --bones hard"),
    ("Know every filled sample, and how sure it is.", "mocap-repair in.trc -o out.trc --fills fills.csv"),
    ("Keep the options of a laboratory in a file.", "mocap-repair --max-gap 120 --print-config > lab.toml"),
    ("Use them, but for one.", "mocap-repair in.c3d -o out.c3d --config lab.toml --unset max-gap"),
    ("Write a take in another format.", "mocap-repair convert in.c3d -o out.trc --units m"),
    (
        "Repair all takes of a folder; the second command goes on after whatever happened to it.",
        "mocap-repair batch plan takes -o plan.jsonl; mocap-repair batch run plan.jsonl --out repaired",
    ),
];

/// The pages by file name: that of the program, then those of its subcommands.
///
/// # Errors
/// None that memory can give.
pub(super) fn pages(command: &Command) -> io::Result<Vec<(String, Vec<u8>)>> {
    let mut command = command.clone().disable_help_subcommand(true);
    command.build();
    let mut pages = vec![page(&command, true)?];
    for sub in command.get_subcommands().filter(|sub| !sub.is_hide_set()) {
        pages.push(page(sub, false)?);
        for below in sub.get_subcommands().filter(|below| !below.is_hide_set()) {
            pages.push(page(below, false)?);
        }
    }
    Ok(pages)
}

fn page(command: &Command, whole: bool) -> io::Result<(String, Vec<u8>)> {
    let source = format!("mocap-repair {}", env!("CARGO_PKG_VERSION"));
    let man = Man::new(command.clone()).source(source).manual("User Commands");
    let mut out = Vec::new();
    man.render_title(&mut out)?;
    man.render_name_section(&mut out)?;
    synopsis(command).to_writer(&mut out)?;
    man.render_description_section(&mut out)?;
    man.render_options_section(&mut out)?;
    if command.has_subcommands() {
        man.render_subcommands_section(&mut out)?;
    }
    let codes = exit_codes(&command.get_after_help().map(ToString::to_string).unwrap_or_default());
    let mut more = Roff::new();
    if !codes.is_empty() {
        more.control("SH", ["EXIT STATUS"]);
        for (code, meaning) in codes {
            more.control("TP", []).text([bold(code)]).text([roman(meaning)]);
        }
    }
    if whole {
        more.control("SH", ["EXAMPLES"]);
        for (what, words) in EXAMPLES {
            more.control("PP", []).text([roman(what)]).control("PP", []).control("RS", ["4"]).text([bold(words)]).control("RE", []);
        }
    }
    more.to_writer(&mut out)?;
    Ok((man.get_filename(), out))
}

/// What is typed at least, as the help text has it: with so many options the whole would tell nothing.
fn synopsis(command: &Command) -> Roff {
    let usage = command.clone().render_usage().to_string();
    let mut roff = Roff::new();
    roff.control("SH", ["SYNOPSIS"]);
    for (at, line) in usage.trim_start_matches("Usage:").lines().enumerate() {
        if at > 0 {
            roff.control("br", []);
        }
        roff.text([roman(line.trim())]);
    }
    roff
}

/// The table of a help text: lines of a number and its meaning, which may go on in the next line.
fn exit_codes(help: &str) -> Vec<(String, String)> {
    let mut codes: Vec<(String, String)> = Vec::new();
    for line in help.lines().filter(|line| line.starts_with("  ")) {
        match line.trim().split_once("  ") {
            Some((code, meaning)) if code.parse::<u8>().is_ok() => codes.push((code.to_owned(), meaning.to_owned())),
            _ => codes.iter_mut().last().into_iter().for_each(|(_, meaning)| *meaning = format!("{meaning} {}", line.trim())),
        }
    }
    codes
}

/// Writes all pages into `folder`, which is made if it is not there. Returns their names.
///
/// # Errors
/// A page exists and `force` is false, or the folder cannot be written to.
pub(super) fn write(command: &Command, folder: &Path, force: bool) -> Result<Vec<PathBuf>, RepairError> {
    let wrong = |path: &Path, problem: String| RepairError::Io { path: path.to_owned(), problem };
    let unwritable = |path: &Path, error: io::Error| wrong(path, format!("cannot be written: {}", plain(&error)));
    std::fs::create_dir_all(folder).map_err(|e| wrong(folder, format!("cannot be made: {}", plain(&e))))?;
    let pages = pages(command).map_err(|e| unwritable(folder, e))?;
    let pages: Vec<(PathBuf, Vec<u8>)> = pages.into_iter().map(|(name, page)| (folder.join(name), page)).collect();
    if let Some((path, _)) = pages.iter().find(|(path, _)| path.exists() && !force) {
        return Err(wrong(path, "exists already; give another folder, or say --force to replace it".to_owned()));
    }
    for (path, page) in &pages {
        let mut file = staging::beside(path).map_err(|e| unwritable(path, e))?;
        file.write_all(page).map_err(|e| unwritable(path, e))?;
        staging::publish(file, path).map_err(|e| unwritable(path, e))?;
    }
    Ok(pages.into_iter().map(|(path, _)| path).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use clap::{CommandFactory, Parser};

    #[test]
    fn examples_can_be_typed() {
        for (_, words) in EXAMPLES {
            for words in words.split("; ") {
                let words = words.split(" > ").next().unwrap_or_default().split(' ');
                assert!(Cli::try_parse_from(words.clone()).is_ok(), "{words:?}: {:?}", Cli::try_parse_from(words.clone()).err());
            }
        }
    }

    #[test]
    fn every_subcommand_has_a_page() {
        let pages = pages(&Cli::command()).unwrap_or_default();
        let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
        let command = Cli::command();
        let below: usize = command.get_subcommands().map(|sub| sub.get_subcommands().filter(|below| !below.is_hide_set()).count()).sum();
        assert_eq!(names.len(), 1 + command.get_subcommands().count() + below);
        assert_eq!(&names[..2], ["mocap-repair.1", "mocap-repair-inspect.1"]);
        let main = String::from_utf8_lossy(&pages[0].1);
        assert!(main.contains("\n.SH \"EXIT STATUS\"\n") && main.contains("\n.SH EXAMPLES\n"), "{main}");
        assert!(pages.iter().all(|(_, page)| !String::from_utf8_lossy(page).contains("Exit codes")));
    }

    #[test]
    fn exit_codes_are_read_from_the_help() {
        let codes = exit_codes("Exit codes:\n  0  fine\n  3  look at it:\n     something was lost");
        assert_eq!(codes, [("0", "fine"), ("3", "look at it: something was lost")].map(|(a, b)| (a.to_owned(), b.to_owned())));
    }
}
