//! The parameters of the linear dynamical system, and where EM starts from.
//!
//! Letters as in `docs/algorithm.md`: transition `F` (H × H), emission `G` (m × H), state noise `Λ` (H × H), observation noise `Σ`
//! (diagonal, one variance per marker), initial mean `μ₀` (H) and covariance `Γ` (H × H).
//! m = 3 × markers; lengths are metres in body-local coordinates, centred on each column's mean.

use nalgebra::{DMatrix, DVector};

/// Parameters Θ of Eq. 1-4.
#[derive(Clone, Debug)]
pub struct Model {
    /// F, H × H.
    pub transition: DMatrix<f64>,
    /// G, m × H.
    pub emission: DMatrix<f64>,
    /// Λ, H × H.
    pub state_noise: DMatrix<f64>,
    /// The diagonal of Σ, one variance per marker, shared by its three coordinates, in m².
    pub marker_noise: Vec<f64>,
    /// μ₀, H.
    pub initial_mean: DVector<f64>,
    /// Γ, H × H.
    pub initial_covariance: DMatrix<f64>,
}

/// No marker is known better than this (0.05 mm)², in m²: keeps Σ invertible where a model explains a still marker perfectly.
pub const LEAST_MARKER_NOISE: f64 = 2.5e-9;

impl Model {
    /// H.
    pub fn hidden(&self) -> usize {
        self.transition.nrows()
    }

    /// Principal components as the start: G from the components of `whole` (m × any number of frames without holes),
    /// hidden states from projecting the *observed* entries of each frame of `table` (m × T), F and Λ from regressing each state on the one before.
    /// `seen(frame, marker)` says which entries count. Returns the model and the states (H × T).
    pub fn from_components(
        whole: &DMatrix<f64>,
        table: &DMatrix<f64>,
        seen: &dyn Fn(usize, usize) -> bool,
        hidden: usize,
    ) -> (Self, DMatrix<f64>) {
        let (m, frames) = table.shape();
        let markers = m / 3;
        let mut emission = components(whole, hidden);
        let mut states = DMatrix::zeros(hidden, frames);
        for t in 0..frames {
            // ridge against frames that show next to nothing
            let mut normal = DMatrix::identity(hidden, hidden) * 1e-4;
            let mut right = DVector::zeros(hidden);
            for i in (0..markers).filter(|&i| seen(t, i)) {
                let g = emission.rows(3 * i, 3);
                normal.gemm_tr(1.0, &g, &g, 1.0);
                right.gemv_tr(1.0, &g, &table.view((3 * i, t), (3, 1)).column(0), 1.0);
            }
            if let Some(c) = normal.cholesky() {
                states.set_column(t, &c.solve(&right));
            }
        }
        // unit variance per state: the scale of the hidden space is free, and this one conditions well
        for h in 0..hidden {
            let scale = (states.row(h).norm_squared() / frames as f64).sqrt().max(1e-6);
            states.row_mut(h).scale_mut(1.0 / scale);
            emission.column_mut(h).scale_mut(scale);
        }
        let identity = DMatrix::<f64>::identity(hidden, hidden);
        let steps = frames.saturating_sub(1);
        let (transition, state_noise) = if steps == 0 {
            (identity.clone(), identity.clone())
        } else {
            let (past, next) = (states.columns(0, steps), states.columns(1, steps));
            let normal = past.clone_owned() * past.transpose() + &identity * (1e-6 * frames as f64);
            let cross = next * past.transpose();
            let transition = normal.cholesky().map_or_else(|| identity.clone(), |c| c.solve(&cross.transpose()).transpose());
            let rest = next - &transition * past;
            let noise = &rest * rest.transpose() / steps as f64 + &identity * 1e-6;
            (transition, noise)
        };
        let mut marker_noise = vec![0.0; markers];
        let explained = &emission * &states;
        for (i, noise) in marker_noise.iter_mut().enumerate() {
            let (mut sum, mut count) = (0.0, 0usize);
            for t in (0..frames).filter(|&t| seen(t, i)) {
                sum += (table.view((3 * i, t), (3, 1)) - explained.view((3 * i, t), (3, 1))).norm_squared();
                count += 3;
            }
            *noise = (sum / count.max(1) as f64).max(1e-7);
        }
        let spread = &states * states.transpose() / frames.max(1) as f64;
        let model = Self {
            initial_mean: states.column(0).into_owned(),
            initial_covariance: spread + identity * 1e-3,
            transition,
            emission,
            state_noise,
            marker_noise,
        };
        (model, states)
    }
}

/// The first `count` principal directions of the columns of `table` (m × T), orthonormal, m × count.
/// Subspace iteration from a fixed start with a final Rayleigh-Ritz rotation; EM refines the result, so a few rounds do.
fn components(table: &DMatrix<f64>, count: usize) -> DMatrix<f64> {
    let m = table.nrows();
    let wide = (count + 8).min(m);
    // a fixed, well spread start: same bytes on every machine
    let mut basis =
        DMatrix::from_fn(m, wide, |r, c| (((r * 7919 + c * 104_729 + 13) % 1009) as f64 / 1009.0 - 0.5) + if r == c { 1.0 } else { 0.0 });
    for _ in 0..12 {
        basis = basis.qr().q();
        let seen = table.tr_mul(&basis);
        basis = table * seen;
    }
    let basis = basis.qr().q();
    let seen = table.tr_mul(&basis);
    let eigen = seen.tr_mul(&seen).symmetric_eigen();
    let mut order: Vec<usize> = (0..wide).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]).then(a.cmp(&b)));
    let rotation = DMatrix::from_columns(&order.iter().take(count).map(|&k| eigen.eigenvectors.column(k)).collect::<Vec<_>>());
    basis * rotation
}
