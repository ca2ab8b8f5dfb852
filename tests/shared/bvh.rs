//! BVH.

use super::{Row, expect, missing};
use formats::{Format, Match, Notes, Stated};
use libtest_mimic::Failed;
use std::path::Path;

/// Joints and frames as the manifest says, unchanged bytes, and our own kind of file.
pub fn bvh(path: &Path, row: &Row) -> Result<(), Failed> {
    let bytes = std::fs::read(path)?;
    expect("sniffed", formats::bvh::Bvh.sniff(bytes.get(..bytes.len().min(4096)).unwrap_or(&bytes)), Match::Certain)?;
    let document = formats::bvh::Bvh.open(bytes.clone(), &Stated::default(), &Notes::new())?;
    let take = document.take();
    expect("frames", take.frames().to_string().as_str(), row.get("frames").map(String::as_str).unwrap_or_default())?;
    // "joints=24 ends=5 frames=56 ..."; an end site whose OFFSET is 0 is where its joint is, and no marker
    let special = row.get("special").map(String::as_str).unwrap_or_default();
    let said = |key: &str| special.split_whitespace().find_map(|word| word.strip_prefix(key)?.strip_prefix('=')?.parse::<usize>().ok());
    let ends = take.markers.iter().filter(|m| m.label.contains("_end")).count();
    expect("joints", Some(take.markers.len() - ends), said("joints"))?;
    if ends > said("ends").unwrap_or(0) {
        return Err(format!("{ends} end sites").into());
    }
    expect("missing samples", missing(take), 0)?;
    let mut saved = Vec::new();
    document.save(take, &mut saved, &Notes::new())?;
    if saved != bytes {
        return Err("saving the unchanged take changes the file".into());
    }
    let mut created = Vec::new();
    formats::bvh::Bvh.create(take, &mut created, &Notes::new())?;
    let again = formats::bvh::Bvh.open(created, &Stated::default(), &Notes::new())?;
    expect("markers of the created file", again.take().markers.len(), take.markers.len())?;
    expect("rate of the created file", again.take().rate_hz, take.rate_hz)?;
    for frame in 0..take.frames() {
        for marker in 0..take.markers.len() {
            expect("a sample of the created file", again.take().position_mm(frame, marker), take.position_mm(frame, marker))?;
        }
    }
    Ok(())
}
