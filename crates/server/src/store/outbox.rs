//! Messages to webhooks, written together with the end of the job that they tell of.

use super::error::StoreError;
use crate::api::webhooks::{Delivery, WebhookMessage};
use async_trait::async_trait;
use std::time::Duration;
use uuid::Uuid;

/// No message waits longer than this for its next attempt: more than the longest pause between two
/// attempts. One that would was put off while the clock was ahead, and is due.
pub const LONGEST_WAIT: Duration = Duration::from_secs(2 * 3600);

/// What one caller sends to one receiver. Lanes take turns, so that no receiver and no caller
/// holds up the messages of another.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Lane {
    /// The key whose jobs the messages tell of, or the address that quotas count by; empty where
    /// callers are not told apart.
    pub owner: String,
    /// Host and port of the receiver.
    pub host: String,
}

/// A message that is due.
#[derive(Clone, Debug)]
pub struct DueMessage {
    /// Its number in the outbox.
    pub id: i64,
    /// The lane that it waits in.
    pub lane: Lane,
    /// What to send.
    pub message: WebhookMessage,
    /// Where to.
    pub url: String,
    /// What signs it.
    pub secret: Option<String>,
    /// Times that it was sent before.
    pub attempts: u32,
}

/// What came of an attempt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Attempt {
    /// The receiver has it.
    Delivered,
    /// Try again after so long.
    RetryIn(Duration),
    /// There will be no other.
    GivenUp,
}

/// Messages to webhooks.
#[async_trait]
pub trait Outbox: Send + Sync {
    /// Lanes in which a message is due; of each owner at most `each`, and others every time where
    /// there are more.
    async fn due_lanes(&self, each: u32) -> Result<Vec<Lane>, StoreError>;
    /// Takes the message that was due first from each of these lanes, two where a lane is named
    /// twice. Nobody else is given them for `lease`; after it, they are due again unless
    /// [`Outbox::sent`] said otherwise.
    async fn take(&self, lanes: &[Lane], lease: Duration) -> Result<Vec<DueMessage>, StoreError>;
    /// Gives up the oldest messages of owners of whom more than `most` wait, from the lane in
    /// which most wait; how many of whom.
    async fn give_up_excess(&self, most: u64) -> Result<Vec<(Lane, u64)>, StoreError>;
    /// Notes what came of sending a message.
    async fn sent(&self, id: i64, attempt: Attempt, answer: &str) -> Result<(), StoreError>;
    /// Messages of a job, oldest first.
    async fn deliveries(&self, job: Uuid) -> Result<Vec<Delivery>, StoreError>;
    /// Messages that are still to be delivered.
    async fn undelivered(&self) -> Result<u64, StoreError>;
    /// Forgets messages that were delivered or given up longer ago than `age`.
    async fn forget_messages(&self, age: Duration) -> Result<u64, StoreError>;
}
