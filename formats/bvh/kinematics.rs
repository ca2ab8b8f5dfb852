//! Forward kinematics: a row of channel values → where every joint is.
//!
//! Column vectors; the rotations of a joint apply in the order of its channels from left to right, `R = R₁ R₂ R₃`, wherever position channels
//! stand among them. With `p` and `R` of the parent and `o` the OFFSET, a joint is at `p + R o`.

use super::hierarchy::{Channel, Node, Skeleton};

/// What position channels below the root mean. BVH does not say, and programs differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Positions {
    /// They stand in place of OFFSET.
    InPlaceOfOffset,
    /// They are added to OFFSET.
    AddedToOffset,
    /// They are positions in the room.
    InRoom,
}

impl Positions {
    /// All meanings, the usual one first.
    pub const ALL: [Self; 3] = [Self::InPlaceOfOffset, Self::AddedToOffset, Self::InRoom];
}

/// Columns of a rotation matrix.
pub(super) type Columns = [[f64; 3]; 3];

const UPRIGHT: Columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Where one joint is, in the file's unit, and how it is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stand {
    /// Position.
    pub place: [f64; 3],
    /// Axes of the joint, in the room.
    pub axes: Columns,
}

impl Stand {
    /// The origin.
    pub const ORIGIN: Self = Self { place: [0.0; 3], axes: UPRIGHT };
}

/// `columns` times a rotation about one axis.
fn turn(columns: Columns, axis: usize, degrees: f64) -> Columns {
    let (s, c) = degrees.to_radians().sin_cos();
    let [x, y, z] = columns;
    let mix = |a: [f64; 3], p: f64, b: [f64; 3], q: f64| [a[0] * p + b[0] * q, a[1] * p + b[1] * q, a[2] * p + b[2] * q];
    match axis {
        0 => [x, mix(y, c, z, s), mix(z, c, y, -s)],
        1 => [mix(x, c, z, -s), y, mix(z, c, x, s)],
        _ => [mix(x, c, y, s), mix(y, c, x, -s), z],
    }
}

/// From a joint to a point in its axes.
fn reach(from: &Stand, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let [a, b, c] = from.axes;
    let [px, py, pz] = from.place;
    [px + a[0] * x + b[0] * y + c[0] * z, py + a[1] * x + b[1] * y + c[1] * z, pz + a[2] * x + b[2] * y + c[2] * z]
}

/// Where `node` is under `parent`, with the values of a row; `turned` is false if it does not matter how it is turned.
pub(super) fn stand(node: &Node, parent: Option<&Stand>, values: &[f64], positions: Positions, turned: bool) -> Stand {
    let from = parent.copied().unwrap_or(Stand::ORIGIN);
    let mut axes = from.axes;
    let mut moved = node.offset;
    let mut in_room = false;
    if node.channels.is_empty() {
        return Stand { place: reach(&from, moved), axes };
    }
    if node.is_placed() && node.parent.is_some() {
        in_room = positions == Positions::InRoom;
        if positions != Positions::AddedToOffset {
            moved = [0.0; 3];
        }
    }
    let own = values.get(node.first_channel..).unwrap_or_default();
    for (channel, &value) in node.channels.iter().zip(own) {
        match *channel {
            Channel::Position(axis) => {
                if let Some(x) = moved.get_mut(axis) {
                    *x += value;
                }
            }
            Channel::Rotation(axis) if turned && value != 0.0 => axes = turn(axes, axis, value),
            Channel::Rotation(_) => {}
        }
    }
    Stand { place: if in_room { moved } else { reach(&from, moved) }, axes }
}

impl Skeleton {
    /// Where everything is, with the values of a row.
    pub fn pose(&self, values: &[f64], positions: Positions, pose: &mut Vec<Stand>) {
        pose.clear();
        for node in &self.nodes {
            let parent = node.parent.and_then(|p| pose.get(p));
            pose.push(stand(node, parent, values, positions, node.inner));
        }
    }

    /// What position channels below the root mean: that under which bones are nearest to the length of their OFFSET.
    pub fn meaning(&self, values: &[f64]) -> Positions {
        let placed = |n: &&Node| n.parent.is_some() && n.is_placed() && length(n.offset) > 0.0;
        if !self.nodes.iter().any(|n| placed(&n)) {
            return Positions::InPlaceOfOffset;
        }
        let mut pose = Vec::new();
        let mut best = (f64::INFINITY, Positions::InPlaceOfOffset);
        for positions in Positions::ALL {
            self.pose(values, positions, &mut pose);
            let total: f64 = self
                .nodes
                .iter()
                .zip(&pose)
                .filter(|(n, _)| placed(n))
                .filter_map(|(n, at)| Some((length(apart(at.place, pose.get(n.parent?)?.place)) - length(n.offset)).abs()))
                .sum();
            // another meaning than the usual one has to be clearly better
            if total < 0.5 * best.0 {
                best = (total, positions);
            }
        }
        best.1
    }
}

/// `a - b`
pub(super) fn apart(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Euclidean length.
pub(super) fn length([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each axis takes the next one to the one after: x turns y to z.
    #[test]
    fn rotations_are_right_handed() {
        for axis in 0..3 {
            let turned = turn(UPRIGHT, axis, 90.0);
            let (next, after) = ((axis + 1) % 3, (axis + 2) % 3);
            assert!(length(apart(turned[next], UPRIGHT[after])) < 1e-15, "axis {axis}");
            assert!(length(apart(turned[axis], UPRIGHT[axis])) == 0.0, "axis {axis}");
        }
    }

    #[test]
    fn channels_apply_from_left_to_right() {
        // R = Rz(90) Rx(90): y first goes to z about x, which z leaves there
        let columns = turn(turn(UPRIGHT, 2, 90.0), 0, 90.0);
        assert!(length(apart(columns[1], [0.0, 0.0, 1.0])) < 1e-15, "{columns:?}");
        assert!(length(apart(columns[2], [1.0, 0.0, 0.0])) < 1e-15, "{columns:?}");
    }
}
