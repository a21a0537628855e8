//! The outbox in SQLite. A trigger of the tables fills it; see the migration.

use super::{SqliteStore, now_ms, rows};
use crate::api::webhooks::{Delivery, DeliveryState, Ending, WebhookMessage, WebhookTarget};
use crate::store::StoreError;
use crate::store::outbox::{Attempt, DueMessage, Outbox};
use async_trait::async_trait;
use sqlx::Row;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use std::time::Duration;
use uuid::Uuid;

/// Longest note about an answer.
const MAX_ANSWER_BYTES: usize = 300;

/// Remembers who is to be told of a job's end.
pub async fn register(
    connection: &mut SqliteConnection,
    job: Uuid,
    webhook: &WebhookTarget,
) -> Result<(), StoreError> {
    sqlx::query("INSERT INTO job_webhooks (job_id, url, events, secret) VALUES (?, ?, ?, ?)")
        .bind(job.to_string())
        .bind(&webhook.url)
        .bind(rows::to_json(&webhook.events))
        .bind(&webhook.secret)
        .execute(connection)
        .await?;
    Ok(())
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

#[async_trait]
impl Outbox for SqliteStore {
    async fn due(&self, limit: u32, lease: Duration) -> Result<Vec<DueMessage>, StoreError> {
        // Looks without the writer first: mostly there is nothing.
        let now = now_ms();
        let any = sqlx::query("SELECT EXISTS (SELECT 1 FROM outbox WHERE next_ms <= ?) AS due")
            .bind(now)
            .fetch_one(&self.reader)
            .await?;
        if !any.get::<bool, _>("due") {
            return Ok(Vec::new());
        }
        let found = sqlx::query(
            "UPDATE outbox SET next_ms = ?1 WHERE id IN (
                 SELECT id FROM outbox WHERE next_ms <= ?2 ORDER BY next_ms, id LIMIT ?3)
             RETURNING *",
        )
        .bind(now.saturating_add(milliseconds(lease)))
        .bind(now)
        .bind(limit)
        .fetch_all(&self.writer)
        .await?;
        found.iter().map(due_message).collect()
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
        let row = sqlx::query("SELECT count(*) AS messages FROM outbox WHERE next_ms IS NOT NULL")
            .fetch_one(&self.reader)
            .await?;
        Ok(row.get::<i64, _>("messages").unsigned_abs())
    }

    async fn forget_messages(&self, age: Duration) -> Result<u64, StoreError> {
        let done = sqlx::query("DELETE FROM outbox WHERE next_ms IS NULL AND created_ms < ?")
            .bind(now_ms().saturating_sub(milliseconds(age)))
            .execute(&self.writer)
            .await?;
        Ok(done.rows_affected())
    }
}
