//! Tables that are not ours, told apart so that they are refused by name instead of misread.

use super::NAME;
use crate::text::scan::{Scanner, decode};
use crate::{FormatError, Place};

/// How many lines are looked at.
const LINES: usize = 20;
/// How many cells of each line are looked at.
const CELLS: usize = 64;

/// A table that we do not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Foreign {
    /// What it seems to be.
    seems: &'static str,
    /// The way out.
    instead: &'static str,
    /// True if it is read under another name.
    elsewhere: bool,
}

/// The usual way out.
const AS_C3D: &str = "export the take as C3D, or as a table with the one header line NAME-x, NAME-y, NAME-z, ...";

impl Foreign {
    /// The error that refuses the file.
    pub fn refuse(self) -> FormatError {
        let but = if self.elsewhere { "which is another format" } else { "which is not read" };
        FormatError::unsupported(NAME, Place::Whole, format!("this seems to be {}, {but}; {}", self.seems, self.instead))
    }
}

/// Names the flavour of a table that is none of ours, from its beginning.
pub(super) fn recognise(bytes: &[u8]) -> Option<Foreign> {
    let foreign = |seems, instead| Some(Foreign { seems, instead, elsewhere: false });

    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return foreign("text in UTF-16", "save it as UTF-8 (\"CSV UTF-8\" in Excel)");
    }
    let lines = first_lines(bytes);
    let cell = |line: usize, column: usize| lines.get(line).and_then(|l| l.get(column)).map_or("", String::as_str);
    let numeric = |text: &str| text.replace(',', ".").parse::<f64>().is_ok_and(f64::is_finite);
    let elsewhere = |seems, instead| Some(Foreign { seems, instead, elsewhere: true });
    match cell(0, 0) {
        "Format Version" => return foreign("a CSV export of OptiTrack Motive", AS_C3D),
        "PathFileType" => return elsewhere("an OpenSim TRC file", "name it .trc"),
        "NO_OF_FRAMES" | "FILE_VERSION" => return elsewhere("a TSV export of Qualisys Track Manager", "name it .tsv"),
        "HIERARCHY" => return foreign("a BVH file", "name it .bvh"),
        "Trajectories" | "Model Outputs" | "Joints" | "Segments" | "Devices" if numeric(cell(1, 0)) => {
            return foreign("an ASCII export of Vicon Nexus", AS_C3D);
        }
        _ => {}
    }
    if (0..LINES).any(|line| cell(line, 0) == "TRAJECTORIES") {
        return foreign("a CSV export of Vicon Workstation", AS_C3D);
    }
    let axes = |line: usize| {
        let all: Vec<&str> = lines.get(line).into_iter().flatten().map(String::as_str).filter(|c| !c.is_empty()).collect();
        let rest = all.strip_prefix(&["Frame", "Sub Frame"]).or_else(|| all.strip_prefix(&["Frame", "Time"])).unwrap_or(&all);
        let rest = rest.strip_prefix(&["Frame"]).unwrap_or(rest);
        rest.len() >= 3 && rest.chunks_exact(3).all(|c| matches!(c, ["X" | "x", "Y" | "y", "Z" | "z"]))
    };
    if axes(1) && !axes(0) {
        return foreign("a table with two header lines, marker names above X, Y, Z", "join them to one: NAME-x, NAME-y, NAME-z, ...");
    }
    let first: Vec<&String> = lines.first().into_iter().flatten().filter(|c| !c.is_empty()).collect();
    let numbers = first.iter().filter(|c| numeric(c)).count();
    if numbers >= 2 && first.iter().all(|c| numeric(c) || c.eq_ignore_ascii_case("nan")) {
        return foreign("a table without a header line (its first line holds numbers only)", "add one: NAME-x, NAME-y, NAME-z, ...");
    }
    None
}

/// The separator that the first line seems to have: tabs and semicolons are rare inside cells, commas may be decimal signs.
pub(super) fn likely_separator(bytes: &[u8]) -> u8 {
    let line = bytes.split(|&b| b == b'\n' || b == b'\r').find(|l| !l.is_empty()).unwrap_or_default();
    [b'\t', b';'].into_iter().find(|separator| line.contains(separator)).unwrap_or(b',')
}

/// The first cells of the first lines that are not empty, under the separator that seems right for each.
fn first_lines(bytes: &[u8]) -> Vec<Vec<String>> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    text.split(|&b| b == b'\n' || b == b'\r')
        .filter(|line| !line.trim_ascii().is_empty())
        .take(LINES)
        .map(|line| {
            let mut scanner = Scanner::new(line, likely_separator(line));
            let mut cells = Vec::new();
            while let Ok(cell) = scanner.cell() {
                cells.push(decode(&cell));
                if cell.ends_row || cells.len() >= CELLS {
                    break;
                }
            }
            cells
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flavours_by_name() {
        for (text, expected) in [
            ("\u{feff}Format Version,1.25,Take Name,x\n", Some("Motive")),
            ("Trajectories\n100\n,,A:B,,\nFrame,Sub Frame,X,Y,Z\n", Some("Nexus")),
            ("Title,,\nDate:,,\n\nTRAJECTORIES,,\n100,Hz\n", Some("Workstation")),
            ("PathFileType\t4\t(X/Y/Z)\tx.trc\n", Some("TRC")),
            ("NO_OF_FRAMES\t3\nNO_OF_CAMERAS\t8\n", Some("Qualisys")),
            (" WRA,,, WRB,,\nX,Y,Z,X,Y,Z\n1,2,3,4,5,6\n", Some("two header lines")),
            ("1.5,2.5,NaN\n1.5,2.5,3\n", Some("without a header")),
            ("1,5;2,5;3\n", Some("without a header")),
            ("A-x,A-y,A-z\n1,2,3\n", None),
            ("frame,marker,x,y,z\n1,X,3,4,5\n", None),
            ("", None),
        ] {
            let found = recognise(text.as_bytes()).map(|f| f.refuse().to_string());
            assert_eq!(found.is_some(), expected.is_some(), "{text}");
            assert!(found.unwrap_or_default().contains(expected.unwrap_or_default()), "{text}");
        }
        assert!(recognise(b"\xff\xfea\0").is_some());
    }
}
