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
