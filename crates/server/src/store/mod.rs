//! Where scenes, jobs and events are kept. One interface; the embedded implementation is
//! [`sqlite`]. Everything that a client was promised is on disk when a call returns.

pub mod bytes;
#[cfg(test)]
pub(crate) mod conformance;
pub mod environments;
mod error;
mod jobs;
pub mod keys;
pub mod meta;
pub mod outbox;
pub mod retention;
pub mod scenes;
pub mod solutions;
#[cfg(test)]
pub(crate) mod specimens;
pub mod sqlite;

use crate::api::events::Event;
use crate::api::jobs::{Job, Picture, PictureFormat, Progress};
use crate::api::scenes::Scene;
use crate::job_state::Cause;
use async_trait::async_trait;
use uuid::Uuid;

pub use bytes::Bytes;
pub use environments::Environments;
pub use error::StoreError;
pub use jobs::{
    Accepted, Asking, Claim, JobCounts, JobFilter, Lease, MAX_PROGRESS_EVENTS, NewJob, Outcome,
    Report,
};
pub use keys::{Keys, Submitter};
pub use meta::Meta;
pub use outbox::Outbox;
pub use retention::{Recorded, Retention};
pub use scenes::Holdings;

/// The store of one service.
#[async_trait]
pub trait Store:
    Bytes + Keys + Meta + Outbox + Retention + Holdings + Environments + solutions::Solutions
{
    /// Stores a scene; false where it was there already.
    async fn put_scene(&self, scene: &Scene) -> Result<bool, StoreError>;
    /// The scene of that id, whoever holds it; [`Holdings::shown_scene`] is for showing it.
    async fn scene(&self, id: &str) -> Result<Option<Scene>, StoreError>;

    /// Queues a job unless `max_queued` are waiting. Durable on return.
    async fn accept(&self, job: NewJob, max_queued: u64) -> Result<Accepted, StoreError>;
    /// The job of that id.
    async fn job(&self, id: Uuid) -> Result<Option<Job>, StoreError>;
    /// Jobs, newest first.
    async fn jobs(&self, filter: &JobFilter) -> Result<Vec<Job>, StoreError>;
    /// How many there are.
    async fn counts(&self) -> Result<JobCounts, StoreError>;
    /// Asks a job to end; terminal jobs stay as they are. `None` where there is no such job.
    async fn cancel(&self, id: Uuid) -> Result<Option<Job>, StoreError>;
    /// Hides a job for good, ending it first if it has not; true where there was one.
    async fn delete(&self, id: Uuid) -> Result<bool, StoreError>;
    /// Forgets some of the jobs hidden for `older_than_ms` and longer, in short writes between which
    /// others get their turn; the ids of those that are gone, none where there are no more.
    async fn purge(&self, older_than_ms: i64) -> Result<Vec<Uuid>, StoreError>;

    /// Takes the next queued job: the highest priority first; within it, those who pay for jobs
    /// take turns, and each one's jobs go in the order in which they came.
    async fn claim(&self, asking: &Asking<'_>) -> Result<Option<(Claim, Job)>, StoreError>;
    /// Writes what a worker has to say; whether the job is asked to end.
    async fn report(&self, claim: Claim, report: Report) -> Result<bool, StoreError>;
    /// Ends a job; state and terminal event in one transaction.
    async fn finish(&self, claim: Claim, outcome: Outcome) -> Result<(), StoreError>;
    /// Puts a claimed job back, or gives it up; `cause` decides whether the attempt counts.
    async fn release(&self, claim: Claim, cause: Cause, reason: &str) -> Result<(), StoreError>;
    /// Puts back every job that this process still holds, uncounted; how many there were.
    async fn release_all(&self) -> Result<u64, StoreError>;
    /// Puts back, or gives up, the jobs of every other process. Only for callers who know that
    /// there is none any more.
    async fn recover(&self) -> Result<Vec<Uuid>, StoreError>;
    /// Gives signs of life for claims; returns those that do not hold any more.
    async fn renew(&self, claims: &[Claim]) -> Result<Vec<Claim>, StoreError>;
    /// Every lease there is.
    async fn leases(&self) -> Result<Vec<Lease>, StoreError>;
    /// Puts back, or gives up, the job of a lease that showed no life; whether it did: not where
    /// there was a sign of life after `lease` was read.
    async fn expire(&self, lease: &Lease, reason: &str) -> Result<bool, StoreError>;
    /// A succeeded job of the same render key, the newest; its pictures can be shared.
    async fn twin(&self, claim: Claim) -> Result<Option<Job>, StoreError>;

    /// Events of a job with numbers above `after`, oldest first.
    async fn events(&self, job: Uuid, after: u64, limit: u32) -> Result<Vec<Event>, StoreError>;
    /// Progress events of a job's latest claim, oldest first.
    async fn trace(&self, job: Uuid) -> Result<Vec<Progress>, StoreError>;
    /// The newest picture of that format.
    async fn newest_picture(
        &self,
        job: Uuid,
        format: PictureFormat,
    ) -> Result<Option<Picture>, StoreError>;
    /// The picture of that content.
    async fn picture(
        &self,
        job: Uuid,
        sha256: &str,
        format: PictureFormat,
    ) -> Result<Option<Picture>, StoreError>;
    /// Whether the store answers and can be written.
    async fn ping(&self) -> Result<(), StoreError>;
    /// Flushes and closes.
    async fn close(&self);
}
