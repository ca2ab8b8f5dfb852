//! What the parts of the solvers cost: `cargo bench --bench parts`.
//!
//! On the synthetic walk of 41 markers at 120 Hz, without bones or with those that are found, with one gap or with 15 % of the samples missing.
#![allow(clippy::unwrap_used)] // a benchmark may fail loudly

mod takes;

use divan::{Bencher, black_box};
use formats::Take;
use mocap_repair::bones;
use mocap_repair::solve::{Method, Problem, Settings};
use takes::{one_gap, scatter};

const FRAMES: usize = 1500;

fn problem(take: &Take) -> Problem {
    let everybody = vec![true; take.markers.len()];
    Problem::new(take, &everybody, &bones::find(take, &everybody))
}

/// One round of a method after two to warm up.
fn rounds(bencher: Bencher<'_, '_>, method: Method, take: &Take) {
    let problem = problem(take);
    let mut solver = method.solver(&problem, &Settings::default());
    for _ in 0..2 {
        solver.step().unwrap();
    }
    bencher.bench_local(|| black_box(solver.step().unwrap()));
}

#[divan::bench(args = [Method::Msvd, Method::Lds, Method::BoleroHc, Method::BoleroSc])]
fn round_one_gap(bencher: Bencher<'_, '_>, method: Method) {
    rounds(bencher, method, &one_gap(FRAMES));
}

#[divan::bench(args = [Method::Msvd, Method::Lds, Method::BoleroHc, Method::BoleroSc])]
fn round_scattered(bencher: Bencher<'_, '_>, method: Method) {
    rounds(bencher, method, &scatter(FRAMES));
}

/// The bone step after the last round.
#[divan::bench(args = [Method::BoleroHc, Method::BoleroSc], sample_count = 10)]
fn conclude_scattered(bencher: Bencher<'_, '_>, method: Method) {
    let problem = problem(&scatter(FRAMES));
    bencher
        .with_inputs(|| {
            let mut solver = method.solver(&problem, &Settings::default());
            for _ in 0..5 {
                solver.step().unwrap();
            }
            solver
        })
        .bench_local_values(|mut solver| solver.conclude());
}

/// Body frames, table, first parameters.
#[divan::bench(args = [Method::Msvd, Method::Lds, Method::BoleroSc])]
fn start_scattered(bencher: Bencher<'_, '_>, method: Method) {
    let problem = problem(&scatter(FRAMES));
    bencher.bench_local(|| black_box(method.solver(&problem, &Settings::default()).estimate().sigma_mm.len()));
}

#[divan::bench]
fn find_bones(bencher: Bencher<'_, '_>) {
    let take = scatter(FRAMES);
    let everybody = vec![true; take.markers.len()];
    bencher.bench_local(|| bones::find(black_box(&take), &everybody));
}

fn main() {
    divan::main();
}
