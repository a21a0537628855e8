//! Why there is no backup, and folders that must not be touched.

use crate::artifacts::ArtifactError;
use crate::data_folder::FolderError;
use crate::store::StoreError;
use std::path::{Path, PathBuf};

/// Why there is no backup, or why it is not restored.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// The system refused.
    #[error("{}: {source}", path.display())]
    System {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The database refused.
    #[error("{0}")]
    Store(#[from] StoreError),
    /// The data folder cannot be used.
    #[error("{0}")]
    Folder(#[from] FolderError),
    /// The files cannot be looked at.
    #[error("{0}")]
    Files(#[from] ArtifactError),
    /// It must not be done as asked.
    #[error("{0}")]
    Refused(String),
    /// The backup is not as it was taken.
    #[error("the backup {} is damaged: {what}; use another one", folder.display())]
    Damaged {
        /// Its folder.
        folder: PathBuf,
        /// What is wrong.
        what: String,
    },
}

/// Names the file in the system's errors.
pub fn at(path: &Path) -> impl Fn(std::io::Error) -> BackupError {
    move |source| BackupError::System { path: path.to_owned(), source }
}

/// Refuses a folder that holds anything but what is allowed.
pub fn refuse_filled(folder: &Path, allowed: &[&str]) -> Result<(), BackupError> {
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(at(folder)(error)),
    };
    for entry in entries {
        let name = entry.map_err(at(folder))?.file_name();
        if !allowed.iter().any(|allowed| name == *allowed) {
            return Err(BackupError::Refused(format!(
                "{} is not empty (there is {}); give a new or an empty folder",
                folder.display(),
                name.display()
            )));
        }
    }
    Ok(())
}
