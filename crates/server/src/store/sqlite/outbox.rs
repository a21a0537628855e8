//! The outbox in SQLite. A trigger of the tables fills it; see the migration.

use super::database::{ROWS_AT_ONCE, SqliteStore};
use super::rows;
use super::time::now_ms;
use crate::api::webhooks::{
    Delivery, DeliveryState, Ending, WebhookMessage, WebhookTarget, host_and_port,
};
use crate::store::StoreError;
use crate::store::outbox::{Attempt, DueMessage, LONGEST_WAIT, Lane, Outbox};
use async_trait::async_trait;
use sqlx::Row;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use std::time::Duration;
use uuid::Uuid;

/// Longest note about an answer.
const MAX_ANSWER_BYTES: usize = 300;
/// Messages over the bound that one write gives up; the next look gives up more.
const GIVEN_UP_AT_ONCE: i64 = 1000;

/// Remembers who is to be told of a job's end.
pub async fn register(
    connection: &mut SqliteConnection,
    job: Uuid,
    webhook: &WebhookTarget,
) -> Result<(), StoreError> {
    sqlx::query(
        "INSERT INTO job_webhooks (job_id, url, host, events, secret) VALUES (?, ?, ?, ?, ?)",
    )
    .bind(job.to_string())
    .bind(&webhook.url)
    .bind(receiver(&webhook.url))
    .bind(rows::to_json(&webhook.events))
    .bind(&webhook.secret)
    .execute(connection)
    .await?;
    Ok(())
}

/// Host and port of an address, for taking turns; nothing where it has none.
fn receiver(url: &str) -> String {
    host_and_port(url)
        .map_or_else(String::new, |(host, port)| format!("{}:{port}", host.to_ascii_lowercase()))
}

fn ending(row: &SqliteRow) -> Result<Ending, StoreError> {
    let state = rows::state(row.get("event"))?;
    Ending::ALL.into_iter().find(|ending| ending.state() == state).ok_or_else(|| {
        StoreError::Corrupt { what: "message".into(), reason: format!("{state:?} ends no job") }
    })
}

/// The same in every attempt, and different from the messages of other servers.
fn message_id(row: &SqliteRow) -> String {
    format!("{}.{}", row.get::<&str, _>("job_id"), row.get::<i64, _>("id"))
}

fn due_message(row: &SqliteRow) -> Result<DueMessage, StoreError> {
    let job = rows::parse_id(row.get("job_id"))?;
    Ok(DueMessage {
        id: row.get("id"),
        lane: Lane { owner: row.get("owner"), host: row.get("host") },
        message: WebhookMessage {
            id: message_id(row),
            event: ending(row)?,
            job,
            ended_at: rows::time(row.get("created_ms"))?,
            url: format!("/v1/jobs/{job}"),
        },
        url: row.get("url"),
        secret: row.get("secret"),
        attempts: row.get("attempts"),
    })
}

fn delivery(row: &SqliteRow) -> Result<Delivery, StoreError> {
    let time = |column| row.get::<Option<i64>, _>(column).map(rows::time).transpose();
    let (next_attempt_at, delivered_at) = (time("next_ms")?, time("delivered_ms")?);
    let state = match (&next_attempt_at, &delivered_at) {
        (_, Some(_)) => DeliveryState::Delivered,
        (Some(_), None) => DeliveryState::Pending,
        (None, None) => DeliveryState::GivenUp,
    };
    Ok(Delivery {
        id: message_id(row),
        event: ending(row)?,
        url: row.get("url"),
        state,
        attempts: row.get("attempts"),
        next_attempt_at,
        delivered_at,
        last_answer: row.get("last_answer"),
    })
}

fn milliseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)
}

/// A message that waits for a later time than this was put off while the clock was ahead, and is
/// due.
fn too_late() -> i64 {
    now_ms().saturating_add(milliseconds(LONGEST_WAIT))
}

#[async_trait]
impl Outbox for SqliteStore {
    async fn due_lanes(&self, each: u32) -> Result<Vec<Lane>, StoreError> {
        // By chance, so that none is left out for long where an owner has more than `each`.
        let found = sqlx::query(
            "SELECT owner, host FROM (
                 SELECT owner, host,
                        row_number() OVER (PARTITION BY owner ORDER BY random()) AS place
                 FROM webhook_lanes AS lane
                 WHERE EXISTS (SELECT 1 FROM outbox WHERE outbox.owner = lane.owner
                                 AND outbox.host = lane.host AND next_ms <= ?1)
                    OR EXISTS (SELECT 1 FROM outbox WHERE outbox.owner = lane.owner
                                 AND outbox.host = lane.host AND next_ms > ?3))
             WHERE place <= ?2",
        )
        .bind(now_ms())
        .bind(each)
        .bind(too_late())
        .fetch_all(&self.reader)
        .await?;
        Ok(found
            .iter()
            .map(|row| Lane { owner: row.get("owner"), host: row.get("host") })
            .collect())
    }

    async fn take(&self, lanes: &[Lane], lease: Duration) -> Result<Vec<DueMessage>, StoreError> {
        if lanes.is_empty() {
            return Ok(Vec::new());
        }
        let now = now_ms();
        let mut taken = Vec::with_capacity(lanes.len());
        let mut transaction = self.begin().await?;
        for lane in lanes {
            let row = sqlx::query(
                "UPDATE outbox SET next_ms = ?1 WHERE id = coalesce(
                     (SELECT id FROM outbox WHERE owner = ?3 AND host = ?4 AND next_ms <= ?2
                      ORDER BY next_ms, id LIMIT 1),
                     (SELECT id FROM outbox WHERE owner = ?3 AND host = ?4 AND next_ms > ?5
                      ORDER BY next_ms, id LIMIT 1))
                 RETURNING *",
            )
            .bind(now.saturating_add(milliseconds(lease)))
            .bind(now)
            .bind(&lane.owner)
            .bind(&lane.host)
            .bind(too_late())
            .fetch_optional(&mut *transaction)
            .await?;
            taken.extend(row.as_ref().map(due_message).transpose()?);
        }
        transaction.commit().await?;
        Ok(taken)
    }

    async fn give_up_excess(&self, most: u64) -> Result<Vec<(Lane, u64)>, StoreError> {
        let most = i64::try_from(most).unwrap_or(i64::MAX);
        // The lane in which most wait is the one that a bare column beside max() comes from.
        let found = sqlx::query(
            "SELECT owner, host, max(pending), sum(pending) - ? AS excess
             FROM webhook_lanes GROUP BY owner HAVING excess > 0",
        )
        .bind(most)
        .fetch_all(&self.reader)
        .await?;
        let mut given_up = Vec::new();
        for row in found {
            let lane = Lane { owner: row.get("owner"), host: row.get("host") };
            let done = sqlx::query(
                "UPDATE outbox SET next_ms = NULL, last_answer = ?4 WHERE id IN (
                     SELECT id FROM outbox
                     WHERE owner = ?1 AND host = ?2 AND next_ms IS NOT NULL
                     ORDER BY id LIMIT ?3)",
            )
            .bind(&lane.owner)
            .bind(&lane.host)
            .bind(row.get::<i64, _>("excess").min(GIVEN_UP_AT_ONCE))
            .bind(format!(
                "given up: over {most} messages waited (--max-webhooks-pending-each), most of them for this receiver"
            ))
            .execute(&self.writer)
            .await?;
            given_up.push((lane, done.rows_affected()));
        }
        Ok(given_up)
    }

    async fn sent(&self, id: i64, attempt: Attempt, answer: &str) -> Result<(), StoreError> {
        let now = now_ms();
        let (next, delivered) = match attempt {
            Attempt::Delivered => (None, Some(now)),
            Attempt::RetryIn(pause) => (Some(now.saturating_add(milliseconds(pause))), None),
            Attempt::GivenUp => (None, None),
        };
        let mut end = answer.len().min(MAX_ANSWER_BYTES);
        while !answer.is_char_boundary(end) {
            end -= 1;
        }
        sqlx::query(
            "UPDATE outbox SET attempts = attempts + 1, next_ms = ?, delivered_ms = ?,
                 last_answer = ? WHERE id = ?",
        )
        .bind(next)
        .bind(delivered)
        .bind(&answer[..end])
        .bind(id)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    async fn deliveries(&self, job: Uuid) -> Result<Vec<Delivery>, StoreError> {
        let found = sqlx::query("SELECT * FROM outbox WHERE job_id = ? ORDER BY id")
            .bind(job.to_string())
            .fetch_all(&self.reader)
            .await?;
        found.iter().map(delivery).collect()
    }

    async fn undelivered(&self) -> Result<u64, StoreError> {
        let row = sqlx::query("SELECT coalesce(sum(pending), 0) AS messages FROM webhook_lanes")
            .fetch_one(&self.reader)
            .await?;
        Ok(row.get::<i64, _>("messages").unsigned_abs())
    }

    async fn forget_messages(&self, age: Duration) -> Result<u64, StoreError> {
        let before = now_ms().saturating_sub(milliseconds(age));
        let mut forgotten = 0;
        loop {
            // A few in each write, so that whoever wants to write meanwhile waits for milliseconds.
            let done = sqlx::query(
                "DELETE FROM outbox WHERE id IN
                     (SELECT id FROM outbox INDEXED BY outbox_over
                      WHERE next_ms IS NULL AND created_ms < ? LIMIT ?)",
            )
            .bind(before)
            .bind(ROWS_AT_ONCE)
            .execute(&self.writer)
            .await?;
            forgotten += done.rows_affected();
            if done.rows_affected() < ROWS_AT_ONCE.into() {
                return Ok(forgotten);
            }
        }
    }
}
