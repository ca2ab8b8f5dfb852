//! The moments of the hidden states given everything (Eq. 14-30), as one block tridiagonal system that is solved from both ends at once.
//!
//! What a frame says about its hidden state arrives as [`Evidence`]: the matrix `L`, the vector `b` and the constant `c` of
//! `log p(evidence | z) = -½ (zᵀ L z - 2 bᵀ z + c)`. Observed markers, missing markers and bones all take this form, so the pass knows nothing of them.
//!
//! The joint density of all states and the evidence is then a quadratic form with the blocks
//! `D₁ = Γ⁻¹ + FᵀΛ⁻¹F + L₁`, `Dₜ = Λ⁻¹ + FᵀΛ⁻¹F + Lₜ`, `D_T = Λ⁻¹ + L_T` on its diagonal and `E = -Λ⁻¹F` below it.
//! Eliminating frames in order, `Sₜ₊₁ = Dₜ₊₁ - E Sₜ⁻¹ Eᵀ`, is the forward pass (Sₜ⁻¹ is what the filter would know if it also had the next state's evidence about this one),
//! and `V̂ₜ = Sₜ⁻¹ + Jₜ V̂ₜ₊₁ Jₜᵀ` with `Jₜ = -Sₜ⁻¹ Eᵀ` the backward pass: the J of Eq. 25, in fewer operations than Eq. 15-27.
//! The elimination may as well run backwards from the last frame. So one half of the frames is eliminated forwards and the other half backwards,
//! at the same time; they meet in the middle frame, and the way back also runs on two cores. The result does not depend on their number.
//!
//! Where consecutive frames say the same (everything seen, or the same markers missing), `S` and `V̂` converge within some tens of frames.
//! From there on one matrix serves all: a *run* costs a matrix-vector product per frame and one matrix product in all.

use super::model::Model;
use crate::solve::SolveError;
use crate::solve::kernel::{dot, invert, product, subtract_product};
use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut, DVector, DVectorView};

/// What the frames say about their hidden states.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// The distinct L, H × H.
    pub matrices: Vec<DMatrix<f64>>,
    /// For each frame, which of them is its own.
    pub of: Vec<u32>,
    /// b of each frame as a column, H × T.
    pub vectors: DMatrix<f64>,
    /// Σ c over all frames.
    pub constant: f64,
}

/// Moments of the hidden states given everything.
#[derive(Clone, Debug)]
pub struct Smoothed {
    /// E[zₜ] as columns, H × T (Eq. 28).
    pub means: DMatrix<f64>,
    /// The distinct Cov[zₜ], H × H.
    pool: Vec<DMatrix<f64>>,
    /// For each frame, which of them is its own.
    slot: Vec<u32>,
    /// Σₜ Cov[zₜ] over all frames, H × H (Eq. 27).
    pub covariance: DMatrix<f64>,
    /// Σₜ Cov[zₜ, zₜ₋₁] over t = 2 .. T, H × H (Eq. 29 without its mean part).
    pub lagged: DMatrix<f64>,
    /// log p(evidence) in nats.
    pub log_likelihood: f64,
}

impl Smoothed {
    /// Cov[zₜ] of one frame, H × H (Eq. 27).
    pub fn covariance_of(&self, frame: usize) -> &DMatrix<f64> {
        &self.pool[self.slot[frame] as usize]
    }

    /// Number of distinct covariances: frames in which nothing was shared, and one for each run.
    pub fn distinct(&self) -> usize {
        self.pool.len()
    }
}

/// Two consecutive matrices count as converged when no entry differs by more than this share of its scale, the root of the product of its two variances.
/// The convergence is geometric, so what is still to come is of the same order: a part in 10⁸ of a standard deviation at most,
/// and in the eleventh digit of the likelihood. Every digit more costs some ten frames of full work at each edge of a gap.
const STEADY: f64 = 1e-9;

/// The chain as blocks.
struct Chain<'a> {
    /// Γ⁻¹, Λ⁻¹, FᵀΛ⁻¹F, each H × H.
    first: DMatrix<f64>,
    own: DMatrix<f64>,
    ahead: DMatrix<f64>,
    /// E and Eᵀ.
    coupling: DMatrix<f64>,
    transposed: DMatrix<f64>,
    matrices: &'a [DMatrix<f64>],
    of: &'a [u32],
    steady: f64,
}

impl Chain<'_> {
    fn frames(&self) -> usize {
        self.of.len()
    }

    /// The diagonal block of a frame.
    fn block(&self, frame: usize, into: &mut DMatrix<f64>) {
        into.copy_from(if frame == 0 { &self.first } else { &self.own });
        if frame + 1 < self.frames() {
            *into += &self.ahead;
        }
        *into += &self.matrices[self.of[frame] as usize];
    }
}

/// One half of the chain, in the order in which its frames are eliminated.
#[derive(Clone, Copy)]
struct Half {
    /// Frames are eliminated upwards from 0, or downwards from the last.
    forward: bool,
    /// Number of frames of this half.
    frames: usize,
    /// Number of frames of the chain.
    of: usize,
}

impl Half {
    /// The frame that is eliminated as the `step`th.
    fn frame(&self, step: usize) -> usize {
        if self.forward { step } else { self.of - 1 - step }
    }

    /// Its column in the part of a table that belongs to this half.
    fn column(&self, step: usize) -> usize {
        if self.forward { step } else { self.frames - 1 - step }
    }

    /// The columns of the steps `from..to`, as first column and number of columns.
    fn columns(&self, from: usize, to: usize) -> (usize, usize) {
        (if self.forward { from } else { self.frames - to }, to - from)
    }
}

/// A half after elimination.
struct Eliminated {
    /// The distinct S⁻¹.
    pool: Vec<DMatrix<f64>>,
    /// For each step, which of them.
    slot: Vec<u32>,
    /// Σ log |S|.
    log_determinant: f64,
    /// Σ yᵀ S⁻¹ y.
    square: f64,
    /// E S⁻¹ Eᵀ and -E S⁻¹ y of the last step: what it says about the middle frame.
    said: DMatrix<f64>,
    said_vector: DVector<f64>,
}

/// Eliminates the frames of a half. `vectors` (H × its frames) holds b; `means` receives S⁻¹ y.
fn eliminate(chain: &Chain<'_>, half: Half, vectors: &mut [f64], means: &mut [f64]) -> Result<Eliminated, usize> {
    let hidden = chain.own.nrows();
    let coupling = if half.forward { &chain.coupling } else { &chain.transposed }; // from this step to the next
    let back = if half.forward { &chain.transposed } else { &chain.coupling };
    let mut out = Eliminated {
        pool: Vec::new(),
        slot: Vec::with_capacity(half.frames),
        log_determinant: 0.0,
        square: 0.0,
        said: DMatrix::zeros(hidden, hidden),
        said_vector: DVector::zeros(hidden),
    };
    let mut present = DMatrix::zeros(hidden, hidden); // S
    let mut previous = DMatrix::zeros(hidden, hidden);
    let mut work = DMatrix::zeros(hidden, hidden);
    let mut last_log_determinant = 0.0;
    let mut y = DVector::zeros(hidden);
    let same = |a: usize, b: usize| chain.of[half.frame(a)] == chain.of[half.frame(b)];
    let mut step = 0;
    while step < half.frames {
        chain.block(half.frame(step), &mut present);
        present -= &out.said;
        // the outermost frame's block is another one
        if step >= 2 && same(step, step - 1) && close(&present, &previous, chain.steady) {
            let mut end = step + 1;
            while end < half.frames && same(end, step) {
                end += 1;
            }
            let slot = out.slot[step - 1];
            let inverse = &out.pool[slot as usize];
            coupling.mul_to(inverse, &mut work);
            for k in step..end {
                // y ← b - E S⁻¹ y of the step before
                let (now, before) = (half.column(k) * hidden, half.column(k - 1) * hidden);
                y.copy_from(&DVectorView::from_slice(&vectors[before..before + hidden], hidden));
                subtract_product(&work, y.as_slice(), &mut vectors[now..now + hidden]);
            }
            let (first, count) = half.columns(step, end);
            let range = first * hidden..(first + count) * hidden;
            let run = DMatrixView::from_slice(&vectors[range.clone()], hidden, count);
            DMatrixViewMut::from_slice(&mut means[range.clone()], hidden, count).gemm(1.0, inverse, &run, 0.0);
            out.square += dot(&vectors[range.clone()], &means[range]);
            out.log_determinant += count as f64 * last_log_determinant;
            out.slot.resize(end, slot);
            let last = half.column(end - 1) * hidden;
            out.said_vector.gemv(-1.0, coupling, &DVectorView::from_slice(&means[last..last + hidden], hidden), 0.0);
            step = end;
            continue;
        }
        let mut inverse = DMatrix::zeros(hidden, hidden);
        last_log_determinant = invert(&present, &mut work, &mut inverse).ok_or_else(|| half.frame(step))?;
        out.log_determinant += last_log_determinant;
        let at = half.column(step) * hidden;
        let (b, mean) = (&mut vectors[at..at + hidden], &mut means[at..at + hidden]);
        for (b, said) in b.iter_mut().zip(&out.said_vector) {
            *b += said;
        }
        product(&inverse, b, mean);
        out.square += dot(b, mean);
        coupling.mul_to(&inverse, &mut work);
        out.said.gemm(1.0, &work, back, 0.0);
        out.said_vector.fill(0.0);
        subtract_product(coupling, mean, out.said_vector.as_mut_slice());
        out.slot.push(out.pool.len() as u32);
        out.pool.push(inverse);
        std::mem::swap(&mut present, &mut previous);
        step += 1;
    }
    Ok(out)
}

/// A half after substitution.
struct Substituted {
    /// The distinct V̂.
    pool: Vec<DMatrix<f64>>,
    /// For each step, which of them.
    slot: Vec<u32>,
    /// Σ V̂.
    covariance: DMatrix<f64>,
    /// Σ Cov[z of a step, z of the next].
    lagged: DMatrix<f64>,
}

/// Goes back from the middle frame, whose moments are given. `means` holds S⁻¹ y and receives E[z].
fn substitute(
    chain: &Chain<'_>,
    half: Half,
    done: Eliminated,
    means: &mut [f64],
    middle_mean: &DVector<f64>,
    middle: &DMatrix<f64>,
) -> Substituted {
    let hidden = chain.own.nrows();
    let back = if half.forward { &chain.transposed } else { &chain.coupling };
    let Eliminated { mut pool, slot, .. } = done;
    let mut out = Substituted {
        pool: Vec::new(),
        slot: slot.clone(),
        covariance: DMatrix::zeros(hidden, hidden),
        lagged: DMatrix::zeros(hidden, hidden),
    };
    let mut next = middle.clone(); // V̂ of the step after
    let mut next_mean = middle_mean.clone();
    let mut gain = DMatrix::zeros(hidden, hidden); // -J
    let mut turned = DMatrix::zeros(hidden, hidden);
    let mut carried = DMatrix::zeros(hidden, hidden);
    let mut covariance = DMatrix::zeros(hidden, hidden);
    let mut step = half.frames;
    while step > 0 {
        // all steps of one S together
        let own = slot[step - 1];
        let mut first = step - 1;
        while first > 0 && slot[first - 1] == own {
            first -= 1;
        }
        pool[own as usize].mul_to(back, &mut gain);
        gain.transpose_to(&mut turned);
        for k in (first..step).rev() {
            let at = half.column(k) * hidden;
            subtract_product(&gain, next_mean.as_slice(), &mut means[at..at + hidden]);
            next_mean.as_mut_slice().copy_from_slice(&means[at..at + hidden]);
        }
        let mut k = step;
        let mut steady = false;
        while k > first {
            k -= 1;
            gain.mul_to(&next, &mut carried);
            covariance.copy_from(&pool[own as usize]);
            covariance.gemm(1.0, &carried, &turned, 1.0);
            steady = k + 1 < step && close(&covariance, &next, chain.steady);
            out.covariance += &covariance;
            out.lagged -= &carried;
            std::mem::swap(&mut covariance, &mut next);
            if steady {
                break;
            }
            if step - first > 1 {
                out.slot[k] = pool.len() as u32;
                pool.push(next.clone());
            }
        }
        if steady {
            // `next` and `carried` hold for this step and the rest of the run
            let shared = out.slot[k + 1];
            out.slot[first..=k].fill(shared);
            let rest = (k - first) as f64;
            out.covariance += &next * rest;
            out.lagged -= &carried * rest;
        }
        if step - first == 1 {
            pool[own as usize].copy_from(&next); // nobody else needs this S⁻¹
        }
        step = first;
    }
    out.pool = pool;
    out
}

/// Solves the system.
///
/// # Errors
/// A covariance of the model, or one on the way, is not positive definite.
pub fn smooth(model: &Model, evidence: Evidence) -> Result<Smoothed, SolveError> {
    smooth_within(model, evidence, STEADY)
}

/// [`smooth`] with another idea of when matrices have converged; a negative one never shares any.
///
/// # Errors
/// As [`smooth`].
pub fn smooth_within(model: &Model, evidence: Evidence, steady: f64) -> Result<Smoothed, SolveError> {
    let Evidence { matrices, of, mut vectors, constant } = evidence;
    let (hidden, frames) = vectors.shape();
    let broken = |what: String| SolveError::Numerical(format!("{what} is not positive definite"));
    let mut work = DMatrix::zeros(hidden, hidden);
    let mut first = DMatrix::zeros(hidden, hidden);
    let mut own = DMatrix::zeros(hidden, hidden);
    let log_first =
        invert(&model.initial_covariance, &mut work, &mut first).ok_or_else(|| broken("the covariance of the first state".into()))?;
    let log_own = invert(&model.state_noise, &mut work, &mut own).ok_or_else(|| broken("the noise of the states".into()))?;
    let coupling = -&own * &model.transition;
    let ahead = -model.transition.tr_mul(&coupling);
    let transposed = coupling.transpose();
    let start = &first * &model.initial_mean;
    let mut log_likelihood = constant + log_first + frames.saturating_sub(1) as f64 * log_own + start.dot(&model.initial_mean);
    if frames > 0 {
        let mut column = vectors.column_mut(0);
        column += &start;
    }
    let mut means = DMatrix::zeros(hidden, frames);
    let chain = Chain { first, own, ahead, coupling, transposed, matrices: &matrices, of: &of, steady };
    if frames == 0 {
        return Ok(Smoothed {
            means,
            pool: Vec::new(),
            slot: Vec::new(),
            covariance: DMatrix::zeros(hidden, hidden),
            lagged: DMatrix::zeros(hidden, hidden),
            log_likelihood: 0.0,
        });
    }
    let middle = frames / 2;
    let left = Half { forward: true, frames: middle, of: frames };
    let right = Half { forward: false, frames: frames - middle - 1, of: frames };
    let (left_vectors, rest) = vectors.as_mut_slice().split_at_mut(middle * hidden);
    let (middle_vector, right_vectors) = rest.split_at_mut(hidden);
    let (left_means, rest) = means.as_mut_slice().split_at_mut(middle * hidden);
    let (middle_mean, right_means) = rest.split_at_mut(hidden);
    let (from_left, from_right) =
        rayon::join(|| eliminate(&chain, left, left_vectors, left_means), || eliminate(&chain, right, right_vectors, right_means));
    let at_frame = |frame: usize| broken(format!("the covariance of frame {frame}"));
    let (from_left, from_right) = (from_left.map_err(at_frame)?, from_right.map_err(at_frame)?);

    let mut present = DMatrix::zeros(hidden, hidden);
    chain.block(middle, &mut present);
    present -= &from_left.said;
    present -= &from_right.said;
    let mut covariance = DMatrix::zeros(hidden, hidden);
    log_likelihood += invert(&present, &mut work, &mut covariance).ok_or_else(|| at_frame(middle))?;
    log_likelihood += from_left.log_determinant + from_right.log_determinant - from_left.square - from_right.square;
    for (k, b) in middle_vector.iter_mut().enumerate() {
        *b += from_left.said_vector[k] + from_right.said_vector[k];
    }
    product(&covariance, middle_vector, middle_mean);
    log_likelihood -= dot(middle_vector, middle_mean);
    log_likelihood *= -0.5;
    let mean = DVector::from_column_slice(middle_mean);

    let (before, after) = rayon::join(
        || substitute(&chain, left, from_left, left_means, &mean, &covariance),
        || substitute(&chain, right, from_right, right_means, &mean, &covariance),
    );
    if !log_likelihood.is_finite() {
        return Err(SolveError::Numerical("the log-likelihood is not finite".into()));
    }
    let Substituted { mut pool, mut slot, covariance: mut sum, lagged } = before;
    sum += &covariance;
    sum += &after.covariance;
    slot.push(pool.len() as u32);
    pool.push(covariance);
    let shift = pool.len() as u32;
    slot.extend(after.slot.iter().rev().map(|s| s + shift));
    pool.extend(after.pool);
    Ok(Smoothed { means, pool, slot, covariance: sum, lagged: lagged.transpose() + after.lagged, log_likelihood })
}

/// True if no entry of two covariances (or their inverses) differs by more than `share` of its scale.
fn close(a: &DMatrix<f64>, b: &DMatrix<f64>, share: f64) -> bool {
    if share < 0.0 {
        return false;
    }
    let n = a.nrows();
    let (values, others) = (a.as_slice(), b.as_slice());
    (0..n).all(|c| {
        let scale = share * share * values[c * n + c];
        (0..=c).all(|r| {
            let off = values[c * n + r] - others[c * n + r];
            off * off <= scale * values[r * n + r]
        })
    })
}
