//! What the pictures share: colours, text, lines. Each has its own white background, so that it reads the same on light and dark pages.

use std::fmt::Write as _;

const FONT: &str = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', 'Noto Sans', 'DejaVu Sans', Arial, sans-serif";
/// What is said aloud.
pub const INK: &str = "#1c2733";
/// What is said quietly.
pub const QUIET: &str = "#5b6876";
/// Lines to read figures off.
pub const GRID: &str = "#e7ebef";
/// Lines that bound something.
pub const EDGE: &str = "#aab4be";
/// A gap.
pub const SHADE: &str = "#f3f5f8";
/// Three colours that stay apart for those who do not tell red from green.
pub const COLOURS: [&str; 3] = ["#2f6db3", "#e4572e", "#1d9a7c"];

/// The text of a picture.
pub struct Svg {
    text: String,
}

impl Svg {
    /// An empty picture of this size, in px. `description` is read to those who do not see it.
    pub fn new(width: f64, height: f64, description: &str) -> Self {
        let mut svg = Self { text: String::new() };
        svg.add(format_args!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             role=\"img\" font-family=\"{FONT}\">\n<title>{description}</title>"
        ));
        svg.add(format_args!("<rect width=\"{width}\" height=\"{height}\" rx=\"8\" fill=\"#ffffff\"/>"));
        svg
    }

    /// One element.
    pub fn add(&mut self, element: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{element}");
    }

    /// Text at a point; `anchor` is `start`, `middle` or `end`.
    pub fn text(&mut self, (x, y): (f64, f64), anchor: &str, size: f64, colour: &str, said: &str) {
        self.add(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-size=\"{size}\" fill=\"{colour}\">{said}</text>"
        ));
    }

    /// The name of the y axis: text around a point, to be read from the right.
    pub fn upright(&mut self, (x, y): (f64, f64), said: &str) {
        self.add(format_args!(
            "<text transform=\"translate({x:.1} {y:.1}) rotate(-90)\" text-anchor=\"middle\" font-size=\"13\" fill=\"{QUIET}\">{said}</text>"
        ));
    }

    /// A straight line; `dashes` may be empty.
    pub fn line(&mut self, (x1, y1): (f64, f64), (x2, y2): (f64, f64), colour: &str, width: f64, dashes: &str) {
        let dashes = if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dashes}\"") };
        self.add(format_args!(
            "<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linecap=\"round\"{dashes}/>"
        ));
    }

    /// A line through points.
    pub fn curve(&mut self, points: &[(f64, f64)], colour: &str, width: f64) {
        if points.is_empty() {
            return;
        }
        let points: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1} {y:.1}")).collect();
        self.add(format_args!(
            "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\" stroke-linecap=\"round\"/>",
            points.join("L")
        ));
    }

    /// The end.
    pub fn finish(mut self) -> String {
        self.text.push_str("</svg>\n");
        self.text
    }
}

/// Text within text.
pub fn strong(said: &str, size: f64) -> String {
    format!("<tspan font-size=\"{size}\" font-weight=\"700\" fill=\"{INK}\">{said}</tspan>")
}

/// Round numbers between `low` and `high`, about `wanted` of them and at most twice that.
pub fn ticks(low: f64, high: f64, wanted: f64) -> Vec<f64> {
    let rough = ((high - low) / wanted).max(1e-9);
    let power = 10.0_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0].map(|m| m * power).into_iter().find(|step| *step >= rough).unwrap_or(10.0 * power);
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    (first..=last).map(|i| i as f64 * step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round() {
        assert_eq!(ticks(0.0, 10.0, 5.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks(1.0, 804.0, 8.0), [200.0, 400.0, 600.0, 800.0]);
        assert_eq!(ticks(100.0, 100.0, 4.0), [100.0]);
    }
}
