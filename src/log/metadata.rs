//! The metadata record: what a reader of the log is to know about the repair as a whole.

use super::mcap::{About, Closing};
use ::mcap::records::Metadata;
use std::collections::BTreeMap;

/// Name of the metadata record.
pub const METADATA: &str = "mocap-repair";

/// What happened in one stage.
#[derive(Debug)]
pub(super) struct Stage {
    pub number: u32,
    pub method: &'static str,
    pub step_limit: u32,
    /// Why it stopped, how many steps it took, and what broke. `None` while it runs.
    pub end: Option<(&'static str, u32, Option<String>)>,
    /// True if it has a likelihood.
    pub likelihood: bool,
}

/// The record. Ordered, so that equal runs give equal bytes.
pub(super) fn metadata(about: &About, iterations: u32, stages: &[Stage], closing: &Closing<'_>) -> Metadata {
    let mut map: BTreeMap<String, String> = BTreeMap::new();
    let mut put = |key: &str, value: String| map.insert(key.to_owned(), value);
    put("version", env!("CARGO_PKG_VERSION").to_owned());
    put("ended", closing.ended.word().to_owned());
    put("source_name", about.source_name.clone());
    put("source_sha256", about.source_sha256.clone());
    put("rate_hz", about.rate_hz.to_string());
    put("first_frame", about.first_frame.to_string());
    put("frames", about.frames.to_string());
    put("markers", about.markers.to_string());
    put("bones", about.bones.to_string());
    put("up", about.up.text());
    put("file_unit", about.unit.clone());
    put("t0_ns", "0".to_owned());
    put("frame_time_base", "frame f of the take, counted from 0, is at round(f * 1e9 / rate_hz) ns".to_owned());
    put(
        "iteration_time_base",
        "iteration k of the log, counted from 0 over all stages, is at round(k * 1e9 / rate_hz) ns; not a wall clock".to_owned(),
    );
    put(
        "units",
        "mm, s and nats in /em and /take topics, the field names say which; m in /markers and /skeleton, except sigma_mm".to_owned(),
    );
    let log_rate_hz = closing.shown.and_then(|shown| shown.log_rate_hz);
    put("log_rate_hz", log_rate_hz.map_or_else(|| "every frame".to_owned(), |hz| hz.to_string()));
    put("seed", about.seed.to_string());
    put("method", about.method.clone());
    put("timings", about.timings.to_string());
    put("iterations", iterations.to_string());
    put("stages", stages.len().to_string());
    let stops: Vec<&str> = stages.iter().map(|s| s.end.as_ref().map_or("unfinished", |e| e.0)).collect();
    put("stop_reason", stops.join(", "));
    for stage in stages {
        let mut put = |key: &str, value: String| put(&format!("stage.{}.{key}", stage.number), value);
        put("method", stage.method.to_owned());
        put("step_limit", stage.step_limit.to_string());
        if let Some((stop, steps, error)) = &stage.end {
            put("stop_reason", (*stop).to_owned());
            put("steps", steps.to_string());
            if let Some(error) = error {
                put("error", error.clone());
            }
        }
    }
    for (name, value) in &about.options {
        put(&format!("option.{name}"), value.clone());
    }
    for (name, value) in &closing.results {
        put(&format!("result.{name}"), value.clone());
    }
    Metadata { name: METADATA.to_owned(), metadata: map }
}
