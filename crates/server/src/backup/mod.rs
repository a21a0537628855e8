//! Backups of a data folder: taken while a server runs on it, and restored into an empty one.
//!
//! A backup is a folder: the database as it was at one moment, the files that its records name,
//! the SHA-256 of each of them, and a manifest, which is written last. The folder gets its name
//! when all of it is on disk, so there is no half of a backup.

mod copy;
mod error;
mod manifest;
mod restore;
mod take;

pub use error::BackupError;
pub use manifest::{FILES, MANIFEST, Manifest};
pub use restore::{restore, restore_database};
pub use take::take;

#[cfg(test)]
mod tests;
