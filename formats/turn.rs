//! Takes in other axes.

use crate::{Direction, Role, Take, TakeBuilder};

/// A signed permutation of axes: coordinate `k` of the turned position is `sign[k]` times coordinate `axis[k]` of the old one.
struct Turn {
    axis: [usize; 3],
    sign: [f64; 3],
}

impl Turn {
    /// The shortest turn that brings `from` to `to`: a quarter turn about the third axis, or half a turn about the axis behind `from`.
    fn new(from: Direction, to: Direction) -> Self {
        let mut turn = Self { axis: [0, 1, 2], sign: [1.0; 3] };
        let sign = |d: Direction| if d.positive { 1.0 } else { -1.0 };
        if from.axis == to.axis {
            if from.positive != to.positive {
                for (axis, sign) in turn.sign.iter_mut().enumerate() {
                    if axis != (from.axis + 1) % 3 {
                        *sign = -1.0;
                    }
                }
            }
            return turn;
        }
        // What pointed along `from` points along `to`; what pointed along `to` points against `from`, which keeps the hand.
        let both = sign(from) * sign(to);
        turn.axis.swap(from.axis, to.axis);
        for (axis, value) in [(to.axis, both), (from.axis, -both)] {
            if let Some(sign) = turn.sign.get_mut(axis) {
                *sign = value;
            }
        }
        turn
    }

    fn apply(&self, position: [f64; 3]) -> [f64; 3] {
        let at = |k: usize| {
            let value = self.axis.get(k).and_then(|&a| position.get(a)).copied().unwrap_or(f64::NAN);
            // no "-0"
            self.sign.get(k).copied().unwrap_or(1.0) * value + 0.0
        };
        [at(0), at(1), at(2)]
    }
}

impl Take {
    /// The take turned as a whole so that what pointed along `from` points along `to`, which is up from then on.
    /// Coordinates are exchanged and change their sign, so nothing is rounded.
    /// Model outputs stay as they are: which of them are vectors is not known.
    #[must_use]
    pub fn turned(&self, from: Direction, to: Direction) -> Self {
        let turn = Turn::new(from, to);
        let mut turned = TakeBuilder::from(self.clone()).up(Some(to));
        for (marker, column) in self.markers.iter().enumerate() {
            if column.role != Role::Marker {
                continue;
            }
            for frame in 0..self.frames() {
                if let Some(position) = self.position_mm(frame, marker) {
                    turned.set(frame, marker, turn.apply(position), self.origin(frame, marker));
                }
            }
        }
        turned.without_given().build()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Direction> {
        (0..3).flat_map(|axis| [true, false].map(|positive| Direction { axis, positive })).collect()
    }

    fn unit(d: Direction) -> [f64; 3] {
        let mut v = [0.0; 3];
        if let Some(x) = v.get_mut(d.axis) {
            *x = if d.positive { 1.0 } else { -1.0 };
        }
        v
    }

    #[test]
    fn the_usual_two() {
        let turn = |from, to| Turn::new(from, to).apply([1.0, 2.0, 3.0]);
        assert_eq!(turn(Direction::PLUS_Y, Direction::PLUS_Z), [1.0, -3.0, 2.0]);
        assert_eq!(turn(Direction::PLUS_Z, Direction::PLUS_Y), [1.0, 3.0, -2.0]);
        assert_eq!(turn(Direction::PLUS_Y, Direction::PLUS_Y), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn every_turn_brings_from_to_to_and_keeps_the_hand() {
        for from in all() {
            for to in all() {
                let turn = Turn::new(from, to);
                assert_eq!(turn.apply(unit(from)), unit(to), "{from} {to}");
                let [a, b, c] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|v| turn.apply(v));
                let determinant =
                    a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
                assert_eq!(determinant, 1.0, "{from} {to}");
            }
        }
    }
}
