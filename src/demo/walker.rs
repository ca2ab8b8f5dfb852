//! A walking body: for every moment, where each segment is and how hard its soft tissue is pulled.
//!
//! Pelvis, trunk, head and arms follow Fourier series of the gait phase.
//! The feet come first, as footsteps on the floor with heel and toe rockers, and the knees follow from hip and ankle:
//! that is what keeps a standing foot standing, which no series of joint angles would.
//! The curves have the shape and size of textbook gait (Perry and Burnfield, *Gait Analysis*, 2010); they claim no more than that.
//!
//! Every segment's frame has x forward, y to the left and z up when standing.
//! Limbs hang down: the far end of an upper arm is at negative z.

use super::path::Oval;
use crate::random::{Random, Stream, Wander};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{SQRT_2, TAU};

/// A rigid part of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Segment {
    Pelvis,
    Thorax,
    Head,
    Clavicle(Side),
    UpperArm(Side),
    Forearm(Side),
    Hand(Side),
    Thigh(Side),
    Shank(Side),
    Foot(Side),
}

/// Left or right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Left,
    Right,
}

impl Side {
    /// The sign of y on this side.
    pub(super) fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }
}

/// Where a segment is, and what its soft tissue feels: three numbers around 0 of size 1, from joint angles and impacts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) world_from_segment: Isometry3<f64>,
    pub(super) pull: [f64; 3],
}

impl Placed {
    fn new(world_from_segment: Isometry3<f64>, pull: [f64; 3]) -> Self {
        Self { world_from_segment, pull }
    }
}

/// The whole body at one moment.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    pelvis: Placed,
    thorax: Placed,
    head: Placed,
    arms: [Arm; 2],
    legs: [Leg; 2],
}

#[derive(Clone, Debug)]
struct Arm {
    clavicle: Placed,
    upper: Placed,
    forearm: Placed,
    hand: Placed,
}

#[derive(Clone, Debug)]
struct Leg {
    thigh: Placed,
    shank: Placed,
    foot: Placed,
}

impl Pose {
    /// One segment.
    pub(super) fn segment(&self, segment: Segment) -> &Placed {
        match segment {
            Segment::Pelvis => &self.pelvis,
            Segment::Thorax => &self.thorax,
            Segment::Head => &self.head,
            Segment::Clavicle(side) => &self.arms[side as usize].clavicle,
            Segment::UpperArm(side) => &self.arms[side as usize].upper,
            Segment::Forearm(side) => &self.arms[side as usize].forearm,
            Segment::Hand(side) => &self.arms[side as usize].hand,
            Segment::Thigh(side) => &self.legs[side as usize].thigh,
            Segment::Shank(side) => &self.legs[side as usize].shank,
            Segment::Foot(side) => &self.legs[side as usize].foot,
        }
    }
}

// Lengths of an adult of about 1.75 m, in mm.
const HIP_HALF_WIDTH_MM: f64 = 85.0;
const THIGH_MM: f64 = 430.0;
const SHANK_MM: f64 = 420.0;
const ANKLE_HEIGHT_MM: f64 = 85.0;
const UPPER_ARM_MM: f64 = 300.0;
const FOREARM_MM: f64 = 255.0;
/// The heel's contact with the floor, ahead of the ankle.
const HEEL_MM: f64 = -50.0;
/// The ball's contact with the floor, ahead of the ankle.
const BALL_MM: f64 = 130.0;

const STRIDE_MM: f64 = 1250.0;
const STRIDE_SECS: f64 = 1.1;
/// Mean height of the hips.
const HIP_HEIGHT_MM: f64 = 898.0;
/// The share of a stride after heel strike at which the hips pass over the ankle.
const OVER_FOOT: f64 = 0.252;
/// The shares of a stride after heel strike between which a foot travels. The heel still slides a few millimetres when it strikes.
const TRAVEL: (f64, f64) = (0.56, 1.03);

/// Somebody who walks. All of it is a smooth function of time.
#[derive(Clone, Debug)]
pub(super) struct Walker {
    path: Oval,
    start_phase: f64,
    /// Strides take longer and shorter.
    hurry: Wander,
    /// Steps reach farther and less far.
    reach: Wander,
    /// Amplitudes grow and shrink: trunk, arms, heels and toes.
    vigour: [Wander; 4],
    /// Joints that wander on their own: trunk, head, arms.
    posture: [Wander; 12],
}

impl Walker {
    /// A walker whose habits depend on the seed.
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, Stream::Gait);
        Self {
            path: Oval::new(),
            start_phase: random.between(0.0, 1.0),
            hurry: Wander::new(&mut random, 0.3),
            reach: Wander::new(&mut random, 0.3),
            vigour: std::array::from_fn(|_| Wander::new(&mut random, 0.35)),
            posture: std::array::from_fn(|_| Wander::new(&mut random, 0.3)),
        }
    }

    /// Strides since some right heel strike: whole numbers are right heel strikes, halves are left ones.
    pub(super) fn phase(&self, time_secs: f64) -> f64 {
        self.start_phase + time_secs / STRIDE_SECS + 0.011 * self.hurry.at(time_secs)
    }

    /// The distance walked, in mm, without the sway within a stride.
    fn distance_mm(&self, phase: f64) -> f64 {
        STRIDE_MM * (phase + 0.012 * self.reach.at(phase))
    }

    /// The body at one moment.
    pub(super) fn pose(&self, time_secs: f64) -> Pose {
        let phase = self.phase(time_secs);
        let turn = TAU * phase;
        let distance_mm = self.distance_mm(phase);
        let heading = yaw(Oval::heading_rad(distance_mm));
        // The body leans into the curve as far as gravity and speed ask for.
        let speed = STRIDE_MM / STRIDE_SECS;
        let lean = speed * speed * Oval::curvature_per_mm(distance_mm) / 9810.0;
        let strong = |i: usize| 1.0 + 0.05 * self.vigour[i].at(phase);
        let wander = |i: usize| self.posture[i].at(phase);
        let bounce = SQRT_2 * (2.0 * turn - 1.0).cos();

        // The pelvis rises over the standing foot, sways towards it, and is fastest when lowest.
        let over = TAU * (phase - 0.30);
        let along = distance_mm - 11.0 * (2.0 * over).sin();
        let sway = 20.0 * strong(0) * -over.cos() + 0.25 * lean * HIP_HEIGHT_MM;
        let height = HIP_HEIGHT_MM + 19.0 * strong(0) * (2.0 * over).cos();
        let ground = self.path.place_mm(along);
        let place = Vector3::new(ground.x, ground.y, height) + heading * Vector3::new(0.0, sway, 0.0);
        let pelvis_turned = heading
            * yaw(degrees(5.0 * strong(0) * turn.cos()))
            * roll(degrees(-3.5 * strong(0) * (turn + 0.3).sin()) - 0.3 * lean)
            * pitch(degrees(7.0 + 1.2 * (2.0 * turn + 0.5).cos()));
        let world_from_pelvis = Isometry3::from_parts(place.into(), pelvis_turned);

        let waist = world_from_pelvis * Point3::new(-30.0, 0.0, 110.0);
        let thorax_turned = heading
            * yaw(degrees(-4.5 * strong(1) * (turn - 0.2).cos() + 0.8 * wander(0)))
            * roll(degrees(1.8 * strong(1) * (turn + 0.5).sin() + 0.5 * wander(1)) - lean)
            * pitch(degrees(4.0 + 1.0 * (2.0 * turn + 1.2).cos() + 0.6 * wander(2)));
        let world_from_thorax = Isometry3::from_parts(waist.into(), thorax_turned);

        // The head looks ahead, into the curve, whatever the trunk does.
        let neck = world_from_thorax * Point3::new(-30.0, 0.0, 450.0);
        let gaze = Oval::heading_rad(distance_mm + 350.0);
        let head_turned = yaw(gaze + degrees(1.0 * (turn - 0.4).cos() + 2.0 * wander(3)))
            * roll(degrees(0.6 * turn.sin() + 0.8 * wander(4)) - 0.3 * lean)
            * pitch(degrees(6.0 + 0.9 * (2.0 * turn + 2.0).cos() + 1.5 * wander(5)));
        let world_from_head = Isometry3::from_parts(neck.into(), head_turned);

        let arm = |side: Side| self.arm(side, phase, &world_from_thorax);
        let leg = |side: Side| self.leg(side, phase, &world_from_pelvis, heading);
        Pose {
            pelvis: Placed::new(world_from_pelvis, [SQRT_2 * turn.cos(), SQRT_2 * turn.sin(), bounce]),
            thorax: Placed::new(world_from_thorax, [SQRT_2 * (turn - 0.3).cos(), wander(1), bounce]),
            head: Placed::new(world_from_head, [wander(3), wander(5), bounce]),
            arms: [arm(Side::Left), arm(Side::Right)],
            legs: [leg(Side::Left), leg(Side::Right)],
        }
    }

    fn arm(&self, side: Side, phase: f64, world_from_thorax: &Isometry3<f64>) -> Arm {
        let sign = side.sign();
        let turn = TAU * (phase - offset(side));
        let strong = 1.0 + 0.07 * self.vigour[2].at(phase);
        let wander = |i: usize| self.posture[6 + 3 * (side as usize) + i].at(phase);
        // At its own heel strike a side's arm is at its rearmost.
        let swing = -(turn - 0.15).cos();
        let flexion = degrees(-3.0 + 20.0 * strong * swing + 2.0 * (2.0 * turn).cos() + 1.5 * wander(0));
        let bend = -(turn - 0.5).cos();
        let elbow = degrees(25.0 + 12.0 * strong * bend + 2.5 * (2.0 * turn + 0.6).cos() + 1.5 * wander(1));
        let pronation = degrees(25.0 + 5.0 * (turn + 0.8).sin() + 4.0 * wander(2));

        let thorax_from_clavicle = Isometry3::from_parts(
            Translation3::new(45.0, sign * 20.0, 370.0),
            yaw(degrees(-sign * 3.0 * strong * swing)) * roll(degrees(sign * (1.0 * (2.0 * turn + 1.0).cos() + 0.8 * wander(1)))),
        );
        let world_from_clavicle = world_from_thorax * thorax_from_clavicle;
        let shoulder = world_from_clavicle * Point3::new(-80.0, sign * 155.0, -10.0);
        let upper_turned = world_from_thorax.rotation
            * roll(degrees(sign * (9.0 + 1.5 * (2.0 * turn).cos() + 1.0 * wander(2))))
            * pitch(-flexion)
            * yaw(degrees(-sign * (12.0 + 4.0 * swing)));
        let world_from_upper = Isometry3::from_parts(shoulder.into(), upper_turned);
        let upper_from_forearm = Isometry3::from_parts(Translation3::new(0.0, 0.0, -UPPER_ARM_MM), pitch(-elbow) * yaw(-sign * pronation));
        let world_from_forearm = world_from_upper * upper_from_forearm;
        let forearm_from_hand = Isometry3::from_parts(
            Translation3::new(0.0, 0.0, -FOREARM_MM),
            roll(degrees(-sign * (8.0 + 5.0 * (turn - 1.2).sin() + 2.0 * wander(0)))) * pitch(degrees(-5.0 + 4.0 * (turn - 0.9).cos())),
        );
        let world_from_hand = world_from_forearm * forearm_from_hand;

        let jolt = SQRT_2 * (2.0 * turn - 1.4).cos();
        Arm {
            clavicle: Placed::new(world_from_clavicle, [SQRT_2 * swing, wander(1), jolt]),
            upper: Placed::new(world_from_upper, [SQRT_2 * swing, SQRT_2 * bend, jolt]),
            forearm: Placed::new(world_from_forearm, [SQRT_2 * bend, wander(2), jolt]),
            hand: Placed::new(world_from_hand, [SQRT_2 * (turn - 1.2).sin(), wander(0), jolt]),
        }
    }

    fn leg(&self, side: Side, phase: f64, world_from_pelvis: &Isometry3<f64>, heading: UnitQuaternion<f64>) -> Leg {
        let since_first = phase - offset(side);
        let step = since_first.floor();
        let share = since_first - step; // of the stride, since heel strike
        let (mut world_from_foot, toe_up) = self.foot(side, phase, step, share);
        let hip = (world_from_pelvis * Point3::new(0.0, side.sign() * HIP_HALF_WIDTH_MM, 0.0)).coords;
        let span = world_from_foot.translation.vector - hip;
        let down = span.normalize();
        // A step that is too long for the leg is taken a few millimetres shorter, so that the knee never locks.
        let span_mm = softly_below(span.norm(), THIGH_MM + SHANK_MM - 1.0);
        let ankle = hip + down * span_mm;
        world_from_foot.translation = ankle.into();

        // Two links between two known points: the law of cosines gives the knee.
        let at_hip = ((span_mm * span_mm + THIGH_MM * THIGH_MM - SHANK_MM * SHANK_MM) / (2.0 * span_mm * THIGH_MM)).clamp(-1.0, 1.0).acos();
        let at_knee =
            ((THIGH_MM * THIGH_MM + SHANK_MM * SHANK_MM - span_mm * span_mm) / (2.0 * THIGH_MM * SHANK_MM)).clamp(-1.0, 1.0).acos();
        let knee_rad = std::f64::consts::PI - at_knee;
        // The knee points half where the body goes and half where the foot does.
        let towards = heading * Vector3::x() + world_from_foot.rotation * Vector3::x();
        let ahead = (towards - down * towards.dot(&down)).normalize();
        let knee = hip + (down * at_hip.cos() + ahead * at_hip.sin()) * THIGH_MM;
        let left = ahead.cross(&down);
        let limb = |top: Vector3<f64>, bottom: Vector3<f64>| {
            let up = (top - bottom).normalize();
            let basis = Matrix3::from_columns(&[left.cross(&up), left, up]);
            Isometry3::from_parts(top.into(), UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(basis)))
        };

        // Impact shakes the leg for the first fifth of the stride.
        let shaken = (share / 0.2).min(1.0);
        let impact = 2.5 * bump(shaken) * (TAU * shaken).sin();
        let bent = (knee_rad - 0.45) / 0.33;
        let reached = (knee - hip).dot(&(heading * Vector3::x())) / (0.3 * THIGH_MM);
        let tilted = (toe_up + 0.2) / 0.4;
        Leg {
            thigh: Placed::new(limb(hip, knee), [bent, reached, impact]),
            shank: Placed::new(limb(knee, ankle), [bent, tilted, impact]),
            foot: Placed::new(world_from_foot, [tilted, 0.0, impact]),
        }
    }

    /// Frame of a foot (its origin is the ankle) and how far the toes point up, in rad.
    fn foot(&self, side: Side, phase: f64, step: f64, share: f64) -> (Isometry3<f64>, f64) {
        let [previous, here, next] = [step - 1.0, step, step + 1.0].map(|step| self.footstep(side, step));
        let left = ramp(share, TRAVEL.0, TRAVEL.1);
        let still_to_come = 1.0 - ramp(share + 1.0, TRAVEL.0, TRAVEL.1);
        let ground = here.0 + (next.0 - here.0) * left - (here.0 - previous.0) * still_to_come;
        let direction = here.1 + (next.1 - here.1) * left - (here.1 - previous.1) * still_to_come;

        // Shares of the stride at which heel and toes go up and down; chosen so that the knee follows textbook gait.
        let heel = |share: f64| ramp(share, 0.855, 0.962) - ramp(share, 0.962, 1.06);
        let landing = degrees(20.0) * (1.0 + 0.06 * self.vigour[3].at(phase));
        let leaving = degrees(57.0) * (1.0 + 0.04 * self.vigour[1].at(phase));
        let toe_up = landing * (heel(share) + heel(share + 1.0)) - leaving * (ramp(share, 0.44, 0.69) - ramp(share, 0.69, 0.875));

        // The foot rolls over its heel when the toes are up and over its ball when they are down, with a round sole in between.
        let contact = f64::midpoint(HEEL_MM, BALL_MM) - 0.5 * (BALL_MM - HEEL_MM) * (toe_up / degrees(8.0)).tanh();
        let turned = yaw(direction);
        let rolled = pitch(-toe_up);
        let ankle = turned * (Vector3::new(contact, 0.0, 0.0) + rolled * Vector3::new(-contact, 0.0, ANKLE_HEIGHT_MM));
        let lift = 40.0 * bump((share - TRAVEL.0) / (TRAVEL.1 - TRAVEL.0));
        (Isometry3::from_parts((ground + ankle + Vector3::new(0.0, 0.0, lift)).into(), turned * rolled), toe_up)
    }

    /// The floor under the ankle of a standing foot, and where the foot points, in rad.
    fn footstep(&self, side: Side, step: f64) -> (Vector3<f64>, f64) {
        let distance_mm = self.distance_mm(step + offset(side) + OVER_FOOT);
        let heading = Oval::heading_rad(distance_mm);
        // Steps are never quite as wide as the last one; the golden ratio scatters without a pattern.
        let width = 48.0 + 9.0 * self.reach.at(1.618 * step + 7.0 * offset(side));
        let ground = self.path.place_mm(distance_mm);
        let beside = yaw(heading) * Vector3::new(0.0, side.sign() * width, 0.0);
        (Vector3::new(ground.x, ground.y, 0.0) + beside, heading + side.sign() * degrees(6.0))
    }
}

/// The phase of a side's heel strikes.
fn offset(side: Side) -> f64 {
    match side {
        Side::Left => 0.5,
        Side::Right => 0.0,
    }
}

fn degrees(angle: f64) -> f64 {
    angle.to_radians()
}

/// Turns to the left.
fn yaw(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

/// Leans to the right.
fn roll(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle_rad)
}

/// Leans forward; what hangs down swings back.
fn pitch(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle_rad)
}

/// `x` where it is well below `limit`, and smoothly held below it elsewhere.
fn softly_below(x: f64, limit: f64) -> f64 {
    const SOFTNESS: f64 = 5.0;
    limit - SOFTNESS * ((limit - x) / SOFTNESS).exp().ln_1p()
}

/// 0 before `from`, 1 after `to`, with no jump in velocity or acceleration (the minimum-jerk curve of Flash and Hogan, 1985).
fn ramp(x: f64, from: f64, to: f64) -> f64 {
    let x = ((x - from) / (to - from)).clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

/// 0 outside 0..1, 1 in the middle, with no jump in velocity or acceleration.
fn bump(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    (4.0 * x * (1.0 - x)).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Knees that bend the right way, never lock and never fold too far, for several walkers.
    #[test]
    fn knees_bend_like_knees() {
        for seed in 1..=20 {
            let walker = Walker::new(seed);
            let mut least = f64::INFINITY;
            let mut most: f64 = 0.0;
            for i in 0..2400 {
                let pose = walker.pose(f64::from(i) / 60.0);
                for side in [Side::Left, Side::Right] {
                    let rotation = |segment: Segment| pose.segment(segment).world_from_segment.rotation;
                    let thigh_from_shank = rotation(Segment::Thigh(side)).inverse() * rotation(Segment::Shank(side));
                    let bent = (thigh_from_shank * Vector3::z()).x.asin().to_degrees();
                    least = least.min(bent);
                    most = most.max(bent);
                }
            }
            assert!(least > 3.0 && least < 20.0, "seed {seed}: the straightest knee is at {least}°");
            assert!(most > 45.0 && most < 80.0, "seed {seed}: the most bent knee is at {most}°");
        }
    }

    #[test]
    fn limbs_keep_their_lengths() {
        let walker = Walker::new(1);
        for i in 0..300 {
            let pose = walker.pose(f64::from(i) * 0.02);
            for side in [Side::Left, Side::Right] {
                let at = |segment: Segment| pose.segment(segment).world_from_segment.translation.vector;
                assert!(((at(Segment::Thigh(side)) - at(Segment::Shank(side))).norm() - THIGH_MM).abs() < 1e-6);
                assert!(((at(Segment::Shank(side)) - at(Segment::Foot(side))).norm() - SHANK_MM).abs() < 1e-6);
                assert!(((at(Segment::Forearm(side)) - at(Segment::Hand(side))).norm() - FOREARM_MM).abs() < 1e-6);
            }
        }
    }

    /// The arm of one side swings forward with the leg of the other.
    #[test]
    fn arms_swing_against_legs() {
        let walker = Walker::new(1);
        let mut product = 0.0;
        for i in 0..600 {
            let pose = walker.pose(f64::from(i) * 0.02);
            let world_from_pelvis = pose.segment(Segment::Pelvis).world_from_segment;
            let ahead = |segment: Segment| (world_from_pelvis.inverse() * pose.segment(segment).world_from_segment).translation.x;
            let hands = ahead(Segment::Hand(Side::Left)) - ahead(Segment::Hand(Side::Right));
            let feet = ahead(Segment::Foot(Side::Left)) - ahead(Segment::Foot(Side::Right));
            product += hands * feet;
        }
        assert!(product < 0.0, "{product}");
    }
}
