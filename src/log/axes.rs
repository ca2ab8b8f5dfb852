//! How the axes of a take lie in a room whose z axis points up, as viewers expect it.

use super::mcap::Up;
use super::schema::foxglove::{FrameTransform, FrameTransforms, Quaternion, Vector3};
use super::{FRAME_ID, ROOM_ID};
use formats::Direction;
use std::f64::consts::FRAC_1_SQRT_2 as HALF;

/// The turn from the room to the take's axes, if they do not agree already.
pub(super) fn transform(up: Up) -> Option<FrameTransforms> {
    let up = up.direction().filter(|up| *up != Direction::PLUS_Z)?;
    Some(FrameTransforms {
        transforms: vec![FrameTransform {
            timestamp: Some(prost_types::Timestamp::default()),
            parent_frame_id: ROOM_ID.to_owned(),
            child_frame_id: FRAME_ID.to_owned(),
            translation: Some(Vector3::default()),
            rotation: Some(rotation(up)),
        }],
    })
}

/// The shortest turn that brings `up` to +z.
fn rotation(up: Direction) -> Quaternion {
    let (x, y, z, w) = match (up.axis, up.positive) {
        (0, true) => (0.0, -HALF, 0.0, HALF),
        (0, false) => (0.0, HALF, 0.0, HALF),
        (1, true) => (HALF, 0.0, 0.0, HALF),
        (1, false) => (-HALF, 0.0, 0.0, HALF),
        (_, true) => (0.0, 0.0, 0.0, 1.0),
        (_, false) => (1.0, 0.0, 0.0, 0.0),
    };
    Quaternion { x, y, z, w }
}

/// A place of the take in the room.
pub(super) fn in_room(up: Direction, p: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = p;
    match (up.axis, up.positive) {
        (0, true) => [-z, y, x],
        (0, false) => [z, y, -x],
        (1, true) => [x, -z, y],
        (1, false) => [x, z, -y],
        (_, true) => p,
        (_, false) => [x, -y, -z],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra as na;

    #[test]
    fn what_is_up_in_the_take_is_z_in_the_room() {
        for axis in 0..3 {
            for positive in [true, false] {
                let Quaternion { x, y, z, w } = rotation(Direction { axis, positive });
                let turn = na::UnitQuaternion::from_quaternion(na::Quaternion::new(w, x, y, z));
                let mut up = na::Vector3::zeros();
                up[axis] = if positive { 1.0 } else { -1.0 };
                let place = na::Vector3::new(1.0, 2.0, 3.0);
                let room = in_room(Direction { axis, positive }, place.into());
                assert!((turn * place - na::Vector3::from(room)).norm() < 1e-14, "axis {axis}, {positive}: {room:?}");
                assert!((turn * up - na::Vector3::z()).norm() < 1e-15, "axis {axis}, {positive}: {}", turn * up);
            }
        }
    }

    #[test]
    fn a_room_that_is_right_already_is_not_turned() {
        assert_eq!(transform(Up::Stated(Direction::PLUS_Z)), None);
        assert_eq!(transform(Up::Unknown), None);
        assert!(transform(Up::Guessed(Direction::PLUS_Y)).is_some());
    }
}
