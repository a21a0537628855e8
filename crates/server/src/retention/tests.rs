//! Submits, endings, deletes, purges, expiry and sweeps in random order: what a record names is
//! always there, and what nothing names goes.

use super::*;
use crate::api::environment::EnvironmentRequest;
use crate::api::jobs::PictureFormat;
use crate::job_state::JobState;
use crate::store::bytes::Pinned;
use crate::store::scenes::Viewer;
use crate::store::specimens;
use crate::store::sqlite::SqliteStore;
use crate::store::{Accepted, Asking, JobFilter, NewJob, Outcome};
use bytes::Bytes;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering};
use tempfile::TempDir;

const ALL: Viewer<'static> = Viewer { holder: "", sees_all: true };
/// Different scenes; few, so that they meet.
const SCENES: u64 = 4;

struct World {
    keeper: Keeper,
    store: Arc<dyn Store>,
    artifacts: Artifacts,
    folder: TempDir,
}

impl World {
    async fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let store: Arc<dyn Store> =
            Arc::new(SqliteStore::open(&folder.path().join("db")).await.unwrap());
        let artifacts = Artifacts::local(&folder.path().join("artifacts")).unwrap();
        let keeper = Keeper::new(store.clone(), artifacts.clone(), JobNotifier::default());
        Self { keeper, store, artifacts, folder }
    }

    fn scene(number: u64) -> (Scene, Bytes) {
        let bytes = Bytes::from(format!("scene {number}"));
        (specimens::scene(&bytes), bytes)
    }

    /// Sends the map of the sky of every second scene, as the handlers do; what a job asks for
    /// that names it.
    async fn sky(&self, number: u64) -> Option<EnvironmentRequest> {
        if number.is_multiple_of(2) {
            return None;
        }
        let bytes = Bytes::from(format!("sky {}", number % 4));
        let map = specimens::map(&bytes);
        if !self.store.use_scene(&map.id).await.unwrap() {
            self.keeper.keep_environment(&map, bytes, "somebody").await.unwrap();
        }
        serde_json::from_value(serde_json::json!({"sky": {"environment": map.id}})).unwrap()
    }

    /// Sends a scene and asks for a picture of it, as the handlers do; `None` where it was
    /// collected in between.
    async fn submit(&self, number: u64) -> Option<Uuid> {
        self.submit_under(number, None).await
    }

    /// As [`World::submit`], with something about the scene.
    async fn submit_under(&self, number: u64, sky: Option<EnvironmentRequest>) -> Option<Uuid> {
        let (scene, bytes) = Self::scene(number);
        if !self.store.use_scene(&scene.id).await.unwrap() {
            self.keeper.keep_scene(&scene, bytes, "somebody").await.unwrap();
        }
        let mut job = specimens::job(&scene.id);
        job.request.environment = sky;
        match self.store.accept(job, 1_000_000).await.unwrap() {
            Accepted::New(job) => {
                // What was accepted can be rendered from now on.
                self.artifacts.scene(&scene.id).await.expect("the scene of an accepted job");
                Some(job.id)
            }
            Accepted::SceneGone | Accepted::EnvironmentGone => None,
            other => panic!("{other:?}"),
        }
    }

    /// Runs the next job.
    async fn run(&self) {
        let asking = Asking { device: "cpu", own_process: true, paused: &[] };
        let Some((claim, job)) = self.store.claim(&asking).await.unwrap() else { return };
        if self.artifacts.scene(&job.scene).await.is_err() {
            let still = self.store.job(job.id).await.unwrap();
            assert!(still.is_none(), "the scene of a running job is gone");
            return;
        }
        let bytes = job.id.as_bytes().to_vec();
        let picture = self.artifacts.put_picture(job.id, PictureFormat::Png, (1, 1), bytes).await;
        let pictures = vec![picture.unwrap()];
        let outcome = Outcome { pictures, ..Outcome::of(JobState::Succeeded) };
        match self.store.finish(claim, outcome).await {
            // It was deleted meanwhile; the worker removes what it wrote.
            Err(StoreError::ClaimLost(_)) => self.artifacts.remove_job(job.id).await.unwrap(),
            done => done.unwrap(),
        }
    }

    /// Everything that a record names is there.
    async fn check(&self) {
        let filter = JobFilter { limit: 1_000_000, ..JobFilter::default() };
        for job in self.store.jobs(&filter).await.unwrap() {
            let scene = self.artifacts.scene(&job.scene).await;
            assert!(scene.is_ok(), "the scene of job {} is gone", job.id);
            if let Some(map) = job.request.environment_map() {
                let map = self.artifacts.scene(map).await;
                assert!(map.is_ok(), "the map of job {} is gone", job.id);
            }
            for picture in job.result.iter().flatten() {
                let bytes = self.artifacts.picture(job.id, &picture.sha256, picture.format).await;
                assert!(bytes.is_ok(), "a picture of job {} is gone", job.id);
            }
        }
        for scene in self.store.shown_scenes(ALL, None, 1_000_000).await.unwrap() {
            assert!(self.artifacts.scene(&scene.id).await.is_ok(), "scene {} is gone", scene.id);
        }
    }
}

/// Numbers that look random.
struct Dice(AtomicU64);

impl Dice {
    fn below(&self, end: u64) -> u64 {
        let mut x = self.0.fetch_add(0x9e37_79b9_7f4a_7c15, Ordering::Relaxed);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (x ^ (x >> 31)) % end
    }
}

async fn live(world: Arc<World>, dice: Arc<Dice>, steps: u64) {
    let all = Rules { age: Some(SignedDuration::ZERO), bytes: None };
    for _ in 0..steps {
        let soon = || Timestamp::now() + SignedDuration::from_millis(2);
        match dice.below(12) {
            0..=3 => {
                let number = dice.below(SCENES);
                let sky = world.sky(number).await;
                world.submit_under(number, sky).await;
            }
            4..=5 => world.run().await,
            6 => {
                let filter = JobFilter { limit: 20, ..JobFilter::default() };
                let jobs = world.store.jobs(&filter).await.unwrap();
                if !jobs.is_empty() {
                    let job = &jobs[dice.below(jobs.len() as u64) as usize];
                    world.store.delete(job.id).await.unwrap();
                }
            }
            7 => drop(world.keeper.purge(0).await.unwrap()),
            8 => drop(world.keeper.expire(all, soon()).await.unwrap()),
            9 => drop(world.keeper.sweep(Timestamp::now(), true).await.unwrap()),
            10 => drop(world.keeper.tend_quarantine(Some(soon())).await.unwrap()),
            _ => {
                let few = Rules { age: None, bytes: Some(100) };
                world.keeper.expire(few, soon()).await.unwrap();
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn nothing_that_a_record_names_is_ever_removed() {
    let world = Arc::new(World::new().await);
    let dice = Arc::new(Dice(AtomicU64::new(1)));
    for _ in 0..6 {
        let tasks: Vec<_> =
            (0..4).map(|_| tokio::spawn(live(world.clone(), dice.clone(), 25))).collect();
        for task in tasks {
            task.await.unwrap();
        }
        world.check().await;
    }
    // In the end everything expires, and no file is left.
    let filter = JobFilter { limit: 1_000_000, ..JobFilter::default() };
    for job in world.store.jobs(&filter).await.unwrap() {
        world.store.delete(job.id).await.unwrap();
    }
    tokio::time::sleep(Duration::from_millis(5)).await;
    world.keeper.purge(0).await.unwrap();
    let all = Rules { age: Some(SignedDuration::ZERO), bytes: None };
    world.keeper.expire(all, Timestamp::now()).await.unwrap();
    world.keeper.tend_quarantine(Some(Timestamp::MAX)).await.unwrap();
    assert_eq!(files(&world.folder.path().join("artifacts")), Vec::<String>::new());
    assert_eq!(world.store.shown_scenes(ALL, None, 10).await.unwrap(), []);
    assert_eq!(world.store.shown_environments(ALL, None, 10).await.unwrap(), []);
}

fn files(folder: &std::path::Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path.display().to_string());
        }
    }
    found
}

#[tokio::test]
async fn a_sweep_finds_what_a_crash_left_and_leaves_the_rest() {
    let world = World::new().await;
    let job = world.submit(0).await.unwrap();
    world.run().await;
    let folder = world.folder.path().join("artifacts");
    let before: BTreeSet<_> = files(&folder).into_iter().collect();
    // A picture without a record, the files of a job that is purged, a scene without a record; and
    // a file of a kind that the sweep does not know.
    let art = &world.artifacts;
    art.put_picture(job, PictureFormat::Exr, (1, 1), b"no record".to_vec()).await.unwrap();
    let gone = Uuid::now_v7();
    art.put_picture(gone, PictureFormat::Png, (1, 1), b"no job".to_vec()).await.unwrap();
    art.put_kept(job, "old.checkpoint", b"replaced".to_vec()).await.unwrap();
    art.put_scene(&"ab".repeat(32), Bytes::from_static(b"no record")).await.unwrap();
    let other = folder.join(format!("jobs/{job}/checkpoint.bin"));
    std::fs::write(&other, b"of another part").unwrap();
    // And a job that runs: its files come before their records.
    let running = world.submit(1).await.unwrap();
    world.store.claim(&crate::store::conformance::fixture::ASKING).await.unwrap().unwrap();
    art.put_picture(running, PictureFormat::Png, (1, 1), b"to be recorded".to_vec()).await.unwrap();

    let now = Timestamp::from_second(1_700_000_000).unwrap();
    let swept = world.keeper.sweep(now, false).await.unwrap();
    assert_eq!((swept.set_aside, swept.left), (4, 0));
    // Nothing is lost: all of it waits, for as long as it is to.
    assert_eq!(art.all_set_aside().await.unwrap().len(), 4);
    let mut after: BTreeSet<_> = files(&folder).into_iter().collect();
    after.retain(|file| !file.contains("quarantine") && !file.contains(&running.to_string()));
    assert!(after.remove(&other.display().to_string()));
    after.retain(|file| before.contains(file) || !file.contains("/scenes/"));
    assert_eq!(after, before);
    assert_eq!(world.keeper.sweep(now, false).await.unwrap().set_aside, 0);
    assert_eq!(
        world.keeper.tend_quarantine(Some(now)).await.unwrap(),
        sweep::QuarantineCounts::default()
    );
    assert_eq!(
        world.keeper.tend_quarantine(None).await.unwrap(),
        sweep::QuarantineCounts::default()
    );
    let later = now + SignedDuration::from_secs(1);
    assert_eq!(world.keeper.tend_quarantine(Some(later)).await.unwrap().removed, 4);
    assert_eq!(art.all_set_aside().await.unwrap(), []);
    world.check().await;
}

/// The wrong database lies beside the files, and then the right one again.
#[tokio::test]
async fn a_large_share_stays_until_asked_for_and_comes_back_with_its_records() {
    let world = World::new().await;
    for number in 0..25 {
        world.submit(number % SCENES).await.unwrap();
        world.run().await;
    }
    let folder = world.folder.path().join("artifacts");
    let before = files(&folder);
    let wrong: Arc<dyn Store> =
        Arc::new(SqliteStore::open(&world.folder.path().join("wrong")).await.unwrap());
    let keeper = Keeper::new(wrong, world.artifacts.clone(), JobNotifier::default());
    let now = Timestamp::from_second(1_700_000_000).unwrap();
    let swept = keeper.sweep(now, false).await.unwrap();
    assert_eq!((swept.set_aside, swept.left), (0, 25 + SCENES));
    assert_eq!(files(&folder), before);
    assert_eq!(keeper.sweep(now, true).await.unwrap().set_aside, 25 + SCENES);
    assert!(!world.artifacts.any_files().await.unwrap());
    // However long they were there: what a record names is not removed.
    let tended = world.keeper.tend_quarantine(Some(Timestamp::MAX)).await.unwrap();
    assert_eq!(tended, sweep::QuarantineCounts { put_back: 25 + SCENES, removed: 0 });
    world.check().await;
}

/// A view's file is there before its record; no sweep may come in between.
#[tokio::test]
async fn a_sweep_waits_for_files_that_are_about_to_be_recorded() {
    let world = Arc::new(World::new().await);
    let held = world.keeper.hold_files().await;
    let job = Uuid::now_v7();
    world.artifacts.put_kept(job, "a.checkpoint", b"light".to_vec()).await.unwrap();
    let sweeping = world.clone();
    let sweep = tokio::spawn(async move { sweeping.keeper.sweep(Timestamp::now(), true).await });
    // It has seen the file as soon as it waits for the lock: nobody else can be given it then.
    let deadline = std::time::Instant::now() + Duration::from_secs(60);
    while world.keeper.collecting.try_read().is_ok() {
        assert!(std::time::Instant::now() < deadline, "the sweep does not wait");
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    let (scene, bytes) = World::scene(0);
    world.artifacts.put_scene(&scene.id, bytes).await.unwrap();
    world.store.put_scene(&scene).await.unwrap();
    let new = NewJob { id: job, ..specimens::job(&scene.id) };
    let solution = serde_json::from_value(serde_json::json!({
        "file": "a.checkpoint", "size": 5, "begins": "view", "method": "stochastic",
        "iterations": 1, "seconds": 1.0
    }));
    let accepted = world.store.accept_view(new, &solution.unwrap(), 10).await.unwrap();
    assert!(matches!(accepted, Accepted::New(_)));
    drop(held);
    assert_eq!(sweep.await.unwrap().unwrap().set_aside, 0);
    assert_eq!(
        world.artifacts.kept_file(job, "a.checkpoint").await.unwrap().into_bytes().unwrap(),
        "light"
    );
}

#[tokio::test]
async fn pinned_and_unfinished_jobs_stay_and_the_oldest_go_first() {
    let world = World::new().await;
    let mut jobs = Vec::new();
    for number in 0..3 {
        jobs.push(world.submit(number).await.unwrap());
        world.run().await;
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    let waiting = world.submit(0).await.unwrap();
    assert_eq!(world.store.pin(jobs[0], true, None).await.unwrap(), Pinned::Done);
    let now = || Timestamp::now() + SignedDuration::from_secs(1);
    let left = async || {
        let filter = JobFilter { limit: 10, ..JobFilter::default() };
        let jobs = world.store.jobs(&filter).await.unwrap();
        jobs.into_iter().map(|job| job.id).collect::<BTreeSet<_>>()
    };
    // Nothing is old or much enough.
    let rules = Rules { age: Some(SignedDuration::from_hours(1)), bytes: Some(1 << 20) };
    assert_eq!(world.keeper.expire(rules, now()).await.unwrap(), Removed::default());
    // For want of space, those that ended first go, but not the pinned one.
    let enough = world.store.stored_bytes().await.unwrap() - 1;
    let rules = Rules { age: None, bytes: Some(enough) };
    assert!(world.keeper.expire(rules, now()).await.unwrap().jobs >= 1);
    assert!(!left().await.contains(&jobs[1]));
    let rules = Rules { age: Some(SignedDuration::ZERO), bytes: None };
    world.keeper.expire(rules, now()).await.unwrap();
    assert_eq!(left().await, BTreeSet::from([jobs[0], waiting]));
    // Their scenes stay with them.
    world.keeper.purge(-10).await.unwrap();
    world.keeper.expire(rules, now()).await.unwrap();
    world.check().await;
    assert_eq!(world.store.pin(jobs[0], false, None).await.unwrap(), Pinned::Done);
    assert_eq!(world.store.pin(Uuid::now_v7(), true, None).await.unwrap(), Pinned::Missing);
    world.keeper.expire(rules, now()).await.unwrap();
    assert_eq!(left().await, BTreeSet::from([waiting]));
}

/// Pins and scenes beyond the limit are no reason to take everybody else's results.
#[tokio::test]
async fn nobody_pays_with_results_for_what_may_not_go() {
    let world = World::new().await;
    let (pinned, other) = (world.submit(0).await.unwrap(), world.submit(1).await.unwrap());
    world.run().await;
    world.run().await;
    world.store.pin(pinned, true, None).await.unwrap();
    let later = Timestamp::now() + SignedDuration::from_hours(100);
    // A scene that no job names goes before any job.
    let (unused, bytes) = World::scene(2);
    world.keeper.keep_scene(&unused, bytes, "somebody").await.unwrap();
    let Staying { bytes, fixed } = world.store.staying(later).await.unwrap();
    let scene = unused.size;
    assert_eq!((bytes, fixed), (2 * (16 + scene), 16 + scene), "one of two may go");
    let most = |bytes| Rules { age: None, bytes: Some(bytes) };
    let removed = world.keeper.expire(most(bytes), later).await.unwrap();
    assert_eq!((removed.jobs, removed.scenes), (0, 1));
    let removed = world.keeper.expire(most(fixed - 1), later).await.unwrap();
    assert_eq!(removed, Removed::default(), "it would not be enough");
    assert!(world.store.job(other).await.unwrap().is_some());
    assert_eq!(world.keeper.expire(most(fixed), later).await.unwrap().jobs, 1);
    assert!(world.store.job(other).await.unwrap().is_none());
    // What was pinned after it was found to be old stays.
    assert!(!world.store.hide_expired(pinned).await.unwrap());
    world.store.pin(pinned, false, None).await.unwrap();
    assert!(world.store.hide_expired(pinned).await.unwrap());
}
