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
use crate::solve::kernel::{add_square, axpy};
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
    /// One row of J and r per bone.
    pub rows: Vec<Row>,
    /// -Σ ln(2 d √λ): turns the density of the scaled rows into that of lengths in m.
    pub log_scale: f64,
}

/// A bone, linearised.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// The bone.
    pub bone: LocalBone,
    /// Places of its missing ends in the group's markers.
    pub slots: [Option<usize>; 2],
    /// Slope of its length, in units of its spread, when its first end moves; the second end's is the opposite. 1/m.
    pub slope: [f64; 3],
    /// r.
    pub right: f64,
}

impl Row {
    /// Its missing ends, with the sign of the slope.
    fn ends(self) -> impl Iterator<Item = (usize, f64)> {
        self.slots.into_iter().zip([1.0, -1.0]).filter_map(|(slot, sign)| Some((slot?, sign)))
    }
}

impl Linearised {
    /// J (bones × 3 · markers) and r written out.
    pub fn dense(&self, markers: usize) -> (DMatrix<f64>, DVector<f64>) {
        let mut jacobian = DMatrix::zeros(self.rows.len(), 3 * markers);
        for (r, row) in self.rows.iter().enumerate() {
            for (slot, sign) in row.ends() {
                for axis in 0..3 {
                    jacobian[(r, 3 * slot + axis)] = sign * row.slope[axis];
                }
            }
        }
        (jacobian, DVector::from_iterator(self.rows.len(), self.rows.iter().map(|row| row.right)))
    }
}

/// Linearises the bones of `group` at `positions` (m, one frame, relative to `centre`) plus `centre` (m).
///
/// What is linearised is the length, `2 d √λ (‖xᵢ - xⱼ‖ - d)`, not its square: both agree to first order where the bone has its length,
/// but away from there the square overshoots (from half the length to one and a quarter), and rounds of EM then swing to and fro.
pub fn linearise(group: &Group, bones: &[LocalBone], positions: &[f64], centre: &[f64]) -> Linearised {
    let at = |marker: usize, axis: usize| positions[3 * marker + axis] + centre[3 * marker + axis];
    let mut log_scale = 0.0;
    let mut rows = Vec::with_capacity(group.bones.len());
    for &bone in group.bones.iter().map(|&k| &bones[k]) {
        let wanted = bone.squared_length.sqrt();
        let stiffness = 2.0 * wanted * bone.weight; // 1 / standard deviation of the length
        log_scale -= stiffness.ln();
        let along: [f64; 3] = std::array::from_fn(|axis| at(bone.a, axis) - at(bone.b, axis));
        let length = along.iter().map(|x| x * x).sum::<f64>().sqrt();
        let slots = [bone.a, bone.b].map(|marker| group.markers.binary_search(&marker).ok());
        // two markers in one place have no direction; this round the bone says nothing
        let mut row = Row { bone, slots, slope: [0.0; 3], right: 0.0 };
        if length >= 1e-6 {
            row.slope = along.map(|x| x * stiffness / length);
            row.right = (wanted - length) * stiffness;
            for (slot, sign) in row.ends() {
                for (axis, slope) in row.slope.iter().enumerate() {
                    row.right += sign * slope * positions[3 * group.markers[slot] + axis];
                }
            }
        }
        rows.push(row);
    }
    Linearised { rows, log_scale }
}

/// `J x = r` for the missing markers of `group`, where each bone's row is the tangent at `positions` of what `row` says:
/// given the bone and its squared length there, its residual, and the slope of that along `xᵢ - xⱼ` when `xᵢ` moves.
pub(super) fn tangents(
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
    /// Aᵀ, H × 3 · markers.
    pub gain: DMatrix<f64>,
    /// k, 3 · markers.
    pub offset: Vec<f64>,
    /// Trace of the 3 × 3 block of Σ - K J Σ of each marker, m².
    pub rest: Vec<f64>,
}

impl BoneEvidence {
    /// What the linearised bones cost at `positions` (one frame, relative to `centre`, m): ½ ‖J x - r‖².
    pub fn linear_cost(&self, positions: &[f64]) -> f64 {
        let off = |row: &Row| {
            let moved = row.ends().map(|(slot, sign)| {
                let at = 3 * self.group.markers[slot];
                sign * (0..3).map(|axis| row.slope[axis] * positions[at + axis]).sum::<f64>()
            });
            moved.sum::<f64>() - row.right
        };
        self.system.rows.iter().map(|row| 0.5 * off(row).powi(2)).sum()
    }

    /// What the bones themselves cost at `positions` plus `centre`: `½ Σ (2 d √λ (‖xᵢ - xⱼ‖ - d))²`.
    pub fn cost(&self, positions: &[f64], centre: &[f64]) -> f64 {
        let at = |marker: usize, axis: usize| positions[3 * marker + axis] + centre[3 * marker + axis];
        let off = |bone: &LocalBone| {
            let length = (0..3).map(|axis| (at(bone.a, axis) - at(bone.b, axis)).powi(2)).sum::<f64>().sqrt();
            2.0 * bone.squared_length.sqrt() * bone.weight * (length - bone.squared_length.sqrt())
        };
        self.system.rows.iter().map(|row| 0.5 * off(&row.bone).powi(2)).sum()
    }
}

/// Integrates the missing markers of `group` out of its linearised bones. `damping` is μ in 1/m², `anchor` (3 · markers) is x₀, relative to `centre` and d, m.
/// `None` if S cannot be factorised, which takes positions that are not finite.
///
/// With `S = L Lᵀ`, everything follows from `p = L⁻¹ J G`, `w = L⁻¹ r` and `h = L⁻¹ J Σ`:
/// the evidence is `pᵀp` and `pᵀw`, `A = G - hᵀp`, `k = hᵀw`, and what is left of Σ is `Σ - hᵀh`.
/// Vectors over the states are contiguous, so that the loops over them are vector instructions.
pub fn integrate(group: &Group, system: Linearised, model: &Model, damping: f64, anchor: &[f64]) -> Option<BoneEvidence> {
    pulp::Arch::new().dispatch(|| integrate_inline(group, system, model, damping, anchor))
}

#[inline(always)]
fn integrate_inline(group: &Group, system: Linearised, model: &Model, damping: f64, anchor: &[f64]) -> Option<BoneEvidence> {
    let unknowns = 3 * group.markers.len();
    let (rows, hidden) = (group.bones.len(), model.hidden());
    let free = |k: usize| model.marker_noise[group.markers[k / 3]];
    // with damping the marker's own distribution is N(G z, r) times N(x₀, 1/μ): a smaller variance, a mean between the two,
    // and the overlap of both, which speaks about z
    let noise: Vec<f64> = (0..unknowns).map(|k| 1.0 / (1.0 / free(k) + damping)).collect();
    let mut gain = DMatrix::from_fn(hidden, unknowns, |h, k| model.emission[(3 * group.markers[k / 3] + k % 3, h)]);
    let mut offset = vec![0.0; unknowns];
    let mut matrix = DMatrix::zeros(hidden, hidden);
    let mut vector = DVector::zeros(hidden);
    let mut constant = 0.0;
    if damping > 0.0 {
        for k in 0..unknowns {
            let overlap = free(k) + 1.0 / damping;
            let own = gain.column(k).into_owned();
            add_square(&mut matrix, own.as_slice(), 1.0 / overlap);
            vector.axpy(anchor[k] / overlap, &own, 1.0);
            gain.column_mut(k).scale_mut(noise[k] / free(k));
            offset[k] = noise[k] * damping * anchor[k];
            constant += anchor[k] * anchor[k] / overlap + (1.0 + damping * free(k)).ln();
        }
    }
    // one column per bone: what L⁻¹ acts on, (J G)ᵀ, then J Σ, then r
    let tall = hidden + unknowns + 1;
    let mut columns = vec![0.0; tall * rows];
    let mut spread = vec![0.0; rows * rows]; // S, its lower half
    let mut at_slot: Vec<Vec<(usize, [f64; 3])>> = vec![Vec::with_capacity(8); group.markers.len()];
    for (r, (row, column)) in system.rows.iter().zip(columns.chunks_exact_mut(tall)).enumerate() {
        column[tall - 1] = row.right;
        spread[r * rows + r] = 1.0;
        for (slot, sign) in row.ends() {
            let slope = row.slope.map(|x| sign * x);
            for (axis, along) in slope.iter().enumerate() {
                let k = 3 * slot + axis;
                axpy(&mut column[..hidden], *along, &gain.as_slice()[k * hidden..(k + 1) * hidden]);
                column[hidden + k] = along * noise[k];
                column[tall - 1] -= along * offset[k];
            }
            at_slot[slot].push((r, slope));
            for (q, other) in &at_slot[slot] {
                let shared: f64 = slope.iter().zip(other).map(|(x, y)| x * y).sum();
                spread[q * rows + r] += shared * noise[3 * slot];
            }
        }
    }
    // S = L Lᵀ in place, and L⁻¹ on the columns
    for c in 0..rows {
        let (done, rest) = spread.split_at_mut((c + 1) * rows);
        let own = &mut done[c * rows..];
        let pivot = own[c];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        constant += pivot.ln();
        let scale = 1.0 / pivot.sqrt();
        for x in &mut own[c..] {
            *x *= scale;
        }
        let (done, after) = columns.split_at_mut((c + 1) * tall);
        let column = &mut done[c * tall..];
        for x in column.iter_mut() {
            *x *= scale;
        }
        for (r, (other, below)) in (c + 1..).zip(after.chunks_exact_mut(tall).zip(rest.chunks_exact_mut(rows))) {
            let share = own[r];
            if share != 0.0 {
                axpy(&mut below[r..], -share, &own[r..]);
                axpy(other, -share, column);
            }
        }
    }
    constant += rows as f64 * std::f64::consts::TAU.ln() + 2.0 * system.log_scale;
    let mut taken = vec![0.0; unknowns]; // the diagonal of hᵀh
    for column in columns.chunks_exact(tall) {
        let (pulled, rest) = column.split_at(hidden);
        let right = rest[unknowns];
        constant += right * right;
        add_square(&mut matrix, pulled, 1.0);
        axpy(vector.as_mut_slice(), right, pulled);
        for (k, (&half, own)) in rest.iter().zip(gain.as_mut_slice().chunks_exact_mut(hidden)).enumerate() {
            if half != 0.0 {
                axpy(own, -half, pulled);
                offset[k] += half * right;
                taken[k] += half * half;
            }
        }
    }
    let rest = (0..group.markers.len()).map(|i| (3 * i..3 * i + 3).map(|k| (noise[k] - taken[k]).max(0.0)).sum()).collect();
    let evidence = BoneEvidence { matrix, vector, constant, group: group.clone(), system, gain, offset, rest };
    evidence.constant.is_finite().then_some(evidence)
}
