//! What only a process can show: exit codes, what is printed where, and which files are there afterwards.
//!
//! - `repairing`: the main job, and the demonstration take
//! - `converting`: `convert`, `.zst`, `--missing`, `--float`
//! - `auto`: what the default method says about its fills
//! - `options`: what each option changes in the files
//! - `outliers`: samples that no body makes
//! - `refusals`: what is refused, in which words, and that nothing is left behind
//! - `interruptions`: runs that are killed
//! - `readme`: the commands of the README
//!
//! How good the filled samples are is measured elsewhere, on the library.
#![allow(clippy::unwrap_used)] // A test program: it fails by panicking.

mod auto;
mod converting;
mod interruptions;
mod lab;
mod options;
mod outliers;
mod readme;
mod refusals;
mod repairing;
