//! Messages to webhooks, written together with the end of the job that they tell of.

use super::StoreError;
use crate::api::webhooks::{Delivery, WebhookMessage};
use async_trait::async_trait;
use std::time::Duration;
use uuid::Uuid;

/// A message that is due.
#[derive(Clone, Debug)]
pub struct DueMessage {
    /// Its number in the outbox.
    pub id: i64,
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
    /// Takes messages that are due, at most `limit`. Nobody else is given them for `lease`; after
    /// it, they are due again unless [`Outbox::sent`] said otherwise.
    async fn due(&self, limit: u32, lease: Duration) -> Result<Vec<DueMessage>, StoreError>;
    /// Notes what came of sending a message.
    async fn sent(&self, id: i64, attempt: Attempt, answer: &str) -> Result<(), StoreError>;
    /// Messages of a job, oldest first.
    async fn deliveries(&self, job: Uuid) -> Result<Vec<Delivery>, StoreError>;
    /// Messages that are still to be delivered.
    async fn undelivered(&self) -> Result<u64, StoreError>;
    /// Forgets messages that were delivered or given up longer ago than `age`.
    async fn forget_messages(&self, age: Duration) -> Result<u64, StoreError>;
}
