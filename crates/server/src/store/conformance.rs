//! What the rest of the service relies on, checked on any store. Each test is a function over a
//! [`Home`] where stores can be opened; [`suite`] makes a test of each for one kind of place, so
//! that another store is one line away from passing the same.

mod attempts;
mod environments;
mod extensions;
pub mod fixture;
mod outbox;
mod sharing;
mod turns;

use crate::api::events::EventData;
use crate::api::jobs::{Figures, Picture, PictureFormat, Progress};
use crate::api::request_hash::RequestHash;
use crate::job_state::{Cause, JobState, MAX_FAILURES};
use crate::store::scenes::{ScenePosition, Viewer};
use crate::store::{Accepted, JobFilter, MAX_PROGRESS_EVENTS, NewJob, Outcome, Report, Store};
use fixture::{
    ASKING, Home, billed, claim, done, furnished, is_lost, progress, queue, scene, state,
    terminal_events, wish,
};
use std::sync::Arc;
use uuid::Uuid;

pub use attempts::*;
pub use environments::*;
pub use extensions::*;
pub use outbox::*;
pub use sharing::*;
pub use turns::*;

/// Makes a `#[tokio::test]` of every function of this suite for one kind of place.
macro_rules! suite {
    ($place:expr) => {
        $crate::store::conformance::suite! { $place;
            scenes_are_kept_once_and_listed_newest_first
            higher_priority_first_then_older
            a_repeated_key_finds_its_job_and_no_other
            a_full_queue_refuses
            jobs_are_found_by_state_label_and_page
            a_worker_that_lost_its_claim_writes_nothing
            a_deleted_job_ends_its_worker_and_its_streams
            a_job_that_kills_its_workers_is_given_up
            a_job_that_ends_its_servers_from_within_is_given_up_later
            deaths_of_the_server_are_no_fault_of_a_job_in_its_own_process
            a_job_that_takes_all_memory_is_tried_alone
            a_job_that_must_run_alone_is_not_passed_over_forever
            a_job_that_was_interrupted_often_lets_others_go_first
            nobody_starves_behind_the_many_jobs_of_another
            who_had_no_turn_for_longest_goes_first
            nobody_starves_behind_ever_new_payers
            jobs_that_pause_are_not_claimed
            an_extension_keeps_the_result_until_there_is_a_better_one
            an_orderly_shutdown_costs_no_attempt
            a_cancel_reaches_the_worker_or_ends_the_job_with_it
            ended_jobs_stay_as_they_are
            leases_of_the_living_are_left_alone
            a_lease_with_a_sign_of_life_does_not_expire
            identical_jobs_wait_for_the_one_that_runs
            quotas_count_each_submitter_for_itself
            pictures_are_found_while_their_job_is
            two_processes_never_hold_the_same_job
            progress_is_thinned_and_its_ends_are_kept
            messages_wait_in_lanes_of_caller_and_receiver
            each_holder_sees_a_scene_as_their_own
            who_lets_go_of_a_scene_leaves_it_to_the_others
            maps_and_scenes_are_kept_alike_and_listed_apart
            a_job_keeps_the_map_of_its_sky
            messages_that_wait_are_bounded_from_the_fullest_lane
        }
    };
    ($place:expr; $($test:ident)*) => {$(
        #[tokio::test]
        async fn $test() {
            $crate::store::conformance::$test(&$place).await;
        }
    )*};
}
pub(super) use suite;

pub async fn scenes_are_kept_once_and_listed_newest_first(place: &dyn Home) {
    let store = place.open().await;
    for (id, created_s) in [("a", 1), ("b", 3), ("c", 2)] {
        assert!(store.put_scene(&scene(id, created_s)).await.unwrap());
        assert!(!store.put_scene(&scene(id, created_s)).await.unwrap());
    }
    assert_eq!(store.scene("b").await.unwrap().unwrap(), scene("b", 3));
    assert_eq!(store.scene("d").await.unwrap(), None);
    let list = async |before: Option<&str>| -> Vec<String> {
        let place = before.map(|id| ScenePosition { created_ms: 2000, id: id.into() });
        let everyone = Viewer { holder: "", sees_all: true };
        let found = store.shown_scenes(everyone, place.as_ref(), 2).await.unwrap();
        found.into_iter().map(|scene| scene.id).collect()
    };
    assert_eq!(list(None).await, ["b", "c"]);
    assert_eq!(list(Some("c")).await, ["a"]);
}

pub async fn higher_priority_first_then_older(place: &dyn Home) {
    let store = furnished(place).await;
    let mut ids = Vec::new();
    for priority in [0, 9, 0] {
        ids.push(queue(&*store, wish(priority)).await);
    }
    for expected in [ids[1], ids[0], ids[2]] {
        assert_eq!(claim(&*store).await.job, expected);
    }
    assert!(store.claim(&ASKING).await.unwrap().is_none());
}

pub async fn a_repeated_key_finds_its_job_and_no_other(place: &dyn Home) {
    let store = furnished(place).await;
    let keyed = |hash: &str| NewJob {
        idempotency_key: Some("key".into()),
        request_hash: RequestHash { now: hash.into(), former: "former".into() },
        ..wish(0)
    };
    let id = queue(&*store, keyed("one")).await;
    match store.accept(keyed("one"), 100).await.unwrap() {
        Accepted::Again(job) => assert_eq!(job.id, id),
        other => panic!("{other:?}"),
    }
    let other = store.accept(keyed("another"), 100).await.unwrap();
    assert!(matches!(other, Accepted::KeyConflict), "{other:?}");
    // What an earlier release stored with the same request is the same request.
    let former = NewJob { idempotency_key: Some("old".into()), ..keyed("former") };
    let old = queue(&*store, former).await;
    let again = NewJob { idempotency_key: Some("old".into()), ..keyed("new form") };
    assert!(matches!(store.accept(again, 100).await.unwrap(), Accepted::Again(j) if j.id == old));
    // A key is free again once its job is deleted.
    assert!(store.delete(id).await.unwrap());
    assert_ne!(queue(&*store, keyed("another")).await, id);
}

pub async fn a_full_queue_refuses(place: &dyn Home) {
    let store = furnished(place).await;
    let first = queue(&*store, wish(0)).await;
    assert!(matches!(store.accept(wish(0), 1).await.unwrap(), Accepted::QueueFull));
    assert_eq!(claim(&*store).await.job, first);
    assert!(matches!(store.accept(wish(0), 1).await.unwrap(), Accepted::New(_)));
    assert_eq!(store.counts().await.unwrap().by_state, [1, 1, 0, 0, 0]);
}

pub async fn jobs_are_found_by_state_label_and_page(place: &dyn Home) {
    let store = furnished(place).await;
    let mut ids = Vec::new();
    for n in 0..4 {
        let mut job = wish(0);
        job.request.labels = [("n".to_owned(), (n % 2).to_string())].into();
        ids.push(queue(&*store, job).await);
    }
    let running = claim(&*store).await;
    assert_eq!(running.job, ids[0]);
    let find = async |filter: JobFilter| -> Vec<Uuid> {
        store.jobs(&filter).await.unwrap().into_iter().map(|job| job.id).collect()
    };
    let all = JobFilter { limit: 10, ..JobFilter::default() };
    assert_eq!(find(all.clone()).await, [ids[3], ids[2], ids[1], ids[0]]);
    let queued = JobFilter { state: Some(JobState::Queued), ..all.clone() };
    assert_eq!(find(queued).await, [ids[3], ids[2], ids[1]]);
    let odd = JobFilter { label: Some(("n".into(), "1".into())), ..all.clone() };
    assert_eq!(find(odd).await, [ids[3], ids[1]]);
    let page = JobFilter { before: Some(ids[2]), limit: 1, ..all };
    assert_eq!(find(page).await, [ids[1]]);
}

pub async fn a_worker_that_lost_its_claim_writes_nothing(place: &dyn Home) {
    let store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    let old = claim(&*store).await;
    store.release(old, Cause::Failure, "its worker died").await.unwrap();
    let new = claim(&*store).await;
    assert!(new.fence > old.fence);
    assert!(is_lost(store.report(old, progress(1)).await));
    assert!(is_lost(store.finish(old, done()).await));
    assert!(is_lost(store.release(old, Cause::Failure, "again").await));
    assert_eq!(store.renew(&[old, new]).await.unwrap(), [old]);
    assert_eq!(state(&*store, id).await, JobState::Running);
    store.finish(new, done()).await.unwrap();
    assert_eq!(state(&*store, id).await, JobState::Succeeded);
    // One result: the same worker cannot finish twice either.
    assert!(is_lost(store.finish(new, done()).await));
    assert_eq!(terminal_events(&*store, id).await, 1);
}

pub async fn a_deleted_job_ends_its_worker_and_its_streams(place: &dyn Home) {
    let store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    let held = claim(&*store).await;
    assert!(store.delete(id).await.unwrap());
    assert!(!store.delete(id).await.unwrap());
    assert!(store.job(id).await.unwrap().is_none());
    assert!(is_lost(store.report(held, progress(1)).await));
    assert_eq!(terminal_events(&*store, id).await, 1);
    let last = store.events(id, 0, 100).await.unwrap().pop().unwrap();
    assert!(last.data.is_terminal());
    assert_eq!(store.purge(60_000).await.unwrap(), Vec::<Uuid>::new());
    assert_eq!(store.purge(0).await.unwrap(), [id]);
    assert!(store.events(id, 0, 100).await.unwrap().is_empty());
}

pub async fn a_job_that_kills_its_workers_is_given_up(place: &dyn Home) {
    let store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    for attempt in 1..=MAX_FAILURES {
        // What does not count is not told either.
        store
            .release(claim(&*store).await, Cause::Circumstances, "the server shut down")
            .await
            .unwrap();
        let why = format!("fault {attempt}");
        store.release(claim(&*store).await, Cause::Failure, &why).await.unwrap();
        let job = store.job(id).await.unwrap().unwrap();
        assert_eq!(job.attempts, attempt);
        let expected = if attempt < MAX_FAILURES { JobState::Queued } else { JobState::Failed };
        assert_eq!(job.state, expected);
    }
    let error = store.job(id).await.unwrap().unwrap().error.unwrap();
    assert_eq!(error.code, "poisoned");
    assert!(error.detail.contains("attempt 1: fault 1"), "{}", error.detail);
    assert!(error.detail.contains("attempt 5: fault 5"), "{}", error.detail);
    assert!(!error.detail.contains("shut down"), "{}", error.detail);
    assert_eq!(terminal_events(&*store, id).await, 1);
}

pub async fn an_orderly_shutdown_costs_no_attempt(place: &dyn Home) {
    let store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    for _ in 0..2 * MAX_FAILURES {
        claim(&*store).await;
        assert_eq!(store.release_all().await.unwrap(), 1);
    }
    let job = store.job(id).await.unwrap().unwrap();
    assert_eq!((job.state, job.attempts), (JobState::Queued, 0));
}

pub async fn a_cancel_reaches_the_worker_or_ends_the_job_with_it(place: &dyn Home) {
    let store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    let held = claim(&*store).await;
    assert!(!store.report(held, progress(1)).await.unwrap());
    store.cancel(id).await.unwrap();
    assert!(store.report(held, progress(2)).await.unwrap());
    // The worker dies before it can obey.
    let store = place.open().await;
    store.recover().await.unwrap();
    assert_eq!(state(&*store, id).await, JobState::Cancelled);
    assert_eq!(terminal_events(&*store, id).await, 1);
}

pub async fn ended_jobs_stay_as_they_are(place: &dyn Home) {
    let store = furnished(place).await;
    for end in [JobState::Succeeded, JobState::Failed, JobState::Cancelled] {
        let id = queue(&*store, wish(0)).await;
        store.finish(claim(&*store).await, Outcome::of(end)).await.unwrap();
        let before = store.job(id).await.unwrap().unwrap();
        assert!(before.finished_at.is_some());
        assert_eq!(store.cancel(id).await.unwrap().unwrap(), before);
        assert!(store.claim(&ASKING).await.unwrap().is_none());
        assert_eq!(store.recover().await.unwrap(), Vec::<Uuid>::new());
        assert_eq!(store.release_all().await.unwrap(), 0);
        assert_eq!(store.job(id).await.unwrap().unwrap(), before);
        assert_eq!(terminal_events(&*store, id).await, 1);
    }
    assert_eq!(store.cancel(Uuid::now_v7()).await.unwrap(), None);
}

pub async fn leases_of_the_living_are_left_alone(place: &dyn Home) {
    let (mine, other) = (furnished(place).await, place.open().await);
    let (first, second) = (queue(&*mine, wish(0)).await, queue(&*mine, wish(0)).await);
    let held = claim(&*mine).await;
    let theirs = claim(&*other).await;
    assert_eq!([held.job, theirs.job], [first, second]);
    // Recovery takes what is not one's own; handing back takes what is.
    assert_eq!(mine.recover().await.unwrap(), [second]);
    assert_eq!(state(&*mine, first).await, JobState::Running);
    assert_eq!(other.release_all().await.unwrap(), 0);
    assert_eq!(mine.release_all().await.unwrap(), 1);
}

pub async fn a_lease_with_a_sign_of_life_does_not_expire(place: &dyn Home) {
    let store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    let held = claim(&*store).await;
    let seen = store.leases().await.unwrap();
    assert_eq!(seen.iter().map(|lease| lease.claim).collect::<Vec<_>>(), [held]);
    assert_eq!(store.renew(&[held]).await.unwrap(), []);
    // The sweeper looked before that.
    assert!(!store.expire(&seen[0], "silence").await.unwrap());
    assert_eq!(state(&*store, id).await, JobState::Running);
    let seen = store.leases().await.unwrap();
    assert!(store.expire(&seen[0], "silence").await.unwrap());
    assert!(!store.expire(&seen[0], "silence").await.unwrap());
    let job = store.job(id).await.unwrap().unwrap();
    // In a process of its own, it cannot have silenced the server.
    assert_eq!((job.state, job.attempts, job.interruptions), (JobState::Queued, 0, 1));
    assert_eq!(store.renew(&[held]).await.unwrap(), [held]);
    assert!(is_lost(store.finish(held, done()).await));
}

pub async fn identical_jobs_wait_for_the_one_that_runs(place: &dyn Home) {
    let store = furnished(place).await;
    let twin = || NewJob { render_key: Some("same".into()), ..wish(0) };
    let (first, second, third) = (
        queue(&*store, twin()).await,
        queue(&*store, twin()).await,
        queue(&*store, NewJob { render_key: Some("other".into()), ..wish(0) }).await,
    );
    let leader = claim(&*store).await;
    assert_eq!(leader.job, first);
    assert_eq!(store.twin(leader).await.unwrap(), None);
    assert_eq!(claim(&*store).await.job, third, "the twin waits, others do not");
    assert!(store.claim(&ASKING).await.unwrap().is_none());
    store.finish(leader, done()).await.unwrap();
    let follower = claim(&*store).await;
    assert_eq!(follower.job, second);
    assert_eq!(store.twin(follower).await.unwrap().unwrap().id, first);
    let outcome = Outcome { result_of: Some(first), ..done() };
    store.finish(follower, outcome).await.unwrap();
    assert_eq!(store.job(second).await.unwrap().unwrap().result_of, Some(first));
    // One that was cancelled, failed or deleted has nothing to share, and holds nobody up.
    let (fourth, fifth) = (queue(&*store, twin()).await, queue(&*store, twin()).await);
    let held = claim(&*store).await;
    assert_eq!(held.job, fourth);
    store.delete(first).await.unwrap();
    store.delete(second).await.unwrap();
    store.finish(held, Outcome::of(JobState::Cancelled)).await.unwrap();
    let last = claim(&*store).await;
    assert_eq!(last.job, fifth);
    assert_eq!(store.twin(last).await.unwrap(), None);
}

pub async fn pictures_are_found_while_their_job_is(place: &dyn Home) {
    let store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    let held = claim(&*store).await;
    let picture = |sha256: &str| Picture {
        format: PictureFormat::Png,
        url: String::new(),
        sha256: sha256.into(),
        size: 3,
        width: 2,
        height: 1,
        base64: None,
    };
    let snapshots = vec![(vec![picture("early")], Progress::default())];
    store.report(held, Report { snapshots, ..Report::default() }).await.unwrap();
    let newest = async || store.newest_picture(id, PictureFormat::Png).await.unwrap();
    assert_eq!(newest().await.unwrap(), picture("early"));
    let outcome = Outcome { pictures: vec![picture("late")], ..done() };
    store.finish(held, outcome).await.unwrap();
    assert_eq!(newest().await.unwrap(), picture("late"));
    assert!(store.picture(id, "early", PictureFormat::Png).await.unwrap().is_some());
    assert!(store.picture(id, "early", PictureFormat::Exr).await.unwrap().is_none());
    assert!(store.picture(id, "never", PictureFormat::Png).await.unwrap().is_none());
    let job = store.job(id).await.unwrap().unwrap();
    assert_eq!(job.result.unwrap(), [picture("late")]);
    store.delete(id).await.unwrap();
    assert!(newest().await.is_none());
    assert!(store.picture(id, "late", PictureFormat::Png).await.unwrap().is_none());
}

pub async fn two_processes_never_hold_the_same_job(place: &dyn Home) {
    let stores = [furnished(place).await, place.open().await];
    const JOBS: usize = 20;
    for _ in 0..JOBS {
        queue(&*stores[0], wish(0)).await;
    }
    let work = |store: Arc<dyn Store>| async move {
        let mut held = Vec::new();
        while let Some((claim, _)) = store.claim(&ASKING).await.unwrap() {
            store.finish(claim, done()).await.unwrap();
            held.push(claim.job);
        }
        held
    };
    let workers = [0, 1, 0, 1].map(|which| tokio::spawn(work(stores[which].clone())));
    let mut held = Vec::new();
    for worker in workers {
        held.extend(worker.await.unwrap());
    }
    held.sort_unstable();
    held.dedup();
    assert_eq!(held.len(), JOBS);
    for id in held {
        assert_eq!(terminal_events(&*stores[1], id).await, 1);
    }
}

pub async fn progress_is_thinned_and_its_ends_are_kept(place: &dyn Home) {
    let store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    let held = claim(&*store).await;
    let total = 3 * MAX_PROGRESS_EVENTS as u64;
    for batch in 0..total / 128 {
        let points = (0..128).map(|i| Progress {
            figures: Figures { iterations: batch * 128 + i, ..Figures::default() },
            ..Progress::default()
        });
        let report = Report { progress: points.collect(), ..Report::default() };
        store.report(held, report).await.unwrap();
    }
    let trace = store.trace(id).await.unwrap();
    let most = (MAX_PROGRESS_EVENTS + MAX_PROGRESS_EVENTS / 8) as usize;
    assert!(trace.len() <= most, "{}", trace.len());
    assert!(trace.len() >= MAX_PROGRESS_EVENTS as usize / 2);
    assert_eq!(trace[0].figures.iterations, 0);
    assert_eq!(trace.last().unwrap().figures.iterations, total - 1);
    assert!(trace.windows(2).all(|pair| pair[0].figures.iterations < pair[1].figures.iterations));
    let states = store.events(id, 0, u32::MAX).await.unwrap();
    let states = states.iter().filter(|event| matches!(event.data, EventData::State(_)));
    assert_eq!(states.count(), 2, "only progress is thinned");
}

pub async fn quotas_count_each_submitter_for_itself(place: &dyn Home) {
    let store = furnished(place).await;
    let first = queue(&*store, billed("a", 2, 1, None)).await;
    let second = queue(&*store, billed("a", 2, 1, None)).await;
    let refused = store.accept(billed("a", 2, 1, None), 100).await.unwrap();
    assert!(matches!(refused, Accepted::OwnQueueFull));
    let third = queue(&*store, billed("b", 1, 2, None)).await;
    // One of a runs; the second waits though it is older than that of b.
    let running = claim(&*store).await;
    assert_eq!(running.job, first);
    assert_eq!(claim(&*store).await.job, third);
    assert!(store.claim(&ASKING).await.unwrap().is_none());
    store.finish(running, done()).await.unwrap();
    assert_eq!(claim(&*store).await.job, second);
    // Idempotency keys are each submitter's own.
    queue(&*store, billed("a", 2, 1, Some("k"))).await;
    queue(&*store, billed("b", 2, 1, Some("k"))).await;
    let again = store.accept(billed("a", 2, 1, Some("k")), 100).await.unwrap();
    assert!(matches!(again, Accepted::Again(_)));
    // What was removed is not taken by a job any more.
    let gone = NewJob { scene_id: "no scene".into(), ..wish(0) };
    assert!(matches!(store.accept(gone, 100).await.unwrap(), Accepted::SceneGone));
}
