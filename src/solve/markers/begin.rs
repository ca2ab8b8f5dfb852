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
    /// For each marker its part, if it is known or was found.
    pub parts: Vec<Option<usize>>,
    /// For each marker the offset from its part's joint, in the axes of the reference pose, cm.
    pub offsets: Vec<Option<Vec3>>,
}

/// Frames that are tried.
const TRIED: usize = 24;
/// Times that markers are put on the surface.
const ROUNDS: usize = 40;
/// The weight of a squared angle against a squared distance of one marker, cm²: poses far from the reference are no good beginning.
const ANGLE: f64 = 4.0;
/// Where parts are not known, one vertex of so many is looked at.
const COARSE: usize = 3;
/// Headings that are tried where no marker's part is known.
const HEADINGS: usize = 8;

/// Finds it. `None` if markers are too few.
pub(super) fn begin(body: &Body, limits: Option<&Limits>, seen: &Seen, known: &[Known]) -> Option<Begun> {
    let tried = if known.iter().any(|known| known.part.is_some()) { TRIED } else { TRIED / 2 };
    let every = (seen.frames / tried).max(1);
    let tried = (0..seen.frames).step_by(every).filter_map(|frame| {
        let fits = starts(body, seen, known, frame).into_iter().map(|pose| fit(body, limits, seen, known, frame, pose));
        fits.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(cost, pose, parts)| (cost, frame, pose, parts))
    });
    let (cost, frame, pose, parts) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let mut posed = Posed::new(&body.tree);
    posed.set(&body.tree, &pose);
    let mut offsets: Vec<Option<Vec3>> = known.iter().map(|known| Some(known.place? - body.tree.links[known.part?].centre)).collect();
    for (at, x, _) in seen.frame(frame) {
        if offsets[at].is_none()
            && let Some(part) = parts[at]
        {
            offsets[at] = Some(posed.parts[part].back(x) - body.tree.links[part].centre);
        }
    }
    let parts = parts.iter().zip(known).map(|(part, known)| known.part.or(*part)).collect();
    Some(Begun { frame, cost, parts, offsets })
}

/// Poses to begin with in a frame: the reference pose, moved as a whole.
fn starts(body: &Body, seen: &Seen, known: &[Known], frame: usize) -> Vec<Pose> {
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
    if parts.len() >= 3 {
        return vec![placed(tree, &pairs)];
    }
    let count = seen.frame(frame).count();
    if count < 6 {
        return Vec::new();
    }
    // nothing is known: upright as the body is, in the middle of the markers, facing anywhere
    let to = seen.frame(frame).map(|(_, x, _)| x).sum::<Vec3>() / count as f64;
    let from = body.vertices.iter().sum::<Vec3>() / body.vertices.len().max(1) as f64;
    let up = body.up();
    let heading = |at: usize| UnitQuaternion::from_scaled_axis(up * (std::f64::consts::TAU * at as f64 / HEADINGS as f64));
    (0..HEADINGS).map(|at| whole(tree, &heading(at), &from, &to)).collect()
}

/// The reference pose, moved as a whole so that pairs of points fall on each other as well as they can.
pub(super) fn placed(tree: &Tree, pairs: &[(Vec3, Vec3)]) -> Pose {
    if pairs.len() < 3 {
        return Pose::reference(tree);
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

/// Puts the markers of a frame on the surface. Returns what it costs, the pose, and the parts of markers.
fn fit(
    body: &Body,
    limits: Option<&Limits>,
    seen: &Seen,
    known: &[Known],
    frame: usize,
    mut pose: Pose,
) -> (f64, Pose, Vec<Option<usize>>) {
    let tree = &body.tree;
    let (mut posed, mut normal) = (Posed::new(tree), Normal::new(tree));
    let mut step = vec![0.0; tree.freedom()];
    let mut parts = vec![None; seen.markers];
    let mut pairs = Vec::new();
    for _ in 0..ROUNDS {
        posed.set(tree, &pose);
        pairs.clear();
        for (at, x, _) in seen.frame(frame) {
            let pair = match known[at] {
                Known { part: Some(part), place: Some(place) } => {
                    Some(Pair { part: part as u32, vertex: place, normal: Vec3::zeros(), point: *x, weight: 1.0 })
                }
                known => nearest(body, &posed, known.part, x),
            };
            parts[at] = pair.map(|pair| pair.part as usize);
            pairs.extend(pair);
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
    let angles = tree.owners.iter().zip(&off).filter(|(owner, _)| carries_angle(tree, **owner)).map(|(_, off)| off * off);
    let cost = Points { pairs: &pairs }.energy(&at) / pairs.len().max(1) as f64 + ANGLE * angles.sum::<f64>() / tree.joints() as f64;
    (cost, pose, parts)
}

/// True for joints that turn against their parent and not with the whole body.
fn carries_angle(tree: &Tree, joint: usize) -> bool {
    let whole = tree.links.iter().position(|link| link.motion == Motion::Ball);
    tree.links[joint].motion != Motion::Translate && Some(joint) != whole
}

/// The nearest vertex, of one part or of all.
fn nearest(body: &Body, posed: &Posed, part: Option<usize>, x: &Vec3) -> Option<Pair> {
    let mut best: Option<(f64, Pair)> = None;
    for (at, surface) in body.surfaces.iter().enumerate().filter(|(at, _)| part.is_none_or(|part| part == *at)) {
        let back = posed.parts[at].back(x);
        // any part: one vertex in a few will do
        let every = if part.is_none() { COARSE } else { 1 };
        for &vertex in surface.iter().step_by(every) {
            let vertex = body.vertices[vertex as usize];
            let square = (vertex - back).norm_squared();
            if best.as_ref().is_none_or(|(least, _)| square < *least) {
                best = Some((square, Pair { part: at as u32, vertex, normal: Vec3::zeros(), point: *x, weight: 1.0 }));
            }
        }
    }
    best.map(|(_, pair)| pair)
}
