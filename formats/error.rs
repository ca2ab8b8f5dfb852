//! Why a file could not be read or written, and where in it.

/// Where in the file the problem stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// Somewhere in the whole file.
    Whole,
    /// A byte of a binary file.
    Byte {
        /// Offset from the start of the file.
        offset: u64,
        /// The part of the file, such as `parameters`.
        section: &'static str,
    },
    /// A line of a text file.
    Line {
        /// Counted from 1.
        line: u64,
        /// Cell of the line, counted from 1.
        column: Option<u64>,
    },
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Whole => Ok(()),
            Self::Byte { offset, section } => write!(f, " ({section}, byte {offset:#x})"),
            Self::Line { line, column: None } => write!(f, " (line {line})"),
            Self::Line { line, column: Some(column) } => write!(f, " (line {line}, column {column})"),
        }
    }
}

/// What kind of problem it is. The text says what was found, what was expected, and the way out.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The file is not what its format asks for.
    #[error("{0}")]
    Malformed(String),
    /// The file is right, but we cannot do this with it.
    #[error("{0}")]
    Unsupported(String),
    /// A size is beyond a limit of ours.
    #[error("{0}")]
    TooLarge(String),
    /// Writing failed.
    #[error("{0}")]
    Io(#[from] std::io::Error),
}

/// Why a file could not be read or written. The path is added once, by the caller.
#[derive(Debug, thiserror::Error)]
#[error("{format}: {problem}{place}")]
pub struct FormatError {
    /// Name of the format.
    pub format: &'static str,
    /// Where.
    pub place: Place,
    /// What.
    #[source]
    pub problem: Problem,
}

impl FormatError {
    /// The file is not what its format asks for.
    pub fn malformed(format: &'static str, place: Place, text: impl Into<String>) -> Self {
        Self { format, place, problem: Problem::Malformed(text.into()) }
    }

    /// The file is right, but we cannot do this with it.
    pub fn unsupported(format: &'static str, place: Place, text: impl Into<String>) -> Self {
        Self { format, place, problem: Problem::Unsupported(text.into()) }
    }

    /// A size is beyond a limit of ours.
    pub fn too_large(format: &'static str, place: Place, text: impl Into<String>) -> Self {
        Self { format, place, problem: Problem::TooLarge(text.into()) }
    }

    /// Writing failed.
    pub fn io(format: &'static str, error: std::io::Error) -> Self {
        Self { format, place: Place::Whole, problem: Problem::Io(error) }
    }
}
