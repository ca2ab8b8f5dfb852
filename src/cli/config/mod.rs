//! Options from a file: `--config FILE.toml`, and what holds in the end: `--print-config`.
//!
//! Keys are the long names of options. The definitions of the command line say all that is to be known here: which options there are, of which
//! type, with which help and which default. So an option that is added there is one here, too, and nothing is listed twice.
//! A file becomes words of a command line that stand before those that were typed; whatever was typed overrules it.

#[cfg(test)]
mod tests;

use super::args::names_file;
use crate::input;
use crate::typeset::wrap;
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command};
use std::any::TypeId;
use std::ffi::{OsStr, OsString};
use std::fmt::Write;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use toml_writer::ToTomlValue;

/// Options that say which take a run is about, or where its options are: these are typed.
const TYPED: [&str; 7] = ["output", "in-place", "config", "print-config", "unset", "help", "version"];

/// Options that say where and how is told what was done, and not what is done. They are not part of [`effective`].
const TELLING: [&str; 9] = ["fills", "log", "no-log", "report", "force", "dry-run", "explain", "json", "quiet"];

/// Names that are at least this alike may be meant (Jaro and Winkler).
const ALIKE: f64 = 0.75;

/// What can be said about an option.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Switch,
    Integer,
    Number,
    Text,
}

/// What a file says about an option.
#[derive(Debug)]
struct Said {
    key: String,
    /// Counted from 1.
    line: usize,
    /// One for each time that it is said; none for a switch.
    values: Vec<OsString>,
}

/// True for an option that a file can hold.
fn in_file(arg: &Arg) -> bool {
    arg.get_long().is_some_and(|long| !TYPED.contains(&long)) && kind(arg).is_some()
}

/// The options that a file can hold, in the order of the help text.
fn options(command: &Command) -> impl Iterator<Item = (&str, &Arg)> {
    command.get_arguments().filter(|arg| in_file(arg)).filter_map(|arg| Some((arg.get_long()?, arg)))
}

fn kind(arg: &Arg) -> Option<Kind> {
    match arg.get_action() {
        ArgAction::SetTrue => return Some(Kind::Switch),
        ArgAction::Set | ArgAction::Append => {}
        _ => return None,
    }
    let of = arg.get_value_parser().type_id();
    let integers = [TypeId::of::<u8>(), TypeId::of::<u16>(), TypeId::of::<u32>(), TypeId::of::<u64>(), TypeId::of::<usize>()];
    let signed = [TypeId::of::<i8>(), TypeId::of::<i16>(), TypeId::of::<i32>(), TypeId::of::<i64>(), TypeId::of::<isize>()];
    Some(if integers.iter().chain(&signed).any(|id| of == *id) {
        Kind::Integer
    } else if [TypeId::of::<f32>(), TypeId::of::<f64>()].iter().any(|id| of == *id) {
        Kind::Number
    } else {
        Kind::Text
    })
}

/// True if the option may be said more than once.
fn is_list(arg: &Arg) -> bool {
    matches!(arg.get_action(), ArgAction::Append) || arg.get_value_delimiter().is_some()
}

/// The options that cannot be said together with this one.
fn enemies<'a>(command: &'a Command, arg: &'a Arg) -> Vec<&'a str> {
    let named = command.get_arg_conflicts_with(arg).into_iter();
    let naming = command.get_arguments().filter(|other| command.get_arg_conflicts_with(other).iter().any(|a| a.get_id() == arg.get_id()));
    named.chain(naming).map(|a| a.get_id().as_str()).collect()
}

/// True if the option was typed.
fn typed(matches: &ArgMatches, arg: &str) -> bool {
    matches.value_source(arg) == Some(ValueSource::CommandLine)
}

/// The words that were typed, `words`, with those of the file `path` before them. `command` is built; `given` is what it made of the words.
///
/// # Errors
/// The file cannot be read, or says something that is no option or no value of it. The text names the file, the line and the key.
pub(super) fn with_file(command: &Command, words: &[OsString], given: &ArgMatches, path: &Path) -> Result<Vec<OsString>, String> {
    let unset: Vec<&String> = given.get_many("unset").unwrap_or_default().collect();
    for key in &unset {
        if !options(command).any(|(known, _)| known == key.as_str()) {
            return Err(format!("--unset {key}: {}", stranger(command, key)));
        }
    }
    let bytes = input::read(path).map_err(|error| error.to_string())?;
    let text = std::str::from_utf8(&bytes).map_err(|_| format!("{}: is not UTF-8 text, as TOML has to be", path.display()))?;
    merged(command, words, given, path, text)
}

/// The same for options that were [settled](settled) before: `text` is what they were settled to.
///
/// # Errors
/// It holds what is no option, or no value of one.
pub(super) fn with_text(command: &Command, words: &[OsString], given: &ArgMatches, text: &str) -> Result<Vec<OsString>, String> {
    merged(command, words, given, Path::new("options of the batch"), text)
}

/// The same, where `text` is what the file holds.
fn merged(command: &Command, words: &[OsString], given: &ArgMatches, path: &Path, text: &str) -> Result<Vec<OsString>, String> {
    let unset: Vec<&String> = given.get_many("unset").unwrap_or_default().collect();
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut kept: Vec<(Said, &Arg)> = Vec::new();
    for said in parse(command, text, folder).map_err(|(line, problem)| format!("{}: line {line}: {problem}", path.display()))? {
        let Some((_, arg)) = options(command).find(|(key, _)| *key == said.key) else { continue };
        let overruled = typed(given, arg.get_id().as_str()) || enemies(command, arg).iter().any(|enemy| typed(given, enemy));
        if !overruled && !unset.iter().any(|key| **key == said.key) {
            kept.push((said, arg));
        }
    }
    for (at, (said, arg)) in kept.iter().enumerate() {
        let enemies = enemies(command, arg);
        if let Some((other, _)) = kept[..at].iter().find(|(_, other)| enemies.contains(&other.get_id().as_str())) {
            let (line, key) = (said.line, &said.key);
            return Err(format!("{}: line {line}: {key} cannot be said together with {} (line {})", path.display(), other.key, other.line));
        }
    }
    let (program, rest) = words.split_first().map_or((OsString::new(), words), |(program, rest)| (program.clone(), rest));
    let mut all = vec![program];
    for (said, _) in kept {
        all.extend(words_of(&said));
    }
    all.extend(rest.iter().cloned());
    Ok(all)
}

/// What one would have typed.
fn words_of(said: &Said) -> Vec<OsString> {
    let word = |value: Option<&OsString>| {
        let mut word = OsString::from(format!("--{}", said.key));
        if let Some(value) = value {
            word.push("=");
            word.push(value);
        }
        word
    };
    if said.values.is_empty() { vec![word(None)] } else { said.values.iter().map(|value| word(Some(value))).collect() }
}

/// What a file says, top to bottom; switches that are off and empty lists say nothing. An error is a line and a problem.
fn parse(command: &Command, text: &str, folder: &Path) -> Result<Vec<Said>, (usize, String)> {
    let line = |offset: usize| text.as_bytes().iter().take(offset).filter(|&&b| b == b'\n').count() + 1;
    let table = DeTable::parse(text).map_err(|error| {
        let problem = error.message().lines().collect::<Vec<_>>().join(", ");
        (line(error.span().map_or(0, |span| span.start)), format!("not TOML: {problem}"))
    })?;
    let mut entries: Vec<_> = table.get_ref().iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    let mut all = Vec::new();
    for (key, value) in entries {
        let (at, name) = (line(key.span().start), key.get_ref().as_ref());
        let arg = options(command).find(|(known, _)| *known == name).map(|(_, arg)| arg);
        let arg = arg.ok_or_else(|| (at, stranger(command, name)))?;
        let wrong = |expected: String| {
            let there = text.get(value.span()).unwrap_or_default().lines().next().unwrap_or_default();
            (at, format!("{name} = {there}: expected {expected}"))
        };
        let values = match (kind(arg), value.get_ref()) {
            (Some(Kind::Switch), DeValue::Boolean(true)) => Vec::new(),
            (Some(Kind::Switch), DeValue::Boolean(false)) | (None, _) => continue,
            (Some(Kind::Switch), _) => return Err(wrong("true or false".to_owned())),
            (Some(kind), DeValue::Array(values)) if is_list(arg) => {
                let words: Option<Vec<String>> = values.iter().map(|value| word(kind, value)).collect();
                words.ok_or_else(|| wrong(format!("an array of {}s", expected(kind))))?
            }
            (Some(kind), _) => {
                let array = if is_list(arg) { format!(", or an array of {}s", expected(kind)) } else { String::new() };
                vec![word(kind, value).ok_or_else(|| wrong(format!("{}{array}", article(expected(kind)))))?]
            }
        };
        let is_switch = kind(arg) == Some(Kind::Switch);
        if values.is_empty() && !is_switch {
            continue;
        }
        for value in &values {
            refused(command, name, value).map_or(Ok(()), |reason| Err((at, format!("{name} = {}: {reason}", quoted(arg, value)))))?;
        }
        let placed = |value: String| if names_file(arg, &value, folder) { folder.join(value).into() } else { value.into() };
        all.push(Said { key: name.to_owned(), line: at, values: values.into_iter().map(placed).collect() });
    }
    Ok(all)
}

/// A value as one would type it; `None` if it is of another type.
fn word(kind: Kind, value: &Spanned<DeValue<'_>>) -> Option<String> {
    match (kind, value.get_ref()) {
        // beyond what TOML promises: whole numbers up to those of the options
        (Kind::Integer | Kind::Number, DeValue::Integer(whole)) => {
            i128::from_str_radix(whole.as_str(), whole.radix()).ok().map(|n| n.to_string())
        }
        (Kind::Number, DeValue::Float(float)) => Some(float.as_str().replace('_', "")),
        (Kind::Text, DeValue::String(text)) => Some(text.to_string()),
        _ => None,
    }
}

fn expected(kind: Kind) -> &'static str {
    match kind {
        Kind::Switch => "switch",
        Kind::Integer => "whole number",
        Kind::Number => "number",
        Kind::Text => "text in quotes",
    }
}

fn article(noun: &str) -> String {
    if noun.starts_with("text") { noun.to_owned() } else { format!("a {noun}") }
}

/// A value as TOML has it.
fn quoted(arg: &Arg, value: &str) -> String {
    if kind(arg) == Some(Kind::Text) { value.to_toml_value() } else { value.to_owned() }
}

/// Why an option does not take a value, in the option's own words.
fn refused(command: &Command, key: &str, value: &str) -> Option<String> {
    let words = [command.get_name().to_owned(), format!("--{key}={value}")];
    let error = command.clone().try_get_matches_from(words).err()?;
    match error.kind() {
        ErrorKind::InvalidValue | ErrorKind::ValueValidation | ErrorKind::WrongNumberOfValues | ErrorKind::NoEquals => {}
        _ => return None, // the rest of a command line is not there, and need not be
    }
    let (_, arg) = options(command).find(|(known, _)| *known == key)?;
    let possible: Vec<String> = arg.get_possible_values().iter().map(|value| value.get_name().to_owned()).collect();
    if !possible.is_empty() {
        return Some(format!("expected one of: {}{}", possible.join(", "), nearest(value, possible.iter().map(String::as_str))));
    }
    if kind(arg) == Some(Kind::Integer) && value.starts_with('-') {
        return Some("expected a whole number that is not negative".to_owned());
    }
    Some(std::error::Error::source(&error).map_or_else(|| "is no value of this option".to_owned(), ToString::to_string))
}

/// What to say about a key that is none.
fn stranger(command: &Command, key: &str) -> String {
    if TYPED.contains(&key) {
        return format!("{key} is said on the command line, for each take, not in a configuration");
    }
    let dashed = key.trim_start_matches('-').replace('_', "-");
    let hint = nearest(&dashed, options(command).map(|(known, _)| known));
    let end = if hint.is_empty() { "; --print-config shows all there are" } else { "" };
    format!("there is no option \"{key}\"{hint}{end}")
}

/// A question for whoever may have meant another name.
fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    let alike = known.map(|known| (strsim::jaro_winkler(name, known), known)).filter(|(alike, _)| *alike >= ALIKE);
    let best = alike.reduce(|best, other| if other.0 > best.0 { other } else { best });
    best.map(|(_, known)| format!("; did you mean {known}?")).unwrap_or_default()
}

/// An option with what holds for it.
struct Entry<'a> {
    key: &'a str,
    arg: &'a Arg,
    /// As TOML; `None` if nothing is said and there is no default.
    value: Option<String>,
    /// It is the default of an option that cannot be said together with one that was said.
    idle: bool,
}

/// `bare`: files are named without their folders.
fn entries<'a>(command: &'a Command, matches: &ArgMatches, bare: bool) -> Vec<Entry<'a>> {
    options(command)
        .map(|(key, arg)| {
            let id = arg.get_id().as_str();
            let idle = !typed(matches, id) && enemies(command, arg).iter().any(|enemy| typed(matches, enemy));
            let value = if kind(arg) == Some(Kind::Switch) {
                Some(matches.get_flag(id).to_string())
            } else {
                matches.get_raw(id).map(|raw| {
                    let word = |value: &OsStr| match Path::new(value).file_name() {
                        Some(name) if bare && names_file(arg, &value.to_string_lossy(), Path::new("")) => {
                            name.to_string_lossy().into_owned()
                        }
                        _ => value.to_string_lossy().into_owned(),
                    };
                    let values: Vec<String> = raw.map(|value| toml_value(arg, &word(value))).collect();
                    if is_list(arg) { format!("[{}]", values.join(", ")) } else { values.concat() }
                })
            };
            Entry { key, arg, value, idle }
        })
        .collect()
}

/// A word of the command line as TOML: numbers in one form, however they were typed.
fn toml_value(arg: &Arg, word: &str) -> String {
    match kind(arg) {
        Some(Kind::Integer) => word.parse::<i128>().map_or_else(|_| quoted(arg, word), |n| n.to_string()),
        Some(Kind::Number) => word.parse::<f64>().map_or_else(|_| quoted(arg, word), |x| x.to_toml_value()),
        _ => quoted(arg, word),
    }
}

/// The options that shape the result, those that nobody said included, as TOML without comments: the same options give the same text.
/// It says nothing about names of files that are written, nor about how is told what was done, and names files that are read without folders.
pub(super) fn effective(command: &Command, matches: &ArgMatches) -> String {
    shaping(command, matches, true)
}

/// The same with full names of files, if options came from a file with a full name: what [`with_text`] reads.
pub(super) fn settled(command: &Command, matches: &ArgMatches) -> String {
    shaping(command, matches, false)
}

fn shaping(command: &Command, matches: &ArgMatches, bare: bool) -> String {
    let mut out = String::new();
    for entry in entries(command, matches, bare).iter().filter(|entry| !entry.idle && !TELLING.contains(&entry.key)) {
        if let Some(value) = &entry.value {
            let _ = writeln!(out, "{} = {value}", entry.key); // a String takes everything
        }
    }
    out
}

/// All options with their help, as a file for `--config` that says what holds now.
pub(super) fn commented(command: &Command, matches: &ArgMatches) -> String {
    let mut out = format!(
        "# Options of {} {}, as a file for --config.\n# What is typed overrules it; --unset KEY takes a line back for one run.\n\
         # Files are looked for from the folder of this file.\n",
        command.get_name(),
        command.get_version().unwrap_or_default()
    );
    for Entry { key, arg, value, idle } in entries(command, matches, false) {
        let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
        let possible: Vec<String> = arg.get_possible_values().iter().map(|value| value.get_name().to_owned()).collect();
        let one_of = if possible.is_empty() || kind(arg) == Some(Kind::Switch) {
            String::new()
        } else {
            format!("; one of: {}", possible.join(", "))
        };
        out.push('\n');
        for line in wrap(&(help + &one_of).replace('\n', " "), 78) {
            let _ = writeln!(out, "# {line}");
        }
        let names: Vec<&str> = arg.get_value_names().unwrap_or_default().iter().map(clap::builder::Str::as_str).collect();
        let _ = match value {
            Some(value) if !idle => writeln!(out, "{key} = {value}"),
            Some(value) => writeln!(out, "# {key} = {value}"),
            None => {
                let name = format!("<{}>", names.join(" "));
                let name = if kind(arg) == Some(Kind::Text) { format!("\"{name}\"") } else { name };
                writeln!(out, "# {key} = {}", if is_list(arg) { format!("[{name}]") } else { name })
            }
        };
    }
    out
}
