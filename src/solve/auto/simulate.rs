//! Simulated gaps: runs of frames in which a marker was seen, as long as the gap that is to be filled.
//!
//! Nearby ones share a block, and whatever is judged on a block is learned without the whole block.

/// Frames in which one marker was seen.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Those frames, ascending.
    pub frames: Vec<usize>,
    /// Number of them before each frame; one entry more than the take has frames.
    before: Vec<u32>,
}

impl Seen {
    /// From one flag for each frame.
    pub fn new(flags: impl Iterator<Item = bool>) -> Self {
        let mut before = vec![0];
        let mut frames = Vec::new();
        for (t, seen) in flags.enumerate() {
            if seen {
                frames.push(t);
            }
            before.push(frames.len() as u32);
        }
        Self { frames, before }
    }

    /// Number of frames of the take.
    pub fn len(&self) -> usize {
        self.before.len() - 1
    }

    /// In how many of `from..to` the marker was seen.
    pub fn count(&self, from: usize, to: usize) -> usize {
        (self.before[to] - self.before[from]) as usize
    }

    /// Number of seen frames before `t`.
    pub fn rank(&self, t: usize) -> usize {
        self.before[t] as usize
    }
}

/// Simulated gaps that are judged together.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// First frame of each.
    pub starts: Vec<usize>,
    /// The frames that must not be learned from.
    pub hidden: std::ops::Range<usize>,
}

/// All simulated gaps for one gap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Simulation {
    /// Length of each in frames; shorter than the gap where the take has no room.
    pub frames: usize,
    /// Those gaps, in blocks.
    pub blocks: Vec<Block>,
}

/// A shorter simulated gap is taken when the take has fewer starts than this for a longer one.
const LEAST_STARTS: usize = 12;

/// How much of the frames of a simulated gap, and of those beside it, must have been seen.
const SEEN_SHARE: f64 = 0.9;

/// Starts are looked for in about this many places.
const PLACES: usize = 4000;

/// Blocks and simulated gaps in each.
const BLOCKS: usize = 5;
const IN_BLOCK: usize = 4;

impl Simulation {
    /// Where gaps like one of `length` frames can be cut from what was seen. Empty if nowhere.
    pub fn new(seen: &Seen, length: usize) -> Self {
        let total = seen.len();
        let stride = (total / PLACES).max(1);
        for share in [1.0, 0.8, 0.6, 0.45, 0.33, 0.25, 0.15, 0.1, 0.0] {
            let frames = ((length as f64 * share) as usize).max(1);
            for side in [12, 4, 1] {
                let enough = |from: usize, to: usize| seen.count(from, to) as f64 >= SEEN_SHARE * (to - from) as f64;
                let fits = |&a: &usize| {
                    let end = a + frames;
                    enough(a, end)
                        && seen.count(a - 1, a) == 1
                        && seen.count(end, end + 1) == 1
                        && enough(a - side, a)
                        && enough(end, end + side)
                };
                let last = total.saturating_sub(frames + side);
                let starts: Vec<usize> = (side..=last).step_by(stride).filter(|&a| a + frames + side <= total).filter(fits).collect();
                if starts.len() >= LEAST_STARTS {
                    return Self { frames, blocks: blocks(&starts, frames, seen) };
                }
            }
        }
        Self::default()
    }

    /// Number of simulated gaps.
    pub fn count(&self) -> usize {
        self.blocks.iter().map(|b| b.starts.len()).sum()
    }
}

/// Evenly over the starts; a block does not hide much more than its share of what was seen, nor than one gap.
fn blocks(starts: &[usize], frames: usize, seen: &Seen) -> Vec<Block> {
    let widest = (seen.frames.len() / BLOCKS).max(frames + frames / 4);
    (0..BLOCKS)
        .map(|k| {
            let own = &starts[k * starts.len() / BLOCKS..(k + 1) * starts.len() / BLOCKS];
            let middle = own[own.len() / 2];
            let reach = widest.saturating_sub(frames) / 2;
            let near: Vec<usize> = own.iter().copied().filter(|a| a.abs_diff(middle) <= reach).collect();
            let mut chosen: Vec<usize> = (0..IN_BLOCK).map(|j| near[j * (near.len() - 1) / (IN_BLOCK - 1)]).collect();
            chosen.dedup();
            let hidden = chosen[0]..chosen.last().copied().unwrap_or(chosen[0]) + frames;
            Block { starts: chosen, hidden }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Runs of seen and missing frames in turn, beginning with seen ones.
    fn mask() -> impl Strategy<Value = Vec<bool>> {
        let run = prop_oneof![3 => 1..8_usize, 2 => 5..150_usize];
        prop::collection::vec(run, 1..30)
            .prop_map(|runs| runs.iter().enumerate().flat_map(|(k, &length)| std::iter::repeat_n(k % 2 == 0, length)).collect())
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn simulated_gaps_are_cut_from_what_was_seen(mask in mask(), length in 1..200_usize) {
            let seen = Seen::new(mask.iter().copied());
            let simulation = Simulation::new(&seen, length);
            let frames = simulation.frames;
            prop_assert_eq!(simulation.count() == 0, simulation.blocks.is_empty());
            prop_assert!(frames <= length);
            for block in &simulation.blocks {
                prop_assert!(!block.starts.is_empty() && block.starts.windows(2).all(|w| w[0] < w[1]));
                prop_assert!(block.hidden.end <= mask.len());
                for &start in &block.starts {
                    let (all, end) = (&mask[start..start + frames], start + frames);
                    prop_assert!(all.iter().filter(|s| **s).count() as f64 >= 0.9 * frames as f64, "{} of {}", start, frames);
                    prop_assert!(start > 0 && mask[start - 1] && mask[end], "{start}..{end} has no edges");
                    prop_assert!(block.hidden.start <= start && end <= block.hidden.end, "{start}..{end} is learned from");
                }
                let widest = (mask.iter().filter(|s| **s).count() / BLOCKS).max(frames + frames / 4);
                prop_assert!(block.hidden.len() <= widest, "a block of {} frames for gaps of {frames}", block.hidden.len());
            }
            // blocks follow each other, and whatever is not hidden is left to learn from
            prop_assert!(simulation.blocks.windows(2).all(|w| w[0].starts.last() < w[1].starts.first()));
            // none is shorter than it must be
            let room = |frames: usize| {
                let whole = |a: &usize| mask[a - 1..=a + frames].iter().all(|s| *s);
                (1..mask.len().saturating_sub(frames)).filter(whole).count()
            };
            prop_assert!(frames == length || room(length) < LEAST_STARTS, "{frames} frames for {length}, of which {} fit", room(length));
            prop_assert!(frames > 0 || room(1) < LEAST_STARTS);
        }

        #[test]
        fn counts_are_those_of_the_mask(mask in mask(), from in 0.0..1.0, to in 0.0..1.0) {
            let seen = Seen::new(mask.iter().copied());
            let at = |share: f64| (share * mask.len() as f64) as usize;
            let (from, to) = (at(f64::min(from, to)), at(f64::max(from, to)));
            let count = |part: &[bool]| part.iter().filter(|s| **s).count();
            prop_assert_eq!((seen.len(), seen.count(from, to), seen.rank(to)), (mask.len(), count(&mask[from..to]), count(&mask[..to])));
            prop_assert!(seen.frames.iter().all(|&t| mask[t]));
            prop_assert_eq!(seen.frames.len(), count(&mask));
        }
    }

    #[test]
    fn takes_that_are_too_short_have_none() {
        for (frames, length) in [(0, 1), (1, 1), (5, 30), (LEAST_STARTS + 1, 1)] {
            assert_eq!(Simulation::new(&Seen::new(vec![true; frames].into_iter()), length), Simulation::default(), "{frames} frames");
        }
        let just_enough = Simulation::new(&Seen::new(vec![true; LEAST_STARTS + 2].into_iter()), 1);
        assert_eq!((just_enough.frames, just_enough.blocks.len()), (1, BLOCKS));
        let never = Simulation::new(&Seen::new(vec![false; 300].into_iter()), 10);
        assert_eq!(never.count(), 0);
        // and one in which every other frame was seen has nothing whole to cut, however long it is
        let flicker = Simulation::new(&Seen::new((0..300).map(|t| t % 2 == 0)), 10);
        assert_eq!(flicker.count(), 0, "{flicker:?}");
    }
}
