//! What is shared by the tests: trees at random.
#![allow(clippy::unwrap_used)]

use super::*;
use crate::random::{Random, Stream};
use formats::rig::{Joint, JointKind, Skeleton};
use nalgebra::UnitQuaternion;

/// A point at random.
pub(super) fn point(random: &mut Random, size: f64) -> Vec3 {
    Vec3::from_fn(|_, _| random.between(-size, size))
}

/// A direction at random.
pub(super) fn direction(random: &mut Random) -> Vec3 {
    loop {
        let x = point(random, 1.0);
        if x.norm() > 0.1 {
            return x.normalize();
        }
    }
}

/// A tree with all kinds of joints in all kinds of order, and shifts behind rotations.
pub(super) fn tree(seed: u64) -> (Tree, Random) {
    let mut random = Random::new(seed, Stream::Actor);
    let joints = (0..8).map(|at| Joint {
        name: format!("joint{at}"),
        kind: match (at, random.whole(0, 4)) {
            (0, _) | (_, 0) => JointKind::Translate,
            (_, 1) => JointKind::Revolute { axis: direction(&mut random).into() },
            _ => JointKind::Ball,
        },
        parent: (at > 0).then(|| random.whole(0, at)),
        centre: point(&mut random, 50.0).into(),
        state: [0.0; 3],
    });
    (Tree::new(&Skeleton { joints: joints.collect() }, 1.0), random)
}

/// A pose at random, far from the reference.
pub(super) fn pose(tree: &Tree, random: &mut Random) -> Pose {
    let mut pose = Pose::reference(tree);
    let update: Vec<f64> = (0..tree.freedom()).map(|_| random.between(-1.5, 1.5)).collect();
    pose.update(tree, &update, 1.0);
    pose
}

#[test]
fn twists_are_derivatives_of_points() {
    for seed in 0..30 {
        let (tree, mut random) = tree(seed);
        let pose = pose(&tree, &mut random);
        let mut posed = Posed::new(&tree);
        posed.set(&tree, &pose);
        for part in 0..tree.joints() {
            let x = point(&mut random, 60.0);
            let there = posed.parts[part].point(&x);
            for dof in 0..tree.freedom() {
                let at = |by: f64| {
                    let mut step = vec![0.0; tree.freedom()];
                    step[dof] = by;
                    let mut moved = pose.clone();
                    moved.update(&tree, &step, 1.0);
                    let mut posed = Posed::new(&tree);
                    posed.set(&tree, &moved);
                    posed.parts[part].point(&x)
                };
                let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
                let told = if tree.chains[part].contains(&dof) { posed.twists[dof].at(&there) } else { Vec3::zeros() };
                assert!((slope - told).norm() < 1e-6, "seed {seed}, part {part}, degree of freedom {dof}: {slope} {told}");
            }
        }
    }
}

#[test]
fn a_half_turn_is_a_half_turn() {
    let (tree, mut random) = tree(1);
    let mut pose = Pose::reference(&tree);
    let ball = tree.links.iter().position(|link| link.motion == tree::Motion::Ball).unwrap();
    let axis = direction(&mut random);
    pose.0[ball] = State::Rotation(UnitQuaternion::from_scaled_axis(axis * std::f64::consts::PI));
    let mut posed = Posed::new(&tree);
    posed.set(&tree, &pose);
    let centre = tree.links[ball].centre;
    for _ in 0..10 {
        let x = point(&mut random, 50.0);
        // reflected on the axis
        let arm = x - centre;
        let expected = centre + axis * (2.0 * axis.dot(&arm)) - arm;
        assert!((posed.parts[ball].point(&x) - expected).norm() < 1e-12);
    }
}

#[test]
fn differences_undo_updates() {
    for seed in 0..20 {
        let (tree, mut random) = tree(seed);
        let a = pose(&tree, &mut random);
        let b = pose(&tree, &mut random);
        let mut update = vec![0.0; tree.freedom()];
        b.since(&tree, &a, &mut update);
        let mut again = a.clone();
        again.update(&tree, &update, 1.0);
        let mut off = vec![0.0; tree.freedom()];
        b.since(&tree, &again, &mut off);
        assert!(off.iter().all(|x| x.abs() < 1e-12), "{off:?}");
    }
}
