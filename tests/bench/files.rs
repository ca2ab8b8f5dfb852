//! What opening a file costs: `cargo bench --bench files`.
//!
//! C3D of 100 markers and 20000 frames, Intel, as floats and as integers, and tables of 41 markers and 20000 frames with three decimals;
//! the figure to look at is bytes per second. `MOCAP_BENCH_FILES=FOLDER` writes the files there as well, for other readers:
//! `tests/python/bench_files.py` does both, and prints them side by side.
#![allow(clippy::unwrap_used)] // a benchmark may fail loudly

use divan::counter::BytesCount;
use divan::{Bencher, black_box};
use formats::{Format, Marker, Notes, Origin, Stated, TakeBuilder, c3d::C3d};

const MARKERS: usize = 100;
const FRAMES: usize = 20_000;

/// A file of floats.
fn floats() -> Vec<u8> {
    let mut b = TakeBuilder::new(vec![Marker::new("M"); MARKERS], FRAMES, 100.0);
    for f in 0..FRAMES {
        for m in 0..MARKERS {
            if (f + m) % 50 > 2 {
                b.set(f, m, [f as f64 * 0.25, m as f64 + 0.5, 900.0], Origin::Measured);
            }
        }
    }
    let mut bytes = Vec::new();
    C3d.create(&b.build(), &mut bytes, &Notes::new()).unwrap();
    bytes
}

/// The same as integers: header and parameters of the floats with positive scales, and two bytes for four.
fn integers() -> Vec<u8> {
    let floats = floats();
    let data = floats.len() - MARKERS * FRAMES * 16;
    let mut bytes = floats.get(..data).unwrap().to_vec();
    let at = bytes.windows(5).position(|w| w == b"SCALE").unwrap() + 5 + 4;
    for at in [12, at] {
        bytes.splice(at..at + 4, 0.25_f32.to_le_bytes());
    }
    for number in floats.get(data..).unwrap().as_chunks::<4>().0.as_chunks::<4>().0 {
        let [x, y, z, word] = number.map(f32::from_le_bytes);
        bytes.extend([x * 4.0, y * 4.0, z * 4.0, word].iter().flat_map(|c| (*c as i16).to_le_bytes()));
    }
    bytes
}

fn open(bencher: Bencher<'_, '_>, bytes: &[u8]) {
    let open = |bytes: Vec<u8>| C3d.open(bytes, &Stated::default(), &Notes::new()).unwrap();
    bencher.counter(BytesCount::new(bytes.len())).with_inputs(|| bytes.to_vec()).bench_local_values(|bytes| black_box(open(bytes)));
}

#[divan::bench(sample_count = 10)]
fn open_floats(bencher: Bencher<'_, '_>) {
    open(bencher, &floats());
}

#[divan::bench(sample_count = 10)]
fn open_integers(bencher: Bencher<'_, '_>) {
    open(bencher, &integers());
}

/// A table as other programs write it: no more decimals than a camera system has.
fn table(format: &dyn Format) -> Vec<u8> {
    let markers = (1..=41).map(|m| Marker::new(format!("M{m:02}"))).collect();
    let mut b = TakeBuilder::new(markers, FRAMES, 100.0);
    for f in 0..FRAMES {
        for m in 0..41 {
            if (f + m) % 50 > 2 {
                let at = |k: usize| ((f * 37 + m * 4099 + k * 70_001) % 3_999_999) as f64 / 1000.0 - 1999.0;
                b.set(f, m, [at(0), at(1), at(2)].map(|x| (x * 1000.0).round() / 1000.0), Origin::Measured);
            }
        }
    }
    let mut bytes = Vec::new();
    format.create(&b.build(), &mut bytes, &Notes::new()).unwrap();
    bytes
}

#[divan::bench(sample_count = 10, args = ["csv", "trc", "tsv", "nexus", "motive", "bvh"])]
fn open_table(bencher: Bencher<'_, '_>, name: &str) {
    let format = *formats::ALL.iter().find(|f| f.info().name == name).unwrap();
    let bytes = table(format);
    let open = |bytes: Vec<u8>| format.open(bytes, &Stated::default(), &Notes::new()).unwrap();
    bencher.counter(BytesCount::new(bytes.len())).with_inputs(|| bytes.clone()).bench_local_values(|bytes| black_box(open(bytes)));
}

fn main() {
    if let Some(folder) = std::env::var_os("MOCAP_BENCH_FILES") {
        let folder = std::path::Path::new(&folder);
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(folder.join("floats.c3d"), floats()).unwrap();
        std::fs::write(folder.join("integers.c3d"), integers()).unwrap();
        for format in formats::ALL.iter().filter(|f| f.info().name != "c3d") {
            let info = format.info();
            std::fs::write(folder.join(format!("{}.{}", info.name, info.extensions[0])), table(*format)).unwrap();
        }
    }
    divan::main();
}
