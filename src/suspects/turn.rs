//! The turn that takes one cloud of points nearest to another.

use super::tracks::Point;
use nalgebra::{Matrix3, Matrix4, Quaternion, SymmetricEigen, UnitQuaternion, Vector3};

/// Pairs of points about the origin, with weights, summed up: all that a turn is found from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pairs {
    /// `Σ w p qᵀ`
    cross: Matrix3<f64>,
    /// `Σ w (p·p + q·q) / 2`, which is the largest that the turned clouds can have in common.
    most: f64,
}

impl Pairs {
    pub fn new(pairs: impl Iterator<Item = (Point, Point, f64)>) -> Self {
        let mut sums = Self { cross: Matrix3::zeros(), most: 0.0 };
        for (p, q, weight) in pairs {
            let (p, q) = (Vector3::from(p), Vector3::from(q));
            sums.cross += (p * weight) * q.transpose();
            sums.most += 0.5 * weight * (p.norm_squared() + q.norm_squared());
        }
        sums
    }

    /// The turn, if it is small, by Newton's method from no turn at all.
    /// Where the points do not say, as about the line on which they all lie, it does not turn.
    pub fn small(&self) -> Matrix3<f64> {
        let mut turn = Matrix3::<f64>::identity();
        for _ in 0..12 {
            let m: Matrix3<f64> = turn * self.cross;
            let torque = Vector3::new(m[(1, 2)] - m[(2, 1)], m[(2, 0)] - m[(0, 2)], m[(0, 1)] - m[(1, 0)]);
            let inertia = Matrix3::identity() * m.trace() - (m + m.transpose()) * 0.5;
            let damping = 2e-3 * self.most + f64::MIN_POSITIVE;
            let Some(inverse) = (inertia + Matrix3::identity() * damping).try_inverse() else { break };
            let half: Vector3<f64> = inverse * torque * 0.5;
            let step = UnitQuaternion::from_quaternion(Quaternion::new(1.0, half.x, half.y, half.z));
            turn = step.to_rotation_matrix().matrix() * turn;
            if half.norm_squared() < 1e-14 {
                break;
            }
        }
        turn
    }

    /// The turn, whatever it is: Horn's quaternion, the eigenvector of a symmetric matrix that belongs to its largest eigenvalue.
    pub fn any(&self) -> Option<Matrix3<f64>> {
        let m = &self.cross;
        let (xx, yy, zz) = (m[(0, 0)], m[(1, 1)], m[(2, 2)]);
        let skew = [m[(1, 2)] - m[(2, 1)], m[(2, 0)] - m[(0, 2)], m[(0, 1)] - m[(1, 0)]];
        let both = [m[(0, 1)] + m[(1, 0)], m[(1, 2)] + m[(2, 1)], m[(2, 0)] + m[(0, 2)]];
        #[rustfmt::skip] // a matrix
        let horn = Matrix4::new(
            xx + yy + zz, skew[0], skew[1], skew[2],
            skew[0], xx - yy - zz, both[0], both[2],
            skew[1], both[0], yy - xx - zz, both[1],
            skew[2], both[2], both[1], zz - xx - yy,
        );
        let q = self.quaternion(&horn).or_else(|| {
            let eigen = SymmetricEigen::try_new(horn, 1e-12, 200)?;
            let best = eigen.eigenvalues.imax();
            Some(eigen.eigenvectors.column(best).into_owned())
        })?;
        let quaternion = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
        Some(*quaternion.to_rotation_matrix().matrix())
    }

    /// The eigenvector by way of the characteristic polynomial (Theobald 2005), if that is well conditioned, which it nearly always is.
    fn quaternion(&self, horn: &Matrix4<f64>) -> Option<nalgebra::Vector4<f64>> {
        let c2 = -2.0 * self.cross.norm_squared();
        let c1 = -8.0 * self.cross.determinant();
        let c0 = horn.determinant();
        let mut largest = self.most;
        let mut settled = false;
        for _ in 0..40 {
            let square = largest * largest;
            let value = (square + c2) * square + c1 * largest + c0;
            let slope = 4.0 * square * largest + 2.0 * c2 * largest + c1;
            if slope.abs() < f64::MIN_POSITIVE {
                return None;
            }
            let step = value / slope;
            largest -= step;
            if step.abs() <= 1e-11 * self.most {
                settled = true;
                break;
            }
        }
        if !settled {
            return None;
        }
        // a column of the adjugate of what is singular now is the eigenvector
        let singular = horn - Matrix4::identity() * largest;
        let mut best = None;
        let mut longest = 0.0;
        for column in [0, 3, 1, 2] {
            let minor = |row: usize| {
                let sign = if (row + column).is_multiple_of(2) { 1.0 } else { -1.0 };
                sign * singular.remove_row(row).remove_column(column).determinant()
            };
            let vector = nalgebra::Vector4::new(minor(0), minor(1), minor(2), minor(3));
            if vector.norm_squared() > longest {
                longest = vector.norm_squared();
                best = Some(vector);
            }
            if longest.sqrt() > 1e-2 * self.most.powi(3) {
                break;
            }
        }
        (longest.sqrt() > 1e-6 * self.most.powi(3)).then_some(best).flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_found() {
        let points: [Point; 4] = [[100.0, 0.0, 20.0], [-50.0, 80.0, 0.0], [-50.0, -80.0, 30.0], [0.0, 0.0, -50.0]];
        for axis in [[0.1, -0.2, 0.05], [2.0, -1.0, 1.5], [3.1, 0.0, 0.0], [0.0, 0.0, 0.0]] {
            let turn = nalgebra::Rotation3::new(Vector3::from(axis));
            let sums = Pairs::new(points.iter().map(|&p| (p, (turn * Vector3::from(p)).into(), 0.01)));
            let off = sums.any().map_or(f64::INFINITY, |found| (found - turn.matrix()).norm());
            assert!(off < 1e-6, "{axis:?}: {off}");
            if Vector3::from(axis).norm() < 1.0 {
                assert!((sums.small() - turn.matrix()).norm() < 1e-6, "{axis:?}");
            }
        }
    }

    /// Nothing says how points on a line turn about it.
    #[test]
    fn a_line_does_not_turn_about_itself() {
        let line: [Point; 3] = [[0.0, 0.0, -100.0], [0.0, 0.0, 30.0], [0.0, 0.0, 70.0]];
        let sums = Pairs::new(line.iter().map(|&p| (p, p, 1.0)));
        assert!((sums.small() - Matrix3::identity()).norm() < 1e-12);
        assert!(sums.any().is_some_and(|turn| (turn * Vector3::z() - Vector3::z()).norm() < 1e-9));
    }
}
