//! Seeded chance: numbers, and curves that wander.
//!
//! The generator is SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014), written out here
//! so that a seed means the same take in every version of every library.

use std::f64::consts::TAU;

/// What a generator is for.
/// Each purpose draws from its own stream, so that a longer take has the same start and other gaps do not change the motion.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Stream {
    /// Body and placement of the markers.
    Actor = 1,
    /// The way of walking.
    Gait = 2,
    /// Camera noise.
    Noise = 3,
    /// What is hidden.
    Gaps = 4,
    /// Parameters that EM starts from.
    Start = 5,
    /// Measures of a body with a surface.
    Body = 6,
    /// Points of a cloud.
    Cloud = 7,
    /// Markers on a surface: noise, and what is hidden.
    Markers = 8,
}

/// A generator of random numbers.
#[derive(Clone, Debug)]
pub(crate) struct Random {
    state: u64,
}

impl Random {
    /// A generator whose numbers depend on the seed and the purpose alone.
    pub(crate) fn new(seed: u64, stream: Stream) -> Self {
        let mut random = Self { state: seed };
        let scattered = random.bits();
        random.state = scattered ^ (stream as u64).wrapping_mul(0xd134_2543_de82_ef95);
        random.bits();
        random
    }

    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `low..high`.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        // 53 random bits, the width of the significand.
        let unit = (self.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        low + (high - low) * unit
    }

    /// A whole number in `low..high`; `low` if the range is empty.
    pub(crate) fn whole(&mut self, low: usize, high: usize) -> usize {
        let drawn = self.between(low as f64, high as f64) as usize;
        drawn.min(high.saturating_sub(1)).max(low)
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller, 1958).
    pub(crate) fn normal(&mut self) -> f64 {
        // 1 - u is in (0, 1], so the logarithm is finite.
        let radius = (-2.0 * (1.0 - self.between(0.0, 1.0)).ln()).sqrt();
        radius * (TAU * self.between(0.0, 1.0)).cos()
    }

    /// Three normal numbers.
    pub(crate) fn normal3(&mut self) -> [f64; 3] {
        std::array::from_fn(|_| self.normal())
    }
}

/// A smooth curve without beginning or end that wanders around 0 with standard deviation 1: a few sines of unrelated frequencies.
#[derive(Clone, Debug)]
pub(crate) struct Wander {
    waves: [(f64, f64); Self::WAVES],
}

impl Wander {
    const WAVES: usize = 4;

    /// A curve that goes up and down about `frequency` times per unit of its argument.
    pub(crate) fn new(random: &mut Random, frequency: f64) -> Self {
        Self { waves: std::array::from_fn(|_| (TAU * frequency * random.between(0.5, 1.5), random.between(0.0, TAU))) }
    }

    /// The value at `x`.
    pub(crate) fn at(&self, x: f64) -> f64 {
        let sum: f64 = self.waves.iter().map(|(pace, start)| (pace * x + start).sin()).sum();
        sum * (2.0 / Self::WAVES as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_what_they_say() {
        let mut random = Random::new(1, Stream::Noise);
        let drawn: Vec<f64> = (0..20_000).map(|_| random.normal()).collect();
        let mean = drawn.iter().sum::<f64>() / 20_000.0;
        let variance = drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04, "mean {mean}, variance {variance}");
        assert!((0..1000).all(|_| (3..7).contains(&random.whole(3, 7))));
        assert_eq!(random.whole(5, 5), 5, "an empty range");
    }

    #[test]
    fn seeds_and_streams_differ_and_repeat() {
        let first = |seed, stream| Random::new(seed, stream).bits();
        assert_eq!(first(1, Stream::Gait), first(1, Stream::Gait));
        assert_ne!(first(1, Stream::Gait), first(2, Stream::Gait));
        assert_ne!(first(1, Stream::Gait), first(1, Stream::Gaps));
    }

    #[test]
    fn wandering_stays_around_zero() {
        let wander = Wander::new(&mut Random::new(3, Stream::Gait), 0.5);
        let values: Vec<f64> = (0..50_000).map(|i| wander.at(f64::from(i) * 0.01)).collect();
        let square = values.iter().map(|x| x * x).sum::<f64>() / 50_000.0;
        assert!((square - 1.0).abs() < 0.1, "{square}");
    }
}
