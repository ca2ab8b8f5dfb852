//! A body followed through a sequence of point clouds (section 3.3 of the report, and what goes beyond it).

mod body;
mod coverage;
mod expect;
mod nearest;
mod record;
mod search;
mod settings;
#[cfg(test)]
mod tests;
mod tracker;
mod usual;

pub use body::{Body, vertex_normals};
pub use coverage::{Beside, coverage};
pub use expect::{Cloud, Expectation, Expected, Mixture};
pub use nearest::{Boxes, Brute, Found, Nearest, Query};
pub use record::{Round, Tracked, Way};
pub use settings::{Method, Settings};
pub use tracker::{Tracker, middle};
