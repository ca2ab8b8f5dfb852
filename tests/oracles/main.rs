//! The mathematics against slower ways to the same numbers.
//!
//! | file | what | against |
//! | --- | --- | --- |
//! | [`auto`] | what experts agree on | truth that was hidden, on walks and on bodies that were made up |
//! | [`smoother`] | forward-backward pass | one Gaussian over all states and observations, inverted |
//! | [`bones`] | bones as evidence | the same; Jacobians against differences; the bone step against gradient descent |
//! | [`band`] | the bone step over whole gaps | processes written out, a search by coordinates, slopes by differences; bones that cannot be met |
//! | [`em`] | M-step | no small change of a parameter is better; what it climbs has the slope of the likelihood |
//! | [`whole`] | the solvers | one Gaussian again; a system that is known because it made the data; likelihoods that never fall |
//! | [`spline`] | natural cubic splines | all polynomials at once, and values computed by hand |
//!
//! [`dense`] is that one Gaussian, [`chance`] the seeded random numbers.
#![allow(clippy::unwrap_used)] // a test that gets no value has failed

mod auto;
mod band;
mod bones;
mod chance;
mod dense;
mod em;
mod smoother;
mod spline;
mod whole;

/// Fails unless `found` is within `tolerance` of `expected`, relative to the larger of `expected` and 1.
#[track_caller]
fn near(what: &str, found: f64, expected: f64, tolerance: f64) {
    let off = (found - expected).abs() / expected.abs().max(1.0);
    assert!(off <= tolerance, "{what}: found {found}, expected {expected}, off by {off:e}");
}

/// The same for every entry of a matrix or vector, relative to the largest one.
#[track_caller]
fn all_near<'a>(what: &str, found: impl IntoIterator<Item = &'a f64>, expected: impl IntoIterator<Item = &'a f64>, tolerance: f64) {
    let (found, expected): (Vec<f64>, Vec<f64>) = (found.into_iter().copied().collect(), expected.into_iter().copied().collect());
    assert_eq!(found.len(), expected.len(), "{what}: another number of entries");
    let scale = expected.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
    for (k, (f, e)) in found.iter().zip(&expected).enumerate() {
        let off = (f - e).abs() / scale;
        assert!(off <= tolerance, "{what}, entry {k}: found {f}, expected {e}, off by {off:e}");
    }
}
