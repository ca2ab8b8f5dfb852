//! Looking for limbs that a tracker has lost.
//!
//! A tracker that follows the nearest surface stays lost once a limb has moved farther in a frame than its surroundings reach.
//! What shows it: less of the surface has points beside it than before, and points are left over that nothing explains.
//! Then other poses are tried, and whichever explains the cloud best is taken.

use super::body::Body;
use super::coverage::Beside;
use super::expect::Cloud;
use super::nearest::{Nearest, Query};
use crate::solve::ik::terms::{At, Limits};
use crate::solve::ik::{Motion, Pose, Posed, Rigid, State, Term, Vec3};
use nalgebra::UnitQuaternion;

/// Distances beyond this cost no more, cm.
const FAR_CM: f64 = 5.0;
/// Vertices of a part that are looked at for the cost of a pose, at most.
const VERTICES: usize = 60;
/// Points of a cloud that are looked at for it.
const POINTS: usize = 1200;
/// A point is explained by a part that is nearer than this, cm.
const EXPLAINED_CM: f64 = 3.0;
/// Fewer points than this are nothing to look at.
const FEWEST: usize = 8;

/// Joints that hang on each other and end in the open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limb {
    /// From the trunk outwards.
    pub joints: Vec<usize>,
}

/// The limbs of a body: chains without branches that hang on something with more than one.
pub fn limbs(body: &Body) -> Vec<Limb> {
    let tree = &body.tree;
    let children = |joint: usize| (0..tree.joints()).filter(move |&at| tree.links[at].parent == Some(joint)).collect::<Vec<_>>();
    let mut limbs = Vec::new();
    for joint in (0..tree.joints()).filter(|&joint| children(joint).len() > 1) {
        for first in children(joint) {
            let mut joints = vec![first];
            while let [next] = children(joints[joints.len() - 1])[..] {
                joints.push(next);
            }
            let open = joints.last().is_some_and(|&last| children(last).is_empty());
            if open && joints.iter().any(|&joint| !body.surfaces[joint].is_empty()) {
                limbs.push(Limb { joints });
            }
        }
    }
    limbs
}

/// What a pose costs, squared and capped, cm².
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    /// How far points are from the surface.
    points: f64,
    /// How far the surface is from points.
    surface: f64,
}

impl Cost {
    /// True if it is less than this share of another cost. Less has to be left over of the points, too: a limb that nobody sees can be laid on
    /// what others explain already.
    pub fn below(&self, share: f64, other: &Self) -> bool {
        self.points + self.surface < share * (other.points + other.surface) && self.points < (1.0 - (1.0 - share) / 7.0) * other.points
    }
}

/// What a pose costs.
pub fn cost(body: &Body, nearest: &dyn Nearest, cloud: &Cloud, beside: &Beside<'_>, posed: &[Rigid], cosine: f64) -> Cost {
    let cap = FAR_CM * FAR_CM;
    let every = (cloud.points.len() / POINTS).max(1);
    let (mut sum, mut count) = (0.0, 0.0);
    for at in (0..cloud.points.len()).step_by(every) {
        sum += distance(body, nearest, posed, &cloud.points[at], &cloud.normals[at], cosine, cap, |_| true);
        count += 1.0;
    }
    let points = sum / f64::max(count, 1.0);
    let (mut sum, mut count) = (0.0, 0.0);
    for (surface, rigid) in body.surfaces.iter().zip(posed) {
        for &vertex in surface.iter().step_by((surface.len() / VERTICES).max(1)) {
            let normal = rigid.rotation * body.normals[vertex as usize];
            if beside.faces(&normal) {
                sum += beside.square(&rigid.point(&body.vertices[vertex as usize]), &normal, cosine, cap);
                count += 1.0;
            }
        }
    }
    Cost { points, surface: sum / f64::max(count, 1.0) }
}

/// The squared distance of a point from the nearest compatible vertex of the parts that are asked, cm²; `cap` if there is none nearer.
#[allow(clippy::too_many_arguments)] // what there is to know of a point
fn distance(
    body: &Body,
    nearest: &dyn Nearest,
    posed: &[Rigid],
    point: &Vec3,
    normal: &Vec3,
    cosine: f64,
    cap: f64,
    asked: impl Fn(usize) -> bool,
) -> f64 {
    let mut best = cap;
    for (part, rigid) in posed.iter().enumerate() {
        if !body.surfaces[part].is_empty() && asked(part) {
            let query = Query { point: rigid.back(point), normal: rigid.rotation.tr_mul(normal), cosine, within: best };
            best = nearest.nearest(part, &query, None).map_or(best, |found| found.square);
        }
    }
    best
}

/// The points that the parts for which `asked` is true do not explain.
pub fn left_over(body: &Body, nearest: &dyn Nearest, cloud: &Cloud, posed: &[Rigid], cosine: f64, asked: impl Fn(usize) -> bool) -> Cloud {
    let cap = EXPLAINED_CM * EXPLAINED_CM;
    let mut left = Cloud::default();
    for (point, normal) in cloud.points.iter().zip(&cloud.normals) {
        if distance(body, nearest, posed, point, normal, cosine, cap, &asked) >= cap {
            left.points.push(*point);
            left.normals.push(*normal);
        }
    }
    left
}

/// Directions all around.
const DIRECTIONS: usize = 48;
/// Angles of a hinge.
const ANGLES: usize = 4;
/// Turns of a limb about itself.
const TURNS: usize = 4;

/// Poses in which a limb covers points that nothing else explains, the best `count` of those that limits allow.
pub fn reach(body: &Body, limb: &Limb, pose: &Pose, left: &Cloud, limits: Option<&Limits>, cosine: f64, count: usize) -> Vec<Pose> {
    let tree = &body.tree;
    let first = limb.joints[0];
    if left.points.len() < FEWEST || !matches!(tree.links[first].motion, Motion::Ball) {
        return Vec::new();
    }
    let beside = Beside::new(left, left.points.iter().copied(), FAR_CM);
    let heading = heading(body, limb);
    let hinge = limb.joints.get(1).copied().filter(|&joint| matches!(tree.links[joint].motion, Motion::Revolute(_)));
    // of this limb: what others exceed by a hair is not its fault
    let own =
        limits.map(|limits| Limits { bounds: limits.bounds.iter().filter(|(joint, ..)| limb.joints.contains(joint)).copied().collect() });
    let mut posed = Posed::new(tree);
    let mut found: Vec<(f64, Pose)> = Vec::new();
    for direction in 0..DIRECTIONS {
        let direction = spread(direction, DIRECTIONS);
        let Some(swing) = UnitQuaternion::rotation_between(&heading, &direction)
            .or_else(|| Some(UnitQuaternion::from_scaled_axis(crossing(&heading) * std::f64::consts::PI)))
        else {
            continue;
        };
        for turn in 0..TURNS {
            let twist = UnitQuaternion::from_scaled_axis(heading * (std::f64::consts::TAU * turn as f64 / TURNS as f64));
            for angle in 0..if hinge.is_some() { ANGLES } else { 1 } {
                let mut tried = pose.clone();
                tried.0[first] = State::Rotation(swing * twist);
                for &joint in &limb.joints[1..] {
                    tried.0[joint] = Pose::reference(tree).0[joint];
                }
                if let Some(hinge) = hinge {
                    let (least, most) = range(limits, hinge);
                    tried.0[hinge] = State::Angle(least + (most - least) * (angle as f64 + 0.5) / ANGLES as f64);
                }
                posed.set(tree, &tried);
                let at = At { tree, pose: &tried, posed: &posed };
                if own.as_ref().is_some_and(|own| own.energy(&at) > 0.0) {
                    continue;
                }
                found.push((missed(body, limb, &posed.parts, &beside, cosine), tried));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(count);
    found.into_iter().map(|(_, pose)| pose).collect()
}

/// How much of a limb has nothing beside it.
fn missed(body: &Body, limb: &Limb, posed: &[Rigid], beside: &Beside<'_>, cosine: f64) -> f64 {
    let cap = FAR_CM * FAR_CM;
    let mut sum = 0.0;
    for &part in &limb.joints {
        let surface = &body.surfaces[part];
        let every = (surface.len() / (VERTICES / 3)).max(1);
        let count = surface.iter().step_by(every).count().max(1) as f64;
        for &vertex in surface.iter().step_by(every) {
            let (x, normal) = (&body.vertices[vertex as usize], &body.normals[vertex as usize]);
            sum += beside.square(&posed[part].point(x), &(posed[part].rotation * normal), cosine, cap) / count;
        }
    }
    sum
}

/// Where a limb points in the reference pose.
fn heading(body: &Body, limb: &Limb) -> Vec3 {
    let centre = body.tree.links[limb.joints[0]].centre;
    let towards = limb.joints.get(1).map_or_else(
        || {
            let surface = &body.surfaces[limb.joints[0]];
            surface.iter().map(|&vertex| body.vertices[vertex as usize]).sum::<Vec3>() / surface.len().max(1) as f64
        },
        |&next| body.tree.links[next].centre,
    );
    (towards - centre).try_normalize(1e-9).unwrap_or_else(Vec3::x)
}

/// The angles that a hinge may have.
fn range(limits: Option<&Limits>, joint: usize) -> (f64, f64) {
    use crate::solve::ik::terms::Bound;
    let bounds = limits.map_or(&[][..], |limits| &limits.bounds);
    bounds
        .iter()
        .find_map(|(at, bound, _)| match bound {
            Bound::Range { least, most } if *at == joint => Some((*least, *most)),
            _ => None,
        })
        .unwrap_or((-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2))
}

/// Some direction across another.
fn crossing(direction: &Vec3) -> Vec3 {
    let axis = if direction.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
    direction.cross(&axis).normalize()
}

/// Directions evenly around, on a spiral.
fn spread(at: usize, count: usize) -> Vec3 {
    let z = 1.0 - (2.0 * at as f64 + 1.0) / count as f64;
    let angle = at as f64 * std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let radius = (1.0 - z * z).sqrt();
    Vec3::new(radius * angle.cos(), radius * angle.sin(), z)
}
