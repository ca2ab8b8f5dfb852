//! Body-local coordinates, found from what was seen.
//!
//! The paper turns each frame so that the body faces one way and stands over one point of the floor: a horizontal translation and a turn about the
//! vertical per frame. It did so with complete data; here markers are missing, labels may be foreign, and everything may black out.
//!
//! A set of *core* markers with a reference shape is laid over each frame by weighted least squares (the planar Procrustes problem), with whatever of
//! the core is seen. Known labels of back and front give the core at once (a start, no more: any other set works too); otherwise every marker takes part,
//! weighted by how little it moves in the common coordinates, found by iteration.
//! The resulting path of each of the three numbers is then smoothed: a smoothing spline on equidistant frames whose data weight is the share of the core
//! that was seen. It hardly touches a seen frame, keeps the path continuous where the seen part of the core changes, and carries it through black-outs.

use super::Problem;

/// One turn and one translation per frame.
#[derive(Clone, Debug)]
pub struct BodyFrames {
    /// Axis that points up: 0, 1 or 2. The other two follow cyclically, so the order stays right-handed.
    up: usize,
    /// Cosine and sine of the turn from world to local, per frame.
    turns: Vec<(f64, f64)>,
    /// The point of the floor that becomes the origin, mm, along the two horizontal axes.
    origins: Vec<[f64; 2]>,
}

/// Labels of the CMU and Vicon sets that lie on the trunk.
const TRUNK: [&str; 10] = ["C7", "T8", "T10", "RBAC", "LBWT", "RBWT", "CLAV", "STRN", "LFWT", "RFWT"];

/// Up to this frequency the body's path is followed closely.
const PATH_HZ: f64 = 10.0;

impl BodyFrames {
    /// No turn, no translation.
    fn identity(frames: usize, up: usize) -> Self {
        Self { up, turns: vec![(1.0, 0.0); frames], origins: vec![[0.0; 2]; frames] }
    }

    /// Finds the body frames of a problem. With fewer than three markers, or nothing that keeps together, they are the world's.
    pub fn find(problem: &Problem) -> Self {
        let up = problem.up.map_or_else(|| guess_up(problem), |d| d.axis);
        let (frames, markers) = (problem.frames(), problem.markers());
        if markers < 3 || frames == 0 {
            return Self::identity(frames, up);
        }
        let trunk: Vec<bool> = problem.names.iter().map(|name| TRUNK.contains(&name.as_str())).collect();
        let labelled = trunk.iter().filter(|&&t| t).count() >= 4;
        let mut weights: Vec<f64> = trunk.iter().map(|&t| if t || !labelled { 1.0 } else { 0.0 }).collect();
        let flat = |t: usize, i: usize| problem.position_mm(t, i).map(|p| [p[(up + 1) % 3], p[(up + 2) % 3]]);
        // the reference shape starts as the frame that shows most of the core
        let first = (0..frames)
            .max_by(|&a, &b| {
                let seen = |t: usize| (0..markers).filter(|&i| problem.observed(t, i)).map(|i| weights[i]).sum::<f64>();
                seen(a).total_cmp(&seen(b)).then(b.cmp(&a))
            })
            .unwrap_or(0);
        let mut reference: Vec<Option<[f64; 2]>> = (0..markers).map(|i| flat(first, i)).collect();
        centre(&mut reference, &weights);
        let mut poses = vec![None; frames];
        for round in 0..6 {
            let mut sums = vec![[0.0; 2]; markers];
            let mut squares = vec![0.0; markers];
            let mut counts = vec![0usize; markers];
            for (t, pose) in poses.iter_mut().enumerate() {
                *pose = lay(&reference, &weights, &|i| flat(t, i));
                if let Some(Pose { cosine, sine, origin, .. }) = *pose {
                    for i in 0..markers {
                        if let Some(p) = flat(t, i) {
                            let local = turn([p[0] - origin[0], p[1] - origin[1]], cosine, sine);
                            sums[i][0] += local[0];
                            sums[i][1] += local[1];
                            squares[i] += local[0] * local[0] + local[1] * local[1];
                            counts[i] += 1;
                        }
                    }
                }
            }
            for i in 0..markers {
                reference[i] = (counts[i] > 0).then(|| [sums[i][0] / counts[i] as f64, sums[i][1] / counts[i] as f64]);
            }
            if !labelled && round >= 1 {
                for i in 0..markers {
                    weights[i] = reference[i].map_or(0.0, |m| {
                        let variance = (squares[i] / counts[i] as f64 - m[0] * m[0] - m[1] * m[1]).max(0.0);
                        1.0 / (variance + CORE_SPREAD_MM * CORE_SPREAD_MM)
                    });
                }
            }
            centre(&mut reference, &weights);
        }
        Self::smoothed(problem, up, &poses)
    }

    /// Joins the poses of single frames into continuous paths.
    fn smoothed(problem: &Problem, up: usize, poses: &[Option<Pose>]) -> Self {
        let frames = poses.len();
        let most_weight = poses.iter().flatten().map(|p| p.weight).fold(0.0, f64::max);
        let most_inertia = poses.iter().flatten().map(|p| p.inertia).fold(0.0, f64::max);
        if most_weight <= 0.0 {
            return Self::identity(frames, up);
        }
        let stiffness = (2.0 * (std::f64::consts::PI * (PATH_HZ / problem.rate_hz).min(0.25)).sin()).powi(-4);
        let mut angles = vec![0.0; frames];
        let mut angle_weights = vec![0.0; frames];
        let mut last: Option<f64> = None;
        for (t, pose) in poses.iter().enumerate() {
            let Some(pose) = pose else { continue };
            // a direction from next to nothing is none
            if most_inertia <= 0.0 || pose.inertia < 0.05 * most_inertia {
                continue;
            }
            let mut angle = pose.sine.atan2(pose.cosine);
            if let Some(last) = last {
                angle += ((last - angle) / std::f64::consts::TAU).round() * std::f64::consts::TAU;
            }
            last = Some(angle);
            angles[t] = angle;
            angle_weights[t] = pose.inertia / most_inertia;
        }
        let angles = smooth(&angles, &angle_weights, stiffness);
        let turns: Vec<(f64, f64)> = angles.iter().map(|a| (a.cos(), a.sin())).collect();
        // the origin follows from the centroid that was seen and the smoothed turn, so that a smoothed angle does not push the body aside
        let mut path = [vec![0.0; frames], vec![0.0; frames]];
        let mut weights = vec![0.0; frames];
        for (t, pose) in poses.iter().enumerate() {
            if let Some(pose) = pose {
                let (cosine, sine) = turns[t];
                let back = turn(pose.centre_reference, cosine, -sine);
                for axis in 0..2 {
                    path[axis][t] = pose.centre_seen[axis] - back[axis];
                }
                weights[t] = pose.weight / most_weight;
            }
        }
        let x = smooth(&path[0], &weights, stiffness);
        let y = smooth(&path[1], &weights, stiffness);
        Self { up, turns, origins: x.into_iter().zip(y).map(|(x, y)| [x, y]).collect() }
    }

    /// From the take's axes to local ones (mm); the third local axis points up.
    pub fn to_local(&self, frame: usize, p: [f64; 3]) -> [f64; 3] {
        let (cosine, sine) = self.turns[frame];
        let [x, y] = self.origins[frame];
        let flat = turn([p[(self.up + 1) % 3] - x, p[(self.up + 2) % 3] - y], cosine, sine);
        [flat[0], flat[1], p[self.up]]
    }

    /// From local axes to the take's (mm).
    pub fn to_world(&self, frame: usize, p: [f64; 3]) -> [f64; 3] {
        let (cosine, sine) = self.turns[frame];
        let [x, y] = self.origins[frame];
        let flat = turn([p[0], p[1]], cosine, -sine);
        let mut world = [0.0; 3];
        world[(self.up + 1) % 3] = flat[0] + x;
        world[(self.up + 2) % 3] = flat[1] + y;
        world[self.up] = p[2];
        world
    }
}

/// A marker that moves less than this in the body's coordinates gains no further weight, mm.
const CORE_SPREAD_MM: f64 = 30.0;

/// The reference shape laid over one frame.
#[derive(Clone, Copy, Debug)]
struct Pose {
    cosine: f64,
    sine: f64,
    origin: [f64; 2],
    /// Weighted centroid of what was seen, and of the same markers in the reference.
    centre_seen: [f64; 2],
    centre_reference: [f64; 2],
    /// Summed weight of what was seen.
    weight: f64,
    /// How firmly it holds the direction.
    inertia: f64,
}

/// Puts the weighted middle of a shape at the origin.
/// An origin far from the body would sweep with every wobble of the turn, and smoothing cuts corners of what sweeps:
/// then a repair would depend on where in the room the take was made (`tests/laws/moving.rs`).
fn centre(shape: &mut [Option<[f64; 2]>], weights: &[f64]) {
    let (mut sum, mut weight) = ([0.0; 2], 0.0);
    for (at, w) in shape.iter().zip(weights) {
        if let Some(at) = at {
            sum = [sum[0] + w * at[0], sum[1] + w * at[1]];
            weight += w;
        }
    }
    if weight > 0.0 {
        for at in shape.iter_mut().flatten() {
            *at = [at[0] - sum[0] / weight, at[1] - sum[1] / weight];
        }
    }
}

fn turn(p: [f64; 2], cosine: f64, sine: f64) -> [f64; 2] {
    [cosine * p[0] - sine * p[1], sine * p[0] + cosine * p[1]]
}

/// The planar Procrustes problem: the turn and translation that take what is seen closest to the reference.
fn lay(reference: &[Option<[f64; 2]>], weights: &[f64], seen: &dyn Fn(usize) -> Option<[f64; 2]>) -> Option<Pose> {
    let mut weight = 0.0;
    let (mut p, mut r) = ([0.0; 2], [0.0; 2]);
    let mut pairs = Vec::with_capacity(weights.len());
    for (i, (&w, shape)) in weights.iter().zip(reference).enumerate() {
        if w > 0.0
            && let (Some(shape), Some(at)) = (*shape, seen(i))
        {
            for axis in 0..2 {
                p[axis] += w * at[axis];
                r[axis] += w * shape[axis];
            }
            weight += w;
            pairs.push((w, at, shape));
        }
    }
    if weight <= 0.0 {
        return None;
    }
    let p = p.map(|x| x / weight);
    let r = r.map(|x| x / weight);
    let (mut dot, mut cross) = (0.0, 0.0);
    for (w, at, shape) in pairs {
        let (a, b) = ([at[0] - p[0], at[1] - p[1]], [shape[0] - r[0], shape[1] - r[1]]);
        dot += w * (a[0] * b[0] + a[1] * b[1]);
        cross += w * (a[0] * b[1] - a[1] * b[0]);
    }
    let inertia = dot.hypot(cross);
    let (cosine, sine) = if inertia > 0.0 { (dot / inertia, cross / inertia) } else { (1.0, 0.0) };
    let back = turn(r, cosine, -sine);
    Some(Pose { cosine, sine, origin: [p[0] - back[0], p[1] - back[1]], centre_seen: p, centre_reference: r, weight, inertia })
}

/// The axis along which the markers keep their order and lie far apart: a body is taller than wide, and turns about the vertical.
/// Judged by (spread between markers)⁴ / (movement of each about its mean)²; the ratio alone mistakes a runner's side for his height.
pub(crate) fn guess_up(problem: &Problem) -> usize {
    let markers = problem.markers();
    let stride = (problem.frames() / 500).max(1);
    let mut sums = vec![[0.0; 3]; markers];
    let mut squares = vec![[0.0; 3]; markers];
    let mut counts = vec![0.0; markers];
    for t in (0..problem.frames()).step_by(stride) {
        let seen: Vec<(usize, [f64; 3])> = (0..markers).filter_map(|i| Some((i, problem.position_mm(t, i)?))).collect();
        if seen.len() * 2 < markers {
            continue;
        }
        for axis in 0..3 {
            let mean = seen.iter().map(|(_, p)| p[axis]).sum::<f64>() / seen.len() as f64;
            for &(i, p) in &seen {
                sums[i][axis] += p[axis] - mean;
                squares[i][axis] += (p[axis] - mean).powi(2);
            }
        }
        for &(i, _) in &seen {
            counts[i] += 1.0;
        }
    }
    let score = |axis: usize| {
        let (mut between, mut within) = (0.0, 1.0); // 1 mm²: a body that does not move at all
        for i in (0..markers).filter(|&i| counts[i] > 0.0) {
            let mean = sums[i][axis] / counts[i];
            between += mean * mean;
            within += (squares[i][axis] / counts[i] - mean * mean).max(0.0);
        }
        between * between / within
    };
    // z wins a tie: it is the usual one
    (0..3).max_by(|&a, &b| score(a).total_cmp(&score(b))).unwrap_or(2)
}

/// Minimises `Σ w (x - value)² + stiffness · Σ (second difference of x)²`: a banded system, solved by Cholesky.
/// Frames of weight 0 are interpolated, beyond the first and last weighted frame the path goes on in a straight line.
fn smooth(values: &[f64], weights: &[f64], stiffness: f64) -> Vec<f64> {
    let n = values.len();
    let weighted = weights.iter().filter(|&&w| w > 0.0).count();
    if weighted < 2 || n < 3 {
        let mean = values.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>() / weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        return values.iter().zip(weights).map(|(v, w)| if *w > 0.0 { *v } else { mean }).collect();
    }
    // the matrix has two bands beside the diagonal
    let mut band = vec![[0.0; 3]; n]; // [diagonal, one below, two below]
    for (row, w) in band.iter_mut().zip(weights) {
        row[0] += w;
    }
    for t in 0..n - 2 {
        for (k, a) in [1.0, -2.0, 1.0].into_iter().enumerate() {
            for (l, b) in [1.0, -2.0, 1.0].into_iter().enumerate().skip(k) {
                band[t + k][l - k] += stiffness * a * b;
            }
        }
    }
    // L D Lᵀ in place: band[t] = [D, L(t+1, t), L(t+2, t)]
    for t in 0..n {
        let [d, one, two] = band[t];
        let (l1, l2) = (one / d, two / d);
        if t + 1 < n {
            band[t + 1][0] -= l1 * one;
            band[t + 1][1] -= l2 * one;
        }
        if t + 2 < n {
            band[t + 2][0] -= l2 * two;
        }
        band[t] = [d, l1, l2];
    }
    let mut x: Vec<f64> = values.iter().zip(weights).map(|(v, w)| v * w).collect();
    for t in 0..n {
        let now = x[t];
        if t + 1 < n {
            x[t + 1] -= band[t][1] * now;
        }
        if t + 2 < n {
            x[t + 2] -= band[t][2] * now;
        }
    }
    for t in (0..n).rev() {
        let mut now = x[t] / band[t][0];
        if t + 1 < n {
            now -= band[t][1] * x[t + 1];
        }
        if t + 2 < n {
            now -= band[t][2] * x[t + 2];
        }
        x[t] = now;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_passes_through_the_smoother_untouched() {
        let line: Vec<f64> = (0..50).map(|t| 3.0 + 2.0 * f64::from(t)).collect();
        let mut weights = vec![1.0; 50];
        weights[20..35].fill(0.0);
        weights[45..].fill(0.0);
        for (a, b) in smooth(&line, &weights, 50.0).iter().zip(&line) {
            assert!((a - b).abs() < 1e-8, "{a} {b}");
        }
    }

    #[test]
    fn the_smoother_solves_its_normal_equations() {
        let values: Vec<f64> = (0..12).map(|t| f64::from(t * t % 7)).collect();
        let weights: Vec<f64> = (0..12).map(|t| f64::from(t % 3)).collect();
        let x = smooth(&values, &weights, 0.7);
        let cost = |x: &[f64]| -> f64 {
            let data: f64 = (0..12).map(|t| weights[t] * (x[t] - values[t]).powi(2)).sum();
            let bend: f64 = (1..11).map(|t| (x[t - 1] - 2.0 * x[t] + x[t + 1]).powi(2)).sum();
            data + 0.7 * bend
        };
        for t in 0..12 {
            for step in [-1e-4, 1e-4] {
                let mut y = x.clone();
                y[t] += step;
                assert!(cost(&y) >= cost(&x), "frame {t}");
            }
        }
    }

    #[test]
    fn a_turned_shape_is_laid_back() {
        let shape = [Some([0.0, 0.0]), Some([100.0, 0.0]), Some([0.0, 50.0])];
        let (sine, cosine) = 0.7f64.sin_cos();
        let seen = |i: usize| {
            let p = turn(shape[i]?, cosine, sine);
            Some([p[0] + 10.0, p[1] - 20.0])
        };
        let pose = lay(&shape, &[1.0; 3], &seen).expect("three points");
        assert!((pose.sine.atan2(pose.cosine) + 0.7).abs() < 1e-12);
        assert!((pose.origin[0] - 10.0).abs() < 1e-9 && (pose.origin[1] + 20.0).abs() < 1e-9);
    }
}
