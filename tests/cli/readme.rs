//! The commands of the README and of docs/usage.md are run as they stand there, one after the other, and print what is said there.

use crate::lab::{Lab, PROGRAM};
use std::path::Path;
use std::process::{Command, Stdio};

/// A line of the README that is to be typed.
struct Typed {
    line: usize,
    commands: Vec<String>,
    /// What the README shows under it; empty if nothing.
    output: String,
}

/// Takes the commands from the blocks marked `sh` (each line is one) and `console` (those after `$ `; the rest is output).
/// A `\` at the end of a line joins the next one, and ` # ` begins a comment.
fn typed(markdown: &str) -> Vec<Typed> {
    let mut found: Vec<Typed> = Vec::new();
    let mut block: Option<&str> = None;
    let mut joined = String::new();
    for (at, line) in markdown.lines().enumerate() {
        if let Some(fence) = line.trim_start().strip_prefix("```") {
            block = if block.is_some() { None } else { Some(fence.trim()) };
            continue;
        }
        let command = match block {
            Some("sh") if !line.trim().is_empty() && !line.starts_with('#') => Some(line),
            Some("console") if !joined.is_empty() => Some(line),
            Some("console") => line.strip_prefix("$ "),
            _ => None,
        };
        if let Some(command) = command {
            if let Some(start) = command.strip_suffix('\\') {
                joined.push_str(start);
                continue;
            }
            let whole = std::mem::take(&mut joined) + command;
            let whole = whole.split(" # ").next().unwrap_or_default();
            found.push(Typed { line: at + 1, commands: whole.split("&&").map(|c| c.trim().to_owned()).collect(), output: String::new() });
        } else if let (Some("console"), Some(last)) = (block, found.last_mut()) {
            last.output.push_str(line);
            last.output.push('\n');
        }
    }
    found
}

/// The command as it can be run here: without building once more. `None` for commands that are not ours.
fn ours(command: &str) -> Option<String> {
    let rest = command.strip_prefix("cargo run --release -- ").or_else(|| command.strip_prefix("mocap-repair "))?;
    Some(format!("\"$PROGRAM\" {rest}"))
}

/// True if `shown` is `printed`, where a line `...` stands for any lines.
fn shows(shown: &str, printed: &str) -> bool {
    fn fits(shown: &[&str], printed: &[&str]) -> bool {
        match shown.split_first() {
            None => printed.is_empty(),
            Some((&"...", rest)) => (0..=printed.len()).any(|from| fits(rest, &printed[from..])),
            Some((line, rest)) => printed.first() == Some(line) && fits(rest, &printed[1..]),
        }
    }
    let [shown, printed] = [shown, printed].map(|text| text.trim_end().lines().map(str::trim_end).collect::<Vec<_>>());
    fits(&shown, &printed)
}

/// Runs all commands of a document in an empty folder and returns how many there were.
#[track_caller]
fn run_all(document: &str) -> usize {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(document);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let lab = Lab::empty();
    let mut ran = 0;
    for typed in typed(&text) {
        let mut printed = String::new();
        let last = typed.commands.len() - 1;
        for (at, command) in typed.commands.iter().enumerate() {
            let Some(shell) = ours(command) else { continue };
            let mut run = Command::new("sh");
            run.args(["-c", &shell]).env("PROGRAM", PROGRAM).env("COLUMNS", "100").current_dir(lab.folder()).stdin(Stdio::null());
            let output = run.output().unwrap();
            let told = String::from_utf8_lossy(&output.stderr);
            let code = output.status.code();
            assert!(code == Some(0) || at == last && code == Some(3), "{document}:{}: {command}: {code:?}\n{told}", typed.line);
            printed.push_str(&String::from_utf8(output.stdout).unwrap());
            ran += 1;
        }
        let known = typed.output.trim().is_empty() || printed.is_empty() || shows(&typed.output, &printed);
        assert!(known, "{document}:{}: shows\n{}\nbut it prints\n{printed}", typed.line, typed.output);
    }
    ran
}

#[test]
fn every_command_of_the_readme_works() {
    let ran = run_all("README.md");
    assert!(ran >= 2, "README.md has {ran} commands of ours in blocks marked sh or console");
}

/// The whole command line stands in docs/usage.md; `just usage` writes it there.
#[test]
fn the_usage_is_what_the_program_says() {
    let ran = run_all("docs/usage.md");
    let help = |arguments: &[&str]| Lab::empty().run(arguments).with_code(0).out;
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/usage.md")).unwrap();
    let listed = help(&["--help"]);
    let commands: Vec<&str> = listed
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| line.starts_with("  "))
        .filter(|line| !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .collect();
    assert!(commands.len() >= 6 && ran > commands.len(), "{commands:?}");
    for command in commands {
        assert!(text.contains(&format!("$ mocap-repair {command} --help\n")), "docs/usage.md does not show mocap-repair {command} --help");
    }
}

#[test]
fn commands_are_found_in_both_kinds_of_blocks() {
    let found = typed(
        "text\n```sh\ncargo run --release -- demo -o d && cargo test\n# comment\na \\\n  b # why\n```\n```console\n$ c d\nout\n$ e\n```\n```json\n$ no\n```\n",
    );
    let seen: Vec<(Vec<&str>, &str)> = found.iter().map(|t| (t.commands.iter().map(String::as_str).collect(), t.output.as_str())).collect();
    assert_eq!(
        seen,
        [(vec!["cargo run --release -- demo -o d", "cargo test"], ""), (vec!["a   b"], ""), (vec!["c d"], "out\n"), (vec!["e"], "")]
    );
    assert_eq!(ours("cargo run --release -- demo").as_deref(), Some("\"$PROGRAM\" demo"));
    assert_eq!(ours("cargo test --workspace"), None);
    for (shown, printed, same) in [
        ("a\nb\n", "a\nb\n", true),
        ("a\n", "a\nb\n", false),
        ("a\n...\nc\n", "a\nb\nc\n", true),
        ("a\n...\n", "a\nb\nc\n", true),
        ("b\n...\n", "a\nb\n", false),
        ("a\n...\nb\n", "a\nc\n", false),
    ] {
        assert_eq!(shows(shown, printed), same, "{shown:?} {printed:?}");
    }
}
