//! Samples that the user states to be missing, although the file holds something in their place.

use crate::input::plain;
use crate::pattern::matches;
use formats::{Role, Samples, Take};
use std::path::Path;

/// Why a statement cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MissingError {
    /// The table cannot be read.
    #[error("{path}: cannot be read: {problem}")]
    Table {
        /// The file.
        path: String,
        /// Why.
        problem: String,
    },
    /// A row of the table makes no sense.
    #[error("{path}: {problem} (line {line})")]
    Row {
        /// The file.
        path: String,
        /// Counted from 1.
        line: u64,
        /// What was found and expected.
        problem: String,
    },
    /// A pattern fits no marker.
    #[error("--missing {text} fits no marker; the take has {labels}")]
    NoSuchMarker {
        /// The statement.
        text: String,
        /// What the take has.
        labels: String,
    },
    /// Frames outside the take.
    #[error("--missing {text} names frames {first} to {last}, the take has {from} to {to}")]
    NoSuchFrames {
        /// The statement.
        text: String,
        /// First frame, the file's number.
        first: i64,
        /// Last frame, the file's number.
        last: i64,
        /// First frame of the take.
        from: i64,
        /// Last frame of the take.
        to: i64,
    },
}

/// Some frames of some markers.
struct Stretch {
    /// As it was stated, for messages.
    text: String,
    /// A label with or without prefix; `*` and `?` allowed.
    pattern: String,
    /// First and last frame, the file's numbers; `None` for all.
    frames: Option<(i64, i64)>,
}

/// True for a text that names a table, if it fits no marker.
pub(crate) fn names_table(text: &Path) -> bool {
    text.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) || text.is_file()
}

/// The samples that `texts` state to be missing from `take`. Each text is one of
///
/// - `MARKER`, `MARKER:FRAME` or `MARKER:FIRST-LAST`: patterns and the file's own frame numbers;
/// - the name of a CSV file with a header: `marker` and `frame`, or `marker`, `first_frame` and `last_frame`; other columns do not matter.
///
/// # Errors
/// The table cannot be read, or a statement fits nothing in the take.
pub fn resolve(texts: &[String], take: &Take) -> Result<Samples, MissingError> {
    let mut missing = Samples::new();
    let (from, to) = (take.frame_label(0), take.frame_label(take.frames().saturating_sub(1)));
    let labels: Vec<(usize, String)> =
        (0..take.markers.len()).filter(|&m| take.markers[m].role == Role::Marker).map(|m| (m, take.display_label(m))).collect();
    let fits = |pattern: &str, (column, label): &(usize, String)| matches(pattern, label) || matches(pattern, take.markers[*column].name());
    for text in texts {
        let whole = labels.iter().any(|label| fits(text, label));
        let stretches = if whole {
            vec![Stretch { text: text.clone(), pattern: text.clone(), frames: None }]
        } else if names_table(Path::new(text)) {
            table(text)?
        } else {
            vec![stretch(text)]
        };
        for Stretch { text, pattern, frames } in stretches {
            let (first, last) = frames.unwrap_or((from, to));
            if first > last || first < from || last > to {
                return Err(MissingError::NoSuchFrames { text, first, last, from, to });
            }
            let columns: Vec<usize> = labels.iter().filter(|label| fits(&pattern, label)).map(|(column, _)| *column).collect();
            if columns.is_empty() {
                let labels = labels.iter().map(|(_, label)| label.as_str()).collect::<Vec<_>>().join(", ");
                return Err(MissingError::NoSuchMarker { text, labels });
            }
            let meant = (0..take.frames()).filter(|&frame| (first..=last).contains(&take.frame_label(frame)));
            for frame in meant {
                for &column in &columns {
                    missing.insert(frame, column);
                }
            }
        }
    }
    Ok(missing)
}

/// `MARKER`, `MARKER:FRAME` or `MARKER:FIRST-LAST`. Labels may have colons, so only the last one counts, and only before numbers,
/// which may be negative.
fn stretch(text: &str) -> Stretch {
    let numbers = |frames: &str| -> Option<(i64, i64)> {
        let sign = frames.len() - frames.trim_start_matches('-').len();
        match frames.get(sign..)?.split_once('-') {
            Some((first, last)) => Some((frames.get(..sign + first.len())?.parse().ok()?, last.parse().ok()?)),
            None => frames.parse().ok().map(|frame| (frame, frame)),
        }
    };
    let split = text.rsplit_once(':').and_then(|(pattern, frames)| Some((pattern, numbers(frames)?)));
    let (pattern, frames) = split.map_or((text, None), |(pattern, frames)| (pattern, Some(frames)));
    Stretch { text: text.to_owned(), pattern: pattern.to_owned(), frames }
}

/// The rows of a table.
fn table(path: &str) -> Result<Vec<Stretch>, MissingError> {
    let unreadable = |problem: String| MissingError::Table { path: path.to_owned(), problem };
    let bytes = std::fs::read(path).map_err(|e| unreadable(plain(&e)))?;
    let head = bytes.split(|&b| b == b'\n').next().unwrap_or_default();
    let separator = [b',', b';', b'\t'].into_iter().find(|s| head.contains(s)).unwrap_or(b',');
    let mut reader = csv::ReaderBuilder::new().delimiter(separator).trim(csv::Trim::All).flexible(true).from_reader(bytes.as_slice());
    let header = reader.headers().map_err(|e| unreadable(e.to_string()))?.clone();
    let column = |name: &str| header.iter().position(|h| h.trim_start_matches('\u{feff}').eq_ignore_ascii_case(name));
    let frames = column("frame").map(|c| (c, c)).or_else(|| Some((column("first_frame")?, column("last_frame")?)));
    let (Some(marker), Some((first, last))) = (column("marker"), frames) else {
        let found = header.iter().take(6).collect::<Vec<_>>().join(", ");
        let problem = format!("the header is {found}; expected the columns marker and frame, or marker, first_frame and last_frame");
        return Err(MissingError::Row { path: path.to_owned(), line: 1, problem });
    };
    let mut stretches = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| unreadable(e.to_string()))?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |column: usize| record.get(column).and_then(|cell| cell.parse::<i64>().ok());
        let (Some(label), Some(first), Some(last)) = (record.get(marker).filter(|l| !l.is_empty()), number(first), number(last)) else {
            let problem = "a marker and its frame numbers were expected".to_owned();
            return Err(MissingError::Row { path: path.to_owned(), line, problem });
        };
        let text = format!("{path}, line {line},");
        stretches.push(Stretch { text, pattern: label.to_owned(), frames: Some((first, last)) });
    }
    Ok(stretches)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use formats::{Marker, TakeBuilder};

    fn take() -> Take {
        TakeBuilder::new(["s:LKNE", "RKNE", ""].map(Marker::new).to_vec(), 10, 100.0).first_frame(5).build()
    }

    fn resolved(texts: &[&str]) -> Result<Vec<(usize, usize)>, String> {
        let texts: Vec<String> = texts.iter().map(ToString::to_string).collect();
        resolve(&texts, &take()).map(|s| s.iter().collect()).map_err(|e| e.to_string())
    }

    #[test]
    fn markers_and_frames() {
        assert_eq!(resolved(&["s:LKNE:5-6", "RKNE:14", "#3:7"]), Ok(vec![(0, 0), (1, 0), (2, 2), (9, 1)]));
        assert_eq!(resolved(&["?KNE:5"]), Ok(vec![(0, 0), (0, 1)]));
        assert_eq!(resolved(&["s:LKNE"]).map(|s| s.len()), Ok(10));
        assert_eq!(resolved(&["s:5"]), Err("--missing s:5 fits no marker; the take has s:LKNE, RKNE, #3".into()));
        assert_eq!(resolved(&["LKNE:4-6"]), Err("--missing LKNE:4-6 names frames 4 to 6, the take has 5 to 14".into()));
        assert_eq!(resolved(&["LKNE:7-6"]), Err("--missing LKNE:7-6 names frames 7 to 6, the take has 5 to 14".into()));
        assert_eq!(resolved(&["WRI:7"]), Err("--missing WRI:7 fits no marker; the take has s:LKNE, RKNE, #3".into()));
    }

    #[test]
    fn labels_and_numbers_that_look_like_each_other() {
        let markers = ["Unlabeled:1034", "A"].map(Marker::new).to_vec();
        let take = TakeBuilder::new(markers, 4, 100.0).first_frame(-3).frame_step(10).build();
        let resolved = |text: &str| resolve(&[text.to_owned()], &take).map(|s| s.iter().collect::<Vec<_>>()).map_err(|e| e.to_string());
        assert_eq!(resolved("Unlabeled:1034").map(|s| s.len()), Ok(4));
        assert_eq!(resolved("A:-3"), Ok(vec![(0, 1)]));
        assert_eq!(resolved("A:-3-7"), Ok(vec![(0, 1), (1, 1)]));
        assert_eq!(resolved("A:7-20"), Ok(vec![(1, 1), (2, 1)]), "17 is the third frame");
        assert_eq!(resolved("not-there.csv"), Err("not-there.csv: cannot be read: no such file or folder".into()));
    }

    #[test]
    fn tables() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mask.csv").to_str().unwrap().to_owned();
        std::fs::write(&path, "Frame,marker,why\n5,RKNE,frozen\n6,RKNE,\n").unwrap();
        assert_eq!(resolved(&[&path]), Ok(vec![(0, 1), (1, 1)]));
        std::fs::write(&path, "marker,first_frame,last_frame\nRKNE,5,6\n").unwrap();
        assert_eq!(resolved(&[&path]), Ok(vec![(0, 1), (1, 1)]));
        std::fs::write(&path, "marker;frame\nRKNE;5\n").unwrap();
        assert_eq!(resolved(&[&path]), Ok(vec![(0, 1)]));
        std::fs::write(&path, "a,b\n1,2\n").unwrap();
        assert!(resolved(&[&path]).unwrap_err().contains("the header is a, b; expected the columns marker and frame"));
        std::fs::write(&path, "marker,frame\nRKNE,x\n").unwrap();
        assert!(resolved(&[&path]).unwrap_err().ends_with("mask.csv: a marker and its frame numbers were expected (line 2)"));
    }
}
