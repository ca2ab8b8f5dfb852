//! The local frame of a set of markers that keep together: a rotation and an origin for every frame.
//!
//! A reference shape is laid over the markers by weighted least squares (Kabsch 1976). The rotation that maximises `tr(Rᵀ K)` is followed from frame to frame
//! by Newton's method on the rotation group, which settles in two or three steps; a singular value decomposition starts it and catches it when it fails.

use super::tracks::Tracks;
use nalgebra::{Matrix3, Vector3};

/// Where a set of markers is in one frame: `world = turn · local + origin`.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    turn: Matrix3<f64>,
    origin: Vector3<f64>,
}

impl Pose {
    /// The world itself.
    pub fn world_frame() -> Self {
        Self { turn: Matrix3::identity(), origin: Vector3::zeros() }
    }

    /// From local coordinates to the world's, mm.
    #[inline]
    pub fn to_world(&self, x: [f64; 3]) -> [f64; 3] {
        (self.turn * Vector3::from(x) + self.origin).into()
    }

    /// From the world's coordinates to local ones, mm.
    #[inline]
    pub fn to_local(&self, x: [f64; 3]) -> [f64; 3] {
        self.turn.tr_mul(&(Vector3::from(x) - self.origin)).into()
    }

    /// The directions of the frame's axes in the world, as columns.
    pub fn turn(&self) -> &Matrix3<f64> {
        &self.turn
    }

    /// Where the frame's origin is in the world, mm.
    pub fn origin(&self) -> Vector3<f64> {
        self.origin
    }

    /// A local direction in the world's coordinates.
    #[inline]
    pub fn direction_to_world(&self, x: Vector3<f64>) -> Vector3<f64> {
        self.turn * x
    }

    /// A direction of the world in local coordinates.
    #[inline]
    pub fn direction_to_local(&self, x: Vector3<f64>) -> Vector3<f64> {
        self.turn.tr_mul(&x)
    }
}

/// The markers that make a frame, with the weight of each of them depending on where it stands.
pub struct Core<'a> {
    /// What is read.
    pub tracks: &'a Tracks,
    /// Markers, three or more.
    pub markers: &'a [usize],
    /// Weight of each of `markers` where it was seen.
    pub weights: &'a [f64],
    /// Share of that weight which a filled sample keeps, given the standard deviation of its error (mm).
    pub trust: &'a dyn Fn(f64) -> f64,
}

impl Core<'_> {
    fn weight(&self, t: usize, k: usize) -> f64 {
        let i = self.markers[k];
        if self.tracks.seen(t, i) { self.weights[k] } else { self.weights[k] * (self.trust)(self.tracks.sigma(t, i)) }
    }

    /// Lays `shape` over frame `t`, beginning at the rotation `near`.
    fn lay(&self, shape: &[Vector3<f64>], t: usize, near: &mut Matrix3<f64>) -> Pose {
        let (mut sum, mut place, mut mean) = (0.0, Vector3::zeros(), Vector3::zeros());
        let at = |k: usize| Vector3::from(self.tracks.place(t, self.markers[k]));
        for (k, s) in shape.iter().enumerate() {
            let w = self.weight(t, k);
            sum += w;
            place += w * at(k);
            mean += w * s;
        }
        place /= sum;
        mean /= sum;
        let mut product = Matrix3::zeros();
        for (k, s) in shape.iter().enumerate() {
            product += (self.weight(t, k) * (at(k) - place)) * (s - mean).transpose();
        }
        *near = follow(&product, *near).unwrap_or_else(|| nearest(&product));
        Pose { turn: *near, origin: place - *near * mean }
    }

    /// The poses in `frames` (ascending). The reference shape is the mean over those of `learn` (ascending).
    pub fn poses(&self, frames: &[usize], learn: &[usize]) -> Vec<Pose> {
        let Some(&middle) = learn.get(learn.len() / 2) else { return vec![Pose::world_frame(); frames.len()] };
        let mut shape: Vec<Vector3<f64>> = self.markers.iter().map(|&i| self.tracks.place(middle, i).into()).collect();
        for _ in 0..2 {
            centre(&mut shape);
            let mut near = Matrix3::identity();
            let mut sums = vec![Vector3::zeros(); shape.len()];
            for &t in learn {
                let pose = self.lay(&shape, t, &mut near);
                for (sum, &i) in sums.iter_mut().zip(self.markers) {
                    *sum += Vector3::from(pose.to_local(self.tracks.place(t, i)));
                }
            }
            shape = sums.into_iter().map(|sum| sum / learn.len() as f64).collect();
        }
        centre(&mut shape);
        let mut near = Matrix3::identity();
        frames.iter().map(|&t| self.lay(&shape, t, &mut near)).collect()
    }
}

/// Puts the frame's origin into the middle of its markers: wherever the take was made, the frame moves as they do.
fn centre(shape: &mut [Vector3<f64>]) {
    let mean = shape.iter().sum::<Vector3<f64>>() / shape.len().max(1) as f64;
    for s in shape {
        *s -= mean;
    }
}

/// The rotation that maximises `tr(Rᵀ product)`, by Newton's method from `turn`; none if it does not get there.
fn follow(product: &Matrix3<f64>, mut turn: Matrix3<f64>) -> Option<Matrix3<f64>> {
    for _ in 0..8 {
        let m = turn.tr_mul(product);
        let trace = m.trace();
        let slope = Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]);
        let curvature = Matrix3::identity() * (trace * (1.0 + 1e-9)) - (m + m.transpose()) * 0.5;
        let step = curvature.cholesky()?.solve(&slope);
        let angle = step.norm();
        if angle.is_nan() || angle > 1.0 {
            return None;
        }
        turn *= nalgebra::Rotation3::from_scaled_axis(step).into_inner();
        if angle < 1e-8 {
            return Some(turn);
        }
    }
    None
}

/// The same by singular value decomposition, from nowhere.
pub fn nearest(product: &Matrix3<f64>) -> Matrix3<f64> {
    let svd = product.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
    let mut signs = Matrix3::identity();
    // the smallest singular value takes the sign
    let least = svd.singular_values.imin();
    signs[(least, least)] = (u * v_t).determinant().signum();
    u * signs * v_t
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::problem;
    use super::*;
    use crate::random::{Random, Stream};
    use nalgebra::Rotation3;

    fn direction(random: &mut Random, length: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| length * random.between(-1.0, 1.0))
    }

    fn turn(random: &mut Random, most: f64) -> Matrix3<f64> {
        let axis = direction(random, 1.0).normalize();
        Rotation3::from_scaled_axis(axis * random.between(0.0, most)).into_inner()
    }

    /// Where each frame puts the body, and the tracks of its markers with that much noise.
    fn moved(shape: &[Vector3<f64>], frames: usize, noise: f64, most: f64, away: Vector3<f64>) -> (Vec<Pose>, Tracks) {
        let mut random = Random::new(5, Stream::Gait);
        let poses: Vec<Pose> =
            (0..frames).map(|_| Pose { turn: turn(&mut random, most), origin: direction(&mut random, 1000.0) + away }).collect();
        let shaken: Vec<[f64; 3]> = (0..frames * shape.len()).map(|_| direction(&mut random, noise).into()).collect();
        let place = |t: usize, i: usize| {
            let (x, shaken) = (poses[t].to_world(shape[i].into()), shaken[t * shape.len() + i]);
            [0, 1, 2].map(|axis| x[axis] + shaken[axis])
        };
        let tracks = Tracks::new(&problem((frames, shape.len()), 100.0, place, |_, _| true));
        (poses, tracks)
    }

    fn found(tracks: &Tracks) -> Vec<Pose> {
        let (markers, weights): (Vec<usize>, Vec<f64>) = (0..tracks.markers).map(|i| (i, 1.0 / (1.0 + i as f64))).unzip();
        let frames: Vec<usize> = (0..tracks.frames).collect();
        let learn: Vec<usize> = frames.iter().copied().step_by(3).collect();
        Core { tracks, markers: &markers, weights: &weights, trust: &|_| 1.0 }.poses(&frames, &learn)
    }

    const SHAPE: [[f64; 3]; 5] = [[0.0, 0.0, 0.0], [120.0, 10.0, -5.0], [20.0, 90.0, 30.0], [-40.0, 15.0, 80.0], [60.0, -70.0, 25.0]];

    /// Turns between frames are anything up to half a turn, so nothing can be followed for long.
    #[test]
    fn a_rigid_body_is_found_wherever_it_turns() {
        for (markers, most) in [(5, 0.1), (5, std::f64::consts::PI), (4, std::f64::consts::PI), (3, std::f64::consts::PI)] {
            let shape = &SHAPE.map(Vector3::from)[..markers];
            let (poses, tracks) = moved(shape, 90, 0.0, most, Vector3::zeros());
            let found = found(&tracks);
            // the body's own axes are free, but not how they are turned from one frame to another
            let own = found[0].turn.transpose() * poses[0].turn;
            for (t, (found, pose)) in found.iter().zip(&poses).enumerate() {
                assert!((found.turn * own - pose.turn).amax() < 1e-9, "{markers} markers, turns up to {most}, frame {t}");
                assert!((found.turn.determinant() - 1.0).abs() < 1e-9, "frame {t}");
            }
            for (i, shape) in shape.iter().enumerate() {
                let first = found[0].to_local(tracks.place(0, i));
                for (t, pose) in found.iter().enumerate() {
                    let local = pose.to_local(tracks.place(t, i));
                    assert!((Vector3::from(local) - Vector3::from(first)).amax() < 1e-8, "marker {i} in frame {t}");
                    assert!((Vector3::from(pose.to_world(local)) - Vector3::from(poses[t].to_world((*shape).into()))).amax() < 1e-8);
                }
            }
        }
    }

    /// A flat body with noise looks like its mirror image in half of the frames; no frame may turn it inside out.
    #[test]
    fn a_flat_body_is_never_mirrored() {
        let flat: Vec<Vector3<f64>> = SHAPE.iter().map(|s| Vector3::new(s[0], s[1], 0.0)).collect();
        for noise in [0.0, 2.0, 60.0] {
            let (_, tracks) = moved(&flat, 120, noise, std::f64::consts::PI, Vector3::zeros());
            for (t, pose) in found(&tracks).iter().enumerate() {
                assert!((pose.turn.determinant() - 1.0).abs() < 1e-9, "noise {noise}, frame {t}");
                assert!((pose.turn.tr_mul(&pose.turn) - Matrix3::identity()).amax() < 1e-9, "noise {noise}, frame {t}");
            }
        }
    }

    #[test]
    fn wherever_newton_arrives_is_where_the_decomposition_is() {
        let mut random = Random::new(9, Stream::Start);
        let mut arrived = 0;
        for case in 0..400 {
            let columns = [0, 1, 2].map(|_| direction(&mut random, 1.0));
            let mut product = Matrix3::from_columns(&columns);
            if case % 2 == 0 && product.determinant() > 0.0 {
                product = -product; // more like its mirror image
            }
            let best = nearest(&product);
            assert!((best.determinant() - 1.0).abs() < 1e-9, "case {case}");
            for close in [0.3, 3.1] {
                let Some(followed) = follow(&product, best * turn(&mut random, close)) else { continue };
                arrived += usize::from(close < 1.0);
                let value = |turn: &Matrix3<f64>| turn.tr_mul(&product).trace();
                assert!(value(&followed) > value(&best) - 1e-9, "case {case}: {} and {}", value(&followed), value(&best));
            }
            for _ in 0..20 {
                assert!(best.tr_mul(&product).trace() >= turn(&mut random, 3.1).tr_mul(&product).trace() - 1e-12, "case {case}");
            }
        }
        assert!(arrived > 200, "it arrives only {arrived} times of 400 from nearby");
    }

    #[test]
    fn it_does_not_matter_where_the_laboratory_is() {
        let shape = SHAPE.map(Vector3::from);
        let [(_, here), (_, there)] =
            [Vector3::zeros(), Vector3::new(60_000.0, -60_000.0, 60_000.0)].map(|away| moved(&shape, 60, 1.0, 0.4, away));
        for (t, (a, b)) in found(&here).iter().zip(&found(&there)).enumerate() {
            for i in 0..shape.len() {
                let off = Vector3::from(a.to_local(here.place(t, i))) - Vector3::from(b.to_local(there.place(t, i)));
                assert!(off.amax() < 1e-6, "marker {i} in frame {t}: {off}");
            }
        }
    }
}
