//! Opens the files of a folder with c3dio or with this project, and prints one line per file: `opened`, `refused` or `panicked`,
//! and for cut files whether the points are those of `whole.c3d`.
//!
//! `MOCAP_HOSTILITY_DUMP=FOLDER cargo test --test hostility` writes the folder.

use formats::{Format, Note, Notes, Stated};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// All coordinates of a file, point by point; `None` if it was refused.
type Points = Option<Vec<[f32; 3]>>;

fn with_c3dio(path: &Path) -> (Points, bool) {
    let Ok(c3d) = c3dio::prelude::C3d::load(&path.to_string_lossy()) else { return (None, false) };
    let mut points = Vec::new();
    for frame in c3d.points.points.iter_rows() {
        points.extend(frame.map(|p| p.point));
    }
    (Some(points), false)
}

/// The second value is true if it said that something is not whole.
fn with_ours(path: &Path) -> (Points, bool) {
    let notes = Notes::new();
    let Ok(document) = formats::c3d::C3d.open(std::fs::read(path).unwrap_or_default(), &Stated::default(), &notes) else {
        return (None, false);
    };
    let take = document.take();
    let all = (0..take.frames()).flat_map(|f| (0..take.markers.len()).map(move |m| (f, m)));
    let points = all.map(|(f, m)| take.position_mm(f, m).unwrap_or([f64::NAN; 3]).map(|x| x as f32)).collect();
    (Some(points), notes.take().iter().any(Note::matters))
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, reader, folder] = arguments.as_slice() else {
        eprintln!("peers c3dio|ours FOLDER");
        std::process::exit(2);
    };
    let read = if reader == "c3dio" { with_c3dio } else { with_ours };
    let whole = read(&Path::new(folder).join("whole.c3d")).0.unwrap_or_default();
    std::panic::set_hook(Box::new(|_| {}));
    let mut counts: BTreeMap<String, u32> = BTreeMap::new();
    let mut names: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    names.sort();
    for path in names {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let kind = name.split('_').next().unwrap_or_default().to_owned();
        let outcome = match catch_unwind(AssertUnwindSafe(|| read(&path))) {
            Err(_) => "panicked",
            Ok((None, _)) => "refused",
            Ok((Some(_), true)) => "opened, and said that it is not whole",
            Ok((Some(points), false)) if kind == "cut" => {
                let same = points.len() == whole.len() && points.iter().flatten().zip(whole.iter().flatten()).all(|(a, b)| a.to_bits() == b.to_bits());
                if same { "opened, with the same points" } else { "opened quietly with other points" }
            }
            Ok(_) => "opened",
        };
        *counts.entry(format!("{kind}: {outcome}")).or_default() += 1;
    }
    for (what, count) in counts {
        println!("{what}: {count}");
    }
}
