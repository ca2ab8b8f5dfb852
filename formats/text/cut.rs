//! Files that end in the middle of a row.
//!
//! Half a number is a number, so a file that was cut off must not be read as if it were whole.
//! A last line without a line end is such a cut if it lacks cells, if the header claims more rows, or if its last number has fewer decimals than all of its others have.

use super::NAME;
use super::lines::{Line, Lines, word};
use crate::{FormatError, Place};

/// What is known about the rows of a file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Whole {
    /// Separator of cells.
    pub separator: u8,
    /// Offset and number of the first row.
    pub first: (usize, u64),
    /// Cells of a whole row.
    pub cells: usize,
    /// Rows that the header claims.
    pub claimed: Option<u64>,
}

/// Refuses a file whose last row is not whole.
///
/// # Errors
/// The file ends in the middle of a row, or seems to.
pub(crate) fn refuse(bytes: &[u8], whole: Whole) -> Result<(), FormatError> {
    if matches!(bytes.last(), None | Some(b'\n' | b'\r')) {
        return Ok(());
    }
    let (mut rows, mut before, mut last) = (0u64, None, None);
    for line in Lines::resume(bytes, whole.first).filter(|l| !l.is_blank(whole.separator)) {
        rows += 1;
        before = last.replace(line);
    }
    let Some(last) = last else { return Ok(()) };
    let refuse = |why: String| {
        let text = format!("the file ends in the middle of this row: {why}; export the take again, or delete the row");
        Err(FormatError::malformed(NAME, Place::Line { line: last.number, column: None }, text))
    };
    let count = |line: Line<'_>| line.text.split(|&b| b == whole.separator).count();
    let cells = count(last);
    if cells < whole.cells {
        return refuse(format!("it has {cells} cells of {} and no line end", whole.cells));
    }
    if let Some(claimed) = whole.claimed.filter(|&claimed| claimed > rows) {
        return refuse(format!("it is row {rows} of {claimed} and has no line end"));
    }
    if let Some(full) = before.map(count).filter(|&full| full > cells && cells == whole.cells) {
        return refuse(format!("it has {cells} cells and no line end, the row before has {full}"));
    }
    let blank = |cell: &[u8]| cell.trim_ascii().is_empty();
    let mut from_end = last.text.rsplit(|&b| b == whole.separator);
    if cells == whole.cells && from_end.next().is_some_and(blank) && !from_end.next().is_some_and(blank) {
        return refuse("its last cell is empty, the one before is not, and there is no line end".to_owned());
    }
    let numbers: Vec<String> = last.text.split(|&b| b == whole.separator).skip(2).map(word).filter(|w| !w.is_empty()).collect();
    let decimals = |number: &String| number.rsplit_once(['.', ',']).map_or(0, |(_, decimals)| decimals.len());
    // only of a writer that pads its numbers can be told that one is too short
    if let Some((end, others)) = numbers.split_last()
        && let Some(usual) = others.first().map(decimals)
        && others.iter().all(|other| decimals(other) == usual)
        && decimals(end) < usual
    {
        let end = super::scan::excerpt(end);
        return refuse(format!("its last number is \"{end}\" and has no line end, all others have {usual} decimals"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn rows_that_are_whole_and_rows_that_are_not() {
        let check = |text: &str, claimed| {
            let whole = Whole { separator: b'\t', first: (0, 1), cells: 4, claimed };
            refuse(text.as_bytes(), whole).map_err(|e| e.to_string())
        };
        for (text, claimed, why) in [
            ("1\t0\t1.5\t2.5\n2\t0\t1.5\t2.5\n", Some(9), None), // a whole number of rows: the caller counts them
            ("1\t0\t1.5\t2.5\n2\t0\t1.5\t2.5", Some(2), None),
            ("1\t0\t1.5\t2.5\n2\t0\t1.5", Some(2), Some("it has 3 cells of 4 and no line end")),
            ("1\t0\t1.5\t2.5\n2\t0\t1.5\t2.5", Some(3), Some("it is row 2 of 3 and has no line end")),
            ("1\t0\t1.5\t2.5\t\n2\t0\t1.5\t2.5", None, Some("it has 4 cells and no line end, the row before has 5")),
            ("1\t0\t1.5\t2.5\n2\t0\t1.55\t2.5", None, Some("its last number is \"2.5\" and has no line end, all others have 2 decimals")),
            ("1\t0\t1.5\t2.5\n2\t0\t1.5\t", None, Some("its last cell is empty, the one before is not, and there is no line end")),
            ("1\t0\t1.5\t2.5\n2\t0\t\t", None, None),
            ("", Some(1), None),
        ] {
            let expected = why.map_or(Ok(()), |why| {
                Err(format!("text: the file ends in the middle of this row: {why}; export the take again, or delete the row (line 2)"))
            });
            assert_eq!(check(text, claimed), expected, "{text:?}");
        }
    }
}
