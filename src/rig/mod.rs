//! The rig of a body, read from its files and brought to the solver's units: skeleton, surface, which joint moves which vertex, limits.
//!
//! What is in the files is told by `formats::rig`, what comes of the poses by [`bvh`], where markers sit by [`map`] and [`wearer`], and whether they are
//! in the unit that was taken for theirs by [`unit`].

pub mod bvh;
pub mod map;
mod sound;
mod spine;
pub mod unit;
pub mod wearer;

use crate::input::{expand, hex, read};
use crate::repair::RepairError;
use crate::report::short;
use crate::solve::ik::terms::Limits;
use crate::solve::ik::{Pose, State, Tree, Vec3};
use crate::solve::track::Body;
use formats::rig::{AngleUnit, JointKind, Skeleton, read_limits, read_mesh, read_parts, read_skeleton, skeleton_of_bvh};
use formats::{Direction, FormatError, Note, Notes, printable};
use nalgebra::UnitQuaternion;
use sha2::{Digest, Sha256};
use sound::{apart, inside_out};
use spine::add_spine;
use std::path::{Path, PathBuf};

/// A body of such a size is that of a person, cm.
const PERSON_CM: std::ops::RangeInclusive<f64> = 100.0..=250.0;

/// A unit of length. The files of a rig name none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    /// 0.1 cm
    Millimetre,
    /// What the solver counts in.
    Centimetre,
    /// 100 cm
    Metre,
    /// 2.54 cm
    Inch,
}

impl Length {
    /// How many centimetres one of this unit is.
    pub fn cm(self) -> f64 {
        match self {
            Self::Millimetre => 0.1,
            Self::Centimetre => 1.0,
            Self::Metre => 100.0,
            Self::Inch => 2.54,
        }
    }

    /// `mm`, `cm`, `m` or `in`.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Metre => "m",
            Self::Inch => "in",
        }
    }
}

/// Where a rig is, and what the user states about it.
#[derive(Clone, Debug)]
pub struct RigFiles {
    /// The skeleton.
    pub skeleton: PathBuf,
    /// The surface in the reference pose.
    pub surface: PathBuf,
    /// Which joint moves which vertex of the surface.
    pub parts: PathBuf,
    /// How far joints move, if that is to be kept.
    pub limits: Option<PathBuf>,
    /// Unit of length of all of them; by the size of the body if absent.
    pub unit: Option<Length>,
    /// Unit of the angles of `limits`; by their size if absent.
    pub angles: Option<AngleUnit>,
    /// The second angle of a ball joint's limit is the largest turn about its limb, not a cone like the first.
    pub swing_twist: bool,
    /// Give the trunk a joint more, so that it bends.
    pub spine: bool,
}

impl RigFiles {
    /// All files, each with what it is.
    pub fn all(&self) -> Vec<(&'static str, &Path)> {
        let limits = self.limits.as_deref().map(|path| ("limits", path));
        [("skeleton", self.skeleton.as_path()), ("surface", &self.surface), ("parts", &self.parts)].into_iter().chain(limits).collect()
    }
}

/// A rig that was read.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The skeleton, in the unit of the files.
    pub skeleton: Skeleton,
    /// The body that the solver moves, cm.
    pub body: Body,
    /// How far its joints move.
    pub limits: Option<Limits>,
    /// The pose that the skeleton's file begins with: the reference pose, if it does not say.
    pub start: Pose,
    /// The unit of the files.
    pub unit: Length,
    /// The trunk and its upper half, if it was given one.
    pub spine: Option<[usize; 2]>,
    /// What was assumed or found odd.
    pub notes: Vec<Note>,
    /// For each file what it is, its name without folders, and its SHA-256.
    pub files: Vec<(&'static str, String, String)>,
}

/// Reads a rig.
///
/// # Errors
/// A file cannot be read or is damaged, or the files do not belong together.
pub fn read_rig(files: &RigFiles) -> Result<Rig, RepairError> {
    let mut sources = Vec::new();
    for (what, path) in files.all() {
        let bytes = read(path)?;
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        sources.push((what, name, hex(&Sha256::digest(&bytes)), expand(bytes, path)?));
    }
    let bytes = |at: usize| sources.get(at).map(|(.., bytes)| bytes.as_slice()).unwrap_or_default();
    let wrong = |path: &Path| {
        let path = path.to_owned();
        move |error: FormatError| RepairError::Format { path, error }
    };
    let notes = Notes::new();
    let bvh = bytes(0).trim_ascii_start().get(..9).is_some_and(|word| word.eq_ignore_ascii_case(b"hierarchy"));
    let skeleton = if bvh { skeleton_of_bvh(bytes(0), &notes) } else { read_skeleton(bytes(0), &notes) };
    let mut skeleton = skeleton.map_err(wrong(&files.skeleton))?;
    let mesh = read_mesh(bytes(1), &notes).map_err(wrong(&files.surface))?;
    if mesh.vertices.is_empty() {
        let problem = "has no vertices, so there is no surface to follow; name the surface of the body in its reference pose";
        return Err(RepairError::Io { path: files.surface.clone(), problem: problem.to_owned() });
    }
    if mesh.normals.is_empty() && mesh.faces.is_empty() {
        let text = "the surface has neither faces nor normals, so nothing tells its inside from its outside";
        notes.add(Note::Assumed { text: text.to_owned() });
    }
    let mut parts = read_parts(bytes(2), &skeleton, mesh.vertices.len()).map_err(wrong(&files.parts))?;
    let mut limits = match &files.limits {
        Some(path) => Some(read_limits(bytes(3), &skeleton, files.angles, &notes).map_err(wrong(path))?),
        None => None,
    };
    let spine = if files.spine { add_spine(&mut skeleton, &mesh.vertices, &mut parts, &mut limits) } else { None };
    if files.spine && spine.is_none() {
        let problem = "has no part with two limbs or more at both of its ends, so it has no place for a spine; leave out --spine";
        return Err(RepairError::Io { path: files.skeleton.clone(), problem: problem.to_owned() });
    }
    let spine = spine.and_then(|name| skeleton.joint(&name)).and_then(|upper| Some([skeleton.joints[upper].parent?, upper]));
    let unit = files.unit.unwrap_or_else(|| likely_unit(&mesh.vertices, &notes));
    let scaled = |x: &[f64; 3]| Vec3::from(*x) * unit.cm();
    let normals = mesh.normals.iter().map(|x| Vec3::from(*x)).collect();
    let vertices = mesh.vertices.iter().map(scaled).collect();
    let mut body = Body::new(Tree::new(&skeleton, unit.cm()), vertices, normals, mesh.faces, parts);
    belong_together(&mut body, &skeleton, files, &notes)?;
    Ok(Rig {
        body,
        limits: limits.map(|limits| Limits::new(&limits, files.swing_twist, unit.cm())),
        start: start(&skeleton, unit),
        unit,
        spine,
        notes: notes.take(),
        files: sources.iter().map(|(what, name, sha256, _)| (*what, name.clone(), sha256.clone())).collect(),
        skeleton,
    })
}

/// Refuses a skeleton that is not where the surface is, and turns a surface that is inside out.
fn belong_together(body: &mut Body, skeleton: &Skeleton, files: &RigFiles, notes: &Notes) -> Result<(), RepairError> {
    let (apart, all) = apart(body);
    if let Some((joint, distance)) = apart.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)) {
        let name = printable(&skeleton.joints[joint].name);
        let (count, distance) = (apart.len(), short(distance));
        let problem = format!(
            "{count} of {all} joints are nowhere near the part that they move, {name} is {distance} cm away from the nearest vertex"
        );
        if 2 * apart.len() > all {
            let problem = format!(
                "{problem}: skeleton and surface do not belong together, or not in these units or places; \
                 both have to be in the same reference pose (a BVH skeleton with the root where the body has it)"
            );
            return Err(RepairError::Io { path: files.skeleton.clone(), problem });
        }
        notes
            .add(Note::Assumed { text: format!("{problem}; are parts named in the order of the vertices, left and right not exchanged?") });
    }
    if inside_out(body) {
        body.turn_normals();
        let text =
            "the normals of the surface point inwards, they are turned (faces have to be wound counter-clockwise, seen from outside)";
        notes.add(Note::Assumed { text: text.to_owned() });
    }
    if let Some(unit) = files.unit
        && !PERSON_CM.contains(&body.size_cm())
    {
        let (size, least, most) = (short(body.size_cm()), PERSON_CM.start(), PERSON_CM.end());
        let symbol = unit.symbol();
        let text = format!("in {symbol} the body is {size} cm tall, and what tracking expects is made for people of {least} to {most} cm");
        notes.add(Note::Assumed { text });
    }
    Ok(())
}

/// The axis along which a body stands: y or z, whichever side is longer. Arms may reach farther than a body is tall, so x is no candidate.
fn upright(vertices: impl Iterator<Item = [f64; 3]>) -> usize {
    let (mut least, mut most) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for x in vertices {
        for k in 0..3 {
            least[k] = least[k].min(x[k]);
            most[k] = most[k].max(x[k]);
        }
    }
    if most[1] - least[1] >= most[2] - least[2] { 1 } else { 2 }
}

/// The unit in which the body has the size of a person.
fn likely_unit(vertices: &[[f64; 3]], notes: &Notes) -> Length {
    let side = |k: usize| {
        let (least, most) = vertices.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), x| (least.min(x[k]), most.max(x[k])));
        most - least
    };
    let size = (0..3).map(side).fold(0.0, f64::max);
    let fits = |unit: Length| PERSON_CM.contains(&(size * unit.cm()));
    let units = [Length::Centimetre, Length::Millimetre, Length::Metre];
    let found = units.into_iter().find(|unit| fits(*unit));
    let size = short(size);
    match found {
        Some(Length::Centimetre) => {}
        Some(unit) => {
            let text =
                format!("the files of the rig name no unit and the body is {size} tall, {} assumed (say it with --unit)", unit.symbol());
            notes.add(Note::Assumed { text });
        }
        None => {
            let text = format!(
                "the files of the rig name no unit, cm assumed, but then the body is {size} cm tall, and what tracking expects is made for \
                 people of {} to {} cm (say the unit with --unit)",
                PERSON_CM.start(),
                PERSON_CM.end()
            );
            notes.add(Note::Assumed { text });
        }
    }
    found.unwrap_or(Length::Centimetre)
}

/// The states of the file as a pose.
fn start(skeleton: &Skeleton, unit: Length) -> Pose {
    let state = |joint: &formats::rig::Joint| {
        let [first, ..] = joint.state;
        let vector = Vec3::from(joint.state);
        match joint.kind {
            JointKind::Translate => State::Shift(vector * unit.cm()),
            JointKind::Revolute { .. } => State::Angle(first),
            JointKind::Ball => State::Rotation(UnitQuaternion::from_scaled_axis(vector)),
        }
    };
    Pose(skeleton.joints.iter().map(state).collect())
}

impl Rig {
    /// Names of the joints, which are those of the parts.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.skeleton.joints.iter().map(|joint| joint.name.as_str())
    }

    /// The upper half of a trunk that was given one, for what is told of the trunk as a whole.
    pub fn upper_half(&self, part: usize) -> Option<usize> {
        self.spine.filter(|[trunk, _]| *trunk == part).map(|[_, upper]| upper)
    }

    /// The joints that move a part of the surface.
    pub fn with_surface(&self) -> Vec<usize> {
        (0..self.body.surfaces.len()).filter(|&joint| !self.body.surfaces[joint].is_empty()).collect()
    }

    /// Which way is up: bodies are taller than thick, and where arms are stretched out they are so to the left and the right.
    pub fn up(&self) -> Direction {
        Direction { axis: upright(self.body.vertices.iter().map(|x| [x.x, x.y, x.z])), positive: true }
    }

    /// For each joint where its part ends in the reference pose: at the vertex that is farthest from the joint, cm.
    pub fn ends(&self) -> Vec<Option<Vec3>> {
        let links = self.body.tree.links.iter();
        let far = |centre: &Vec3, surface: &[u32]| {
            let places = surface.iter().map(|&vertex| self.body.vertices[vertex as usize]);
            places.max_by(|a, b| (a - centre).norm_squared().total_cmp(&(b - centre).norm_squared()))
        };
        links.zip(&self.body.surfaces).map(|(link, surface)| far(&link.centre, surface)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_by_the_size_of_the_body() {
        for (size, unit, noted) in [
            (175.0, Length::Centimetre, false),
            (1750.0, Length::Millimetre, true),
            (1.75, Length::Metre, true),
            (69.0, Length::Centimetre, true),
            (0.0, Length::Centimetre, true),
        ] {
            let notes = Notes::new();
            assert_eq!(likely_unit(&[[0.0, -size / 2.0, 1.0], [0.0, size / 2.0, 1.0]], &notes), unit, "{size}");
            assert_eq!(!notes.take().is_empty(), noted, "{size}");
        }
    }
}
