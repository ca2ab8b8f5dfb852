//! A synthetic actor with a surface: what a tracker of bodies in clouds of points is tested on, with the truth that real recordings lack.
//!
//! Lengths are in cm, y is up, and the actor looks along z in the reference pose.
//! A seed means the same body, habits and noise for ever.
//! The skeleton has 15 joints and 29 degrees of freedom, but the body is no puppet: its back bends, its shoulders rise and its
//! surface stretches around the joints, so that a model of rigid parts is wrong by millimetres, as it is on people.
//! All of it is written on its own, with nothing from what follows bodies: a mistake there does not hide here.
//!
//! - `figure`: measures, joints and limits; `flesh` and `net`: the surface around them; `body`: how it hangs on the bones
//! - `posture`, `motion`: what the actor does; `pose`: where that puts everything
//! - `scan`: points of the surface; `camera`: silhouettes and depths; `hull`: what silhouettes leave; `markers`: labelled points of the skin
//! - `files`: all of it in a folder

mod body;
mod camera;
mod figure;
mod files;
mod flesh;
mod hull;
mod markers;
mod motion;
mod net;
mod pose;
mod posture;
mod scan;
#[cfg(test)]
mod tests;

pub use camera::Camera;
pub use files::{BodyOptions, write_body};
pub use markers::{MarkerOptions, SkinMarker};
pub use motion::Motion;
pub use pose::ActorPose;
pub use scan::ScanOptions;

use figure::Figure;
use formats::rig::{Limit, Mesh, Skeleton};
use motion::Habits;
use nalgebra::Vector3;

/// A body with a surface, and the way it moves.
#[derive(Clone, Debug)]
pub struct Actor {
    /// The joints in the reference pose, in cm.
    pub skeleton: Skeleton,
    /// The surface in the reference pose, in cm, closed.
    pub mesh: Mesh,
    /// The joint of every vertex.
    pub parts: Vec<usize>,
    /// How far the joints go; `None` where they go anywhere.
    pub limits: Vec<Option<Limit>>,
    seed: u64,
    figure: Figure,
    habits: Habits,
    /// For every vertex: what moves it, and by how much.
    weights: Vec<Vec<(usize, f64)>>,
    /// What touches the floor, with the part that it belongs to.
    soles: Vec<(usize, Vector3<f64>)>,
    /// The height of the lowest of them in the reference pose.
    reference_lowest: Option<f64>,
}

impl Actor {
    /// The actor of a seed.
    pub fn new(seed: u64) -> Self {
        let figure = Figure::new(seed);
        let body = body::Body::new(&figure);
        let mut actor = Self {
            skeleton: figure.skeleton(),
            mesh: body.mesh,
            parts: body.parts,
            limits: figure.limits(),
            seed,
            habits: Habits::new(seed),
            weights: body.weights,
            soles: Self::soles(&figure),
            reference_lowest: None,
            figure,
        };
        actor.reference_lowest = Some(actor.lowest(&actor.held(&actor.figure.reference)));
        actor
    }

    /// The pose at a time of a motion; the reference pose at 0.
    pub fn pose(&self, motion: Motion, secs: f64) -> ActorPose {
        let measures = &self.figure.measures;
        self.held(&self.habits.posture(motion, secs, &self.figure.reference, measures.thigh + measures.shank()))
    }

    /// The poses of `frames` frames.
    pub fn poses(&self, motion: Motion, frames: usize, rate_hz: f64) -> Vec<ActorPose> {
        (0..frames).map(|frame| self.pose(motion, frame as f64 / rate_hz)).collect()
    }
}
