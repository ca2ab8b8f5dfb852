//! From a posture to where everything is: forward kinematics of a body whose back bends and whose shoulders rise.

use super::Actor;
use super::body::{CHEST, MOVERS, SHOULDER};
use super::figure::{ARM, Figure, HEAD, JOINTS, LEG, ROOT, SIGN, TORSO, axes, bent, hinge_of, parent};
use super::net;
use super::posture::{Posture, turned};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// How far a shoulder rises, in cm, while a hanging arm is lifted overhead.
const RISE_CM: f64 = 2.4;
/// How sharply the lowest point of the body is chosen, in cm; without it the pelvis would jerk when the weight changes from foot to foot.
const LOWEST_SOFTNESS_CM: f64 = 0.6;

/// Where all parts of an actor are at one moment.
#[derive(Clone, Debug)]
pub struct ActorPose {
    /// For everything that moves vertices, where it puts a point of the reference pose.
    movers: [Isometry3<f64>; MOVERS],
    /// The state of every joint against the reference pose, as in [`formats::rig::Joint::state`]: shift in cm, angle in radians
    /// (first number), or rotation vector. The torso's is that of the pelvis, to which hips, shoulders and head are stated:
    /// a rigid skeleton in these states has every part turned as it is, and hips where they are, but shoulders and head
    /// where they would be without the bend of the back.
    pub states: Vec<[f64; 3]>,
}

impl Actor {
    /// The pose that a posture means.
    pub(super) fn held(&self, posture: &Posture) -> ActorPose {
        let figure = &self.figure;
        let mut pose = on_floor(figure, posture, figure.centres[ROOT]);
        let lowest = |pose: &ActorPose| self.lowest(pose);
        let ground = self.reference_lowest.unwrap_or_else(|| lowest(&pose));
        let shift = Vector3::new(posture.place[0], ground - lowest(&pose) + posture.above, posture.place[1]);
        for mover in &mut pose.movers {
            mover.translation.vector += shift;
        }
        pose.states[ROOT] = shift.into();
        pose
    }

    /// About the height of the lowest point, in cm.
    pub(super) fn lowest(&self, pose: &ActorPose) -> f64 {
        let heights: Vec<f64> = self.soles.iter().map(|&(joint, point)| (pose.movers[joint] * Point3::from(point)).y).collect();
        let least = heights.iter().copied().fold(f64::INFINITY, f64::min);
        let sum: f64 = heights.iter().map(|height| ((least - height) / LOWEST_SOFTNESS_CM).exp()).sum();
        least - LOWEST_SOFTNESS_CM * sum.ln()
    }

    /// Points of the body that touch the floor first: ends of feet, hands and head.
    pub(super) fn soles(figure: &Figure) -> Vec<(usize, Vector3<f64>)> {
        let m = &figure.measures;
        let mut points = vec![(HEAD, Vector3::new(0.0, m.stature, 0.0))];
        for side in 0..2 {
            let hand = ARM[side] + 2;
            points.push((hand, figure.centres[hand] - figure.turned[hand] * Vector3::y() * m.hand));
            let foot = LEG[side] + 2;
            let (ankle, toes) = (figure.centres[foot], figure.turned[foot] * Vector3::z());
            for share in [-0.27, 0.44, 0.75] {
                let end = ankle + toes * (share * m.foot);
                points.push((foot, Vector3::new(end.x, 0.0, end.z)));
            }
        }
        points
    }

    /// The surface in a pose: vertices in cm, and their directions.
    pub fn surface(&self, pose: &ActorPose) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
        let vertices: Vec<[f64; 3]> = (0..self.mesh.vertices.len()).map(|vertex| self.vertex(pose, vertex)).collect();
        let normals = net::normals(&vertices, &self.mesh.faces);
        (vertices, normals)
    }

    /// Where one vertex of the surface is, in cm.
    pub fn vertex(&self, pose: &ActorPose, vertex: usize) -> [f64; 3] {
        let at = Point3::from(self.mesh.vertices[vertex]);
        let moved: Vector3<f64> = self.weights[vertex].iter().map(|&(mover, share)| (pose.movers[mover] * at).coords * share).sum();
        moved.into()
    }

    /// Where the joints are, in cm, in the order of the skeleton: as the body carries them, which bends more than the skeleton can.
    pub fn joints(&self, pose: &ActorPose) -> Vec<[f64; 3]> {
        (0..JOINTS).map(|joint| (pose.movers[joint] * Point3::from(self.figure.centres[joint])).coords.into()).collect()
    }
}

/// The pose with the pelvis at `pelvis`.
fn on_floor(figure: &Figure, posture: &Posture, pelvis: Vector3<f64>) -> ActorPose {
    let axes = axes(posture);
    let mut movers = [Isometry3::identity(); MOVERS];
    let mut states = vec![[0.0; 3]; JOINTS];
    // How each part is turned away from the reference pose.
    let moved: [Rotation3<f64>; JOINTS] = std::array::from_fn(|joint| axes[joint] * figure.turned[joint].inverse());
    movers[TORSO] = about(&moved[TORSO], figure.centres[TORSO], pelvis);
    movers[ROOT] = Isometry3::from(Translation3::from(pelvis - figure.centres[ROOT]));
    let chest_turned = moved[TORSO] * turned(posture.back);
    movers[CHEST] = about(&chest_turned, figure.lumbar, carried(&movers[TORSO], figure.lumbar));
    for joint in HEAD..JOINTS {
        let centre = figure.centres[joint];
        let carrier = match ARM.iter().position(|&arm| arm == joint) {
            Some(side) => {
                let up = chest_turned * Vector3::y();
                let rise = RISE_CM * 0.5 * (risen(&figure.turned[joint], &Vector3::y()) - risen(&axes[joint], &up));
                let drawn = chest_turned * Vector3::new(-SIGN[side] * 0.4, 1.0, 0.0);
                movers[SHOULDER[side]] = Translation3::from(drawn * rise) * movers[CHEST];
                movers[SHOULDER[side]]
            }
            None if joint == HEAD => movers[CHEST],
            None => movers[parent(joint).unwrap_or(TORSO)],
        };
        movers[joint] = about(&moved[joint], centre, carried(&carrier, centre));
    }
    states[TORSO] = moved[TORSO].scaled_axis().into();
    for joint in HEAD..JOINTS {
        states[joint] = match (hinge_of(joint), parent(joint)) {
            (Some(_), _) => [(bent(posture, joint) - bent(&figure.reference, joint)).to_radians(), 0.0, 0.0],
            (None, Some(parent)) => (moved[parent].inverse() * moved[joint]).scaled_axis().into(),
            (None, None) => [0.0; 3],
        };
    }
    ActorPose { movers, states }
}

/// How far an arm points down: -1 overhead, 1 hanging.
fn risen(arm: &Rotation3<f64>, up: &Vector3<f64>) -> f64 {
    (arm * Vector3::y()).dot(up)
}

/// Turns what is at `from` and puts it to `to`.
fn about(turn: &Rotation3<f64>, from: Vector3<f64>, to: Vector3<f64>) -> Isometry3<f64> {
    let matrix: &Matrix3<f64> = turn.matrix();
    Isometry3::from_parts(Translation3::from(to - matrix * from), UnitQuaternion::from_rotation_matrix(turn))
}

fn carried(carrier: &Isometry3<f64>, point: Vector3<f64>) -> Vector3<f64> {
    (carrier * Point3::from(point)).coords
}
