//! Poses of a rig as a BVH file, in the rig's own unit, and the proof that it says what the solver found.

use super::Rig;
use crate::compression;
use crate::input::expand;
use crate::output::unwritable;
use crate::repair::RepairError;
use crate::solve::ik::{Pose, State, Vec3};
use crate::staging;
use crate::verify::Broken;
use formats::bvh::{self, Bvh, Motion, Order, motion_joints, write_motion};
use formats::{Format, FormatError, Notes, Stated, Take, Unit};
use std::io::{self, Write};
use std::path::Path;
use tempfile::NamedTempFile;

/// How far a joint of the written file may be from where the solver has it, cm: numbers have six decimals ...
const ROUNDING_CM: f64 = 0.01;
/// ... and so far in the unit of the file, where that is large.
const ROUNDING: f64 = 2e-5;

/// The frames of a rig in motion.
#[derive(Clone, Debug, Default)]
pub struct Poses {
    states: Vec<Vec<bvh::State>>,
    /// Where the joints are, cm.
    centres: Vec<Vec<Vec3>>,
}

impl Poses {
    /// The next frame: its pose, and where that puts the joints, cm.
    pub fn push(&mut self, rig: &Rig, pose: &Pose, centres: &[Vec3]) {
        let state = |state: &State| match state {
            State::Shift(shift) => bvh::State::Shift((shift / rig.unit.cm()).into()),
            State::Angle(angle) => bvh::State::Angle(*angle),
            State::Rotation(rotation) => {
                let matrix = rotation.to_rotation_matrix();
                bvh::State::Rotation(std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)])))
            }
        };
        self.states.push(pose.0.iter().map(state).collect());
        self.centres.push(centres.to_vec());
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.states.len()
    }

    /// Where the joints are in each frame, cm.
    pub fn centres(&self) -> &[Vec<Vec3>] {
        &self.centres
    }

    /// Writes the file under a hidden name beside `output`, opens it again and holds it against the poses. What comes out only lacks its name.
    ///
    /// # Errors
    /// It cannot be written, or is not what it should be.
    pub fn stage(&self, rig: &Rig, rate_hz: f64, order: Order, output: &Path) -> Result<NamedTempFile, RepairError> {
        let ends = rig.ends().iter().map(|end| end.map(|end| (end / rig.unit.cm()).into())).collect();
        let motion = Motion { skeleton: &rig.skeleton, ends, frame_secs: 1.0 / rate_hz, order, frames: &self.states };
        let mut file = staging::beside(output).map_err(|e| unwritable(output, &e))?;
        let compressed = compression::is_named(output);
        let io_error = |e: io::Error| FormatError::io(Bvh.info().name, e);
        let written = {
            let mut out = io::BufWriter::with_capacity(1 << 20, file.as_file_mut());
            let result = compression::through(&mut out, compressed, io_error, |out| write_motion(&motion, out));
            result.and_then(|()| out.flush().map_err(io_error))
        };
        written.map_err(|error| RepairError::Format { path: output.to_owned(), error })?;
        file.as_file().sync_all().map_err(|e| unwritable(output, &e))?;
        let back = std::fs::read(file.path()).map_err(|e| unwritable(output, &e))?;
        let back = if compressed { expand(back, output)? } else { back };
        // Files name no unit; millimetres leave the numbers as they are.
        let stated = Stated { unit: Some(Unit::Millimetre), ..Stated::default() };
        let proven = match Bvh.open(back, &stated, &Notes::new()) {
            Ok(document) => self.compare(rig, &motion_joints(&motion), document.take()),
            Err(error) => Err(Broken(format!("it does not open ({error})"))),
        };
        proven.map_err(|error| RepairError::Verify { path: output.to_owned(), error })?;
        Ok(file)
    }

    /// Every joint is where the solver has it, in every frame.
    fn compare(&self, rig: &Rig, joints: &[(String, usize)], take: &Take) -> Result<(), Broken> {
        if take.frames() != self.frames() {
            return Err(Broken(format!("{} frames instead of {}", take.frames(), self.frames())));
        }
        let unit_cm = rig.unit.cm();
        let most = (ROUNDING_CM / unit_cm).max(ROUNDING);
        for (name, joint) in joints {
            let Some(column) = take.markers.iter().position(|marker| marker.label == *name) else {
                return Err(Broken(format!("joint {name} is not there")));
            };
            for (frame, centres) in self.centres.iter().enumerate() {
                let was = centres[*joint] / unit_cm;
                let Some(is) = take.position_mm(frame, column).map(Vec3::from) else {
                    return Err(Broken(format!("joint {name} is nowhere in frame {frame}")));
                };
                let off = (is - was).norm();
                if off.is_nan() || off > most + 1e-9 * was.norm() {
                    let symbol = rig.unit.symbol();
                    return Err(Broken(format!("joint {name}, frame {frame}: {off} {symbol} from where it was found")));
                }
            }
        }
        Ok(())
    }
}
