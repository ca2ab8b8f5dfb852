//! The table of channels: what is written where, and when a moment of the take is in the time of the log.

/// A topic of the log. To add one: its definition in `proto/`, a variant here with a row in each `match`, and its rows in `docs/mcap-log.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    /// How the axes of the take lie in a room whose z axis points up; once, and only if they lie otherwise.
    Axes,
    /// One [`EmLikelihood`](super::schema::EmLikelihood) per iteration.
    Likelihood,
    /// One [`EmBoneResiduals`](super::schema::EmBoneResiduals) per iteration.
    BoneResiduals,
    /// One [`BoneLengths`](super::schema::BoneLengths) per frame.
    BoneLengths,
    /// One [`MarkerStates`](super::schema::MarkerStates) per frame.
    MarkerState,
    /// The markers as they were read.
    Raw,
    /// The markers as they were written.
    Repaired,
    /// Bones as lines, filled markers as balls.
    Skeleton,
    /// What happened, in words.
    Log,
}

/// The descriptor set that the build wrote for a message.
macro_rules! descriptor {
    ($message:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/", $message, ".binpb"))
    };
}
pub(super) use descriptor;

impl Channel {
    /// All of them, in the order in which messages of the same time are written.
    pub const ALL: [Self; 9] = [
        Self::Axes,
        Self::Likelihood,
        Self::BoneResiduals,
        Self::BoneLengths,
        Self::MarkerState,
        Self::Raw,
        Self::Repaired,
        Self::Skeleton,
        Self::Log,
    ];

    /// The topic's name.
    pub fn topic(self) -> &'static str {
        match self {
            Self::Axes => "/tf",
            Self::Likelihood => "/em/likelihood",
            Self::BoneResiduals => "/em/bone_residuals",
            Self::BoneLengths => "/take/bone_lengths",
            Self::MarkerState => "/take/marker_state",
            Self::Raw => "/markers/raw",
            Self::Repaired => "/markers/repaired",
            Self::Skeleton => "/skeleton",
            Self::Log => "/log",
        }
    }

    /// Full name of the message.
    pub fn schema(self) -> &'static str {
        match self {
            Self::Axes => "foxglove.FrameTransforms",
            Self::Likelihood => "mocap_repair.EmLikelihood",
            Self::BoneResiduals => "mocap_repair.EmBoneResiduals",
            Self::BoneLengths => "mocap_repair.BoneLengths",
            Self::MarkerState => "mocap_repair.MarkerStates",
            Self::Raw | Self::Repaired => "foxglove.PointCloud",
            Self::Skeleton => "foxglove.SceneUpdate",
            Self::Log => "foxglove.Log",
        }
    }

    /// The message's `FileDescriptorSet`, imports included.
    pub fn descriptor(self) -> &'static [u8] {
        match self {
            Self::Axes => descriptor!("FrameTransforms"),
            Self::Likelihood => descriptor!("EmLikelihood"),
            Self::BoneResiduals => descriptor!("EmBoneResiduals"),
            Self::BoneLengths => descriptor!("BoneLengths"),
            Self::MarkerState => descriptor!("MarkerStates"),
            Self::Raw | Self::Repaired => descriptor!("PointCloud"),
            Self::Skeleton => descriptor!("SceneUpdate"),
            Self::Log => descriptor!("Log"),
        }
    }
}

/// The time of tick `k` (a frame, or an iteration) in ns after frame 0.
///
/// A ratio, never a sum of rounded periods: those drift, by 72 µs an hour at 60 Hz.
/// `k`·10⁹ is exact up to nine million ticks and the division rounds once, so the result is the nearest nanosecond.
pub(super) fn tick_ns(k: u32, rate_hz: f64) -> u64 {
    (f64::from(k) * 1e9 / rate_hz).round() as u64
}

/// A time of the log as a field of a message.
pub(super) fn timestamp(ns: u64) -> prost_types::Timestamp {
    // Both fit by construction: 2^64 ns are 2^35 s.
    prost_types::Timestamp { seconds: (ns / 1_000_000_000).cast_signed(), nanos: (ns % 1_000_000_000) as i32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_ratios() {
        for (k, rate_hz, ns) in [
            (0, 59.94, 0),
            (1, 100.0, 10_000_000),
            (3, 120.0, 25_000_000),
            (1, 59.94, 16_683_350),
            (5994, 59.94, 100_000_000_000),
            (599_400, 119.88, 5_000_000_000_000),
            (1, 3.0, 333_333_333),
            (2, 3.0, 666_666_667),
        ] {
            assert_eq!(tick_ns(k, rate_hz), ns, "{k} at {rate_hz} Hz");
        }
    }

    #[test]
    fn timestamps_carry_into_seconds() {
        assert_eq!(timestamp(2_000_000_001), prost_types::Timestamp { seconds: 2, nanos: 1 });
        assert_eq!(timestamp(999_999_999), prost_types::Timestamp { seconds: 0, nanos: 999_999_999 });
    }
}
