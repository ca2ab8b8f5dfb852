//! Ways to damage a file.

/// Random numbers that are the same everywhere (xorshift).
pub struct Random(u64);

impl Random {
    /// From a seed; any will do.
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 >> 11
    }

    /// A number below `n`, 0 if that is 0.
    pub fn below(&mut self, n: usize) -> usize {
        self.next() as usize % n.max(1)
    }
}

/// Numbers at which counts, sizes and coordinates go wrong, as bytes.
const EXTREMES: [&[u8]; 12] = [
    &[0xff],
    &[0x80],
    &[0x7f],
    &[0x00],
    &[0xff, 0xff],
    &[0xff, 0x7f],
    &[0x00, 0x80],
    &[0xff, 0xff, 0xff, 0xff],
    &[0x00, 0x00, 0xc0, 0x7f], // NaN
    &[0x00, 0x00, 0x80, 0x7f], // infinity
    &[0xff, 0xff, 0x7f, 0x7f], // the largest 32-bit float
    &[0x01, 0x00, 0x00, 0x00], // the smallest
];

/// The same for text.
const WORDS: [&str; 18] = [
    "",
    "0",
    "-0",
    "NaN",
    "inf",
    "1e308",
    "1e999",
    "-1e308",
    "1e-320",
    "4294967296",
    "9223372036854775807",
    "2147483648",
    "1.2.3",
    "1,5",
    "\"",
    "\t",
    ";",
    "\u{feff}",
];

/// Four bytes anywhere, each with another value.
pub fn four_bytes(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut damaged = bytes.to_vec();
    for _ in 0..4 {
        let at = random.below(damaged.len());
        let value = random.below(256) as u8;
        if let Some(byte) = damaged.get_mut(at) {
            *byte = value;
        }
    }
    damaged
}

/// The file, damaged in one to three ways.
pub fn mutate(bytes: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let mut damaged = bytes.to_vec();
    for _ in 0..=random.below(3) {
        damaged = once(&damaged, other, random);
    }
    damaged
}

fn once(bytes: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let length = bytes.len();
    let stretch = |random: &mut Random, of: usize| {
        let from = random.below(of + 1);
        // short ones do other harm than long ones
        let most = if random.below(2) == 0 { 16 } else { of };
        (from, (from + random.below(most + 1)).min(of))
    };
    match random.below(9) {
        0 => four_bytes(bytes, random),
        1 | 2 => {
            let mut damaged = bytes.to_vec();
            let extreme = EXTREMES[random.below(EXTREMES.len())];
            // counts stand at the beginning
            let within = if random.below(2) == 0 { length.min(1024) } else { length };
            let at = random.below(within);
            for (byte, value) in damaged.iter_mut().skip(at).zip(extreme) {
                *byte = *value;
            }
            damaged
        }
        3 => bytes[..random.below(length + 1)].to_vec(),
        4 => {
            let (from, to) = stretch(random, length);
            [&bytes[..from], &bytes[to..]].concat()
        }
        5 => {
            let (from, to) = stretch(random, length);
            [&bytes[..to], &bytes[from..]].concat()
        }
        6 => {
            let (from, to) = stretch(random, other.len());
            let at = random.below(length + 1);
            [&bytes[..at], &other[from..to], &bytes[at..]].concat()
        }
        7 => {
            // a number becomes another word
            let starts: Vec<usize> = (0..length)
                .filter(|&i| bytes[i].is_ascii_digit() && (i == 0 || !matches!(bytes[i - 1], b'0'..=b'9' | b'.' | b'-')))
                .collect();
            let Some(&from) = starts.get(random.below(starts.len())) else { return bytes.to_vec() };
            let to = from + bytes[from..].iter().take_while(|b| matches!(b, b'0'..=b'9' | b'.' | b'e' | b'-' | b'+')).count();
            [&bytes[..from], WORDS[random.below(WORDS.len())].as_bytes(), &bytes[to..]].concat()
        }
        _ => {
            // two lines change places
            let mut lines: Vec<&[u8]> = bytes.split_inclusive(|&b| b == b'\n').collect();
            let (a, b) = (random.below(lines.len()), random.below(lines.len()));
            if !lines.is_empty() {
                lines.swap(a, b);
            }
            lines.concat()
        }
    }
}
