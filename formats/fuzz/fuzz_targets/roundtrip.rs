//! Any file that opens: filled, saved, opened again, and written in every other format.
#![no_main]

#[path = "../checks.rs"]
#[allow(dead_code)] // each target uses its part
mod checks;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    checks::roundtrip(bytes).unwrap();
});
