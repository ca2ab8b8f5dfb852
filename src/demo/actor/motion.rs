//! Motions as functions of time, so that every frame rate samples the same motion.

use super::posture::{ArmPosture, LegPosture, Posture};
use crate::random::{Random, Stream, Wander};
use std::f64::consts::TAU;

/// What an actor does. Every motion starts in the reference pose and leaves it smoothly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Walking on a circle to the left, with swinging arms. It does not end.
    Walk,
    /// Gymnastics, repeated every [`Motion::GYM_SECS`]: two steps with high knees and spread arms (until 1.9 s),
    /// a jump with arms swung up (until 3.3 s), hands resting on the belly (until 4.7 s), bending forward into a handstand (until 7 s), and back.
    Gym,
}

impl Motion {
    /// Length of the gymnastics.
    pub const GYM_SECS: f64 = 8.4;
    /// Radius of the circle of the walk, in cm.
    const CIRCLE_CM: f64 = 170.0;

    /// The point on the floor around which the motion takes place, in cm, if it begins over the origin. Cameras look there.
    pub fn stage(self) -> [f64; 3] {
        match self {
            Self::Walk => [Self::CIRCLE_CM, 0.0, 0.0],
            Self::Gym => [0.0, 0.0, 30.0],
        }
    }
}

/// The habits of one actor.
#[derive(Clone, Debug)]
pub(super) struct Habits {
    wanders: Vec<Wander>,
    stride_secs: f64,
    vigour: f64,
    /// The first step is the left foot's, or the right one's.
    start: f64,
}

/// Seconds until a walk is in full swing.
const START_SECS: f64 = 1.2;

impl Habits {
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, Stream::Gait);
        let stride_secs = random.between(1.05, 1.2);
        let vigour = random.between(0.9, 1.15);
        let start = if random.between(0.0, 1.0) < 0.5 { 0.0 } else { 0.5 };
        Self { wanders: (0..12).map(|_| Wander::new(&mut random, 0.4)).collect(), stride_secs, vigour, start }
    }

    /// The posture at a time. Before 0 and at 0 it is the reference.
    pub(super) fn posture(&self, motion: Motion, secs: f64, reference: &Posture, leg_cm: f64) -> Posture {
        match motion {
            Motion::Walk => reference.mixed(&self.walk(secs, leg_cm), ramp(secs / START_SECS)),
            Motion::Gym => self.gym(secs, reference),
        }
    }

    /// A posture of a walk. Phases are shares of a stride since the heel strike of a foot.
    fn walk(&self, secs: f64, leg_cm: f64) -> Posture {
        // The speed grows smoothly: the distance is its integral.
        let x = (secs / START_SECS).clamp(0.0, 1.0);
        let moved_secs = if secs < START_SECS { START_SECS * x * x * x * (1.0 - 0.5 * x) } else { secs - 0.5 * START_SECS };
        let strides = self.start + 0.25 + moved_secs / self.stride_secs;
        let stride_cm = 1.5 * leg_cm * self.vigour;
        let heading = moved_secs / self.stride_secs * stride_cm / Motion::CIRCLE_CM;
        let wander = |i: usize| self.wanders[i].at(secs);
        let turn = TAU * strides;
        let leg = |late: f64| {
            let phase = strides - late;
            LegPosture {
                forward: 9.0 + self.vigour * 21.0 * (TAU * (phase + 0.04)).cos() + 6.0 * hump(phase, 0.85, 8.0),
                aside: 1.0,
                outward: 6.0,
                knee: 5.0 + 13.0 * hump(phase, 0.14, 12.0) + self.vigour * 54.0 * hump(phase, 0.72, 5.0),
                toes_down: -2.0 - 8.0 * hump(phase, 0.42, 6.0) + 18.0 * hump(phase, 0.63, 20.0),
            }
        };
        let arm = |late: f64, i: usize| {
            let swing = -(TAU * (strides - late) - 0.15).cos();
            ArmPosture {
                forward: 1.0 + 21.0 * self.vigour * swing + 1.5 * wander(i),
                aside: 11.0 + 1.5 * wander(i + 1),
                inward: 18.0 + 5.0 * swing,
                elbow: 24.0 + 11.0 * swing + 2.0 * wander(i + 2),
                wrist: 6.0 + 5.0 * swing,
            }
        };
        Posture {
            place: [Motion::CIRCLE_CM * (1.0 - heading.cos()), Motion::CIRCLE_CM * heading.sin()],
            above: 0.0,
            pelvis: [heading.to_degrees() - 5.0 * turn.cos(), 4.0 + 1.0 * (2.0 * turn).cos(), 3.0 * (turn + 0.3).sin()],
            back: [6.0 * turn.cos() + 0.8 * wander(6), 2.0 + 0.8 * wander(7), -3.0 * (turn + 0.4).sin()],
            head: [2.0 * wander(8), 2.0 * wander(9), 1.0 * wander(10)],
            arms: [arm(0.0, 0), arm(0.5, 3)],
            legs: [leg(0.0), leg(0.5)],
        }
    }

    fn gym(&self, secs: f64, reference: &Posture) -> Posture {
        let rounds = (secs / Motion::GYM_SECS).floor().max(0.0);
        let secs = (secs - rounds * Motion::GYM_SECS).max(0.0);
        let keys = self.keys(reference);
        let next = keys.iter().position(|key| key.0 > secs).unwrap_or(keys.len() - 1).max(1);
        let (before, after) = (&keys[next - 1], &keys[next]);
        let mut posture = before.1.mixed(&after.1, ramp((secs - before.0) / (after.0 - before.0)));
        // Who jumps flies on a parabola.
        let flight = (secs - HOP_SECS.0) / (HOP_SECS.1 - HOP_SECS.0);
        if (0.0..1.0).contains(&flight) {
            let half = 0.5 * (HOP_SECS.1 - HOP_SECS.0);
            posture.above = 0.5 * 981.0 * half * half * 4.0 * flight * (1.0 - flight);
        }
        posture
    }

    /// The postures of the gymnastics, with their times in seconds.
    fn keys(&self, reference: &Posture) -> Vec<(f64, Posture)> {
        let arm = |forward: f64, aside: f64, inward: f64, elbow: f64| ArmPosture { forward, aside, inward, elbow, wrist: 5.0 };
        let leg = |forward: f64, knee: f64, toes_down: f64| LegPosture { forward, aside: 4.0, outward: 5.0, knee, toes_down };
        let stand = Posture {
            pelvis: [0.0, 2.0, 0.0],
            back: [0.0, 1.0, 0.0],
            arms: [arm(2.0, 12.0, 10.0, 15.0); 2],
            legs: [leg(1.0, 4.0, -1.0); 2],
            ..Posture::default()
        };
        let at = |posture: Posture, ahead: f64| Posture { place: [0.0, ahead], ..posture };
        let v = self.vigour;
        let high = leg(92.0 * v, 98.0, 10.0);
        let spread = [arm(5.0, 84.0 * v, 0.0, 12.0); 2];
        let right_up =
            Posture { arms: spread, legs: [leg(2.0, 6.0, -4.0), high], pelvis: [4.0, 0.0, -3.0], back: [-3.0, 2.0, 2.0], ..stand };
        let left_up =
            Posture { arms: spread, legs: [high, leg(2.0, 6.0, -4.0)], pelvis: [-4.0, 0.0, 3.0], back: [3.0, 2.0, -2.0], ..stand };
        let crouch = Posture {
            pelvis: [0.0, 28.0, 0.0],
            back: [0.0, 5.0, 0.0],
            head: [0.0, -10.0, 0.0],
            arms: [arm(-35.0, 10.0, 0.0, 10.0); 2],
            legs: [leg(75.0, 88.0, -22.0); 2],
            ..stand
        };
        let stretched = Posture {
            pelvis: [0.0, -3.0, 0.0],
            back: [0.0, -4.0, 0.0],
            arms: [arm(162.0, 8.0, 0.0, 8.0); 2],
            legs: [leg(-4.0, 4.0, 32.0); 2],
            ..stand
        };
        let landing =
            Posture { arms: [arm(60.0, 20.0, 0.0, 20.0); 2], legs: [leg(48.0, 62.0, -17.0); 2], pelvis: [0.0, 20.0, 0.0], ..stand };
        let resting = Posture { arms: [arm(16.0, 14.0, 62.0, 96.0), arm(18.0, 13.0, 58.0, 101.0)], head: [0.0, 8.0, 0.0], ..stand };
        let sway = Posture { pelvis: [3.0, 3.0, 2.0], back: [3.0, 3.0, 1.0], ..resting };
        let bend = Posture {
            pelvis: [0.0, 75.0, 0.0],
            back: [0.0, 6.0, 0.0],
            arms: [arm(120.0, 10.0, 0.0, 5.0); 2],
            legs: [leg(78.0, 12.0, -4.0); 2],
            ..stand
        };
        let hands_down =
            Posture { pelvis: [0.0, 128.0, 0.0], arms: [arm(145.0, 10.0, 0.0, 5.0); 2], legs: [leg(112.0, 22.0, 12.0); 2], ..bend };
        let upside = Posture {
            pelvis: [0.0, 180.0, 0.0],
            back: [0.0, -4.0, 0.0],
            arms: [arm(163.0, 8.0, 0.0, 5.0); 2],
            legs: [leg(2.0, 6.0, 25.0), leg(-8.0, 10.0, 25.0)],
            ..stand
        };
        vec![
            (0.0, *reference),
            (0.5, at(stand, 0.0)),
            (0.85, at(right_up, 10.0)),
            (1.2, at(stand, 28.0)),
            (1.55, at(left_up, 38.0)),
            (1.9, at(stand, 56.0)),
            (2.25, at(crouch, 50.0)),
            (2.65, at(stretched, 56.0)),
            (2.9, at(stretched, 60.0)),
            (3.25, at(landing, 58.0)),
            (3.55, at(stand, 60.0)),
            (3.9, at(resting, 60.0)),
            (4.3, at(sway, 60.0)),
            (4.7, at(resting, 60.0)),
            (5.2, at(bend, 52.0)),
            (5.6, at(hands_down, 50.0)),
            (6.3, at(upside, 112.0)),
            (6.7, at(upside, 112.0)),
            (7.3, at(hands_down, 50.0)),
            (7.9, at(stand, 40.0)),
            (Motion::GYM_SECS, *reference),
        ]
    }
}

/// When the jump leaves the floor and when it lands.
const HOP_SECS: (f64, f64) = (2.6, 3.08);

/// 0 before 0, 1 after 1, with no jump in velocity or acceleration (the minimum-jerk curve of Flash and Hogan, 1985).
fn ramp(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

/// 1 where the phase is at `centre`, falling to either side, more steeply the larger `sharp` is; it repeats with every stride.
fn hump(phase: f64, centre: f64, sharp: f64) -> f64 {
    (sharp * ((TAU * (phase - centre)).cos() - 1.0)).exp()
}
