//! Messages to webhooks: lanes are told apart, counted and bounded.

use super::fixture::{Home, furnished, queue, wish};
use crate::api::webhooks::{DeliveryState, Ending, WebhookTarget};
use crate::store::outbox::{Attempt, Lane};
use crate::store::{NewJob, Store, Submitter};
use std::time::Duration;
use uuid::Uuid;

const LEASE: Duration = Duration::from_secs(30);

/// Ends a job of `owner` that tells `url`; the job.
async fn told(store: &dyn Store, owner: &str, url: &str) -> Uuid {
    let webhook = WebhookTarget { url: url.into(), events: Ending::ALL.to_vec(), secret: None };
    let submitter = Submitter {
        owner: owner.into(),
        billed_to: owner.into(),
        webhook: Some(webhook),
        ..Submitter::default()
    };
    let id = queue(store, NewJob { submitter, ..wish(0) }).await;
    store.cancel(id).await.unwrap();
    id
}

fn lane(owner: &str, host: &str) -> Lane {
    Lane { owner: owner.into(), host: host.into() }
}

pub async fn messages_wait_in_lanes_of_caller_and_receiver(place: &dyn Home) {
    let store = furnished(place).await;
    let mut jobs = Vec::new();
    for _ in 0..3 {
        jobs.push(told(&*store, "a", "http://hole.example/x").await);
    }
    told(&*store, "a", "https://GOOD.example").await;
    told(&*store, "b", "http://hole.example:80/another").await;
    let mut due = store.due_lanes(10).await.unwrap();
    due.sort();
    let expected =
        [lane("a", "good.example:443"), lane("a", "hole.example:80"), lane("b", "hole.example:80")];
    assert_eq!(due, expected);
    assert_eq!(store.due_lanes(1).await.unwrap().len(), 2, "one of each owner");
    // The oldest of the lane, once for each time that the lane is named, and not again while it
    // is leased.
    let taken = store.take(&[due[1].clone(), due[1].clone()], LEASE).await.unwrap();
    assert_eq!(taken.iter().map(|m| m.message.job).collect::<Vec<_>>(), jobs[..2]);
    let again = store.take(&[due[1].clone(), due[1].clone()], LEASE).await.unwrap();
    assert_eq!(again.iter().map(|m| m.message.job).collect::<Vec<_>>(), jobs[2..]);
    assert_eq!(store.due_lanes(10).await.unwrap().len(), 2);
    assert_eq!(store.undelivered().await.unwrap(), 5);
    store.sent(taken[0].id, Attempt::Delivered, "200").await.unwrap();
    store.sent(taken[1].id, Attempt::GivenUp, "410").await.unwrap();
    store.sent(again[0].id, Attempt::RetryIn(Duration::ZERO), "500").await.unwrap();
    assert_eq!(store.undelivered().await.unwrap(), 3);
    let third = store.take(&[due[1].clone()], LEASE).await.unwrap();
    assert_eq!((third[0].id, third[0].attempts), (again[0].id, 1));
}

pub async fn messages_that_wait_are_bounded_from_the_fullest_lane(place: &dyn Home) {
    let store = furnished(place).await;
    let mut stuck = Vec::new();
    for _ in 0..6 {
        stuck.push(told(&*store, "a", "http://hole.example/").await);
    }
    let fresh = told(&*store, "a", "http://good.example/").await;
    let other = told(&*store, "b", "http://hole.example/").await;
    assert_eq!(store.give_up_excess(7).await.unwrap(), []);
    let given_up = store.give_up_excess(4).await.unwrap();
    assert_eq!(given_up, [(lane("a", "hole.example:80"), 3)]);
    assert_eq!(store.give_up_excess(4).await.unwrap(), []);
    for (place, job) in stuck.iter().enumerate() {
        let told = store.deliveries(*job).await.unwrap().pop().unwrap();
        let expected = if place < 3 { DeliveryState::GivenUp } else { DeliveryState::Pending };
        assert_eq!(told.state, expected, "{place}");
        let says_why = told.last_answer.is_some_and(|why| why.contains("messages waited"));
        assert_eq!(says_why, place < 3);
    }
    for job in [fresh, other] {
        let told = store.deliveries(job).await.unwrap().pop().unwrap();
        assert_eq!(told.state, DeliveryState::Pending);
    }
    assert_eq!(store.undelivered().await.unwrap(), 5);
}
