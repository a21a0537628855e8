//! Backups of a data folder: taken while a server runs on it, and restored into an empty one.
//!
//! A backup is a folder: the database as it was at one moment, the files that its records name,
//! the SHA-256 of each of them, and a manifest, which is written last. The folder gets its name
//! when all of it is on disk, so there is no half of a backup.

mod copy;
mod restore;
mod take;

pub use restore::{restore, restore_database};
pub use take::take;

use crate::artifacts::ArtifactError;
use crate::data_folder::FolderError;
use crate::store::StoreError;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use uuid::Uuid;

/// Name of the manifest.
pub const MANIFEST: &str = "manifest.json";
/// Name of the list of files with their hashes, in the format of `sha256sum`.
pub const FILES: &str = "files.sha256";
/// The format of backups that this program writes and reads.
const FORMAT: u32 = 1;

/// What a backup says of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Format of the backup.
    pub format: u32,
    /// Version of the program that took it.
    pub program: String,
    /// Version of the database's tables.
    pub tables: i64,
    /// The id of the store.
    pub store_id: Uuid,
    /// When it was taken, by the wall clock.
    pub taken_at: Timestamp,
    /// Jobs in it.
    pub jobs: u64,
    /// Scenes in it.
    pub scenes: u64,
    /// Files of scenes and jobs in it.
    pub files: u64,
    /// Bytes of these files.
    pub bytes: u64,
    /// SHA-256 of the database's file.
    pub database_sha256: String,
    /// SHA-256 of the list of files.
    pub files_sha256: String,
    /// Files that records name and that the data folder itself did not have whole: paths, each
    /// with what is wrong.
    pub lost: Vec<String>,
    /// Jobs whose checkpoint could not be had while they ran: in the backup they begin afresh.
    pub begin_afresh: Vec<Uuid>,
}

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
fn at(path: &Path) -> impl Fn(std::io::Error) -> BackupError {
    move |source| BackupError::System { path: path.to_owned(), source }
}

/// Refuses a folder that holds anything but what is allowed.
fn refuse_filled(folder: &Path, allowed: &[&str]) -> Result<(), BackupError> {
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

#[cfg(test)]
mod tests;
