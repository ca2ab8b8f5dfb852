//! What experts say about a gap, and how they do on simulated ones.

use super::ensemble::{Case, Scene};
use super::experts::{Base, Family, Spec};
use super::features::{Features, Local, Part};
use super::ridge::{Fit, Sums};
use super::stack::{Expert, squares};
use crate::solve::kernel::dot;
use nalgebra::{DMatrix, Vector3};

impl Scene<'_> {
    /// Asks a family of experts.
    pub(super) fn ask(&self, case: &Case, order: &[usize], family: &Family, experts: &mut Vec<Expert>) {
        let tracks = self.tracks;
        let marker = case.gap.marker;
        let parts: Vec<Part> = family.specs.iter().flat_map(|s| s.parts.iter().copied()).collect();
        let local = self.local(case, order, family.base, &parts);
        let own = |t: usize| local.pose(t).to_local(tracks.place(t, marker));
        let mut mean = [0.0; 3];
        for &t in &case.learn {
            let x = own(t);
            for axis in 0..3 {
                mean[axis] += x[axis] / case.learn.len() as f64;
            }
        }
        let target = |frames: &[usize]| {
            let values = frames.iter().flat_map(|&t| {
                let x = own(t);
                [x[0] - mean[0], x[1] - mean[1], x[2] - mean[2]]
            });
            DMatrix::from_iterator(3, frames.len(), values)
        };
        let targets =
            Targets { learn: target(&case.learn), judged: target(&case.judged), beside: target(&case.beside), edges: target(&case.edges) };
        let mut groups: Vec<Vec<&Spec>> = Vec::new();
        for spec in &family.specs {
            // nested sets of places share their sums
            let plain = |s: &Spec| matches!(s.parts[..], [] | [Part::Place(_)]);
            match groups.iter_mut().find(|g| plain(g[0]) && plain(spec)) {
                Some(group) => group.push(spec),
                None => groups.push(vec![spec]),
            }
        }
        for group in &groups {
            let Some(widest) = group.iter().max_by_key(|s| s.parts.first().map_or(0, |p| p.neighbours())) else { continue };
            let (features, learned) = Features::new(&local, &widest.parts, &case.learn);
            let d = features.count();
            let mut table = DMatrix::zeros(d + 3, case.learn.len());
            table.rows_mut(0, d).copy_from(&learned);
            table.rows_mut(d, 3).copy_from(&targets.learn);
            let sums = Sums::new(&table, &case.hidden);
            let tables = Tables {
                inside: features.table(&case.inside),
                edges: features.table(&case.edges),
                judged: features.table(&case.judged),
                beside: features.table(&case.beside),
            };
            for spec in group {
                let used = if group.len() > 1 { 1 + spec.parts.first().map_or(0, |p| 3 * p.neighbours()) } else { d };
                let mut noise = vec![0.0; used - 1];
                let places = if let Some(Part::Place(k)) = spec.parts.first() { 3 * k } else { 0 };
                noise[..places].copy_from_slice(&case.noise[..places]);
                let Some(fit) = sums.fit(used, spec.prior, &noise, self.recipe.stiffness * self.scale / case.stride as f64) else {
                    continue;
                };
                let doubt: f64 = (1..used).map(|k| noise[k - 1] * fit.all.row(k).norm_squared()).sum();
                carry(case, spec, family.base, &local, mean, &fit, &tables, &targets, doubt, experts);
            }
        }
    }

    /// What smooth curves through the marker's own samples say, whatever its neighbours do: over a few frames nothing knows better.
    pub(super) fn ask_time(&self, case: &Case, experts: &mut Vec<Expert>) {
        let marker = case.gap.marker;
        let (p, c) = (case.positions(), case.beside.len() / case.starts.len());
        let place = |t: usize| self.tracks.place(t, marker);
        let table = |frames: &[usize]| DMatrix::from_iterator(3, frames.len(), frames.iter().flat_map(|&t| place(t)));
        let (edges, beside, judged) = (table(&case.edges), table(&case.beside), table(&case.judged));
        for (carry, curve) in case.curves.iter().enumerate() {
            let prediction = &edges * &curve.real;
            let mut errors = judged.clone();
            for n in 0..case.starts.len() {
                let said = beside.columns(n * c, c) * &curve.simulated;
                errors.columns_mut(n * p, p).zip_apply(&said, |x, y| *x -= y);
            }
            for (mut column, w) in errors.column_iter_mut().zip(&case.weight) {
                column *= *w;
            }
            let score = squares(errors.as_slice()) / case.total();
            let known = case.weight.iter().map(|w| *w > 0.0).collect();
            experts.push(Expert {
                name: "curve",
                base: Base::Nearest(0),
                carry,
                prediction,
                errors,
                doubt: 0.0,
                score,
                total: case.total(),
                known,
            });
        }
    }

    /// What the model of the whole body says, if it can be judged.
    pub(super) fn ask_body(&self, case: &Case) -> Option<Expert> {
        let gap = case.gap;
        let said = self.body.prediction(self.problem, gap)?;
        let mut errors = DMatrix::zeros(3, case.judged.len());
        let mut known = vec![false; case.judged.len()];
        for (((mut column, &t), w), known) in errors.column_iter_mut().zip(&case.judged).zip(&case.weight).zip(&mut known) {
            let Some(x) = self.body.said(t, gap.marker).filter(|_| *w > 0.0) else { continue };
            let real = self.tracks.place(t, gap.marker);
            column.copy_from_slice(&[real[0] - x[0], real[1] - x[1], real[2] - x[2]]);
            *known = true;
        }
        let total = known.iter().filter(|k| **k).count() as f64;
        let prediction = DMatrix::from_iterator(3, said.len(), said.into_iter().flatten());
        let score = squares(errors.as_slice()) / total;
        (total > 0.0).then_some(Expert {
            name: "body",
            base: Base::Nearest(0),
            carry: 0,
            prediction,
            errors,
            doubt: 0.0,
            score,
            total,
            known,
        })
    }
}

/// What one regression says, with each way to carry what is left at the edges into the gap.
#[allow(clippy::too_many_arguments)] // one step of a chain
fn carry(
    case: &Case,
    spec: &Spec,
    base: Base,
    local: &Local,
    mean: [f64; 3],
    fit: &Fit,
    tables: &Tables,
    targets: &Targets,
    doubt: f64,
    experts: &mut Vec<Expert>,
) {
    let used = fit.all.nrows();
    let predict = |beta: &DMatrix<f64>, table: &DMatrix<f64>, from: usize, count: usize| linear(beta, table, used, from, count);
    // what is left in and around the simulated gaps, out of block
    let (p, c) = (case.positions(), case.beside.len() / case.starts.len());
    let mut left = targets.judged.clone();
    let mut left_beside = targets.beside.clone();
    for (n, &(block, _)) in case.starts.iter().enumerate() {
        let beta = &fit.without[block];
        left.columns_mut(n * p, p).zip_apply(&predict(beta, &tables.judged, n * p, p), |x, y| *x -= y);
        left_beside.columns_mut(n * c, c).zip_apply(&predict(beta, &tables.beside, n * c, c), |x, y| *x -= y);
    }
    let plain = predict(&fit.all, &tables.inside, 0, case.inside.len());
    let mut edge_left = &targets.edges - predict(&fit.all, &tables.edges, 0, case.edges.len());
    follow_no_ghosts(&mut edge_left, &left_beside);
    for carry in 0..=case.carries.len() {
        let mut errors = left.clone();
        let mut prediction = plain.clone();
        if let Some(carry) = carry.checked_sub(1).map(|k| &case.carries[k]) {
            for n in 0..case.starts.len() {
                let step = left_beside.columns(n * c, c) * &carry.simulated;
                errors.columns_mut(n * p, p).zip_apply(&step, |x, y| *x -= y);
            }
            prediction += &edge_left * &carry.real;
        }
        // families have frames of their own, so they meet in the world's
        for ((mut column, w), &t) in errors.column_iter_mut().zip(&case.weight).zip(&case.judged) {
            let turned = local.pose(t).direction_to_world(Vector3::new(column[0], column[1], column[2])) * *w;
            column.copy_from(&turned);
        }
        for (mut column, &t) in prediction.column_iter_mut().zip(&case.inside) {
            let x = local.pose(t).to_world([column[0] + mean[0], column[1] + mean[1], column[2] + mean[2]]);
            column.copy_from_slice(&x);
        }
        let score = squares(errors.as_slice()) / case.total() + doubt;
        experts.push(Expert {
            name: spec.name,
            base,
            carry,
            prediction,
            errors,
            doubt,
            score,
            total: case.total(),
            known: case.weight.iter().map(|w| *w > 0.0).collect(),
        });
    }
}

/// Features × frames.
struct Tables {
    inside: DMatrix<f64>,
    edges: DMatrix<f64>,
    judged: DMatrix<f64>,
    beside: DMatrix<f64>,
}

/// The marker in local coordinates, minus its mean: 3 × frames.
struct Targets {
    learn: DMatrix<f64>,
    edges: DMatrix<f64>,
    judged: DMatrix<f64>,
    beside: DMatrix<f64>,
}

/// A residual this many times longer than the median one is no property of the marker.
const GHOST: f64 = 4.0;

/// Shortens what is left at the edges of a gap where it is longer than what is usually left: the samples next to a gap are where a marker was
/// being lost or found again, and what lies far from where it should be there is often another marker or a reflection.
fn follow_no_ghosts(edges: &mut DMatrix<f64>, usual: &DMatrix<f64>) {
    let mut sizes: Vec<f64> = usual.column_iter().map(|x| x.norm()).collect();
    if sizes.is_empty() {
        return;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    let longest = GHOST * *median;
    for mut edge in edges.column_iter_mut() {
        let size = edge.norm();
        if size > longest {
            edge *= longest / size;
        }
    }
}

/// `betaᵀ table` for some columns of a table: 3 × count.
fn linear(beta: &DMatrix<f64>, table: &DMatrix<f64>, used: usize, from: usize, count: usize) -> DMatrix<f64> {
    let height = table.nrows();
    let mut out = DMatrix::zeros(3, count);
    for (out, column) in out.as_mut_slice().chunks_exact_mut(3).zip(table.as_slice()[from * height..].chunks_exact(height)) {
        for (x, beta) in out.iter_mut().zip(beta.as_slice().chunks_exact(used)) {
            *x = dot(beta, &column[..used]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ghosts_at_the_edges_are_shortened() {
        let usual = DMatrix::from_column_slice(3, 3, &[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 300.0]);
        let mut edges = DMatrix::from_column_slice(3, 2, &[3.0, 4.0, 0.0, 60.0, 0.0, -80.0]);
        follow_no_ghosts(&mut edges, &DMatrix::zeros(3, 0));
        assert_eq!(edges.column(1).norm(), 100.0, "nothing is known");
        follow_no_ghosts(&mut edges, &usual);
        assert_eq!(edges.column(0).as_slice(), [3.0, 4.0, 0.0]);
        let expected = [0.6, 0.0, -0.8].map(|x| x * GHOST * 2.0);
        assert!(edges.column(1).iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{edges}");
    }
}
