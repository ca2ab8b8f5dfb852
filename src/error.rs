//! Why a take could not be read, repaired or written.

use crate::bones::BonesError;
use crate::log::LogReadError;
use crate::missing::MissingError;
use crate::rig::map::MapError;
use crate::verify::Broken;
use formats::{DetectError, FormatError, Problem};
use std::io;
use std::path::{Path, PathBuf};

/// Why a take could not be repaired. Every text begins with the file it is about.
#[derive(Debug, thiserror::Error)]
pub enum RepairError {
    /// A file could not be read or written.
    #[error("{path}: {problem}", path = .path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// What was found, what was expected, the way out.
        problem: String,
    },
    /// The system did not let a file be read or written.
    #[error("{path}: {problem}", path = .path.display())]
    System {
        /// Which.
        path: PathBuf,
        /// What the system said.
        kind: io::ErrorKind,
        /// The same for people.
        problem: String,
    },
    /// The format is not known.
    #[error("{path}: {error}", path = .path.display())]
    Detect {
        /// Which file.
        path: PathBuf,
        /// Why.
        error: DetectError,
    },
    /// The content is not right, or cannot be written.
    #[error("{path}: {error}", path = .path.display())]
    Format {
        /// Which file.
        path: PathBuf,
        /// Why.
        error: FormatError,
    },
    /// The bones cannot be used.
    #[error("{path}: {error}", path = .path.display())]
    Bones {
        /// Which file.
        path: PathBuf,
        /// Why.
        error: BonesError,
    },
    /// It is not known where markers sit.
    #[error("{path}: {error}", path = .path.display())]
    Map {
        /// Which file.
        path: PathBuf,
        /// Why.
        error: MapError,
    },
    /// The samples stated to be missing cannot be found.
    #[error("{path}: {error}", path = .path.display())]
    Missing {
        /// The take.
        path: PathBuf,
        /// Why.
        error: MissingError,
    },
    /// A take is to be turned, and nobody says from where.
    #[error("{path}: does not say which axis points up, so it cannot be turned; say it with --from-up", path = .path.display())]
    NoUp {
        /// The take.
        path: PathBuf,
    },
    /// A pattern fits no marker.
    #[error("{path}: --markers {pattern} fits no marker; the take has {labels}", path = .path.display())]
    NoSuchMarker {
        /// The take.
        path: PathBuf,
        /// The pattern.
        pattern: String,
        /// What the take has.
        labels: String,
    },
    /// The written file is not what it should be.
    #[error("{path}: {error}", path = .path.display())]
    Verify {
        /// The output.
        path: PathBuf,
        /// What differs.
        error: Broken,
    },
    /// A log cannot be used.
    #[error("{path}: {error}", path = .path.display())]
    Log {
        /// The log.
        path: PathBuf,
        /// Why.
        error: LogReadError,
    },
    /// The solver broke down.
    #[error("{path}: {method} failed: {problem}; try --method spline, or fewer hidden dimensions with --hidden{log}", path = .path.display())]
    Solve {
        /// The take.
        path: PathBuf,
        /// Which method.
        method: &'static str,
        /// What broke.
        problem: String,
        /// What was left.
        log: Left,
    },
    /// Somebody stopped it.
    #[error("{path}: interrupted, no take was written{log}", path = .path.display())]
    Interrupted {
        /// The take.
        path: PathBuf,
        /// What was left.
        log: Left,
    },
}

impl RepairError {
    /// The file that it is about.
    pub fn path(&self) -> &Path {
        match self {
            Self::Io { path, .. }
            | Self::System { path, .. }
            | Self::Detect { path, .. }
            | Self::Format { path, .. }
            | Self::Bones { path, .. }
            | Self::Map { path, .. }
            | Self::Missing { path, .. }
            | Self::NoUp { path }
            | Self::NoSuchMarker { path, .. }
            | Self::Verify { path, .. }
            | Self::Log { path, .. }
            | Self::Solve { path, .. }
            | Self::Interrupted { path, .. } => path,
        }
    }

    /// What the system said, if it was the system's fault and not that of a file.
    pub fn system(&self) -> Option<io::ErrorKind> {
        match self {
            Self::System { kind, .. } => Some(*kind),
            Self::Format { error: FormatError { problem: Problem::Io(error), .. }, .. } => Some(error.kind()),
            _ => None,
        }
    }
}

/// True if there was no room to write to.
pub(crate) fn is_full(kind: io::ErrorKind) -> bool {
    matches!(kind, io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}

/// The log that a repair left which came to nothing, if it left one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Left(pub Option<PathBuf>);

impl std::fmt::Display for Left {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.as_ref().map_or(Ok(()), |log| write!(f, "; {} shows how far it came", log.display()))
    }
}
