//! Jobs as they go into a store and come out of it: accepted, claimed, reported on, ended.

use super::keys::Submitter;
use crate::api::Warning;
use crate::api::events::NoticeEvent;
use crate::api::jobs::{Job, JobError, JobRequest, Picture, Plan, Progress, Stats};
use crate::api::request_hash::RequestHash;
use crate::job_state::JobState;
use uuid::Uuid;

/// Progress events that a job may keep; beyond it every second one of the older half goes.
pub const MAX_PROGRESS_EVENTS: i64 = 2048;

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
    /// The map of the sky was removed meanwhile.
    EnvironmentGone,
}

/// A worker's claim on a job. Writes under an outdated claim fail with
/// [`StoreError::ClaimLost`](super::error::StoreError::ClaimLost).
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
        let done = |stats: Option<&Stats>| stats.map_or(0, |stats| stats.figures.iterations);
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
