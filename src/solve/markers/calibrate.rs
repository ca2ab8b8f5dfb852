//! Where markers sit and how long bones are, from a take alone.
//!
//! A marker is at `c + R o`: the centre of its part's joint, and an offset `o` that turns with the part. A joint is at its parent's centre and a bone `s b`
//! away from it, where `b` is the bone of the rig in the reference pose and `s` its scale. Poses, offsets and scales are solved for together
//! by Gauss-Newton over frames from all of the take; in each step poses are eliminated first, frame by frame (Schur's complement).

use super::begin::{Begun, begin};
use super::pass::LIMIT;
use super::{Seen, Settings, solve};
use crate::solve::ik::terms::{Limits, Marker};
use crate::solve::ik::{Normal, Pose, Posed, Tree, Vec3};
use crate::solve::track::Body;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// What is known of a marker beforehand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Known {
    /// The part it is fixed to.
    pub part: Option<usize>,
    /// Another part that it may be fixed to as well: the upper half of a trunk.
    pub or: Option<usize>,
    /// Its place in the reference pose, cm.
    pub place: Option<Vec3>,
}

/// What was found.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The body with its bones as long as they are; its surface is moved along.
    pub body: Body,
    /// The size of the body against that of the rig.
    pub size: f64,
    /// For each joint, the scale of the bone that leads to it, besides that; 1 where there is none.
    pub scales: Vec<f64>,
    /// For each marker, where it sits; `None` if it was never seen with others.
    pub markers: Vec<Option<Marker>>,
    /// Root mean square distance of markers from where they should be, cm.
    pub rms_cm: f64,
    /// The frame that it began with.
    pub frame: usize,
    /// True if no other size was tried beyond the best one.
    pub at_edge: bool,
}

/// Frames that are looked at, at most.
const FRAMES: usize = 160;
/// Times that all poses are solved for anew.
const ROUNDS: usize = 6;
/// Steps of poses, offsets and scales together.
const STEPS: usize = 3;
/// How far bones may differ from the rig's, as a share of their lengths.
const SCALE_SIGMA: f64 = 0.1;
/// How far a marker may sit from where it was first thought to be, cm.
const OFFSET_SIGMA_CM: f64 = 1.5;
/// How far if the map says where, cm.
const KNOWN_SIGMA_CM: f64 = 0.5;
/// How far a marker is off in a frame, cm: skin, most of all.
const MARKER_SIGMA_CM: f64 = 1.0;
/// As many frames count as if each said something new: skin is off in the same way for long.
const TELLING: f64 = 2.0;
/// Bones shorter than this have no length to estimate, cm.
const SHORT_CM: f64 = 1.0;

/// Sizes are tried in such steps ...
const COARSE: f64 = 0.04;
/// ... and then in such ...
const FINE: f64 = 0.01;
/// ... up to this far from that of the rig.
const FARTHEST: f64 = 0.24;

/// Estimates offsets and scales. `None` if there is no frame in which markers of three parts are seen.
pub fn calibrate(body: &Body, limits: Option<&Limits>, seen: &Seen, known: &[Known]) -> Option<Calibration> {
    let limits = limits.map(|limits| limits.weighing(LIMIT));
    let limits = limits.as_ref();
    let (size, start) = sized(body, limits, seen, known)?;
    let body = &body.scaled(size);
    let mut model = Model {
        tree: body.tree.clone(),
        reference: body.tree.clone(),
        scales: vec![1.0; body.tree.joints()],
        parts: start.parts,
        first: start.offsets.clone(),
        offsets: start.offsets,
        sigma_cm: known.iter().map(|k| if k.place.is_some() { KNOWN_SIGMA_CM } else { OFFSET_SIGMA_CM }).collect(),
    };
    let every = (seen.frames / FRAMES).max(1);
    let frames: Vec<usize> = (0..seen.frames).step_by(every).collect();
    let mut rms_cm = f64::NAN;
    for _ in 0..ROUNDS {
        let (markers, shown) = model.shown(seen);
        let poses = solve(&model.tree, limits, &markers, &shown, &Settings::default()).poses;
        let mut chosen: Vec<Pose> = frames.iter().map(|&frame| poses[frame].clone()).collect();
        model.place(seen, &poses);
        for _ in 0..STEPS {
            model.step(seen, &frames, &mut chosen)?;
        }
        rms_cm = model.rms(seen, &frames, &chosen);
    }
    let markers = (0..seen.markers).map(|at| model.marker(at)).collect();
    let body = moved(body, &model.tree);
    let at_edge = (size - 1.0).abs() > FARTHEST - 0.5 * FINE;
    Some(Calibration { body, size, scales: model.scales, markers, rms_cm, frame: start.frame, at_edge })
}

/// The size of the body with which markers fit the surface best, and how they do.
fn sized(body: &Body, limits: Option<&Limits>, seen: &Seen, known: &[Known]) -> Option<(f64, Begun)> {
    if known.iter().any(|known| known.place.is_some()) {
        return Some((1.0, begin(body, limits, seen, known)?));
    }
    let best = |sizes: Vec<f64>| {
        let fits: Vec<Option<(f64, Begun)>> =
            sizes.par_iter().map(|&size| Some((size, begin(&body.scaled(size), limits, seen, known)?))).collect();
        fits.into_iter().flatten().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
    };
    let (about, _) = best((-6..=6).map(|step| 1.0 + COARSE * f64::from(step)).collect())?;
    let near = (-3..=3).map(|step| about + FINE * f64::from(step));
    best(near.filter(|size| (size - 1.0).abs() < FARTHEST + 0.5 * FINE).collect())
}

/// The surface with every part moved to where its joint has come to be.
fn moved(body: &Body, tree: &Tree) -> Body {
    let vertices = body.vertices.iter().zip(&body.parts).map(|(x, &part)| x + tree.links[part].centre - body.tree.links[part].centre);
    Body::new(tree.clone(), vertices.collect(), body.normals.clone(), body.faces.clone(), body.parts.clone())
}

/// What is estimated.
struct Model {
    tree: Tree,
    reference: Tree,
    scales: Vec<f64>,
    parts: Vec<Option<usize>>,
    /// The offsets that it began with.
    first: Vec<Option<Vec3>>,
    offsets: Vec<Option<Vec3>>,
    sigma_cm: Vec<f64>,
}

impl Model {
    fn marker(&self, at: usize) -> Option<Marker> {
        let (part, offset) = (self.parts[at]?, self.offsets[at]?);
        Some(Marker { part, vertex: self.tree.links[part].centre + offset, offset: Vec3::zeros() })
    }

    /// The markers that are placed, and the take with nothing else.
    fn shown(&self, seen: &Seen) -> (Vec<Marker>, Seen) {
        let nowhere = Marker { part: 0, vertex: Vec3::zeros(), offset: Vec3::zeros() };
        let mut shown = seen.clone();
        let markers = (0..seen.markers).map(|at| {
            self.marker(at).unwrap_or_else(|| {
                for frame in 0..seen.frames {
                    shown.places[frame * seen.markers + at] = Vec3::repeat(f64::NAN);
                }
                nowhere
            })
        });
        (markers.collect(), shown)
    }

    /// Places markers that were not seen in the first frame: where they are on the average, in the axes of their part.
    /// Those whose part nobody told go to the part on which they keep their place best.
    fn place(&mut self, seen: &Seen, poses: &[Pose]) {
        if self.offsets.iter().all(Option::is_some) {
            return;
        }
        let mut posed = Posed::new(&self.tree);
        let joints = self.tree.joints();
        let mut sums = vec![(0.0, Vec3::zeros(), 0.0); seen.markers * joints];
        for (frame, pose) in poses.iter().enumerate() {
            posed.set(&self.tree, pose);
            for (at, x, _) in seen.frame(frame) {
                for part in 0..joints {
                    let offset = posed.parts[part].back(x) - self.tree.links[part].centre;
                    let sum = &mut sums[at * joints + part];
                    *sum = (sum.0 + 1.0, sum.1 + offset, sum.2 + offset.norm_squared());
                }
            }
        }
        for at in 0..seen.markers {
            let spread = |part: usize| {
                let (count, sum, square) = sums[at * joints + part];
                (square / count - (sum / count).norm_squared()).max(0.0)
            };
            let best = self.parts[at].or_else(|| (0..joints).min_by(|&a, &b| spread(a).total_cmp(&spread(b))));
            let Some(best) = best else { continue };
            let (count, sum, _) = sums[at * joints + best];
            if count > 0.0 && self.offsets[at].is_none() {
                self.parts[at] = Some(best);
                self.offsets[at] = Some(sum / count);
                self.first[at] = self.offsets[at];
            }
        }
    }

    /// The centres of joints under the scales.
    fn scale(&mut self) {
        for joint in 0..self.tree.joints() {
            if let Some(parent) = self.tree.links[joint].parent {
                let bone = self.reference.links[joint].centre - self.reference.links[parent].centre;
                self.tree.links[joint].centre = self.tree.links[parent].centre + bone * self.scales[joint];
            }
        }
    }

    /// The bone of a joint in the reference pose, if it has a length.
    fn bone(&self, joint: usize) -> Option<(usize, Vec3)> {
        let parent = self.tree.links[joint].parent?;
        let bone = self.reference.links[joint].centre - self.reference.links[parent].centre;
        (bone.norm() > SHORT_CM).then_some((parent, bone))
    }

    /// A step of poses, offsets and scales.
    fn step(&mut self, seen: &Seen, frames: &[usize], poses: &mut [Pose]) -> Option<()> {
        let (n, joints) = (self.tree.freedom(), self.tree.joints());
        let size = joints + 3 * seen.markers;
        let model = &*self;
        // what a joint's scale moves: everything behind it
        let above: Vec<Vec<usize>> = (0..joints)
            .map(|joint| {
                std::iter::successors(Some(joint), |&at| model.tree.links[at].parent).filter(|&at| model.bone(at).is_some()).collect()
            })
            .collect();
        let weight = MARKER_SIGMA_CM.powi(-2) * (TELLING / frames.len() as f64).min(1.0);
        let parts: Vec<FrameStep> = frames
            .par_iter()
            .zip(&*poses)
            .map_init(
                || (Posed::new(&model.tree), Normal::new(&model.tree)),
                |(posed, normal), (&frame, pose)| {
                    posed.set(&model.tree, pose);
                    normal.clear();
                    let mut cross = DMatrix::zeros(n, size);
                    let mut own = DMatrix::zeros(size, size);
                    let mut right = DVector::zeros(size);
                    for (at, x, _) in seen.frame(frame) {
                        let Some(marker) = model.marker(at) else { continue };
                        let place = posed.parts[marker.part].point(&marker.vertex);
                        let off = place - x;
                        normal.blocks[marker.part].point(&place, weight, &off);
                        let mut columns: Vec<(usize, Vec3)> = above[marker.part]
                            .iter()
                            .filter_map(|&joint| {
                                let (parent, bone) = model.bone(joint)?;
                                Some((joint, posed.parts[parent].rotation * bone))
                            })
                            .collect();
                        for k in 0..3 {
                            columns.push((joints + 3 * at + k, posed.parts[marker.part].rotation.column(k).into_owned()));
                        }
                        for (column, along) in &columns {
                            for &dof in &model.tree.chains[marker.part] {
                                cross[(dof, *column)] += weight * posed.twists[dof].at(&place).dot(along);
                            }
                            for (other, across) in &columns {
                                own[(*column, *other)] += weight * along.dot(across);
                            }
                            right[*column] -= weight * along.dot(&off);
                        }
                    }
                    normal.gather(&model.tree, posed);
                    let full =
                        DMatrix::from_fn(n, n, |row, column| normal.entry(row, column) + if row == column { HOLD * weight } else { 0.0 });
                    let factor = full.cholesky()?;
                    let gradient = DVector::from_column_slice(normal.gradient());
                    let inner = factor.solve(&cross);
                    let rest = factor.solve(&gradient);
                    own.gemm_tr(-1.0, &cross, &inner, 1.0);
                    right += cross.tr_mul(&rest);
                    Some((own, right, inner, rest))
                },
            )
            .collect();
        let mut matrix = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        for (own, more, ..) in parts.iter().flatten() {
            matrix += own;
            right += more;
        }
        for joint in 0..joints {
            let weight = SCALE_SIGMA.powi(-2);
            matrix[(joint, joint)] += weight;
            right[joint] -= weight * (self.scales[joint] - 1.0);
        }
        for at in 0..seen.markers {
            let weight = self.sigma_cm[at].powi(-2);
            for k in 0..3 {
                matrix[(joints + 3 * at + k, joints + 3 * at + k)] += weight;
                if let (Some(now), Some(first)) = (self.offsets[at], self.first[at]) {
                    right[joints + 3 * at + k] -= weight * (now - first)[k];
                }
            }
        }
        let step = matrix.cholesky()?.solve(&right);
        for joint in 0..joints {
            self.scales[joint] = (self.scales[joint] + step[joint]).clamp(0.5, 2.0);
        }
        for (at, offset) in self.offsets.iter_mut().enumerate() {
            if let Some(offset) = offset {
                *offset += Vec3::new(step[joints + 3 * at], step[joints + 3 * at + 1], step[joints + 3 * at + 2]);
            }
        }
        self.scale();
        for (pose, part) in poses.iter_mut().zip(&parts) {
            if let Some((_, _, inner, rest)) = part {
                let update = -(rest + inner * &step);
                pose.update(&self.tree, update.as_slice(), 1.0);
            }
        }
        Some(())
    }

    fn rms(&self, seen: &Seen, frames: &[usize], poses: &[Pose]) -> f64 {
        let mut posed = Posed::new(&self.tree);
        let (mut sum, mut count) = (0.0, 0.0);
        for (&frame, pose) in frames.iter().zip(poses) {
            posed.set(&self.tree, pose);
            for (at, x, _) in seen.frame(frame) {
                if let Some(marker) = self.marker(at) {
                    sum += (posed.parts[marker.part].point(&marker.vertex) - x).norm_squared();
                    count += 1.0;
                }
            }
        }
        f64::sqrt(sum / f64::max(count, 1.0))
    }
}

/// What a frame adds to offsets and scales, and how its pose follows them.
type FrameStep = Option<(DMatrix<f64>, DVector<f64>, DMatrix<f64>, DVector<f64>)>;

/// What is added to the diagonal of poses, for joints that no marker sees.
const HOLD: f64 = 1.0;
