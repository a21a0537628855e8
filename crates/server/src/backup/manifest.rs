//! What a backup says of itself.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use uuid::Uuid;

/// Name of the manifest.
pub const MANIFEST: &str = "manifest.json";
/// Name of the list of files with their hashes, in the format of `sha256sum`.
pub const FILES: &str = "files.sha256";
/// The format of backups that this program writes and reads.
pub const FORMAT: u32 = 1;

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
