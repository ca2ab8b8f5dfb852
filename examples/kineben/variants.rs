//! What is tracked: an actor, what it does, and how it is seen.

use formats::rig::Mesh;
use mocap_repair::demo::actor::{Actor, ActorPose, Camera, Motion, ScanOptions};
use mocap_repair::solve::ik::terms::Limits;
use mocap_repair::solve::ik::{Pose, Tree, Vec3};
use mocap_repair::solve::track::{Body, Cloud};

/// The size of the cubes of visual hulls, cm.
const VOXEL_CM: f64 = 2.5;
/// Standard deviation of the depths of a depth camera at 3 m, cm.
const DEPTH_NOISE_CM: f64 = 0.3;

/// How a body is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum View {
    /// Points all over the surface.
    Scan(ScanOptions),
    /// The visual hull of so many cameras.
    Hull(usize),
    /// The front, by one depth camera.
    Depth,
}

/// A sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Variant {
    /// Its name.
    pub name: &'static str,
    /// Whose body it is, and which noise.
    pub seed: u64,
    /// What it does.
    pub motion: Motion,
    /// Frames per second.
    pub rate_hz: f64,
    /// Number of frames.
    pub frames: usize,
    /// How it is seen.
    pub view: View,
}

/// 3 mm of noise.
const CLEAN: ScanOptions = ScanOptions { points: 2500, noise_cm: 0.3, tilt_rad: 0.1, holes: 0, hole_cm: 10.0, outliers: 0.0 };
/// 10 mm of noise, holes, and points that belong to nothing.
const NOISY: ScanOptions = ScanOptions { noise_cm: 1.0, tilt_rad: 0.2, holes: 4, outliers: 0.08, ..CLEAN };

const WALK: Variant = Variant { name: "walk", seed: 1, motion: Motion::Walk, rate_hz: 30.0, frames: 120, view: View::Scan(CLEAN) };
const GYM: Variant = Variant { name: "gym", seed: 1, motion: Motion::Gym, rate_hz: 30.0, frames: 252, view: View::Scan(CLEAN) };

/// All of them. Gymnastics are done once, from beginning to end.
pub const ALL: &[Variant] = &[
    WALK,
    Variant { name: "walk, another body", seed: 7, ..WALK },
    Variant { name: "walk, 15 Hz", rate_hz: 15.0, frames: 60, ..WALK },
    Variant { name: "walk, 10 mm, holes, outliers", view: View::Scan(NOISY), ..WALK },
    Variant { name: "walk, 10 mm, holes, outliers, 15 Hz", rate_hz: 15.0, frames: 60, view: View::Scan(NOISY), ..WALK },
    GYM,
    Variant { name: "gym, another body", seed: 7, ..GYM },
    Variant { name: "gym, 10 mm, holes, outliers", view: View::Scan(NOISY), ..GYM },
    Variant { name: "gym, hull of 8 cameras", view: View::Hull(8), ..GYM },
    Variant { name: "gym, hull of 4 cameras", view: View::Hull(4), ..GYM },
    Variant { name: "gym, one depth camera", view: View::Depth, ..GYM },
    Variant { name: "gym, hull of 4 cameras, another body", seed: 7, view: View::Hull(4), ..GYM },
    Variant { name: "gym, one depth camera, another body", seed: 7, view: View::Depth, ..GYM },
    Variant { name: "walk, one depth camera", view: View::Depth, ..WALK },
    Variant {
        name: "gym, 10 mm, holes, outliers, 15 Hz, another body",
        seed: 7,
        rate_hz: 15.0,
        frames: 126,
        view: View::Scan(NOISY),
        ..GYM
    },
    Variant { name: "gym, one depth camera, 15 Hz", rate_hz: 15.0, frames: 126, view: View::Depth, ..GYM },
    Variant { name: "gym, 15 Hz", rate_hz: 15.0, frames: 126, ..GYM },
    Variant { name: "gym, hull of 8 cameras, 15 Hz", rate_hz: 15.0, frames: 126, view: View::Hull(8), ..GYM },
];

/// A body with everything that is needed to track it, and what is known of every frame.
pub struct Sequence {
    /// The body.
    pub body: Body,
    /// How far its joints move.
    pub limits: Option<Limits>,
    /// Where it begins.
    pub start: Pose,
    /// For each frame its cloud, if there is one.
    pub clouds: Vec<Option<Cloud>>,
    /// For each frame where the joints are, cm; NaN where nobody knows.
    pub joints: Vec<Vec<Vec3>>,
}

impl Variant {
    /// Makes it.
    pub fn sequence(&self) -> Sequence {
        let actor = Actor::new(self.seed);
        let tree = Tree::new(&actor.skeleton, 1.0);
        let poses = actor.poses(self.motion, self.frames, self.rate_hz);
        let clouds = poses.iter().enumerate().map(|(frame, pose)| Some(cloud(&self.seen(&actor, pose, frame))));
        // the root is no joint of its own: it is where the torso is
        let joints = poses.iter().map(|pose| {
            let mut joints: Vec<Vec3> = actor.joints(pose).into_iter().map(Vec3::from).collect();
            joints[0] = Vec3::repeat(f64::NAN);
            joints
        });
        Sequence {
            start: Pose::reference(&tree),
            limits: Some(Limits::new(&actor.limits, false, 1.0)),
            clouds: clouds.collect(),
            joints: joints.collect(),
            body: Body::new(tree, points(&actor.mesh.vertices), points(&actor.mesh.normals), actor.mesh.faces.clone(), actor.parts.clone()),
        }
    }

    fn seen(&self, actor: &Actor, pose: &ActorPose, frame: usize) -> Mesh {
        match self.view {
            View::Scan(options) => actor.scan(pose, frame, &options),
            View::Hull(cameras) => actor.hull(pose, &Camera::ring(cameras, self.motion.stage()), VOXEL_CM),
            View::Depth => actor.depth(pose, frame, &Camera::depth(self.motion.stage()), DEPTH_NOISE_CM),
        }
    }
}

fn points(list: &[[f64; 3]]) -> Vec<Vec3> {
    list.iter().map(|x| Vec3::from(*x)).collect()
}

fn cloud(mesh: &Mesh) -> Cloud {
    Cloud { points: points(&mesh.vertices), normals: points(&mesh.normals) }
}
