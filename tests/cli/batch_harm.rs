//! What batches must not harm, and whom they must not blame.

use crate::batch::{plan, put, records, run, studio, tree};
use crate::lab::Lab;
use serde_json::Value;

/// The last record of a take; ledgers of different plans come in no order.
#[track_caller]
fn last(lab: &Lab, out: &str, path: &str) -> Value {
    let seen = records(&lab.path(out)).into_iter().map(|(_, record)| record).filter(|record| record["path"] == path);
    seen.max_by_key(|record| record["time"].as_str().unwrap().to_owned()).unwrap()
}

#[test]
fn inputs_are_never_written_whatever_is_forced() {
    let lab = studio();
    let before = tree(&lab.path("in"));
    lab.write("list.txt", "in/Day 1/walk.c3d\n");
    let sources: [(&[&str], &str); 3] =
        [(&["in/Day 1/*.c3d"], "in/Day 1"), (&["--list", "list.txt"], "in/Day 1"), (&["in/Day 1", "in/Day 2"], "in")];
    for (source, out) in sources {
        lab.run(&[&["batch", "plan", "-o", "plan.jsonl", "--force"], source].concat()).with_code(0);
        let told = lab.run(&["batch", "run", "plan.jsonl", "--out", out, "--force", "--quiet"]);
        assert!(told.code == 1 && told.err.contains("is the take that is read"), "{source:?}: {told:?}");
        assert!(tree(&lab.path("in")) == before, "{source:?} changed an input");
    }
    // by another name
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(lab.path("in"), lab.path("link")).unwrap();
        assert_eq!(lab.run(&["batch", "run", "plan.jsonl", "--out", "link", "--force", "--quiet"]).code, 1);
        assert!(tree(&lab.path("in")) == before);
        assert!(last(&lab, "link", "Day 1/walk.c3d")["reason"].as_str().unwrap().contains("is the take that is read"));
    }
}

#[test]
fn nothing_beside_an_output_is_replaced_either() {
    let lab = studio();
    plan(&lab, &["--reports"]).with_code(0);
    for name in ["Day 1/walk.c3d.mcap", "Day 1/Größe.csv.html", "Day 2/walk.c3d.repair.json"] {
        put(&lab, &format!("out/{name}"), b"{}");
    }
    put(&lab, "out/Day 2/walk.c3d", b"mine");
    assert_eq!(run(&lab, &[]).code, 1);
    for name in ["Day 1/walk.c3d.mcap", "Day 1/Größe.csv.html", "Day 2/walk.c3d.repair.json"] {
        assert_eq!(lab.read(&format!("out/{name}")), b"{}", "{name}");
    }
    assert_eq!(lab.read("out/Day 2/walk.c3d"), b"mine");
    assert!(!lab.path("out/Day 1/walk.c3d").exists());
}

#[test]
fn a_sidecar_takes_nothing_away_that_is_not_an_output() {
    let lab = studio();
    plan(&lab, &["--reports"]).with_code(0);
    run(&lab, &[]);
    let precious = ["out/Day 1/other.c3d", "out/Day 1/precious.txt"];
    for name in precious {
        put(&lab, name, b"precious");
    }
    // what somebody else may write into one, with the hash that it has to have
    let text = lab.text("out/Day 1/walk.c3d.repair.json");
    let mut sidecar = mocap_repair::batch::sidecar::Sidecar::parse(text.as_bytes()).unwrap();
    let report = sidecar.outputs.iter().position(|file| file.name == "walk.c3d.html").unwrap();
    for name in ["other.c3d", "precious.txt", "../precious.txt"] {
        let file = mocap_repair::batch::sidecar::OutputFile { name: name.to_owned(), ..sidecar.outputs[report].clone() };
        sidecar.outputs.push(file);
    }
    lab.write("out/Day 1/walk.c3d.repair.json", sidecar.text());
    plan(&lab, &[]).with_code(0);
    lab.write("out/Day 1/walk.c3d", b"damaged");
    assert_eq!(run(&lab, &[]).code, 3);
    assert!(precious.iter().all(|name| lab.read(name) == b"precious"));
    assert!(!lab.path("out/Day 1/walk.c3d.html").exists(), "it is not wanted any more");
}

#[test]
fn a_kill_after_other_options_leaves_what_an_undisturbed_run_leaves() {
    let lab = studio();
    plan(&lab, &["--reports", "--fills"]).with_code(0);
    run(&lab, &[]);
    lab.run(&["batch", "run", "plan.jsonl", "--out", "undisturbed", "--quiet"]);
    lab.write("quick.toml", "method = \"spline\"\n");
    plan(&lab, &[]).with_code(0);
    lab.run(&["batch", "run", "plan.jsonl", "--out", "undisturbed", "--quiet"]);
    let whole = tree(&lab.path("undisturbed"));
    // every state that a kill can leave: the new ones in their order up to some file, the old ones from there on
    let take = "Day 1/walk.c3d";
    let old = tree(&lab.path("out"));
    let order = [".html", ".fills.csv", ".repair.json", ".mcap", ""].map(|extension| format!("{take}{extension}"));
    for done in 0..=order.len() {
        for (name, bytes) in &old {
            put(&lab, &format!("out/{name}"), bytes);
        }
        for name in &order[..done] {
            match whole.get(name) {
                Some(bytes) => lab.write(&format!("out/{name}"), bytes),
                None => std::fs::remove_file(lab.path(&format!("out/{name}"))).unwrap(),
            }
        }
        assert_eq!(run(&lab, &[]).code, 3);
        let after = tree(&lab.path("out"));
        assert!(
            after == whole,
            "killed after {done}: {:?}",
            after.keys().filter(|name| after.get(*name) != whole.get(*name)).collect::<Vec<_>>()
        );
    }
}

#[test]
fn a_take_that_gets_its_right_name_is_tried() {
    let lab = studio();
    put(&lab, "in/table.c3d", &lab.read("walk-gaps.csv"));
    plan(&lab, &[]).with_code(0);
    run(&lab, &[]);
    assert_eq!(last(&lab, "out", "table.c3d")["outcome"], "quarantined");
    std::fs::rename(lab.path("in/table.c3d"), lab.path("in/table.csv")).unwrap();
    plan(&lab, &[]).with_code(0);
    run(&lab, &[]);
    assert_eq!(last(&lab, "out", "table.csv")["outcome"], "done");
}

#[test]
fn no_take_is_blamed_for_a_file_of_the_options() {
    let lab = studio();
    let bones = lab.run(&["bones", "walk-truth.c3d"]).with_code(0).out;
    lab.write("bones.csv", &bones);
    lab.write("quick.toml", "method = \"linear\"\nbones = \"bones.csv\"\n");
    plan(&lab, &[]).with_code(0);
    lab.write("bones.csv", "no bones");
    let told = run(&lab, &[]);
    assert!(told.code == 1 && told.err.contains("bones.csv: is not what it was when it was planned"), "{told:?}");
    plan(&lab, &[]).with_code(0);
    assert_eq!(run(&lab, &[]).code, 1);
    let record = last(&lab, "out", "Day 1/walk.c3d");
    assert!(record["outcome"] == "failed" && record["reason"].as_str().unwrap().contains("bones.csv"), "{record}");
    lab.write("bones.csv", &bones);
    plan(&lab, &[]).with_code(0);
    assert_eq!(run(&lab, &[]).code, 3);
    assert_eq!(last(&lab, "out", "Day 1/walk.c3d")["outcome"], "done");
    // the content counts, not the name
    lab.write("bones.csv", bones.lines().take(3).fold(String::new(), |text, line| text + line + "\n"));
    plan(&lab, &[]).with_code(0);
    run(&lab, &[]);
    let record = last(&lab, "out", "Day 1/walk.c3d");
    assert_eq!(record["outcome"], "done", "{record}");
}

#[test]
fn plans_of_others_write_nothing_elsewhere() {
    let lab = studio();
    plan(&lab, &[]).with_code(0);
    let text = lab.text("plan.jsonl");
    let evil = lab.path("evil.csv");
    lab.write(
        "plan.jsonl",
        text.replacen("method = \\\"linear\\\"", &format!("method = \\\"linear\\\"\\nfills = \\\"{}\\\"", evil.display()), 1),
    );
    let told = run(&lab, &[]);
    assert!(told.code == 1 && !evil.exists(), "{told:?}");
    lab.write("plan.jsonl", text.replacen("seed = 1", "seed = 2", 1));
    let told = run(&lab, &[]);
    assert!(told.code == 1 && told.err.contains("it was changed; plan again"), "{told:?}");
    for output in ["../evil.c3d", "/tmp/evil.c3d", ".mocap-repair/ledger/evil.c3d", "a/../../evil.c3d"] {
        lab.write("plan.jsonl", text.replace("\"output\":\"Day 1/walk.c3d\"", &format!("\"output\":\"{output}\"")));
        assert_eq!(run(&lab, &["--keep-going"]).code, 1, "{output}");
        assert_eq!(last(&lab, "out", "Day 1/walk.c3d")["outcome"], "failed", "{output}");
    }
    assert!(!lab.path("evil.c3d").exists() && !std::path::Path::new("/tmp/evil.c3d").exists());
}

#[cfg(unix)]
#[test]
fn what_cannot_be_read_is_told() {
    use std::os::unix::fs::PermissionsExt;
    let lab = studio();
    let closed = lab.path("in/Day 1/walk.c3d");
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o0)).unwrap();
    if std::fs::read(&closed).is_ok() {
        return; // whoever may read everything sees nothing of this
    }
    let told = plan(&lab, &[]).with_code(3);
    assert!(told.sentences().contains("cannot be read at the moment"), "{}", told.out);
    run(&lab, &[]);
    assert_eq!(last(&lab, "out", "Day 1/walk.c3d")["outcome"], "failed");
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o644)).unwrap();
    run(&lab, &[]);
    assert_eq!(last(&lab, "out", "Day 1/walk.c3d")["outcome"], "done");
    run(&lab, &[]);
    assert_eq!(last(&lab, "out", "Day 1/walk.c3d")["outcome"], "skipped");
}

#[test]
fn patterns_and_lists_leave_out_what_folders_leave_out() {
    let lab = studio();
    plan(&lab, &[]).with_code(0);
    lab.run(&["batch", "run", "plan.jsonl", "--out", "in/repaired", "--quiet"]);
    put(&lab, "in/.hidden/walk.c3d", &lab.read("walk-gaps.c3d"));
    let takes = |lab: &Lab| lab.text("plan.jsonl").lines().count() - 1;
    for source in [&["in/**/*.c3d"][..], &["--list", "list.txt"]] {
        lab.write("list.txt", "in/**/*.c3d\n");
        lab.run(&[&["batch", "plan", "-o", "plan.jsonl", "--force"], source].concat()).with_code(0);
        assert_eq!(takes(&lab), 3, "{source:?}: {}", lab.text("plan.jsonl"));
    }
}

#[test]
fn another_take_does_not_take_the_place_of_one() {
    let lab = studio();
    for day in ["Day 1", "Day 2"] {
        lab.run(&["batch", "plan", &format!("in/{day}"), "-o", "plan.jsonl", "--config", "quick.toml", "--force"]).with_code(0);
        run(&lab, &[]);
    }
    let record = last(&lab, "out", "walk.c3d");
    assert!(record["outcome"] == "failed" && record["reason"].as_str().unwrap().contains("is the output of another take"), "{record}");
    assert_eq!(lab.run(&["batch", "run", "plan.jsonl", "--out", "alone", "--quiet"]).code, 3);
    assert_ne!(lab.read("out/walk.c3d"), lab.read("alone/walk.c3d"));
    // the same take in another version takes its place
    put(&lab, "in/Day 1/walk.c3d", &lab.read("walk-truth.c3d"));
    lab.run(&["batch", "plan", "in/Day 1", "-o", "plan.jsonl", "--config", "quick.toml", "--force"]).with_code(0);
    run(&lab, &[]);
    assert_eq!(lab.read("out/walk.c3d"), lab.read("alone/walk.c3d"));
}

#[test]
fn what_is_done_stays_done_whatever_old_ledgers_say() {
    let lab = studio();
    plan(&lab, &[]).with_code(0);
    for shard in ["0/2", "1/2"] {
        run(&lab, &["--shard", shard, "--timeout", "1ms"]);
    }
    assert!(lab.run(&["batch", "status", "out"]).with_code(3).out.contains("put aside  4"));
    run(&lab, &["--retry"]);
    let repaired = tree(&lab.path("out"));
    assert_eq!(repaired.len(), 9);
    run(&lab, &[]);
    let told = lab.run(&["batch", "status", "out"]).with_code(3);
    assert!(told.out.contains("repaired   3") && told.out.contains("put aside  1"), "{}", told.out);
    std::fs::remove_file(lab.path("out/Day 1/walk.c3d")).unwrap();
    run(&lab, &[]);
    assert!(tree(&lab.path("out")) == repaired, "and what is lost is made again");
}

#[cfg(unix)]
#[test]
fn the_exit_code_does_not_depend_on_what_was_done_before() {
    let lab = studio();
    std::fs::remove_file(lab.path("in/Day 2/cut.c3d")).unwrap();
    lab.write("quick.toml", "method = \"linear\"\nmax-gap = 1\n");
    plan(&lab, &[]).with_code(0);
    assert_eq!([run(&lab, &[]).code, run(&lab, &[]).code], [3, 3], "gaps stay open");
    // a pipe is waited for by nobody
    assert!(std::process::Command::new("mkfifo").arg(lab.path("in/pipe.c3d")).status().unwrap().success());
    let told = lab.run(&["batch", "plan", "in/*", "-o", "plan.jsonl", "--force"]).with_code(3);
    assert!(told.sentences().contains("pipe.c3d: is no file"), "{}", told.out);
}
