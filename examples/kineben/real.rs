//! Sequences from files, with the truth beside them: `model.off`, `.skl`, `.vj`, `.cst`, `clouds/frame_%03d.off` and `truth_joints.csv`.

use super::variants::Sequence;
use mocap_repair::rig::{RigFiles, read_rig};
use mocap_repair::solve::ik::Vec3;
use mocap_repair::track::{self, Pattern};
use std::path::Path;

/// Reads a sequence.
///
/// # Errors
/// In words.
pub fn read(folder: &Path) -> Result<Sequence, String> {
    let named = |name: &str| folder.join(name);
    let rig = read_rig(&RigFiles {
        skeleton: named("model.skl"),
        surface: named("model.off"),
        parts: named("model.vj"),
        limits: Some(named("model.cst")),
        unit: None,
        angles: None,
        swing_twist: false,
        spine: false,
    });
    let rig = rig.map_err(|e| e.to_string())?;
    let pattern = Pattern::parse(&format!("{}/clouds/frame_%03d.off", folder.display()))?;
    let files = track::Sequence::find(&pattern, None, None).map_err(|e| e.to_string())?;
    let clouds = std::thread::scope(|scope| {
        let frames = files.read(rig.unit.cm(), scope);
        frames.map(|frame| frame.map(|frame| frame.cloud)).collect::<Result<Vec<_>, _>>().map_err(|e| e.to_string())
    })?;
    let truth = std::fs::read_to_string(named("truth_joints.csv")).map_err(|e| format!("truth_joints.csv: {e}"))?;
    let names: Vec<&str> = rig.names().collect();
    let joints = read_truth(&truth, &names, rig.unit.cm())?;
    if joints.len() != clouds.len() {
        return Err(format!("{}: {} clouds, and the truth of {} frames", folder.display(), clouds.len(), joints.len()));
    }
    Ok(Sequence { body: rig.body, limits: rig.limits, start: rig.start, clouds, joints })
}

/// Where the joints of `names` are, cm; NaN for those that the table does not have.
fn read_truth(text: &str, names: &[&str], unit_cm: f64) -> Result<Vec<Vec<Vec3>>, String> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let columns: Vec<Option<usize>> = names.iter().map(|name| header.iter().position(|h| h.strip_suffix("_x") == Some(name))).collect();
    let row = |line: &str| {
        let cells: Vec<f64> = line.split(',').map(str::parse).collect::<Result<_, _>>().map_err(|e| format!("{line}: {e}"))?;
        let place = |at: &Option<usize>| match at {
            Some(at) if at + 3 <= cells.len() => Vec3::from_column_slice(&cells[*at..at + 3]) * unit_cm,
            _ => Vec3::repeat(f64::NAN),
        };
        Ok(columns.iter().map(place).collect())
    };
    lines.map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_truth_is_read_by_name() {
        let rows = read_truth("frame,b_x,b_y,b_z,a_x,a_y,a_z\n0,1,2,3,4,5,6\n1,7,8,9,10,11,12\n", &["a", "c", "b"], 2.0);
        let rows = rows.expect("a table");
        assert_eq!(rows.len(), 2);
        assert_eq!((rows[1][0], rows[1][2]), (Vec3::new(20.0, 22.0, 24.0), Vec3::new(14.0, 16.0, 18.0)));
        assert!(rows[0][1].x.is_nan());
        assert!(read_truth("frame,a_x,a_y,a_z\n0,x,1,2\n", &["a"], 1.0).is_err());
    }
}
