//! The log as a user gets it: what is in it on demand, and what is taken out of it.

use crate::lab::Lab;

const REPAIR: [&str; 6] = ["walk-gaps.c3d", "-o", "walk.c3d", "--method", "linear", "--force"];

fn attachment(log: &[u8], name: &str) -> Option<Vec<u8>> {
    let summary = mcap::Summary::read(log).unwrap().unwrap();
    let index = summary.attachment_indexes.iter().find(|index| index.name == name)?.clone();
    Some(mcap::read::attachment(log, &index).unwrap().data.into_owned())
}

/// Number of messages of a topic.
fn count(log: &[u8], topic: &str) -> u64 {
    let summary = mcap::Summary::read(log).unwrap().unwrap();
    let id = summary.channels.values().find(|c| c.topic == topic).unwrap().id;
    summary.stats.unwrap().channel_message_counts.get(&id).copied().unwrap_or(0)
}

#[test]
fn the_input_is_in_the_log_if_it_is_wanted() {
    let lab = Lab::new();
    lab.run(&REPAIR).with_code(0);
    let plain = lab.read("walk.mcap");
    assert!(attachment(&plain, "walk-gaps.c3d").is_none());
    lab.run(&[&REPAIR[..], &["--log-source"]].concat()).with_code(0);
    let with = lab.read("walk.mcap");
    assert!(attachment(&with, "walk-gaps.c3d").unwrap() == lab.read("walk-gaps.c3d"));
    let config = String::from_utf8(attachment(&with, "config.toml").unwrap()).unwrap();
    assert!(config.contains("method = \"linear\"") && config.contains("log-source = true"), "{config}");
    lab.write("config.toml", &config);
    let before = lab.read("walk.c3d");
    lab.run(&["walk-gaps.c3d", "-o", "walk.c3d", "--force", "--config", "config.toml"]).with_code(0);
    assert!(lab.read("walk.c3d") == before && lab.read("walk.mcap") == with, "the options of a log make the same log");
    for name in ["report.jsonl", "take.json", "layout.json"] {
        assert!(attachment(&with, name).is_some(), "{name}");
    }
}

#[test]
fn what_is_drawn_can_be_thinned() {
    let lab = Lab::new();
    lab.run(&[&REPAIR[..], &["--log-rate", "30"]].concat()).with_code(0);
    let log = lab.read("walk.mcap");
    let frames = crate::lab::FRAMES as u64;
    assert_eq!([count(&log, "/markers/raw"), count(&log, "/markers/repaired"), count(&log, "/skeleton")], [frames.div_ceil(4); 3]);
    assert_eq!([count(&log, "/take/marker_state"), count(&log, "/take/bone_lengths")], [frames; 2]);
    let refused = lab.run(&[&REPAIR[..], &["--log-rate", "0"]].concat());
    assert!(refused.code == 2 && refused.err.contains("--log-rate"), "{refused:?}");
}

#[test]
fn where_a_take_lies_makes_no_difference_to_its_log() {
    let logs = [Lab::new(), Lab::new()].map(|lab| {
        let name = |file: &str| lab.path(file).display().to_string();
        lab.write("bones.csv", "LKNE,LANK\n");
        lab.run(&[&name("walk-gaps.c3d"), "-o", &name("walk.c3d"), "--method", "lds", "--hidden", "4", "--bones", &name("bones.csv")]);
        lab.read("walk.mcap")
    });
    assert!(logs[0] == logs[1]);
    let report = String::from_utf8(attachment(&logs[0], "report.jsonl").unwrap()).unwrap();
    assert!(report.contains(r#""input":"walk-gaps.c3d","output":"walk.c3d","log":"walk.mcap""#), "{report}");
}

#[test]
fn the_layout_is_taken_out_of_the_log() {
    let lab = Lab::new();
    lab.run(&REPAIR).with_code(0);
    lab.run(&["layout", "walk.mcap", "-o", "layout.json"]).with_code(0);
    assert!(lab.read("layout.json") == attachment(&lab.read("walk.mcap"), "layout.json").unwrap());

    let before = lab.listing();
    lab.write("note.mcap", "no log at all");
    for (arguments, told) in [
        (["walk.mcap", "-o", "layout.json"], "layout.json: exists already; give another name, or say --force to replace it"),
        (["none.mcap", "-o", "new.json"], "none.mcap: cannot be read: "),
        (["note.mcap", "-o", "new.json"], "note.mcap: is no MCAP log, or is not whole"),
        (["walk-gaps.c3d", "-o", "new.json"], "walk-gaps.c3d: is no MCAP log, or is not whole"),
        (["walk.mcap", "-o", "walk.mcap"], "walk.mcap: is the input itself; give another name"),
    ] {
        let ran = lab.run(&[&["layout"][..], &arguments].concat());
        assert!(ran.code == 1 && ran.err.starts_with(&format!("mocap-repair: {told}")), "{arguments:?}: {ran:?}");
    }
    assert_eq!(lab.new_since(&before), ["note.mcap"]);
    lab.run(&["layout", "walk.mcap", "-o", "layout.json", "--force"]).with_code(0);
}

#[test]
fn somebody_elses_log_is_recognised() {
    let lab = Lab::empty();
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut writer = mcap::Writer::new(&mut bytes).unwrap();
    writer.finish().unwrap();
    drop(writer);
    lab.write("other.mcap", bytes.into_inner());
    let ran = lab.run(&["layout", "other.mcap", "-o", "layout.json"]);
    assert!(ran.code == 1 && ran.err.contains("is an MCAP file, but not the log of a repair"), "{ran:?}");
}
