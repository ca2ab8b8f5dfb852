//! Where markers sit on a body: a table of markers, vertices and joints, and which columns of a take it means.

use super::Rig;
use crate::solve::ik::Vec3;
use crate::solve::ik::terms::Marker;
use formats::{Role, Take};

/// Why a table of markers cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// Something is wrong in a line.
    #[error("line {line}: {problem}")]
    Line {
        /// Counted from 1.
        line: u64,
        /// What was found and what was expected.
        problem: String,
    },
    /// There are no markers in it.
    #[error("no marker was found, expected the header marker,vertex,joint and a line for each marker")]
    Empty,
    /// Labels name no joints.
    #[error(
        "no marker has a label that begins with the name of a joint ({joints}); the take has {known}; say with --map which joint moves which marker"
    )]
    Labels {
        /// What the take has.
        known: String,
        /// What the skeleton has.
        joints: String,
    },
    /// It is not known where markers sit.
    #[error("only the joint is told of {known}, not where they sit on its part; --calibrate finds that, or add vertices")]
    Somewhere {
        /// Which.
        known: String,
    },
    /// Too little is seen to find out where markers sit.
    #[error(
        "there is no frame in which markers of three parts are seen, so it cannot be found where they sit; give --map with their vertices"
    )]
    TooFew,
    /// None of its markers is in the take.
    #[error("none of its markers is in the take; the first one is {first}, the take has {known}")]
    Strange {
        /// The first marker of the table.
        first: String,
        /// What the take has.
        known: String,
    },
}

/// A marker of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// As the table writes it.
    pub label: String,
    /// Where it sits.
    pub marker: Marker,
    /// What the weight of its samples is multiplied by; 0 leaves it out.
    pub weight: f64,
    /// True if only the joint is told: where the marker sits on its part has to be found.
    pub somewhere: bool,
    line: u64,
}

/// The columns of the table; the first is always there, and one of the next two.
const COLUMNS: [&str; 7] = ["marker", "vertex", "joint", "x", "y", "z", "weight"];

/// Reads a table. The header names its columns in any order: `marker`, `vertex` (from 0, as in the surface's file) or `joint` or both, and besides `x`, `y`, `z`
/// and `weight`. An offset `x`, `y`, `z` leads from the vertex to the marker, in the unit and the axes of the rig; without a vertex it is the marker's
/// place in the reference pose. With a joint alone, it is somewhere on that joint's part. Without a joint the marker moves with the vertex, and a joint overrules that. Empty lines and lines that start
/// with `#` are skipped.
///
/// # Errors
/// A line that is not of this form, an unknown joint or vertex, a marker that is there twice, or none at all.
pub fn read_map(text: &[u8], rig: &Rig) -> Result<Vec<Placed>, MapError> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).comment(Some(b'#')).trim(csv::Trim::All).from_reader(text);
    let mut header: Option<[Option<usize>; 7]> = None;
    let mut placed: Vec<Placed> = Vec::new();
    for (at, record) in reader.records().enumerate() {
        let record = record.map_err(|e| MapError::Line {
            line: e.position().map_or(at as u64 + 1, csv::Position::line),
            problem: "not text in CSV form, expected: marker,vertex,joint".to_owned(),
        })?;
        let line = record.position().map_or(at as u64 + 1, csv::Position::line);
        let wrong = |problem: String| MapError::Line { line, problem };
        let Some(header) = &header else {
            header = Some(columns(&record).map_err(wrong)?);
            continue;
        };
        let cell = |column: usize| header[column].and_then(|at| record.get(at)).filter(|cell| !cell.is_empty());
        if record.iter().all(str::is_empty) {
            continue;
        }
        let most = header.iter().flatten().max().map_or(0, |last| last + 1);
        if record.len() > most {
            return Err(wrong(format!("{} cells found, the header has {most}", record.len())));
        }
        let marker = row(rig, cell).map_err(wrong)?;
        if let Some(before) = placed.iter().find(|before| before.label == marker.0) {
            return Err(wrong(format!("marker \"{}\" is in line {} already; delete one of them", marker.0, before.line)));
        }
        let (label, marker, weight, somewhere) = marker;
        placed.push(Placed { label, marker, weight, somewhere, line });
    }
    if placed.is_empty() { Err(MapError::Empty) } else { Ok(placed) }
}

/// Where each of the known columns is.
fn columns(header: &csv::StringRecord) -> Result<[Option<usize>; 7], String> {
    let mut found = [None; 7];
    for (at, cell) in header.iter().enumerate() {
        let Some(column) = COLUMNS.iter().position(|name| cell.trim_start_matches('\u{feff}').eq_ignore_ascii_case(name)) else {
            return Err(format!(
                "the header has a column \"{cell}\", expected are marker, vertex, joint, and if need be x, y, z and weight"
            ));
        };
        if found[column].replace(at).is_some() {
            return Err(format!("the header has the column {} twice", COLUMNS[column]));
        }
    }
    let lacks = |column: usize| Err(format!("the header has no column {}, expected: marker,vertex,joint", COLUMNS[column]));
    match found {
        [None, ..] => lacks(0),
        // either of them will do
        [_, None, None, ..] => lacks(1),
        _ => Ok(found),
    }
}

/// Label, place and weight of a row, and whether only the joint is told.
fn row<'a>(rig: &Rig, cell: impl Fn(usize) -> Option<&'a str>) -> Result<(String, Marker, f64, bool), String> {
    let number = |column: usize| match cell(column).map(str::parse::<f64>) {
        None => Ok(None),
        Some(Ok(x)) if x.is_finite() => Ok(Some(x)),
        Some(_) => Err(format!("{} \"{}\" is not a number", COLUMNS[column], cell(column).unwrap_or_default())),
    };
    let label = cell(0).ok_or("a row without a marker")?;
    let vertices = &rig.body.vertices;
    let vertex = match cell(1).map(|text| (text, text.parse::<usize>())) {
        None => None,
        Some((_, Ok(vertex))) if vertex < vertices.len() => Some(vertex),
        Some((text, Ok(_))) => return Err(format!("vertex {text} is not there, the surface has vertices 0 to {}", vertices.len() - 1)),
        Some((text, Err(_))) => return Err(format!("vertex \"{text}\" is not the number of a vertex")),
    };
    let offset = match [number(3)?, number(4)?, number(5)?] {
        [Some(x), Some(y), Some(z)] => Some(Vec3::new(x, y, z) * rig.unit.cm()),
        [None, None, None] => None,
        _ => return Err("only some of x, y and z are given; give all of them, or none".to_owned()),
    };
    let joint = match cell(2) {
        None => None,
        Some(name) => match rig.names().position(|joint| joint == name) {
            None => return Err(format!("joint \"{name}\" is not in the skeleton; it has {}", rig.names().collect::<Vec<_>>().join(", "))),
            joint => joint,
        },
    };
    let weight = match number(6)? {
        Some(weight) if weight < 0.0 => return Err(format!("weight {weight} is below 0")),
        weight => weight.unwrap_or(1.0),
    };
    let (part, at, offset) = match (vertex, offset) {
        (Some(vertex), offset) => {
            let part = rig.body.parts[vertex];
            // maps are written for rigs without a spine
            let joint = joint.filter(|&joint| rig.upper_half(joint) != Some(part));
            (joint.unwrap_or(part), vertices[vertex], offset.unwrap_or_default())
        }
        (None, Some(place)) => {
            (joint.ok_or("neither a vertex nor a joint, so it is not known what moves the marker")?, place, Vec3::zeros())
        }
        (None, None) => {
            let part = joint.ok_or_else(|| format!("marker \"{label}\" has neither a vertex nor x, y and z, nor a joint"))?;
            (part, rig.body.tree.links[part].centre, Vec3::zeros())
        }
    };
    let somewhere = cell(1).is_none() && cell(3).is_none();
    Ok((label.to_owned(), Marker { part, vertex: at, offset }, weight, somewhere))
}

/// The markers of a table that a take has.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Worn {
    /// For each of them its column in the take, its label there, where it sits, and the factor of its weights; in the order of the take.
    pub markers: Vec<(usize, String, Marker, f64)>,
    /// For each of them, whether only its part is known, and not where it sits there.
    pub somewhere: Vec<bool>,
    /// Markers of the table that the take does not have.
    pub absent: Vec<String>,
    /// Markers of the take that the table does not have.
    pub strangers: Vec<String>,
}

/// Finds the markers of a table in a take. A label matches as written or without its subject's prefix.
///
/// # Errors
/// A label fits several markers, a marker is there twice, or none is there.
pub fn wear(placed: &[Placed], take: &Take) -> Result<Worn, MapError> {
    let markers: Vec<usize> = (0..take.markers.len()).filter(|&m| take.markers[m].role == Role::Marker).collect();
    let known = |columns: &[usize]| columns.iter().map(|&m| take.display_label(m)).collect::<Vec<_>>().join(", ");
    let mut worn = Worn::default();
    let mut lines: Vec<Option<u64>> = vec![None; take.markers.len()];
    let mut somewhere = vec![false; take.markers.len()];
    for Placed { label, marker, weight, somewhere: part_only, line } in placed {
        let wrong = |problem: String| Err(MapError::Line { line: *line, problem });
        let fitting = |fits: &dyn Fn(usize) -> bool| markers.iter().copied().filter(|&m| fits(m)).collect::<Vec<_>>();
        let mut fits = fitting(&|m| take.markers[m].label == *label);
        if fits.is_empty() {
            fits = fitting(&|m| take.markers[m].name() == label);
        }
        match fits[..] {
            [] => worn.absent.push(label.clone()),
            [column] => {
                if let Some(before) = lines[column].replace(*line) {
                    return wrong(format!("marker \"{label}\" of the take is in line {before} already; delete one of them"));
                }
                somewhere[column] = *part_only;
                worn.markers.push((column, take.display_label(column), *marker, *weight));
            }
            _ => return wrong(format!("marker \"{label}\" may be each of {}; write its whole label", known(&fits))),
        }
    }
    if worn.markers.is_empty() {
        return Err(MapError::Strange { first: worn.absent.swap_remove(0), known: known(&markers) });
    }
    worn.markers.sort_by_key(|(column, ..)| *column);
    worn.somewhere = worn.markers.iter().map(|(column, ..)| somewhere[*column]).collect();
    worn.strangers = markers.iter().filter(|&&m| lines[m].is_none()).map(|&m| take.display_label(m)).collect();
    Ok(worn)
}

/// The markers of a take whose labels begin with the name of a joint (the longest such name counts): each is somewhere on that joint's part.
///
/// # Errors
/// There are none.
pub fn wear_by_labels(rig: &Rig, take: &Take) -> Result<Worn, MapError> {
    let mut worn = Worn::default();
    for column in (0..take.markers.len()).filter(|&m| take.markers[m].role == Role::Marker) {
        let label = take.markers[column].name().to_ascii_lowercase();
        let begins = |joint: &str| label.starts_with(&joint.to_ascii_lowercase());
        let part = rig.names().enumerate().filter(|(_, joint)| begins(joint)).max_by_key(|(_, joint)| joint.len());
        match part {
            Some((part, _)) => {
                let marker = Marker { part, vertex: rig.body.tree.links[part].centre, offset: Vec3::zeros() };
                worn.markers.push((column, take.display_label(column), marker, 1.0));
                worn.somewhere.push(true);
            }
            None => worn.strangers.push(take.display_label(column)),
        }
    }
    if worn.markers.is_empty() {
        let joints = rig.names().collect::<Vec<_>>().join(", ");
        return Err(MapError::Labels { known: worn.strangers.join(", "), joints });
    }
    Ok(worn)
}
