//! Rows to records and back.

use super::time::now_ms;
use crate::api::Warning;
use crate::api::jobs::{Job, Picture, Progress, Stats, Timings};
use crate::job_state::JobState;
use crate::store::StoreError;
use jiff::Timestamp;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteExecutor};
use uuid::Uuid;

/// The row, if any, that a query finds whose one parameter is the id of a job.
pub async fn of_job(
    connection: impl SqliteExecutor<'_>,
    query: &'static str,
    job: Uuid,
) -> Result<Option<SqliteRow>, StoreError> {
    Ok(sqlx::query(query).bind(job.to_string()).fetch_optional(connection).await?)
}

/// The JSON text of a record. Records are plain data: writing them cannot fail.
pub fn to_json(record: &impl Serialize) -> String {
    serde_json::to_string(record).expect("API records serialise")
}

/// Reads a record back.
pub fn from_json<T: DeserializeOwned>(what: &str, json: &str) -> Result<T, StoreError> {
    serde_json::from_str(json)
        .map_err(|error| StoreError::Corrupt { what: what.into(), reason: error.to_string() })
}

fn optional<T: DeserializeOwned>(
    row: &SqliteRow,
    column: &'static str,
) -> Result<Option<T>, StoreError> {
    row.get::<Option<&str>, _>(column).map(|json| from_json(column, json)).transpose()
}

/// Reads an id back.
pub fn parse_id(id: &str) -> Result<Uuid, StoreError> {
    id.parse().map_err(|error: uuid::Error| StoreError::Corrupt {
        what: format!("id {id:?}"),
        reason: error.to_string(),
    })
}

/// Reads a time back.
pub fn time(ms: i64) -> Result<Timestamp, StoreError> {
    Timestamp::from_millisecond(ms).map_err(|error| StoreError::Corrupt {
        what: format!("time {ms}"),
        reason: error.to_string(),
    })
}

/// Reads a state back.
pub fn state(name: &str) -> Result<JobState, StoreError> {
    JobState::parse(name).ok_or_else(|| StoreError::Corrupt {
        what: "state".into(),
        reason: format!("no state {name:?}"),
    })
}

/// Reads a whole row of `jobs`.
pub fn job(row: &SqliteRow) -> Result<Job, StoreError> {
    let created_ms: i64 = row.get("created_ms");
    let started_ms: Option<i64> = row.get("started_ms");
    let finished_ms: Option<i64> = row.get("finished_ms");
    let state = state(row.get("state"))?;
    let progress: Option<Progress> = optional(row, "progress")?;
    let stats: Option<Stats> = optional(row, "stats")?;
    let figures = progress.as_ref().map(|progress| progress.figures).unwrap_or_default();
    let warnings: Vec<Warning> = from_json("warnings", row.get("warnings"))?;
    let result: Option<Vec<Picture>> = optional(row, "result")?;
    Ok(Job {
        id: parse_id(row.get("id"))?,
        state,
        scene: row.get("scene_id"),
        scene_name: row.get("scene_name"),
        request: from_json("request", row.get("request"))?,
        created_at: time(created_ms)?,
        started_at: started_ms.map(time).transpose()?,
        finished_at: finished_ms.map(time).transpose()?,
        pinned: row.get("pinned"),
        bytes: row.get::<i64, _>("bytes").unsigned_abs(),
        attempts: row.get("attempts"),
        interruptions: row.get("interruptions"),
        cancel_requested: row.get("cancel_requested"),
        device: row.get("device"),
        figures,
        progress,
        plan: optional(row, "plan")?,
        warnings,
        stats,
        error: optional(row, "error")?,
        result,
        result_of: row.get::<Option<&str>, _>("result_of").map(parse_id).transpose()?,
        timings: timings(created_ms, started_ms, finished_ms),
    })
}

fn timings(created_ms: i64, started_ms: Option<i64>, finished_ms: Option<i64>) -> Timings {
    let end = finished_ms.unwrap_or_else(now_ms);
    let seconds = |from: i64, to: i64| (to - from).max(0) as f64 / 1e3;
    Timings {
        queued_s: seconds(created_ms, started_ms.unwrap_or(end)),
        running_s: started_ms.map_or(0.0, |started| seconds(started, end)),
        total_s: seconds(created_ms, end),
    }
}
