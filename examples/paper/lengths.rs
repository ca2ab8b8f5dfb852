//! Fig. 1 and 3e to 3g: the lengths of the bones at the hidden markers over time, in the original and as the methods left them.

use crate::example::{Example, Shown, length};
use crate::svg::{COLOURS, EDGE, GRID, QUIET, SHADE, Svg, strong, ticks};
use crate::trial::{BASELINE, Fill, proposed, title};
use formats::Take;
use std::ops::Range;

const WIDTH: f64 = 900.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = WIDTH - 28.0;
const TOP: f64 = 104.0;
const PANEL: f64 = 118.0;
const STEP: f64 = PANEL + 42.0;
const BELOW: f64 = 56.0;

/// One panel for the original, the baseline and each proposed method.
pub fn lengths(example: &Example<'_>) -> String {
    let panels: Vec<(Option<&Fill>, &Take)> =
        example.takes().filter(|(fill, _)| fill.is_none_or(|fill| fill.method == BASELINE || proposed(fill.method))).collect();
    let chart = Chart::around(example, &panels);
    let height = TOP + (panels.len() as f64 - 1.0) * STEP + PANEL + BELOW;
    let motion = &example.trial.case.motion;
    let mut svg = Svg::new(WIDTH, height, &format!("Bone lengths of {motion} over time, original and filled"));
    let (first, last) = (example.gap.start + 1, example.gap.end);
    svg.text(
        (LEFT, 34.0),
        "start",
        15.0,
        QUIET,
        &format!("{} {} hidden in frames {first} to {last}", strong(motion, 19.0), example.trial.markers),
    );
    legend(&mut svg, example);
    for (at, (fill, take)) in panels.iter().enumerate() {
        let top = TOP + at as f64 * STEP;
        chart.panel(&mut svg, top, at + 1 == panels.len());
        let name = fill.map_or_else(|| "original".to_owned(), |fill| title(fill.method));
        let error = fill.map_or_else(String::new, |fill| format!(" RMSE {:.0} mm", fill.rmse_mm()));
        svg.text((LEFT, top - 10.0), "start", 13.0, QUIET, &format!("{}{error}", strong(&name, 15.0)));
        deviations(&mut svg, example, take, top - 10.0);
        for (bone, colour) in example.bones.iter().zip(COLOURS) {
            let y = chart.y(top, bone.length_mm);
            svg.line((LEFT, y), (RIGHT, y), colour, 1.0, "1 5");
            svg.curve(&chart.points(top, take, bone), colour, 2.2);
        }
    }
    svg.text((f64::midpoint(LEFT, RIGHT), height - 14.0), "middle", 13.0, QUIET, "frame");
    svg.finish()
}

/// The bones with their colours, and what the dotted lines mean.
fn legend(svg: &mut Svg, example: &Example<'_>) {
    let y = 62.0;
    let mut x = LEFT;
    for (bone, colour) in example.bones.iter().zip(COLOURS) {
        svg.line((x, y - 4.5), (x + 24.0, y - 4.5), colour, 2.6, "");
        svg.text((x + 32.0, y), "start", 13.0, QUIET, &bone.name);
        // the width of the name is a guess that fits all the fonts of the list
        x += 32.0 + 8.8 * bone.name.chars().count() as f64 + 24.0;
    }
    svg.line((x, y - 4.5), (x + 24.0, y - 4.5), QUIET, 1.2, "1 5");
    svg.text((x + 32.0, y), "start", 13.0, QUIET, "mean outside the gap");
}

/// How far the bones are from their mean lengths, right above the panel and in their colours.
fn deviations(svg: &mut Svg, example: &Example<'_>, take: &Take, y: f64) {
    // each figure is a text of its own: not every program that draws SVG can align text of several colours
    let mut x = RIGHT;
    for (bone, colour) in example.bones.iter().zip(COLOURS).rev() {
        if let Some(off) = example.deviation_mm(bone, take) {
            svg.text((x, y), "end", 14.0, colour, &format!("{off:.1}"));
        }
        x -= 50.0;
    }
    svg.text((x - 4.0, y), "end", 13.0, QUIET, "mean deviation in the gap (mm)");
}

/// Frames and millimetres on paper. All panels share it, so that they can be compared.
struct Chart {
    frames: usize,
    gap: Range<usize>,
    low_mm: f64,
    high_mm: f64,
}

impl Chart {
    fn around(example: &Example<'_>, panels: &[(Option<&Fill>, &Take)]) -> Self {
        let frames = example.truth.frames();
        let all = panels.iter().flat_map(|(_, take)| {
            example.bones.iter().flat_map(move |bone| (0..frames).filter_map(move |frame| length(take, bone.ends, frame)))
        });
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), mm| (low.min(mm), high.max(mm)));
        let air = 0.05 * (high - low).max(10.0);
        Self { frames, gap: example.gap.clone(), low_mm: low - air, high_mm: high + air }
    }

    fn x(&self, frame: f64) -> f64 {
        LEFT + (RIGHT - LEFT) * frame / self.frames.saturating_sub(1).max(1) as f64
    }

    fn y(&self, top: f64, length_mm: f64) -> f64 {
        top + PANEL * (self.high_mm - length_mm) / (self.high_mm - self.low_mm)
    }

    fn points(&self, top: f64, take: &Take, bone: &Shown) -> Vec<(f64, f64)> {
        let point = |frame| Some((self.x(frame as f64), self.y(top, length(take, bone.ends, frame)?)));
        (0..self.frames).filter_map(point).collect()
    }

    fn panel(&self, svg: &mut Svg, top: f64, last: bool) {
        let bottom = top + PANEL;
        // half a frame beyond the hidden ones
        let (from, to) = (self.x(self.gap.start as f64 - 0.5).max(LEFT), self.x(self.gap.end as f64 - 0.5).min(RIGHT));
        svg.add(format_args!("<rect x=\"{from:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{PANEL}\" fill=\"{SHADE}\"/>", to - from));
        for length_mm in ticks(self.low_mm, self.high_mm, 4.0) {
            let y = self.y(top, length_mm);
            svg.line((LEFT, y), (RIGHT, y), GRID, 1.0, "");
            svg.text((LEFT - 10.0, y + 4.5), "end", 13.0, QUIET, &format!("{length_mm:.0}"));
        }
        for edge in [from, to] {
            svg.line((edge, top), (edge, bottom), QUIET, 1.0, "");
        }
        svg.line((LEFT, bottom), (RIGHT, bottom), EDGE, 1.0, "");
        svg.upright((26.0, top + 0.5 * PANEL), "length (mm)");
        // frames are counted from 1 as in the paper
        for number in ticks(1.0, self.frames as f64, 8.0) {
            let x = self.x(number - 1.0);
            svg.line((x, bottom), (x, bottom + 5.0), EDGE, 1.0, "");
            if last {
                svg.text((x, bottom + 20.0), "middle", 13.0, QUIET, &format!("{number:.0}"));
            }
        }
    }
}
