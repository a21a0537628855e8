//! What the tests of any store begin with: somewhere to open stores, and jobs, claims and reports to
//! try them with.

use crate::api::jobs::{Figures, JobRequest, Progress};
use crate::api::scenes::Scene;
use crate::job_state::JobState;
use crate::store::specimens;
use crate::store::{
    Accepted, Asking, Claim, NewJob, Outcome, Report, Store, StoreError, Submitter,
};
use async_trait::async_trait;
use std::sync::Arc;
use uuid::Uuid;

/// Somewhere that keeps what stores keep. Each call opens what another process would: a store
/// with a boot id of its own on the same content.
#[async_trait]
pub trait Home: Send + Sync {
    /// Opens it.
    async fn open(&self) -> Arc<dyn Store>;
}

pub async fn furnished(place: &dyn Home) -> Arc<dyn Store> {
    let store = place.open().await;
    store.put_scene(&scene("scene", 0)).await.unwrap();
    store
}

pub fn scene(id: &str, created_s: i64) -> Scene {
    let created_at = jiff::Timestamp::from_second(created_s).unwrap();
    Scene { id: id.into(), size: 1, created_at, ..specimens::scene(b"?") }
}

pub fn wish(priority: i32) -> NewJob {
    let request: JobRequest =
        serde_json::from_value(serde_json::json!({ "priority": priority })).unwrap();
    NewJob { request, ..specimens::job("scene") }
}

pub async fn queue(store: &dyn Store, job: NewJob) -> Uuid {
    let id = job.id;
    assert!(matches!(store.accept(job, 100).await.unwrap(), Accepted::New(_)));
    id
}

/// A worker whose jobs run in a process of their own.
pub const ASKING: Asking<'static> = Asking { device: "cpu", own_process: true, paused: &[] };

pub async fn claim(store: &dyn Store) -> Claim {
    store.claim(&ASKING).await.unwrap().expect("a job waits").0
}

pub async fn state(store: &dyn Store, id: Uuid) -> JobState {
    store.job(id).await.unwrap().unwrap().state
}

pub fn done() -> Outcome {
    Outcome::of(JobState::Succeeded)
}

pub fn progress(iterations: u64) -> Report {
    let progress = vec![Progress {
        figures: Figures { iterations, ..Figures::default() },
        ..Progress::default()
    }];
    Report { progress, ..Report::default() }
}

pub fn is_lost<T>(result: Result<T, StoreError>) -> bool {
    matches!(result, Err(StoreError::ClaimLost(_)))
}

pub async fn terminal_events(store: &dyn Store, id: Uuid) -> usize {
    let events = store.events(id, 0, u32::MAX).await.unwrap();
    assert!(events.windows(2).all(|pair| pair[0].seq < pair[1].seq));
    events.iter().filter(|event| event.data.is_terminal()).count()
}

/// A job of `who`, of whom `max_queued` may wait and `max_running` run.
pub fn billed(who: &str, max_queued: u64, max_running: u64, key: Option<&str>) -> NewJob {
    NewJob {
        idempotency_key: key.map(str::to_owned),
        submitter: Submitter {
            owner: who.into(),
            billed_to: who.into(),
            max_queued: Some(max_queued),
            max_running: Some(max_running),
            ..Submitter::default()
        },
        ..wish(0)
    }
}
