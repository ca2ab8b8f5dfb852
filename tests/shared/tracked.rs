//! Sequences of clouds with known truth: how far joints are from it when a body was followed.

use libtest_mimic::{Failed, Trial};
use mocap_repair::rig::{RigFiles, read_rig};
use mocap_repair::solve::track::{Method, Settings};
use mocap_repair::track::{Pattern, Request, track};
use std::ops::{Range, RangeInclusive};
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A sequence, a method, and between what its distances of joints from the truth have to be, cm: their mean, the largest one, and the share of frames
/// whose own mean is beyond 5 cm.
struct Bound {
    sequence: &'static str,
    method: Method,
    mean_cm: Range<f64>,
    worst_cm: Range<f64>,
    lost: RangeInclusive<f64>,
}

/// A frame whose joints are farther off than this on average is lost, cm.
const LOST_CM: f64 = 5.0;

/// The report's own method is to be as good as it was measured elsewhere within 20 %, and not much better: 1.26, 19 and 0, and 11.05, 126 and 0.58.
const BOUNDS: [Bound; 4] = [
    Bound { sequence: "walk", method: Method::Planes, mean_cm: 0.0..0.45, worst_cm: 0.0..1.75, lost: 0.0..=0.0 },
    Bound { sequence: "gym", method: Method::Planes, mean_cm: 0.0..0.60, worst_cm: 0.0..2.5, lost: 0.0..=0.0 },
    Bound { sequence: "walk", method: Method::Report, mean_cm: 1.01..1.51, worst_cm: 15.2..22.8, lost: 0.0..=0.0 },
    Bound { sequence: "gym", method: Method::Report, mean_cm: 8.84..13.26, worst_cm: 100.8..151.2, lost: 0.464..=0.696 },
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
        dry_run: false,
    };
    read_rig(&request.rig)?;
    track(&request, &mut (), &AtomicBool::new(false))?;
    let Errors { mean, worst, lost } =
        errors_cm(&std::fs::read(output.path().join("out.bvh"))?, &std::fs::read_to_string(named("truth_joints.csv"))?)?;
    let fine = bound.mean_cm.contains(&mean) && bound.worst_cm.contains(&worst) && bound.lost.contains(&lost);
    if fine {
        Ok(())
    } else {
        let Bound { mean_cm, worst_cm, lost: share, .. } = bound;
        Err(format!("mean {mean:.3} cm, worst {worst:.2} cm, lost {lost:.3}; allowed are {mean_cm:?}, {worst_cm:?} and {share:?}").into())
    }
}

/// Distances of joints from the truth, cm.
pub struct Errors {
    /// Their mean.
    pub mean: f64,
    /// The largest one.
    pub worst: f64,
    /// The share of frames whose own mean is beyond 5 cm.
    pub lost: f64,
}

/// How far the joints of a BVH file are from those of a table.
pub fn errors_cm(bvh: &[u8], truth: &str) -> Result<Errors, Failed> {
    use formats::{Format, Notes, Stated, Unit};
    let stated = Stated { unit: Some(Unit::Centimetre), ..Stated::default() };
    let document = formats::bvh::Bvh.open(bvh.to_vec(), &stated, &Notes::new())?;
    let take = document.take();
    let mut lines = truth.lines();
    let joints: Vec<&str> =
        lines.next().unwrap_or_default().split(',').skip(1).step_by(3).filter_map(|name| name.strip_suffix("_x")).collect();
    let (mut sum, mut count, mut worst, mut lost) = (0.0, 0, 0.0_f64, 0_u32);
    for (frame, line) in lines.enumerate() {
        let row: Vec<f64> = line.split(',').map(str::parse).collect::<Result<_, _>>()?;
        let before = sum;
        for (at, joint) in joints.iter().enumerate() {
            let column = (0..take.markers.len()).find(|&m| take.markers[m].label == *joint).ok_or("a joint is missing")?;
            let is = take.position_mm(frame, column).ok_or("a joint is nowhere")?;
            let off = (0..3).map(|k| (is[k] / 10.0 - row[1 + 3 * at + k]).powi(2)).sum::<f64>().sqrt();
            sum += off;
            count += 1;
            worst = worst.max(off);
        }
        if (sum - before) / joints.len() as f64 > LOST_CM {
            lost += 1;
        }
    }
    super::expect("frames", take.frames(), count / joints.len().max(1))?;
    super::expect("joints", joints.len(), 14)?;
    Ok(Errors { mean: sum / f64::from(u32::try_from(count)?), worst, lost: f64::from(lost) / take.frames() as f64 })
}
