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
