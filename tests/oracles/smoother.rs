//! The forward-backward pass against one Gaussian over all states and observations.

use crate::chance::Chance;
use crate::dense::{Gaussian, Table, evidence, seen};
use crate::{all_near, near};
use mocap_repair::solve::lds::smoother::{smooth, smooth_within};
use nalgebra::DMatrix;

/// What of a table is missing.
#[derive(Clone, Copy, Debug)]
enum Missing {
    Nothing,
    /// Each sample with probability one half.
    Half,
    /// Half, and besides every third frame altogether, from the second on.
    BlackOuts,
    Everything,
}

/// A table of numbers, whole or with holes.
fn table(chance: &mut Chance, markers: usize, frames: usize, missing: Missing) -> Table {
    let mut table = chance.normals(3 * markers, frames) * 2.0;
    for t in 0..frames {
        for i in 0..markers {
            let hidden = match missing {
                Missing::Nothing => false,
                Missing::Half => chance.happens(0.5),
                Missing::BlackOuts => t % 3 == 1 || chance.happens(0.5),
                Missing::Everything => true,
            };
            if hidden {
                table.view_mut((3 * i, t), (3, 1)).fill(f64::NAN);
            }
        }
    }
    table
}

#[test]
fn moments_and_likelihood_are_those_of_one_big_gaussian() {
    let mut cases = 0;
    for hidden in 1..=4 {
        for frames in 1..=7 {
            for (k, missing) in [Missing::Nothing, Missing::Half, Missing::BlackOuts, Missing::Everything].into_iter().enumerate() {
                let mut chance = Chance::new((100 * hidden + 10 * frames + k) as u64);
                let markers = 1 + (hidden + frames) % 3;
                let model = chance.model(hidden, markers);
                let table = table(&mut chance, markers, frames, missing);
                let found = smooth(&model, evidence(&model, &table)).unwrap();
                let (at, values) = seen(&model, &table);
                let (expected, log_likelihood) = Gaussian::system(&model, frames).given(&at, &values);
                let case = format!("H = {hidden}, T = {frames}, missing: {missing:?}");

                near(&format!("{case}: log-likelihood"), found.log_likelihood, log_likelihood, 1e-9);
                all_near(&format!("{case}: means"), &found.means, expected.mean.rows(0, hidden * frames).iter(), 1e-9);
                let block = |s: usize, t: usize| expected.covariance.view((s * hidden, t * hidden), (hidden, hidden)).into_owned();
                for t in 0..frames {
                    all_near(&format!("{case}: covariance of frame {t}"), found.covariance_of(t), &block(t, t), 1e-9);
                }
                let sum = (0..frames).fold(DMatrix::zeros(hidden, hidden), |sum, t| sum + block(t, t));
                all_near(&format!("{case}: sum of the covariances"), &found.covariance, &sum, 1e-9);
                let lagged = (1..frames).fold(DMatrix::zeros(hidden, hidden), |sum, t| sum + block(t, t - 1));
                all_near(&format!("{case}: lagged covariances"), &found.lagged, &lagged, 1e-9);
                cases += 1;
            }
        }
    }
    assert_eq!(cases, 4 * 7 * 4);
}

/// Long takes, most frames of which say the same: what is shared must be what would have been computed.
#[test]
fn shared_covariances_are_those_of_every_frame() {
    for (seed, gap) in (1..).zip([0..0, 90..200, 3..5, 0..120, 250..300, 149..152]) {
        let mut chance = Chance::new(seed);
        let model = chance.model(3, 4);
        let mut table = chance.normals(12, 300) * 2.0;
        for t in gap.clone() {
            table.view_mut((3, t), (3, 1)).fill(f64::NAN);
        }
        let mut said = evidence(&model, &table);
        // the frames of the gap are alike, too
        for t in gap.clone() {
            said.of[t] = said.of[gap.start];
        }
        let every = smooth_within(&model, said.clone(), -1.0).unwrap();
        let shared = smooth(&model, said).unwrap();
        assert!(every.distinct() == 300 && shared.distinct() < 200, "{}", shared.distinct());
        let case = format!("gap {gap:?}");
        near(&format!("{case}: log-likelihood"), shared.log_likelihood, every.log_likelihood, 1e-10);
        all_near(&format!("{case}: means"), &shared.means, &every.means, 1e-8);
        all_near(&format!("{case}: sum of the covariances"), &shared.covariance, &every.covariance, 1e-8);
        all_near(&format!("{case}: lagged covariances"), &shared.lagged, &every.lagged, 1e-8);
        for t in 0..300 {
            all_near(&format!("{case}: covariance of frame {t}"), shared.covariance_of(t), every.covariance_of(t), 1e-8);
        }
    }
}
