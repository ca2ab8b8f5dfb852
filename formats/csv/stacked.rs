//! A table with two header lines: names above X, Y, Z; possibly units in a third.
//!
//! ```text
//! frame,time (s),WRA,,,WRB,,       frame and time may stand in either line
//! ,,X,Y,Z,X,Y,Z
//! ,,mm,mm,mm,mm,mm,mm
//! ```

use super::header::{Header, Name, SEPARATORS, Shape};
use crate::Unit;
use crate::text::scan::Scanner;
use crate::text::titles::{self, row};
use crate::text::{Column, Sheet};

/// The header of such a table, if the first two lines that are not empty make one.
/// `bytes` may be cut off, for a first impression.
pub(super) fn read(bytes: &[u8]) -> Option<Header> {
    SEPARATORS.iter().find_map(|&separator| with_separator(bytes, separator))
}

fn with_separator(bytes: &[u8], separator: u8) -> Option<Header> {
    let mut scanner = Scanner::new(bytes, separator);
    scanner.skip_blank_lines();
    let names = row(&mut scanner).ok()?;
    // Axes above axes are no names.
    if names.iter().filter(|n| titles::axis_of(n).is_some()).count() > 2 {
        return None;
    }
    let axes = row(&mut scanner).ok()?;
    let mut ahead = scanner.clone();
    let units = row(&mut ahead).ok().filter(|cells| are_units(cells)).unwrap_or_default();
    let mut titles = titles::understand(&names, &axes, &units);
    if titles.markers.is_empty() || titles.markers.iter().any(|m| m.label.is_empty()) {
        return None;
    }
    if !units.is_empty() {
        scanner = ahead;
    }
    titles.mark_model_outputs();
    let words: Vec<String> = (0..axes.len())
        .map(|at| {
            let cell = |cells: &[String]| cells.get(at).map_or(String::new(), |c| c.trim().to_owned());
            format!("{} {}", cell(&names), cell(&axes)).trim().to_owned()
        })
        .collect();
    let (mut time_unit_secs, mut framed, mut timed) = (None, false, false);
    for (at, word) in words.iter().enumerate().filter(|(at, _)| titles.columns.get(*at) == Some(&Column::Other)).collect::<Vec<_>>() {
        match Name::parse(word) {
            Name::Frame if !framed => {
                titles.set(at, Column::Frame);
                framed = true;
            }
            Name::Time { unit_secs } if !timed => {
                titles.set(at, Column::Time);
                (timed, time_unit_secs) = (true, unit_secs);
            }
            _ => {}
        }
    }
    let others = words.iter().zip(&titles.columns).filter(|(word, column)| **column == Column::Other && !word.is_empty());
    Some(Header {
        others: others.map(|(word, _)| word.clone()).collect(),
        shape: Shape::Wide,
        sheet: Sheet {
            separator,
            columns: titles.columns,
            nameless_tail: titles.nameless_tail,
            time_unit_secs,
            start: scanner.offset(),
            line: scanner.line(),
        },
        markers: titles.markers,
        unit: titles.unit,
        units_differ: titles.units_differ,
        odd_order: None,
        assumed: None,
    })
}

/// True for a line of units of length.
fn are_units(cells: &[String]) -> bool {
    let mut words = cells.iter().map(|c| c.trim()).filter(|c| !c.is_empty()).peekable();
    let some = words.peek().is_some();
    some && words.clone().any(|w| Unit::parse(w).is_some()) && words.all(|w| w.parse::<f64>().is_err())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::Role;

    fn outputs(header: &Header) -> usize {
        header.markers.iter().filter(|m| m.role == Role::ModelOutput).count()
    }

    #[test]
    fn two_and_three_lines() {
        for (text, labels, frame, time, unit) in [
            (" WRA,,, WRB,,\r\nX,Y,Z,X,Y,Z\r\n1,2,3,4,5,6\r\n", &["WRA", "WRB"][..], false, false, None),
            ("Frame;Time;A;;\n;;x;y;z\n;;m;m;m\n1;0;1;2;3\n", &["A"], true, true, Some(Unit::Metre)),
            ("\t\tA\tA\tA\nFrame#\tTime (ms)\tX\tY\tZ\n1\t0\t1\t2\t3\n", &["A"], true, true, None),
        ] {
            let header = read(text.as_bytes()).unwrap();
            assert_eq!(header.markers.iter().map(|m| m.label.as_str()).collect::<Vec<_>>(), labels, "{text}");
            assert_eq!((header.sheet.has(Column::Frame), header.sheet.has(Column::Time), header.unit), (frame, time, unit), "{text}");
            assert_eq!(outputs(&header), 0);
        }
        let header = read(b"A,,,LKneeAngles,,,EMG\nX,Y,Z,X,Y,Z,V\n").unwrap();
        assert_eq!((outputs(&header), header.others), (1, vec!["EMG V".to_owned()]));
    }

    #[test]
    fn other_tables() {
        for text in [
            "A-x,A-y,A-z\n1,2,3\n",
            "x,y,z,x,y,z\nX,Y,Z,X,Y,Z\n",
            ",,\nX,Y,Z\n",
            "A,B,C\nX,Y,Z\n",
            "frame,marker,x,y,z\n1,X,3,4,5\n",
            "A\n",
            "",
        ] {
            assert!(read(text.as_bytes()).is_none(), "{text}");
        }
    }
}
