//! What must hold for any bytes whatever: shared by the fuzz targets and by `tests/hostility`.
//!
//! A check returns what is wrong; panics, hangs and memory are for whoever calls it to notice.

use formats::rig::{self, Joint, JointKind, Skeleton};
use formats::{Document, Format, Notes, Origin, Role, Stated, Take};

/// Samples of a take per byte of its file, at most: a missing sample of a table costs two separators at least,
/// and a row of a long table may stand for 256 samples.
const SAMPLES_PER_BYTE: usize = 256;
/// ... and this many always.
const SAMPLES_ALWAYS: usize = 1_100_000;

/// Larger takes are not filled and converted: nothing new comes up in them, and fuzzing is to be fast.
const LARGEST_TAKE: usize = 4000;

/// Opens the bytes with every format, whether it wants them or not; what opens is saved unchanged.
pub fn open_any(bytes: &[u8]) -> Result<(), String> {
    // which one is found must not matter to whether it survives
    let _ = formats::detect(bytes.get(..bytes.len().min(4096)).unwrap_or(bytes), None);
    for format in formats::ALL {
        let name = format.info().name;
        let Ok(document) = format.open(bytes.to_vec(), &Stated::default(), &Notes::new()) else { continue };
        let take = document.take();
        let samples = take.frames().saturating_mul(take.markers.len());
        if samples > SAMPLES_ALWAYS.max(bytes.len().saturating_mul(SAMPLES_PER_BYTE)) {
            return Err(format!("{name}: {samples} samples from {} bytes", bytes.len()));
        }
        if saved(document.as_ref(), take)? != bytes {
            return Err(format!("{name}: saving unchanged changes the file"));
        }
    }
    Ok(())
}

fn saved(document: &dyn Document, take: &Take) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    document.save(take, &mut out, &Notes::new()).map_err(|e| format!("what was opened cannot be saved: {e}"))?;
    Ok(out)
}

/// Fills every gap of a file that opens, saves it, and opens it again: what was known is as it was, what was filled is there.
/// Then writes the take in every format, and opens that.
pub fn roundtrip(bytes: &[u8]) -> Result<(), String> {
    let Ok(format) = formats::detect(bytes.get(..bytes.len().min(4096)).unwrap_or(bytes), None) else { return Ok(()) };
    let name = format.info().name;
    let Ok(document) = format.open(bytes.to_vec(), &Stated::default(), &Notes::new()) else { return Ok(()) };
    let take = document.take();
    if take.frames().saturating_mul(take.markers.len()) > LARGEST_TAKE {
        return Ok(());
    }
    fills_and_saves(format, document.as_ref(), bytes).map_err(|e| format!("{name}: {e}"))?;
    goes_everywhere(take).map_err(|e| format!("{name} {e}"))
}

/// Writes the take in every format that can hold it, opens that, and compares.
pub fn goes_everywhere(take: &Take) -> Result<(), String> {
    for to in formats::ALL {
        let name = to.info().name;
        let mut out = Vec::new();
        if to.create(take, &mut out, &Notes::new()).is_err() {
            continue; // refused for a reason: no markers, no frames, coordinates that no number of the format can hold
        }
        let again = to.open(out, &Stated::default(), &Notes::new());
        let again = again.map_err(|e| format!("to {name}: what was written does not open: {e}"))?;
        same(take, again.take(), to.info().holds_gaps).map_err(|e| format!("to {name}: {e}"))?;
    }
    Ok(())
}

/// Holds a take against what a new file made of it holds: the same frames, and every marker where it was, as near as a 32-bit float is.
/// A format without model outputs leaves their columns out.
fn same(take: &Take, back: &Take, holds_gaps: bool) -> Result<(), String> {
    let markers: Vec<usize> = (0..take.markers.len()).filter(|&m| take.markers.get(m).is_some_and(|k| k.role == Role::Marker)).collect();
    let columns = if back.markers.len() == take.markers.len() { (0..take.markers.len()).collect() } else { markers };
    if (back.frames(), back.markers.len()) != (take.frames(), columns.len()) {
        return Err(format!("{} frames of {} markers become {} of {}", take.frames(), columns.len(), back.frames(), back.markers.len()));
    }
    for frame in 0..take.frames() {
        for (column, &marker) in columns.iter().enumerate() {
            let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-3 * take.unit.mm() + 2e-7 * a.abs();
            match (take.position_mm(frame, marker), back.position_mm(frame, column)) {
                (None, None) => {}
                (Some(was), Some(is)) if was.iter().zip(&is).all(near) => {}
                (None, Some(_)) if !holds_gaps => {}
                (was, is) => return Err(format!("sample {frame}, {marker}: {was:?} becomes {is:?}")),
            }
        }
    }
    Ok(())
}

fn fills_and_saves(format: &'static dyn Format, document: &dyn Document, bytes: &[u8]) -> Result<(), String> {
    let take = document.take();
    let mut filled = take.clone();
    let mut count = 0_usize;
    for frame in 0..take.frames() {
        for marker in 0..take.markers.len() {
            // inside what every format can store, and different in every cell
            let place = [count as f64 % 97.0 + 1.25, 2.5, -3.75].map(|x| x * take.unit.mm() / 10.0);
            count += usize::from(filled.fill(frame, marker, place));
        }
    }
    let mut out = Vec::new();
    let Ok(()) = document.save(&filled, &mut out, &Notes::new()) else { return Ok(()) };
    if count == 0 && out != bytes {
        return Err("nothing was filled, and the file changes".to_owned());
    }
    let again = format.open(out, &Stated::default(), &Notes::new()).map_err(|e| format!("the repaired file does not open: {e}"))?;
    let back = again.take();
    if (back.frames(), back.markers.len()) != (take.frames(), take.markers.len()) {
        return Err("the repaired file has another size".to_owned());
    }
    // Whether zeros are gaps, and which unit it is, was judged by the whole take, which is another one now.
    if back.unit != take.unit {
        return Ok(());
    }
    for frame in 0..take.frames() {
        for marker in 0..take.markers.len() {
            let (was, is) = (filled.position_mm(frame, marker), back.position_mm(frame, marker));
            match (filled.origin(frame, marker), was, is) {
                (Origin::Measured | Origin::Derived, Some(was), Some(is)) if was == is => {}
                // zeros in doubt may be gaps in the light of what was filled
                (Origin::Measured | Origin::Derived, Some(was), None) if was == [0.0; 3] => {}
                (Origin::Missing, _, _) | (Origin::Repaired, Some(_), Some(_)) => {}
                _ => return Err(format!("sample {frame}, {marker}: {was:?} comes back as {is:?}")),
            }
        }
    }
    Ok(())
}

/// Gives the bytes to every reader of rigs: what they make of them is sound, and reads as the same again once it is written.
pub fn rigs(bytes: &[u8]) -> Result<(), String> {
    let notes = Notes::new();
    let wrote = |e: formats::FormatError| format!("what was read cannot be written: {e}");
    let reads = |e: formats::FormatError| format!("what was written cannot be read: {e}");
    if let Ok(mesh) = rig::read_mesh(bytes, &notes) {
        let mut out = Vec::new();
        rig::write_mesh(&mesh, &mut out).map_err(wrote)?;
        if rig::read_mesh(&out, &notes).map_err(reads)? != mesh {
            return Err("off: a surface reads as another".to_owned());
        }
    }
    for skeleton in [rig::read_skeleton(bytes, &notes), rig::skeleton_of_bvh(bytes, &notes)].into_iter().flatten() {
        let mut out = Vec::new();
        rig::write_skeleton(&skeleton, &mut out).map_err(wrote)?;
        let again = rig::read_skeleton(&out, &notes).map_err(reads)?;
        if again.joints.len() != skeleton.joints.len() || again.joints.iter().zip(&skeleton.joints).any(|(a, b)| !alike(a, b)) {
            return Err("skl: a skeleton reads as another".to_owned());
        }
    }
    let joint = |name: &str, kind, parent| Joint { name: name.to_owned(), kind, parent, centre: [0.0; 3], state: [0.0; 3] };
    let arm = Skeleton {
        joints: vec![
            joint("root", JointKind::Translate, None),
            joint("body", JointKind::Ball, Some(0)),
            joint("elbow", JointKind::Revolute { axis: [0.0, 0.0, 1.0] }, Some(1)),
            joint("slide", JointKind::Translate, Some(2)),
        ],
    };
    if let Ok(limits) = rig::read_limits(bytes, &arm, None, &notes) {
        let mut out = Vec::new();
        rig::write_limits(&limits, &arm, &mut out).map_err(wrote)?;
        rig::read_limits(&out, &arm, None, &notes).map_err(reads)?;
    }
    if let Ok(parts) = rig::read_parts(bytes, &arm, 4) {
        let mut out = Vec::new();
        rig::write_parts(&parts, &arm, &mut out).map_err(wrote)?;
        if rig::read_parts(&out, &arm, 4).map_err(reads)? != parts {
            return Err("vj: parts read as others".to_owned());
        }
    }
    Ok(())
}

/// The same but for the name, which may be one that no file can hold.
fn alike(a: &Joint, b: &Joint) -> bool {
    (a.kind, a.parent, a.centre, a.state) == (b.kind, b.parent, b.centre, b.state)
}
