//! Seeded random numbers, and random systems made of them.

use mocap_repair::solve::lds::model::Model;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// SplitMix64 (Steele, Lea and Flood, 2014).
pub struct Chance(u64);

impl Chance {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in 0..1.
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// True with this probability.
    pub fn happens(&mut self, share: f64) -> bool {
        self.unit() < share
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller, 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (TAU * self.unit()).cos()
    }

    pub fn normals(&mut self, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| self.normal())
    }

    pub fn normal_vector(&mut self, rows: usize) -> DVector<f64> {
        DVector::from_fn(rows, |_, _| self.normal())
    }

    /// Symmetric and positive definite, with eigenvalues from `least` on.
    pub fn covariance(&mut self, size: usize, least: f64) -> DMatrix<f64> {
        let root = self.normals(size, size);
        &root * root.transpose() / size as f64 + DMatrix::identity(size, size) * least
    }

    /// A system whose states neither vanish nor explode within a few frames.
    pub fn model(&mut self, hidden: usize, markers: usize) -> Model {
        Model {
            transition: self.normals(hidden, hidden) * (0.7 / (hidden as f64).sqrt()),
            emission: self.normals(3 * markers, hidden),
            offset: self.normal_vector(3 * markers),
            state_noise: self.covariance(hidden, 0.2),
            marker_noise: (0..markers).map(|_| self.between(0.05, 1.0)).collect(),
            initial_mean: self.normal_vector(hidden),
            initial_covariance: self.covariance(hidden, 0.2),
        }
    }
}
