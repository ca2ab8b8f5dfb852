//! The flesh on the bones: a function that is negative inside the body, made of rounded cones that melt into each other.

use super::figure::{ARM, Figure, HEAD, LEG, SIGN, TORSO};
use nalgebra::{Matrix3, Vector3};

/// Over how many cm neighbouring cones melt into each other.
const MELT_CM: f64 = 1.3;

/// A cone between two balls, squeezed along one direction.
#[derive(Clone, Debug)]
struct Cone {
    /// The part of the body that it belongs to.
    joint: usize,
    from: Vector3<f64>,
    along: Vector3<f64>,
    /// Radii at both ends.
    radii: [f64; 2],
    /// Stretches the squeezed direction, so that the cone is round again.
    round_from_flat: Matrix3<f64>,
    /// From distances in the round to distances outside; at most 1.
    squeeze: f64,
}

impl Cone {
    fn new(joint: usize, ends: [Vector3<f64>; 2], radii: [f64; 2]) -> Self {
        Self { joint, from: ends[0], along: ends[1] - ends[0], radii, round_from_flat: Matrix3::identity(), squeeze: 1.0 }
    }

    /// The same, `share` times as thick along `across`, a direction of length 1 at right angles to the cone.
    fn flat(mut self, across: Vector3<f64>, share: f64) -> Self {
        self.round_from_flat = Matrix3::identity() + across * across.transpose() * (1.0 / share - 1.0);
        self.squeeze = share;
        self
    }

    /// About the distance from its surface, negative inside.
    fn distance(&self, point: &Vector3<f64>) -> f64 {
        let offset = self.round_from_flat * (point - self.from);
        let along = self.round_from_flat * self.along;
        let share = (offset.dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        let radius = self.radii[0] + (self.radii[1] - self.radii[0]) * share;
        let apart = (offset - along * share).norm();
        // The gradient of the squeezed distance is between 1 and 1 / squeeze; dividing by it keeps flat hands as round as they should be.
        let slope = (self.round_from_flat * (offset - along * share)).norm() / apart.max(1e-9);
        (apart - radius) / slope.max(1.0)
    }
}

/// The whole body.
#[derive(Clone, Debug)]
pub(super) struct Flesh {
    cones: Vec<Cone>,
}

impl Flesh {
    pub(super) fn new(figure: &Figure) -> Self {
        let mut flesh = Self { cones: Vec::new() };
        flesh.trunk(figure);
        flesh.head(figure);
        for side in 0..2 {
            flesh.arm(figure, side);
            flesh.leg(figure, side);
        }
        flesh
    }

    fn trunk(&mut self, figure: &Figure) {
        let (m, s) = (&figure.measures, figure.measures.stature / 174.0);
        let pelvis = figure.centres[TORSO];
        let shoulders = figure.centres[ARM[0]].y;
        let at = |x: f64, y: f64, z: f64| Vector3::new(x, y, z * s);
        let (girth, belly) = (m.trunk_girth * s, m.belly_girth * s);
        let mut put = |ends: [Vector3<f64>; 2], radii: [f64; 2], depth: f64| {
            self.cones.push(Cone::new(TORSO, ends, radii).flat(Vector3::z(), depth));
        };
        put([at(-m.hip * 0.62, pelvis.y, 0.0), at(m.hip * 0.62, pelvis.y, 0.0)], [11.3 * girth; 2], 0.86);
        put([at(0.0, pelvis.y + 5.0 * s, 0.5), at(0.0, pelvis.y + 19.0 * s, 0.5)], [14.6 * belly, 13.6 * belly], 0.72);
        put([at(0.0, pelvis.y + 22.0 * s, 0.0), at(0.0, shoulders - 12.0 * s, -0.5)], [13.8 * girth, 15.6 * girth], 0.70);
        put([at(-8.0 * s, shoulders - 9.0 * s, 2.0), at(8.0 * s, shoulders - 9.0 * s, 2.0)], [9.0 * girth; 2], 0.95);
        put([at(-m.shoulder * 0.72, shoulders - 0.5 * s, -1.0), at(m.shoulder * 0.72, shoulders - 0.5 * s, -1.0)], [6.0 * girth; 2], 0.95);
        put([at(-5.5 * s, shoulders + 3.0 * s, -1.5), at(5.5 * s, shoulders + 3.0 * s, -1.5)], [4.6 * girth; 2], 0.9);
        put([at(0.0, shoulders, -1.0), at(0.0, m.stature * 0.855, 0.0)], [6.4 * girth, 5.7 * girth], 1.0);
        for sign in SIGN {
            put(
                [at(sign * 6.3 * s, pelvis.y - 5.0 * s, -4.5), at(sign * 6.3 * s, pelvis.y + 2.0 * s, -4.2)],
                [8.6 * girth, 7.6 * girth],
                1.0,
            );
        }
    }

    fn head(&mut self, figure: &Figure) {
        let m = &figure.measures;
        let (neck, s) = (figure.centres[HEAD], m.stature / 174.0 * m.head_girth);
        let at = |y: f64, z: f64| neck + Vector3::new(0.0, y * s, z * s);
        // The crown is at the stature, whatever the size of the head.
        let crown = (m.stature - neck.y) / s - 9.2;
        let mut put = |ends: [Vector3<f64>; 2], radii: [f64; 2], breadth: f64| {
            self.cones.push(Cone::new(HEAD, ends, radii.map(|radius| radius * s)).flat(Vector3::x(), breadth));
        };
        put([at(-0.5, 0.0), at(5.0, 1.0)], [5.5, 5.4], 1.0);
        put([at(crown, -1.0), at(crown - 1.0, 2.2)], [9.2, 8.8], 0.84);
        put([at(4.2, 4.8), at(8.0, 4.5)], [4.8, 5.8], 0.95);
        put([at(crown - 4.2, 10.0), at(crown - 2.0, 9.6)], [1.5, 1.2], 1.0);
    }

    fn arm(&mut self, figure: &Figure, side: usize) {
        let (m, joint) = (&figure.measures, ARM[side]);
        let girth = m.arm_girth * m.stature / 174.0;
        let [shoulder, elbow, wrist] = [0, 1, 2].map(|after| figure.centres[joint + after]);
        let mut put = |joint: usize, ends: [Vector3<f64>; 2], radii: [f64; 2]| {
            self.cones.push(Cone::new(joint, ends, radii.map(|radius| radius * girth)));
        };
        put(joint, [shoulder, elbow], [5.6, 4.1]);
        put(joint, [shoulder.lerp(&elbow, 0.35), shoulder.lerp(&elbow, 0.7)], [5.1, 4.7]);
        put(joint + 1, [elbow, elbow.lerp(&wrist, 0.3)], [4.0, 4.3]);
        put(joint + 1, [elbow.lerp(&wrist, 0.3), wrist], [4.3, 2.8]);
        // The palm faces the thigh when the arm hangs.
        let hand = joint + 2;
        let [across, up, ahead] = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| figure.turned[hand] * axis);
        let size = m.hand / 18.0;
        let at = |down: f64, forward: f64| wrist + (ahead * forward - up * down) * size;
        let mut put = |ends: [Vector3<f64>; 2], radii: [f64; 2], share: f64| {
            self.cones.push(Cone::new(hand, ends, radii.map(|radius| radius * size)).flat(across, share));
        };
        put([at(1.0, 0.0), at(8.0, 0.0)], [2.9, 4.0], 0.52);
        put([at(8.0, 0.0), at(15.3, -0.3)], [3.9, 2.7], 0.56);
        put([at(3.0, 2.0), at(8.5, 5.6)], [1.9, 1.4], 0.9);
    }

    fn leg(&mut self, figure: &Figure, side: usize) {
        let (m, joint) = (&figure.measures, LEG[side]);
        let s = m.stature / 174.0;
        let girth = m.leg_girth * s;
        let [hip, knee, ankle] = [0, 1, 2].map(|after| figure.centres[joint + after]);
        let back = figure.turned[joint + 1] * -Vector3::z();
        let mut put = |joint: usize, ends: [Vector3<f64>; 2], radii: [f64; 2]| {
            self.cones.push(Cone::new(joint, ends, radii.map(|radius| radius * girth)));
        };
        let aside = Vector3::x() * SIGN[side] * 0.8;
        put(joint, [hip + aside - Vector3::y() * 3.0, hip.lerp(&knee, 0.5)], [9.0, 7.6]);
        put(joint, [hip.lerp(&knee, 0.5), knee], [7.6, 5.7]);
        put(joint + 1, [knee, knee.lerp(&ankle, 0.3) + back * 1.2], [5.5, 5.7]);
        put(joint + 1, [knee.lerp(&ankle, 0.3) + back * 1.2, ankle], [5.7, 3.7]);
        // The foot is level in the reference pose, whatever the shank does.
        let toes = figure.turned[joint + 2] * Vector3::z();
        let ahead = Vector3::new(toes.x, 0.0, toes.z).normalize();
        let size = m.foot / 26.0;
        let at = |forward: f64, height: f64| {
            let place = ankle + ahead * forward * size;
            Vector3::new(place.x, (height + 1.3) * size, place.z)
        };
        let mut put = |ends: [Vector3<f64>; 2], radii: [f64; 2], height: f64| {
            self.cones.push(Cone::new(joint + 2, ends, radii.map(|radius| radius * size)).flat(Vector3::y(), height));
        };
        put([at(-3.2, 3.6), at(0.5, 5.5)], [3.7, 4.0], 1.0);
        put([at(0.5, 5.5), at(10.5, 3.3)], [4.1, 3.6], 0.85);
        put([at(-2.0, 2.6), at(11.5, 2.6)], [3.6, 4.6], 0.62);
        put([at(11.5, 2.5), at(16.6, 2.0)], [4.5, 3.4], 0.55);
    }

    /// Negative inside, about a distance in cm near the surface.
    pub(super) fn value(&self, point: &Vector3<f64>) -> f64 {
        let mut nearest = f64::INFINITY;
        let mut sum = 0.0;
        for cone in &self.cones {
            let distance = cone.distance(point);
            // Sum of exponentials, taken relative to the least so far.
            if distance < nearest {
                sum = sum * ((distance - nearest) / MELT_CM).exp() + 1.0;
                nearest = distance;
            } else if distance < nearest + 8.0 * MELT_CM {
                sum += ((nearest - distance) / MELT_CM).exp();
            }
        }
        nearest - MELT_CM * sum.ln()
    }

    /// The value, and the direction in which it grows, not of length 1.
    pub(super) fn value_and_slope(&self, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        const STEP_CM: f64 = 0.01;
        let value = self.value(point);
        let slope = Vector3::from_fn(|axis, _| {
            let mut moved = *point;
            moved[axis] += STEP_CM;
            (self.value(&moved) - value) / STEP_CM
        });
        (value, slope)
    }

    /// The part of the body that a point belongs to.
    pub(super) fn part(&self, point: &Vector3<f64>) -> usize {
        let least = self.cones.iter().map(|cone| (cone.distance(point), cone.joint)).min_by(|a, b| a.0.total_cmp(&b.0));
        least.map_or(TORSO, |(_, joint)| joint)
    }
}
