//! Bones as evidence (the penalty of Eq. 8), frame by frame.
//!
//! The penalty `λ/2 (‖xᵢ - xⱼ‖² - d²)²` is, close to the right length, the negative log-density of a Gaussian observation of the length
//! with standard deviation `1 / (2 d √λ)`. Linearised at the present positions (Gauss-Newton) it is a linear observation `J x = r + unit noise` of the missing markers `x` of a frame.
//! Given the hidden state, `x = G z + ε` with covariance Σ, so the bones tell the state
//! `J G z = r` with covariance `S = J Σ Jᵀ + 1`, and the markers, given the state,
//! `x = A z + k` with `K = Σ Jᵀ S⁻¹`, `A = G - K J G`, `k = K r` and covariance `Σ - K J Σ`.
//! The first goes into the forward-backward pass, the second into the M-step and the estimate:
//! neighbouring frames are coupled through the dynamics, and nothing jumps.
//!
//! A step that trusts the linearisation too far can swing to and fro between two wrong places for ever. So each frame has a *damping* μ
//! (Levenberg-Marquardt): while it is above 0, `½ μ ‖x - x₀‖²` holds the markers near the place x₀ of the linearisation.
//! It rises when the bones got no better although the linearisation said so, falls otherwise, and leaves the solution where it is.
//!
//! Missing markers that no chain of bones between missing markers connects are independent: each group is its own small system.

use super::model::Model;
use nalgebra::{DMatrix, DVector};

/// A bone in the solver's own terms.
#[derive(Clone, Copy, Debug)]
pub struct LocalBone {
    /// One end, as a column of the problem.
    pub a: usize,
    /// The other end.
    pub b: usize,
    /// d², m².
    pub squared_length: f64,
    /// √λ, 1/m².
    pub weight: f64,
}

/// The missing markers of a frame that bones connect, and the bones at them.
#[derive(Clone, Debug, Default)]
pub struct Group {
    /// Columns of the problem, ascending.
    pub markers: Vec<usize>,
    /// Indices into the list of bones, ascending.
    pub bones: Vec<usize>,
}

impl Group {
    /// True if a bone of the group reaches a marker that was seen.
    ///
    /// Otherwise its bones tie missing markers to missing markers only, around a place that nobody saw;
    /// in black-outs that outvoted the dynamics which carry the body through. Such groups say nothing.
    pub fn held(&self, bones: &[LocalBone]) -> bool {
        self.bones.iter().any(|&k| self.markers.binary_search(&bones[k].a).is_err() || self.markers.binary_search(&bones[k].b).is_err())
    }
}

/// For every marker, the bones at it.
pub fn incidence(bones: &[LocalBone], markers: usize) -> Vec<Vec<usize>> {
    let mut at = vec![Vec::new(); markers];
    for (k, bone) in bones.iter().enumerate() {
        at[bone.a].push(k);
        at[bone.b].push(k);
    }
    at
}

/// Splits the `missing` markers of a frame (ascending) into groups that share no bone. Markers without any bone are in no group.
pub fn groups(missing: &[usize], bones: &[LocalBone], incidence: &[Vec<usize>]) -> Vec<Group> {
    let mut group_of: Vec<Option<usize>> = vec![None; missing.len()];
    let mut found: Vec<Group> = Vec::new();
    let mut open = Vec::new();
    for start in 0..missing.len() {
        if group_of[start].is_some() || incidence[missing[start]].is_empty() {
            continue;
        }
        let mut group = Group::default();
        open.push(start);
        group_of[start] = Some(found.len());
        while let Some(at) = open.pop() {
            let marker = missing[at];
            group.markers.push(marker);
            for &k in &incidence[marker] {
                group.bones.push(k);
                let other = if bones[k].a == marker { bones[k].b } else { bones[k].a };
                if let Ok(next) = missing.binary_search(&other)
                    && group_of[next].is_none()
                {
                    group_of[next] = Some(found.len());
                    open.push(next);
                }
            }
        }
        group.markers.sort_unstable();
        group.bones.sort_unstable();
        group.bones.dedup();
        found.push(group);
    }
    found
}

/// The bones of a group, linearised at a frame's positions: `J x = r + unit noise` for its missing markers `x`.
#[derive(Clone, Debug)]
pub struct Linearised {
    /// J, bones × 3 · markers.
    pub jacobian: DMatrix<f64>,
    /// r, bones.
    pub right: DVector<f64>,
    /// -Σ ln(2 d √λ): turns the density of the scaled rows into that of lengths in m.
    pub log_scale: f64,
}

/// Linearises the bones of `group` at `positions` (m, centred positions of one frame) plus `centre` (m).
///
/// What is linearised is the length, `2 d √λ (‖xᵢ - xⱼ‖ - d)`, not its square: both agree to first order where the bone has its length,
/// but away from there the square overshoots (from half the length to one and a quarter), and rounds of EM then swing to and fro.
pub fn linearise(group: &Group, bones: &[LocalBone], positions: &[f64], centre: &[f64]) -> Linearised {
    let stiffness = |bone: &LocalBone| 2.0 * bone.squared_length.sqrt() * bone.weight; // 1 / standard deviation of the length
    let (jacobian, right) = tangents(group, bones, positions, centre, &|bone, squared| {
        let length = squared.sqrt();
        if length < 1e-6 {
            return (0.0, 0.0); // two markers in one place have no direction; this round the bone says nothing
        }
        ((length - bone.squared_length.sqrt()) * stiffness(bone), stiffness(bone) / length)
    });
    let log_scale = -group.bones.iter().map(|&k| stiffness(&bones[k]).ln()).sum::<f64>();
    Linearised { jacobian, right, log_scale }
}

/// `J x = r` for the missing markers of `group`, where each bone's row is the tangent at `positions` of what `row` says:
/// given the bone and its squared length there, its residual, and the slope of that along `xᵢ - xⱼ` when `xᵢ` moves.
fn tangents(
    group: &Group,
    bones: &[LocalBone],
    positions: &[f64],
    centre: &[f64],
    row: &dyn Fn(&LocalBone, f64) -> (f64, f64),
) -> (DMatrix<f64>, DVector<f64>) {
    let at = |marker: usize, axis: usize| positions[3 * marker + axis] + centre[3 * marker + axis];
    let mut jacobian = DMatrix::zeros(group.bones.len(), 3 * group.markers.len());
    let mut right = DVector::zeros(group.bones.len());
    for (k, bone) in group.bones.iter().map(|&k| &bones[k]).enumerate() {
        let along: [f64; 3] = std::array::from_fn(|axis| at(bone.a, axis) - at(bone.b, axis));
        let (residual, slope) = row(bone, along.iter().map(|x| x * x).sum());
        right[k] = -residual;
        for (marker, sign) in [(bone.a, 1.0), (bone.b, -1.0)] {
            if let Ok(slot) = group.markers.binary_search(&marker) {
                for (axis, step) in along.iter().enumerate() {
                    let slope = sign * slope * step;
                    jacobian[(k, 3 * slot + axis)] = slope;
                    right[k] += slope * positions[3 * marker + axis];
                }
            }
        }
    }
    (jacobian, right)
}

/// What the bones of a group say, once the markers are integrated out.
#[derive(Clone, Debug)]
pub struct BoneEvidence {
    /// What they add to L, H × H.
    pub matrix: DMatrix<f64>,
    /// What they add to b, H.
    pub vector: DVector<f64>,
    /// What they add to c.
    pub constant: f64,
    /// Whom it is about.
    pub group: Group,
    /// The linearised bones.
    pub system: Linearised,
    /// A, 3 · markers × H.
    pub gain: DMatrix<f64>,
    /// k, 3 · markers.
    pub offset: DVector<f64>,
    /// Trace of the 3 × 3 block of Σ - K J Σ of each marker, m².
    pub rest: Vec<f64>,
}

impl BoneEvidence {
    /// What the linearised bones cost at `positions` (one frame, centred, m): ½ ‖J x - r‖².
    pub fn linear_cost(&self, positions: &[f64]) -> f64 {
        let x = DVector::from_iterator(
            3 * self.group.markers.len(),
            self.group.markers.iter().flat_map(|&i| positions[3 * i..3 * i + 3].iter().copied()),
        );
        0.5 * (&self.system.jacobian * x - &self.system.right).norm_squared()
    }
}

/// What the bones of a group cost at `positions`: `½ Σ (2 d √λ (‖xᵢ - xⱼ‖ - d))²`.
pub fn cost(group: &Group, bones: &[LocalBone], positions: &[f64], centre: &[f64]) -> f64 {
    let off = |bone: &LocalBone| {
        let length = (0..3)
            .map(|axis| {
                (positions[3 * bone.a + axis] + centre[3 * bone.a + axis] - positions[3 * bone.b + axis] - centre[3 * bone.b + axis])
                    .powi(2)
            })
            .sum::<f64>()
            .sqrt();
        2.0 * bone.squared_length.sqrt() * bone.weight * (length - bone.squared_length.sqrt())
    };
    group.bones.iter().map(|&k| 0.5 * off(&bones[k]).powi(2)).sum()
}

/// Integrates the missing markers of `group` out of its linearised bones. `damping` is μ in 1/m², `anchor` (3 · markers) is x₀, centred, m.
/// `None` if S cannot be factorised, which takes positions that are not finite.
pub fn integrate(group: &Group, system: Linearised, model: &Model, damping: f64, anchor: &[f64]) -> Option<BoneEvidence> {
    let unknowns = 3 * group.markers.len();
    let (rows, hidden) = (group.bones.len(), model.hidden());
    let free = |k: usize| model.marker_noise[group.markers[k / 3]];
    // with damping the marker's own distribution is N(G z, r) times N(x₀, 1/μ): a smaller variance, a mean between the two,
    // and the overlap of both, which speaks about z
    let noise = |k: usize| 1.0 / (1.0 / free(k) + damping);
    let own = DMatrix::from_fn(unknowns, hidden, |r, c| model.emission[(3 * group.markers[r / 3] + r % 3, c)]);
    let mut emission = own.clone();
    let mut lead = DVector::zeros(unknowns);
    let mut matrix = DMatrix::zeros(hidden, hidden);
    let mut vector = DVector::zeros(hidden);
    let mut constant = 0.0;
    if damping > 0.0 {
        let mut pulled = own.clone();
        let mut towards = DVector::zeros(unknowns);
        for k in 0..unknowns {
            let overlap = free(k) + 1.0 / damping;
            emission.row_mut(k).scale_mut(noise(k) / free(k));
            lead[k] = noise(k) * damping * anchor[k];
            pulled.row_mut(k).scale_mut(1.0 / overlap);
            towards[k] = anchor[k] / overlap;
            constant += anchor[k] * towards[k] + (1.0 + damping * free(k)).ln();
        }
        matrix.gemm_tr(1.0, &own, &pulled, 1.0);
        vector.gemv_tr(1.0, &own, &towards, 1.0);
    }
    let mut scaled = system.jacobian.transpose(); // Σ Jᵀ, 3k × bones
    for mut column in scaled.column_iter_mut() {
        for (k, value) in column.iter_mut().enumerate() {
            *value *= noise(k);
        }
    }
    let mut spread = DMatrix::identity(rows, rows); // S
    spread.gemm(1.0, &system.jacobian, &scaled, 1.0);
    let factor = spread.cholesky()?;
    let projected = &system.jacobian * &emission; // J G, bones × H
    let mut right = system.right.clone();
    right.gemv(-1.0, &system.jacobian, &lead, 1.0);
    let whitened = factor.solve(&projected); // S⁻¹ J G
    let pulled = factor.solve(&right); // S⁻¹ r
    let log_determinant = 2.0 * (0..rows).map(|k| factor.l_dirty()[(k, k)].ln()).sum::<f64>();
    constant += right.dot(&pulled) + log_determinant + rows as f64 * std::f64::consts::TAU.ln() + 2.0 * system.log_scale;
    matrix.gemm_tr(1.0, &projected, &whitened, 1.0);
    vector.gemv_tr(1.0, &projected, &pulled, 1.0);
    let mut gain = emission;
    gain.gemm(-1.0, &scaled, &whitened, 1.0);
    let mut offset = lead;
    offset.gemv(1.0, &scaled, &pulled, 1.0);
    let mut half = scaled.transpose(); // J Σ, then L⁻¹ J Σ
    factor.l_dirty().solve_lower_triangular_mut(&mut half);
    let rest =
        (0..group.markers.len()).map(|i| (3 * i..3 * i + 3).map(|k| (noise(k) - half.column(k).norm_squared()).max(0.0)).sum()).collect();
    let evidence = BoneEvidence { matrix, vector, constant, group: group.clone(), system, gain, offset, rest };
    evidence.constant.is_finite().then_some(evidence)
}

/// The bone step of the imputing EM (the G-step of Algorithm 2): minimises
/// `f(x) = ½ (x - x⁻)ᵀ Σ⁻¹ (x - x⁻) + Σ λ/2 (‖xᵢ - xⱼ‖² - d²)²` (Eq. 11) over the missing markers of `group`,
/// by Gauss-Newton with step halving. `positions` (one frame, centred, m) holds the start and receives the result;
/// `expected` is x⁻ = G E[z] (the whole frame).
pub fn settle(group: &Group, bones: &[LocalBone], positions: &mut [f64], centre: &[f64], expected: &[f64], marker_noise: &[f64]) {
    let mut value = penalty(group, bones, positions, centre, expected, marker_noise);
    for _ in 0..20 {
        // here the squares themselves: steps towards the least of something else would not end at the least of f
        let (jacobian, right) =
            tangents(group, bones, positions, centre, &|bone, squared| ((squared - bone.squared_length) * bone.weight, 2.0 * bone.weight));
        let unknowns = 3 * group.markers.len();
        let mut normal = jacobian.tr_mul(&jacobian);
        let mut right = jacobian.tr_mul(&right);
        for k in 0..unknowns {
            let (marker, axis) = (group.markers[k / 3], k % 3);
            normal[(k, k)] += 1.0 / marker_noise[marker];
            right[k] += expected[3 * marker + axis] / marker_noise[marker];
        }
        let Some(target) = normal.cholesky().map(|c| c.solve(&right)) else { return };
        let before: Vec<f64> = (0..unknowns).map(|k| positions[3 * group.markers[k / 3] + k % 3]).collect();
        let mut share = 1.0;
        let mut moved = 0.0f64;
        loop {
            for k in 0..unknowns {
                positions[3 * group.markers[k / 3] + k % 3] = before[k] + share * (target[k] - before[k]);
            }
            let now = penalty(group, bones, positions, centre, expected, marker_noise);
            if now <= value {
                moved = (0..unknowns).fold(0.0, |most: f64, k| most.max((share * (target[k] - before[k])).abs()));
                value = now;
                break;
            }
            share *= 0.5;
            if share < 1e-3 {
                for k in 0..unknowns {
                    positions[3 * group.markers[k / 3] + k % 3] = before[k];
                }
                break;
            }
        }
        if moved < 1e-6 {
            return;
        }
    }
}

/// f of Eq. 11 without its constant part.
pub fn penalty(group: &Group, bones: &[LocalBone], positions: &[f64], centre: &[f64], expected: &[f64], marker_noise: &[f64]) -> f64 {
    let mut sum = 0.0;
    for &marker in &group.markers {
        for axis in 0..3 {
            let away = positions[3 * marker + axis] - expected[3 * marker + axis];
            sum += 0.5 * away * away / marker_noise[marker];
        }
    }
    for bone in group.bones.iter().map(|&k| &bones[k]) {
        let squared: f64 = (0..3)
            .map(|axis| {
                let along =
                    positions[3 * bone.a + axis] + centre[3 * bone.a + axis] - positions[3 * bone.b + axis] - centre[3 * bone.b + axis];
                along * along
            })
            .sum();
        let off = bone.weight * (squared - bone.squared_length);
        sum += 0.5 * off * off;
    }
    sum
}
