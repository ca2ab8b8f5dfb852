//! Where joints shall be → the values of a row: inverse kinematics with a damped Gauss–Newton method (Levenberg and Marquardt), frame by frame.
//!
//! Only what has to change may change.
//! A repaired joint moves because its parent turns; so the parent's other children, and the repaired joint's own children, turn back to keep
//! where they are and how they are turned. Everything below them then stays by itself, so the problem stays small however large the skeleton is.
//! Repaired joints that share such neighbours are solved together, others one after the other.
//!
//! | what | weight ([`WEIGHTS`]) |
//! | --- | --- |
//! | a joint that is not repaired stays where it is, mm | held |
//! | one that is neither repaired nor the parent of such stays turned as it is, at a lever of a bone's length, mm | held |
//! | a repaired joint goes where it was filled, mm | 1 |
//! | the others stay turned as they are; values stay as they are, mm | prior |

use super::hierarchy::{Channel, Skeleton};
use super::kinematics::{Positions, Stand, apart, length, stand};
use std::collections::BTreeMap;

/// Weights of what is known and of what nobody knows, such as the twist of a bone, against that of what was filled.
/// The square of the first is how far fills give way to what is known in the end; starting there would make a valley too narrow to walk along.
/// The second first shows the search the way, and then leaves no trace.
const WEIGHTS: [Weights; 4] = [
    Weights { held: 1.0, prior: 1e-2 },
    Weights { held: 30.0, prior: 1e-3 },
    Weights { held: 1e3, prior: 1e-4 },
    Weights { held: 1e4, prior: 1e-4 },
];

/// More values than any neighbourhood of a body has. A larger one is left as it is; the time grows with the cube.
const MOST_VALUES: usize = 240;
/// Steps of the search.
const MOST_STEPS: usize = 60;
/// Steps of the differences that stand for derivatives, in degrees (about 10⁻⁴ rad).
const NUDGE_DEGREES: f64 = 6e-3;
/// From this mean distance on, mm, another start is tried.
const NEAR_MM: f64 = 1.0;
/// Share of an OFFSET by which a joint's position channels may differ from it without being a movement.
const RIGID: f64 = 1e-3;

/// How much residuals count.
#[derive(Clone, Copy, Debug)]
struct Weights {
    held: f64,
    prior: f64,
}

/// A skeleton, ready for [`Fitter::fit`].
pub(super) struct Fitter<'a> {
    pub skeleton: &'a Skeleton,
    pub positions: Positions,
    /// Millimetres in the file's unit.
    pub unit_mm: f64,
    children: Vec<Vec<usize>>,
}

/// Why a joint takes part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    /// It stays where it is and as it is turned.
    Held,
    /// It turns, so that a child moves.
    Pivot,
    /// It was repaired.
    Wanted,
}

/// One value that may change.
#[derive(Clone, Copy, Debug)]
struct Variable {
    channel: usize,
    angle: bool,
}

/// Joints that are solved together.
struct Group<'a> {
    fitter: &'a Fitter<'a>,
    /// The joints, parents first, with the place of the parent in here, if it is.
    nodes: Vec<(usize, Option<usize>, Part)>,
    /// How they stood before.
    before: Vec<Stand>,
    /// Where parents stand that are not in here.
    above: Vec<Option<Stand>>,
    wanted: Vec<Option<[f64; 3]>>,
    variables: Vec<Variable>,
    /// The length of a bone, in the file's unit.
    lever: f64,
}

impl<'a> Fitter<'a> {
    /// Prepares a skeleton.
    pub fn new(skeleton: &'a Skeleton, positions: Positions, unit_mm: f64) -> Self {
        let mut children = vec![Vec::new(); skeleton.nodes.len()];
        for (at, node) in skeleton.nodes.iter().enumerate() {
            if let Some(list) = node.parent.and_then(|p| children.get_mut(p)) {
                list.push(at);
            }
        }
        Self { skeleton, positions, unit_mm, children }
    }

    /// How everything stands, leaves included.
    pub fn pose(&self, values: &[f64]) -> Vec<Stand> {
        let mut pose: Vec<Stand> = Vec::with_capacity(self.skeleton.nodes.len());
        for node in &self.skeleton.nodes {
            let parent = node.parent.and_then(|p| pose.get(p));
            pose.push(stand(node, parent, values, self.positions, true));
        }
        pose
    }

    /// True if a joint's position channels move it in this row, instead of repeating its OFFSET.
    fn is_free(&self, at: usize, values: &[f64]) -> bool {
        let Some(node) = self.skeleton.nodes.get(at).filter(|n| n.is_placed()) else { return false };
        if node.parent.is_none() || !node.turns() || self.positions == Positions::InRoom {
            return true;
        }
        let mut moved = if self.positions == Positions::AddedToOffset { [0.0; 3] } else { node.offset.map(|x| -x) };
        for (place, channel) in node.channels() {
            if let (Channel::Position(axis), Some(value)) = (channel, values.get(place))
                && let Some(x) = moved.get_mut(axis)
            {
                *x += value;
            }
        }
        length(moved) > RIGID * length(node.offset)
    }

    /// The joints that take part, and why.
    fn parts(&self, wanted: &BTreeMap<usize, [f64; 3]>, values: &[f64]) -> BTreeMap<usize, Part> {
        let mut parts: BTreeMap<usize, Part> = BTreeMap::new();
        // an end site that is no marker may go with its joint
        let matters = |at: usize| self.skeleton.nodes.get(at).is_some_and(|n| n.marker.is_some() || n.inner);
        let mut add = |at: usize, part: Part| {
            if part == Part::Held && !matters(at) {
                return;
            }
            let entry = parts.entry(at).or_insert(part);
            *entry = (*entry).max(part);
        };
        for &at in wanted.keys() {
            add(at, Part::Wanted);
            for &child in self.children.get(at).into_iter().flatten() {
                add(child, Part::Held);
            }
            let parent = self.skeleton.nodes.get(at).and_then(|n| n.parent).filter(|_| !self.is_free(at, values));
            let Some(parent) = parent.filter(|&p| self.may_turn(p)) else { continue };
            add(parent, Part::Pivot);
            for &child in self.children.get(parent).into_iter().flatten() {
                add(child, Part::Held);
            }
        }
        parts
    }

    /// The root of a cloud of points is its origin.
    fn may_turn(&self, at: usize) -> bool {
        (at > 0 || self.skeleton.cloud.is_none()) && self.skeleton.nodes.get(at).is_some_and(super::hierarchy::Node::turns)
    }

    /// Changes `values` so that the joints in `wanted` (places in the file's unit) come as near to them as bones allow, and no others move.
    /// `previous` is a row to start from where this one leads astray.
    pub fn fit(&self, values: &mut [f64], wanted: &BTreeMap<usize, [f64; 3]>, previous: Option<&[f64]>) {
        let before = self.pose(values);
        let parts = self.parts(wanted, values);
        // a group is what hangs together: a joint belongs to the group of its parent, if that takes part
        let mut group_of: BTreeMap<usize, usize> = BTreeMap::new();
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for &at in parts.keys() {
            let parent = self.skeleton.nodes.get(at).and_then(|n| n.parent);
            let group = parent.and_then(|p| group_of.get(&p).copied()).unwrap_or(groups.len());
            group_of.insert(at, group);
            match groups.get_mut(group) {
                Some(list) => list.push(at),
                None => groups.push(vec![at]),
            }
        }
        for members in groups {
            let now = self.pose(values);
            let Some(group) = self.group(&members, &parts, wanted, values, &before, &now) else { continue };
            let (mut best, mut cost) = group.solve(values, &group.pick(values));
            if let Some(previous) = previous
                && cost > NEAR_MM * NEAR_MM * group.wanted.iter().flatten().count() as f64
            {
                let (other, other_cost) = group.solve(values, &group.pick(previous));
                if other_cost < cost {
                    (best, cost) = (other, other_cost);
                }
            }
            if cost.is_finite() {
                group.put(&best, values);
            }
        }
    }

    fn group(
        &self,
        members: &[usize],
        parts: &BTreeMap<usize, Part>,
        wanted: &BTreeMap<usize, [f64; 3]>,
        values: &[f64],
        before: &[Stand],
        now: &[Stand],
    ) -> Option<Group<'_>> {
        let mut group = Group {
            fitter: self,
            nodes: Vec::new(),
            before: Vec::new(),
            above: Vec::new(),
            wanted: Vec::new(),
            variables: Vec::new(),
            lever: 0.0,
        };
        for &at in members {
            let node = self.skeleton.nodes.get(at)?;
            let part = *parts.get(&at)?;
            let inside = node.parent.and_then(|p| members.binary_search(&p).ok());
            let parent = node.parent.and_then(|p| now.get(p)).copied();
            group.nodes.push((at, inside, part));
            group.before.push(*before.get(at)?);
            group.above.push(parent.filter(|_| inside.is_none()));
            group.wanted.push(wanted.get(&at).copied());
            if let Some(parent) = node.parent.and_then(|p| before.get(p)) {
                group.lever = group.lever.max(length(apart(before.get(at)?.place, parent.place)));
            }
            let turns = self.may_turn(at);
            let moves = part != Part::Pivot && self.is_free(at, values) && (node.parent.is_some() || part == Part::Wanted);
            for (channel, kind) in node.channels() {
                let angle = matches!(kind, Channel::Rotation(_));
                if if angle { turns } else { moves } {
                    group.variables.push(Variable { channel, angle });
                }
            }
        }
        group.lever = if group.lever > 0.0 { group.lever } else { 1.0 };
        (!group.variables.is_empty() && group.variables.len() <= MOST_VALUES).then_some(group)
    }
}

impl Group<'_> {
    /// The values of the variables in a row.
    fn pick(&self, values: &[f64]) -> Vec<f64> {
        self.variables.iter().map(|v| values.get(v.channel).copied().unwrap_or_default()).collect()
    }

    /// Puts values of the variables into a row; angles by the shortest way.
    fn put(&self, picked: &[f64], values: &mut [f64]) {
        for (variable, new) in self.variables.iter().zip(picked) {
            if let Some(value) = values.get_mut(variable.channel) {
                let change = new - *value;
                *value += if variable.angle { change - 360.0 * (change / 360.0).round() } else { change };
            }
        }
    }

    /// What is wrong with the values of the variables, in weighted mm. `row` is the whole row, and scratch.
    fn residuals(&self, picked: &[f64], origin: &[f64], weights: Weights, row: &mut [f64]) -> Vec<f64> {
        for (variable, new) in self.variables.iter().zip(picked) {
            if let Some(value) = row.get_mut(variable.channel) {
                *value = *new;
            }
        }
        let (unit_mm, lever_mm) = (self.fitter.unit_mm, self.lever * self.fitter.unit_mm);
        let mut residuals = Vec::with_capacity(self.nodes.len() * 12 + picked.len());
        let mut stands: Vec<Stand> = Vec::with_capacity(self.nodes.len());
        let places = self.nodes.iter().zip(&self.before).zip(self.above.iter().zip(&self.wanted));
        for ((&(at, inside, part), before), (above, wanted)) in places {
            let Some(node) = self.fitter.skeleton.nodes.get(at) else { continue };
            let parent = inside.and_then(|i| stands.get(i)).or(above.as_ref());
            let now = stand(node, parent, row, self.fitter.positions, true);
            let (target, weight) = wanted.map_or((before.place, weights.held), |w| (w, 1.0));
            residuals.extend(apart(now.place, target).map(|x| x * unit_mm * weight));
            if node.turns() || node.inner {
                let weight = if part == Part::Held { weights.held } else { weights.prior };
                for (is, was) in now.axes.iter().zip(&before.axes) {
                    residuals.extend(apart(*is, *was).map(|x| x * lever_mm * weight));
                }
            }
            stands.push(now);
        }
        residuals.extend(self.variables.iter().zip(picked.iter().zip(origin)).map(|(variable, (is, was))| {
            let mm = if variable.angle { (is - was).to_radians() * lever_mm } else { (is - was) * unit_mm };
            mm * weights.prior
        }));
        residuals
    }

    /// The best values from a start, and the sum of squares there, mm².
    fn solve(&self, values: &[f64], start: &[f64]) -> (Vec<f64>, f64) {
        WEIGHTS.iter().fold((start.to_vec(), f64::INFINITY), |(x, _), weights| self.descend(values, x, *weights))
    }

    /// Goes down from a start.
    fn descend(&self, values: &[f64], mut x: Vec<f64>, weights: Weights) -> (Vec<f64>, f64) {
        let origin = self.pick(values);
        let mut row = values.to_vec();
        let mut r = self.residuals(&x, &origin, weights, &mut row);
        let mut cost = dot(&r, &r);
        let mut damping = 1e-6;
        for _ in 0..MOST_STEPS {
            let nudges: Vec<f64> =
                self.variables.iter().map(|v| if v.angle { NUDGE_DEGREES } else { NUDGE_DEGREES.to_radians() * self.lever }).collect();
            let mut jacobian: Vec<Vec<f64>> = Vec::with_capacity(x.len());
            for (at, nudge) in nudges.iter().enumerate() {
                let mut beside = |by: f64| {
                    let moved: Vec<f64> = x.iter().enumerate().map(|(i, v)| if i == at { v + by } else { *v }).collect();
                    self.residuals(&moved, &origin, weights, &mut row)
                };
                let (ahead, behind) = (beside(*nudge), beside(-nudge));
                // per nudge, so that angles and lengths are of one size
                jacobian.push(ahead.iter().zip(&behind).map(|(a, b)| 0.5 * (a - b)).collect());
            }
            let gradient: Vec<f64> = jacobian.iter().map(|column| dot(column, &r)).collect();
            let hessian: Vec<Vec<f64>> =
                jacobian.iter().enumerate().map(|(i, a)| jacobian.iter().take(i + 1).map(|b| dot(a, b)).collect()).collect();
            let mut better = false;
            while damping < 1e6 {
                let Some(step) = solve_damped(&hessian, &gradient, damping) else {
                    damping *= 10.0;
                    continue;
                };
                let moved: Vec<f64> = x.iter().zip(step.iter().zip(&nudges)).map(|(v, (s, nudge))| v - s * nudge).collect();
                let there = self.residuals(&moved, &origin, weights, &mut row);
                let moved_cost = dot(&there, &there);
                if moved_cost < cost {
                    better = cost - moved_cost > 1e-14 * cost;
                    (x, r, cost) = (moved, there, moved_cost);
                    damping = (damping * 0.1).max(1e-12);
                    break;
                }
                damping *= 10.0;
            }
            if !better {
                break;
            }
        }
        (x, cost)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Solves `(H + damping · diag H) s = g` by Cholesky's method; `H` is given by its lower triangle.
fn solve_damped(hessian: &[Vec<f64>], gradient: &[f64], damping: f64) -> Option<Vec<f64>> {
    let mut rows: Vec<Vec<f64>> = Vec::with_capacity(hessian.len());
    let mut forward: Vec<f64> = Vec::with_capacity(hessian.len());
    for (i, (row, g)) in hessian.iter().zip(gradient).enumerate() {
        let mut new: Vec<f64> = Vec::with_capacity(i + 1);
        for (entry, other) in row.iter().zip(&rows) {
            new.push((entry - dot(&new, other)) / other.last()?);
        }
        let diagonal = row.last()?;
        let pivot = diagonal * (1.0 + damping) + f64::MIN_POSITIVE - dot(&new, &new);
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        let pivot = pivot.sqrt();
        forward.push((g - dot(&new, &forward)) / pivot);
        new.push(pivot);
        rows.push(new);
    }
    let mut solution = forward;
    for at in (0..rows.len()).rev() {
        let row = rows.get(at)?;
        let value = solution.get(at)? / row.last()?;
        *solution.get_mut(at)? = value;
        for (s, entry) in solution.iter_mut().take(at).zip(row) {
            *s -= entry * value;
        }
    }
    solution.iter().all(|s| s.is_finite()).then_some(solution)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn cholesky_solves() {
        let lower = vec![vec![4.0], vec![2.0, 5.0], vec![1.0, -1.0, 3.0]];
        let s = solve_damped(&lower, &[7.0, 6.0, 3.0], 0.0).unwrap();
        let full = [[4.0, 2.0, 1.0], [2.0, 5.0, -1.0], [1.0, -1.0, 3.0]];
        for (row, g) in full.iter().zip([7.0, 6.0, 3.0]) {
            assert!((dot(row, &s) - g).abs() < 1e-12, "{s:?}");
        }
        assert!(solve_damped(&[vec![-1.0]], &[1.0], 0.0).is_none());
    }
}
