//! Faults put into a take on purpose.

use formats::{Origin, Take, TakeBuilder};
use std::ops::Range;

/// Random numbers that mean the same for ever: SplitMix64.
pub struct Dice(u64);

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    /// From 0 to 1.
    pub fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A whole number of the range.
    pub fn whole(&mut self, range: Range<usize>) -> usize {
        range.start + (self.share() * (range.end - range.start) as f64) as usize
    }

    /// A whole number of the range, all scales alike.
    pub fn scale(&mut self, range: Range<usize>) -> usize {
        let (low, high) = ((range.start as f64).ln(), (range.end as f64).ln());
        ((low + self.share() * (high - low)).exp() as usize).clamp(range.start, range.end - 1)
    }

    /// Any direction.
    fn direction(&mut self) -> [f64; 3] {
        loop {
            let p: [f64; 3] = std::array::from_fn(|_| 2.0 * self.share() - 1.0);
            let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            if (0.1..=1.0).contains(&length) {
                return p.map(|x| x / length);
            }
        }
    }
}

/// What is done to a take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// 1 to 5 frames are off by so many mm.
    Spike(f64),
    /// 10 to 100 frames are.
    Excursion(f64),
    /// The last or first 1 to 3 frames beside a new gap are.
    Ghost(f64),
    /// Two markers, from so many mm apart to so many, carry each other's label for 1 to 200 frames or to the end.
    Swap(f64, f64),
    /// The same between two gaps of both.
    SwapInGaps(f64, f64),
}

impl Fault {
    pub fn name(self) -> String {
        match self {
            Self::Spike(mm) => format!("spike, 1 to 5 frames, {mm} mm"),
            Self::Excursion(mm) => format!("excursion, 10 to 100 frames, {mm} mm"),
            Self::Ghost(mm) => format!("ghost, 1 to 3 frames beside a gap, {mm} mm"),
            Self::Swap(low, high) => format!("swap of markers {low} to {high} mm apart"),
            Self::SwapInGaps(low, high) => format!("swap between gaps, {low} to {high} mm apart"),
        }
    }
}

/// One fault that was put in: the samples that are wrong.
pub struct Put {
    pub markers: Vec<usize>,
    pub frames: Range<usize>,
}

fn distance(take: &Take, frame: usize, a: usize, b: usize) -> Option<f64> {
    let (a, b) = (take.position_mm(frame, a)?, take.position_mm(frame, b)?);
    Some((0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt())
}

/// Puts faults of one sort into a take, no two of them near each other in time or on one marker.
pub fn put(take: &Take, fault: Fault, dice: &mut Dice) -> (Take, Vec<Put>) {
    let mut builder = TakeBuilder::from(take.clone());
    let frames = take.frames();
    let apart = (0.25 * take.rate_hz) as usize;
    let mut done: Vec<Put> = Vec::new();
    let mut used: Vec<Range<usize>> = Vec::new();
    for _ in 0..40 {
        let length = match fault {
            Fault::Spike(_) => dice.whole(1..6),
            Fault::Excursion(_) => dice.whole(10..101),
            Fault::Ghost(_) => dice.whole(1..4),
            Fault::Swap(..) | Fault::SwapInGaps(..) => dice.scale(1..201),
        };
        let to_end = matches!(fault, Fault::Swap(..)) && dice.share() < 0.1;
        let gap = dice.whole(5..31);
        if frames < length + 2 * gap + 24 {
            continue;
        }
        let start = dice.whole(gap + 8..frames - length - gap - 8);
        let end = if to_end { frames } else { start + length };
        let around = start.saturating_sub(apart + gap)..end + apart + gap;
        let marker = dice.whole(0..take.markers.len());
        let markers = match fault {
            Fault::Swap(low, high) | Fault::SwapInGaps(low, high) => {
                let fits =
                    |&other: &usize| other != marker && distance(take, start, marker, other).is_some_and(|mm| (low..high).contains(&mm));
                let others: Vec<usize> = (0..take.markers.len()).filter(fits).collect();
                if others.is_empty() {
                    continue;
                }
                vec![marker, others[dice.whole(0..others.len())]]
            }
            _ => vec![marker],
        };
        let crowded = used.iter().any(|r| r.start < around.end && around.start < r.end)
            || done.iter().any(|p| p.markers.iter().any(|m| markers.contains(m)));
        let seen =
            (start.saturating_sub(gap + 4)..(end + gap + 4).min(frames)).all(|f| markers.iter().all(|&m| take.position_mm(f, m).is_some()));
        if crowded || !seen || end - start > frames / 3 {
            continue;
        }
        used.push(start.saturating_sub(gap)..end + gap);
        let mut set = |frame: usize, marker: usize, p: [f64; 3]| builder.set(frame, marker, p, Origin::Measured);
        match fault {
            Fault::Spike(mm) | Fault::Excursion(mm) | Fault::Ghost(mm) => {
                let way = dice.direction();
                for frame in start..end {
                    let shaken = dice.direction();
                    if let Some(p) = take.position_mm(frame, marker) {
                        set(frame, marker, std::array::from_fn(|k| p[k] + mm * (way[k] + 0.1 * shaken[k])));
                    }
                }
                if matches!(fault, Fault::Ghost(_)) {
                    let hidden = if dice.share() < 0.5 { start - gap..start } else { end..end + gap };
                    hidden.for_each(|f| builder.hide(f, marker));
                }
            }
            Fault::Swap(..) | Fault::SwapInGaps(..) => {
                let (a, b) = (markers[0], markers[1]);
                for frame in start..end {
                    if let (Some(p), Some(q)) = (take.position_mm(frame, a), take.position_mm(frame, b)) {
                        set(frame, a, q);
                        set(frame, b, p);
                    }
                }
                if matches!(fault, Fault::SwapInGaps(..)) {
                    for frame in (start - gap..start).chain(end..end + gap) {
                        builder.hide(frame, a);
                        builder.hide(frame, b);
                    }
                }
            }
        }
        done.push(Put { markers, frames: start..end });
    }
    (builder.build(), done)
}

/// Every `step`th frame.
pub fn decimated(take: &Take, step: usize) -> Take {
    let frames = take.frames().div_ceil(step);
    let mut thin = TakeBuilder::new(take.markers.clone(), frames, take.rate_hz / step as f64).up(take.up);
    for frame in 0..frames {
        for marker in 0..take.markers.len() {
            if let Some(p) = take.position_mm(frame * step, marker) {
                thin.set(frame, marker, p, Origin::Measured);
            }
        }
    }
    thin.build()
}
