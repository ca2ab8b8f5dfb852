//! The report on a batch: one page and one table.

use crate::batch::{plan, put, run, studio};
use crate::lab::{Lab, Ran};

fn report(lab: &Lab, more: &[&str]) -> Ran {
    lab.run(&[&["batch", "report"], more].concat())
}

#[track_caller]
fn refused(lab: &Lab, more: &[&str], why: &str) {
    let told = report(lab, more);
    assert!(told.code == 1 && told.err.contains(why), "{told:?}");
}

#[test]
fn a_batch_has_a_page_and_a_table() {
    let lab = studio();
    plan(&lab, &["--reports"]).with_code(0);
    // nothing was done: there is nothing to tell of
    refused(&lab, &["out", "-o", "report.html"], "holds no batch");
    assert_eq!(run(&lab, &[]).code, 3);
    report(&lab, &["out", "-o", "out/report.html"]).with_code(0);
    let (page, table) = (lab.read("out/report.html"), lab.text("out/report.csv"));
    assert!(page.starts_with(b"<!doctype html>"));
    let mut rows = csv::Reader::from_reader(table.as_bytes());
    let column = |name: &str| table.lines().next().unwrap().split(',').position(|cell| cell == name).unwrap();
    let [path, outcome, missing, own] = ["path", "outcome", "samples_missing", "report"].map(column);
    let rows: Vec<csv::StringRecord> = rows.records().map(Result::unwrap).collect();
    let told: Vec<_> = rows.iter().map(|row| (&row[path], &row[outcome], !row[missing].is_empty(), &row[own])).collect();
    let expected = [
        ("Day 1/Größe.csv", "done", true, "Day 1/Größe.csv.html"),
        ("Day 1/walk.c3d", "done", true, "Day 1/walk.c3d.html"),
        ("Day 2/cut.c3d", "quarantined", false, ""),
        ("Day 2/walk.c3d", "done", true, "Day 2/walk.c3d.html"),
    ];
    assert_eq!(told, expected);
    assert!(rows.iter().all(|row| row[own].is_empty() || lab.path(&format!("out/{}", &row[own])).is_file()));

    // the same records, the same bytes; and nothing is replaced that nobody wants replaced
    refused(&lab, &["out", "-o", "out/report.html"], "--force");
    report(&lab, &["out", "-o", "out/report.html", "--force"]).with_code(0);
    assert!(lab.read("out/report.html") == page);
    report(&lab, &["out", "-o", "report.html", "--plan", "all"]).with_code(0);
    refused(&lab, &["out", "-o", "report.html", "--plan", "no"], "no plan that begins with no was run here");

    // a take that came later is not yet done
    put(&lab, "in/Day 3/late.csv", &lab.read("walk-gaps.csv"));
    plan(&lab, &["--reports"]).with_code(0);
    report(&lab, &["out", "-o", "late.html"]).with_code(0);
    assert!(!lab.text("late.csv").contains("late.csv"), "nobody has begun with this plan");
}
