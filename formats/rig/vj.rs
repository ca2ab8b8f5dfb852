//! Parts: the joint that moves each vertex, one name in each line, in the order of the vertices of the surface.

use super::Skeleton;
use super::records::{names, written};
use super::words::{excerpt, without_mark, wrong};
use crate::note::listed;
use crate::text::scan::letters;
use crate::{FormatError, Place};
use std::io::{BufWriter, Write};

const NAME: &str = "vj";

/// Reads which joint moves which of so many vertices: places in [`Skeleton::joints`].
///
/// # Errors
/// Malformed: a vertex without a joint, a joint that is not in the skeleton, more or fewer lines than vertices. Empty lines at the end are none.
pub fn read_parts(bytes: &[u8], skeleton: &Skeleton, vertices: usize) -> Result<Vec<usize>, FormatError> {
    let names = names(skeleton);
    let mut parts = Vec::new();
    let mut empty: Option<u64> = None;
    let mut last = 0;
    for (line, text) in (1_u64..).zip(lines(without_mark(bytes))) {
        let text = text.trim_ascii();
        if text.is_empty() {
            empty = empty.or(Some(line));
            continue;
        }
        if let Some(line) = empty {
            let text =
                format!("the line is empty, so vertex {} has no joint; name the joint that moves it, nothing was skipped", parts.len());
            return Err(wrong(NAME, line, text));
        }
        if parts.len() == vertices {
            let text = format!("more lines than the {vertices} vertices of the surface; one line belongs to each vertex, in their order");
            return Err(wrong(NAME, line, text));
        }
        let Some(&joint) = names.get(&letters(text)) else {
            let known: Vec<&String> = names.keys().collect();
            let text = format!("\"{}\" is no joint of the skeleton, which has {}; correct the name", excerpt(text), listed(&known));
            return Err(wrong(NAME, line, text));
        };
        parts.push(joint);
        last = line;
    }
    if parts.len() < vertices {
        let text = format!(
            "the file ends after {} lines, but the surface has {vertices} vertices; vertex {} and those behind it have no joint that moves them",
            parts.len(),
            parts.len()
        );
        return Err(wrong(NAME, last.max(1), text));
    }
    Ok(parts)
}

/// Lines that end in any of three ways.
fn lines(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let length = rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(rest.len());
        let (line, behind) = rest.split_at_checked(length)?;
        rest = match behind {
            [b'\r', b'\n', behind @ ..] | [_, behind @ ..] => behind,
            [] => behind,
        };
        Some(line)
    })
}

/// Writes which joint moves which vertex; `parts` are places in [`Skeleton::joints`]. Names are spelled as
/// [`write_skeleton`](super::write_skeleton) spells them.
///
/// # Errors
/// Unsupported: a joint that is not there. Or an I/O error of `out`.
pub fn write_parts(parts: &[usize], skeleton: &Skeleton, out: &mut dyn Write) -> Result<(), FormatError> {
    let names = written(skeleton);
    let mut out = BufWriter::new(out);
    for &part in parts {
        let Some(name) = names.get(part) else {
            let text = format!("a vertex belongs to joint {part}, but there are {}, counted from 0", names.len());
            return Err(FormatError::unsupported(NAME, Place::Whole, text));
        };
        writeln!(out, "{name}").map_err(|e| FormatError::io(NAME, e))?;
    }
    out.flush().map_err(|e| FormatError::io(NAME, e))
}
