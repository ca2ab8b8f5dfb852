//! The M-step against the function that it claims to maximise.
//!
//! That function is the expected log-density of states and markers under the moments of the E-step, up to a constant.
//! It is written out here from the moments; that it is the right one is seen from its slope, which at the parameters of the E-step
//! is the slope of the log-likelihood itself (Fisher's identity), and that is computed from one big Gaussian.

use crate::chance::Chance;
use crate::dense::{Gaussian, Table, evidence, seen};
use crate::near;
use mocap_repair::solve::lds::em::{self, Noise, maximise};
use mocap_repair::solve::lds::model::Model;
use mocap_repair::solve::lds::smoother::{Smoothed, smooth};
use nalgebra::{DMatrix, DVector};

/// What the E-step hands to the M-step.
struct Moments {
    smoothed: Smoothed,
    of: em::Moments,
}

impl Moments {
    /// Those of a table with holes under `model`.
    fn new(model: &Model, table: &Table) -> Self {
        let smoothed = smooth(model, evidence(model, table)).unwrap();
        let (m, hidden) = (table.nrows(), model.hidden());
        let mut of = em::Moments { cross: DMatrix::zeros(m, hidden), sum: DVector::zeros(m), squares: vec![0.0; m / 3] };
        for t in 0..table.ncols() {
            let mean = smoothed.means.column(t);
            for k in 0..m {
                let mut x = table[(k, t)];
                if x.is_nan() {
                    let row = model.emission.row(k);
                    let carried = row * smoothed.covariance_of(t);
                    x = (row * mean)[0] + model.offset[k];
                    of.squares[k / 3] += carried.dot(&row) + model.marker_noise[k / 3];
                    let mut cross = of.cross.row_mut(k);
                    cross += carried;
                }
                let mut cross = of.cross.row_mut(k);
                cross += mean.transpose() * x;
                of.sum[k] += x;
                of.squares[k / 3] += x * x;
            }
        }
        Self { smoothed, of }
    }

    /// Expected log-density of states and markers under `model`, up to a constant; -∞ if a covariance is not one.
    fn expected(&self, model: &Model) -> f64 {
        let Smoothed { means, lagged, .. } = &self.smoothed;
        let frames = means.ncols();
        let second = |t: usize| self.smoothed.covariance_of(t) + means.column(t) * means.column(t).transpose();
        let gaussian = |covariance: &DMatrix<f64>, count: usize, squares: &DMatrix<f64>| {
            let Some(factor) = covariance.clone().cholesky() else { return f64::NEG_INFINITY };
            -0.5 * (count as f64 * factor.ln_determinant() + factor.solve(squares).trace())
        };
        let off = means.column(0) - &model.initial_mean;
        let mut sum = gaussian(&model.initial_covariance, 1, &(self.smoothed.covariance_of(0) + &off * off.transpose()));
        let past = (0..frames - 1).map(second).sum::<DMatrix<f64>>();
        let next = (1..frames).map(second).sum::<DMatrix<f64>>();
        let step = (1..frames).fold(lagged.clone(), |sum, t| sum + means.column(t) * means.column(t - 1).transpose());
        let f = &model.transition;
        let squares = next - f * step.transpose() - &step * f.transpose() + f * past * f.transpose();
        sum += gaussian(&model.state_noise, frames - 1, &squares);
        let states = (0..frames).map(second).sum::<DMatrix<f64>>();
        let state = means.column_sum();
        for (i, noise) in model.marker_noise.iter().enumerate() {
            let (g, d) = (model.emission.rows(3 * i, 3), model.offset.rows(3 * i, 3));
            let squares = self.of.squares[i] - 2.0 * g.dot(&self.of.cross.rows(3 * i, 3)) + (g * &states).dot(&g)
                - 2.0 * d.dot(&self.of.sum.rows(3 * i, 3))
                + 2.0 * d.dot(&(g * &state))
                + frames as f64 * d.norm_squared();
            sum -= 0.5 * ((3 * frames) as f64 * noise.ln() + squares / noise);
        }
        sum
    }
}

/// A table drawn at random, without the samples that chance hides.
fn table(chance: &mut Chance, markers: usize, frames: usize, missing: f64) -> Table {
    let mut table = chance.normals(3 * markers, frames) * 1.5;
    for t in 0..frames {
        for i in 0..markers {
            if chance.happens(missing) {
                table.view_mut((3 * i, t), (3, 1)).fill(f64::NAN);
            }
        }
    }
    table
}

/// The model moved by `step` in some direction within each of their seven parameters in turn, and the name of that parameter.
/// Covariances stay symmetric.
fn moved(model: &Model, chance: &mut Chance, step: f64) -> Vec<(&'static str, Model)> {
    let (hidden, markers) = (model.hidden(), model.marker_noise.len());
    let symmetric = |chance: &mut Chance| {
        let any = chance.normals(hidden, hidden);
        (&any + any.transpose()) * 0.5
    };
    let mut out: Vec<(&'static str, Model)> =
        ["F", "G", "Λ", "noise", "μ₀", "Γ", "d"].into_iter().map(|name| (name, model.clone())).collect();
    out[0].1.transition += chance.normals(hidden, hidden) * step;
    out[1].1.emission += chance.normals(3 * markers, hidden) * step;
    out[2].1.state_noise += symmetric(chance) * step;
    for noise in &mut out[3].1.marker_noise {
        *noise *= (chance.normal() * step).exp();
    }
    out[4].1.initial_mean += chance.normal_vector(hidden) * step;
    out[5].1.initial_covariance += symmetric(chance) * step;
    out[6].1.offset += chance.normal_vector(3 * markers) * step;
    out
}

/// Hidden dimensions, markers, frames, share that is missing.
const CASES: [(usize, usize, usize, f64); 7] =
    [(1, 1, 6, 0.0), (2, 2, 9, 0.0), (3, 2, 12, 0.0), (1, 2, 7, 0.3), (2, 3, 10, 0.3), (3, 2, 15, 0.5), (4, 3, 20, 0.2)];

#[test]
fn no_small_change_of_a_parameter_beats_the_m_step() {
    let mut tried = 0;
    for (seed, (hidden, markers, frames, missing)) in (1..).zip(CASES) {
        let mut chance = Chance::new(seed);
        let before = chance.model(hidden, markers);
        let moments = Moments::new(&before, &table(&mut chance, markers, frames, missing));
        let mut found = before.clone();
        maximise(&mut found, &moments.smoothed, &moments.of, Noise::Diagonal, true).unwrap();
        let best = moments.expected(&found);
        assert!(best > moments.expected(&before), "case {seed}: the M-step gains nothing");
        for _ in 0..60 {
            for step in [1e-1, 1e-2, 1e-3] {
                for (parameter, other) in moved(&found, &mut chance, step) {
                    let value = moments.expected(&other);
                    assert!(value < best, "case {seed}: another {parameter}, {step} away, has {value}, the M-step {best}");
                    tried += 1;
                }
            }
        }
    }
    assert_eq!(tried, CASES.len() * 60 * 3 * 7);
}

#[test]
fn what_the_m_step_climbs_has_the_slope_of_the_likelihood() {
    for (seed, (hidden, markers, frames, missing)) in (1..).zip(CASES) {
        let mut chance = Chance::new(100 + seed);
        let model = chance.model(hidden, markers);
        let table = table(&mut chance, markers, frames, missing);
        let moments = Moments::new(&model, &table);
        let likelihood = |model: &Model| {
            let (at, values) = seen(model, &table);
            Gaussian::system(model, frames).given(&at, &values).1
        };
        let step = 1e-5;
        // the same directions, there and back
        let there = moved(&model, &mut Chance::new(seed), step);
        let back = moved(&model, &mut Chance::new(seed), -step);
        for ((parameter, there), (_, back)) in there.iter().zip(&back) {
            let slope = |f: &dyn Fn(&Model) -> f64| (f(there) - f(back)) / (2.0 * step);
            near(&format!("case {seed}, {parameter}"), slope(&|m| moments.expected(m)), slope(&likelihood), 1e-6);
        }
    }
}

#[test]
fn a_single_frame_leaves_the_dynamics_alone() {
    let mut chance = Chance::new(1);
    let before = chance.model(2, 2);
    let moments = Moments::new(&before, &table(&mut chance, 2, 1, 0.0));
    let mut found = before.clone();
    maximise(&mut found, &moments.smoothed, &moments.of, Noise::Diagonal, true).unwrap();
    assert_eq!((found.transition, found.state_noise), (before.transition, before.state_noise));
    assert_eq!(found.initial_mean, moments.smoothed.means.column(0));
}
