//! CSV, and exports of Motive and Nexus.

use super::{expect, missing};
use formats::{Notes, Stated};
use libtest_mimic::Failed;
use std::path::Path;

/// What a table is, counted with another reader: format, markers, frames, frames per second, missing samples.
/// A rate of 100 Hz is also what is assumed where the file names none.
pub type Counted = (&'static str, &'static str, usize, usize, f64, usize);
pub const TABLES: [Counted; 10] = [
    ("Gaga-mocap-Kinematics__example.csv", "motive", 82, 32, 120.0, 928),
    ("MoGapFill__gait-raw.csv", "csv", 13, 142, 100.0, 101),
    ("biobuddy__examples_data_static.csv", "csv", 21, 28, 100.0, 0),
    ("bvh-toolbox__tests_example_files_csv_walk01_pos.csv", "csv", 24, 101, 24.0, 0),
    ("dynammo_127_07.csv", "csv", 41, 145, 100.0, 0),
    ("dynammo_141_16.csv", "csv", 41, 299, 100.0, 0),
    ("pyCGM__SampleData_ROM_Sample_Static.csv", "nexus", 141, 275, 100.0, 0),
    ("pyomeca__test_data_markers_without_header.csv", "nexus", 42, 1489, 100.0, 3495),
    ("pyomeca__tests_data_markers.csv", "nexus", 51, 580, 100.0, 305),
    ("pyomeca__tests_data_markers_without_header.csv", "csv", 51, 580, 100.0, 305),
];

/// Tables that are refused, and what the message must say.
pub const REFUSED_TABLES: [(&str, &str); 4] = [
    ("bvh-toolbox__bvhtoolbox_tests_example_files_csv_walk01_rot.csv", "rotations of joints"),
    ("bvh-toolbox__converters_example_files_csv_walk01_rot.csv", "rotations of joints"),
    ("bvh-toolbox__tests_example_files_csv_walk01_rot.csv", "rotations of joints"),
    (
        "f8dae0_pyomeca__test_data_markers_without_header.csv",
        "this row is empty, but rows follow; nothing was skipped, delete or complete it (line 300)",
    ),
];

pub fn table(path: &Path) -> Result<(), Failed> {
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let bytes = std::fs::read(path)?;
    let format = formats::detect(bytes.get(..4096).unwrap_or(&bytes), Some("csv"))?;
    let opened = format.open(bytes.clone(), &Stated::default(), &Notes::new());
    if let Some((_, why)) = REFUSED_TABLES.iter().find(|(file, _)| *file == name) {
        return match opened {
            Err(error) if error.to_string().contains(why) => Ok(()),
            Err(error) => Err(format!("refused because: {error}; expected: {why}").into()),
            Ok(_) => Err(format!("it opens; expected: {why}").into()),
        };
    }
    let (_, kind, markers, frames, rate_hz, gaps) =
        TABLES.iter().find(|(file, ..)| *file == name).ok_or("nobody has counted this table")?;
    let document = opened?;
    let take = document.take();
    expect("format", format.info().name, kind)?;
    expect("markers", take.markers.len(), *markers)?;
    expect("frames", take.frames(), *frames)?;
    expect("rate", take.rate_hz, *rate_hz)?;
    expect("missing samples", missing(take), *gaps)?;
    let mut saved = Vec::new();
    document.save(take, &mut saved, &Notes::new())?;
    if saved == bytes { Ok(()) } else { Err("saving the unchanged take changes the file".into()) }
}
