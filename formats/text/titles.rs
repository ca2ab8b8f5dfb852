//! Header lines that stand above each other: names, below them the axes, and possibly units.
//!
//! ```text
//! ,,S:LKNE,,,S:RKNE,,          names: once per marker, or above each of its columns
//! Frame,Sub Frame,X,Y,Z,X,Y,Z  axes
//! ,,mm,mm,mm,mm,mm,mm          units, if there are any
//! ```

use super::Column;
use super::scan::{Scanner, decode};
use crate::{FormatError, Marker, Role, Unit};

/// What the columns below such lines hold.
#[derive(Clone, Debug, Default)]
pub(crate) struct Titles {
    /// The markers, from left to right.
    pub markers: Vec<Marker>,
    /// What each column holds: coordinates, or something else.
    pub columns: Vec<Column>,
    /// How many of the last columns have neither name nor axis.
    pub nameless_tail: usize,
    /// The unit of length, if one is written.
    pub unit: Option<Unit>,
    /// For each marker, true if all its columns state a unit of length.
    lengths: Vec<bool>,
    /// True if different columns have different units.
    pub units_differ: bool,
    /// A unit that is written and that we do not know.
    pub unknown_unit: Option<String>,
}

/// Finds the markers: neighbours X, Y, Z below one name, that is below a name and two blank cells or below the same name three times.
///
/// `units` may be empty. Columns in a unit that is an angle, a force or the like are no coordinates.
pub(crate) fn understand(names: &[String], axes: &[String], units: &[String]) -> Titles {
    let cell = |cells: &[String], at: usize| cells.get(at).map_or(String::new(), |c| c.trim().to_owned());
    let width = axes.len();
    let mut titles = Titles { columns: vec![Column::Other; width], ..Titles::default() };
    titles.nameless_tail = (0..width).rev().take_while(|&i| cell(axes, i).is_empty() && cell(names, i).is_empty()).count();
    let mut at = 0;
    while at < width {
        let name = names.get(at).cloned().unwrap_or_default();
        let below = |i: usize| cell(names, i).is_empty() || cell(names, i) == name.trim();
        let is_triple = (0..3).all(|axis| axis_of(&cell(axes, at + axis)) == Some(axis)) && below(at + 1) && below(at + 2);
        let written: Vec<String> = (at..at + 3).map(|i| cell(units, i)).collect();
        if !is_triple || written.iter().any(|u| is_no_length(u)) {
            at += 1;
            continue;
        }
        for word in written.iter().filter(|u| !u.is_empty()) {
            match Unit::parse(word) {
                Some(unit) => {
                    titles.units_differ |= titles.unit.is_some_and(|u| u != unit);
                    titles.unit = titles.unit.or(Some(unit));
                }
                None => titles.unknown_unit = titles.unknown_unit.take().or_else(|| Some(word.clone())),
            }
        }
        for axis in 0..3 {
            if let Some(column) = titles.columns.get_mut(at + axis) {
                *column = Column::Coordinate { marker: titles.markers.len(), axis };
            }
        }
        titles.markers.push(Marker::new(name));
        titles.lengths.push(written.iter().all(|u| Unit::parse(u).is_some()));
        at += 3;
    }
    titles.units_differ |= titles.unit.is_some() && titles.unknown_unit.is_some();
    titles
}

impl Titles {
    /// Gives a column a meaning, unless it holds a coordinate.
    pub fn set(&mut self, at: usize, meaning: Column) {
        if let Some(column @ Column::Other) = self.columns.get_mut(at) {
            *column = meaning;
        }
    }

    /// Marks what [`is_model_output`] takes for a model output, unless it is a length, as its unit says; how many there are.
    pub fn mark_model_outputs(&mut self) -> usize {
        let outputs = self.markers.iter_mut().zip(&self.lengths).filter(|(m, length)| !**length && is_model_output(&m.label));
        outputs.map(|(m, _)| m.role = Role::ModelOutput).count()
    }
}

/// 0, 1, 2 for X, Y, Z in either case.
pub(crate) fn axis_of(text: &str) -> Option<usize> {
    ["x", "y", "z"].iter().position(|axis| text.eq_ignore_ascii_case(axis))
}

/// True for units of other things than lengths: angles, forces, velocities and the like.
fn is_no_length(unit: &str) -> bool {
    let word = unit.to_ascii_lowercase();
    word.contains(['/', '.', '*', '^', '°', 'º', '²'])
        || ["deg", "rad", "n", "nm", "nmm", "w", "v", "mv", "degrees", "volts"].contains(&word.as_str())
}

/// True for names of joint angles, forces and the like as Plug-in Gait writes them: not markers, although they come in threes.
pub(crate) fn is_model_output(label: &str) -> bool {
    let label = label.to_ascii_lowercase();
    ["angle", "force", "moment", "power"].iter().any(|kind| label.strip_suffix('s').unwrap_or(&label).ends_with(kind))
}

/// All cells of the next row, as a person reads them.
///
/// # Errors
/// Quotes that make no sense.
pub(crate) fn row(scanner: &mut Scanner<'_>) -> Result<Vec<String>, FormatError> {
    let mut cells = Vec::new();
    loop {
        let cell = scanner.cell()?;
        cells.push(decode(&cell));
        if cell.ends_row {
            return Ok(cells);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(line: &str) -> Vec<String> {
        line.split(',').map(str::to_owned).collect()
    }

    #[test]
    fn markers_stand_above_their_axes() {
        for (names, axes, units, expected) in [
            (",,S:A,,,S:B,,", "Frame,Sub Frame,X,Y,Z,X,Y,Z", ",,mm,mm,mm,mm,mm,mm", &["S:A", "S:B"][..]),
            (" A,,, B,,,", "X,Y,Z,X,Y,Z", "", &[" A", " B"]), // the scanner has trimmed what stands without quotes
            ("A,A,A,B,B,B", "x,y,z,x,y,z", "", &["A", "B"]),
            ("A,,,,B,,", "X,Y,Z,Q,X,Y,Z", "", &["A", "B"]),
            ("A,,,B,,", "X,Y,Z,X,Y,Z", "mm,mm,mm,deg,deg,deg", &["A"]),
            ("A,,,,,,B,,", "X,Y,Z,X',Y',Z',X,Y,Z", "mm,mm,mm,mm/s,mm/s,mm/s,mm,mm,mm", &["A", "B"]),
            (",,,A,,", "X,Y,Z,X,Y,Z", "", &["", "A"]),
            ("A,B,C", "X,Y,Z", "", &[]), // three things with an axis each
            ("A,,", "X,Z,Y", "", &[]),
        ] {
            let titles = understand(&cells(names), &cells(axes), &cells(units));
            let labels: Vec<&str> = titles.markers.iter().map(|m| m.label.as_str()).collect();
            assert_eq!(labels, expected, "{names}");
        }
    }

    #[test]
    fn units_and_tails() {
        let titles = understand(&cells("A,,,B,,,,"), &cells("X,Y,Z,X,Y,Z,,"), &cells("mm,mm,mm,m,m,m"));
        assert_eq!((titles.unit, titles.units_differ, titles.nameless_tail), (Some(Unit::Millimetre), true, 2));
        let titles = understand(&cells("A,,,B,,"), &cells("X,Y,Z,X,Y,Z"), &cells("mm,mm,mm,ell,ell,ell"));
        assert!(titles.units_differ);
        let titles = understand(&cells("A,,"), &cells("X,Y,Z"), &cells("furlong,furlong,furlong"));
        assert_eq!((titles.unit, titles.unknown_unit.as_deref(), titles.markers.len()), (None, Some("furlong"), 1));
    }
}
