//! Whose job is claimed next.

use super::fixture::{ASKING, Home, claim, done, furnished, wish};
use crate::store::{Accepted, Asking, NewJob, Store, Submitter};
use uuid::Uuid;

/// A job that `payer` pays for.
fn of(payer: &str) -> NewJob {
    let submitter = Submitter { billed_to: payer.into(), ..Submitter::default() };
    NewJob { submitter, ..wish(0) }
}

async fn queue(store: &dyn Store, job: NewJob) -> Uuid {
    let id = job.id;
    assert!(matches!(store.accept(job, 2000).await.unwrap(), Accepted::New(_)));
    id
}

/// Claims and ends the next job.
async fn next(store: &dyn Store) -> Uuid {
    let held = claim(store).await;
    store.finish(held, done()).await.unwrap();
    held.job
}

pub async fn nobody_starves_behind_the_many_jobs_of_another(place: &dyn Home) {
    let store = furnished(place).await;
    let mut many = Vec::new();
    for _ in 0..1000 {
        many.push(queue(&*store, of("many")).await);
    }
    assert_eq!(next(&*store).await, many[0]);
    let few = [queue(&*store, of("few")).await, queue(&*store, of("few")).await];
    // They take turns from now on.
    for expected in [few[0], many[1], few[1], many[2], many[3]] {
        assert_eq!(next(&*store).await, expected);
    }
    // Priority goes before turns.
    let urgent = queue(&*store, NewJob { request: wish(1).request, ..of("many") }).await;
    let third = queue(&*store, of("few")).await;
    for expected in [urgent, third, many[4]] {
        assert_eq!(next(&*store).await, expected);
    }
}

pub async fn who_had_no_turn_for_longest_goes_first(place: &dyn Home) {
    let store = furnished(place).await;
    let mut expected = Vec::new();
    for round in 0..3 {
        for payer in ["c", "a", "b"] {
            expected.push(queue(&*store, of(payer)).await);
        }
        assert_eq!(expected.len(), 3 * (round + 1));
    }
    // Also across a restart, and with many who come anew: they go before the one who had the last
    // turn, `c`, and behind the others who wait.
    for id in &expected[..4] {
        assert_eq!(next(&*store).await, *id);
    }
    let store = place.open().await;
    for guest in 0..200 {
        queue(&*store, of(&format!("guest {guest:03}"))).await;
    }
    for id in &expected[4..6] {
        assert_eq!(next(&*store).await, *id);
    }
    for _ in 0..200 {
        assert!(!expected[6..].contains(&next(&*store).await), "newcomers are next");
    }
    for id in &expected[6..] {
        assert_eq!(next(&*store).await, *id);
    }
    assert!(store.claim(&ASKING).await.unwrap().is_none());
}

/// However many come, each with one job: who waits has a turn within a round.
pub async fn nobody_starves_behind_ever_new_payers(place: &dyn Home) {
    let store = furnished(place).await;
    let waits = [queue(&*store, of("waits")).await, queue(&*store, of("waits")).await];
    let mut claimed = Vec::new();
    for guest in 0..300 {
        for twin in ["a", "b"] {
            queue(&*store, of(&format!("guest {guest} {twin}"))).await;
        }
        claimed.push(next(&*store).await);
    }
    let turn = |id| claimed.iter().position(|claimed| *claimed == id);
    assert_eq!(turn(waits[0]), Some(0));
    // Two came before its second turn was due, and those who came with its first.
    assert!(turn(waits[1]).is_some_and(|turn| turn <= 5), "{:?}", turn(waits[1]));
}

pub async fn jobs_that_pause_are_not_claimed(place: &dyn Home) {
    let store = furnished(place).await;
    let (first, second) = (queue(&*store, of("a")).await, queue(&*store, of("a")).await);
    let other = queue(&*store, of("b")).await;
    let paused = [first, other];
    let asking = Asking { paused: &paused, ..ASKING };
    let (held, _) = store.claim(&asking).await.unwrap().unwrap();
    assert_eq!(held.job, second);
    assert!(store.claim(&asking).await.unwrap().is_none());
    // Who only paused did not have a turn.
    assert_eq!(next(&*store).await, other);
    assert_eq!(next(&*store).await, first);
}
