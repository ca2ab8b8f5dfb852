//! The table of what becomes of every real file: opened, refused, or wrong. It stands in `docs/formats/real-files.md`, and is compared here;
//! with `MOCAP_BLESS=1` in the environment it is written there.

use super::{Row, bvh, c3d, checks, tables, text};
use libtest_mimic::Failed;
use mocap_repair::input::{Reading, open};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

const PAGE: &str = "docs/formats/real-files.md";
const BEGIN: &str = "<!-- made by tests/shared -->\n";
const END: &str = "<!-- until here -->\n";

/// What became of the files of one folder.
#[derive(Default)]
struct Counts {
    files: usize,
    opened: usize,
    refused: usize,
    wrong: usize,
}

/// The checks that the file has to pass, as the other tests make them; files of formats that we do not read have none.
fn check(kind: &str, path: &Path, row: &Row) -> Result<(), Failed> {
    match kind {
        "c3d" | "synthetic" => c3d::c3d(path, row),
        "csv" => tables::table(path),
        "trc" | "tsv" => text::text(path, row, if kind == "trc" { "trc" } else { "tsv" }),
        "bvh" => bvh::bvh(path, row),
        _ => Ok(()),
    }
}

fn table(data: &Path, rows: &[Row]) -> String {
    let mut counts: BTreeMap<String, Counts> = BTreeMap::new();
    let mut refusals = String::new();
    for row in rows {
        let file = row.get("file").cloned().unwrap_or_default();
        let kind = file.split('/').next().unwrap_or_default().to_owned();
        let path = data.join(&file);
        let counts = counts.entry(kind.clone()).or_default();
        counts.files += 1;
        if check(&kind, &path, row).is_err() {
            counts.wrong += 1;
            continue;
        }
        match open(&path, &Reading::default()) {
            Ok(opened) if checks::goes_everywhere(opened.document.take()).is_err() => counts.wrong += 1,
            Ok(_) => counts.opened += 1,
            Err(error) => {
                counts.refused += 1;
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                let why = error.to_string().replace(&path.display().to_string(), "").trim_start_matches(": ").replace('|', "\\|");
                let _ = writeln!(refusals, "| {name} | {why} |");
            }
        }
    }
    let mut out = String::from("| folder | files | opened | refused | wrong |\n| --- | --- | --- | --- | --- |\n");
    for (kind, c) in &counts {
        let _ = writeln!(out, "| {kind} | {} | {} | {} | {} |", c.files, c.opened, c.refused, c.wrong);
    }
    let _ = write!(out, "\n| refused | because |\n| --- | --- |\n{refusals}");
    out
}

/// Holds the page against what becomes of the files.
pub fn survey(data: &Path, rows: &[Row]) -> Result<(), Failed> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join(PAGE);
    let was = std::fs::read_to_string(&page)?;
    let (before, rest) = was.split_once(BEGIN).ok_or("the page has no place for the table")?;
    let (_, after) = rest.split_once(END).ok_or("the page does not say where the table ends")?;
    let is = format!("{before}{BEGIN}{}{END}{after}", table(data, rows));
    if std::env::var_os("MOCAP_BLESS").is_some() {
        std::fs::write(&page, &is)?;
    }
    let wrong = is.lines().any(|line| {
        line.starts_with("| ")
            && line.matches('|').count() == 6
            && !line.ends_with(" 0 |")
            && !line.contains("wrong")
            && !line.contains("---")
    });
    if wrong {
        return Err("a file is wrong".into());
    }
    if std::fs::read_to_string(&page)? == is { Ok(()) } else { Err(format!("{PAGE} says something else; run with MOCAP_BLESS=1").into()) }
}
