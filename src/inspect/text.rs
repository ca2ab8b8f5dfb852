//! What is in a take, for people: what they ask first, and where the gaps are.

use super::Inspection;
use super::map::Map;
use crate::report::{count, short};
use crate::typeset::{Style, Tone, table};

/// Unless all are wanted, so many gaps are listed, the longest ones ...
const MOST_GAPS: usize = 10;

/// ... so many suspects ...
const MOST_SUSPECTS: usize = 10;

/// ... and so many markers drawn.
const MOST_MARKERS: usize = 60;

/// Labels of markers without gaps, at most.
const MOST_LABELS: usize = 60;

impl Inspection {
    /// For people. `all`: every marker with gaps, every gap and every bone, however many.
    pub fn text(&self, style: &Style, all: bool) -> String {
        let mut out = style.toned(Tone::Title, &self.file) + "\n";
        out.push_str(&style.sentence(&format!(
            "{}, {} frames from {} at {} Hz ({:.2} s), in {}{}",
            self.format,
            self.frames,
            self.first_frame,
            short(self.rate_hz),
            self.duration_s,
            self.unit,
            self.up.as_ref().map_or_else(|| ", up not stated".to_owned(), |up| format!(", {up} up"))
        )));
        let samples = self.frames * self.markers.len();
        out.push_str(&style.sentence(&format!(
            "{} markers, {} gaps, {} of {samples} samples missing ({:.2} %), {} bones",
            self.markers.len(),
            self.gaps.len(),
            self.samples_missing,
            100.0 * self.samples_missing as f64 / samples.max(1) as f64,
            self.bones.len()
        )));
        if self.model_outputs > 0 {
            out.push_str(&style.sentence(&format!("{} model outputs, which are no markers", self.model_outputs)));
        }
        if self.samples_derived > 0 {
            let derived = format!("{} samples were filled or filtered by someone else, says the file", self.samples_derived);
            out.push_str(&style.sentence(&derived));
        }
        for note in &self.notes {
            out.push_str(&style.item(if note.matters { "look at" } else { "note" }, &note.text));
        }
        let shown = if all { self.suspects.len() } else { MOST_SUSPECTS };
        for suspect in self.suspects.iter().take(shown) {
            out.push_str(&style.item("suspect", &format!("{}: {}", suspect.kind, suspect.text)));
        }
        if self.suspects.len() > shown {
            out.push_str(&style.item("", &format!("and {} more (--all shows them)", self.suspects.len() - shown)));
        }
        if !self.gaps.is_empty() {
            out.push('\n');
            out.push_str(&self.map(all).text(style));
        }
        out.push_str(&self.whole_markers(style, all));
        out.push_str(&self.gaps_text(style, all));
        out.push_str(&self.bones_text(style, all));
        out
    }

    /// The markers with gaps: in the file's order, or worst first where they are too many.
    fn map(&self, all: bool) -> Map<'_> {
        let mut map = Map::new(self.frames, self.first_frame, self.markers.len());
        for (at, marker) in self.markers.iter().enumerate().filter(|(_, m)| m.gaps > 0) {
            let from = self.gaps.partition_point(|g| g.at < at);
            let own = self.gaps[from..].iter().take_while(|g| g.at == at);
            let stretches = own.map(|g| ((g.first_frame - self.first_frame) as usize, (g.last_frame - self.first_frame + 1) as usize));
            map.add(&marker.label, stretches.collect());
        }
        if !all {
            map.keep_worst(MOST_MARKERS);
        }
        map
    }

    /// One line for the markers that need nothing.
    fn whole_markers(&self, style: &Style, all: bool) -> String {
        let labels: Vec<&str> = self.markers.iter().filter(|m| m.gaps == 0).map(|m| m.label.as_str()).collect();
        if labels.is_empty() {
            return String::new();
        }
        let shown = if all { labels.len() } else { MOST_LABELS.min(labels.len()) };
        let more = if labels.len() > shown { format!(" and {} more", labels.len() - shown) } else { String::new() };
        let head = if self.gaps.is_empty() { "no gaps" } else { "without gaps" };
        format!("\n{}", style.sentence(&format!("{head} ({}): {}{more}", labels.len(), labels[..shown].join(" "))))
    }

    fn gaps_text(&self, style: &Style, all: bool) -> String {
        if self.gaps.is_empty() {
            return String::new();
        }
        let mut gaps: Vec<_> = self.gaps.iter().collect();
        let shown = if all { gaps.len() } else { MOST_GAPS.min(gaps.len()) };
        if !all {
            gaps.sort_by_key(|g| std::cmp::Reverse(g.frames));
        }
        let cells = |g: &&super::GapLine| vec![g.marker.clone(), g.first_frame.to_string(), g.last_frame.to_string(), g.frames.to_string()];
        let rows: Vec<Vec<String>> = gaps[..shown].iter().map(cells).collect();
        let title = if all { "gap of" } else { "longest gaps" };
        let mut out = titled(&table(&[title, "first", "last", "frames"], &rows, style, &[]), style);
        if gaps.len() > shown {
            let more = format!("  and {} more (--all lists them)", count(gaps.len() - shown, "gap"));
            out.push_str(&style.toned(Tone::Quiet, &more));
            out.push('\n');
        }
        out
    }

    fn bones_text(&self, style: &Style, all: bool) -> String {
        let mut spreads: Vec<f64> = self.bones.iter().map(|b| b.spread_mm).collect();
        spreads.sort_by(f64::total_cmp);
        let (Some(least), Some(most), median) = (spreads.first(), spreads.last(), spreads.get(spreads.len() / 2)) else {
            return String::new();
        };
        if all {
            let cells =
                self.bones.iter().map(|b| vec![format!("{}-{}", b.a, b.b), format!("{:.1}", b.length_mm), format!("{:.2}", b.spread_mm)]);
            return titled(&table(&["bone", "length mm", "spread mm"], &cells.collect::<Vec<_>>(), style, &[]), style);
        }
        let median = median.copied().unwrap_or_default();
        let said = format!(
            "{}, whose lengths spread by {least:.1} to {most:.1} mm (median {median:.1} mm); mocap-repair bones prints them",
            count(self.bones.len(), "bone")
        );
        format!("\n{}", style.sentence(&said))
    }
}

/// A table after an empty line, its titles quiet.
fn titled(lines: &[String], style: &Style) -> String {
    let mut out = String::from("\n");
    for (at, line) in lines.iter().enumerate() {
        out.push_str(&if at == 0 { style.toned(Tone::Quiet, line) } else { line.clone() });
        out.push('\n');
    }
    out
}
