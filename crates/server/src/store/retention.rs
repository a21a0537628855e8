//! What expires.

use super::StoreError;
use async_trait::async_trait;
use jiff::Timestamp;
use std::collections::BTreeSet;
use uuid::Uuid;

/// Expiry of jobs and scenes.
#[async_trait]
pub trait Retention: Send + Sync {
    /// Makes a job stay, or expire again; false where there is no such job.
    async fn pin(&self, job: Uuid, pinned: bool) -> Result<bool, StoreError>;
    /// Jobs that ended before `before` and are not pinned, those that ended first at the front.
    async fn expired(&self, before: Timestamp, limit: u32) -> Result<Vec<Uuid>, StoreError>;
    /// Bytes of all pictures and scenes that records name.
    async fn stored_bytes(&self) -> Result<u64, StoreError>;
    /// Scenes that no job names, deleted ones included, and that nobody sent or used since
    /// `before`.
    async fn unused_scenes(&self, before: Timestamp, limit: u32)
    -> Result<Vec<String>, StoreError>;
    /// Forgets a scene, unless a job names it or it was used since `before`; whether it did.
    async fn forget_scene(&self, scene: &str, before: Timestamp) -> Result<bool, StoreError>;
    /// Notes that a scene is wanted now; false where it is not there any more.
    async fn use_scene(&self, scene: &str) -> Result<bool, StoreError>;
    /// Whether there is a record of that job, deleted or not.
    async fn knows_job(&self, job: Uuid) -> Result<bool, StoreError>;
    /// Hashes of all pictures of a job.
    async fn picture_hashes(&self, job: Uuid) -> Result<BTreeSet<String>, StoreError>;
}
