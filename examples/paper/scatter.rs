//! Fig. 4b and 4c: the mean squared error of each trial against the baseline's.

use crate::svg::{COLOURS, EDGE, GRID, INK, QUIET, SHADE, Svg, strong};
use crate::table::wins;
use crate::trial::{BASELINE, Trial, proposed, title};
use mocap_repair::solve::Method;

const SIDE: f64 = 324.0;
const LEFT: f64 = 84.0;
const TOP: f64 = 76.0;
/// Room right of each panel for the names of its guide lines.
const BESIDE: f64 = 74.0;
const BETWEEN: f64 = 12.0;
const BELOW: f64 = 62.0;
const MOST_LABELS: i32 = 6;

const WON: &str = COLOURS[0];
const LOST: &str = COLOURS[1];

/// One panel for each proposed method. `None` if there is nothing to compare.
pub fn scatter(trials: &[Trial], methods: &[Method]) -> Option<String> {
    let panels: Vec<(Method, Vec<Point>)> = methods
        .iter()
        .filter(|&&method| proposed(method))
        .map(|&method| (method, trials.iter().filter_map(|trial| Point::new(trial, method)).collect()))
        .filter(|(_, points): &(_, Vec<Point>)| !points.is_empty())
        .collect();
    let chart = Chart::around(panels.iter().flat_map(|(_, points)| points))?;
    let width = LEFT + panels.len() as f64 * (SIDE + BESIDE) + (panels.len() as f64 - 1.0) * BETWEEN;
    let mut svg = Svg::new(width, TOP + SIDE + BELOW, &format!("Mean squared error of each trial against that of {}", title(BASELINE)));
    svg.upright(
        (24.0, TOP + 0.5 * SIDE),
        &format!("mse of {} (cm²)", if panels.len() > 1 { "BoLeRO".into() } else { title(panels.first()?.0) }),
    );
    for (at, (method, points)) in panels.iter().enumerate() {
        let left = LEFT + at as f64 * (SIDE + BESIDE + BETWEEN);
        chart.panel(&mut svg, left, at == 0);
        let won = points.iter().filter(|point| point.won).count();
        svg.text((left, 32.0), "start", 14.0, QUIET, &strong(&title(*method), 17.0));
        let y = 54.0;
        mark(&mut svg, (left + 6.0, y - 4.5), true);
        svg.text((left + 18.0, y), "start", 13.0, QUIET, &format!("at or below {}: {}", title(BASELINE), strong(&won.to_string(), 13.0)));
        mark(&mut svg, (left + 176.0, y - 4.5), false);
        svg.text((left + 188.0, y), "start", 13.0, QUIET, &format!("above: {}", strong(&(points.len() - won).to_string(), 13.0)));
        // losses last: they are few, and what matters most
        for lost in [false, true] {
            for point in points.iter().filter(|point| point.won != lost) {
                mark(&mut svg, (left + chart.along(point.x), TOP + SIDE - chart.along(point.y)), point.won);
            }
        }
    }
    Some(svg.finish())
}

/// A trial, as logarithms (base 10) of mean squared errors in cm².
struct Point {
    x: f64,
    y: f64,
    won: bool,
}

impl Point {
    fn new(trial: &Trial, method: Method) -> Option<Self> {
        let (baseline, fill) = (trial.of(BASELINE)?, trial.of(method)?);
        // a perfect fill has no logarithm; a hundredth of a millimetre is as good as perfect
        let log = |mse_cm2: f64| mse_cm2.max(1e-6).log10();
        Some(Self { x: log(baseline.mse_cm2()), y: log(fill.mse_cm2()), won: wins(baseline, fill) })
    }
}

/// A dot, or a lozenge for a loss, so that the colour is not all that tells them apart.
fn mark(svg: &mut Svg, (x, y): (f64, f64), won: bool) {
    let paint = format!("fill=\"{}\" fill-opacity=\"0.8\" stroke=\"#ffffff\" stroke-width=\"0.8\"", if won { WON } else { LOST });
    if won {
        svg.add(format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.2\" {paint}/>"));
    } else {
        svg.add(format_args!("<path d=\"M{x:.1} {:.1}l5.4 5.4l-5.4 5.4l-5.4 -5.4Z\" {paint}/>", y - 5.4));
    }
}

/// Both axes of all panels, logarithms.
struct Chart {
    low: f64,
    high: f64,
}

impl Chart {
    fn around<'a>(points: impl Iterator<Item = &'a Point>) -> Option<Self> {
        let (low, high) = points.flat_map(|p| [p.x, p.y]).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        // a little air, or marks would lie on the frame
        (low <= high).then_some(Self { low: low - 0.15, high: high + 0.15 })
    }

    /// Px from the lower left corner.
    fn along(&self, log: f64) -> f64 {
        SIDE * (log - self.low) / (self.high - self.low)
    }

    fn panel(&self, svg: &mut Svg, left: f64, labelled: bool) {
        let bottom = TOP + SIDE;
        // the half where the method wins
        svg.add(format_args!("<path d=\"M{left:.1} {bottom:.1}h{SIDE}v-{SIDE}Z\" fill=\"{SHADE}\"/>"));
        let decades = self.low.ceil() as i32..=self.high.floor() as i32;
        // as many labels as have room side by side
        let every = (decades.end() - decades.start()) / MOST_LABELS + 1;
        for decade in decades {
            let along = self.along(f64::from(decade));
            let said = power_of_ten(decade);
            svg.line((left + along, TOP), (left + along, bottom), GRID, 1.0, "");
            svg.line((left, bottom - along), (left + SIDE, bottom - along), GRID, 1.0, "");
            if decade % every != 0 {
                continue;
            }
            svg.text((left + along, bottom + 20.0), "middle", 13.0, QUIET, &said);
            if labelled {
                svg.text((left - 10.0, bottom - along + 4.5), "end", 13.0, QUIET, &said);
            }
        }
        svg.add(format_args!("<rect x=\"{left:.1}\" y=\"{TOP}\" width=\"{SIDE}\" height=\"{SIDE}\" fill=\"none\" stroke=\"{EDGE}\"/>"));
        for (times, said) in [(0.0, "equal"), (1.0, "10 times"), (2.0, "100 times")] {
            let along = self.along(self.low + times);
            let (colour, dashes) = if times > 0.0 { (EDGE, "3 4") } else { (INK, "") };
            svg.line((left + along, bottom), (left + SIDE, TOP + along), colour, 1.0, dashes);
            svg.text((left + SIDE + 7.0, TOP + along + 4.5), "start", 12.0, QUIET, said);
        }
        svg.text((left + SIDE + 7.0, TOP + self.along(self.low + 2.0) + 19.0), "start", 12.0, QUIET, "better");
        svg.text((left + 0.5 * SIDE, bottom + 44.0), "middle", 13.0, QUIET, &format!("mse of {} (cm²)", title(BASELINE)));
    }
}

/// `0.01`, `100`, `10 000`.
fn power_of_ten(decade: i32) -> String {
    match usize::try_from(decade) {
        Ok(zeros) if zeros > 3 => format!("{} 000", power_of_ten(decade - 3)),
        Ok(zeros) => format!("1{}", "0".repeat(zeros)),
        Err(_) => format!("{:.*}", decade.unsigned_abs() as usize, 10.0_f64.powi(decade)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_in_full() {
        assert_eq!([-3, -1, 0, 2, 3, 4].map(power_of_ten), ["0.001", "0.1", "1", "100", "1000", "10 000"]);
    }

    #[test]
    fn every_point_is_within_the_axes() {
        let points = [Point { x: -0.4, y: 2.3, won: false }, Point { x: 1.0, y: 1.0, won: true }];
        let chart = Chart::around(points.iter());
        assert!(chart.is_some_and(|chart| chart.along(-0.4) > 8.0 && chart.along(2.3) < SIDE - 8.0 && chart.along(1.0) < chart.along(1.1)));
        assert!(Chart::around([].iter()).is_none());
    }
}
