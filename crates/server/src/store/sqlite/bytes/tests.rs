//! Sums that are kept, against sums that are added up.

use super::*;
use crate::api::events::Notice;
use crate::api::jobs::{PictureFormat, Progress};
use crate::api::scenes::Scene;
use crate::api::solutions::{Begins, KeptFile, Solution};
use crate::job_state::JobState;
use crate::store::retention::Retention;
use crate::store::scenes::Holdings;
use crate::store::solutions::Solutions;
use crate::store::specimens;
use crate::store::{Accepted, JobFilter, NewJob, Outcome, Report, Store, Submitter};
use tempfile::TempDir;

async fn store(folder: &TempDir) -> SqliteStore {
    let store = SqliteStore::open(&folder.path().join("db")).await.unwrap();
    let scene = Scene { id: "scene".into(), size: 1000, ..specimens::scene(b"a scene") };
    store.put_scene(&scene).await.unwrap();
    store
}

async fn submit(store: &SqliteStore, payer: &str, max_stored: Option<u64>) -> Uuid {
    let submitter = Submitter { billed_to: payer.into(), max_stored, ..Submitter::default() };
    let job = NewJob { submitter, ..specimens::job("scene") };
    let id = job.id;
    store.accept(job, 1000).await.unwrap();
    id
}

fn picture(sha256: &str, size: u64) -> Picture {
    Picture {
        format: PictureFormat::Png,
        url: String::new(),
        sha256: sha256.into(),
        size,
        width: 1,
        height: 1,
        base64: None,
    }
}

fn snapshot(sha256: &str, size: u64) -> Report {
    let snapshots = vec![(vec![picture(sha256, size)], Progress::default())];
    Report { snapshots, ..Report::default() }
}

fn outcome(size: u64) -> Outcome {
    Outcome {
        pictures: vec![picture(&format!("last {size}"), size)],
        ..Outcome::of(JobState::Succeeded)
    }
}

fn solution(size: u64, baked: Option<u64>) -> Solution {
    let file = |size| KeptFile { file: "b".into(), sha256: String::new(), size };
    Solution {
        file: "f".into(),
        size,
        begins: Begins::Continue,
        method: "hemilux".into(),
        iterations: 1,
        seconds: 1.0,
        estimated_error: None,
        baked: baked.map(file),
    }
}

fn notice() -> NoticeEvent {
    NoticeEvent { what: Notice::SnapshotsThinned, detail: String::new(), removed: 1 }
}

/// A job of `payer` that has ended with so many bytes.
async fn ended(store: &SqliteStore, payer: &str, size: u64) -> Uuid {
    let id = submit(store, payer, None).await;
    let (claim, _) =
        store.claim(&crate::store::conformance::fixture::ASKING).await.unwrap().unwrap();
    assert_eq!(claim.job, id);
    store.finish(claim, outcome(size)).await.unwrap();
    id
}

/// Rows that say otherwise than what adding everything up gives.
async fn wrong_sums(store: &SqliteStore) -> Vec<String> {
    let of_job = "(SELECT coalesce(sum(size), 0) FROM
                      (SELECT DISTINCT sha256, format, json_extract(record, '$.size') AS size
                       FROM pictures WHERE job_id = jobs.id))
                + (SELECT coalesce(sum(json_extract(record, '$.size')
                                       + coalesce(json_extract(record, '$.baked.size'), 0)), 0)
                   FROM solutions WHERE job_id = jobs.id)";
    let query = format!(
        "WITH own AS (SELECT id, billed_to, pinned, deleted_ms, bytes, {of_job} AS added FROM jobs),
         payer AS (SELECT billed_to, sum(added) AS bytes, sum(iif(pinned, added, 0)) AS pinned_bytes
                   FROM own WHERE deleted_ms IS NULL GROUP BY billed_to HAVING sum(added) > 0)
         SELECT 'job ' || id AS what FROM own WHERE bytes <> added
         UNION ALL SELECT 'missing ' || billed_to FROM (SELECT * FROM payer EXCEPT SELECT * FROM payers)
         UNION ALL SELECT 'wrong ' || billed_to FROM (SELECT * FROM payers EXCEPT SELECT * FROM payer)
         UNION ALL SELECT 'scenes' FROM scene_bytes
             WHERE bytes <> (SELECT coalesce(sum(json_extract(record, '$.size')), 0) FROM scenes)"
    );
    let found = sqlx::query(sqlx::AssertSqlSafe(query)).fetch_all(&store.reader).await.unwrap();
    found.iter().map(|row| row.get("what")).collect()
}
/// Works on the next job, if any: some snapshots and solutions, then its end.
async fn work_on_next(store: &SqliteStore, step: u64, roll: &mut impl FnMut(u64) -> u64) {
    let Some((claim, _)) = store.claim(&crate::store::conformance::fixture::ASKING).await.unwrap()
    else {
        return;
    };
    for number in 0..roll(5) {
        let report = snapshot(&format!("{step} {number}"), 1 + roll(100));
        store.report(claim, report).await.unwrap();
    }
    for _ in 0..roll(3) {
        let baked = (roll(2) == 0).then(|| roll(50));
        store.keep_solution(claim, &solution(roll(500), baked)).await.unwrap();
    }
    let stored = store.snapshots(claim.job).await.unwrap().stored;
    let gone: Vec<_> = stored.iter().step_by(2).map(|(number, _)| *number).collect();
    if roll(2) == 0 {
        store.drop_snapshots(claim, &gone, notice()).await.unwrap();
    }
    store.finish(claim, outcome(1 + roll(1000))).await.unwrap();
}

#[tokio::test]
async fn kept_sums_are_what_is_stored_whatever_happens() {
    let folder = TempDir::new().unwrap();
    let store = store(&folder).await;
    let mut dice = 1_u64;
    let mut roll = |sides: u64| {
        dice = dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (dice >> 33) % sides
    };
    for step in 0..400 {
        let filter = JobFilter { limit: 1000, ..JobFilter::default() };
        let jobs = store.jobs(&filter).await.unwrap();
        let any = (!jobs.is_empty()).then(|| jobs[roll(jobs.len() as u64) as usize].id);
        match (roll(9), any) {
            (0..=1, _) => {
                submit(&store, ["", "a", "b"][roll(3) as usize], None).await;
            }
            (2..=3, _) => work_on_next(&store, step, &mut roll).await,
            (7, Some(job)) => {
                let request = serde_json::from_str("{}").unwrap();
                drop(store.extend(job, &request, 1000, None).await.unwrap());
            }
            (4, Some(job)) => drop(store.pin(job, roll(2) == 0, None).await.unwrap()),
            (5, Some(job)) => drop(store.drop_solution(job).await.unwrap()),
            (6, Some(job)) => drop(store.delete(job).await.unwrap()),
            (_, _) => drop(store.purge(0).await.unwrap()),
        }
        assert_eq!(wrong_sums(&store).await, Vec::<String>::new(), "step {step}");
    }
    let filter = JobFilter { limit: 1000, ..JobFilter::default() };
    let jobs = store.jobs(&filter).await.unwrap();
    let bytes: u64 = jobs.iter().map(|job| job.bytes).sum();
    assert!(bytes > 0);
    assert_eq!(store.stored_bytes().await.unwrap(), 1000 + bytes);
    for job in jobs {
        store.delete(job.id).await.unwrap();
    }
    assert_eq!(store.stored_bytes().await.unwrap(), 1000, "what is deleted counts no more");
    let before = jiff::Timestamp::now() + jiff::SignedDuration::from_secs(1);
    store.purge(-1000).await.unwrap();
    assert!(store.forget_scene("scene", before).await.unwrap());
    assert_eq!(store.stored_bytes().await.unwrap(), 0);
    // The comparison finds a sum that is wrong.
    sqlx::query("UPDATE scene_bytes SET bytes = 1").execute(&store.writer).await.unwrap();
    assert_eq!(wrong_sums(&store).await, ["scenes"]);
}

/// The answer to a request was lost; its own pictures are no reason to refuse the repetition.
#[tokio::test]
async fn a_full_store_refuses_new_jobs_and_no_repetition() {
    let folder = TempDir::new().unwrap();
    let store = store(&folder).await;
    let submitter =
        Submitter { billed_to: "a".into(), max_stored: Some(100), ..Submitter::default() };
    let sent = |key: &str| NewJob {
        idempotency_key: Some(key.into()),
        submitter: submitter.clone(),
        ..specimens::job("scene")
    };
    let first = store.accept(sent("first"), 10).await.unwrap();
    assert!(matches!(first, Accepted::New(_)), "{first:?}");
    let (claim, _) =
        store.claim(&crate::store::conformance::fixture::ASKING).await.unwrap().unwrap();
    store.finish(claim, outcome(100)).await.unwrap();
    let again = store.accept(sent("first"), 10).await.unwrap();
    assert!(matches!(again, Accepted::Again(job) if job.id == claim.job));
    let other = store.accept(sent("other"), 10).await.unwrap();
    assert!(matches!(other, Accepted::StoreFull { stored: 100 }), "{other:?}");
}

/// Whoever holds large scenes stores much, though their results be small.
#[tokio::test]
async fn scenes_count_for_whoever_holds_them() {
    let folder = TempDir::new().unwrap();
    let store = store(&folder).await;
    let results = ended(&store, "results", 100).await;
    let scenes = ended(&store, "scenes", 1).await;
    assert_eq!(store.evictable().await.unwrap(), Some((results, 100)));
    store.hold_scene("scene", "scenes").await.unwrap();
    assert_eq!(store.evictable().await.unwrap(), Some((scenes, 1)));
}

#[tokio::test]
async fn who_stores_most_makes_room_first_and_pinned_or_running_jobs_stay() {
    let folder = TempDir::new().unwrap();
    let store = store(&folder).await;
    let oldest = ended(&store, "little", 25).await;
    let pinned = ended(&store, "much", 100).await;
    assert_eq!(store.pin(pinned, true, None).await.unwrap(), Pinned::Done);
    let mut much = Vec::new();
    for _ in 0..3 {
        much.push(ended(&store, "much", 10).await);
    }
    let empty = ended(&store, "much", 0).await;
    submit(&store, "much", None).await;
    let (running, _) =
        store.claim(&crate::store::conformance::fixture::ASKING).await.unwrap().unwrap();
    store.report(running, snapshot("s", 500)).await.unwrap();
    for expected in much {
        assert_eq!(store.evictable().await.unwrap(), Some((expected, 10)));
        store.delete(expected).await.unwrap();
    }
    // Only when nothing of theirs can go is it somebody else's turn.
    assert_eq!(store.evictable().await.unwrap(), Some((oldest, 25)));
    store.delete(oldest).await.unwrap();
    assert_eq!(store.evictable().await.unwrap(), None);
    for there in [pinned, empty, running.job] {
        assert!(store.job(there).await.unwrap().is_some());
    }
}

#[tokio::test]
async fn pins_stay_within_their_quota() {
    let folder = TempDir::new().unwrap();
    let store = store(&folder).await;
    let [a, b] = [ended(&store, "a", 60).await, ended(&store, "a", 60).await];
    let other = ended(&store, "b", 60).await;
    let pin = async |job| store.pin(job, true, Some(100)).await.unwrap();
    assert_eq!(pin(a).await, Pinned::Done);
    assert_eq!(pin(b).await, Pinned::OverQuota { pinned: 60, job: 60 });
    assert!(!store.job(b).await.unwrap().unwrap().pinned);
    assert_eq!(pin(a).await, Pinned::Done, "it is pinned already");
    assert_eq!(pin(other).await, Pinned::Done, "each payer for itself");
    assert_eq!(pin(Uuid::now_v7()).await, Pinned::Missing);
    assert_eq!(store.pin(a, false, Some(0)).await.unwrap(), Pinned::Done, "that makes room");
    assert_eq!(pin(b).await, Pinned::Done);
    // How many bytes it will have is not known; without a quota that does not matter.
    let waits = submit(&store, "a", None).await;
    assert_eq!(pin(waits).await, Pinned::NotYet);
    assert_eq!(store.pin(waits, true, None).await.unwrap(), Pinned::Done);
}

/// An extension that is cancelled while it waits ends with the result of before, which is recorded
/// again and stored once.
#[tokio::test]
async fn a_result_that_stays_is_not_counted_again() {
    let folder = TempDir::new().unwrap();
    let store = store(&folder).await;
    let id = ended(&store, "a", 100).await;
    let request = serde_json::from_str("{}").unwrap();
    for _ in 0..3 {
        store.extend(id, &request, 10, None).await.unwrap();
        store.cancel(id).await.unwrap();
        assert_eq!(store.job(id).await.unwrap().unwrap().result.unwrap().len(), 1);
    }
    assert_eq!(store.payer_bytes("a").await.unwrap(), 100);
}

#[tokio::test]
async fn snapshots_go_with_their_events_and_what_is_still_named_stays() {
    let folder = TempDir::new().unwrap();
    let store = store(&folder).await;
    let id = submit(&store, "a", Some(100)).await;
    let (claim, _) =
        store.claim(&crate::store::conformance::fixture::ASKING).await.unwrap().unwrap();
    assert_eq!(store.room(id).await.unwrap(), Some(100));
    for (sha256, size) in [("x", 10), ("y", 20), ("x", 10)] {
        store.report(claim, snapshot(sha256, size)).await.unwrap();
    }
    assert_eq!(store.room(id).await.unwrap(), Some(70), "a file counts once");
    let known = store.snapshots(id).await.unwrap();
    assert_eq!(known.stored.iter().map(|(_, bytes)| *bytes).collect::<Vec<_>>(), [10, 20, 10]);
    let gone = [known.stored[0].0, known.stored[1].0];
    let unnamed = store.drop_snapshots(claim, &gone, notice()).await.unwrap();
    assert_eq!(unnamed, [picture("y", 20)], "the newest snapshot has the other file");
    let left = store.snapshots(id).await.unwrap();
    assert_eq!((left.stored, left.thinned), (vec![known.stored[2]], 1));
    let kinds: Vec<_> =
        store.events(id, 0, 100).await.unwrap().iter().map(|event| event.data.kind()).collect();
    assert_eq!(kinds, ["state", "state", "snapshot", "notice"]);
    let lost = Claim { fence: claim.fence + 1, ..claim };
    assert!(store.drop_snapshots(lost, &[known.stored[2].0], notice()).await.is_err());
    assert_eq!(store.snapshots(id).await.unwrap().stored.len(), 1);
    store.finish(claim, outcome(500)).await.unwrap();
    assert_eq!(store.room(id).await.unwrap(), Some(0));
    let free = submit(&store, "b", None).await;
    assert_eq!(store.room(free).await.unwrap(), None);
}
