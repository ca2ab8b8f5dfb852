//! What a repair did, for people.

use super::{GapReport, Report, StageReport, count, short};
use crate::gaps::Open;
use crate::suspects;
use crate::typeset::{Style, Tone, cut, table};

/// The table of markers has so many rows at most.
const MOST_ROWS: usize = 12;

/// Columns that a label may take; the report to look at and `--json` have the whole.
const NAME: usize = 32;

impl StageReport {
    /// In a few words: what it was, why and when it ended, and what came before.
    fn text(&self, before: &[Self]) -> String {
        let mut said = Vec::new();
        if !self.settled || self.log_likelihood.is_some() || self.iterations > 1 {
            said.push(format!("{} after {}", self.stop.replace('-', " "), count(self.iterations as usize, "iteration")));
        }
        said.extend(before.iter().map(|s| format!("{} of {} before", s.iterations, s.method)));
        if said.is_empty() { self.method.to_owned() } else { format!("{} ({})", self.method, said.join(", ")) }
    }
}

/// The gaps of one marker.
struct Row<'a> {
    marker: &'a str,
    column: usize,
    gaps: usize,
    samples: usize,
    longest: usize,
    worst_sigma_mm: Option<f64>,
    open: usize,
}

impl<'a> Row<'a> {
    /// One row for each marker with gaps, worst first: gaps that stay open, then how unsure, then how long.
    fn all(gaps: &'a [GapReport]) -> Vec<Self> {
        let mut rows: Vec<Self> = Vec::new();
        for gap in gaps {
            if rows.last().is_none_or(|row| row.column != gap.column) {
                rows.push(Self { marker: &gap.marker, column: gap.column, gaps: 0, samples: 0, longest: 0, worst_sigma_mm: None, open: 0 });
            }
            if let Some(row) = rows.last_mut() {
                row.gaps += 1;
                row.samples += gap.frames;
                row.longest = row.longest.max(gap.frames);
                row.worst_sigma_mm = [row.worst_sigma_mm, gap.worst_sigma_mm].into_iter().flatten().reduce(f64::max);
                row.open += usize::from(gap.open.is_some());
            }
        }
        let sigma = |row: &Self| row.worst_sigma_mm.unwrap_or(0.0);
        rows.sort_by(|a, b| b.open.cmp(&a.open).then(sigma(b).total_cmp(&sigma(a))).then(b.longest.cmp(&a.longest)));
        rows
    }
}

impl Report {
    /// The report for people: at most 80 columns where single names allow it.
    pub fn text(&self, style: &Style) -> String {
        let mut out = String::new();
        let name = |label: &str| cut(label, NAME, style.ascii);
        let mut line = |head: &str, text: String| out.push_str(&style.item(head, &text));
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
        for (head, told) in suspects::text(&self.suspects, self.dry_run) {
            line(head, told);
        }
        let missing = self.missing_samples();
        match self.gaps.iter().max_by_key(|g| g.frames) {
            None => line("gaps", "none".to_owned()),
            Some(longest) => {
                let share = 100.0 * missing as f64 / (self.frames * self.markers).max(1) as f64;
                line("gaps", format!("{} with {} ({share:.1} %)", self.gaps.len(), count(missing, "sample")));
                line(
                    "longest",
                    format!(
                        "{}: {}, {} to {}",
                        count(longest.frames, "frame"),
                        name(&longest.marker),
                        longest.first_frame,
                        longest.last_frame
                    ),
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
                        judged.rms_mm,
                        judged.measured_rms_mm,
                        judged.worst_mm,
                        cut(&judged.worst_bone, 2 * NAME + 1, style.ascii)
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
            let shown = names.iter().take(12).map(|label| name(label)).collect::<Vec<_>>().join(" ");
            line("", if more > 0 { format!("{shown} and {more} more") } else { shown });
        }
        for note in &self.notes {
            line(if note.matters() { "look at" } else { "note" }, note.to_string());
        }
        if let Some(error) = &self.log_error {
            line("no log", error.clone());
        }
        for (head, path) in [("log", &self.log), ("fills", &self.fills), ("report", &self.page)] {
            out.extend(path.iter().map(|path| style.name(head, &path.display().to_string())));
        }
        let input = self.input.display().to_string();
        let head = match &self.output {
            Some(output) => style.way(&input, &output.display().to_string()),
            None => style.toned(Tone::Title, &format!("{input} (dry run, nothing was written)")) + "\n",
        };
        format!("{head}{out}{}", self.markers_text(style))
    }

    /// The table of markers with gaps; nothing for a take without.
    fn markers_text(&self, style: &Style) -> String {
        let rows = Row::all(&self.gaps);
        let Some(sure) = (!rows.is_empty()).then(|| rows.iter().any(|row| row.worst_sigma_mm.is_some())) else {
            return String::new();
        };
        let titles = ["marker", "gaps", "samples", "longest", "worst mm", "open"];
        let cells: Vec<Vec<String>> = rows
            .iter()
            .take(MOST_ROWS)
            .map(|row| {
                let some = |n: usize| if n > 0 { n.to_string() } else { "-".to_owned() };
                vec![
                    row.marker.to_owned(),
                    row.gaps.to_string(),
                    row.samples.to_string(),
                    row.longest.to_string(),
                    row.worst_sigma_mm.map_or_else(|| "-".to_owned(), |sigma| format!("{sigma:.1}")),
                    some(row.open),
                ]
            })
            .collect();
        // what nobody can say, or nothing is said about, needs no column
        let silent: Vec<usize> =
            [(4, sure), (5, rows.iter().any(|row| row.open > 0))].iter().filter(|(_, any)| !any).map(|(c, _)| *c).collect();
        let keep = |row: &[String]| row.iter().enumerate().filter(|(c, _)| !silent.contains(c)).map(|(_, cell)| cell.clone()).collect();
        let titles: Vec<&str> = titles.iter().enumerate().filter(|(c, _)| !silent.contains(c)).map(|(_, title)| *title).collect();
        let kept: Vec<Vec<String>> = cells.iter().map(|row| keep(row)).collect();
        let lines = table(&titles, &kept, style, &[2, 1]);
        let mut out = String::from("\n");
        for (at, line) in lines.iter().enumerate() {
            let tone = match at.checked_sub(1).map(|row| rows[row].open) {
                None => Some(Tone::Quiet),
                Some(open) if open > 0 => Some(Tone::Alarm),
                Some(_) => None,
            };
            out.push_str(&tone.map_or_else(|| line.clone(), |tone| style.toned(tone, line)));
            out.push('\n');
        }
        let rest = &rows[rows.len().min(MOST_ROWS)..];
        if !rest.is_empty() {
            let gaps = rest.iter().map(|row| row.gaps).sum();
            out.push_str(&style.toned(Tone::Quiet, &format!("  and {} more with {}", count(rest.len(), "marker"), count(gaps, "gap"))));
            out.push('\n');
        }
        out
    }
}
