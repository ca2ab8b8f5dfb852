//! Takes of labelled markers with known truth: how far joints are from it when the motion was solved for, and what is left when markers are hidden.

use libtest_mimic::{Failed, Trial};
use mocap_repair::fit::{Request, fit};
use mocap_repair::input::Reading;
use mocap_repair::rig::RigFiles;
use mocap_repair::rig::wearer::WearerFiles;
use std::path::Path;

/// A take, how many percent of its samples are hidden, and the mean and largest distance of joints from the truth, cm, that it must not exceed.
struct Bound {
    take: &'static str,
    hidden: u64,
    mean_cm: f64,
    worst_cm: f64,
}

/// With 30 % hidden, a hand of the gymnast shows no marker for some frames and is carried by its neighbours in time.
const BOUNDS: [Bound; 4] = [
    Bound { take: "walk", hidden: 0, mean_cm: 0.45, worst_cm: 2.6 },
    Bound { take: "gym", hidden: 0, mean_cm: 0.30, worst_cm: 1.0 },
    Bound { take: "walk", hidden: 30, mean_cm: 0.50, worst_cm: 5.0 },
    Bound { take: "gym", hidden: 30, mean_cm: 0.45, worst_cm: 5.0 },
];

/// The tests, as far as their takes are there.
pub fn trials(data: &Path) -> Vec<Trial> {
    let there = BOUNDS.iter().filter(|bound| data.join("kineben").join(bound.take).is_dir());
    there
        .map(|bound| {
            let folder = data.join("kineben").join(bound.take);
            Trial::test(format!("solve {} with {} % hidden", bound.take, bound.hidden), move || solved(&folder, bound))
        })
        .collect()
}

fn solved(folder: &Path, bound: &Bound) -> Result<(), Failed> {
    let output = tempfile::tempdir()?;
    let named = |name: &str| folder.join(name);
    let input = output.path().join("markers.csv");
    std::fs::write(&input, holed(&std::fs::read_to_string(named("markers.csv"))?, bound.hidden))?;
    let rig = RigFiles {
        skeleton: named("model.skl"),
        surface: named("model.off"),
        parts: named("model.vj"),
        limits: Some(named("model.cst")),
        unit: None,
        angles: None,
        swing_twist: false,
        spine: false,
    };
    let stated = formats::Stated { unit: Some(formats::Unit::Centimetre), rate_hz: Some(30.0), ..formats::Stated::default() };
    let request = Request {
        input,
        reading: Reading::from(stated),
        wearer: WearerFiles { rig, map: Some(named("markers_map.csv")), calibrate: false },
        fills: None,
        settings: mocap_repair::solve::markers::Settings::default(),
        order: formats::bvh::Order::default(),
        output: output.path().join("out.bvh"),
        table: output.path().join("out.csv"),
        log: None,
        log_rate_hz: None,
        page: None,
        force: false,
        dry_run: false,
    };
    let report = fit(&request, &mut ())?;
    super::expect("markers", report.markers.len(), 41)?;
    let super::tracked::Errors { mean, worst, .. } =
        super::tracked::errors_cm(&std::fs::read(&request.output)?, &std::fs::read_to_string(named("truth_joints.csv"))?)?;
    if mean <= bound.mean_cm && worst <= bound.worst_cm {
        Ok(())
    } else {
        Err(format!("mean {mean:.3} cm, worst {worst:.2} cm; allowed are {} and {}", bound.mean_cm, bound.worst_cm).into())
    }
}

/// The table without some of its samples, always the same ones.
fn holed(table: &str, hidden: u64) -> String {
    let mut state = 11_u64;
    let mut draw = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % 100
    };
    let mut lines = table.lines();
    let mut text = lines.next().unwrap_or_default().to_owned() + "\n";
    for line in lines {
        let mut cells: Vec<&str> = line.split(',').collect();
        for sample in cells[1..].chunks_exact_mut(3) {
            if draw() < hidden {
                sample.fill("");
            }
        }
        text += &cells.join(",");
        text.push('\n');
    }
    text
}
