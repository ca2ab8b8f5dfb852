//! Many takes: planned, repaired each in a process of its own, and accounted for.
//!
//! - [`sidecar`]: what a finished take leaves beside its output
//! - [`ledger`]: what was done when, append-only
//! - [`store`]: where takes are read from and outputs are written to: a folder, or a bucket

pub mod ledger;
pub mod sidecar;
pub mod store;
