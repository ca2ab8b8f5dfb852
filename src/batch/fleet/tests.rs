#![allow(clippy::unwrap_used)]

use super::*;
use crate::batch::ledger::{Begun, Ended, How, Record, Stop, TakeRecord, Try};
use crate::batch::plan::{Header, PlannedTake};
use crate::batch::sidecar::{InputFile, MarkerSummary, NoteSaid, OutputFile, Summary};
use crate::batch::store::Place;
use std::fs;

/// A sidecar of a take with one gap.
pub(super) fn sidecar() -> Sidecar {
    Sidecar {
        version: "0.1.0".to_owned(),
        key: "k1".to_owned(),
        path: "A/a.c3d".to_owned(),
        input: InputFile { name: "a.c3d".to_owned(), source: String::new(), bytes: 10, sha256: "s".to_owned(), version: None },
        config_sha256: "c".to_owned(),
        outputs: vec![OutputFile { name: "a.c3d".to_owned(), bytes: 10, sha256: "o".to_owned() }],
        exit_code: 3,
        summary: Summary {
            format: "c3d".to_owned(),
            rate_hz: 100.0,
            frames: 1000,
            markers: 1,
            method: "auto".to_owned(),
            gaps: 1,
            samples: 1000,
            samples_missing: 40,
            samples_filled: 40,
            longest_gap: 40,
            worst_sigma_mm: Some(4.7),
            ..Summary::default()
        },
        markers: vec![MarkerSummary {
            label: "S:LKNE".to_owned(),
            missing: 40,
            gaps: 1,
            longest: 40,
            filled: 40,
            worst_sigma_mm: Some(4.7),
        }],
        notes: vec![NoteSaid { kind: "unit_assumed".to_owned(), text: "millimetres are assumed".to_owned(), matters: true }],
        sidecar_sha256: String::new(),
    }
}

fn record(path: &str, time: &str, outcome: Outcome, key: &str, elapsed_secs: f64) -> Record {
    let done = matches!(outcome, Outcome::Done | Outcome::Skipped);
    Record::Take(TakeRecord {
        time: time.to_owned(),
        path: path.to_owned(),
        output: path.to_owned(),
        key: Some(key.to_owned()),
        planned: None,
        outcome,
        exit_code: done.then_some(3),
        reason: (!done).then(|| format!("{path}: c3d: the header is cut off")),
        tries: if outcome == Outcome::Skipped {
            Vec::new()
        } else {
            vec![Try { ended: How::Exit, code: Some(3), signal: None, reason: None, elapsed_secs }]
        },
        elapsed_secs,
        peak_bytes: Some(1000),
        bytes: 10,
    })
}

fn lines(records: &[Record]) -> String {
    crate::report::lines(records)
}

/// The name of a plan's copy.
fn sha256(plan: u32) -> String {
    format!("{plan:08}").repeat(8)
}

fn begun(plan: u32, time: &str) -> Record {
    let plan = (plan > 0).then(|| sha256(plan));
    Record::Begun(Begun { time: time.to_owned(), host: "a".to_owned(), shards: 1, plan, ..Begun::default() })
}

/// A folder with these ledgers, plans and sidecars.
fn batch(ledgers: &[(&str, String)], plans: &[(u32, &[&str])], sidecars: &[(&str, Sidecar)]) -> (tempfile::TempDir, Place) {
    let root = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = root.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    for (name, text) in ledgers {
        put(&format!(".mocap-repair/ledger/{name}"), text);
    }
    for (plan, paths) in plans {
        let (header, takes) = planned(*plan, paths);
        put(
            &format!(".mocap-repair/plans/{}.jsonl", sha256(*plan)),
            &[crate::report::lines(&[header]), crate::report::lines(&takes)].concat(),
        );
    }
    for (path, sidecar) in sidecars {
        put(&format!("{path}.repair.json"), &sidecar.text());
    }
    let place = Place::parse(root.path().to_str().unwrap()).unwrap();
    (root, place)
}

/// A plan of these takes; in each plan they are to be repaired otherwise.
fn planned(plan: u32, paths: &[&str]) -> (Header, Vec<PlannedTake>) {
    let header = Header {
        version: "0.1.0".to_owned(),
        config: "method = 'auto'".to_owned(),
        config_sha256: format!("c{plan}"),
        files: Vec::new(),
        wanted: crate::batch::plan::Wanted::default(),
        sources: vec!["/in".to_owned()],
        takes: paths.len() as u64,
        bytes: 1,
    };
    let take = |path: &&str| PlannedTake {
        path: (*path).to_owned(),
        source: format!("/in/{path}"),
        output: (*path).to_owned(),
        bytes: 10,
        modified_ns: None,
        sha256: None,
        version: None,
        problem: None,
    };
    (header, paths.iter().map(take).collect())
}

fn rows(place: &Place, plans: &Plans) -> (About, Vec<FleetRow>) {
    let collected = collect(place, plans).unwrap();
    let rows = collected.rows().collect();
    (collected.about, rows)
}

#[test]
fn the_newest_record_wins_whichever_ledger_it_is_in() {
    let ended = Ended {
        time: "2026-11-30T13:00:10Z".to_owned(),
        stop: Stop::Complete,
        done: 1,
        remarked: 0,
        skipped: 1,
        quarantined: 0,
        failed: 0,
    };
    let late = lines(&[
        begun(1, "2026-11-30T13:00:00Z"),
        record("A/a.c3d", "2026-11-30T13:00:01Z", Outcome::Skipped, "k1", 0.0),
        record("A/b.c3d", "2026-11-30T13:00:00.5Z", Outcome::Done, "k1", 2.0),
        Record::Ended(ended),
    ]);
    let early = lines(&[
        begun(1, "2026-11-30T12:00:00Z"),
        record("A/a.c3d", "2026-11-30T12:00:30Z", Outcome::Done, "k1", 7.5),
        record("A/b.c3d", "2026-11-30T13:00:00Z", Outcome::Failed, "k1", 1.0),
    ]);
    // a kill tore the last line off, and with it the news that a.c3d failed
    let torn = format!("{early}{}", &lines(&[record("A/a.c3d", "2026-11-30T23:00:00Z", Outcome::Failed, "k1", 1.0)])[..200]);
    let ledgers = [("00000001-0-of-1-0002.jsonl", late), ("00000001-0-of-1-0001.jsonl", torn)];
    let (_root, place) = batch(&ledgers, &[(1, &["A/a.c3d", "A/b.c3d", "A/c.c3d"])], &[("A/a.c3d", sidecar())]);
    let (about, rows) = rows(&place, &Plans::Last);
    assert_eq!(rows.iter().map(|row| row.path.as_str()).collect::<Vec<_>>(), ["A/a.c3d", "A/b.c3d", "A/c.c3d"]);
    assert_eq!((rows[0].outcome, rows[0].elapsed_secs, rows[0].tries, rows[0].exit_code), (Some(Outcome::Skipped), Some(7.5), 1, Some(3)));
    assert_eq!(rows[0].sidecar, Sidecar::parse(sidecar().text().as_bytes()));
    assert_eq!((rows[1].outcome, rows[1].sidecar.is_none()), (Some(Outcome::Done), true));
    assert_eq!((rows[2].outcome, rows[2].bytes, rows[2].tries), (None, 10, 0));
    assert_eq!((about.shared_folders, about.attempts.len(), about.done_in_runs), (1, 2, 2));
    // from 12:00:00 to 13:00:10, without a hole: the record of b.c3d came at 13:00:00
    assert_eq!(about.wall_secs, 3610.0);
    assert_eq!((about.attempts[0].stop.as_deref(), about.attempts[1].stop.as_deref()), (None, Some("complete")));
    assert_eq!((about.plans[0].config.as_str(), about.plans[0].name.as_str()), ("method = 'auto'", "00000001"));
}

/// The same as one of a plan.
fn of_plan(plan: u32, record: Record) -> Record {
    let Record::Take(mut take) = record else { return record };
    let (header, takes) = planned(plan, &[&take.path]);
    take.planned = Some(takes[0].identity(&header));
    Record::Take(take)
}

#[test]
fn of_several_plans_the_one_that_was_run_last_counts_unless_another_is_asked_for() {
    let first = lines(&[
        begun(1, "2026-11-30T12:00:00Z"),
        of_plan(1, record("a", "2026-11-30T12:00:01Z", Outcome::Done, "k1", 1.0)),
        of_plan(1, record("b", "2026-11-30T12:00:02Z", Outcome::Quarantined, "k1", 1.0)),
    ]);
    let second = lines(&[begun(2, "2026-11-30T13:00:00Z"), of_plan(2, record("c", "2026-11-30T13:00:01Z", Outcome::Done, "k3", 1.0))]);
    let ledgers = [("00000001-0-of-1-0001.jsonl", first), ("00000002-0-of-1-0001.jsonl", second)];
    let (_root, place) = batch(&ledgers, &[(1, &["a", "b"]), (2, &["a", "c"])], &[]);
    let told = |plans: &Plans| {
        let (about, rows) = rows(&place, plans);
        (about.attempts.len(), rows.into_iter().map(|row| (row.path, row.outcome)).collect::<Vec<_>>())
    };
    let take = |path: &str, outcome| (path.to_owned(), outcome);
    assert_eq!(told(&Plans::Last), (1, vec![take("a", None), take("c", Some(Outcome::Done))]), "a is to be repaired otherwise");
    assert_eq!(told(&Plans::Of("00000001".to_owned())), (1, vec![take("a", Some(Outcome::Done)), take("b", Some(Outcome::Quarantined))]));
    let all = vec![take("a", Some(Outcome::Done)), take("b", Some(Outcome::Quarantined)), take("c", Some(Outcome::Done))];
    assert_eq!(told(&Plans::All), (2, all));
    for (wanted, problem) in [("9", "no plan that begins with 9"), ("0", "2 plans begin with 0")] {
        let error = collect(&place, &Plans::Of(wanted.to_owned())).err().unwrap().to_string();
        assert!(error.contains(problem), "{error}");
    }
}

#[test]
fn what_does_not_fit_is_left_out_and_told() {
    let text = format!(
        "{}not json\n{}",
        lines(&[begun(0, "2026-11-30T12:00:00Z"), record("a", "2026-11-30T12:00:01Z", Outcome::Done, "other", 1.0)]),
        lines(&[
            record("b", "2026-11-30T12:00:02Z", Outcome::Quarantined, "k1", 1.0),
            record("../c", "2026-11-30T12:00:03Z", Outcome::Done, "k1", 1.0),
            record("d", "2026-11-30T12:00:03Z", Outcome::Skipped, "k2", 0.0),
        ])
    );
    let (root, place) = batch(&[("watch-0-of-1-0001.jsonl", text)], &[], &[("a", sidecar()), ("b", sidecar())]);
    let collected = collect(&place, &Plans::Last).unwrap();
    let rows: Vec<FleetRow> = collected.rows().collect();
    assert_eq!(rows.len(), 4, "of a folder that is watched, whatever came");
    assert!(rows.iter().all(|row| row.sidecar.is_none()), "another key, no output, outside, not there");
    assert_eq!(collected.unread().unwrap().0, 1, "outside");
    assert_eq!((rows[3].outcome, rows[3].elapsed_secs), (Some(Outcome::Skipped), None), "no record tells when d was done");
    let out = root.path().join("report.html");
    assert_eq!(write(rows.into_iter(), &collected.about, &out, false).unwrap().without_numbers, 3);
}

#[test]
fn a_folder_without_a_batch_says_so() {
    let root = tempfile::tempdir().unwrap();
    let place = Place::parse(root.path().to_str().unwrap()).unwrap();
    assert!(collect(&place, &Plans::Last).err().unwrap().to_string().contains("holds no batch"));
}

fn row(path: &str, sidecar: Option<Sidecar>) -> FleetRow {
    FleetRow {
        path: path.to_owned(),
        output: path.to_owned(),
        outcome: Some(Outcome::Done),
        exit_code: Some(3),
        tries: 1,
        elapsed_secs: Some(1.5),
        bytes: 10,
        sidecar,
        ..FleetRow::default()
    }
}

#[test]
fn equal_takes_give_equal_bytes_and_nothing_is_replaced_unasked() {
    let root = tempfile::tempdir().unwrap();
    let about = About { name: "out".to_owned(), ..About::default() };
    let rows = || [row("A/a.c3d", Some(sidecar())), row("B/b.c3d", None)].into_iter();
    let page = |name: &str| root.path().join(name);
    let written = write(rows(), &about, &page("one.html"), false).unwrap();
    assert_eq!((written.takes, written.without_numbers, &written.csv), (2, 1, &page("one.csv")));
    write(rows(), &about, &page("two.html"), false).unwrap();
    for extension in ["html", "csv"] {
        assert_eq!(fs::read(page(&format!("one.{extension}"))).unwrap(), fs::read(page(&format!("two.{extension}"))).unwrap());
    }
    assert!(write(rows(), &about, &page("one.html"), false).unwrap_err().to_string().contains("--force"));
    fs::remove_file(page("two.html")).unwrap();
    assert!(write(rows(), &about, &page("two.html"), false).unwrap_err().to_string().contains("two.csv: exists already"));
    assert!(!page("two.html").exists());
    write(rows(), &about, &page("two.html"), true).unwrap();
    assert!(write(rows(), &about, &page("three.csv"), false).unwrap_err().to_string().contains(".html"));
    assert_eq!(fs::read_dir(root.path()).unwrap().count(), 4, "nothing else is left");
}

#[test]
fn names_and_labels_are_no_code() {
    let root = tempfile::tempdir().unwrap();
    let evil = "</script><img src=x onerror=alert(1)><!--\u{2028}\"'&";
    let mut told = sidecar();
    told.markers[0].label = evil.to_owned();
    told.notes[0].text = evil.to_owned();
    told.summary.worst_bone = Some(evil.to_owned());
    let page = |name: &str, about: &str, row: FleetRow| {
        let path = root.path().join(name);
        write([row].into_iter(), &About { name: about.to_owned(), remarks: vec![evil.to_owned()], ..About::default() }, &path, false)
            .unwrap();
        fs::read_to_string(path).unwrap()
    };
    let plain = page("plain.html", "out", row("a.c3d", Some(sidecar())));
    let text = page("evil.html", evil, FleetRow { reason: Some(evil.to_owned()), ..row(evil, Some(told)) });
    for what in ["<script", "</script", "<!--", "<img"] {
        assert_eq!(text.matches(what).count(), plain.matches(what).count(), "{what}");
    }
    assert!(!text.contains(evil) && text.contains("&lt;/script&gt;"));
}

#[test]
fn takes_are_told_apart_by_the_first_folder_that_differs() {
    for (path, shared, folder) in [("A/B/c", 0, "A"), ("A/B/c", 1, "B"), ("A/c", 1, ""), ("c", 0, "")] {
        assert_eq!(folder_of(path, shared), folder, "{path}");
    }
}
