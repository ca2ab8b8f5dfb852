//! Fills the gaps of motion-capture takes so that bones keep their lengths, and leaves everything else as it was.
//!
//! Start with [`repair::repair`], the story of one take from file to file.
//! Reading and writing files is the other crate, `formats`; [`solve`] is the mathematics and knows no files.
//!
//! - [`repair`]: open, decide, solve, fill, write, prove, rename
//! - [`error`]: why something could not be done
//! - [`gaps`], [`bones`]: what is missing and what is stiff
//! - [`suspects`]: samples that no body makes
//! - [`solve`]: problems, solvers, the loop, and its observers
//! - [`log`]: observers that write: the MCAP log, the progress line
//! - [`rig`], [`track`]: a body with a skeleton, and how it is followed through clouds of points
//! - [`fit`]: the motion of that body from labelled markers
//! - [`fills`], [`report`], [`explain`], [`inspect`]: what is told afterwards, or beforehand
//! - [`page`]: the report to look at, one HTML file
//! - [`staging`], [`verify`]: files appear whole or not at all, and only after they were proven
//! - [`demo`]: a synthetic take to try it on
//! - [`typeset`]: how wide and in which colours text is set
//! - [`batch`]: many takes, planned, repaired and accounted for
//! - [`cli`]: what was typed

pub mod batch;
pub mod bones;
pub mod cli;
mod compression;
pub mod convert;
pub mod demo;
pub mod error;
pub mod explain;
pub mod fills;
pub mod fit;
pub mod gaps;
pub mod input;
pub mod inspect;
pub mod log;
pub mod missing;
pub mod output;
pub mod page;
mod pattern;
mod random;
pub mod repair;
pub mod report;
pub mod rig;
pub mod runs;
pub mod solve;
pub mod staging;
pub mod suspects;
pub mod track;
pub mod typeset;
pub mod verify;
