//! Sequences of clouds with known truth: how far joints are from it when a body was followed.

use libtest_mimic::{Failed, Trial};
use mocap_repair::rig::{RigFiles, read_rig};
use mocap_repair::solve::track::{Method, Settings};
use mocap_repair::track::{Pattern, Request, track};
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A sequence, a method, and the mean and largest distance of joints from the truth, cm, that it must not exceed.
struct Bound {
    sequence: &'static str,
    method: Method,
    mean_cm: std::ops::Range<f64>,
    worst_cm: f64,
}

/// The report's own method is to be as good as it was measured elsewhere, and not much better.
const BOUNDS: [Bound; 4] = [
    Bound { sequence: "walk", method: Method::Planes, mean_cm: 0.0..0.45, worst_cm: 1.75 },
    Bound { sequence: "gym", method: Method::Planes, mean_cm: 0.0..0.60, worst_cm: 2.5 },
    Bound { sequence: "walk", method: Method::Report, mean_cm: 1.01..1.51, worst_cm: f64::INFINITY },
    Bound { sequence: "gym", method: Method::Report, mean_cm: 8.84..13.26, worst_cm: f64::INFINITY },
];

/// The tests, as far as their sequences are there.
pub fn trials(data: &Path) -> Vec<Trial> {
    let there = BOUNDS.iter().filter(|bound| data.join("kineben").join(bound.sequence).is_dir());
    there
        .map(|bound| {
            let folder = data.join("kineben").join(bound.sequence);
            Trial::test(format!("track {} by {:?}", bound.sequence, bound.method), move || followed(&folder, bound))
        })
        .collect()
}

fn followed(folder: &Path, bound: &Bound) -> Result<(), Failed> {
    let output = tempfile::tempdir()?;
    let named = |name: &str| folder.join(name);
    let request = Request {
        clouds: Pattern::parse(&format!("{}/clouds/frame_%03d.off", folder.display()))?,
        first: None,
        last: None,
        rig: RigFiles {
            skeleton: named("model.skl"),
            surface: named("model.off"),
            parts: named("model.vj"),
            limits: Some(named("model.cst")),
            unit: None,
            angles: None,
            swing_twist: false,
            spine: false,
        },
        settings: Settings::of(bound.method),
        rate_hz: 30.0,
        order: formats::bvh::Order::default(),
        output: output.path().join("out.bvh"),
        table: output.path().join("out.csv"),
        log: None,
        log_rate_hz: None,
        page: None,
        force: false,
    };
    read_rig(&request.rig)?;
    track(&request, &mut (), &AtomicBool::new(false))?;
    let (mean, worst) = errors_cm(&std::fs::read(output.path().join("out.bvh"))?, &std::fs::read_to_string(named("truth_joints.csv"))?)?;
    let fine = bound.mean_cm.contains(&mean) && worst <= bound.worst_cm;
    if fine {
        Ok(())
    } else {
        Err(format!("mean {mean:.3} cm, worst {worst:.2} cm; allowed are {:?} and {}", bound.mean_cm, bound.worst_cm).into())
    }
}

/// Mean and largest distance of the joints of a BVH file from those of a table, cm.
pub fn errors_cm(bvh: &[u8], truth: &str) -> Result<(f64, f64), Failed> {
    use formats::{Format, Notes, Stated, Unit};
    let stated = Stated { unit: Some(Unit::Centimetre), ..Stated::default() };
    let document = formats::bvh::Bvh.open(bvh.to_vec(), &stated, &Notes::new())?;
    let take = document.take();
    let mut lines = truth.lines();
    let joints: Vec<&str> =
        lines.next().unwrap_or_default().split(',').skip(1).step_by(3).filter_map(|name| name.strip_suffix("_x")).collect();
    let (mut sum, mut count, mut worst) = (0.0, 0, 0.0_f64);
    for (frame, line) in lines.enumerate() {
        let row: Vec<f64> = line.split(',').map(str::parse).collect::<Result<_, _>>()?;
        for (at, joint) in joints.iter().enumerate() {
            let column = (0..take.markers.len()).find(|&m| take.markers[m].label == *joint).ok_or("a joint is missing")?;
            let is = take.position_mm(frame, column).ok_or("a joint is nowhere")?;
            let off = (0..3).map(|k| (is[k] / 10.0 - row[1 + 3 * at + k]).powi(2)).sum::<f64>().sqrt();
            sum += off;
            count += 1;
            worst = worst.max(off);
        }
    }
    super::expect("frames", take.frames(), count / joints.len().max(1))?;
    super::expect("joints", joints.len(), 14)?;
    Ok((sum / f64::from(u32::try_from(count)?), worst))
}
