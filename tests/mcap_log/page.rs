//! The report to look at, made of a log and of what the log was made of.

use super::frames::{BONES, FILLED, raw, repaired};
use super::{about, drive, scripts};
use formats::{Direction, Origin, TakeBuilder};
use mocap_repair::log::{About, Attachment, Closing, Ended, McapLog, Shown, Up, attachment};
use mocap_repair::page::{Curves, Page, State};
use std::path::PathBuf;
use tempfile::TempDir;

const REPORT: &str = concat!(
    r#"{"message_type":"note","kind":"k","text":"</script><!-- é","matters":true}"#,
    "\n",
    r#"{"message_type":"gap","gap":1,"marker":"S:A","first_frame":102,"last_frame":102,"frames":1,"worst_sigma_mm":20.123456789012345}"#,
    "\n",
    r#"{"message_type":"gap","gap":2,"marker":"S:B","first_frame":103,"last_frame":103,"frames":1,"open":"too-long"}"#,
    "\n",
    r#"{"message_type":"suspect","kind":"swap","marker":"S:A","with":"S:B","column":0,"with_column":1,"first_frame":101,"last_frame":104,"samples":3,"size_mm":400.5,"dropped":false,"ignored":false,"text":"t"}"#,
    "\n",
    r#"{"message_type":"from_tomorrow","text":"not known yet"}"#,
    "\n",
    r#"{"message_type":"summary","format":"c3d","samples_missing":2,"samples_filled":1,"gaps_left_open":1,"stages":[{"method":"lds","stop":"converged","iterations":3}],"bone_judgement":null}"#,
    "\n",
);

/// A log of `closing`, and what the page needs of it.
fn log(closing: &Closing<'_>) -> (TempDir, PathBuf, About, Curves) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.mcap");
    let about = About { up: Up::Guessed(Direction::PLUS_Y), ..about() };
    let mut log = McapLog::create(&path, about.clone()).unwrap();
    let mut curves = Curves::default();
    drive(&mut log, scripts());
    drive(&mut curves, scripts());
    log.finish(closing).unwrap();
    (folder, path, about, curves)
}

fn report() -> Attachment {
    Attachment { name: "report.jsonl".into(), media_type: "application/jsonl".into(), bytes: REPORT.into() }
}

#[test]
fn a_page_of_a_log_is_the_page_of_its_repair() {
    // what was read and what was written differ in a sample that was dropped, too
    let (mut raw, repaired) = (TakeBuilder::from(raw()), repaired());
    raw.set(1, 0, [900.0, 1.0, -250.0], Origin::Measured);
    let raw = raw.build();
    let shown = Shown { raw: &raw, repaired: Some(&repaired), bones: &BONES, samples: &[FILLED], log_rate_hz: None };
    let (_folder, path, about, curves) = log(&Closing { attachments: vec![report()], shown: Some(shown), ..Closing::default() });
    let of_log = Page::of_log(&path).unwrap();
    let of_repair = Page::of_repair(&about, shown, REPORT, &curves).unwrap();
    assert_eq!(of_log, of_repair);
    assert_eq!(of_log.write(), of_repair.write());

    assert_eq!(of_log.take.markers, ["S:A", "S:B", "S:B (2)"], "model outputs are no markers");
    assert_eq!((of_log.take.up.as_deref(), of_log.take.up_guessed), (Some("+y"), true));
    assert_eq!(of_log.positions.tracks[0].at[1], [30, 10, -2500]);
    assert_eq!(of_log.positions.tracks[0].sigma, [Some(2000)]);
    assert_eq!(of_log.positions.raw, [(0, 1, [9000, 10, -2500])]);
    assert_eq!(of_log.positions.tracks[1].states, [State::Observed, State::Observed, State::Missing, State::Observed]);
    let gaps: Vec<_> = of_log.gaps.iter().map(|g| (g.marker, g.start, g.frames, g.open.as_deref(), g.sigma_mm)).collect();
    assert_eq!(gaps, [(0, 1, 1, None, Some(20.123_456_789_012_345)), (1, 2, 1, Some("too-long"), None)]);
    let swap = &of_log.suspects[0];
    assert_eq!((swap.marker, swap.other, swap.start, swap.frames), (0, Some(1), 0, 4));
    assert!(!of_log.curves.is_empty() && of_log.curves.iter().all(|c| !c.iterations.is_empty()));
}

#[test]
fn a_repair_that_came_to_nothing_has_a_page_that_says_so() {
    let raw = raw();
    let shown = Shown { raw: &raw, repaired: None, bones: &BONES, samples: &[], log_rate_hz: None };
    let (_folder, path, ..) = log(&Closing { ended: Ended::Interrupted, shown: Some(shown), ..Closing::default() });
    let page = Page::of_log(&path).unwrap();
    assert_eq!(page.notes[0].text, "the repair was interrupted, no take was written");
    assert_eq!(page.positions.frames, [0, 1, 2, 3]);
    assert_eq!(page.positions.tracks[2].at[3], [10_000, 30, -2500]);
    assert!(page.gaps.iter().all(|gap| gap.open.as_deref() == Some("interrupted")) && page.gaps.len() == 2);
}

#[test]
fn a_log_without_a_take_has_no_page() {
    let (_folder, path, ..) = log(&Closing::default());
    let told = Page::of_log(&path).unwrap_err().to_string();
    assert!(told.contains("it has no attachment called take.json"), "{told}");
}

#[test]
fn a_report_of_another_take_is_noticed() {
    let raw = raw();
    let shown = Shown { raw: &raw, repaired: None, bones: &BONES, samples: &[], log_rate_hz: None };
    let mut other = report();
    other.bytes = REPORT.replace(r#""frames":1"#, r#""frames":2"#).into();
    let (_folder, path, ..) = log(&Closing { attachments: vec![other], shown: Some(shown), ..Closing::default() });
    let told = Page::of_log(&path).unwrap_err().to_string();
    assert!(told.contains("the report tells of 2 gaps"), "{told}");
}

#[test]
fn a_take_that_no_clock_can_play_has_no_page() {
    let raw = raw();
    let shown = Shown { raw: &raw, repaired: None, bones: &BONES, samples: &[], log_rate_hz: None };
    let (_folder, path, ..) = log(&Closing { attachments: vec![report()], shown: Some(shown), ..Closing::default() });
    let honest = String::from_utf8(attachment(&path, "take.json").unwrap()).unwrap();
    for (is, might_be) in [(r#""rate_hz": 59.94"#, r#""rate_hz": 0.0"#), (r#""first_frame": 101"#, r#""first_frame": 4611686018427387904"#)]
    {
        assert!(honest.contains(is), "{honest}");
        let mut crafted = report();
        crafted.name = "take.json".into();
        crafted.bytes = honest.replace(is, might_be).into();
        let (_folder, path, ..) = log(&Closing { attachments: vec![report(), crafted], shown: Some(shown), ..Closing::default() });
        let told = Page::of_log(&path).unwrap_err().to_string();
        assert!(told.contains("its take.json speaks of a rate or of frames that no take can have"), "{told}");
    }
}
