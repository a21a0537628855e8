//! What the rest of the service relies on, checked on a database file.

use super::*;
use crate::api::events::EventData;
use crate::api::jobs::JobRequest;
use crate::api::scenes::{Scene, SceneFormat};
use crate::job_state::{JobState, MAX_ATTEMPTS};
use crate::store::Submitter;
use tempfile::TempDir;

struct Fixture {
    store: SqliteStore,
    folder: TempDir,
}

impl Fixture {
    async fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let store = SqliteStore::open(&folder.path().join("db")).await.unwrap();
        let scene = Scene {
            id: "scene".into(),
            format: SceneFormat::Gltf,
            size: 1,
            created_at: jiff::Timestamp::UNIX_EPOCH,
            triangles: 1,
            vertices: 3,
            materials: 1,
            textures: 0,
            lights: 0,
            bounds: None,
            cameras: Vec::new(),
            warnings: Vec::new(),
        };
        assert!(store.put_scene(&scene).await.unwrap());
        assert!(!store.put_scene(&scene).await.unwrap());
        Self { store, folder }
    }

    async fn queue(&self, priority: i32) -> Uuid {
        let request: JobRequest =
            serde_json::from_value(serde_json::json!({ "priority": priority })).unwrap();
        let id = Uuid::now_v7();
        let job = NewJob {
            id,
            scene_id: "scene".into(),
            request,
            idempotency_key: None,
            request_hash: String::new(),
            submitter: Submitter::default(),
        };
        assert!(matches!(self.store.accept(job, 100).await.unwrap(), Accepted::New(_)));
        id
    }

    async fn claim(&self) -> Claim {
        self.store.claim("cpu").await.unwrap().expect("a job waits").0
    }

    async fn state(&self, id: Uuid) -> JobState {
        self.store.job(id).await.unwrap().unwrap().state
    }

    /// Another process on the same file, after this one died.
    async fn reopened(self) -> Self {
        let store = SqliteStore::open(&self.folder.path().join("db")).await.unwrap();
        Self { store, folder: self.folder }
    }
}

fn done() -> Outcome {
    Outcome {
        state: JobState::Succeeded,
        stats: None,
        pictures: Vec::new(),
        error: None,
        progress: None,
    }
}

fn progress(iterations: u64) -> Report {
    let progress = vec![Progress { iterations, ..Progress::default() }];
    Report { progress, ..Report::default() }
}

#[tokio::test]
async fn higher_priority_first_then_older() {
    let fixture = Fixture::new().await;
    let (low, high, later) =
        (fixture.queue(0).await, fixture.queue(9).await, fixture.queue(0).await);
    for expected in [high, low, later] {
        assert_eq!(fixture.claim().await.job, expected);
    }
    assert!(fixture.store.claim("cpu").await.unwrap().is_none());
}

impl Fixture {
    /// Offers a job of `who`, of whom `max_queued` may wait and `max_running` run.
    async fn offer(&self, who: &str, max_queued: u64, max_running: u64, key: &str) -> Accepted {
        let job = NewJob {
            id: Uuid::now_v7(),
            scene_id: "scene".into(),
            request: serde_json::from_str("{}").unwrap(),
            idempotency_key: (!key.is_empty()).then(|| key.to_owned()),
            request_hash: String::new(),
            submitter: Submitter {
                owner: who.into(),
                billed_to: who.into(),
                max_queued: Some(max_queued),
                max_running: Some(max_running),
                ..Submitter::default()
            },
        };
        self.store.accept(job, 100).await.unwrap()
    }
}

#[tokio::test]
async fn quotas_count_each_submitter_for_itself() {
    let fixture = Fixture::new().await;
    let id = |accepted| match accepted {
        Accepted::New(job) => job.id,
        other => panic!("{other:?}"),
    };
    let first = id(fixture.offer("a", 2, 1, "").await);
    let second = id(fixture.offer("a", 2, 1, "").await);
    assert!(matches!(fixture.offer("a", 2, 1, "").await, Accepted::OwnQueueFull));
    let third = id(fixture.offer("b", 1, 2, "").await);
    // One of a runs; the second waits though it is older than that of b.
    let running = fixture.claim().await;
    assert_eq!(running.job, first);
    assert_eq!(fixture.claim().await.job, third);
    assert!(fixture.store.claim("cpu").await.unwrap().is_none());
    fixture.store.finish(running, done()).await.unwrap();
    assert_eq!(fixture.claim().await.job, second);
    // Idempotency keys are each submitter's own.
    let (mine, other) = (fixture.offer("a", 2, 1, "k").await, fixture.offer("b", 2, 1, "k").await);
    assert_ne!(id(mine), id(other));
    assert!(matches!(fixture.offer("a", 2, 1, "k").await, Accepted::Again(_)));
    // What was removed is not taken by a job any more.
    let gone = NewJob {
        id: Uuid::now_v7(),
        scene_id: "no scene".into(),
        request: serde_json::from_str("{}").unwrap(),
        idempotency_key: None,
        request_hash: String::new(),
        submitter: Submitter::default(),
    };
    assert!(matches!(fixture.store.accept(gone, 100).await.unwrap(), Accepted::SceneGone));
}

#[tokio::test]
async fn a_worker_that_lost_its_claim_writes_nothing() {
    let fixture = Fixture::new().await;
    let id = fixture.queue(0).await;
    let old = fixture.claim().await;
    fixture.store.release(old, true, "its worker died").await.unwrap();
    let new = fixture.claim().await;
    assert!(new.fence > old.fence);
    let lost = |result: Result<(), StoreError>| matches!(result, Err(StoreError::ClaimLost(_)));
    assert!(lost(fixture.store.report(old, progress(1)).await.map(|_| ())));
    assert!(lost(fixture.store.finish(old, done()).await));
    assert!(lost(fixture.store.release(old, true, "again").await));
    assert_eq!(fixture.state(id).await, JobState::Running);
    fixture.store.finish(new, done()).await.unwrap();
    assert_eq!(fixture.state(id).await, JobState::Succeeded);
    // One result: the same worker cannot finish twice either.
    assert!(lost(fixture.store.finish(new, done()).await));
    let events = fixture.store.events(id, 0, 100).await.unwrap();
    assert_eq!(events.iter().filter(|event| event.data.is_terminal()).count(), 1);
}

#[tokio::test]
async fn a_deleted_job_ends_its_worker_and_its_streams() {
    let fixture = Fixture::new().await;
    let id = fixture.queue(0).await;
    let claim = fixture.claim().await;
    assert!(fixture.store.delete(id).await.unwrap());
    assert!(!fixture.store.delete(id).await.unwrap());
    assert!(fixture.store.job(id).await.unwrap().is_none());
    let report = fixture.store.report(claim, progress(1)).await;
    assert!(matches!(report, Err(StoreError::ClaimLost(_))));
    let last = fixture.store.events(id, 0, 100).await.unwrap().pop().unwrap();
    assert!(last.data.is_terminal());
    assert_eq!(fixture.store.purge(60_000).await.unwrap(), Vec::<Uuid>::new());
    assert_eq!(fixture.store.purge(0).await.unwrap(), [id]);
    assert!(fixture.store.events(id, 0, 100).await.unwrap().is_empty());
}

#[tokio::test]
async fn a_job_that_kills_its_workers_is_given_up() {
    let mut fixture = Fixture::new().await;
    let id = fixture.queue(0).await;
    for attempt in 1..=MAX_ATTEMPTS {
        fixture.claim().await;
        fixture = fixture.reopened().await;
        assert_eq!(fixture.store.recover().await.unwrap(), [id]);
        let job = fixture.store.job(id).await.unwrap().unwrap();
        assert_eq!(job.attempts, attempt);
        let expected = if attempt < MAX_ATTEMPTS { JobState::Queued } else { JobState::Failed };
        assert_eq!(job.state, expected);
    }
    let job = fixture.store.job(id).await.unwrap().unwrap();
    assert_eq!(job.error.unwrap().code, "poisoned");
}

#[tokio::test]
async fn an_orderly_shutdown_costs_no_attempt() {
    let fixture = Fixture::new().await;
    let id = fixture.queue(0).await;
    for _ in 0..2 * MAX_ATTEMPTS {
        fixture.claim().await;
        assert_eq!(fixture.store.release_all().await.unwrap(), 1);
    }
    let job = fixture.store.job(id).await.unwrap().unwrap();
    assert_eq!((job.state, job.attempts), (JobState::Queued, 0));
}

#[tokio::test]
async fn a_cancel_reaches_the_worker_or_ends_the_job_with_it() {
    let fixture = Fixture::new().await;
    let id = fixture.queue(0).await;
    let claim = fixture.claim().await;
    assert!(!fixture.store.report(claim, progress(1)).await.unwrap());
    fixture.store.cancel(id).await.unwrap();
    assert!(fixture.store.report(claim, progress(2)).await.unwrap());
    // The worker dies before it can obey.
    let fixture = fixture.reopened().await;
    fixture.store.recover().await.unwrap();
    assert_eq!(fixture.state(id).await, JobState::Cancelled);
}

#[tokio::test]
async fn progress_is_thinned_and_its_ends_are_kept() {
    let fixture = Fixture::new().await;
    let id = fixture.queue(0).await;
    let claim = fixture.claim().await;
    let total = 3 * events::MAX_PROGRESS_EVENTS as u64;
    for batch in 0..total / 128 {
        let points =
            (0..128).map(|i| Progress { iterations: batch * 128 + i, ..Progress::default() });
        let report = Report { progress: points.collect(), ..Report::default() };
        fixture.store.report(claim, report).await.unwrap();
    }
    let trace = fixture.store.trace(id).await.unwrap();
    let most = (events::MAX_PROGRESS_EVENTS + events::MAX_PROGRESS_EVENTS / 8) as usize;
    assert!(trace.len() <= most, "{}", trace.len());
    assert!(trace.len() >= events::MAX_PROGRESS_EVENTS as usize / 2);
    assert_eq!(trace[0].iterations, 0);
    assert_eq!(trace.last().unwrap().iterations, total - 1);
    assert!(trace.windows(2).all(|pair| pair[0].iterations < pair[1].iterations));
    let states = fixture.store.events(id, 0, u32::MAX).await.unwrap();
    let states = states.iter().filter(|event| matches!(event.data, EventData::State(_)));
    assert_eq!(states.count(), 2, "only progress is thinned");
}
