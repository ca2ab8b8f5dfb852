//! The gap map: markers × time in characters, each as dark as the share of its frames in which the marker is missing.

use crate::report::count;
use crate::typeset::{Style, Tone, columns};

/// Labels take this many columns at most, and this share of the width.
const MOST_LABEL: usize = 20;

/// Below this many columns only the share stands beside the map.
const ROOM_FOR_FIGURES: usize = 64;

/// What is drawn.
pub(super) struct Map<'a> {
    frames: usize,
    first_frame: i64,
    /// Number of markers, those without gaps as well.
    markers: usize,
    rows: Vec<Row<'a>>,
    /// Number of markers missing in each frame.
    missing: Vec<usize>,
    /// Markers with gaps that are not drawn, and their gaps.
    left_out: (usize, usize),
}

struct Row<'a> {
    label: &'a str,
    /// Half-open, counted from 0, ascending.
    gaps: Vec<(usize, usize)>,
}

impl Row<'_> {
    fn missing(&self) -> usize {
        self.gaps.iter().map(|(start, end)| end - start).sum()
    }

    /// Missing frames within `start..end`.
    fn within(&self, start: usize, end: usize) -> usize {
        self.gaps.iter().map(|gap| gap.1.min(end).saturating_sub(gap.0.max(start))).sum()
    }
}

/// Characters of growing darkness: nothing missing, up to a quarter, up to a half, more, all.
fn shades(ascii: bool) -> [char; 5] {
    if ascii { [' ', '.', ':', '+', '#'] } else { [' ', '░', '▒', '▓', '█'] }
}

/// Characters of growing height.
fn heights(ascii: bool) -> &'static [char] {
    if ascii { &['.', ':', '+', '#'] } else { &['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'] }
}

/// How dark a cell is of whose `all` frames so many are missing. Dark only if all are, and light only if none is.
fn shade(missing: usize, all: usize) -> usize {
    match missing {
        0 => 0,
        m if m == all => 4,
        m if 4 * m <= all => 1,
        m if 2 * m <= all => 2,
        _ => 3,
    }
}

impl<'a> Map<'a> {
    pub fn new(frames: usize, first_frame: i64, markers: usize) -> Self {
        Self { frames, first_frame, markers, rows: Vec::new(), missing: vec![0; frames], left_out: (0, 0) }
    }

    /// Adds a marker with its gaps: half-open, counted from 0, ascending.
    pub fn add(&mut self, label: &'a str, gaps: Vec<(usize, usize)>) {
        for &(start, end) in &gaps {
            for missing in &mut self.missing[start..end] {
                *missing += 1;
            }
        }
        self.rows.push(Row { label, gaps });
    }

    /// If there are more markers than that, those that miss most, in that order; the rest is counted.
    pub fn keep_worst(&mut self, most: usize) {
        if self.rows.len() > most {
            self.rows.sort_by_key(|row| std::cmp::Reverse(row.missing()));
            let rest = self.rows.split_off(most);
            self.left_out = (rest.len(), rest.iter().map(|row| row.gaps.len()).sum());
        }
    }

    /// The map with its axis, as wide as there is room.
    pub fn text(&self, style: &Style) -> String {
        let longest = self.rows.iter().map(|row| columns(row.label)).max().unwrap_or(0);
        let label = longest.clamp(7, MOST_LABEL.min(style.columns / 4));
        let roomy = style.columns >= ROOM_FOR_FIGURES;
        let figures = if roomy { 24 } else { 9 };
        let room = style.columns.saturating_sub(2 + label + 2 + figures).max(10);
        let cells = room.min(self.frames);
        let ends: Vec<usize> = (0..=cells).map(|c| c * self.frames / cells).collect();
        let (shades, heights) = (shades(style.ascii), heights(style.ascii));
        let set = |name: &str, drawn: &str, figures: &str, tone: Option<Tone>| {
            let (name, blank) = (tail(name, label, style.ascii), " ".repeat(label.saturating_sub(columns(name))));
            let line = format!("  {name}{blank}  {drawn}  {figures}");
            tone.map_or_else(|| line.trim_end().to_owned(), |tone| style.toned(tone, line.trim_end())) + "\n"
        };

        let peak = self.missing.iter().max().copied().unwrap_or(0);
        let means: Vec<f64> =
            ends.windows(2).map(|w| self.missing[w[0]..w[1]].iter().sum::<usize>() as f64 / (w[1] - w[0]) as f64).collect();
        let highest = means.iter().copied().fold(0.0, f64::max);
        let height = |mean: f64| ((mean / highest * heights.len() as f64).ceil() as usize).clamp(1, heights.len()) - 1;
        let curve: String = means.iter().map(|&mean| if mean > 0.0 { heights[height(mean)] } else { ' ' }).collect();
        let mut out = String::new();
        let titles = if roomy { "missing  gaps  longest" } else { "missing" };
        out.push_str(&set("", &" ".repeat(cells), titles, Some(Tone::Quiet)));
        let at_most = format!("{peak} of {}", self.markers);
        out.push_str(&set("markers", &curve, &if roomy { format!("at most {at_most}") } else { format!("max {peak}") }, None));
        for row in &self.rows {
            let drawn: String = ends.windows(2).map(|w| shades[shade(row.within(w[0], w[1]), w[1] - w[0])]).collect();
            let share = 100.0 * row.missing() as f64 / self.frames as f64;
            let gap = row.gaps.iter().map(|(start, end)| end - start).max().unwrap_or(0);
            let figures = if roomy { format!("{share:>5.1} %  {:>4}  {gap:>7}", row.gaps.len()) } else { format!("{share:>4.1} %") };
            out.push_str(&set(row.label, &drawn, &figures, None));
        }
        for line in self.axis(&ends, style.ascii) {
            out.push_str(&set("", &line, "", Some(Tone::Quiet)));
        }
        let [_, some, half, more, whole] = shades;
        let each = format!("{:.1}", self.frames as f64 / cells as f64);
        let each = count_of(each.strip_suffix(".0").unwrap_or(&each));
        let legend = format!("{some} up to 25 %, {half} up to 50 %, {more} more, {whole} all missing of {each} a column");
        out.push_str(&style.toned(Tone::Quiet, &style.sentence(&legend)));
        if self.left_out.0 > 0 {
            let (markers, gaps) = (count(self.left_out.0, "marker"), count(self.left_out.1, "gap"));
            out.push_str(&style.sentence(&format!("worst markers first; {markers} more with {gaps} (--all shows them)")));
        }
        out
    }

    /// Two lines under the map: marks, and the file's own frame numbers that begin there.
    fn axis(&self, ends: &[usize], ascii: bool) -> [String; 2] {
        let cells = ends.len() - 1;
        let last = self.first_frame + self.frames as i64 - 1;
        let apart = last.to_string().len() + 3;
        let step = nice((self.frames * apart).div_ceil(cells) as i64);
        // the first frame, then round numbers; a number that would run into the next one or out of the map is left out
        let round = (self.first_frame.div_euclid(step) + 1..=last.div_euclid(step)).map(|k| k * step);
        let (mut marks, mut numbers) = (vec![if ascii { '-' } else { '─' }; cells], vec![' '; cells]);
        let mut free = 0;
        for frame in std::iter::once(self.first_frame).chain(round) {
            let index = (frame - self.first_frame) as usize;
            let cell = ends.partition_point(|&end| end <= index) - 1;
            let text = frame.to_string();
            if cell < free || cell + text.len() > cells {
                continue;
            }
            marks[cell] = if ascii { '+' } else { '┬' };
            for (at, c) in text.chars().enumerate() {
                numbers[cell + at] = c;
            }
            free = cell + text.len() + 1;
        }
        [marks, numbers].map(|line| line.into_iter().collect())
    }
}

fn count_of(number: &str) -> String {
    format!("{number} {}", if number == "1" { "frame" } else { "frames" })
}

/// The smallest of 1, 2, 5, 10, 20, 50 ... that is no less than `least`.
fn nice(least: i64) -> i64 {
    let mut ten = 1;
    loop {
        for step in [ten, 2 * ten, 5 * ten] {
            if step >= least {
                return step;
            }
        }
        ten *= 10;
    }
}

/// The end of a label if it is too long: that is where labels differ.
fn tail(label: &str, width: usize, ascii: bool) -> String {
    if columns(label) <= width {
        return label.to_owned();
    }
    let (mut kept, mut used) = (Vec::new(), 1);
    for c in label.chars().rev() {
        used += columns(c.encode_utf8(&mut [0; 4]));
        if used > width {
            break;
        }
        kept.push(c);
    }
    kept.push(if ascii { '~' } else { '…' });
    kept.iter().rev().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> Map<'static> {
        let mut map = Map::new(100, 1, 3);
        map.add("subject:LKNE", vec![(0, 10), (50, 52)]);
        map.add("RTOE", vec![(40, 100)]);
        map
    }

    #[test]
    fn the_map_is_drawn() {
        let drawn = map().text(&Style { columns: 67, ..Style::plain() });
        let expected = "
                                             missing  gaps  longest
  markers       ▆▆▅        ▆▆██▆▆▆▆▆▆▆▆▆▆▆▆  at most 2 of 3
  subject:LKNE  ██▓          ▒░               12.0 %     2       10
  RTOE                     ████████████████   60.0 %     1       60
                ┬────────────┬─────────────
                1            50
  ░ up to 25 %, ▒ up to 50 %, ▓ more, █ all missing of 3.7 frames
    a column
";
        assert_eq!(format!("\n{drawn}"), expected, "{drawn}");
    }

    #[test]
    fn no_line_is_wider_than_the_terminal() {
        for wide in [40, 63, 64, 80, 200] {
            for ascii in [false, true] {
                let style = Style { columns: wide, ascii, colour: false };
                let drawn = map().text(&style);
                assert!(drawn.lines().all(|line| columns(line) <= wide), "{wide}\n{drawn}");
                assert!(!ascii || drawn.is_ascii(), "{drawn}");
            }
        }
    }

    #[test]
    fn cells_are_dark_only_if_all_is_missing() {
        for (missing, all, dark) in [(0, 8, 0), (1, 800, 1), (2, 8, 1), (3, 8, 2), (4, 8, 2), (5, 8, 3), (7, 8, 3), (8, 8, 4), (1, 1, 4)] {
            assert_eq!(shade(missing, all), dark, "{missing} of {all}");
        }
    }

    #[test]
    fn the_axis_has_the_frame_numbers_of_the_file() {
        let ends = |frames: usize, cells: usize| (0..=cells).map(|c| c * frames / cells).collect::<Vec<_>>();
        let axis = |frames, first, cells| Map::new(frames, first, 1).axis(&ends(frames, cells), true);
        assert_eq!(axis(100, 1, 30), ["+----+-----+-----+-----+------", "1    20    40    60    80     "]);
        assert_eq!(axis(100, 990, 12), ["+-----------", "990         "]);
        assert_eq!(axis(3, -1, 3), ["+--", "-1 "]);
    }

    #[test]
    fn the_worst_are_kept_and_the_rest_is_counted() {
        let mut map = map();
        map.keep_worst(1);
        assert_eq!((map.rows[0].label, map.left_out), ("RTOE", (1, 2)));
        assert!(map.text(&Style::plain()).contains("1 marker more with 2 gaps (--all shows them)"));
    }

    #[test]
    fn labels_keep_their_ends() {
        assert_eq!((tail("subject:LKNE", 7, false), tail("LKNE", 7, true)), ("…t:LKNE".to_owned(), "LKNE".to_owned()));
    }
}
