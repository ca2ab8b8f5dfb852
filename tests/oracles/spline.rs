//! Natural cubic splines against all their polynomials at once.

use crate::chance::Chance;
use crate::near;
use formats::{Marker, Origin, TakeBuilder};
use mocap_repair::solve::interpolate::{Curve, Interpolate};
use mocap_repair::solve::{Problem, Solver};
use nalgebra::{DMatrix, DVector};

/// Fills the frames between `knots`, (frame, value), along x; what was filled as (frame, value).
fn filled(knots: &[(usize, f64)], curve: Curve) -> Vec<(usize, f64)> {
    let mut take = TakeBuilder::new(vec![Marker::new("A")], knots[knots.len() - 1].0 + 1, 100.0);
    for &(frame, value) in knots {
        take.set(frame, 0, [value, 1.0, -value], Origin::Measured);
    }
    let problem = Problem::new(&take.build(), &[true], &[]);
    let mut solver = Interpolate::new(&problem, curve);
    assert!(solver.step().unwrap().done);
    let fill = |(&(frame, _), p): (&(usize, usize), &[f64; 3])| {
        assert!(p[1] == 1.0 && p[2] == -p[0], "each coordinate alone: {p:?}");
        (frame, p[0])
    };
    problem.missing.iter().zip(&solver.estimate().positions_mm).map(fill).collect()
}

/// The spline at `time`: a + b u + c u² + d u³ on each of n - 1 intervals, from 4 (n - 1) conditions in one system.
fn dense(knots: &[(usize, f64)], time: f64) -> f64 {
    let spans = knots.len() - 1;
    let mut matrix = DMatrix::zeros(4 * spans, 4 * spans);
    let mut right = DVector::zeros(4 * spans);
    let mut row = 0;
    for k in 0..spans {
        let h = (knots[k + 1].0 - knots[k].0) as f64;
        let (here, next) = (4 * k, 4 * k + 4);
        // both ends
        matrix[(row, here)] = 1.0;
        right[row] = knots[k].1;
        for (power, factor) in [1.0, h, h * h, h * h * h].into_iter().enumerate() {
            matrix[(row + 1, here + power)] = factor;
        }
        right[row + 1] = knots[k + 1].1;
        row += 2;
        // slope and bend go on at the inner knots
        if k + 1 < spans {
            for (power, factor) in [(1, 1.0), (2, 2.0 * h), (3, 3.0 * h * h)] {
                matrix[(row, here + power)] = factor;
            }
            matrix[(row, next + 1)] = -1.0;
            matrix[(row + 1, here + 2)] = 2.0;
            matrix[(row + 1, here + 3)] = 6.0 * h;
            matrix[(row + 1, next + 2)] = -2.0;
            row += 2;
        }
    }
    // no bend at the two ends
    let h = (knots[spans].0 - knots[spans - 1].0) as f64;
    matrix[(row, 2)] = 2.0;
    matrix[(row + 1, 4 * spans - 2)] = 2.0;
    matrix[(row + 1, 4 * spans - 1)] = 6.0 * h;
    let polynomials = matrix.lu().solve(&right).unwrap();
    let k = (0..spans).rev().find(|&k| knots[k].0 as f64 <= time).unwrap_or(0);
    let u = time - knots[k].0 as f64;
    [1.0, u, u * u, u * u * u].iter().zip(polynomials.rows(4 * k, 4).iter()).map(|(power, factor)| power * factor).sum()
}

#[test]
fn curves_have_the_values_computed_by_hand() {
    type Row = (&'static [(usize, f64)], Curve, &'static [(usize, f64)]);
    let rows: [Row; 4] = [
        // one hat: the bend at its tip is -3 / 4 per frame², so half way up is 1/2 + 3/16
        (&[(0, 0.0), (2, 1.0), (4, 0.0)], Curve::Spline, &[(1, 0.6875), (3, 0.6875)]),
        // a straight line and a constant are their own splines
        (&[(0, 0.0), (1, 3.0), (4, 12.0), (6, 18.0)], Curve::Spline, &[(2, 6.0), (3, 9.0), (5, 15.0)]),
        (&[(0, 7.0), (3, 7.0)], Curve::Spline, &[(1, 7.0), (2, 7.0)]),
        (&[(0, 0.0), (2, 1.0), (6, 0.0)], Curve::Linear, &[(1, 0.5), (3, 0.75), (4, 0.5), (5, 0.25)]),
    ];
    for (knots, curve, expected) in rows {
        let found = filled(knots, curve);
        assert_eq!(found.len(), expected.len(), "{knots:?}");
        for (&(frame, value), &(at, right)) in found.iter().zip(expected) {
            assert_eq!(frame, at, "{knots:?}");
            near(&format!("{knots:?}, frame {frame}"), value, right, 1e-14);
        }
    }
}

#[test]
fn splines_are_those_of_all_polynomials_at_once() {
    let mut compared = 0;
    for seed in 1..=8 {
        let mut chance = Chance::new(seed);
        let mut knots = vec![(0, 100.0 * chance.normal())];
        for _ in 0..9 {
            let step = 1 + (6.0 * chance.unit()) as usize;
            knots.push((knots[knots.len() - 1].0 + step, 100.0 * chance.normal()));
        }
        for (frame, value) in filled(&knots, Curve::Spline) {
            near(&format!("seed {seed}, frame {frame}"), value, dense(&knots, frame as f64), 1e-11);
            compared += 1;
        }
    }
    assert!(compared > 100, "{compared}");
}
