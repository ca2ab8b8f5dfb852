//! The measures of a body, and the bones that follow from them: where joints are in the reference pose, and how far they go.

use super::posture::{ArmPosture, Hinge, LegPosture, Posture, hinge, turned};
use crate::random::{Random, Stream};
use formats::rig::{Joint, JointKind, Limit, Skeleton};
use nalgebra::{Rotation3, Vector3};

/// The joints in the order of the skeleton.
pub(super) const ROOT: usize = 0;
pub(super) const TORSO: usize = 1;
pub(super) const HEAD: usize = 2;
/// The first joint of an arm, left and right: upper arm, forearm and hand follow each other.
pub(super) const ARM: [usize; 2] = [3, 6];
/// The first joint of a leg, left and right: thigh, shank and foot follow each other.
pub(super) const LEG: [usize; 2] = [9, 12];
/// Number of joints.
pub(super) const JOINTS: usize = 15;
/// Left and right as the sign of x.
pub(super) const SIGN: [f64; 2] = [1.0, -1.0];

const NAMES: [&str; JOINTS] = [
    "root", "torso", "head", "l_uarm", "l_farm", "l_hand", "r_uarm", "r_farm", "r_hand", "l_thigh", "l_shank", "l_foot", "r_thigh",
    "r_shank", "r_foot",
];

/// Sizes of a body. Lengths in cm; girths are factors of an average body's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measures {
    pub(super) stature: f64,
    pub(super) hip_height: f64,
    pub(super) thigh: f64,
    pub(super) ankle_height: f64,
    pub(super) upper_arm: f64,
    pub(super) forearm: f64,
    pub(super) hand: f64,
    pub(super) foot: f64,
    /// Half the distance between the shoulders.
    pub(super) shoulder: f64,
    /// Half the distance between the hips.
    pub(super) hip: f64,
    pub(super) trunk_girth: f64,
    pub(super) belly_girth: f64,
    pub(super) arm_girth: f64,
    pub(super) leg_girth: f64,
    pub(super) head_girth: f64,
}

/// A body without flesh.
#[derive(Clone, Debug)]
pub(super) struct Figure {
    pub(super) measures: Measures,
    /// The posture of the reference pose.
    pub(super) reference: Posture,
    /// Joint centres in the reference pose, in cm.
    pub(super) centres: [Vector3<f64>; JOINTS],
    /// The axes of the limbs in the reference pose: turns the upright posture into it.
    pub(super) turned: [Rotation3<f64>; JOINTS],
    /// Where the back bends.
    pub(super) lumbar: Vector3<f64>,
}

impl Figure {
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, Stream::Body);
        // Cut at two standard deviations: nobody here is a giant.
        let mut about = |mean: f64, deviation: f64| mean * (1.0 + deviation * random.normal().clamp(-2.0, 2.0));
        let stature = about(174.0, 0.035);
        let measures = Measures {
            stature,
            hip_height: stature * about(0.518, 0.012),
            thigh: stature * about(0.242, 0.015),
            ankle_height: stature * 0.045,
            upper_arm: stature * about(0.162, 0.025),
            forearm: stature * about(0.146, 0.025),
            hand: stature * about(0.105, 0.03),
            foot: stature * about(0.150, 0.03),
            shoulder: stature * about(0.106, 0.035),
            hip: stature * about(0.057, 0.04),
            trunk_girth: about(1.0, 0.05),
            belly_girth: about(1.0, 0.08),
            arm_girth: about(1.0, 0.07),
            leg_girth: about(1.0, 0.06),
            head_girth: about(1.0, 0.025),
        };
        let [aside, elbow, spread] = [about(42.0, 0.1), about(22.0, 0.2), about(6.0, 0.2)];
        let arm = ArmPosture { forward: 4.0, aside, inward: 0.0, elbow, wrist: 5.0 };
        let leg = LegPosture { forward: 3.0, aside: spread, outward: 7.0, knee: 8.0, toes_down: -5.0 };
        let reference = Posture { arms: [arm; 2], legs: [leg; 2], ..Posture::default() };
        let turned = axes(&reference);
        let s = stature / 174.0;
        let mut centres = [Vector3::zeros(); JOINTS];
        let pelvis = Vector3::new(0.0, measures.hip_height + 2.0 * s, 0.0);
        centres[ROOT] = pelvis;
        centres[TORSO] = pelvis;
        centres[HEAD] = Vector3::new(0.0, stature * 0.862, 0.5 * s);
        let down = |joint: usize, length: f64| turned[joint] * Vector3::new(0.0, -length, 0.0);
        for (side, sign) in SIGN.into_iter().enumerate() {
            let [arm, leg] = [ARM[side], LEG[side]];
            centres[arm] = Vector3::new(sign * measures.shoulder, stature * 0.812, -0.5 * s);
            centres[arm + 1] = centres[arm] + down(arm, measures.upper_arm);
            centres[arm + 2] = centres[arm + 1] + down(arm + 1, measures.forearm);
            centres[leg] = pelvis + Vector3::new(sign * measures.hip, -2.0 * s, 0.5 * s);
            centres[leg + 1] = centres[leg] + down(leg, measures.thigh);
            centres[leg + 2] = centres[leg + 1] + down(leg + 1, measures.shank());
        }
        let lumbar = pelvis + Vector3::new(0.0, 13.0 * s, -2.0 * s);
        Self { measures, reference, centres, turned, lumbar }
    }

    pub(super) fn skeleton(&self) -> Skeleton {
        let joint = |index: usize| {
            let kind = match (index, hinge_of(index)) {
                (ROOT, _) => JointKind::Translate,
                (_, Some((kind, sign))) => JointKind::Revolute { axis: self.axis(index, kind, sign).into() },
                (_, None) => JointKind::Ball,
            };
            Joint { name: NAMES[index].to_owned(), kind, parent: parent(index), centre: self.centres[index].into(), state: [0.0; 3] }
        };
        Skeleton { joints: (0..JOINTS).map(joint).collect() }
    }

    /// The axis of a hinge in the reference pose.
    pub(super) fn axis(&self, joint: usize, kind: Hinge, sign: f64) -> Vector3<f64> {
        self.turned[parent(joint).unwrap_or(ROOT)] * hinge(kind, sign)
    }

    /// How far joints go. Root and torso go anywhere.
    pub(super) fn limits(&self) -> Vec<Option<Limit>> {
        let limit = |joint: usize| {
            if let Some((kind, sign)) = hinge_of(joint) {
                let _ = sign;
                let at = bent(&self.reference, joint);
                let (least, most) = match kind {
                    Hinge::Elbow => (-at, 155.0 - at),
                    Hinge::Knee => (-3.0 - at, 152.0 - at),
                    Hinge::Wrist => (-80.0, 80.0),
                    Hinge::Ankle => (-60.0, 60.0),
                };
                return Some(Limit::Revolute { least: least.to_radians(), most: most.to_radians() });
            }
            let (heading, bank, most) = match joint {
                ROOT | TORSO => return None,
                HEAD => (Vector3::y(), -Vector3::z(), (60.0_f64, 80.0_f64)),
                _ => {
                    let axes = &self.turned[joint];
                    (-(axes * Vector3::y()), axes * Vector3::z(), if ARM.contains(&joint) { (170.0, 170.0) } else { (130.0, 130.0) })
                }
            };
            let (heading_most, bank_most) = (most.0.to_radians(), most.1.to_radians());
            Some(Limit::Ball { heading: heading.into(), heading_most, bank: bank.into(), bank_most })
        };
        (0..JOINTS).map(limit).collect()
    }
}

impl Measures {
    pub(super) fn shank(&self) -> f64 {
        self.hip_height - self.thigh - self.ankle_height
    }
}

/// The joint that a joint hangs on.
pub(super) fn parent(joint: usize) -> Option<usize> {
    match joint {
        ROOT => None,
        TORSO => Some(ROOT),
        HEAD => Some(TORSO),
        _ if ARM.contains(&joint) || LEG.contains(&joint) => Some(TORSO),
        _ => Some(joint - 1),
    }
}

/// Which hinge a joint is, and on which side.
pub(super) fn hinge_of(joint: usize) -> Option<(Hinge, f64)> {
    let found = |first: [usize; 2], after: usize| first.iter().position(|&first| first + after == joint).map(|side| SIGN[side]);
    [(ARM, 1, Hinge::Elbow), (ARM, 2, Hinge::Wrist), (LEG, 1, Hinge::Knee), (LEG, 2, Hinge::Ankle)]
        .into_iter()
        .find_map(|(first, after, kind)| Some((kind, found(first, after)?)))
}

/// How far a hinge is bent, in degrees.
pub(super) fn bent(posture: &Posture, joint: usize) -> f64 {
    let side = usize::from(joint >= ARM[1] && joint < LEG[0] || joint >= LEG[1]);
    let (arm, leg) = (posture.arms[side], posture.legs[side]);
    match hinge_of(joint) {
        Some((Hinge::Elbow, _)) => arm.elbow,
        Some((Hinge::Wrist, _)) => arm.wrist,
        Some((Hinge::Knee, _)) => leg.knee,
        Some((Hinge::Ankle, _)) => leg.toes_down,
        None => 0.0,
    }
}

/// The axes of every part in a posture, in the world; head and arms hang on the chest, which is not the pelvis where the back is bent.
pub(super) fn axes(posture: &Posture) -> [Rotation3<f64>; JOINTS] {
    let pelvis = turned(posture.pelvis);
    let chest = pelvis * turned(posture.back);
    let mut axes = [Rotation3::identity(); JOINTS];
    axes[TORSO] = pelvis;
    axes[HEAD] = chest * turned(posture.head);
    for (side, sign) in SIGN.into_iter().enumerate() {
        axes[ARM[side]] = chest * posture.arms[side].shoulder(sign);
        axes[LEG[side]] = pelvis * posture.legs[side].hip(sign);
    }
    for joint in 0..JOINTS {
        if let (Some((kind, sign)), Some(parent)) = (hinge_of(joint), parent(joint)) {
            let axis = nalgebra::Unit::new_normalize(hinge(kind, sign));
            axes[joint] = axes[parent] * Rotation3::from_axis_angle(&axis, bent(posture, joint).to_radians());
        }
    }
    axes
}
