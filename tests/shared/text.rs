//! TRC and TSV.

use super::{Row, expect, missing};
use formats::{Match, Notes, Stated};
use libtest_mimic::Failed;
use std::path::Path;

/// Text files that are refused, and what the message must say.
const TEXT_REFUSED: [(&str, &str); 1] = [("btk_Truncated.trc", "the file ends inside its header, expected the line with the values")];

/// What text files hold where the manifest is silent, or repeats a header that is wrong: file, markers, frames, Hz, percentage missing.
const TEXT_CORRECTED: [(&str, usize, usize, f64, f64); 5] = [
    ("biobuddy__examples_data_static.trc", 49, 138, 100.0, 0.0), // the header claims 1300
    ("nimblephysics__data_grf_AddBiomechanicsTutorialFiles_motion_capture_walk.trc", 41, 238, 100.0, 0.0),
    ("nimblephysics__data_osim_AlanBug2_step_width.trc", 32, 501, 100.0, 0.0), // the header claims 27107
    ("pyomeca__tests_data_markers.trc", 51, 93, 100.0, 0.0),                   // the header claims 652
    ("biomechanics__data_Measurement1.tsv", 15, 2000, 100.0, 0.0),
];

/// Opens a text file, holds it against the manifest, and fills and saves it.
pub fn text(path: &Path, row: &Row, extension: &str) -> Result<(), Failed> {
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let bytes = std::fs::read(path)?;
    let head = bytes.get(..bytes.len().min(4096)).unwrap_or(&bytes);
    let format = formats::detect(head, Some(extension))?;
    let opened = format.open(bytes.clone(), &Stated::default(), &Notes::new());
    if let Some((_, why)) = TEXT_REFUSED.iter().find(|(file, _)| *file == name) {
        return match opened {
            Err(error) if error.to_string().contains(why) => Ok(()),
            Err(error) => Err(format!("refused because: {error}; expected: {why}").into()),
            Ok(_) => Err(format!("it opens; expected: {why}").into()),
        };
    }
    expect("format", (format.info().name, format.sniff(head)), (extension_of(extension), Match::Certain))?;
    // without a name it is known, too
    expect("format without a name", formats::detect(head, None)?.info().name, format.info().name)?;
    let document = opened?;
    let take = document.take();
    let number = |column: &str| row.get(column).and_then(|cell| cell.parse::<f64>().ok()).ok_or(format!("the manifest lacks {column}"));
    let (markers, frames, rate_hz, percent) = match TEXT_CORRECTED.iter().find(|c| c.0 == name) {
        Some(&(_, markers, frames, rate_hz, percent)) => (markers as f64, frames as f64, rate_hz, percent),
        None => (number("points")?, number("frames")?, number("rate")?, number("pct_missing")?),
    };
    expect("markers", take.markers.len() as f64, markers)?;
    expect("frames", take.frames() as f64, frames)?;
    expect("rate", take.rate_hz, rate_hz)?;
    let found = 100.0 * missing(take) as f64 / (take.frames() * take.markers.len()).max(1) as f64;
    if (found - percent).abs() > 6e-3 {
        return Err(format!("missing: found {found} %, expected {percent} %").into());
    }
    let mut saved = Vec::new();
    document.save(take, &mut saved, &Notes::new())?;
    if saved != bytes {
        return Err("saving the unchanged take changes the file".into());
    }
    let mut whole = take.clone();
    for (f, m) in (0..take.frames()).flat_map(|f| (0..take.markers.len()).map(move |m| (f, m))) {
        whole.fill(f, m, [1.0, 2.0, 3.0]);
    }
    let mut saved = Vec::new();
    document.save(&whole, &mut saved, &Notes::new())?;
    let again = format.open(saved, &Stated::default(), &Notes::new())?;
    expect("missing samples after filling", missing(again.take()), 0)?;
    for (f, m) in (0..take.frames()).flat_map(|f| (0..take.markers.len()).map(move |m| (f, m))) {
        if let Some(p) = take.position_mm(f, m) {
            expect("a known sample", again.take().position_mm(f, m), Some(p))?;
        }
    }
    if !take.markers.is_empty() {
        let mut created = Vec::new();
        format.create(take, &mut created, &Notes::new())?;
        let again = format.open(created, &Stated::default(), &Notes::new())?;
        expect("rate of the created file", again.take().rate_hz, take.rate_hz)?;
        expect("missing samples of the created file", missing(again.take()), missing(take))?;
    }
    Ok(())
}

/// The format that usually has an extension.
fn extension_of(extension: &str) -> &'static str {
    formats::by_extension(extension).map_or("", |f| f.info().name)
}
