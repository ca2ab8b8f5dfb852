//! Many takes: planned, repaired each in a process of its own, and accounted for.
//!
//! - [`sidecar`]: what a finished take leaves beside its output
//! - [`ledger`]: what was done when, append-only

pub mod ledger;
pub mod sidecar;
