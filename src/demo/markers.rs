//! Where the markers sit, and how the skin moves under them.

use super::walker::{Pose, Segment, Side};
use crate::random::{Random, Stream, Wander};
use nalgebra::{Point3, Vector3};

/// A marker on its segment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Attachment {
    pub(super) name: &'static str,
    pub(super) segment: Segment,
    /// Mean position in the frame of the segment.
    offset_mm: [f64; 3],
    /// Root mean square of the motion of skin and muscle against the bone: small on the skull, large on a thigh.
    soft_mm: f64,
}

const fn on(name: &'static str, segment: Segment, offset_mm: [f64; 3], soft_mm: f64) -> Attachment {
    Attachment { name, segment, offset_mm, soft_mm }
}

/// The 41 markers of a full-body set as laboratories with Vicon cameras use it, in alphabetical order.
/// The sides differ a little, as they do when a person places markers on a person.
#[rustfmt::skip] // a table
pub(super) const MARKERS: [Attachment; 41] = {
    use Segment::{Clavicle, Foot, Forearm, Hand, Head, Pelvis, Shank, Thigh, Thorax, UpperArm};
    use Side::{Left, Right};
    [
        on("C7", Thorax, [-60.0, 0.0, 430.0], 1.6),
        on("CLAV", Thorax, [75.0, 2.0, 365.0], 1.5),
        on("LANK", Shank(Left), [-6.0, 42.0, -412.0], 1.5),
        on("LBHD", Head, [-55.0, 52.0, 175.0], 0.5),
        on("LBWT", Pelvis, [-120.0, 45.0, 108.0], 2.5),
        on("LELB", UpperArm(Left), [-6.0, 42.0, -298.0], 2.2),
        on("LFHD", Head, [100.0, 77.0, 158.0], 0.5),
        on("LFIN", Hand(Left), [12.0, 22.0, -78.0], 1.6),
        on("LFRM", Forearm(Left), [12.0, 38.0, -130.0], 2.5),
        on("LFWT", Pelvis, [78.0, 122.0, 92.0], 3.2),
        on("LHEE", Foot(Left), [-66.0, 2.0, -44.0], 0.9),
        on("LKNE", Thigh(Left), [0.0, 57.0, -424.0], 3.2),
        on("LMT5", Foot(Left), [84.0, 52.0, -64.0], 0.8),
        on("LSHN", Shank(Left), [38.0, 30.0, -250.0], 2.6),
        on("LSHO", Clavicle(Left), [-78.0, 158.0, 42.0], 2.8),
        on("LTHI", Thigh(Left), [16.0, 78.0, -318.0], 4.5),
        on("LTOE", Foot(Left), [126.0, 4.0, -45.0], 0.8),
        on("LUPA", UpperArm(Left), [4.0, 50.0, -212.0], 3.6),
        on("LWRA", Forearm(Left), [44.0, 8.0, -248.0], 1.3),
        on("LWRB", Forearm(Left), [-42.0, 10.0, -250.0], 1.3),
        on("RANK", Shank(Right), [-2.0, -42.0, -412.0], 1.5),
        on("RBAC", Thorax, [-112.0, -88.0, 322.0], 3.4),
        on("RBHD", Head, [-54.0, -52.0, 176.0], 0.5),
        on("RBWT", Pelvis, [-117.0, -47.0, 110.0], 2.5),
        on("RELB", UpperArm(Right), [-8.0, -40.0, -303.0], 2.2),
        on("RFHD", Head, [99.0, -77.0, 158.0], 0.5),
        on("RFIN", Hand(Right), [14.0, -24.0, -77.0], 1.6),
        on("RFRM", Forearm(Right), [15.0, -40.0, -126.0], 2.5),
        on("RFWT", Pelvis, [76.0, -124.0, 90.0], 3.2),
        on("RHEE", Foot(Right), [-66.0, -2.0, -45.0], 0.9),
        on("RKNE", Thigh(Right), [1.0, -59.0, -428.0], 3.2),
        on("RMT5", Foot(Right), [83.0, -52.0, -63.0], 0.8),
        on("RSHN", Shank(Right), [40.0, -32.0, -253.0], 2.6),
        on("RSHO", Clavicle(Right), [-83.0, -160.0, 40.0], 2.8),
        on("RTHI", Thigh(Right), [14.0, -80.0, -321.0], 4.5),
        on("RTOE", Foot(Right), [126.0, -4.0, -46.0], 0.8),
        on("RUPA", UpperArm(Right), [7.0, -48.0, -207.0], 3.6),
        on("RWRA", Forearm(Right), [42.0, -10.0, -250.0], 1.3),
        on("RWRB", Forearm(Right), [-41.0, -10.0, -255.0], 1.3),
        on("STRN", Thorax, [124.0, 0.0, 165.0], 2.0),
        on("T10", Thorax, [-114.0, 8.0, 160.0], 2.2),
    ]
};

/// A marker on the skin of one actor.
#[derive(Clone, Debug)]
struct Skin {
    offset_mm: Vector3<f64>,
    /// Displacement in mm for each unit of the segment's [`pull`](super::walker::Placed::pull).
    give_mm: [Vector3<f64>; 3],
    /// The marker's own slow drift, by axis.
    drift: [Wander; 3],
    drift_mm: f64,
}

/// All markers of one actor.
#[derive(Clone, Debug)]
pub(super) struct Suit {
    skins: Vec<Skin>,
    stature: f64,
}

/// How much of the soft-tissue motion is drift. The rest follows joints and impacts.
const DRIFT_SHARE: f64 = 0.35;
/// How often the drift turns round, in Hz.
const DRIFT_HZ: f64 = 0.2;

impl Suit {
    /// The markers of an actor who depends on the seed. `softness` scales the motion of the skin; 0 makes the segments rigid.
    pub(super) fn new(seed: u64, softness: f64) -> Self {
        let mut random = Random::new(seed, Stream::Actor);
        let stature = random.between(0.95, 1.05);
        let skins = MARKERS
            .iter()
            .map(|attachment| {
                let soft_mm = attachment.soft_mm * softness;
                let followed_mm = soft_mm * (1.0 - DRIFT_SHARE * DRIFT_SHARE).sqrt();
                let gives: [Vector3<f64>; 3] = std::array::from_fn(|_| Vector3::from(random.normal3()));
                let size = gives.iter().map(Vector3::norm_squared).sum::<f64>().sqrt();
                Skin {
                    offset_mm: Vector3::from(attachment.offset_mm),
                    give_mm: gives.map(|give| give * (followed_mm / size)),
                    drift: std::array::from_fn(|_| Wander::new(&mut random, DRIFT_HZ)),
                    drift_mm: soft_mm * DRIFT_SHARE / 3.0_f64.sqrt(),
                }
            })
            .collect();
        Self { skins, stature }
    }

    /// Positions of all markers in the world, in mm, in the order of [`MARKERS`].
    pub(super) fn positions_mm<'a>(&'a self, pose: &'a Pose, time_secs: f64) -> impl Iterator<Item = [f64; 3]> + 'a {
        MARKERS.iter().zip(&self.skins).map(move |(attachment, skin)| {
            let placed = pose.segment(attachment.segment);
            let pulled: Vector3<f64> = skin.give_mm.iter().zip(placed.pull).map(|(give, pull)| give * pull).sum();
            let drifted = Vector3::from(std::array::from_fn(|axis| skin.drift[axis].at(time_secs))) * skin.drift_mm;
            let on_segment = Point3::from(skin.offset_mm + pulled + drifted);
            ((placed.world_from_segment * on_segment).coords * self.stature).into()
        })
    }
}
