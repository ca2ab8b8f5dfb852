//! A gap before and after, as SVG: one coordinate of one marker over time.
//!
//! The picture has its own white background, so that it reads the same on light and dark pages, and it loads nothing.
//! Who repaired the take is none of its business.

use crate::solve::Gap;
use formats::Take;
use std::fmt::Write as _;
use std::ops::Range;

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 540.0;
/// Edges of both panels.
const LEFT: f64 = 84.0;
const RIGHT: f64 = WIDTH - 28.0;
const PANEL_HEIGHT: f64 = 172.0;
const PANEL_TOPS: [f64; 2] = [82.0, 308.0];
/// Seen frames on either side of the gap, in seconds: at least, at most.
const AROUND_SECS: (f64, f64) = (0.8, 1.6);

const FONT: &str = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', 'Noto Sans', 'DejaVu Sans', Arial, sans-serif";
const INK: &str = "#1c2733";
const QUIET: &str = "#5b6876";
const GRID: &str = "#e7ebef";
const SHADE: &str = "#f3f5f8";
const MEASURED: &str = "#2f4a67";
const REPAIRED: &str = "#e4572e";
const TRUTH: &str = "#111111";

/// Draws one coordinate of `marker` around its longest gap: above as it was seen, below as it was repaired.
///
/// The coordinate is the height, if the take says which axis points up, and z otherwise.
/// Repaired samples are coloured; the hidden truth is a dashed line upon them.
/// `sigma_mm` gives the standard deviation of the 3-D error of a frame, as [`Estimate`](crate::solve::Estimate) does;
/// where it is finite a band shows twice the share of one axis (sigma / √3, as if no direction were worse than another).
/// Without a gap the whole take is drawn.
pub fn gap_svg(truth: &Take, before: &Take, after: &Take, sigma_mm: &dyn Fn(usize) -> Option<f64>, marker: usize) -> String {
    let gaps = gaps_of(before, marker);
    let longest = gaps.iter().copied().reduce(|best, gap| if gap.frames() > best.frames() { gap } else { best });
    let window = window(before, longest);
    let (axis, sign) = before.up.map_or((2, 1.0), |up| (up.axis, if up.positive { 1.0 } else { -1.0 }));
    let value = |take: &Take, frame: usize| take.position_mm(frame, marker).and_then(|p| p.get(axis).map(|x| sign * x));
    let band: Vec<(usize, f64, f64)> = window
        .clone()
        .filter(|&frame| before.position_mm(frame, marker).is_none())
        .filter_map(|frame| {
            let half = 2.0 * sigma_mm(frame).filter(|s| s.is_finite())? / 3.0_f64.sqrt();
            value(after, frame).map(|middle| (frame, middle - half, middle + half))
        })
        .collect();

    let lines = window.clone().flat_map(|frame| [value(truth, frame), value(after, frame)]).flatten();
    let heights = lines.chain(band.iter().flat_map(|&(_, low, high)| [low, high]));
    let chart = Chart::new(&window, before.rate_hz, heights);
    let label = escape(&before.display_label(marker));
    let what = if before.up.is_some() { "height" } else { "z" };

    let mut svg = Svg::new(&format!("A gap of marker {label}, before and after the repair"));
    svg.text(LEFT, 34.0, "start", 15.0, QUIET, 400, &format!("{} {what} over time", strong(&label, 19)));
    for (top, title) in PANEL_TOPS.into_iter().zip(["Before", "After"]) {
        svg.panel(&chart, top, title, what);
        for gap in gaps.iter().filter(|gap| gap.end > window.start && gap.start < window.end) {
            svg.shade(&chart, top, gap);
        }
    }

    let [above, below] = PANEL_TOPS;
    if let Some(gap) = longest {
        svg.gap_label(&chart, above, &gap);
    }
    let runs_of = |take: &Take, wanted: &dyn Fn(usize) -> bool| {
        let mut runs: Vec<Vec<(usize, f64)>> = vec![Vec::new()];
        for frame in window.clone() {
            match value(take, frame).filter(|_| wanted(frame)) {
                Some(height) => runs.last_mut().expect("there is always a run").push((frame, height)),
                None if runs.last().is_some_and(|run| !run.is_empty()) => runs.push(Vec::new()),
                None => {}
            }
        }
        runs
    };
    let seen = |frame: usize| before.position_mm(frame, marker).is_some();
    // Lines across a gap begin and end on the seen neighbours, so that they join.
    let near_gap = |frame: usize| !seen(frame) || !seen(frame + 1) || frame.checked_sub(1).is_some_and(|f| !seen(f));
    let inside = |frame: usize| near_gap(frame) && frame < before.frames();

    svg.band(&chart, below, &band);
    for top in PANEL_TOPS {
        for run in runs_of(before, &|_| true) {
            svg.line(&chart, top, &run, MEASURED, 2.2, "");
        }
    }
    for run in runs_of(after, &inside) {
        svg.line(&chart, below, &run, REPAIRED, 3.2, "");
    }
    for run in runs_of(truth, &inside) {
        svg.line(&chart, below, &run, TRUTH, 1.2, "5 4");
    }
    svg.legend(below - 12.0, !band.is_empty());
    if let Some(said) = errors(truth, after, &gaps, marker, &window) {
        svg.text(RIGHT, 34.0, "end", 14.0, QUIET, 400, &said);
    }
    svg.finish(&chart)
}

/// The runs of missing samples of one marker.
fn gaps_of(take: &Take, marker: usize) -> Vec<Gap> {
    let mut gaps: Vec<Gap> = Vec::new();
    for frame in (0..take.frames()).filter(|&frame| take.position_mm(frame, marker).is_none()) {
        match gaps.last_mut() {
            Some(gap) if gap.end == frame => gap.end += 1,
            _ => gaps.push(Gap { marker, start: frame, end: frame + 1 }),
        }
    }
    gaps
}

/// The frames to draw.
fn window(take: &Take, gap: Option<Gap>) -> Range<usize> {
    let Some(gap) = gap else { return 0..take.frames() };
    let around = (gap.frames() as f64 / take.rate_hz).clamp(AROUND_SECS.0, AROUND_SECS.1) * take.rate_hz;
    gap.start.saturating_sub(around as usize)..gap.end.saturating_add(around as usize).min(take.frames())
}

/// Mean and largest 3-D error of the repaired samples that are drawn.
fn errors(truth: &Take, after: &Take, gaps: &[Gap], marker: usize, window: &Range<usize>) -> Option<String> {
    let frames = gaps.iter().flat_map(|gap| gap.start..gap.end).filter(|frame| window.contains(frame));
    let errors: Vec<f64> = frames
        .filter_map(|frame| Some((truth.position_mm(frame, marker)?, after.position_mm(frame, marker)?)))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt())
        .collect();
    if errors.is_empty() {
        return None;
    }
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let largest = errors.iter().copied().fold(0.0, f64::max);
    Some(format!("3-D error of the repair: mean {mean:.1} mm, largest {largest:.1} mm"))
}

/// Frames and millimetres on paper. Both panels share it.
struct Chart {
    frames: Range<usize>,
    rate_hz: f64,
    low_mm: f64,
    high_mm: f64,
}

impl Chart {
    fn new(frames: &Range<usize>, rate_hz: f64, heights_mm: impl Iterator<Item = f64>) -> Self {
        let (low, high) = heights_mm.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let air = 0.12 * (high - low).max(1.0);
        Self { frames: frames.clone(), rate_hz, low_mm: low - air, high_mm: high + air }
    }

    fn x(&self, frame: f64) -> f64 {
        let last = self.frames.len().saturating_sub(1).max(1) as f64;
        LEFT + (RIGHT - LEFT) * (frame - self.frames.start as f64) / last
    }

    fn y(&self, top: f64, height_mm: f64) -> f64 {
        top + PANEL_HEIGHT * (self.high_mm - height_mm) / (self.high_mm - self.low_mm)
    }

    fn start_secs(&self) -> f64 {
        self.frames.start as f64 / self.rate_hz
    }

    fn end_secs(&self) -> f64 {
        self.frames.end.saturating_sub(1) as f64 / self.rate_hz
    }
}

/// Round numbers between `low` and `high`, about `wanted` of them.
fn ticks(low: f64, high: f64, wanted: f64) -> Vec<f64> {
    let rough = ((high - low) / wanted).max(1e-9);
    let power = 10.0_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].iter().map(|m| m * power).find(|step| *step >= rough).unwrap_or(power);
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// The text of a picture.
struct Svg {
    text: String,
}

impl Svg {
    fn new(description: &str) -> Self {
        let mut svg = Self { text: String::new() };
        svg.add(format_args!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
             role=\"img\" font-family=\"{FONT}\">\n<title>{description}</title>"
        ));
        svg.add(format_args!("<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" rx=\"8\" fill=\"#ffffff\"/>"));
        svg
    }

    fn add(&mut self, element: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{element}");
    }

    #[expect(clippy::too_many_arguments, reason = "the attributes of a text element")]
    fn text(&mut self, x: f64, y: f64, anchor: &str, size: f64, colour: &str, weight: u32, said: &str) {
        self.add(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-size=\"{size}\" font-weight=\"{weight}\" fill=\"{colour}\">{said}</text>"
        ));
    }

    fn panel(&mut self, chart: &Chart, top: f64, title: &str, what: &str) {
        let bottom = top + PANEL_HEIGHT;
        self.text(LEFT, top - 12.0, "start", 15.0, INK, 600, title);
        for (height_mm, label) in labelled(&ticks(chart.low_mm, chart.high_mm, 4.0)) {
            let y = chart.y(top, height_mm);
            self.add(format_args!("<path d=\"M{LEFT} {y:.1}H{RIGHT}\" stroke=\"{GRID}\" stroke-width=\"1\"/>"));
            self.text(LEFT - 10.0, y + 4.5, "end", 13.0, QUIET, 400, &label);
        }
        self.add(format_args!("<path d=\"M{LEFT} {bottom}H{RIGHT}\" stroke=\"#aab4be\" stroke-width=\"1\"/>"));
        let (x, y) = (26.0, top + 0.5 * PANEL_HEIGHT);
        self.add(format_args!(
            "<text transform=\"translate({x} {y}) rotate(-90)\" text-anchor=\"middle\" font-size=\"13\" fill=\"{QUIET}\">{what} (mm)</text>"
        ));
    }

    fn shade(&mut self, chart: &Chart, top: f64, gap: &Gap) {
        // Half a frame beyond the missing ones.
        let from = chart.x(gap.start as f64 - 0.5).max(LEFT);
        let to = chart.x(gap.end as f64 - 0.5).min(RIGHT);
        let (width, bottom) = (to - from, top + PANEL_HEIGHT);
        self.add(format_args!("<rect x=\"{from:.1}\" y=\"{top}\" width=\"{width:.1}\" height=\"{PANEL_HEIGHT}\" fill=\"{SHADE}\"/>"));
        self.add(format_args!(
            "<path d=\"M{from:.1} {top}V{bottom}M{to:.1} {top}V{bottom}\" stroke=\"#c3ccd5\" stroke-width=\"1\" stroke-dasharray=\"2 3\"/>"
        ));
    }

    /// How long a gap is: inside if there is room for the words, above the panel otherwise.
    fn gap_label(&mut self, chart: &Chart, top: f64, gap: &Gap) {
        const ROOM: f64 = 120.0;
        let (from, to) = (chart.x(gap.start as f64), chart.x(gap.end as f64));
        let middle = f64::midpoint(from, to);
        let frames = count(gap.frames(), "frame");
        let missing = format!("{:.2} s missing", gap.frames() as f64 / chart.rate_hz);
        if to - from >= ROOM {
            let centre = top + 0.5 * PANEL_HEIGHT;
            self.text(middle, centre - 2.0, "middle", 15.0, INK, 600, &frames);
            self.text(middle, centre + 18.0, "middle", 14.0, QUIET, 400, &missing);
        } else {
            // Clear of the panel's title on the left.
            let middle = middle.clamp(LEFT + 1.6 * ROOM, RIGHT - ROOM);
            self.text(middle, top - 12.0, "middle", 14.0, QUIET, 400, &format!("{} {missing}", strong(&frames, 15)));
        }
    }

    fn line(&mut self, chart: &Chart, top: f64, run: &[(usize, f64)], colour: &str, width: f64, dashes: &str) {
        if run.is_empty() {
            return;
        }
        let points: Vec<String> = run.iter().map(|&(f, h)| format!("{:.1} {:.1}", chart.x(f as f64), chart.y(top, h))).collect();
        let dashes = if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dashes}\"") };
        self.add(format_args!(
            "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\" stroke-linecap=\"round\"{dashes}/>",
            points.join("L")
        ));
    }

    /// One shape for each run of frames.
    fn band(&mut self, chart: &Chart, top: f64, band: &[(usize, f64, f64)]) {
        for run in band.chunk_by(|a, b| a.0 + 1 == b.0) {
            let upper = run.iter().map(|&(f, _, high)| (f, high));
            let lower = run.iter().rev().map(|&(f, low, _)| (f, low));
            let points: Vec<String> = upper.chain(lower).map(|(f, h)| format!("{:.1} {:.1}", chart.x(f as f64), chart.y(top, h))).collect();
            self.add(format_args!("<path d=\"M{}Z\" fill=\"{REPAIRED}\" fill-opacity=\"0.20\"/>", points.join("L")));
        }
    }

    /// Keys of the lower panel, set leftwards from the right edge.
    fn legend(&mut self, baseline: f64, with_band: bool) {
        let mut x = RIGHT;
        let y = baseline - 4.5;
        // The width in px that each word takes is a guess that fits all the fonts of the list.
        let keys = [("hidden truth", 84.0, 0), ("± 2σ", 36.0, 1), ("repaired", 60.0, 2), ("measured", 66.0, 3)];
        for (word, width, kind) in keys.into_iter().filter(|key| with_band || key.2 != 1) {
            self.text(x, baseline, "end", 13.0, QUIET, 400, word);
            let (from, to) = (x - width - 34.0, x - width - 8.0);
            match kind {
                0 => self.add(format_args!(
                    "<path d=\"M{from:.1} {y:.1}H{to:.1}\" stroke=\"{TRUTH}\" stroke-width=\"1.2\" stroke-dasharray=\"5 4\"/>"
                )),
                1 => self.add(format_args!(
                    "<rect x=\"{from:.1}\" y=\"{:.1}\" width=\"26\" height=\"11\" fill=\"{REPAIRED}\" fill-opacity=\"0.20\"/>",
                    y - 5.5
                )),
                _ => {
                    let (colour, width) = if kind == 2 { (REPAIRED, 3.2) } else { (MEASURED, 2.2) };
                    self.add(format_args!(
                        "<path d=\"M{from:.1} {y:.1}H{to:.1}\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linecap=\"round\"/>"
                    ));
                }
            }
            x = from - 20.0;
        }
    }

    /// The time axis, and the end.
    fn finish(mut self, chart: &Chart) -> String {
        let bottoms = PANEL_TOPS.map(|top| top + PANEL_HEIGHT);
        for (secs, label) in labelled(&ticks(chart.start_secs(), chart.end_secs(), 8.0)) {
            let x = chart.x(secs * chart.rate_hz);
            for bottom in bottoms {
                self.add(format_args!("<path d=\"M{x:.1} {bottom}v5\" stroke=\"#aab4be\" stroke-width=\"1\"/>"));
            }
            self.text(x, bottoms[1] + 20.0, "middle", 13.0, QUIET, 400, &label);
        }
        self.text(f64::midpoint(LEFT, RIGHT), bottoms[1] + 42.0, "middle", 13.0, QUIET, 400, "time (s)");
        self.text.push_str("</svg>\n");
        self.text
    }
}

/// Ticks and their texts, all with as many decimals as the tick that needs the most.
fn labelled(ticks: &[f64]) -> Vec<(f64, String)> {
    let fits = |decimals: i32| {
        let scaled = ticks.iter().map(|x| x * 10.0_f64.powi(decimals));
        scaled.into_iter().all(|x| (x - x.round()).abs() < 1e-6)
    };
    let decimals = (0..6).find(|&decimals| fits(decimals)).unwrap_or(6) as usize;
    ticks.iter().map(|&x| (x, format!("{x:.decimals$}").replace('-', "−"))).collect()
}

/// A bold word within a text.
fn strong(word: &str, size: u32) -> String {
    format!("<tspan font-size=\"{size}\" font-weight=\"700\" fill=\"{INK}\">{word}</tspan>")
}

fn count(n: usize, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::demo::{hide, walk};

    #[test]
    fn ticks_are_round() {
        assert_eq!(ticks(0.0, 10.0, 5.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks(-130.0, 210.0, 4.0), [-100.0, 0.0, 100.0, 200.0]);
        let texts = |ticks: &[f64]| labelled(ticks).into_iter().map(|(_, text)| text).collect::<Vec<_>>().join(" ");
        assert_eq!(texts(&[-100.0, 0.0, 100.0]), "−100 0 100");
        assert_eq!(texts(&[0.5, 1.0, 1.5]), "0.5 1.0 1.5");
    }

    #[test]
    fn the_picture_shows_gap_repair_and_truth() {
        let truth = walk(300, 120.0, 1);
        let knee = truth.markers.iter().position(|m| m.label == "LKNE").unwrap();
        let before = hide(&truth, "LKNE", 100..160);
        let mut after = before.clone();
        for frame in 100..160 {
            let [x, y, z] = truth.position_mm(frame, knee).unwrap();
            assert!(after.fill(frame, knee, [x, y, z + 3.0]));
        }
        let svg = gap_svg(&truth, &before, &after, &|_| Some(2.0), knee);
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"));
        for word in
            ["LKNE", "60 frames", "0.50 s missing", "mean 3.0 mm, largest 3.0 mm", "± 2σ", "hidden truth", "height (mm)", "time (s)"]
        {
            assert!(svg.contains(word), "{word}");
        }
        assert!(!gap_svg(&truth, &before, &after, &|_| None, knee).contains("2σ"), "no band without sigma");
        assert!(!gap_svg(&truth, &before, &after, &|_| Some(f64::NAN), knee).contains("2σ"), "nor with one that is not finite");
    }

    /// Nothing to draw is no reason to panic.
    #[test]
    fn odd_takes_are_drawn() {
        let whole = walk(30, 120.0, 1);
        for take in [walk(0, 120.0, 1), walk(1, 120.0, 1), whole.clone(), hide(&whole, "C7", 0..30), hide(&whole, "C7", 20..30)] {
            let svg = gap_svg(&take, &take, &take, &|_| None, 0);
            assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"));
        }
    }
}
