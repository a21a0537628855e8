//! The event log of each job.

use super::{now_ms, rows};
use crate::api::events::{Event, EventData, ProgressEvent};
use crate::api::jobs::Progress;
use crate::store::{MAX_PROGRESS_EVENTS, StoreError};
use sqlx::Row;
use sqlx::sqlite::{SqliteConnection, SqlitePool};
use uuid::Uuid;

/// Adds an event; its number.
pub async fn append(
    connection: &mut SqliteConnection,
    job: Uuid,
    data: &EventData,
) -> Result<i64, StoreError> {
    let row =
        sqlx::query("UPDATE jobs SET last_seq = last_seq + 1 WHERE id = ? RETURNING last_seq")
            .bind(job.to_string())
            .fetch_one(&mut *connection)
            .await?;
    let seq: i64 = row.get("last_seq");
    sqlx::query("INSERT INTO events (job_id, seq, kind, at_ms, data) VALUES (?, ?, ?, ?, ?)")
        .bind(job.to_string())
        .bind(seq)
        .bind(data.kind())
        .bind(now_ms())
        .bind(rows::to_json(data))
        .execute(&mut *connection)
        .await?;
    Ok(seq)
}

/// Keeps the number of progress events bounded: thins the older half, so that a long job's trace
/// stays dense where it is new and reaches back to its start.
pub async fn thin(connection: &mut SqliteConnection, job: Uuid) -> Result<(), StoreError> {
    let row =
        sqlx::query("SELECT count(*) AS kept FROM events WHERE job_id = ? AND kind = 'progress'")
            .bind(job.to_string())
            .fetch_one(&mut *connection)
            .await?;
    if row.get::<i64, _>("kept") <= MAX_PROGRESS_EVENTS {
        return Ok(());
    }
    sqlx::query(
        "DELETE FROM events WHERE job_id = ?1 AND seq IN (
             SELECT seq FROM (
                 SELECT seq, row_number() OVER (ORDER BY seq) AS position FROM events
                 WHERE job_id = ?1 AND kind = 'progress'
             ) WHERE position <= ?2 AND position % 2 = 0)",
    )
    .bind(job.to_string())
    .bind(MAX_PROGRESS_EVENTS / 2)
    .execute(connection)
    .await?;
    Ok(())
}

/// Events with numbers above `after`, oldest first.
pub async fn after(
    pool: &SqlitePool,
    job: Uuid,
    after: u64,
    limit: u32,
) -> Result<Vec<Event>, StoreError> {
    let found = sqlx::query(
        "SELECT seq, kind, at_ms, data FROM events WHERE job_id = ? AND seq > ?
         ORDER BY seq LIMIT ?",
    )
    .bind(job.to_string())
    .bind(i64::try_from(after).unwrap_or(i64::MAX))
    .bind(limit)
    .fetch_all(pool)
    .await?;
    found
        .iter()
        .map(|row| {
            let data =
                EventData::from_stored(row.get("kind"), row.get("data")).map_err(|error| {
                    StoreError::Corrupt { what: "event".into(), reason: error.to_string() }
                })?;
            Ok(Event {
                seq: row.get::<i64, _>("seq").unsigned_abs(),
                at: rows::time(row.get("at_ms"))?,
                data,
            })
        })
        .collect()
}

/// Progress of the latest claim, oldest first.
pub async fn trace(pool: &SqlitePool, job: Uuid) -> Result<Vec<Progress>, StoreError> {
    let found =
        sqlx::query("SELECT data FROM events WHERE job_id = ? AND kind = 'progress' ORDER BY seq")
            .bind(job.to_string())
            .fetch_all(pool)
            .await?;
    let events: Vec<ProgressEvent> = found
        .iter()
        .map(|row| rows::from_json("event", row.get("data")))
        .collect::<Result<_, _>>()?;
    let latest = events.last().map(|event| event.fence);
    Ok(events.into_iter().filter(|e| Some(e.fence) == latest).map(|e| e.progress).collect())
}
