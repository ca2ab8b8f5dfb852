//! The table of channels of a log of tracking.

use crate::log::channels::descriptor;
use crate::log::sink::Topic;

/// A topic. To add one: its definition in `proto/`, a variant here with a row in `topic`, and its row in `docs/mcap-log.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    /// How the axes of the sequence lie in a room whose z axis points up; once, and only if they lie otherwise.
    Axes,
    /// One [`EmRound`](crate::log::schema::EmRound) per round of EM.
    Rounds,
    /// One [`TrackedFrame`](crate::log::schema::TrackedFrame) per frame.
    Frames,
    /// What was measured.
    Cloud,
    /// The surface of the body.
    Model,
    /// Its joints as lines.
    Skeleton,
    /// What happened, in words.
    Log,
}

impl Channel {
    /// All of them, in the order in which messages of the same time are written.
    pub const ALL: [Self; 7] = [Self::Axes, Self::Rounds, Self::Frames, Self::Cloud, Self::Model, Self::Skeleton, Self::Log];

    pub fn topic(self) -> Topic {
        let (name, schema, descriptor): (_, _, &[u8]) = match self {
            Self::Axes => ("/tf", "foxglove.FrameTransforms", descriptor!("FrameTransforms")),
            Self::Rounds => ("/em/rounds", "mocap_repair.EmRound", descriptor!("EmRound")),
            Self::Frames => ("/track/frames", "mocap_repair.TrackedFrame", descriptor!("TrackedFrame")),
            Self::Cloud => ("/cloud", "foxglove.PointCloud", descriptor!("PointCloud")),
            Self::Model => ("/model", "foxglove.PointCloud", descriptor!("PointCloud")),
            Self::Skeleton => ("/skeleton", "foxglove.SceneUpdate", descriptor!("SceneUpdate")),
            Self::Log => ("/log", "foxglove.Log", descriptor!("Log")),
        };
        Topic { name, schema, descriptor }
    }

    /// The topic's name.
    pub fn name(self) -> &'static str {
        self.topic().name
    }
}
