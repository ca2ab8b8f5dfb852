//! C3D: what the manifest says about each file, unchanged bytes, and files of our own.

use super::{Row, expect, missing};
use formats::{Format, Match, Note, Notes, Stated, Take};
use libtest_mimic::Failed;
use std::path::Path;

/// Files that are refused, and what the message must say.
const REFUSED: [(&str, &str); 4] = [
    ("MoGapFill__gait-raw.c3d", "expected 0x50"),
    ("btk_others_Empty.c3d", "the file has 0 bytes"),
    ("c3dio__examples_simple.c3d", "the processor is 0"),
    // The recording was never closed (all counts are 0), and its last frame is not whole.
    ("emg-c3d-analyzer__frontend_public_samples_Ghostly_Emg_20240304_10-05-56-0883.c3d", "the file ends in frame 4732"),
];

/// Where the manifest is wrong: file, markers, frames, percentage missing.
/// It took the 12 points of POINT:USED; 152 frames of the header's 11 points fill the file up to its padding.
const CORRECTED: [(&str, usize, usize, f64); 1] = [("c3dorg_sample_27_kyowadengyo.c3d", 11, 152, 1.555)];

pub fn c3d(path: &Path, row: &Row) -> Result<(), Failed> {
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let bytes = std::fs::read(path)?;
    let notes = Notes::new();
    let opened = formats::c3d::C3d.open(bytes.clone(), &Stated::default(), &notes);
    if let Some((_, why)) = REFUSED.iter().find(|(file, _)| *file == name) {
        return match opened {
            Err(error) if error.to_string().contains(why) => Ok(()),
            Err(error) => Err(format!("refused because: {error}; expected: {why}").into()),
            Ok(_) => Err(format!("it opens; expected: {why}").into()),
        };
    }
    let document = opened?;
    let take = document.take();
    expect("sniffed", formats::c3d::C3d.sniff(bytes.get(..bytes.len().min(4096)).unwrap_or(&bytes)), Match::Certain).or_else(|e| {
        // The parameters may begin beyond the bytes that are sniffed at.
        if bytes.first().is_some_and(|&block| block > 8) { Ok(()) } else { Err(e) }
    })?;

    let number = |column: &str| row.get(column).and_then(|cell| cell.parse::<f64>().ok());
    let corrected = CORRECTED.iter().find(|(file, ..)| *file == name);
    expect("markers", take.markers.len() as f64, corrected.map_or(number("points").unwrap(), |c| c.1 as f64))?;
    expect("frames", take.frames() as f64, corrected.map_or(number("frames").unwrap(), |c| c.2 as f64))?;
    expect("rate", take.rate_hz, number("rate").unwrap())?;
    if let Some(percent) = corrected.map(|c| c.3).or(number("pct_missing")) {
        // The manifest counts samples at the origin as present unless they are flagged.
        let zeros = notes.take().iter().map(|n| if let Note::ZeroReadAsMissing { samples } = n { *samples } else { 0 }).sum::<usize>();
        let found = 100.0 * (missing(take) - zeros) as f64 / (take.frames() * take.markers.len()) as f64;
        if (found - percent).abs() > 6e-4 {
            return Err(format!("missing: found {found} %, expected {percent} %").into());
        }
    }

    let mut saved = Vec::new();
    document.save(take, &mut saved, &Notes::new())?;
    if saved != bytes {
        return Err("saving the unchanged take changes the file".into());
    }

    // As floats, if it stores integers.
    if let Some(floats) = document.as_floats()? {
        let again = formats::c3d::C3d.open(floats, &Stated::default(), &Notes::new())?;
        same_take(again.take(), take)?;
    }

    // And as a file of our own.
    let mut created = Vec::new();
    formats::c3d::C3d.create(take, &mut created, &Notes::new())?;
    let again = formats::c3d::C3d.open(created, &Stated::default(), &Notes::new())?;
    expect("frames of the created file", again.take().frames(), take.frames())?;
    expect("missing samples of the created file", missing(again.take()), missing(take))?;
    Ok(())
}

/// What floats keep of integers: everything, up to the last bit of a 32-bit number.
fn same_take(floats: &Take, integers: &Take) -> Result<(), Failed> {
    let facts = |take: &Take| (take.frames(), take.first_frame, take.markers.clone(), take.unit);
    if facts(floats) != facts(integers) {
        return Err("as floats, it is another take".into());
    }
    expect("rate as floats", floats.rate_hz, integers.rate_hz)?;
    for f in 0..integers.frames() {
        for m in 0..integers.markers.len() {
            expect("origin as floats", floats.origin(f, m), integers.origin(f, m))?;
            let (is, was) = (floats.position_mm(f, m).unwrap_or_default(), integers.position_mm(f, m).unwrap_or_default());
            if (0..3).any(|k| (is[k] - was[k]).abs() > 6e-8 * was[k].abs()) {
                return Err(format!("as floats, sample {m} of frame {f} is {is:?} instead of {was:?}").into());
            }
        }
    }
    Ok(())
}
