//! The body that wears the markers of a take, from its files, for whoever fills gaps.

use super::map::{Worn, read_map, wear};
use super::{Rig, RigFiles, read_rig};
use crate::input::{expand, read};
use crate::repair::RepairError;
use crate::solve::skeleton::Wearer;
use formats::{Note, Take};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A body and where it wears markers, as files.
#[derive(Clone, Debug)]
pub struct WearerFiles {
    /// The body.
    pub rig: RigFiles,
    /// The table of markers; see [`read_map`].
    pub map: PathBuf,
}

impl WearerFiles {
    /// All files that are read.
    pub fn all(&self) -> impl Iterator<Item = &Path> {
        self.rig.all().into_iter().map(|(_, path)| path).chain([self.map.as_path()])
    }

    /// Where the markers of `take` sit.
    ///
    /// # Errors
    /// The table cannot be read, or does not fit the take.
    pub fn worn(&self, rig: &Rig, take: &Take) -> Result<Worn, RepairError> {
        let wrong = |error| RepairError::Map { path: self.map.clone(), error };
        let placed = read_map(&expand(read(&self.map)?, &self.map)?, rig).map_err(wrong)?;
        wear(&placed, take).map_err(wrong)
    }

    /// The body that wears the markers of `take`, and what there is to say about that.
    ///
    /// # Errors
    /// A file cannot be read, or the files do not belong together.
    pub fn wearer(&self, take: &Take) -> Result<(Arc<Wearer>, Vec<Note>), RepairError> {
        let rig = read_rig(&self.rig)?;
        let worn = self.worn(&rig, take)?;
        let mut notes = rig.notes;
        for (names, what) in [
            (&worn.absent, "markers of --map that the take does not have"),
            (&worn.strangers, "markers that --map does not have are filled by splines"),
        ] {
            if !names.is_empty() {
                notes.push(Note::Assumed { text: format!("{what}: {}", names.join(", ")) });
            }
        }
        let markers = worn.markers.into_iter().map(|(column, _, marker, weight)| (column, marker, weight)).collect();
        Ok((Arc::new(Wearer { tree: rig.body.tree, limits: rig.limits, markers }), notes))
    }
}
