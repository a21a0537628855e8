//! Where it is recorded what jobs know and begin with.

use super::error::StoreError;
use super::jobs::{Accepted, Claim, NewJob};
use crate::api::jobs::{Job, JobRequest};
use crate::api::solutions::Solution;
use async_trait::async_trait;
use uuid::Uuid;

/// What became of an extension.
#[derive(Clone, Debug)]
pub enum Extended {
    /// The job is queued again.
    Queued(Box<Job>),
    /// There is no such job.
    Missing,
    /// It has not ended, or it failed and has no result.
    NotNow(Box<Job>),
    /// The queue is full.
    QueueFull,
    /// As many jobs of whoever pays for it wait as may.
    OwnQueueFull,
}

/// The part of a store that knows of solutions.
#[async_trait]
pub trait Solutions: Send + Sync {
    /// Records what a claimed job knows now; what it replaces. Files first: they are there.
    async fn keep_solution(
        &self,
        claim: Claim,
        solution: &Solution,
    ) -> Result<Option<Solution>, StoreError>;
    /// What that job begins with, or knew last.
    async fn solution(&self, job: Uuid) -> Result<Option<Solution>, StoreError>;
    /// Forgets it; what it was.
    async fn drop_solution(&self, job: Uuid) -> Result<Option<Solution>, StoreError>;
    /// Queues a job that begins with a solution, whose file is in its folder.
    async fn accept_view(
        &self,
        job: NewJob,
        solution: &Solution,
        max_queued: u64,
    ) -> Result<Accepted, StoreError>;
    /// Queues a job again that succeeded, was cancelled, or has a result of before it failed, with
    /// new limits, unless `max_queued` are waiting, or `max_own` of those that whoever pays for it
    /// sent. The result stays until there is another.
    async fn extend(
        &self,
        job: Uuid,
        request: &JobRequest,
        max_queued: u64,
        max_own: Option<u64>,
    ) -> Result<Extended, StoreError>;
}
