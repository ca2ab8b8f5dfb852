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
        if let Some(plain) = plain(text)
            && plain.sign.is_none_or(|sign| self.sign.is_none_or(|usual| usual == sign))
        {
            self.sign = self.sign.or(plain.sign);
            if let Some(count) = self.decimals.get_mut(plain.decimals) {
                *count += 1;
            }
            return Ok(Some(plain.value));
        }
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

/// A number that is nothing but digits, perhaps with a sign before and one decimal sign among them.
struct Plain {
    value: f64,
    /// Decimal sign.
    sign: Option<u8>,
    decimals: usize,
}

/// Powers of ten that a double holds exactly.
const POWERS_OF_TEN: [f64; 23] =
    [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22];
/// Whole numbers up to here are exact as doubles.
const LARGEST_EXACT: u64 = 1 << 53;

/// Reads nearly all numbers of nearly all files, several times as fast as the standard parser; `None` for the others.
///
/// The digits as a whole number and the power of ten are both exact, so their quotient is rounded once, and correctly
/// (Clinger, *How to read floating point numbers accurately*, 1990, section 5).
fn plain(text: &[u8]) -> Option<Plain> {
    let (negative, digits) = match text {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, text),
    };
    if digits.len() > 19 {
        return None; // 19 digits and no sign would still fit; longer ones might not
    }
    let mut whole = 0u64;
    let mut sign = None;
    let mut decimals = 0usize;
    for &b in digits {
        let digit = b.wrapping_sub(b'0');
        if digit < 10 {
            whole = whole.wrapping_mul(10).wrapping_add(u64::from(digit));
            decimals += usize::from(sign.is_some());
        } else if (b == b'.' || b == b',') && sign.is_none() {
            sign = Some(b);
        } else {
            return None;
        }
    }
    if whole > LARGEST_EXACT || digits.len() == usize::from(sign.is_some()) {
        return None;
    }
    let value = whole as f64 / POWERS_OF_TEN.get(decimals)?;
    Some(Plain { value: if negative { -value } else { value }, sign, decimals })
}

/// The finite number that `text` is, correctly rounded. `nan`, `inf` and decimal commas are none.
pub(crate) fn finite(text: &[u8]) -> Option<f64> {
    match leading(text) {
        Some((value, [])) => Some(value),
        _ => None,
    }
}

/// The finite number that `text` begins with, correctly rounded, and the text behind it, which is empty or begins with white space or `#`.
pub(crate) fn leading(text: &[u8]) -> Option<(f64, &[u8])> {
    let (negative, mut rest) = match text {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] | rest => (false, rest),
    };
    // as in `plain`: both are exact, so one division rounds correctly
    let (mut whole, mut digits, mut decimals, mut point) = (0_u64, 0_usize, 0_usize, false);
    loop {
        match rest {
            [b @ b'0'..=b'9', behind @ ..] if whole < LARGEST_EXACT / 16 => {
                whole = whole * 10 + u64::from(b - b'0');
                digits += 1;
                decimals += usize::from(point);
                rest = behind;
            }
            [b'.', behind @ ..] if !point => {
                point = true;
                rest = behind;
            }
            _ => break,
        }
    }
    match POWERS_OF_TEN.get(decimals) {
        Some(power) if digits > 0 && rest.first().is_none_or(|&b| ends_number(b)) => {
            let value = whole as f64 / power;
            Some((if negative { -value } else { value }, rest))
        }
        _ => slow_leading(text),
    }
}

/// Exponents, and more digits than are exact.
#[cold]
fn slow_leading(text: &[u8]) -> Option<(f64, &[u8])> {
    let end = text.iter().position(|&b| ends_number(b)).unwrap_or(text.len());
    let (number, rest) = text.split_at_checked(end)?;
    let plain = number.iter().all(|b| matches!(b, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E'));
    parse(number).filter(|value| plain && value.is_finite()).map(|value| (value, rest))
}

fn ends_number(b: u8) -> bool {
    matches!(b, b' ' | b'\t'..=b'\r' | b'#')
}

/// A finite number with a decimal point or comma, as headers have it.
pub(crate) fn decimal(text: &str) -> Option<f64> {
    text.replace(',', ".").parse().ok().filter(|x: &f64| x.is_finite())
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

    /// The short way to a number gives the same bits as the long one.
    #[test]
    fn plain_numbers_are_rounded_correctly() {
        let mut state = 0x2545_f491_4f6c_dd1d_u64;
        let mut random = |below: u64| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 20) % below
        };
        let mut compared = 0;
        for _ in 0..200_000 {
            let digits = random(18) + 1;
            let point = random(digits + 2);
            let mut text = ["", "-", "+", "-0"][random(4) as usize].to_owned();
            for at in 0..digits {
                if at == point {
                    text.push('.');
                }
                text.push(char::from(b'0' + random(10) as u8));
            }
            let slow: f64 = text.parse().unwrap();
            if let Some(fast) = plain(text.as_bytes()) {
                assert_eq!(fast.value.to_bits(), slow.to_bits(), "{text}");
                compared += 1;
            }
            assert_eq!(Numbers::new(b';').read(&cell(&text)).unwrap().unwrap().to_bits(), slow.to_bits(), "{text}");
        }
        assert!(compared > 150_000, "{compared}");
        for odd in ["", "-", "+", ".", "-.", "1e3", "1.2.3", "1 2", "nan", "12345678901234567890", "99999999999999999"] {
            assert!(plain(odd.as_bytes()).is_none(), "{odd}");
        }
    }

    #[test]
    fn finite_numbers_are_what_the_library_reads() {
        for text in [
            "0",
            "-0.0",
            "1",
            "+1.5",
            ".0083333",
            "5.",
            "-3.55271e-015",
            "1E3",
            "0.1",
            "123456789.123456789",
            "9007199254740993",
            "0.0417083750417",
            "12345678901234567890",
            "1e-320",
            "0.000000000000000000000000001",
            "000000000000000000000000000001.5",
            "179.99999999999997",
        ] {
            let (ours, library) = (finite(text.as_bytes()).unwrap(), text.parse::<f64>().unwrap());
            assert_eq!(ours.to_bits(), library.to_bits(), "{text}");
        }
        for text in ["", "-", ".", "+-1", "nan", "inf", "1e999", "1,5", "1.2.3", "--1", "1e", "<<<<<<<", "-1.#IND00", "1 ", " 1", "1#"] {
            assert_eq!(finite(text.as_bytes()), None, "{text}");
        }
        for (text, value, rest) in [("1 2", 1.0, " 2"), ("-.5#x", -0.5, "#x"), ("1e2\r\n", 100.0, "\r\n"), ("7\t", 7.0, "\t")] {
            assert_eq!(leading(text.as_bytes()), Some((value, rest.as_bytes())), "{text}");
        }
    }

    #[test]
    fn random_finite_numbers_are_what_the_library_reads() {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        let mut random = |below: u64| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 20) % below
        };
        for _ in 0..200_000 {
            let digits = random(22) + 1;
            let point = random(digits + 2);
            let mut text = ["", "-", "+", "0"][random(4) as usize].to_owned();
            for at in 0..digits {
                if at == point {
                    text.push('.');
                }
                text.push(char::from(b'0' + random(10) as u8));
            }
            if random(5) == 0 {
                text = format!("{text}e{}", random(40) as i64 - 20);
            }
            let library: f64 = text.parse().unwrap();
            assert_eq!(finite(text.as_bytes()).unwrap().to_bits(), library.to_bits(), "{text}");
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
