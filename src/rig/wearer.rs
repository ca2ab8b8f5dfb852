//! The body that wears the markers of a take, from its files, for whoever fills gaps.

use super::map::{MapError, Worn, read_map, wear, wear_by_labels};
use super::unit::other_unit;
use super::{Rig, RigFiles, read_rig};
use crate::input::{Opened, Reading, expand, read};
use crate::repair::RepairError;
use crate::solve::ik::Vec3;
use crate::solve::markers::{Calibration, Known, Seen, calibrate};
use crate::solve::skeleton::Wearer;
use formats::{Direction, Note, Take};
use nalgebra::{Matrix3, Rotation3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A body and where it wears markers, as files.
#[derive(Clone, Debug)]
pub struct WearerFiles {
    /// The body.
    pub rig: RigFiles,
    /// The table of markers, see [`read_map`]; without it labels tell which joint moves which marker.
    pub map: Option<PathBuf>,
    /// Find out where markers sit and how long bones are.
    pub calibrate: bool,
}

impl WearerFiles {
    /// All files that are read.
    pub fn all(&self) -> impl Iterator<Item = &Path> {
        self.rig.all().into_iter().map(|(_, path)| path).chain(self.map.as_deref())
    }

    /// Where the markers of `take` sit, as far as it is known beforehand.
    ///
    /// # Errors
    /// The table cannot be read, or does not fit the take.
    pub fn worn(&self, rig: &Rig, take: &Take) -> Result<Worn, RepairError> {
        let Some(map) = &self.map else {
            return wear_by_labels(rig, take).map_err(|error| RepairError::Map { path: self.rig.skeleton.clone(), error });
        };
        let wrong = |error| RepairError::Map { path: map.clone(), error };
        let placed = read_map(&expand(read(map)?, map)?, rig).map_err(wrong)?;
        let worn = wear(&placed, take).map_err(wrong)?;
        let somewhere =
            worn.markers.iter().zip(&worn.somewhere).filter(|(_, somewhere)| **somewhere).map(|((_, label, ..), _)| label.as_str());
        let known = somewhere.collect::<Vec<_>>().join(", ");
        if known.is_empty() || self.calibrate { Ok(worn) } else { Err(wrong(MapError::Somewhere { known })) }
    }

    /// Finds out where markers sit and how long bones are: `rig` and `worn` are as the take shows them afterwards.
    /// `seen` has the markers of `worn`.
    ///
    /// # Errors
    /// Too little is seen.
    pub fn calibrate(&self, rig: &mut Rig, worn: &mut Worn, seen: &Seen) -> Result<Calibration, RepairError> {
        let known = worn.markers.iter().zip(&worn.somewhere).map(|((_, _, marker, _), somewhere)| Known {
            part: Some(marker.part),
            or: rig.upper_half(marker.part).filter(|_| *somewhere),
            place: (!somewhere).then(|| marker.place()),
        });
        let known: Vec<Known> = known.collect();
        let found = calibrate(&rig.body, rig.limits.as_ref(), seen, &known).ok_or_else(|| RepairError::Map {
            path: self.map.clone().unwrap_or_else(|| self.rig.skeleton.clone()),
            error: MapError::TooFew,
        })?;
        for (joint, link) in rig.skeleton.joints.iter_mut().zip(&found.body.tree.links) {
            joint.centre = (link.centre / rig.unit.cm()).into();
        }
        rig.body = found.body.clone();
        for (at, ((_, _, marker, weight), place)) in worn.markers.iter_mut().zip(&found.markers).enumerate() {
            match place {
                Some(place) => *marker = *place,
                // where it sits is not known; without a sample that does not matter
                None if (0..seen.frames).any(|frame| seen.places[frame * seen.markers + at].x.is_finite()) => *weight = 0.0,
                None => {}
            }
        }
        Ok(found)
    }

    /// The body that wears the markers of a take, and what there is to say about that.
    ///
    /// # Errors
    /// A file cannot be read, or the files do not belong together.
    pub fn wearer(&self, opened: &Opened, path: &Path, reading: &Reading) -> Result<(Arc<Wearer>, Vec<Note>), RepairError> {
        let rig = read_rig(&self.rig)?;
        let take = opened.document.take();
        let worn = self.worn(&rig, take)?;
        let names = rig.names().map(str::to_owned).collect();
        let mut from_take = take.up.map_or_else(Matrix3::identity, |up| turn(up, rig.up()));
        let unit = other_unit(&rig, &worn, opened, path, reading)?;
        let mut notes = rig.notes;
        if let Some(unit) = unit {
            from_take *= unit.mm() / take.unit.mm();
            let text =
                format!("the file names no unit, and the body fits its markers if they are in {} (say it with --units)", unit.symbol());
            notes.push(Note::Assumed { text });
        }
        for (names, what) in [
            (&worn.absent, "markers of --map that the take does not have"),
            (&worn.strangers, "markers that --map does not have are filled by splines"),
        ] {
            if !names.is_empty() {
                notes.push(Note::Assumed { text: format!("{what}: {}", names.join(", ")) });
            }
        }
        let markers = worn.markers.into_iter().map(|(column, _, marker, weight)| (column, marker, weight)).collect();
        Ok((Arc::new(Wearer { tree: rig.body.tree, names, limits: rig.limits, markers, from_take }), notes))
    }
}

/// The shortest turn after which what pointed along one direction points along another. Any heading will do: fills are turned back.
fn turn(from: Direction, to: Direction) -> Matrix3<f64> {
    let vector = |direction: Direction| {
        let mut vector = Vec3::zeros();
        vector[direction.axis] = if direction.positive { 1.0 } else { -1.0 };
        vector
    };
    let rotation = Rotation3::rotation_between(&vector(from), &vector(to));
    // the other way round: about any axis across
    rotation
        .unwrap_or_else(|| {
            Rotation3::from_scaled_axis(vector(Direction { axis: (from.axis + 1) % 3, positive: true }) * std::f64::consts::PI)
        })
        .into_inner()
}
