//! The three processors that C3D files were written on, and how each lays out its numbers.
//!
//! | byte | processor | integers | floats |
//! | --- | --- | --- | --- |
//! | 84 | Intel | little-endian | IEEE 754, little-endian |
//! | 85 | DEC | little-endian | VAX F_floating: two little-endian words, the high word first, exponent bias 128, mantissa 0.1f |
//! | 86 | MIPS (SGI) | big-endian | IEEE 754, big-endian |

/// Who wrote the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Processor {
    /// PC.
    Intel,
    /// VAX, PDP-11.
    Dec,
    /// SGI and other big-endian machines.
    Mips,
}

impl Processor {
    /// Reads the fourth byte of the parameter section.
    pub fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            84 => Some(Self::Intel),
            85 => Some(Self::Dec),
            86 => Some(Self::Mips),
            _ => None,
        }
    }

    /// Reads a 16-bit word.
    pub fn u16(self, bytes: [u8; 2]) -> u16 {
        match self {
            Self::Intel | Self::Dec => u16::from_le_bytes(bytes),
            Self::Mips => u16::from_be_bytes(bytes),
        }
    }

    /// Reads a float. The reserved operand of a DEC machine becomes NaN.
    pub fn f32(self, bytes: [u8; 4]) -> f32 {
        match self {
            Self::Intel => f32::from_le_bytes(bytes),
            Self::Dec => dec_to_f32(bytes),
            Self::Mips => f32::from_be_bytes(bytes),
        }
    }

    /// Writes a signed 16-bit word.
    pub fn put_i16(self, value: i16) -> [u8; 2] {
        match self {
            Self::Intel | Self::Dec => value.to_le_bytes(),
            Self::Mips => value.to_be_bytes(),
        }
    }

    /// Writes a float. `None` if the processor has no such number.
    pub fn put_f32(self, value: f32) -> Option<[u8; 4]> {
        match self {
            Self::Intel => Some(value.to_le_bytes()),
            Self::Dec => dec_from_f32(value),
            Self::Mips => Some(value.to_be_bytes()),
        }
    }
}

/// The same bits as IEEE 754 would be four times as large: the bias is 128 instead of 127, and the mantissa 0.1f instead of 1.f.
const EXPONENT_STEP: u32 = 2 << 23;

/// Reads a VAX F_floating number.
pub(super) fn dec_to_f32([a, b, c, d]: [u8; 4]) -> f32 {
    let bits = u32::from_le_bytes([c, d, a, b]);
    match (bits >> 23) & 0xff {
        // An exponent of 0 is zero, whatever the mantissa says; with the sign set it is the reserved operand.
        0 if bits >> 31 == 0 => 0.0,
        0 => f32::NAN,
        // These two become subnormal, so let the FPU shift the mantissa.
        1 | 2 => f32::from_bits(bits) / 4.0,
        _ => f32::from_bits(bits - EXPONENT_STEP),
    }
}

/// Writes a VAX F_floating number. Subnormal numbers become zero. `None` for NaN, infinity, and above 1.7e38.
fn dec_from_f32(value: f32) -> Option<[u8; 4]> {
    let bits = value.to_bits();
    let bits = match (bits >> 23) & 0xff {
        0 => 0,
        254 | 255 => return None,
        _ => bits + EXPONENT_STEP,
    };
    let [c, d, a, b] = bits.to_le_bytes();
    Some([a, b, c, d])
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn dec_numbers_from_the_vax_manual() {
        // 1.0 is 0x4080 0x0000, -1.0 is 0xc080, 0.1f = 0x3ecc 0xcccd, 2.5 = 0x4120 0x0000.
        for (words, value) in
            [([0x80, 0x40, 0, 0], 1.0), ([0x80, 0xc0, 0, 0], -1.0), ([0xcc, 0x3e, 0xcd, 0xcc], 0.1), ([0x20, 0x41, 0, 0], 2.5)]
        {
            assert_eq!(dec_to_f32(words), value);
            assert_eq!(dec_from_f32(value), Some(words));
        }
        assert!(dec_to_f32([0, 0x80, 0, 0]).is_nan(), "reserved operand");
        assert_eq!(dec_to_f32([0xff, 0x7f, 0xff, 0xff]), 1.701_411_7e38, "the largest");
        assert_eq!(dec_from_f32(-0.0), Some([0; 4]), "minus zero would be the reserved operand");
    }

    #[test]
    fn every_number_comes_back() {
        let mut bits = 1u32;
        for _ in 0..10_000 {
            bits = bits.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let x = f32::from_bits(bits);
            for p in [Processor::Intel, Processor::Dec, Processor::Mips] {
                match p.put_f32(x) {
                    Some(bytes) if x.is_normal() => assert_eq!(p.f32(bytes).to_bits(), x.to_bits(), "{p:?} {x:e}"),
                    Some(_) => {}
                    None => assert!(p == Processor::Dec && (x.is_nan() || x.abs() >= 1.7e38), "{x:e}"),
                }
                let word = (bits >> 16) as u16;
                assert_eq!(p.u16(p.put_i16(word.cast_signed())), word);
            }
        }
    }
}
