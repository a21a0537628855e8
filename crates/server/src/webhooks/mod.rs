//! Messages to webhooks: taken from the outbox in [`turns`], sent, sent again where that failed.
//!
//! At least once: a message that was sent and not noted is sent again after its lease, with the
//! same id.

pub mod send;
pub mod turns;

use crate::shared::Shared;
use crate::store::StoreError;
use crate::store::outbox::{Attempt, DueMessage, Lane};
use axum::http::StatusCode;
use send::{Sender, Sent};
use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::task::{Id, JoinSet};
use turns::Turns;

/// Lanes of one owner that are looked at together.
const LANES_EACH: u32 = 64;
/// Nobody else gets a message for so long; more than a sender's patience.
const LEASE: Duration = Duration::from_secs(30);
/// How often the outbox is looked at.
const POLL: Duration = Duration::from_millis(500);
/// How often it is looked for owners of whom too many messages wait.
const EXCESS_EVERY: Duration = Duration::from_secs(2);
/// The first pause; it doubles.
const FIRST_PAUSE: Duration = Duration::from_secs(5);
/// The longest pause.
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);
/// Times that a message is sent: over about ten hours.
pub const MAX_ATTEMPTS: u32 = 18;
/// How long one can see what became of a message.
pub const KEEP: Duration = Duration::from_secs(7 * 86_400);

/// Delivers messages until the service shuts down; what is under way then is sent again later.
pub async fn deliver(shared: Arc<Shared>) {
    let sender = match Sender::new(shared.config.guard.webhook_allow.clone()) {
        Ok(sender) => Arc::new(sender),
        Err(error) => return tracing::error!(%error, "webhooks cannot be sent"),
    };
    let mut excess = tokio::time::interval(EXCESS_EVERY);
    let mut under_way = UnderWay::default();
    loop {
        under_way.note_ended();
        if let Err(error) = under_way.send_due(&shared, &sender).await {
            tracing::error!(%error, "cannot read the outbox");
        }
        tokio::select! {
            () = tokio::time::sleep(POLL) => {}
            _ = excess.tick() => give_up_excess(&shared).await,
            () = under_way.one_ended() => {}
            () = shared.shutdown.cancelled() => return,
        }
    }
}

/// Messages that are being sent, and whose turn is next.
#[derive(Default)]
struct UnderWay {
    turns: Turns,
    tasks: JoinSet<bool>,
    lanes: HashMap<Id, Lane>,
}

impl UnderWay {
    /// Begins to send what is due and has its turn.
    async fn send_due(
        &mut self,
        shared: &Arc<Shared>,
        sender: &Arc<Sender>,
    ) -> Result<(), StoreError> {
        let due = shared.store.due_lanes(LANES_EACH).await?;
        let mut lanes = self.turns.next(&due, Instant::now());
        let taken = shared.store.take(&lanes, LEASE).await;
        for message in taken.as_deref().unwrap_or_default() {
            if let Some(at) = lanes.iter().position(|lane| *lane == message.lane) {
                lanes.swap_remove(at);
            }
            let one = deliver_one(shared.clone(), sender.clone(), message.clone());
            self.lanes.insert(self.tasks.spawn(one).id(), message.lane.clone());
        }
        // Turns that found nothing, or nothing because the outbox could not be written.
        lanes.iter().for_each(|lane| self.turns.had_none(lane));
        taken.map(|_| ())
    }

    /// Takes back the places of all messages that are not under way any more.
    fn note_ended(&mut self) {
        while let Some(ended) = self.tasks.try_join_next_with_id() {
            self.note(ended);
        }
    }

    /// Waits until a message is not under way any more; for ever where none is.
    async fn one_ended(&mut self) {
        match self.tasks.join_next_with_id().await {
            Some(ended) => self.note(ended),
            None => std::future::pending().await,
        }
    }

    fn note(&mut self, ended: Result<(Id, bool), tokio::task::JoinError>) {
        let (id, reached) = match ended {
            Ok((id, reached)) => (id, reached),
            Err(error) => {
                tracing::error!(%error, "sending a webhook failed within the server");
                (error.id(), false)
            }
        };
        if let Some(lane) = self.lanes.remove(&id) {
            self.turns.ended(&lane, reached, Instant::now());
        }
    }
}

/// Sends one message and notes what came of it; whether the receiver was reached.
async fn deliver_one(shared: Arc<Shared>, sender: Arc<Sender>, due: DueMessage) -> bool {
    let sent = sender.send(&due.url, due.secret.as_deref(), &due.message).await;
    let (attempt, answer) = judge(&sent, due.attempts + 1);
    let outcome = match attempt {
        Attempt::Delivered => "delivered",
        Attempt::RetryIn(_) => "failed",
        Attempt::GivenUp => "given_up",
    };
    shared.metrics.count_webhook(outcome);
    tracing::debug!(job = %due.message.job, message = due.message.id, outcome, answer, "webhook");
    if attempt == Attempt::GivenUp {
        tracing::warn!(job = %due.message.job, message = due.message.id, answer, "webhook given up");
    }
    if let Err(error) = shared.store.sent(due.id, attempt, &answer).await {
        tracing::error!(%error, "cannot note what became of a webhook; it is sent again");
    }
    !matches!(sent, Sent::Failed(_))
}

/// Bounds what waits for receivers that do not come back.
async fn give_up_excess(shared: &Shared) {
    let most = shared.config.guard.max_webhooks_pending_each;
    match shared.store.give_up_excess(most).await {
        Ok(given_up) => {
            for (lane, messages) in given_up {
                let Lane { owner, host } = lane;
                tracing::warn!(
                    owner,
                    host,
                    messages,
                    most,
                    "too many webhooks wait; oldest given up"
                );
                shared.metrics.count_webhooks("over_limit", messages);
            }
        }
        Err(error) => tracing::error!(%error, "cannot bound the outbox"),
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
