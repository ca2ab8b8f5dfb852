//! Whether a take is in the unit that it is read in: the body that wears its markers has a size.

use super::Rig;
use super::map::Worn;
use crate::input::{Opened, Reading};
use crate::repair::RepairError;
use crate::solve::ik::Vec3;
use formats::{Note, Take, Unit};
use std::path::Path;

/// Markers that are spread so many times as far as on the body, or so many times less, are not those of the body. Who curls up halves the spread.
const MOST_TIMES: f64 = 3.0;
/// Frames that are looked at, at most.
const FRAMES: usize = 200;
/// Markers that are spread less than this on the body tell nothing, cm.
const LEAST_CM: f64 = 5.0;

/// The unit in which the take has the size of the body, if that is another one than was assumed.
///
/// # Errors
/// The unit was stated, by the user or by the file, and cannot be; or there is none that can.
pub fn other_unit(rig: &Rig, worn: &Worn, opened: &Opened, path: &Path, reading: &Reading) -> Result<Option<Unit>, RepairError> {
    let take = opened.document.take();
    let Some((found_cm, expected_cm)) = spread(rig, worn, take) else { return Ok(None) };
    let now = reading.stated.unit.unwrap_or(take.unit);
    let fits = |unit: &Unit| (1.0 / MOST_TIMES..=MOST_TIMES).contains(&(found_cm / expected_cm * unit.mm() / now.mm()));
    if fits(&now) {
        return Ok(None);
    }
    let other = Unit::ALL.into_iter().find(fits);
    if reading.stated.unit.is_none() && other.is_some() && assumed(opened) {
        return Ok(other);
    }
    let way = other.map_or_else(
        || "say the unit of the body with --unit, or give the map of this take".to_owned(),
        |unit| format!("say --units {}, or the unit of the body with --unit", unit.symbol()),
    );
    let problem = format!(
        "its markers are {found_cm:.1} cm from their middle (read as {}), and {expected_cm:.1} cm are expected of this body; {way}",
        now.symbol()
    );
    Err(RepairError::Io { path: path.to_owned(), problem })
}

/// What there is to say about a unit that was found that way.
pub fn note(unit: Unit) -> Note {
    let text = format!(
        "the file names no unit, {} assumed, because the markers have the size of the body then (say it with --units)",
        unit.symbol()
    );
    Note::Assumed { text }
}

/// True if nobody said the unit.
fn assumed(opened: &Opened) -> bool {
    let notes = opened.notes.take();
    let assumed = notes.iter().any(|note| matches!(note, Note::UnitAssumed { .. } | Note::UnitUnknown { .. }));
    for note in notes {
        opened.notes.add(note);
    }
    assumed
}

/// How far markers are from their middle, root mean square: in the frame in the middle by that, and of the same markers on the body in the
/// reference pose, cm.
fn spread(rig: &Rig, worn: &Worn, take: &Take) -> Option<(f64, f64)> {
    let places: Vec<Vec3> = worn
        .markers
        .iter()
        .zip(&worn.somewhere)
        .map(|((_, _, marker, _), somewhere)| {
            let surface = &rig.body.surfaces[marker.part];
            if !*somewhere || surface.is_empty() {
                return marker.place();
            }
            surface.iter().map(|&vertex| rig.body.vertices[vertex as usize]).sum::<Vec3>() / surface.len() as f64
        })
        .collect();
    let every = take.frames().div_ceil(FRAMES).max(1);
    let of_frame = |frame: usize| {
        let seen = worn.markers.iter().zip(&places).filter(|((.., weight), _)| *weight > 0.0);
        let seen = seen.filter_map(|((column, ..), place)| Some((Vec3::from(take.position_mm(frame, *column)?) / 10.0, *place)));
        let (seen, on_body): (Vec<Vec3>, Vec<Vec3>) = seen.unzip();
        let (found, expected) = (radius(&seen), radius(&on_body));
        (expected > LEAST_CM).then_some((found, expected))
    };
    let mut all: Vec<(f64, f64)> = (0..take.frames()).step_by(every).filter_map(of_frame).collect();
    all.sort_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)));
    all.get(all.len() / 2).copied()
}

/// The root mean square distance of points from their middle.
fn radius(points: &[Vec3]) -> f64 {
    let count = points.len().max(1) as f64;
    let middle = points.iter().sum::<Vec3>() / count;
    (points.iter().map(|x| (x - middle).norm_squared()).sum::<f64>() / count).sqrt()
}
