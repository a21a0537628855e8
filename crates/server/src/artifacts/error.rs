//! What goes wrong with files.

use crate::failpoints;
use object_store::path::Path as Key;

/// Why a file could not be kept or found.
#[derive(Debug, thiserror::Error)]
pub enum ArtifactError {
    /// The storage refused or is unreachable.
    #[error("artifacts: {0}")]
    Storage(#[from] object_store::Error),
    /// What is to be stored, or was stored, cannot be read.
    #[error("artifacts: {0}")]
    Unreadable(#[from] std::io::Error),
    /// The file is there, but its content is not what was stored.
    #[error("artifacts: {file} is damaged; restore it from a backup")]
    Damaged {
        /// Where it lies, relative to the folder of files.
        file: String,
    },
}

impl ArtifactError {
    /// Whether there simply is no such file.
    pub fn is_not_found(&self) -> bool {
        matches!(self, Self::Storage(object_store::Error::NotFound { .. }))
    }

    /// Whether trying again cannot help: the file is lost or damaged.
    pub fn is_lasting(&self) -> bool {
        self.is_not_found() || matches!(self, Self::Damaged { .. })
    }
}

/// Where a test may make the storage fail or the program die.
pub(super) fn failpoint(point: &'static str, key: &Key) -> Result<(), ArtifactError> {
    failpoints::pass(point, || key.to_string()).map_err(|injected| {
        object_store::Error::Generic { store: "failpoint", source: Box::new(injected) }.into()
    })
}

/// Says that a file is damaged, to the log too.
pub(super) fn damaged(key: &Key) -> ArtifactError {
    tracing::error!(file = %key, "a stored file is damaged");
    ArtifactError::Damaged { file: key.to_string() }
}
