//! How many bytes are stored and for whom, and which of them can go.

use super::error::StoreError;
use super::jobs::Claim;
use crate::api::events::NoticeEvent;
use crate::api::jobs::Picture;
use async_trait::async_trait;
use jiff::Timestamp;
use uuid::Uuid;

/// The snapshots that a job has stored.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Snapshots {
    /// The number of each one's event and its bytes in all formats, oldest first.
    pub stored: Vec<(u64, u64)>,
    /// How often every second one was removed, in this run of the job and those before.
    pub thinned: u32,
}

/// Bytes of what stays unless something is removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Staying {
    /// Of pictures and solutions of jobs that are not deleted, and of scenes that these name or
    /// that were used lately.
    pub bytes: u64,
    /// Of that, what may not go to make room: jobs that are pinned or have not ended, and scenes
    /// that these or jobs without files name, or that were used lately.
    pub fixed: u64,
}

/// What became of a wish to pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pinned {
    /// It is as was wished.
    Done,
    /// There is no such job.
    Missing,
    /// The payer has a quota of pinned bytes, and the job has not ended: how many it will have is not
    /// known.
    NotYet,
    /// The payer's pinned jobs would have more bytes than they may.
    OverQuota {
        /// Bytes of the payer's pinned jobs.
        pinned: u64,
        /// Bytes of this one.
        job: u64,
    },
}

/// Bytes: of the store, of payers, of a job's snapshots.
#[async_trait]
pub trait Bytes: Send + Sync {
    /// Bytes of all that is stored: scenes, and pictures and solutions of jobs that are not deleted.
    async fn stored_bytes(&self) -> Result<u64, StoreError>;
    /// Bytes of pictures and solutions of a payer's jobs.
    async fn payer_bytes(&self, billed_to: &str) -> Result<u64, StoreError>;
    /// What a job's payer may still store by its quota; `None` where it has none.
    async fn room(&self, job: Uuid) -> Result<Option<u64>, StoreError>;
    /// Makes a job stay, or expire again. It does not become pinned where its payer's pinned jobs
    /// would then have more than `most` bytes.
    async fn pin(&self, job: Uuid, pinned: bool, most: Option<u64>) -> Result<Pinned, StoreError>;
    /// What stays, where scenes that were used since `before` stay for that.
    async fn staying(&self, before: Timestamp) -> Result<Staying, StoreError>;
    /// The job to remove next for want of space: of the payer who stores most, scenes that they
    /// hold included, of those who have any that may go, the one that ended first. Pinned jobs stay,
    /// and those that have not ended. With its bytes.
    async fn evictable(&self) -> Result<Option<(Uuid, u64)>, StoreError>;
    /// The snapshots of a job.
    async fn snapshots(&self, job: Uuid) -> Result<Snapshots, StoreError>;
    /// Forgets those snapshots of a claimed job, by the numbers of their events, with the events,
    /// and tells why; the pictures that nothing names any more. Records first, files after.
    async fn drop_snapshots(
        &self,
        claim: Claim,
        events: &[u64],
        notice: NoticeEvent,
    ) -> Result<Vec<Picture>, StoreError>;
}
