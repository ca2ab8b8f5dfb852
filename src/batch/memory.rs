//! How much memory there is, and how much a take is thought to want.

use super::plan::PlannedTake;
use crate::compression;
use std::path::Path;

/// What the program itself takes, and the smallest take, in bytes.
const AT_LEAST: u64 = 64 << 20;

/// What repairing takes, in sizes of the file: the table as doubles, the model's expectations, the bytes to compare with, the log.
const TIMES: u64 = 10;

/// How much larger a compressed take may be inside.
const EXPANDS: u64 = 4;

/// How much memory a take is thought to want, in bytes. Takes that want more than they get are run alone.
pub fn estimate(take: &PlannedTake) -> u64 {
    let expands = if compression::is_named(Path::new(&take.source)) { EXPANDS } else { 1 };
    take.bytes.saturating_mul(TIMES * expands).saturating_add(AT_LEAST)
}

/// Four fifths of the memory that is free, or that the group of processes may take.
pub fn available() -> u64 {
    let mut system = sysinfo::System::new();
    system.refresh_memory();
    let group = system.cgroup_limits().map_or(u64::MAX, |limits| limits.free_memory);
    system.available_memory().min(group) / 5 * 4
}

/// What this process takes at the moment, as far as the system says it.
pub fn taken() -> Option<u64> {
    of_self("VmRSS:")
}

/// The most that this process has taken.
pub fn most_taken() -> Option<u64> {
    of_self("VmHWM:")
}

fn of_self(what: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(what))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 1024)
}

/// Reads sizes such as `8G`, `500M` or plain bytes.
///
/// # Errors
/// It is none. The text says what was expected.
pub fn parse(text: &str) -> Result<u64, String> {
    let expected = || "expected a size, such as 8G, 500M or a number of bytes".to_owned();
    let text = text.trim();
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let shift = match text.get(digits.len()..).unwrap_or_default().to_ascii_uppercase().as_str() {
        "" | "B" => 0,
        "K" | "KB" | "KIB" => 10,
        "M" | "MB" | "MIB" => 20,
        "G" | "GB" | "GIB" => 30,
        "T" | "TB" | "TIB" => 40,
        _ => return Err(expected()),
    };
    let number: f64 = digits.trim().parse().map_err(|_| expected())?;
    let bytes = number * (1u64 << shift) as f64;
    if bytes.is_finite() && bytes >= 1.0 { Ok(bytes as u64) } else { Err(expected()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_typed_as_people_do() {
        for (text, bytes) in [("1", 1), ("500M", 500 << 20), ("1.5g", 3 << 29), ("2 GiB", 2 << 30), ("7KB", 7 << 10)] {
            assert_eq!(parse(text), Ok(bytes), "{text}");
        }
        for wrong in ["", "G", "-1G", "1X", "nan", "0"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        assert!(available() > 1 << 20);
    }
}
