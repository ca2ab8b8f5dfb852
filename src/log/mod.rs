//! Observers of the solvers: they write down what happens and change nothing.
//!
//! [`McapLog`] writes a file that viewers for robotics logs plot and play; `docs/mcap-log.md` describes it for its readers.

mod axes;
mod body;
mod bone_residuals;
mod channels;
mod check;
mod cloud;
mod describe;
mod events;
mod fit;
mod frames;
mod layout;
mod mcap;
mod metadata;
mod names;
mod read;
mod replay;
mod sink;
mod skeleton;
mod terminal;
mod track;

/// The messages of the log, generated from the definitions in `proto/`, whose comments they carry.
pub mod schema {
    #![allow(clippy::pedantic, missing_docs)] // generated code

    include!(concat!(env!("OUT_DIR"), "/mocap_repair.rs"));

    /// Messages that Foxglove defines and viewers know how to draw.
    pub mod foxglove {
        include!(concat!(env!("OUT_DIR"), "/foxglove.rs"));
    }
}

/// Name of the axes in which the take was recorded.
const FRAME_ID: &str = "lab";

/// Name of the axes of the room, z up, if the take's are others.
const ROOM_ID: &str = "world";

pub use bone_residuals::{BoneResiduals, Residual};
pub(crate) use cloud::{Point, metres};
pub(crate) use describe::NAME as DESCRIPTION;
pub use describe::{DescribedBone, Description};
pub use events::{Event, of_gaps, of_suspects};
pub use fit::{FitAbout, write_fit_log};
pub use frames::Shown;
pub(crate) use frames::columns;
pub use mcap::{About, Attachment, Closing, Ended, LogError, McapLog, Up, Whole, Written};
pub use metadata::METADATA;
pub use read::{LogReadError, attachment, extract_layout, is_unfinished};
pub(crate) use replay::{Told, replay};
pub use terminal::Terminal;
pub use track::{TrackAbout, TrackLog};
