//! What only a process can show: exit codes, what is printed where, and which files are there afterwards.
//!
//! - `repairing`: the main job, and the demonstration take
//! - `converting`: `convert`, `.zst`, `--missing`, `--float`
//! - `logs`: what is in the log on demand, and what is taken out of it
//! - `batch`, `batch_killed`, `batch_harm`: many takes, runs of them that are ended from outside, and what they must not harm
//! - `batch_report`: the report on them
//! - `auto`: what the default method says about its fills
//! - `options`: what each option changes in the files
//! - `outliers`: samples that no body makes
//! - `refusals`: what is refused, in which words, and that nothing is left behind
//! - `reporting`: the report to look at
//! - `interruptions`: runs that are killed
//! - `tracking`: `track`
//! - `solving`: `solve`, and gaps that are filled from a body
//! - `terminal`: width, colours and characters of what is told
//! - `config`: options from a file
//! - `shells`: completions and manual pages
//! - `readme`: the commands of the README and of docs/usage.md
//!
//! How good the filled samples are is measured elsewhere, on the library.
#![allow(clippy::unwrap_used)] // A test program: it fails by panicking.

mod auto;
mod batch;
mod batch_harm;
mod batch_killed;
mod batch_report;
mod config;
mod converting;
mod interruptions;
mod lab;
mod logs;
mod options;
mod outliers;
mod readme;
mod refusals;
mod repairing;
mod reporting;
mod shells;
mod solving;
mod terminal;
mod tracking;
