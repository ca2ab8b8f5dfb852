//! Rules about the repository itself, so that nobody has to remember them.
#![allow(clippy::unwrap_used)] // A test program: it fails by panicking.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// Files of code may be this long, in lines ...
const LONGEST_FILE: usize = 500;

/// ... unless they are here, with the reason.
const LONG_FILES: &[(&str, &str)] = &[
    ("src/fit/report.rs", "what a motion tells people, scripts and the exit code has to agree, and is read side by side"),
    ("tests/cli/solving.rs", "what the command says and finds is tested with the same body, takes and bounds"),
];

/// The largest fixture, in bytes: a fixture shows one thing.
const LARGEST_FIXTURE: u64 = 100_000;

/// Licences that a dependency may be under without anything to be done about it.
const LICENCES: &[&str] = &[
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "ISC",
    "MIT",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Dependencies that are there in more than one version, with the reason.
const TWICE: &[(&str, &str)] = &[
    ("hashbrown", "petgraph wants an older one than its own indexmap; both are for the build script only"),
    ("syn", "the derive macros are on their way from version 2 to 3; none of it is in the program"),
    ("unicode-width", "miette wants an older one; it is for the build script only"),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[track_caller]
fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// All files below a folder of the repository, by their path from its root; what builds leave is not among them.
#[track_caller]
fn files(folder: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![root().join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if path.is_dir() {
                if ![".git", "target", "__pycache__", "node_modules"].contains(&name) {
                    folders.push(path);
                }
            } else {
                let inside = path.strip_prefix(root()).unwrap();
                found.push(inside.components().map(|c| c.as_os_str().to_str().unwrap()).collect::<Vec<_>>().join("/"));
            }
        }
    }
    found.sort();
    found
}

fn with_extension<'a>(files: &'a [String], extension: &str) -> Vec<&'a str> {
    files.iter().map(String::as_str).filter(|f| Path::new(f).extension().is_some_and(|e| e == extension)).collect()
}

#[test]
fn solvers_know_no_files_no_clock_and_no_terminal() {
    let all = files("src/solve");
    let sources = with_extension(&all, "rs");
    assert!(sources.len() >= 5, "{sources:?}");
    for path in sources {
        for (at, line) in read(path).lines().enumerate() {
            for word in ["std::fs", "std::io", "std::env", "std::process", "Instant", "SystemTime", "println", "eprint", "dbg!"] {
                assert!(!line.contains(word), "{path}:{}: {word} has no place among the solvers", at + 1);
            }
        }
    }
}

#[test]
fn long_files_have_a_reason() {
    let all = files("");
    let code = ["rs", "js", "mjs", "css", "py"].map(|extension| with_extension(&all, extension)).concat();
    let sources: Vec<&str> = code.into_iter().filter(|path| !path.starts_with("src/page/vendor/")).collect();
    assert!(sources.len() > 40, "{sources:?}");
    let long: BTreeSet<&str> = sources.into_iter().filter(|path| read(path).lines().count() > LONGEST_FILE).collect();
    let allowed: BTreeSet<&str> = LONG_FILES.iter().map(|(path, _)| *path).collect();
    assert!(LONG_FILES.iter().all(|(_, reason)| reason.len() > 20));
    let without: Vec<_> = long.difference(&allowed).collect();
    assert!(without.is_empty(), "longer than {LONGEST_FILE} lines: split {without:?}, or give the reason in tests/tidy.rs");
    let stale: Vec<_> = allowed.difference(&long).collect();
    assert!(stale.is_empty(), "no longer long, or gone: take {stale:?} out of tests/tidy.rs");
}

#[test]
fn every_format_has_a_page_and_fixtures() {
    assert!(formats::ALL.len() >= 2);
    for format in formats::ALL {
        let name = format.info().name;
        let page = read(&format!("docs/formats/{name}.md"));
        assert!(page.lines().count() > 10, "docs/formats/{name}.md says next to nothing");
        for kind in ["good", "bad"] {
            assert!(!files(&format!("fixtures/{name}/{kind}")).is_empty(), "fixtures/{name}/{kind} is empty");
        }
    }
}

#[test]
fn every_fixture_is_listed_and_small() {
    let all = files("fixtures");
    let readme = read("fixtures/README.md");
    assert!(readme.to_lowercase().contains("licence"), "fixtures/README.md must say under which licence they are");
    let listed: BTreeSet<String> =
        readme.lines().filter_map(|line| Some(format!("fixtures/{}", line.strip_prefix("| ")?.split(" |").next()?.trim()))).collect();
    let present: BTreeSet<String> = all.iter().filter(|path| *path != "fixtures/README.md").cloned().collect();
    assert!(present.len() > 30, "{} fixtures", present.len());
    let unlisted: Vec<_> = present.difference(&listed).collect();
    assert!(unlisted.is_empty(), "not listed in fixtures/README.md: {unlisted:?}");
    let gone: Vec<_> = listed.difference(&present).filter(|path| path.matches('/').count() == 3).collect();
    assert!(gone.is_empty(), "listed in fixtures/README.md and not there: {gone:?}");
    for path in &present {
        let bytes = std::fs::metadata(root().join(path)).unwrap().len();
        assert!(bytes < LARGEST_FIXTURE, "{path} has {bytes} bytes");
    }
}

/// The project speaks of the project: not of those who work on it, nor of their machines.
#[test]
fn nothing_speaks_of_anything_but_the_project() {
    // In pieces, or this file would be the first to be found.
    let words = [["cla", "ude"], ["anth", "ropic"], ["/wo", "rk/"], ["issue", " #"], ["helper", " agent"]].map(|pieces| pieces.concat());
    let all = files("");
    assert!(all.len() > 100, "{} files", all.len());
    for path in &all {
        let text = String::from_utf8_lossy(&std::fs::read(root().join(path)).unwrap()).to_lowercase();
        for word in &words {
            let place = text.find(word.as_str()).map(|at| text[..at].lines().count());
            assert!(place.is_none(), "{path}:{}: \"{word}\"", place.unwrap_or_default());
        }
    }
}

#[test]
fn the_documents_name_every_module() {
    let readme = read("README.md");
    let architecture = read("docs/architecture.md");
    let algorithm = read("docs/algorithm.md");
    assert!(readme.contains("docs/architecture.md") && readme.contains("docs/algorithm.md") && readme.contains("docs/mcap-log.md"));
    let mut modules = BTreeSet::new();
    for folder in ["src", "formats"] {
        for path in with_extension(&files(folder), "rs") {
            // `src/log/mcap.rs` belongs to the module `src/log`
            let top = path.split('/').nth(1).unwrap().trim_end_matches(".rs").to_owned();
            if !["lib", "main"].contains(&top.as_str()) {
                modules.insert((folder, top));
            }
        }
    }
    assert!(modules.len() > 15, "{modules:?}");
    for (folder, module) in &modules {
        let names =
            [format!("`{module}`"), format!("{folder}/{module}"), format!("`{module}.rs`"), format!("`{module}/`"), format!("{module}.rs")];
        assert!(names.iter().any(|name| architecture.contains(name)), "docs/architecture.md does not name {folder}/{module}");
    }
    let solvers = files("src/solve");
    for path in with_extension(&solvers, "rs") {
        let short = path.strip_prefix("src/solve/").unwrap();
        if short.ends_with("mod.rs") || short.ends_with("tests.rs") {
            continue;
        }
        let named = [&algorithm, &architecture].iter().any(|text| text.contains(short) || text.contains(short.rsplit('/').next().unwrap()));
        assert!(named, "neither docs/algorithm.md nor docs/architecture.md names {path}");
    }
}

#[test]
fn links_between_documents_lead_somewhere() {
    let all = files("");
    let mut links = 0;
    for path in with_extension(&all, "md") {
        let folder = Path::new(path).parent().unwrap();
        for (at, line) in read(path).lines().enumerate() {
            let targets = line.split("](").skip(1).filter_map(|rest| rest.split([')', '#', ' ']).next());
            for target in targets.filter(|t| !t.is_empty() && !t.contains("://") && !t.starts_with("mailto:")) {
                assert!(root().join(folder).join(target).exists(), "{path}:{}: {target} is not there", at + 1);
                links += 1;
            }
        }
    }
    assert!(links > 3, "{links} links");
}

#[test]
fn decisions_are_numbered_without_holes() {
    let all = files("docs/decisions");
    let decisions = with_extension(&all, "md");
    assert!(!all.is_empty() && decisions.len() == all.len(), "{all:?}");
    for (at, path) in decisions.into_iter().enumerate() {
        let start = format!("docs/decisions/{:04}-", at + 1);
        assert!(path.starts_with(&start), "{path}: expected {start}");
        assert!(read(path).starts_with("# "), "{path} has no title");
    }
}

/// The command that tests everything stands in the README; `.ci/run` takes it from there.
#[test]
fn the_readme_says_how_to_test() {
    let commands: Vec<String> = read("README.md").lines().map(|line| line.trim_start_matches("$ ").trim().to_owned()).collect();
    assert_eq!(commands.iter().filter(|line| line.starts_with("cargo test")).collect::<Vec<_>>(), ["cargo test --workspace"]);
    assert!(read(".ci/run").contains("README.md") && read("justfile").contains(".ci/run"));
}

/// What `cargo tree` says about all dependencies of a build on this machine, tests included. No network: a build that got here has them all.
#[track_caller]
fn dependencies(format: &str) -> Vec<String> {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.args(["tree", "--workspace", "--offline", "--locked", "--prefix", "none", "--no-dedupe", "--format", format]).current_dir(root());
    let output = cargo.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines: BTreeSet<String> =
        String::from_utf8(output.stdout).unwrap().lines().filter(|line| !line.is_empty()).map(str::to_owned).collect();
    assert!(lines.len() > 20, "{lines:?}");
    lines.into_iter().collect()
}

/// True if an expression such as `(MIT OR Apache-2.0) AND Unicode-3.0` can be met with allowed licences alone.
fn allowed(expression: &str) -> bool {
    /// The parts of an expression between `word`s that stand outside brackets.
    fn split<'a>(expression: &'a str, word: &str) -> Vec<&'a str> {
        let (mut depth, mut start, mut parts) = (0, 0, Vec::new());
        for (at, c) in expression.char_indices() {
            match c {
                '(' => depth += 1,
                ')' => depth -= 1,
                _ if depth == 0 && at >= start && expression[at..].starts_with(word) => {
                    parts.push(&expression[start..at]);
                    start = at + word.len();
                }
                _ => {}
            }
        }
        parts.push(&expression[start..]);
        parts
    }
    let expression = expression.trim();
    for (word, all) in [(" OR ", false), ("/", false), (" AND ", true)] {
        let parts = split(expression, word);
        if parts.len() > 1 {
            return if all { parts.into_iter().all(allowed) } else { parts.into_iter().any(allowed) };
        }
    }
    match expression.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')) {
        Some(inside) => allowed(inside),
        None => LICENCES.contains(&expression),
    }
}

#[test]
fn licences_are_weighed_as_written() {
    for (expression, fine) in [
        ("MIT", true),
        ("GPL-3.0", false),
        ("", false),
        ("GPL-3.0 OR MIT", true),
        ("GPL-3.0/MIT", true),
        ("MIT AND GPL-3.0", false),
        ("(MIT OR GPL-3.0) AND Unicode-3.0", true),
        ("(MIT AND GPL-3.0) OR Zlib", true),
        ("MIT AND (GPL-3.0 OR LGPL-2.1)", false),
        ("Apache-2.0 WITH LLVM-exception", true),
        ("GPL-2.0 WITH Classpath-exception-2.0", false),
    ] {
        assert_eq!(allowed(expression), fine, "{expression}");
    }
}

#[test]
fn every_dependency_may_be_used() {
    for line in dependencies("{p}|{l}") {
        let (package, licence) = line.split_once('|').unwrap();
        assert!(
            allowed(licence),
            "{package} is under \"{licence}\"; add it to LICENCES in tests/tidy.rs if that is fine, or do without it"
        );
    }
}

#[test]
fn dependencies_come_from_the_registry_once_each() {
    let lock = read("Cargo.lock");
    let sources: BTreeSet<&str> = lock.lines().filter_map(|line| line.strip_prefix("source = ")).collect();
    assert_eq!(sources.into_iter().collect::<Vec<_>>(), ["\"registry+https://github.com/rust-lang/crates.io-index\""]);
    let mut versions: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for package in dependencies("{p}") {
        let mut words = package.split_whitespace();
        let (name, version) = (words.next().unwrap(), words.next().unwrap());
        versions.entry(name.to_owned()).or_default().insert(version.to_owned());
    }
    let twice: Vec<&str> = versions.iter().filter(|(_, v)| v.len() > 1).map(|(name, _)| name.as_str()).collect();
    assert!(TWICE.iter().all(|(_, reason)| reason.len() > 20));
    assert_eq!(twice, TWICE.iter().map(|(name, _)| *name).collect::<Vec<_>>(), "in more than one version");
}
