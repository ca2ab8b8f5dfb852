//! Observers of the solvers: they write down what happens and change nothing.
//!
//! [`McapLog`] writes a file that viewers for robotics logs plot and play; `docs/mcap-log.md` describes it for its readers.

mod bone_residuals;
mod channels;
mod check;
mod mcap;
mod terminal;

/// The messages of the log, generated from the definitions in `proto/`, whose comments they carry.
pub mod schema {
    #![allow(clippy::pedantic)] // generated code

    include!(concat!(env!("OUT_DIR"), "/mocap_repair.rs"));
}

pub use bone_residuals::{BoneResiduals, Residual};
pub use mcap::{About, Attachment, Closing, LogError, METADATA, McapLog, Written};
pub use terminal::Terminal;
