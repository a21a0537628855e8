//! Messages to webhooks: taken from the outbox, sent, sent again where that failed.
//!
//! At least once: a message that was sent and not noted is sent again after its lease, with the
//! same id.

pub mod address;
pub mod send;

use crate::service::Service;
use crate::store::outbox::{Attempt, DueMessage};
use axum::http::StatusCode;
use send::{Sender, Sent};
use std::sync::Arc;
use std::time::Duration;
use tokio::task::JoinSet;

/// Messages under way at the same time.
const AT_ONCE: usize = 16;
/// Nobody else gets a message for so long; more than a sender's patience.
const LEASE: Duration = Duration::from_secs(30);
/// How often the outbox is looked at.
const POLL: Duration = Duration::from_millis(500);
/// The first pause; it doubles.
const FIRST_PAUSE: Duration = Duration::from_secs(5);
/// The longest pause.
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);
/// Times that a message is sent: over about ten hours.
pub const MAX_ATTEMPTS: u32 = 18;
/// How long one can see what became of a message.
pub const KEEP: Duration = Duration::from_secs(7 * 86_400);

/// Delivers messages until the service shuts down; what is under way then is sent again later.
pub async fn deliver(service: Arc<Service>) {
    let sender = match Sender::new(service.config.guard.webhook_allow.clone()) {
        Ok(sender) => Arc::new(sender),
        Err(error) => return tracing::error!(%error, "webhooks cannot be sent"),
    };
    let mut under_way = JoinSet::new();
    loop {
        while under_way.try_join_next().is_some() {}
        let room = u32::try_from(AT_ONCE - under_way.len().min(AT_ONCE)).unwrap_or(0);
        let due = if room > 0 { service.store.due(room, LEASE).await } else { Ok(Vec::new()) };
        match due {
            Ok(messages) => {
                for message in messages {
                    under_way.spawn(deliver_one(service.clone(), sender.clone(), message));
                }
            }
            Err(error) => tracing::error!(%error, "cannot read the outbox"),
        }
        tokio::select! {
            () = tokio::time::sleep(POLL) => {}
            Some(_) = under_way.join_next(), if under_way.len() >= AT_ONCE => {}
            () = service.shutdown.cancelled() => return,
        }
    }
}

async fn deliver_one(service: Arc<Service>, sender: Arc<Sender>, due: DueMessage) {
    let sent = sender.send(&due.url, due.secret.as_deref(), &due.message).await;
    let (attempt, answer) = judge(&sent, due.attempts + 1);
    let outcome = match attempt {
        Attempt::Delivered => "delivered",
        Attempt::RetryIn(_) => "failed",
        Attempt::GivenUp => "given_up",
    };
    service.metrics.count_webhook(outcome);
    tracing::debug!(job = %due.message.job, message = due.message.id, outcome, answer, "webhook");
    if attempt == Attempt::GivenUp {
        tracing::warn!(job = %due.message.job, message = due.message.id, answer, "webhook given up");
    }
    if let Err(error) = service.store.sent(due.id, attempt, &answer).await {
        tracing::error!(%error, "cannot note what became of a webhook; it is sent again");
    }
}

/// What follows from an attempt, and a note about it.
fn judge(sent: &Sent, attempts: u32) -> (Attempt, String) {
    match sent {
        Sent::Answered(status) if status.is_success() => (Attempt::Delivered, status.to_string()),
        // The receiver says that it is gone for good.
        Sent::Answered(StatusCode::GONE) => (Attempt::GivenUp, StatusCode::GONE.to_string()),
        Sent::Answered(status) => (again(attempts), status.to_string()),
        Sent::Failed(why) => (again(attempts), why.clone()),
        Sent::Refused(why) => (Attempt::GivenUp, why.clone()),
    }
}

fn again(attempts: u32) -> Attempt {
    if attempts >= MAX_ATTEMPTS { Attempt::GivenUp } else { Attempt::RetryIn(pause(attempts)) }
}

/// The pause after so many attempts: doubling, with up to a quarter more by chance, so that what
/// failed together does not come back together.
fn pause(attempts: u32) -> Duration {
    let doubled = FIRST_PAUSE.saturating_mul(1 << attempts.saturating_sub(1).min(16));
    let pause = doubled.min(LONGEST_PAUSE);
    let chance = (uuid::Uuid::new_v4().as_u128() & 0xff) as u32;
    pause + pause / 4 * chance / 256
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_decide_what_comes_next() {
        let answered = |code: u16| Sent::Answered(StatusCode::from_u16(code).unwrap());
        for code in [200, 202, 204, 299] {
            assert_eq!(judge(&answered(code), 1).0, Attempt::Delivered, "{code}");
        }
        // A redirect is no delivery, and is not followed.
        for code in [301, 302, 307, 308, 400, 404, 429, 500, 503] {
            assert!(matches!(judge(&answered(code), 1).0, Attempt::RetryIn(_)), "{code}");
            assert_eq!(judge(&answered(code), MAX_ATTEMPTS).0, Attempt::GivenUp, "{code}");
        }
        assert_eq!(judge(&answered(410), 1).0, Attempt::GivenUp);
        assert_eq!(judge(&Sent::Refused("inside".into()), 1).0, Attempt::GivenUp);
        assert!(matches!(judge(&Sent::Failed("away".into()), 1).0, Attempt::RetryIn(_)));
    }

    #[test]
    fn pauses_double_up_to_an_hour() {
        for attempts in 1..100 {
            let least = FIRST_PAUSE.saturating_mul(1 << (attempts - 1).min(16)).min(LONGEST_PAUSE);
            let pause = pause(attempts);
            assert!(pause >= least && pause <= least + least / 4, "{attempts}: {pause:?}");
        }
        let total: Duration = (1..MAX_ATTEMPTS).map(pause).sum();
        assert!(total > Duration::from_secs(8 * 3600) && total < Duration::from_secs(12 * 3600));
    }
}
