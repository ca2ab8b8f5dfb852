//! Many takes: planned, repaired each in a process of its own, and accounted for.
//!
//! - [`store`]: where takes are read from and outputs are written to: a folder, or a bucket

pub mod store;
