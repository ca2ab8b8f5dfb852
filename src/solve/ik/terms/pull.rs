//! What is believed about a pose before anything is seen: where motion leads, and what a body is usually like.

use super::{At, Term};
use crate::solve::ik::{Normal, Pose, State, Tree, Vec3};
use nalgebra::{DMatrix, Matrix3};

/// Pulls every degree of freedom by itself towards a pose: the one that motion leads to, for instance.
#[derive(Clone, Debug)]
pub struct Pull {
    /// The pose.
    pub towards: Pose,
    /// For each degree of freedom, the weight of its squared difference.
    pub weights: Vec<f64>,
}

/// Pulls towards a pose by a full matrix: joints that move together are expected to.
#[derive(Clone, Debug)]
pub struct Prior {
    /// The usual pose.
    pub usual: Pose,
    /// A square root of the inverse covariance of differences from it: `precision = rootᵀ root`; rows are residuals.
    pub root: DMatrix<f64>,
}

/// The differences of a pose from another, and for each joint how they follow its update: the inverse of the right Jacobian of the exponential.
fn differences(tree: &Tree, pose: &Pose, other: &Pose) -> (Vec<f64>, Vec<Matrix3<f64>>) {
    let mut update = vec![0.0; tree.freedom()];
    pose.since(tree, other, &mut update);
    let follow = pose.0.iter().enumerate().map(|(joint, state)| match state {
        State::Rotation(_) => follow(&Vec3::from_column_slice(&update[tree.own(joint)])),
        _ => Matrix3::identity(),
    });
    let follow = follow.collect();
    (update, follow)
}

/// How `log(R exp([w]))` follows `w`, at `log R = e`.
fn follow(e: &Vec3) -> Matrix3<f64> {
    let angle = e.norm();
    let cross = e.cross_matrix();
    let factor = if angle < 1e-4 { 1.0 / 12.0 } else { 1.0 / (angle * angle) - (1.0 + angle.cos()) / (2.0 * angle * angle.sin()) };
    Matrix3::identity() + cross * 0.5 + cross * cross * factor
}

impl Term for Pull {
    fn residuals(&self, at: &At<'_>, residuals: &mut Vec<f64>) {
        let (off, _) = differences(at.tree, at.pose, &self.towards);
        residuals.extend(off.iter().zip(&self.weights).map(|(off, weight)| off * weight.sqrt()));
    }

    fn add(&self, at: &At<'_>, normal: &mut Normal) {
        let (off, follow) = differences(at.tree, at.pose, &self.towards);
        for (joint, follow) in follow.iter().enumerate() {
            for (row, dof) in at.tree.own(joint).enumerate() {
                let count = at.tree.own(joint).len();
                let gradient = [follow[(row, 0)], follow[(row, 1)], follow[(row, 2)]];
                normal.add(at.tree.links[joint].first, if count == 1 { &[1.0] } else { &gradient }, self.weights[dof], off[dof]);
            }
        }
    }
}

impl Term for Prior {
    fn residuals(&self, at: &At<'_>, residuals: &mut Vec<f64>) {
        let (off, _) = differences(at.tree, at.pose, &self.usual);
        residuals.extend(self.root.row_iter().map(|row| row.iter().zip(&off).map(|(a, b)| a * b).sum::<f64>()));
    }

    fn add(&self, at: &At<'_>, normal: &mut Normal) {
        let (off, follow) = differences(at.tree, at.pose, &self.usual);
        let mut jacobian = self.root.clone();
        for (joint, follow) in follow.iter().enumerate() {
            let own = at.tree.own(joint);
            if own.len() == 3 {
                let columns = self.root.columns(own.start, 3) * follow;
                jacobian.columns_mut(own.start, 3).copy_from(&columns);
            }
        }
        let residuals: Vec<f64> = self.root.row_iter().map(|row| row.iter().zip(&off).map(|(a, b)| a * b).sum()).collect();
        for column in 0..jacobian.ncols() {
            normal.add_gradient(column, jacobian.column(column).iter().zip(&residuals).map(|(a, b)| a * b).sum());
            for row in column..jacobian.ncols() {
                normal.add_entry(row, column, jacobian.column(row).dot(&jacobian.column(column)));
            }
        }
    }
}
