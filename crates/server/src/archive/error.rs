//! Why an archive is not read.

use crate::worker::scenes::SceneRefusal;
use std::io;

/// Why an archive is not read.
#[derive(Debug)]
pub enum ArchiveError {
    /// It cannot be used.
    Refused(SceneRefusal),
    /// Its file cannot be read.
    Trouble(io::Error),
}

impl From<io::Error> for ArchiveError {
    fn from(error: io::Error) -> Self {
        // What is wrong with a member comes by way of reading it.
        match error.downcast::<SceneRefusal>() {
            Ok(refusal) => Self::Refused(refusal),
            Err(error) => Self::Trouble(error),
        }
    }
}

impl From<SceneRefusal> for ArchiveError {
    fn from(refusal: SceneRefusal) -> Self {
        Self::Refused(refusal)
    }
}

/// What a sender can do about an archive that is no proper one.
const FIX_ARCHIVE: &str = "pack the scene again as a plain zip archive, or send one .glb";

/// A refusal of a member, or of the whole archive.
pub fn refused(at: &str, what: impl Into<String>) -> SceneRefusal {
    SceneRefusal {
        at: at.chars().take(100).collect(),
        what: what.into(),
        fix: FIX_ARCHIVE.into(),
        too_large: false,
    }
}
