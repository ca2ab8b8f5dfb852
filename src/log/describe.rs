//! What a reader of the log needs to know about the take besides its messages: the attachment `take.json`.

use super::mcap::{About, Attachment};
use super::names::{self, unique};
use super::{Shown, Up, frames};
use serde::Serialize;

/// Name of the attachment.
pub const NAME: &str = "take.json";

/// The take, as `take.json` describes it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, serde::Deserialize)]
pub struct Description {
    /// Frames per second.
    pub rate_hz: f64,
    /// Number of frames.
    pub frames: usize,
    /// The file's own number of frame 0.
    pub first_frame: i64,
    /// By how much the file's own number grows from frame to frame.
    pub frame_step: i64,
    /// Unit of length of the file, such as `mm`.
    pub unit: String,
    /// The axis that points up, such as `+z`; absent if nobody knows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<String>,
    /// True if `up` was guessed from the shape of what moves.
    pub up_guessed: bool,
    /// Labels, in the order of `/take/marker_state` and of the field `marker` of the clouds.
    pub markers: Vec<String>,
    /// In the order of `/take/bone_lengths`.
    pub bones: Vec<DescribedBone>,
}

/// A bone of `take.json`.
#[derive(Clone, Debug, PartialEq, Serialize, serde::Deserialize)]
pub struct DescribedBone {
    /// As in `/take/bone_lengths`.
    pub label: String,
    /// One end, by its place in the list of markers, from 0.
    pub a: usize,
    /// The other end.
    pub b: usize,
    /// Mean length, mm.
    pub length_mm: f64,
    /// Standard deviation of the length where both ends were measured, mm.
    pub spread_mm: f64,
}

impl Description {
    /// Of a take that is shown.
    pub(crate) fn new(about: &About, shown: &Shown<'_>) -> Self {
        let take = shown.raw;
        let columns = frames::columns(take);
        let place = |column: usize| columns.binary_search(&column).ok();
        Self {
            rate_hz: about.rate_hz,
            frames: take.frames(),
            first_frame: take.first_frame,
            frame_step: take.frame_step,
            unit: about.unit.clone(),
            up: about.up.direction().map(|d| d.to_string()),
            up_guessed: matches!(about.up, Up::Guessed(_)),
            markers: unique(columns.iter().map(|&column| take.display_label(column))),
            bones: names::bones(take, shown.bones)
                .into_iter()
                .zip(shown.bones)
                .filter_map(|(label, bone)| {
                    let (a, b) = (place(bone.a)?, place(bone.b)?);
                    Some(DescribedBone { label, a, b, length_mm: bone.length_mm, spread_mm: bone.spread_mm })
                })
                .collect(),
        }
    }
}

/// The attachment.
pub(super) fn attachment(about: &About, shown: &Shown<'_>) -> Attachment {
    // plain numbers and texts always become JSON
    let bytes = serde_json::to_vec_pretty(&Description::new(about, shown)).unwrap_or_default();
    Attachment { name: NAME.to_owned(), media_type: "application/json".to_owned(), bytes }
}
