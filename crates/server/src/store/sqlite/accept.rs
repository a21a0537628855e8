//! How a job comes into the queue. Callers hold the transaction; nothing here commits.

use super::jobs::{expect, waiting};
use super::time::now_ms;
use super::{claims, events, outbox, payers, rows, scenes};
use crate::job_state::Life;
use crate::store::{Accepted, NewJob, StoreError, Submitter};
use sqlx::Row;
use sqlx::sqlite::SqliteConnection;

/// Queues a job, or finds the one that the same key made.
pub async fn accept(
    connection: &mut SqliteConnection,
    job: NewJob,
    max_queued: u64,
) -> Result<Accepted, StoreError> {
    if let Some(key) = &job.idempotency_key {
        let before = sqlx::query(
            "SELECT id, request_hash FROM jobs
             WHERE owner = ? AND idempotency_key = ? AND deleted_ms IS NULL",
        )
        .bind(&job.submitter.owner)
        .bind(key)
        .fetch_optional(&mut *connection)
        .await?;
        if let Some(row) = before {
            if !job.request_hash.matches(row.get("request_hash")) {
                return Ok(Accepted::KeyConflict);
            }
            let id = rows::parse_id(row.get("id"))?;
            return Ok(Accepted::Again(Box::new(expect(connection, id).await?)));
        }
    }
    if let Some(refused) = refusal(connection, &job, max_queued).await? {
        return Ok(refused);
    }
    insert(connection, &job).await?;
    claims::join(connection, &job.submitter.billed_to).await?;
    events::append_state(connection, job.id, Life::NEW, None, None).await?;
    Ok(Accepted::New(Box::new(expect(connection, job.id).await?)))
}

/// Why a job is not queued, if so; its scene, and the map of its sky, count as used.
async fn refusal(
    connection: &mut SqliteConnection,
    job: &NewJob,
    max_queued: u64,
) -> Result<Option<Accepted>, StoreError> {
    if waiting(connection).await? >= max_queued {
        return Ok(Some(Accepted::QueueFull));
    }
    let Submitter { billed_to, max_queued: most, max_stored, .. } = &job.submitter;
    if payers::own_queue_is_full(connection, billed_to, *most).await? {
        return Ok(Some(Accepted::OwnQueueFull));
    }
    if let Some(most) = max_stored {
        let stored = payers::stored_bytes(connection, billed_to).await?;
        if stored >= *most {
            return Ok(Some(Accepted::StoreFull { stored }));
        }
    }
    if !is_used(connection, &job.scene_id).await? {
        return Ok(Some(Accepted::SceneGone));
    }
    match job.request.environment_map() {
        Some(map) if !is_used(connection, map).await? => Ok(Some(Accepted::EnvironmentGone)),
        _ => Ok(None),
    }
}

/// Notes that a scene or a map of a sky is wanted now; false where it is not there any more.
async fn is_used(connection: &mut SqliteConnection, id: &str) -> Result<bool, StoreError> {
    let done = sqlx::query("UPDATE scenes SET used_ms = max(used_ms, ?) WHERE id = ?")
        .bind(now_ms())
        .bind(id)
        .execute(connection)
        .await?;
    Ok(done.rows_affected() == 1)
}

async fn insert(connection: &mut SqliteConnection, job: &NewJob) -> Result<(), StoreError> {
    let quota = |most: Option<u64>| most.map(|most| i64::try_from(most).unwrap_or(i64::MAX));
    sqlx::query(
        "INSERT INTO jobs (id, scene_id, state, priority, created_ms, idempotency_key,
                           request_hash, request, owner, billed_to, max_running, trace_parent,
                           render_key, max_stored, scene_name, environment_id, place)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?,
                 (SELECT coalesce(max(place), 0) + 1 FROM jobs))",
    )
    .bind(job.id.to_string())
    .bind(&job.scene_id)
    .bind(Life::NEW.state.as_str())
    .bind(job.request.priority)
    .bind(now_ms())
    .bind(&job.idempotency_key)
    .bind(&job.request_hash.now)
    .bind(rows::to_json(&job.request))
    .bind(&job.submitter.owner)
    .bind(&job.submitter.billed_to)
    .bind(quota(job.submitter.max_running))
    .bind(&job.submitter.trace_parent)
    .bind(&job.render_key)
    .bind(quota(job.submitter.max_stored))
    .bind(scenes::name_for(connection, &job.scene_id, &job.submitter.billed_to).await?)
    .bind(job.request.environment_map())
    .execute(&mut *connection)
    .await?;
    if let Some(webhook) = &job.submitter.webhook {
        outbox::register(connection, job.id, webhook).await?;
    }
    for (key, value) in &job.request.labels {
        sqlx::query("INSERT INTO job_labels (job_id, key, value) VALUES (?, ?, ?)")
            .bind(job.id.to_string())
            .bind(key)
            .bind(value)
            .execute(&mut *connection)
            .await?;
    }
    Ok(())
}
