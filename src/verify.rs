//! Holds what was written against the promises, before anybody can see it.
//!
//! The written bytes are opened again as a stranger would open them.
//! Frame count, rate and what each column is must be those of the take, and in a patched file every name; every sample that was known must come back exactly (or, in another format, as near as that format
//! can say); every filled sample must be there; and nothing else may have appeared.
//!
//! Where samples depend on each other, as joints on the angles of others, those of a frame in which something was filled come back as near as the opened
//! document says ([`Leeway`]); those of all other frames exactly.

use formats::{Document, Format, Leeway, Notes, Origin, Role, Stated, Take};

/// A promise that the written file does not keep.
#[derive(Debug, thiserror::Error)]
#[error("the written file does not keep what was promised: {0}; nothing was put in place, please report this")]
pub struct Broken(pub(crate) String);

/// By how much of the unit a new file may move a sample away from 0 0 0.
const NOT_THE_ORIGIN: f64 = 1.01e-6;

/// Opens `written` with `format` and compares it with the repaired take.
/// Returns the written file, opened.
///
/// `patched` is what the opened document allows ([`Document::leeway`]) if its bytes were patched; `None` if a new file of another format was made.
///
/// # Errors
/// The first difference, or that the file does not open.
pub fn verify(
    written: Vec<u8>,
    format: &dyn Format,
    stated: &Stated,
    repaired: &Take,
    patched: Option<Leeway>,
) -> Result<Box<dyn Document>, Broken> {
    let notes = Notes::new();
    let document = format.open(written, stated, &notes).map_err(|e| Broken(format!("it does not open ({e})")))?;
    compare(document.as_ref(), repaired, patched, format.info().holds_gaps)?;
    Ok(document)
}

fn compare(document: &dyn Document, repaired: &Take, patched: Option<Leeway>, holds_gaps: bool) -> Result<(), Broken> {
    let same_format = patched.is_some();
    let take = document.take();
    let broken = |text: String| Err(Broken(text));
    if take.frames() != repaired.frames() {
        return broken(format!("{} frames instead of {}", take.frames(), repaired.frames()));
    }
    // a format without model outputs leaves their columns out, and says so in a note
    let all: Vec<usize> = (0..repaired.markers.len()).collect();
    let markers_only = || all.iter().copied().filter(|&m| repaired.markers.get(m).is_some_and(|k| k.role == Role::Marker)).collect();
    let columns: Vec<usize> = if same_format || take.markers.len() == all.len() { all.clone() } else { markers_only() };
    if take.markers.len() != columns.len() {
        return broken(format!("{} markers instead of {}", take.markers.len(), columns.len()));
    }
    if same_format && take.markers != repaired.markers {
        return broken("the labels differ".to_owned());
    }
    if let Some(column) = (0..columns.len())
        .find(|&c| take.markers.get(c).map(|m| m.role) != columns.get(c).and_then(|&m| repaired.markers.get(m)).map(|m| m.role))
    {
        return broken(format!("column {} is a marker in one and a model output in the other", repaired.display_label(columns[column])));
    }
    // a rate that goes through a 32-bit float or a column of times is only as exact as those
    // and a single frame has none in a column of times, which whoever wrote it noted
    let timed = same_format || repaired.frames() > 1;
    if timed && (take.rate_hz - repaired.rate_hz).abs() > 1e-3 * repaired.rate_hz.abs() {
        return broken(format!("{} Hz instead of {}", take.rate_hz, repaired.rate_hz));
    }
    // a new file may have to move what is at exactly 0 0 0 by a millionth of its unit, or it would read as missing
    let rounding_mm = if same_format { document.rounding_mm() } else { document.rounding_mm().max(NOT_THE_ORIGIN * take.unit.mm()) };
    for frame in 0..repaired.frames() {
        let changed = (0..repaired.markers.len()).any(|m| repaired.origin(frame, m) == Origin::Repaired);
        for (column, &marker) in columns.iter().enumerate() {
            let (is, was) = (take.position_mm(frame, column), repaired.position_mm(frame, marker));
            let origin = repaired.origin(frame, marker);
            let allowed_mm = match patched {
                None => rounding_mm,
                Some(leeway) if origin == Origin::Repaired => leeway.filled_mm,
                Some(leeway) => {
                    if changed {
                        leeway.known_mm
                    } else {
                        0.0
                    }
                }
            };
            let exact = same_format && origin.is_known() && allowed_mm == 0.0;
            let kept = match (is, was) {
                (None, None) => true,
                (Some(is), Some(was)) => (0..3).all(|k| if exact { is[k] == was[k] } else { near(is[k], was[k], allowed_mm) }),
                // a format that cannot say that something is missing has to put something there
                (Some(_), None) => !holds_gaps,
                (None, Some(_)) => false,
            };
            if !kept {
                return broken(format!(
                    "marker {}, frame {}: {} sample {} comes back as {}",
                    repaired.display_label(marker),
                    repaired.frame_label(frame),
                    kind(origin),
                    show(was),
                    show(is)
                ));
            }
        }
    }
    Ok(())
}

/// Equal up to the rounding of the format and of a 32-bit float.
fn near(is: f64, was: f64, rounding_mm: f64) -> bool {
    (is - was).abs() <= rounding_mm * (1.0 + 1e-9) + 1.2e-7 * was.abs()
}

fn kind(origin: Origin) -> &'static str {
    match origin {
        Origin::Measured => "the measured",
        Origin::Derived => "the derived",
        Origin::Missing => "the missing",
        Origin::Repaired => "the filled",
    }
}

fn show(position: Option<[f64; 3]>) -> String {
    position.map_or_else(|| "missing".to_owned(), |[x, y, z]| format!("({x}, {y}, {z}) mm"))
}
