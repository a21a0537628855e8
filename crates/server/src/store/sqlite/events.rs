//! The event log of each job.

use super::time::now_ms;
use super::{jobs, rows};
use crate::api::events::{Event, EventData, ProgressEvent, StateEvent};
use crate::api::jobs::{JobError, Picture, Progress};
use crate::job_state::Life;
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

/// Records pictures under the event that names them.
pub async fn add_pictures(
    connection: &mut SqliteConnection,
    job: Uuid,
    seq: i64,
    pictures: &[Picture],
) -> Result<(), StoreError> {
    for picture in pictures {
        sqlx::query(
            "INSERT INTO pictures (job_id, seq, sha256, format, record) VALUES (?, ?, ?, ?, ?)",
        )
        .bind(job.to_string())
        .bind(seq)
        .bind(&picture.sha256)
        .bind(picture.format.suffix())
        .bind(rows::to_json(picture))
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}

/// Appends the event of a job's new state.
pub async fn append_state(
    connection: &mut SqliteConnection,
    id: Uuid,
    life: Life,
    reason: Option<String>,
    error: Option<JobError>,
) -> Result<(), StoreError> {
    // An extension that ends without a picture leaves the earlier result, which is then the newest
    // picture again, whatever snapshots came after it.
    let result = match life.state.is_terminal() {
        true => jobs::get(connection, id).await?.and_then(|job| job.result).unwrap_or_default(),
        false => Vec::new(),
    };
    let event = EventData::State(StateEvent {
        state: life.state,
        attempts: life.attempts,
        reason,
        pictures: result.clone(),
        error,
    });
    let seq = append(connection, id, &event).await?;
    add_pictures(connection, id, seq, &result).await
}
