//! What a repair did, for people.

use super::{GapReport, Report, StageReport, count, short};
use crate::gaps::Open;
use crate::solve::Stop;
use std::fmt::Write;

impl StageReport {
    /// In a few words: what it was, why and when it ended, and what came before.
    fn text(&self, before: &[Self]) -> String {
        let mut said = Vec::new();
        if self.stop != Stop::Converged.word() || self.log_likelihood.is_some() || self.iterations > 1 {
            said.push(format!("{} after {}", self.stop.replace('-', " "), count(self.iterations as usize, "iteration")));
        }
        said.extend(before.iter().map(|s| format!("{} of {} before", s.iterations, s.method)));
        if said.is_empty() { self.method.to_owned() } else { format!("{} ({})", self.method, said.join(", ")) }
    }
}

impl Report {
    /// The report for people: at most 80 columns where names allow it.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let mut line = |head: &str, text: String| {
            let _ = writeln!(out, "  {head:<10} {text}"); // writing to a String cannot fail
        };
        let seconds = self.frames as f64 / self.rate_hz;
        let how = if self.bones_stated { "stated" } else { "found" };
        line(
            "take",
            format!(
                "{} at {} Hz ({seconds:.1} s), {}, {} {how}",
                count(self.frames, "frame"),
                short(self.rate_hz),
                count(self.markers, "marker"),
                count(self.bones, "bone")
            ),
        );
        let missing = self.missing_samples();
        match self.gaps.iter().max_by_key(|g| g.frames) {
            None => line("gaps", "none".to_owned()),
            Some(longest) => {
                let share = 100.0 * missing as f64 / (self.frames * self.markers).max(1) as f64;
                line("gaps", format!("{} with {} ({share:.1} %)", self.gaps.len(), count(missing, "sample")));
                line(
                    "longest",
                    format!("{}: {}, {} to {}", count(longest.frames, "frame"), longest.marker, longest.first_frame, longest.last_frame),
                );
            }
        }
        if !self.dry_run && !self.gaps.is_empty() {
            let filled = self.gaps.len() - self.open_gaps().count();
            let by = self.stages.split_last().map_or_else(String::new, |(last, before)| format!(" by {}", last.text(before)));
            line("filled", format!("{} with {}{by}", count(filled, "gap"), count(self.samples.len(), "sample")));
            let mut sigmas: Vec<f64> = self.samples.iter().map(|s| s.sigma_mm).filter(|s| s.is_finite()).collect();
            sigmas.sort_by(f64::total_cmp);
            if let (Some(worst), Some(median)) = (sigmas.last(), sigmas.get(sigmas.len() / 2)) {
                line("expected", format!("error {median:.1} mm (median), {worst:.1} mm (worst)"));
            }
            if let Some(unmet) = self.unmet() {
                let (lengths, frames) = (count(unmet.lengths, "bone length"), count(unmet.frames, "frame"));
                line("not kept", format!("{lengths} in {frames}: they contradict each other or what was seen"));
            }
            if let Some(judged) = &self.bone_judgement {
                line(
                    "bones",
                    format!(
                        "off by {:.1} mm in filled frames (measured ones: {:.1} mm), worst {:.1} mm ({})",
                        judged.rms_mm, judged.measured_rms_mm, judged.worst_mm, judged.worst_bone
                    ),
                );
            }
        }
        let mut reasons: Vec<(Open, Vec<&GapReport>)> = Vec::new();
        for gap in self.open_gaps() {
            if let Some(why) = gap.why {
                match reasons.iter_mut().find(|(r, _)| *r == why) {
                    Some((_, gaps)) => gaps.push(gap),
                    None => reasons.push((why, vec![gap])),
                }
            }
        }
        reasons.sort_by_key(|(why, _)| *why);
        for (why, gaps) in reasons {
            let verb = if self.dry_run { "would stay" } else { "left" };
            line("open", format!("{} {verb} open: {}", count(gaps.len(), "gap"), why.reason()));
            let mut names: Vec<&str> = gaps.iter().map(|g| g.marker.as_str()).collect();
            names.dedup();
            let more = names.len().saturating_sub(12);
            let shown = names.iter().take(12).copied().collect::<Vec<_>>().join(" ");
            line("", if more > 0 { format!("{shown} and {more} more") } else { shown });
        }
        for note in &self.notes {
            line(if note.matters() { "look at" } else { "note" }, note.to_string());
        }
        if let Some(log) = &self.log {
            line("log", log.display().to_string());
        }
        if let Some(fills) = &self.fills {
            line("fills", fills.display().to_string());
        }
        if let Some(error) = &self.log_error {
            line("no log", error.clone());
        }
        let head = match &self.output {
            Some(output) => format!("{} -> {}", self.input.display(), output.display()),
            None => format!("{} (dry run, nothing was written)", self.input.display()),
        };
        format!("{head}\n{out}")
    }
}
