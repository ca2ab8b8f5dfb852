//! Rotations → the angles of three rotation channels, without jumps over time.
//!
//! `R = Rᵢ(a) Rⱼ(b) Rₖ(c)` for channels about the axes i, j, k from left to right. With `s` = 1 for i j k = x y z, y z x, z x y, and else -1:
//!
//! | element | is |
//! | --- | --- |
//! | `R[i][k]` | `s sin b` |
//! | `R[j][k]`, `R[k][k]` | `-s sin a cos b`, `cos a cos b` |
//!
//! Each rotation has two such triples, `a b c` and `a+π π-b c+π`, and each angle may have whole turns more.
//! Where `cos b` is 0, only the sum or the difference of `a` and `c` matters.

use std::f64::consts::{PI, TAU};

/// The order in which the angles of a joint are written, and in which they apply from left to right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// `Xrotation Yrotation Zrotation`
    Xyz,
    /// `Xrotation Zrotation Yrotation`
    Xzy,
    /// `Yrotation Xrotation Zrotation`
    Yxz,
    /// `Yrotation Zrotation Xrotation`
    Yzx,
    /// `Zrotation Xrotation Yrotation`
    Zxy,
    /// `Zrotation Yrotation Xrotation`
    #[default]
    Zyx,
}

impl Order {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Xyz, Self::Xzy, Self::Yxz, Self::Yzx, Self::Zxy, Self::Zyx];

    /// Its name, such as `ZYX`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Xyz => "XYZ",
            Self::Xzy => "XZY",
            Self::Yxz => "YXZ",
            Self::Yzx => "YZX",
            Self::Zxy => "ZXY",
            Self::Zyx => "ZYX",
        }
    }

    /// The axes: 0 = x, 1 = y, 2 = z.
    pub(super) fn axes(self) -> [usize; 3] {
        match self {
            Self::Xyz => [0, 1, 2],
            Self::Xzy => [0, 2, 1],
            Self::Yxz => [1, 0, 2],
            Self::Yzx => [1, 2, 0],
            Self::Zxy => [2, 0, 1],
            Self::Zyx => [2, 1, 0],
        }
    }

    fn sign(self) -> f64 {
        if matches!(self, Self::Xyz | Self::Yzx | Self::Zxy) { 1.0 } else { -1.0 }
    }
}

/// Below this cosine the first angle says nothing any more.
const LOCKED: f64 = 1e-9;

/// Rows of a rotation.
pub(super) type Rows = [[f64; 3]; 3];

fn at(rows: &Rows, row: usize, column: usize) -> f64 {
    rows.get(row).and_then(|row| row.get(column)).copied().unwrap_or(0.0)
}

/// The angles of `rotation` in radians that are nearest to `before`.
pub(super) fn angles(rotation: &Rows, order: Order, before: [f64; 3]) -> [f64; 3] {
    let ([i, j, k], s) = (order.axes(), order.sign());
    let (sine, cosine) = (-s * at(rotation, j, k), at(rotation, k, k));
    let [first, ..] = before;
    let first = if sine.hypot(cosine) < LOCKED { first } else { sine.atan2(cosine) };
    let one = with_first(rotation, [i, j, k], s, first);
    let [a, b, c] = one;
    let branches = [one, [a + PI, PI - b, c + PI]].map(|branch| nearest(branch, before));
    let [one, other] = branches;
    if far(other, before) < far(one, before) { other } else { one }
}

/// The triple with this first angle. The others follow from `Rᵢ(-a) R = Rⱼ(b) Rₖ(c)`, so that what is uncertain in the first, near where
/// `cos b` is 0, is made up for by the last.
fn with_first(rotation: &Rows, [i, j, k]: [usize; 3], s: f64, a: f64) -> [f64; 3] {
    let (sin, cos) = a.sin_cos();
    // the rows j and k of Rᵢ(-a) R
    let row_j = |column: usize| cos * at(rotation, j, column) + s * sin * at(rotation, k, column);
    let row_k = |column: usize| cos * at(rotation, k, column) - s * sin * at(rotation, j, column);
    [a, (s * at(rotation, i, k)).atan2(row_k(k)), (s * row_j(i)).atan2(row_j(j))]
}

/// The same angles with as many whole turns more as bring them nearest to others.
pub(super) fn nearest(angles: [f64; 3], before: [f64; 3]) -> [f64; 3] {
    let [a, b, c] = angles;
    let [x, y, z] = before;
    [unwrapped(a, x), unwrapped(b, y), unwrapped(c, z)]
}

/// An angle with as many whole turns more as bring it nearest to another.
pub(super) fn unwrapped(angle: f64, before: f64) -> f64 {
    angle - ((angle - before) / TAU).round() * TAU
}

fn far(angles: [f64; 3], before: [f64; 3]) -> f64 {
    angles.iter().zip(before).map(|(x, y)| (x - y) * (x - y)).sum()
}

/// A rotation by `angle` about an axis of length 1 (Rodrigues).
pub(super) fn about([x, y, z]: [f64; 3], angle: f64) -> Rows {
    let (s, c) = angle.sin_cos();
    let v = 1.0 - c;
    [
        [c + x * x * v, x * y * v - z * s, x * z * v + y * s],
        [x * y * v + z * s, c + y * y * v, y * z * v - x * s],
        [x * z * v - y * s, y * z * v + x * s, c + z * z * v],
    ]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::indexing_slicing)]
    use super::*;

    fn product(a: &Rows, b: &Rows) -> Rows {
        std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
    }

    fn unit(axis: usize) -> [f64; 3] {
        std::array::from_fn(|at| f64::from(u8::from(at == axis)))
    }

    fn composed(angles: [f64; 3], order: Order) -> Rows {
        let [i, j, k] = order.axes();
        product(&product(&about(unit(i), angles[0]), &about(unit(j), angles[1])), &about(unit(k), angles[2]))
    }

    fn differ(a: &Rows, b: &Rows) -> f64 {
        a.iter().flatten().zip(b.iter().flatten()).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn angles_make_the_rotation_again() {
        let steps = [-PI, -2.5, -PI / 2.0, -1e-10, 0.0, 1e-7, 0.7, PI / 2.0 - 1e-9, PI / 2.0, PI / 2.0 + 1e-7, 3.0, PI];
        for order in Order::ALL {
            for a in steps {
                for b in steps {
                    for c in steps {
                        let rotation = composed([a, b, c], order);
                        for before in [[0.0; 3], [1.0, -2.0, 3.0], [30.0, 0.0, -11.0]] {
                            let found = angles(&rotation, order, before);
                            let off = differ(&rotation, &composed(found, order));
                            assert!(off < 1e-8, "{order:?} {a} {b} {c}: {found:?}, off by {off:e}");
                            assert!(found.iter().zip(before).all(|(x, y)| (x - y).abs() <= PI + 1e-9), "{found:?} {before:?}");
                        }
                    }
                }
            }
        }
    }

    /// The second angle goes through 90 degrees and on, round and round, and nothing jumps.
    #[test]
    fn angles_follow_through_the_lock() {
        for order in Order::ALL {
            let mut before = [0.4, 0.0, -0.3];
            for step in 0..1000 {
                let b = f64::from(step) * PI / 180.0;
                let found = angles(&composed([0.4, b, -0.3], order), order, before);
                assert!(found.iter().zip([0.4, b, -0.3]).all(|(x, y)| (x - y).abs() < 1e-6), "{order:?} {step}: {found:?}");
                before = found;
            }
        }
    }

    /// At the lock itself the first angle stays, and the last does what is left.
    #[test]
    fn the_first_angle_stays_at_the_lock() {
        for order in Order::ALL {
            let found = angles(&composed([0.9, PI / 2.0, 0.2], order), order, [0.4, 1.5, 0.0]);
            assert_eq!(found[0], 0.4, "{order:?}");
            assert!(differ(&composed(found, order), &composed([0.9, PI / 2.0, 0.2], order)) < 1e-12);
        }
    }
}
