//! Where scenes, jobs and events are kept. One interface; the embedded implementation is
//! [`sqlite`]. Everything that a client was promised is on disk when a call returns.

pub mod bytes;
#[cfg(test)]
pub(crate) mod conformance;
pub mod keys;
pub mod meta;
pub mod outbox;
pub mod retention;
pub mod scenes;
pub mod solutions;
pub mod sqlite;

use crate::api::Warning;
use crate::api::events::{Event, EventData, NoticeEvent};
use crate::api::jobs::{Job, JobError, JobRequest, Picture, PictureFormat, Plan, Progress, Stats};
use crate::api::request_hash::RequestHash;
use crate::api::scenes::Scene;
use crate::job_state::{Cause, JobState, Refusal};
use async_trait::async_trait;
use uuid::Uuid;

pub use bytes::Bytes;
pub use keys::{Keys, Submitter};
pub use meta::Meta;
pub use outbox::Outbox;
pub use retention::{Recorded, Retention};
pub use scenes::Holdings;
/// Progress events that a job may keep; beyond it every second one of the older half goes.
pub const MAX_PROGRESS_EVENTS: i64 = 2048;

/// Why the store could not do it.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database refused or is unreachable.
    #[error("database: {0}")]
    Database(sqlx::Error),
    /// The database, or what lies under it, is out of order: what, and what to do about it.
    #[error("database: {what}; {remedy} ({source})")]
    Sick {
        /// What is wrong.
        what: &'static str,
        /// What an operator can do.
        remedy: &'static str,
        /// What the database said.
        source: sqlx::Error,
    },
    /// The database could not be brought to this version's tables.
    #[error("database migration: {0}")]
    Migration(sqlx::migrate::MigrateError),
    /// The tables are those of another version of the program, and this caller must not change them.
    #[error(
        "the database has the tables of another version of hemilux (version {version} of the tables, this program has {own}); {}",
        if version < own {
            "start the server of this program's version on the data folder first, which brings them up to date, or use the program of the version that serves it"
        } else {
            "use the program of the version that serves it"
        }
    )]
    OtherVersion {
        /// Version of the tables.
        version: i64,
        /// Version that this program has.
        own: i64,
    },
    /// A stored record does not read back.
    #[error("stored {what} does not read back: {reason}")]
    Corrupt {
        /// Which record.
        what: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The writer's claim on the job is over: it was deleted, or another worker has it.
    #[error("the claim on job {0} is over")]
    ClaimLost(Uuid),
    /// The state machine forbids it; a fault of the caller.
    #[error("job {job}: {refusal}")]
    Illegal {
        /// The job.
        job: Uuid,
        /// Why not.
        refusal: Refusal,
    },
}

impl StoreError {
    /// Whether trying again cannot help: what is stored does not read back.
    pub fn is_lasting(&self) -> bool {
        matches!(self, Self::Corrupt { .. })
    }
}

impl From<sqlx::Error> for StoreError {
    /// Names the troubles that an operator can mend.
    fn from(source: sqlx::Error) -> Self {
        match sqlite::diagnose(&source) {
            Some((what, remedy)) => Self::Sick { what, remedy, source },
            None => Self::Database(source),
        }
    }
}

impl From<sqlx::migrate::MigrateError> for StoreError {
    fn from(error: sqlx::migrate::MigrateError) -> Self {
        match error {
            sqlx::migrate::MigrateError::Execute(source) => source.into(),
            other => Self::Migration(other),
        }
    }
}

/// A job to be accepted.
#[derive(Clone, Debug)]
pub struct NewJob {
    /// Its id, a fresh UUIDv7.
    pub id: Uuid,
    /// Its scene, already stored.
    pub scene_id: String,
    /// What was asked for.
    pub request: JobRequest,
    /// The client's `Idempotency-Key`.
    pub idempotency_key: Option<String>,
    /// Hash of the request, to tell a repetition from another request under the same key.
    pub request_hash: RequestHash,
    /// On whose behalf.
    pub submitter: Submitter,
    /// Hash of everything that the picture depends on, where that determines it: jobs of the
    /// same key can share one result.
    pub render_key: Option<String>,
}

/// What became of a [`NewJob`].
#[derive(Clone, Debug)]
pub enum Accepted {
    /// It is queued.
    New(Box<Job>),
    /// The same request came before under the same key; this is its job.
    Again(Box<Job>),
    /// Another request came before under the same key.
    KeyConflict,
    /// The queue is full.
    QueueFull,
    /// As many jobs of this submitter wait as may.
    OwnQueueFull,
    /// What is stored for this submitter has as many bytes as it may.
    StoreFull {
        /// How many it has.
        stored: u64,
    },
    /// The scene was removed meanwhile.
    SceneGone,
}

/// A worker's claim on a job. Writes under an outdated claim fail with
/// [`StoreError::ClaimLost`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Claim {
    /// The job.
    pub job: Uuid,
    /// The fencing token: grows with every claim of the job.
    pub fence: u64,
}

/// A worker that asks for a job.
#[derive(Clone, Copy, Debug)]
pub struct Asking<'a> {
    /// The device that it works with.
    pub device: &'a str,
    /// Whether its jobs run in a process of their own.
    pub own_process: bool,
    /// Jobs that pause, and which it therefore does not want.
    pub paused: &'a [Uuid],
}

/// A claim as the store keeps it, with its holder's signs of life.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lease {
    /// The claim.
    pub claim: Claim,
    /// The random boot id of the process that holds it.
    pub owner: String,
    /// Signs of life so far. Who sweeps measures on its own monotonic clock for how long this
    /// has not moved; no two clocks are ever compared.
    pub beat: u64,
}

/// What a running worker has to say. All of it is optional.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// What the engine decided, with the warnings.
    pub plan: Option<(Plan, Vec<Warning>)>,
    /// Progress events, oldest first.
    pub progress: Vec<Progress>,
    /// Snapshots whose files are stored.
    pub snapshots: Vec<(Vec<Picture>, Progress)>,
    /// What else a client should know.
    pub notices: Vec<NoticeEvent>,
}

/// How a job ended.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// A terminal state.
    pub state: JobState,
    /// Figures.
    pub stats: Option<Stats>,
    /// The final picture's files, already stored.
    pub pictures: Vec<Picture>,
    /// Why it failed.
    pub error: Option<JobError>,
    /// Last figures.
    pub progress: Option<Progress>,
    /// The identical job whose result this is.
    pub result_of: Option<Uuid>,
}

impl Outcome {
    /// An end with nothing to show.
    pub fn of(state: JobState) -> Self {
        let pictures = Vec::new();
        Self { state, stats: None, pictures, error: None, progress: None, result_of: None }
    }

    /// Whether it replaces the result of an earlier run with those figures: a success does; what
    /// was cancelled does where it has a picture and knows at least as much; a failure does not.
    pub fn is_better_than(&self, earlier: Option<&Stats>) -> bool {
        let done = |stats: Option<&Stats>| stats.map_or(0, |stats| stats.iterations);
        match self.state {
            JobState::Succeeded => true,
            JobState::Failed => false,
            _ => !self.pictures.is_empty() && done(self.stats.as_ref()) >= done(earlier),
        }
    }
}

/// Which jobs a list holds.
#[derive(Clone, Debug, Default)]
pub struct JobFilter {
    /// Only this state.
    pub state: Option<JobState>,
    /// Only jobs with this label.
    pub label: Option<(String, String)>,
    /// Only jobs older than this one.
    pub before: Option<Uuid>,
    /// Only jobs of this key.
    pub owner: Option<String>,
    /// At most so many.
    pub limit: u32,
}

/// Jobs by state, for metrics and back-pressure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JobCounts {
    /// In the order of [`JobState::ALL`].
    pub by_state: [u64; 5],
}

/// The store of one service.
#[async_trait]
pub trait Store:
    Bytes + Keys + Meta + Outbox + Retention + Holdings + solutions::Solutions
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

impl EventData {
    /// Reads an event back from its stored kind and JSON.
    fn from_stored(kind: &str, data: &str) -> Result<Self, serde_json::Error> {
        Ok(match kind {
            "progress" => Self::Progress(serde_json::from_str(data)?),
            "snapshot" => Self::Snapshot(serde_json::from_str(data)?),
            "notice" => Self::Notice(serde_json::from_str(data)?),
            _ => Self::State(serde_json::from_str(data)?),
        })
    }
}
