//! A trunk that bends: one joint more, inside a part that carries limbs at both of its ends.
//!
//! Rigs of few parts have the trunk in one piece, from hips to shoulders. People bend and turn it, and then neither end is where a rigid trunk puts it:
//! most of what is left of the errors of such a rig.

use super::upright;
use formats::rig::{Joint, JointKind, Limit, Skeleton};

/// Where the new joint is: this far from the lower limbs to the upper ones.
const HEIGHT: f64 = 0.3;
/// How far the upper half bends and turns against the lower one, degrees.
const MOST_DEG: f64 = 60.0;

/// Puts the joint in, as a ball joint behind the trunk in the list; the upper half of the trunk's vertices and its upper limbs go with it.
/// Returns its name, or `None` if there is no trunk with limbs at both ends.
pub(super) fn add_spine(
    skeleton: &mut Skeleton,
    vertices: &[[f64; 3]],
    parts: &mut [usize],
    limits: &mut Option<Vec<Option<Limit>>>,
) -> Option<String> {
    let children = |joint: usize| (0..skeleton.joints.len()).filter(|&at| skeleton.joints[at].parent == Some(joint)).collect::<Vec<_>>();
    let trunk = (0..skeleton.joints.len()).rev().filter(|joint| parts.contains(joint)).max_by_key(|&joint| children(joint).len())?;
    let limbs = children(trunk);
    let axis = upright(vertices.iter().copied());
    let height = |joint: usize| skeleton.joints[joint].centre[axis];
    let (least, most) = limbs.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &limb| (a.min(height(limb)), b.max(height(limb))));
    let middle = f64::midpoint(least, most);
    let mean = |upper: bool| {
        let side: Vec<usize> = limbs.iter().copied().filter(|&limb| (height(limb) > middle) == upper).collect();
        let count = side.len() as f64;
        (side.len() >= 2)
            .then(|| std::array::from_fn::<f64, 3, _>(|k| side.iter().map(|&limb| skeleton.joints[limb].centre[k]).sum::<f64>() / count))
    };
    let (lower, upper) = (mean(false)?, mean(true)?);
    let along: [f64; 3] = std::array::from_fn(|k| upper[k] - lower[k]);
    let length = along.iter().map(|x| x * x).sum::<f64>().sqrt();
    let heading = along.map(|x| x / length);
    let centre: [f64; 3] = std::array::from_fn(|k| lower[k] + along[k] * HEIGHT);
    let above = |x: &[f64; 3]| (0..3).map(|k| (x[k] - centre[k]) * heading[k]).sum::<f64>() > 0.0;

    let mut name = format!("{}_spine", skeleton.joints[trunk].name);
    while skeleton.joint(&name).is_some() {
        name.push('_');
    }
    let moved = |joint: usize| if joint > trunk { joint + 1 } else { joint };
    for joint in &mut skeleton.joints {
        joint.parent = match joint.parent {
            Some(parent) if parent == trunk && joint.centre[axis] > middle => Some(trunk + 1),
            parent => parent.map(moved),
        };
    }
    skeleton.joints.insert(trunk + 1, Joint { name: name.clone(), kind: JointKind::Ball, parent: Some(trunk), centre, state: [0.0; 3] });
    for (part, x) in parts.iter_mut().zip(vertices) {
        *part = if *part == trunk && above(x) { trunk + 1 } else { moved(*part) };
    }
    if let Some(limits) = limits {
        let across = if heading[0].abs() < 0.7 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let most = MOST_DEG.to_radians();
        limits.insert(trunk + 1, Some(Limit::Ball { heading, heading_most: most, bank: across, bank_most: most }));
    }
    Some(name)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::demo::actor::Actor;

    #[test]
    fn the_upper_half_goes_with_the_spine() {
        let actor = Actor::new(1);
        let (mut skeleton, mut parts, mut limits) = (actor.skeleton.clone(), actor.parts.clone(), Some(actor.limits.clone()));
        let name = add_spine(&mut skeleton, &actor.mesh.vertices, &mut parts, &mut limits).unwrap();
        assert_eq!(name, "torso_spine");
        let spine = skeleton.joint(&name).unwrap();
        let parent = |joint: &str| skeleton.joints[skeleton.joint(joint).unwrap()].parent.unwrap();
        assert_eq!([parent("head"), parent("l_uarm"), parent("r_uarm")], [spine; 3]);
        assert_eq!([parent("l_thigh"), parent(&name)], [skeleton.joint("torso").unwrap(); 2]);
        assert_eq!(limits.unwrap().len(), skeleton.joints.len());
        for (before, after) in actor.parts.iter().zip(&parts) {
            let (before, after) = (&actor.skeleton.joints[*before].name, &skeleton.joints[*after].name);
            assert!(before == after || (before == "torso" && *after == name));
        }
        let share =
            parts.iter().filter(|part| **part == spine).count() as f64 / actor.parts.iter().filter(|part| **part == 1).count() as f64;
        assert!((0.3..0.9).contains(&share), "{share}");
    }

    #[test]
    fn without_a_trunk_there_is_no_spine() {
        let actor = Actor::new(1);
        let mut skeleton = Skeleton { joints: actor.skeleton.joints[..3].to_vec() };
        assert_eq!(add_spine(&mut skeleton, &[[0.0; 3]], &mut [1], &mut None), None);
    }
}
