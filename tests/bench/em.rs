//! What a round of EM costs beside the two matrix products that no E- and M-step can do without: `just bench-em`.
//!
//! For takes of 41 markers and 16 hidden states it prints one line per length: seconds per round of the method `lds`,
//! seconds of `Gᵀ X` (H × m by m × T) and `X Zᵀ` (m × T by T × H) with the same library, both on one core,
//! and their ratio for a take with one gap (`em_over_gemm`) and one with 15 % of all samples missing in many gaps (`em_over_gemm_scattered`).
//! The products are timed between the rounds, so that a busy machine slows both.
#![allow(clippy::print_stdout)] // a benchmark prints
#![allow(clippy::unwrap_used)] // and may fail loudly

mod takes;

use formats::Take;
use mocap_repair::solve::lds::{Hidden, Lds, Options};
use mocap_repair::solve::{Problem, Solver};
use nalgebra::DMatrix;
use std::hint::black_box;
use std::time::Instant;
use takes::{one_gap, scatter};

const HIDDEN: usize = 16;

/// The middle of some numbers.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Seconds of a round and of the two products.
fn time(take: &Take, rounds: usize) -> (f64, f64) {
    let problem = Problem::new(take, &vec![true; take.markers.len()], &[]);
    let options = Options { hidden: Hidden::Count(HIDDEN), ..Options::default() };
    let mut solver = Lds::new(&problem, options);
    let (m, frames) = (3 * problem.markers(), problem.frames());
    let table = DMatrix::from_fn(m, frames, |r, c| ((r * 31 + c * 17) % 101) as f64 * 0.01 - 0.5);
    let emission = DMatrix::from_fn(HIDDEN, m, |r, c| ((r * 7 + c * 3) % 23) as f64 * 0.1 - 1.0);
    let states = DMatrix::from_fn(frames, HIDDEN, |r, c| ((r * 5 + c * 11) % 37) as f64 * 0.1 - 1.5);
    let (mut projected, mut cross) = (DMatrix::zeros(HIDDEN, frames), DMatrix::zeros(m, HIDDEN));
    for _ in 0..2 {
        solver.step().unwrap();
    }
    let (mut rounds_took, mut products_took) = (Vec::new(), Vec::new());
    for _ in 0..rounds {
        let began = Instant::now();
        black_box(solver.step().unwrap());
        rounds_took.push(began.elapsed().as_secs_f64());
        let began = Instant::now();
        projected.gemm(1.0, &emission, &table, 0.0);
        cross.gemm(1.0, &table, &states, 0.0);
        products_took.push(began.elapsed().as_secs_f64());
        black_box((&projected, &cross));
    }
    (median(rounds_took), median(products_took))
}

fn main() {
    let threads = std::env::args().skip_while(|a| a != "--threads").nth(1).map_or(1, |n| n.parse().unwrap());
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().unwrap();
    println!("41 markers, H = {HIDDEN}, method lds, exact E-step, {threads} thread(s)");
    let mut per_frame = Vec::new();
    for frames in [150usize, 1500, 15_000, 100_000] {
        let rounds = (60_000 / frames).clamp(5, 100);
        let (em, gemm) = time(&one_gap(frames), rounds);
        println!(
            "T = {frames:6}  one gap    {:9.3} ms per round, products {:8.3} ms  em_over_gemm = {:.2}",
            em * 1e3,
            gemm * 1e3,
            em / gemm
        );
        let (scattered, gemm) = time(&scatter(frames), rounds);
        println!(
            "T = {frames:6}  scattered  {:9.3} ms per round, products {:8.3} ms  em_over_gemm_scattered = {:.2}",
            scattered * 1e3,
            gemm * 1e3,
            scattered / gemm
        );
        per_frame.push((frames, em / frames as f64, scattered / frames as f64));
    }
    let at = |frames: usize| per_frame.iter().find(|p| p.0 == frames).unwrap();
    let (short, long) = (at(1500), at(100_000));
    println!(
        "cost per frame, 100000 frames against 1500: one gap growth = {:.2}, scattered growth_scattered = {:.2}",
        long.1 / short.1,
        long.2 / short.2
    );
    if let Some(peak) =
        std::fs::read_to_string("/proc/self/status").ok().and_then(|s| s.lines().find(|l| l.starts_with("VmHWM")).map(str::to_owned))
    {
        println!("peak memory of this benchmark: {}", peak.trim_start_matches("VmHWM:").trim());
    }
}
