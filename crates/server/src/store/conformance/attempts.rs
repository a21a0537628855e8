//! Attempts that were broken off: what counts, and who goes first after that.

use super::fixture::{ASKING, Home, claim, done, furnished, queue, terminal_events, wish};
use crate::job_state::{Cause, JobState, MAX_FAILURES, MAX_OUTAGES};
use crate::store::{Asking, Claim, Store};
use uuid::Uuid;

/// A worker whose jobs run in the server's own process.
const WITHIN_THE_SERVER: Asking<'static> = Asking { own_process: false, ..ASKING };

pub async fn a_job_that_ends_its_servers_from_within_is_given_up_later(place: &dyn Home) {
    let mut store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    store.release(claim(&*store).await, Cause::Failure, "the device was lost").await.unwrap();
    for outage in 1..=MAX_OUTAGES {
        store.claim(&WITHIN_THE_SERVER).await.unwrap().unwrap();
        store = place.open().await;
        assert_eq!(store.recover().await.unwrap(), [id]);
        let job = store.job(id).await.unwrap().unwrap();
        assert_eq!((job.attempts, job.interruptions), (1 + outage, 0));
        let expected = if outage < MAX_OUTAGES { JobState::Queued } else { JobState::Failed };
        assert_eq!(job.state, expected);
    }
    let error = store.job(id).await.unwrap().unwrap().error.unwrap();
    assert!(error.detail.contains("attempt 1: the device was lost"), "{}", error.detail);
    assert!(error.detail.contains("attempt 21: the server died"), "{}", error.detail);
    assert_eq!(terminal_events(&*store, id).await, 1);
}

pub async fn deaths_of_the_server_are_no_fault_of_a_job_in_its_own_process(place: &dyn Home) {
    let mut store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    for death in 1..=2 * MAX_OUTAGES {
        let (_, running) = store.claim(&ASKING).await.unwrap().unwrap();
        assert_eq!((running.attempts, running.interruptions), (1, death - 1));
        store = place.open().await;
        assert_eq!(store.recover().await.unwrap(), [id]);
        let job = store.job(id).await.unwrap().unwrap();
        assert_eq!((job.state, job.attempts), (JobState::Queued, 0));
        assert_eq!(job.interruptions, death);
    }
    // Its own failures count as ever.
    for _ in 1..=MAX_FAILURES {
        store.release(claim(&*store).await, Cause::Failure, "it crashed").await.unwrap();
    }
    let job = store.job(id).await.unwrap().unwrap();
    assert_eq!((job.state, job.attempts), (JobState::Failed, MAX_FAILURES));
    let told = job.error.unwrap().detail;
    assert!(!told.contains("the server died"), "{told}");
    assert_eq!(terminal_events(&*store, id).await, 1);
}

/// Makes a job run alone from now on.
async fn dies_of_memory_beside_others(store: &dyn Store, id: Uuid) {
    let cause = Cause::OutOfMemory { alone: false };
    for _ in 0..2 {
        let held = claim(store).await;
        assert_eq!(held.job, id);
        store.release(held, cause, "it was killed").await.unwrap();
        assert_eq!(store.job(id).await.unwrap().unwrap().attempts, 0);
    }
}

async fn is_nothing_to_claim(store: &dyn Store) -> bool {
    store.claim(&ASKING).await.unwrap().is_none()
}

pub async fn a_job_that_takes_all_memory_is_tried_alone(place: &dyn Home) {
    let store = furnished(place).await;
    let greedy = queue(&*store, wish(1)).await;
    dies_of_memory_beside_others(&*store, greedy).await;
    let other = queue(&*store, wish(2)).await;
    let beside = claim(&*store).await;
    assert_eq!(beside.job, other);
    assert!(is_nothing_to_claim(&*store).await, "another job runs");
    store.finish(beside, done()).await.unwrap();
    queue(&*store, wish(0)).await;
    for failure in 1..=MAX_FAILURES {
        let alone = claim(&*store).await;
        assert_eq!(alone.job, greedy);
        assert!(is_nothing_to_claim(&*store).await, "nothing runs beside it");
        let cause = Cause::OutOfMemory { alone: true };
        store.release(alone, cause, "it was killed").await.unwrap();
        assert_eq!(store.job(greedy).await.unwrap().unwrap().attempts, failure);
    }
    assert_eq!(store.job(greedy).await.unwrap().unwrap().state, JobState::Failed);
    claim(&*store).await;
}

pub async fn a_job_that_must_run_alone_is_not_passed_over_forever(place: &dyn Home) {
    let store = furnished(place).await;
    let greedy = queue(&*store, wish(0)).await;
    dies_of_memory_beside_others(&*store, greedy).await;
    // Two devices that are never idle at the same time: others come all the time.
    queue(&*store, wish(1)).await;
    let mut running = claim(&*store).await;
    let mut passed: u32 = 0;
    loop {
        queue(&*store, wish(0)).await;
        let Some((next, _)) = store.claim(&ASKING).await.unwrap() else { break };
        assert_ne!(next.job, greedy);
        store.finish(std::mem::replace(&mut running, next), done()).await.unwrap();
        passed += 1;
        assert!(passed < 100, "it starves");
    }
    assert!(passed > 4, "others wait for it too soon");
    store.finish(running, done()).await.unwrap();
    assert_eq!(claim(&*store).await.job, greedy);
}

pub async fn a_job_that_was_interrupted_often_lets_others_go_first(place: &dyn Home) {
    let mut store = furnished(place).await;
    let unlucky = queue(&*store, wish(0)).await;
    let urgent = queue(&*store, wish(5)).await;
    store.finish(claim(&*store).await, done()).await.unwrap();
    assert_eq!(store.job(urgent).await.unwrap().unwrap().state, JobState::Succeeded);
    let others = [queue(&*store, wish(0)).await, queue(&*store, wish(0)).await];
    let mut held: Option<Claim> = None;
    for _ in 0..3 {
        held = Some(claim(&*store).await);
        assert_eq!(held.unwrap().job, unlucky, "the oldest");
        store = place.open().await;
        store.recover().await.unwrap();
    }
    assert!(store.renew(&[held.unwrap()]).await.unwrap().len() == 1);
    let later = queue(&*store, wish(0)).await;
    for expected in [others[0], others[1], unlucky, later] {
        assert_eq!(claim(&*store).await.job, expected);
    }
}
