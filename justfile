# What one types here. `just` lists it.

_default:
    @just --list

# Everything that must hold before a change is accepted; exactly what .ci/run does
check:
    .ci/run

# Put right what can be put right by itself
fix:
    cargo clippy --workspace --all-targets --fix --allow-dirty --allow-staged
    cargo fmt --all

# All tests
test:
    cargo test --workspace

# Make the demonstration take in demo/ and repair it
demo:
    cargo run --release -- demo -o demo --force
    cargo run --release -- demo/walk-gaps.c3d -o demo/walk.c3d --force

# Write the fixtures and their table anew from the code that makes them
fixtures:
    cargo test --test fixtures -- --bless

# The experiment of the BoLeRO paper into docs/paper.md; the motions are looked for in ../shared or MOCAP_SHARED
paper:
    cargo run --release --example paper -- --doc docs/paper.md

# Minify the libraries of the report anew
vendor:
    src/page/vendor/build.sh

# What a round of EM costs beside the two matrix products that it cannot do without, on one core
bench-em:
    cargo bench --bench em

# What the parts of the solvers cost
bench:
    cargo bench --bench parts

# opening files, beside ezc3d and pandas
bench-files:
    python tests/python/bench_files.py

# Ten minutes of a fuzz target, `open_any`, `roundtrip` or `rigs`; needs nightly Rust and cargo-fuzz. What it finds is in formats/fuzz/found and artifacts
fuzz target="roundtrip":
    mkdir -p formats/fuzz/found
    cd formats/fuzz && cargo +nightly fuzz run --fuzz-dir . {{target}} found corpus $(find ../../fixtures -mindepth 2 -type d) -- -max_total_time=600 -max_len=20000 -timeout=1 -malloc_limit_mb=600

# Write what --help prints into docs/usage.md
usage:
    cargo build
    python3 tests/python/usage.py target/debug/mocap-repair docs/usage.md
