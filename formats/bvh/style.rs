//! How a file writes numbers, and how new ones are written.

use super::hierarchy::Skeleton;
use super::kinematics::length;
use super::scan::values;
use crate::Unit;

/// Rows that are looked at.
const SAMPLED_ROWS: usize = 32;
/// Angles have at least this many decimals: 1 µm at 1 m.
const LEAST_ANGLE_DECIMALS: usize = 4;
/// More decimals than a double has.
const MOST_DECIMALS: usize = 15;
/// How many rounded angles may add up at the end of a limb.
const ADDING_UP: f64 = 12.0;
/// What the search for angles may leave, in mm.
const UNSOLVED_MM: f64 = 3e-3;

/// How numbers are written.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Style {
    /// Most digits behind the point (of the mantissa, in scientific notation).
    decimals: usize,
    /// All numbers have as many.
    padded: bool,
    /// How exponents are written, where most numbers have one.
    exponent: Option<Exponent>,
}

/// `e+01`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Exponent {
    letter: char,
    plus: bool,
    digits: usize,
}

/// Digits behind the point, before the exponent.
fn behind(mantissa: &[u8]) -> usize {
    mantissa.iter().position(|&b| b == b'.').map_or(0, |at| mantissa.len() - at - 1)
}

impl Style {
    /// Looks at some rows of a file.
    pub fn of(bytes: &[u8], starts: &[usize]) -> Self {
        let every = (starts.len() / SAMPLED_ROWS).max(1);
        let (mut plain, mut scientific) = (0_usize, 0_usize);
        let (mut least, mut most, mut most_mantissa) = (usize::MAX, 0, 0);
        let mut exponent = None;
        for &start in starts.iter().step_by(every) {
            let rest = bytes.get(start..).unwrap_or_default();
            let row = rest.split(|&b| matches!(b, b'\n' | b'\r')).next().unwrap_or_default();
            for (_, word) in values(row) {
                if let Some(at) = word.iter().position(|b| matches!(b, b'e' | b'E')) {
                    scientific += 1;
                    most_mantissa = most_mantissa.max(behind(word.get(..at).unwrap_or_default()));
                    let tail = word.get(at + 1..).unwrap_or_default();
                    let digits = tail.iter().filter(|b| b.is_ascii_digit()).count();
                    let signed = matches!(tail.first(), Some(b'+' | b'-'));
                    let negative = tail.first() == Some(&b'-');
                    let letter = word.get(at).map_or('e', |&b| char::from(b));
                    let before: Option<Exponent> = exponent;
                    let plus = if negative { before.is_none_or(|e| e.plus) } else { signed };
                    exponent = Some(Exponent { letter, plus, digits: before.map_or(digits, |e| e.digits.min(digits)) });
                } else {
                    plain += 1;
                    least = least.min(behind(word));
                    most = most.max(behind(word));
                }
            }
        }
        let exponent = exponent.filter(|_| scientific > plain);
        let decimals = if exponent.is_some() { most_mantissa } else { most };
        Self { decimals: decimals.min(MOST_DECIMALS), padded: exponent.is_some() || (least == most && scientific == 0), exponent }
    }

    /// Decimals of an angle in degrees, or of a length in `unit`.
    fn decimals(&self, angle: bool, unit: Unit) -> usize {
        let least = match unit {
            _ if angle => LEAST_ANGLE_DECIMALS,
            Unit::Millimetre => 3,
            Unit::Centimetre => 4,
            Unit::Metre => 6,
        };
        // with an exponent, digits count from the first one: hundreds have two before the point
        self.decimals.max(if self.exponent.is_some() { least + 3 } else { least })
    }

    /// Writes an angle or a length. Never `-0`.
    pub fn write(&self, value: f64, angle: bool, unit: Unit, out: &mut Vec<u8>) {
        let decimals = self.decimals(angle, unit);
        let mut text = match self.exponent {
            Some(exponent) => {
                let text = format!("{value:.decimals$e}");
                let (mantissa, power) = text.split_once('e').unwrap_or((&text, "0"));
                let power: i32 = power.parse().unwrap_or(0);
                let sign = if power < 0 {
                    "-"
                } else if exponent.plus {
                    "+"
                } else {
                    ""
                };
                format!("{mantissa}{}{sign}{:0width$}", exponent.letter, power.unsigned_abs(), width = exponent.digits)
            }
            None => format!("{value:.decimals$}"),
        };
        if !self.padded && text.contains('.') {
            text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
        }
        if !text.bytes().any(|b| matches!(b, b'1'..=b'9')) || value == 0.0 {
            text = text.replacen('-', "", 1);
        }
        out.extend_from_slice(text.as_bytes());
    }

    /// How far rounded numbers may move a joint, in mm.
    pub fn known_mm(&self, skeleton: &Skeleton, unit: Unit) -> f64 {
        let mut reaches: Vec<f64> = Vec::with_capacity(skeleton.nodes.len());
        for node in &skeleton.nodes {
            let above = node.parent.and_then(|p| reaches.get(p)).copied();
            reaches.push(above.map_or(0.0, |reach| reach + length(node.offset)));
        }
        let reach_mm = reaches.into_iter().fold(0.0, f64::max) * unit.mm();
        let half = |angle: bool| 0.5 * 10_f64.powi(-i32::try_from(self.decimals(angle, unit).min(MOST_DECIMALS)).unwrap_or(0));
        // exponents only make numbers below 1000 finer
        let half = |angle: bool| if self.exponent.is_some() { half(angle) * 1e3 } else { half(angle) };
        ADDING_UP * (half(true).to_radians() * reach_mm + half(false) * unit.mm()) + UNSOLVED_MM
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_numbers_look_like_the_old_ones() {
        for (old, value, angle, new) in [
            ("1.500000 -2.250000", 3.25, true, "3.250000"),
            ("1.500000 -2.250000", -1e-9, true, "0.000000"),
            ("1.5 -2", 3.25, true, "3.25"),
            ("1.5 -2", 12.345_678_9, true, "12.3457"),
            ("1.5 -2", 12.345_678_9, false, "12.3457"),
            ("1.5 -3.5e-015 2", -0.000_01, true, "0"),
            ("1.5000000e+01 -2.2500000e+00", -0.01234, true, "-1.2340000e-02"),
            ("1.50000000E1 -2.25000000E-1", 123.0, true, "1.23000000E2"),
            ("0 0 0", 100.0, true, "100.0000"),
        ] {
            let mut out = Vec::new();
            Style::of(old.as_bytes(), &[0]).write(value, angle, Unit::Centimetre, &mut out);
            assert_eq!(String::from_utf8_lossy(&out), new, "{value} after {old:?}");
        }
    }
}
