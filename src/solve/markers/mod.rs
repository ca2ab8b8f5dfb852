//! The motion of a skeleton from labelled markers: every frame by itself first, then all frames at once with a prior on accelerations,
//! so that a limb with few markers goes on moving as limbs do, and one without any comes to rest near where it usually is.

mod band;
mod begin;
mod calibrate;
mod pass;
mod smooth;
#[cfg(test)]
mod tests;
mod told;

pub use calibrate::{Calibration, Known, calibrate};
pub use pass::{Round, Seen, Settings, Solution, Stage, solve};
pub use told::Told;
