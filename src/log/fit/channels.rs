//! The table of channels of a log of solving for a motion.

use crate::log::channels::descriptor;
use crate::log::sink::Topic;

/// A topic. To add one: its definition in `proto/`, a variant here with a row in `topic`, and its row in `docs/mcap-log.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    /// How the axes of the rig lie in a room whose z axis points up; once, and only if they lie otherwise.
    Axes,
    /// One [`SolveRound`](crate::log::schema::SolveRound) per round.
    Rounds,
    /// One [`SolvedFrame`](crate::log::schema::SolvedFrame) per frame.
    Frames,
    /// Where markers were seen.
    Seen,
    /// Where the body has them.
    Expected,
    /// The surface of the body.
    Model,
    /// Its joints as lines.
    Skeleton,
    /// What happened, in words.
    Log,
}

impl Channel {
    /// All of them, in the order in which messages of the same time are written.
    pub const ALL: [Self; 8] = [Self::Axes, Self::Rounds, Self::Frames, Self::Seen, Self::Expected, Self::Model, Self::Skeleton, Self::Log];

    pub fn topic(self) -> Topic {
        let (name, schema, descriptor): (_, _, &[u8]) = match self {
            Self::Axes => ("/tf", "foxglove.FrameTransforms", descriptor!("FrameTransforms")),
            Self::Rounds => ("/solve/rounds", "mocap_repair.SolveRound", descriptor!("SolveRound")),
            Self::Frames => ("/solve/frames", "mocap_repair.SolvedFrame", descriptor!("SolvedFrame")),
            Self::Seen => ("/markers/seen", "foxglove.PointCloud", descriptor!("PointCloud")),
            Self::Expected => ("/markers/expected", "foxglove.PointCloud", descriptor!("PointCloud")),
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
