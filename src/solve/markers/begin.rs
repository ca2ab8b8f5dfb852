//! A first guess of where markers sit: in the frame that is most like the reference pose, they are put on the surface.

use super::Seen;
use super::calibrate::Known;
use crate::solve::ik::terms::{At, Limits, Pair, Points};
use crate::solve::ik::{Motion, Normal, Pose, Posed, State, Term, Tree, Vec3};
use crate::solve::track::Body;
use nalgebra::{Matrix3, UnitQuaternion};

/// A first guess.
pub(super) struct Begun {
    /// The frame.
    pub frame: usize,
    /// What it costs.
    pub cost: f64,
    /// For each marker its part.
    pub parts: Vec<Option<usize>>,
    /// For each marker the offset from its part's joint, in the axes of the reference pose, cm.
    pub offsets: Vec<Option<Vec3>>,
}

/// Frames that are tried.
const TRIED: usize = 24;
/// How much more than the best a frame may cost to be used besides.
const MORE: f64 = 1.0;
/// Times that markers are put on the surface.
const ROUNDS: usize = 40;
/// The weight of a squared angle against a squared distance of one marker, cm²: poses far from the reference are no good beginning.
const ANGLE: f64 = 4.0;

/// Finds it. `None` if markers are too few.
pub(super) fn begin(body: &Body, limits: Option<&Limits>, seen: &Seen, known: &[Known]) -> Option<Begun> {
    let every = (seen.frames / TRIED).max(1);
    let tried = (0..seen.frames).step_by(every).filter_map(|frame| {
        let (cost, pose) = fit(body, limits, seen, known, frame, start(body, seen, known, frame)?);
        Some((cost, frame, pose))
    });
    let mut tried: Vec<(f64, usize, Pose)> = tried.collect();
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (cost, frame, _) = *tried.first()?;
    let mut parts: Vec<Option<usize>> = known.iter().map(|known| known.part).collect();
    let centre = |part: usize| body.tree.links[part].centre;
    let mut offsets: Vec<Option<Vec3>> = known.iter().map(|known| Some(known.place? - centre(known.part?))).collect();
    let mut posed = Posed::new(&body.tree);
    // what is not seen in the best frame may be in one that is nearly as good
    for (_, frame, pose) in tried.iter().take_while(|(other, ..)| *other < cost + MORE) {
        posed.set(&body.tree, pose);
        for (at, x, _) in seen.frame(*frame) {
            if offsets[at].is_none()
                && let Some((part, _)) = nearest(body, &posed, &known[at], x)
            {
                parts[at] = Some(part);
                offsets[at] = Some(posed.parts[part].back(x) - centre(part));
            }
        }
    }
    Some(Begun { frame, cost, parts, offsets })
}

/// The pose to begin with in a frame: the reference pose, moved as a whole. `None` if markers of fewer than three parts are seen.
fn start(body: &Body, seen: &Seen, known: &[Known], frame: usize) -> Option<Pose> {
    let tree = &body.tree;
    let middle = |part: usize| {
        let surface = &body.surfaces[part];
        surface.iter().map(|&vertex| body.vertices[vertex as usize]).sum::<Vec3>() / surface.len().max(1) as f64
    };
    let mut pairs: Vec<(Vec3, Vec3)> = Vec::new();
    let mut parts = std::collections::BTreeSet::new();
    for (at, x, _) in seen.frame(frame) {
        if let Some(part) = known[at].part {
            parts.insert(part);
            pairs.push((known[at].place.unwrap_or_else(|| middle(part)), *x));
        }
    }
    (parts.len() >= 3).then(|| placed(tree, &pairs))
}

/// The reference pose, moved as a whole so that pairs of points fall on each other as well as they can.
pub(super) fn placed(tree: &Tree, pairs: &[(Vec3, Vec3)]) -> Pose {
    if pairs.len() < 3 {
        let from = pairs.iter().map(|(a, _)| a).sum::<Vec3>() / pairs.len().max(1) as f64;
        let to = pairs.iter().map(|(_, b)| b).sum::<Vec3>() / pairs.len().max(1) as f64;
        return whole(tree, &UnitQuaternion::identity(), &from, &to);
    }
    let count = pairs.len() as f64;
    let from = pairs.iter().map(|(a, _)| a).sum::<Vec3>() / count;
    let to = pairs.iter().map(|(_, b)| b).sum::<Vec3>() / count;
    let moments: Matrix3<f64> = pairs.iter().map(|(a, b)| (b - to) * (a - from).transpose()).sum();
    let svd = moments.svd(true, true);
    let (Some(u), Some(v)) = (svd.u, svd.v_t) else { return Pose::reference(tree) };
    let mut flip = Matrix3::identity();
    flip[(2, 2)] = (u * v).determinant().signum();
    whole(tree, &UnitQuaternion::from_matrix(&(u * flip * v)), &from, &to)
}

/// The reference pose, turned about `from`, which comes to `to`.
fn whole(tree: &Tree, rotation: &UnitQuaternion<f64>, from: &Vec3, to: &Vec3) -> Pose {
    let mut pose = Pose::reference(tree);
    // the first joints that turn and shift carry it
    let turning = tree.links.iter().position(|link| link.motion == Motion::Ball);
    let shifting = tree.links.iter().position(|link| link.motion == Motion::Translate);
    if let (Some(turning), Some(shifting)) = (turning, shifting) {
        let centre = tree.links[turning].centre;
        pose.0[turning] = State::Rotation(*rotation);
        pose.0[shifting] = State::Shift(to + rotation * (centre - from) - centre);
    }
    pose
}

/// Puts the markers of a frame on the surface. Returns what it costs, and the pose.
fn fit(body: &Body, limits: Option<&Limits>, seen: &Seen, known: &[Known], frame: usize, mut pose: Pose) -> (f64, Pose) {
    let tree = &body.tree;
    let (mut posed, mut normal) = (Posed::new(tree), Normal::new(tree));
    let mut step = vec![0.0; tree.freedom()];
    let mut pairs = Vec::new();
    for _ in 0..ROUNDS {
        posed.set(tree, &pose);
        pairs.clear();
        for (at, x, _) in seen.frame(frame) {
            let there = match known[at] {
                Known { part: Some(part), place: Some(place), .. } => Some((part, place)),
                ref known => nearest(body, &posed, known, x),
            };
            pairs.extend(there.map(|(part, vertex)| Pair { part: part as u32, vertex, normal: Vec3::zeros(), point: *x, weight: 1.0 }));
        }
        normal.clear();
        let at = At { tree, pose: &pose, posed: &posed };
        Points { pairs: &pairs }.add(&at, &mut normal);
        if let Some(limits) = limits {
            limits.add(&at, &mut normal);
        }
        normal.gather(tree, &posed);
        if !normal.step(|_| ANGLE, &mut step) {
            break;
        }
        pose.update(tree, &step, 1.0);
    }
    posed.set(tree, &pose);
    let at = At { tree, pose: &pose, posed: &posed };
    let mut off = vec![0.0; tree.freedom()];
    pose.since(tree, &Pose::reference(tree), &mut off);
    let angles = tree.owners.iter().zip(&off).filter(|(owner, _)| tree.turns_within(**owner)).map(|(_, off)| off * off);
    let cost = Points { pairs: &pairs }.energy(&at) / pairs.len().max(1) as f64 + ANGLE * angles.sum::<f64>() / tree.joints() as f64;
    (cost, pose)
}

/// The nearest vertex of the parts on which a marker may be, in the reference pose, with its part.
fn nearest(body: &Body, posed: &Posed, known: &Known, x: &Vec3) -> Option<(usize, Vec3)> {
    let squares = known.part.into_iter().chain(known.or).flat_map(|part| {
        let back = posed.parts[part].back(x);
        body.surfaces[part].iter().map(move |&vertex| {
            let vertex = body.vertices[vertex as usize];
            ((vertex - back).norm_squared(), part, vertex)
        })
    });
    squares.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, part, vertex)| (part, vertex))
}
