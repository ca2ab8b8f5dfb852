//! Numbers as files write them: with a point or a comma, with many decimals or few.

use super::scan::Cell;
use crate::Unit;

/// Most decimals that are told apart.
const MOST_DECIMALS: usize = 24;

/// Larger numbers are no coordinates, and in other units they might be no numbers at all.
const LARGEST: f64 = 1e100;

/// What is wrong with a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wrong {
    /// It is none.
    NotANumber,
    /// It has a decimal comma where the numbers before have points, or the other way round.
    OtherSign {
        /// The sign of the numbers before.
        usual: char,
    },
}

/// Reads numbers, and remembers how they are written.
#[derive(Clone, Debug)]
pub(crate) struct Numbers {
    separator: u8,
    sign: Option<u8>,
    /// How many numbers have 0, 1, 2... decimals.
    decimals: [u64; MOST_DECIMALS + 1],
}

impl Numbers {
    /// No number seen so far.
    pub fn new(separator: u8) -> Self {
        Self { separator, sign: None, decimals: [0; MOST_DECIMALS + 1] }
    }

    /// The number in a cell; `None` where the cell says that there is none: empty, `NaN`, `NA`, `null`.
    ///
    /// # Errors
    /// The text is no number up to 1e100, or its decimal sign is not the usual one.
    pub fn read(&mut self, cell: &Cell<'_>) -> Result<Option<f64>, Wrong> {
        let text = if cell.quoted { cell.text.trim_ascii() } else { cell.text };
        if is_missing(text) {
            return Ok(None);
        }
        let (mut sign, mut exponent) = (None, None);
        for (i, &b) in text.iter().enumerate() {
            match b {
                b'.' | b',' if sign.is_none() => sign = Some((i, b)),
                b'e' | b'E' => exponent = Some(i),
                _ => {}
            }
        }
        if let Some((_, found)) = sign {
            match self.sign {
                None => self.sign = Some(found),
                Some(usual) if usual == found => {}
                Some(usual) => return Err(Wrong::OtherSign { usual: char::from(usual) }),
            }
        }
        let value = match sign {
            Some((_, b',')) => parse(&text.iter().map(|&b| if b == b',' { b'.' } else { b }).collect::<Vec<u8>>()),
            _ => parse(text),
        };
        let value = value.filter(|v| v.abs() <= LARGEST).ok_or(Wrong::NotANumber)?;
        // 1.25e-3 shows five decimals
        let mantissa_end = exponent.unwrap_or(text.len());
        let shown = sign.map_or(0, |(at, _)| mantissa_end.saturating_sub(at + 1));
        let power = exponent.and_then(|at| std::str::from_utf8(text.get(at + 1..)?).ok()?.parse::<i32>().ok()).unwrap_or(0);
        let shift = power.unsigned_abs() as usize;
        let decimals = if power < 0 { shown.saturating_add(shift) } else { shown.saturating_sub(shift) };
        if let Some(count) = self.decimals.get_mut(decimals.min(MOST_DECIMALS)) {
            *count += 1;
        }
        Ok(Some(value))
    }

    /// The most decimals that a number shows.
    pub fn most_decimals(&self) -> usize {
        self.decimals.iter().rposition(|&n| n > 0).unwrap_or(0)
    }

    /// How new numbers of a length in `unit` are to be written.
    ///
    /// With as many decimals as nine in ten of the numbers do with, but never coarser than 0.001 mm.
    pub fn style(&self, unit: Unit) -> Style {
        let total: u64 = self.decimals.iter().sum();
        let mut seen = 0;
        let general = self.decimals.iter().position(|&n| {
            seen += n;
            seen * 10 >= total * 9
        });
        let general = if total == 0 { 0 } else { general.unwrap_or(0) };
        let finest = match unit {
            Unit::Millimetre => 3,
            Unit::Centimetre => 4,
            Unit::Metre => 6,
        };
        let exactly = self.decimals.get(general).copied().unwrap_or(0);
        Style {
            decimals: general.max(finest),
            // A writer that cuts trailing zeros cuts one number in ten; one that pads cuts none.
            padded: total > 0 && exactly * 20 >= total * 19,
            comma: self.sign == Some(b','),
            quote: self.sign == Some(b',') && self.separator == b',',
        }
    }
}

/// How a file writes its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Style {
    /// Decimals.
    pub decimals: usize,
    /// True if trailing zeros are written.
    pub padded: bool,
    /// True if the decimal sign is a comma.
    pub comma: bool,
    /// True if a number needs quotes because its decimal sign is the separator of cells.
    pub quote: bool,
}

impl Style {
    /// Appends a number.
    pub fn write(&self, value: f64, quoted: bool, out: &mut Vec<u8>) {
        let value = if value == 0.0 { 0.0 } else { value }; // no "-0"
        let shortest = format!("{value}");
        let shown = shortest.split_once('.').map_or(0, |(_, d)| d.len());
        let mut text = if shown > self.decimals { format!("{value:.*}", self.decimals) } else { shortest };
        let mut shown = text.split_once('.').map_or(0, |(_, d)| d.len());
        if self.padded {
            if shown == 0 && self.decimals > 0 {
                text.push('.');
            }
            while shown < self.decimals {
                text.push('0');
                shown += 1;
            }
        } else if shown > 0 {
            text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
        }
        if text.starts_with('-') && text.bytes().all(|b| matches!(b, b'-' | b'0' | b'.')) {
            text.remove(0);
        }
        let quote = self.quote && !quoted;
        out.extend(quote.then_some(b'"'));
        out.extend(text.bytes().map(|b| if b == b'.' && self.comma { b',' } else { b }));
        out.extend(quote.then_some(b'"'));
    }

    /// The step between neighbouring numbers, in the file's unit.
    pub fn step(&self) -> f64 {
        step(self.decimals)
    }
}

/// One unit of the last of `decimals` decimals.
pub(crate) fn step(decimals: usize) -> f64 {
    format!("1e-{decimals}").parse().unwrap_or(0.0)
}

/// True if the text says that there is no number.
fn is_missing(text: &[u8]) -> bool {
    let Some(&first) = text.first() else { return true };
    if first.is_ascii_digit() {
        return text.len() > 3 && (text.ends_with(b"#QNAN") || text.ends_with(b"#IND")); // as old C libraries print NaN
    }
    let word = text.strip_prefix(b"-").or_else(|| text.strip_prefix(b"+")).unwrap_or(text);
    match word.first() {
        Some(b'n' | b'N') => ["nan", "na", "n/a", "null", "none"].iter().any(|m| word.eq_ignore_ascii_case(m.as_bytes())),
        Some(b'#') => word == b"#N/A",
        Some(b'1') => word.ends_with(b"#QNAN") || word.ends_with(b"#IND"),
        _ => false,
    }
}

fn parse(text: &[u8]) -> Option<f64> {
    // The standard parser also takes words such as "infinity", which are filtered as not finite.
    std::str::from_utf8(text).ok()?.parse().ok()
}

/// A whole number up to 9e15 (which every `f64` below is exact for), also if written as `12.0`.
pub(crate) fn whole(cell: &Cell<'_>) -> Option<i64> {
    let text = std::str::from_utf8(cell.text).ok()?.trim();
    let value = text.parse::<f64>().or_else(|_| text.replace(',', ".").parse()).ok()?;
    (value.fract() == 0.0 && value.abs() <= 9e15).then_some(value as i64)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn cell(text: &str) -> Cell<'_> {
        Cell { text: text.as_bytes(), start: 0, quoted: false, ends_row: false }
    }

    #[test]
    fn numbers_and_no_numbers() {
        for (text, expected) in [
            ("1880.875", Ok(Some(1880.875))),
            ("-1,5", Ok(Some(-1.5))),
            ("+.5", Ok(Some(0.5))),
            ("1.5e-3", Ok(Some(0.0015))),
            ("", Ok(None)),
            ("NaN", Ok(None)),
            ("-nan", Ok(None)),
            ("NA", Ok(None)),
            ("null", Ok(None)),
            ("-1.#IND", Ok(None)),
            ("1.#QNAN", Ok(None)),
            ("inf", Err(Wrong::NotANumber)),
            ("1e999", Err(Wrong::NotANumber)),
            ("-1e308", Err(Wrong::NotANumber)),
            ("1,2,3", Err(Wrong::NotANumber)),
            ("1.2.3", Err(Wrong::NotANumber)),
            ("1 2", Err(Wrong::NotANumber)),
            ("nine", Err(Wrong::NotANumber)),
            ("-", Err(Wrong::NotANumber)),
        ] {
            assert_eq!(Numbers::new(b';').read(&cell(text)), expected, "{text:?}");
        }
        let mut numbers = Numbers::new(b';');
        assert_eq!(numbers.read(&cell("1,5")), Ok(Some(1.5)));
        assert_eq!(numbers.read(&cell("1.5")), Err(Wrong::OtherSign { usual: ',' }));
        assert_eq!(numbers.read(&cell("2")), Ok(Some(2.0)));
    }

    #[test]
    fn new_numbers_look_like_the_old_ones() {
        for (old, unit, value, new) in [
            (&["1.50", "2.25"][..], Unit::Millimetre, 3.0, "3.000"), // at least 0.001 mm
            (&["1.5000", "2.2500"], Unit::Millimetre, -3.0, "-3.0000"),
            (&["1.5000", "2.2500"], Unit::Millimetre, -0.000_01, "0.0000"),
            (&["1.25", "2.5", "3.75", "4"], Unit::Millimetre, 1.0 / 3.0, "0.333"),
            (&["1.25", "2.5", "3.75", "4"], Unit::Millimetre, 2.5, "2.5"),
            (&["1.25", "2.5", "3.75", "4"], Unit::Millimetre, 1_200.000_01, "1200"),
            (&["1,250", "2,500"], Unit::Metre, 1.25, "1,250000"),
            (&["1880.87500000000001"], Unit::Millimetre, 1000.1, "1000.10000000000000"),
            (&["1.5e-3", "1e-12"], Unit::Metre, 1.5, "1.5"),
            (&[], Unit::Centimetre, 1.5, "1.5"),
        ] {
            let mut numbers = Numbers::new(b';');
            for text in old {
                numbers.read(&cell(text)).unwrap();
            }
            let mut out = Vec::new();
            numbers.style(unit).write(value, false, &mut out);
            assert_eq!(String::from_utf8(out).unwrap(), new, "{value} after {old:?}");
        }
    }

    #[test]
    fn whole_numbers() {
        for (text, expected) in
            [("12", Some(12)), ("-3", Some(-3)), ("7.0", Some(7)), ("7,0", Some(7)), ("7.5", None), ("", None), ("1e300", None)]
        {
            assert_eq!(whole(&cell(text)), expected, "{text}");
        }
    }
}
