//! What a C3D holds that a take does not: kept when the file is saved, lost when the take goes into a new file.

use super::layout::{Layout, Storage};
use super::parameters::Parameters;
use crate::note::listed;

/// Groups whose content is in the take, is written anew with it, or is named on its own below.
const SPOKEN_FOR: [&str; 7] = ["POINT", "TRIAL", "ANALOG", "EVENT", "EVENT_CONTEXT", "FORCE_PLATFORM", "ROTATION"];

/// The group that this program writes.
const OWN: &str = "MOCAPREPAIR";

/// What the parameters tell of, in a few words each.
pub(super) fn parameters(p: &Parameters<'_>) -> Vec<String> {
    let used = |group: &str| p.number(group, "USED").filter(|n| *n >= 1.0);
    let count = |n: f64, what: &str| format!("{n} {what}{}", if n == 1.0 { "" } else { "s" });
    let mut beyond = Vec::new();
    beyond.extend(used("ANALOG").map(|n| count(n, "analog channel")));
    beyond.extend(used("FORCE_PLATFORM").map(|n| count(n, "force platform")));
    beyond.extend(used("EVENT").map(|n| count(n, "event")));
    let in_header = Some(p.header_events()).filter(|n| *n > 0);
    beyond.extend(in_header.map(|n| count(n.into(), "event") + " in the header"));
    beyond.extend(used("ROTATION").map(|n| count(n, "rotation")));
    // our own group says something that a new file does not have only if something was filled
    let filled = p.number(OWN, "FILLED").is_some_and(|n| n > 0.0) || p.texts(OWN, "METHOD").is_some();
    let tells = |name: &str| !SPOKEN_FOR.contains(&name) && !name.is_empty() && (name != OWN || filled);
    let mut others: Vec<&str> = p.group_names().filter(|name| tells(name)).collect();
    others.sort_unstable();
    others.dedup();
    if !others.is_empty() {
        beyond.push(format!("the parameters of {}", listed(&others)));
    }
    beyond
}

/// True if fourth words say more than whether a sample was measured: residuals that differ, or cameras.
pub(super) fn has_residuals(layout: &Layout, bytes: &[u8]) -> bool {
    let size = layout.storage.bytes();
    let mut first = None;
    (0..layout.frames).any(|frame| {
        let start = layout.start.saturating_add(frame.saturating_mul(layout.frame_bytes));
        let points = bytes.get(start..).and_then(|data| data.get(..layout.points.checked_mul(4 * size)?)).unwrap_or_default();
        points.chunks_exact(4 * size).filter_map(|point| point.get(3 * size..)).any(|word| {
            let value = match layout.storage {
                Storage::Integer => word.first_chunk().map_or(0.0, |w| f64::from(layout.processor.u16(*w).cast_signed())),
                Storage::Float => word.first_chunk().map_or(0.0, |w| f64::from(layout.processor.f32(*w))),
            };
            value > 0.0 && value < 32_768.0 && *first.get_or_insert(value) != value
        })
    })
}
