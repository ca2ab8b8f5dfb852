//! What is told of a plan, and of a run at its end.

use super::ledger::{Ended, Stop};
use super::planning::Planned;
use super::sources::Findings;
use crate::report::{count, lines};
use crate::typeset::{Style, rounded};
use serde::Serialize;
use std::path::Path;
use std::time::Duration;

/// So many names are shown; `--json` has them all.
const MOST_NAMES: usize = 8;

/// What is said of takes without a hash.
const UNREAD: &str = "cannot be read at the moment; it is planned, and a run will try";

/// A size for people.
pub fn size(bytes: u64) -> String {
    let units = ["bytes", "kB", "MB", "GB", "TB", "PB"];
    let mut value = bytes as f64;
    let mut at = 0;
    while value >= 999.5 && at + 1 < units.len() {
        value /= 1000.0;
        at += 1;
    }
    if at == 0 || value >= 99.5 { format!("{value:.0} {}", units[at]) } else { format!("{value:.1} {}", units[at]) }
}

/// What was planned, for people.
pub fn plan_text(planned: &Planned, findings: &Findings, path: &Path, style: &Style) -> String {
    let header = &planned.header;
    let mut text = style.way(&header.sources.join(", "), &path.display().to_string());
    text += &style.item("takes", &format!("{}, {}", count(header.takes as usize, "take"), size(header.bytes)));
    if !findings.others.is_empty() {
        let others = findings.others.iter().map(|(extension, number)| format!("{extension} {number}")).collect::<Vec<_>>().join(", ");
        text += &style.item("left out", &format!("files that are no takes: {}", formats::printable(&others)));
    }
    for output in &findings.outputs {
        text += &style.item("left out", &format!("{}, which is the output of a batch", output.display()));
    }
    if planned.copies > 0 {
        text += &style.item("copies", &format!("{} with the content of another one", count(planned.copies as usize, "take")));
    }
    if !planned.renamed.is_empty() {
        let also = "would be one file with another on some file systems, or have very long names, so their outputs get names of their own";
        text += &style.item("renamed", &format!("{} {also}:", count(planned.renamed.len(), "take")));
        for (from, to) in planned.renamed.iter().take(MOST_NAMES) {
            text += &style.name("", &formats::printable(&format!("{from} -> {to}")));
        }
        text += &more(planned.renamed.len(), style);
    }
    let troubles: Vec<String> = planned
        .problems
        .iter()
        .map(|take| format!("{}: {}", take.path, take.problem.as_deref().unwrap_or_default()))
        .chain(planned.unread.iter().map(|path| format!("{path}: {UNREAD}")))
        .chain(findings.unreadable.iter().cloned())
        .collect();
    for trouble in troubles.iter().take(MOST_NAMES) {
        text += &style.item("look at", &formats::printable(trouble));
    }
    text + &more(troubles.len(), style)
}

fn more(all: usize, style: &Style) -> String {
    if all > MOST_NAMES { style.item("", &format!("and {} more; --json has them all", all - MOST_NAMES)) } else { String::new() }
}

/// What was planned, for scripts.
pub fn plan_json(planned: &Planned, findings: &Findings, path: &Path) -> String {
    #[derive(Serialize)]
    #[serde(tag = "message_type", rename_all = "snake_case")]
    enum Message<'a> {
        Renamed { path: &'a str, output: &'a str },
        Problem { path: Option<&'a str>, text: &'a str },
        LeftOut { extension: &'a str, files: u64 },
        Planned { plan: String, takes: u64, bytes: u64, copies: u64, renamed: usize, problems: usize, config_sha256: &'a str },
    }
    let mut messages: Vec<Message> = planned.renamed.iter().map(|(path, output)| Message::Renamed { path, output }).collect();
    messages.extend(
        planned.problems.iter().map(|take| Message::Problem { path: Some(&take.path), text: take.problem.as_deref().unwrap_or_default() }),
    );
    messages.extend(planned.unread.iter().map(|path| Message::Problem { path: Some(path), text: UNREAD }));
    messages.extend(findings.unreadable.iter().map(|text| Message::Problem { path: None, text }));
    messages.extend(findings.others.iter().map(|(extension, files)| Message::LeftOut { extension, files: *files }));
    messages.push(Message::Planned {
        plan: path.display().to_string(),
        takes: planned.header.takes,
        bytes: planned.header.bytes,
        copies: planned.copies,
        renamed: planned.renamed.len(),
        problems: planned.problems.len() + planned.unread.len() + findings.unreadable.len(),
        config_sha256: &planned.header.config_sha256,
    });
    lines(&messages)
}

/// How a run ended, for people. `why`: why it stopped, if it did.
pub fn run_text(ended: &Ended, why: &str, from: &str, to: &str, took: Duration, style: &Style) -> String {
    let mut text = style.way(from, to);
    let all = ended.done + ended.skipped + ended.quarantined + ended.failed;
    let mut parts = vec![format!("{} repaired", ended.done)];
    for (number, what) in [(ended.skipped, "done before"), (ended.quarantined, "put aside"), (ended.failed, "failed")] {
        if number > 0 {
            parts.push(format!("{number} {what}"));
        }
    }
    text += &style.item("takes", &format!("{}: {}", count(all as usize, "take"), parts.join(", ")));
    if ended.remarked > 0 {
        text += &style.item("look at", &format!("{} with gaps left open or something assumed; batch report shows them", ended.remarked));
    }
    let secs = took.as_secs_f64();
    let ran = ended.done + ended.quarantined + ended.failed;
    let speed = if ran > 0 && secs > 0.0 { format!(", {:.2} takes/s", ran as f64 / secs) } else { String::new() };
    text += &style.item("time", &if secs < 1.0 { format!("below 1 s{speed}") } else { format!("{}{speed}", rounded(secs)) });
    let why = formats::printable(why);
    let stopped = match ended.stop {
        Stop::Complete => return text,
        Stop::Interrupted => "interrupted; the same command goes on".to_owned(),
        Stop::DiskFull => format!("no room: {why}; make room, and the same command goes on"),
        Stop::Engine if !why.contains("the same command") => format!("{why}; the same command goes on"),
        Stop::TooManyFailures | Stop::Engine => why,
    };
    text + &style.item("stopped", &stopped)
}

/// How a run ended, for scripts.
pub fn run_json(ended: &Ended, why: &str, out: &str, took: Duration, exit_code: u8) -> String {
    #[derive(Serialize)]
    #[serde(tag = "message_type", rename = "run_ended")]
    struct Message<'a> {
        out: &'a str,
        stop: Stop,
        reason: Option<&'a str>,
        done: u64,
        remarked: u64,
        skipped: u64,
        quarantined: u64,
        failed: u64,
        elapsed_secs: f64,
        exit_code: u8,
    }
    let Ended { stop, done, remarked, skipped, quarantined, failed, .. } = *ended;
    let reason = Some(why).filter(|why| !why.is_empty());
    lines(&[Message { out, stop, reason, done, remarked, skipped, quarantined, failed, elapsed_secs: took.as_secs_f64(), exit_code }])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_short() {
        for (bytes, said) in
            [(0, "0 bytes"), (999, "999 bytes"), (1000, "1.0 kB"), (123_456, "123 kB"), (99_499_999, "99.5 MB"), (7 << 40, "7.7 TB")]
        {
            assert_eq!(size(bytes), said);
        }
    }
}
