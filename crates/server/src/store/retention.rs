//! What expires.

use super::error::StoreError;
use async_trait::async_trait;
use jiff::Timestamp;
use std::collections::BTreeSet;
use uuid::Uuid;

/// What the records say of a job's files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Recorded {
    /// There is no such job.
    Unknown,
    /// The job has not ended, and its files come before their records; or it is deleted, and they
    /// go with it. These are named already.
    Open(BTreeSet<String>),
    /// The job has ended with files of these names: pictures, and what is kept of its solution.
    Ended(BTreeSet<String>),
}

/// Expiry of jobs, scenes and maps of skies.
#[async_trait]
pub trait Retention: Send + Sync {
    /// Jobs that ended before `before` and are not pinned, those that ended first at the front.
    async fn expired(&self, before: Timestamp, limit: u32) -> Result<Vec<Uuid>, StoreError>;
    /// Deletes a job, unless it was pinned, extended or deleted since it was found; whether it did.
    async fn hide_expired(&self, job: Uuid) -> Result<bool, StoreError>;
    /// Scenes, and maps of skies, that no job names, deleted ones included, and that nobody sent or used since
    /// `before`.
    async fn unused_scenes(&self, before: Timestamp, limit: u32)
    -> Result<Vec<String>, StoreError>;
    /// Forgets a scene, unless a job names it or it was used since `before`; whether it did.
    async fn forget_scene(&self, scene: &str, before: Timestamp) -> Result<bool, StoreError>;
    /// Notes that a scene is wanted now; false where it is not there any more.
    async fn use_scene(&self, scene: &str) -> Result<bool, StoreError>;
    /// What the records say of a job's files.
    async fn recorded_files(&self, job: Uuid) -> Result<Recorded, StoreError>;
}
