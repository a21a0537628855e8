//! Those under whose name jobs count, and what counts for them.

use crate::store::StoreError;
use sqlx::Row;
use sqlx::sqlite::SqliteConnection;
use uuid::Uuid;

/// Under which name a job counts.
pub async fn of_job(connection: &mut SqliteConnection, job: Uuid) -> Result<String, StoreError> {
    let row = sqlx::query("SELECT billed_to FROM jobs WHERE id = ?")
        .bind(job.to_string())
        .fetch_one(connection)
        .await?;
    Ok(row.get("billed_to"))
}

/// Whether as many jobs under that name wait as may.
pub async fn own_queue_is_full(
    connection: &mut SqliteConnection,
    billed_to: &str,
    most: Option<u64>,
) -> Result<bool, StoreError> {
    let Some(most) = most else { return Ok(false) };
    let row = sqlx::query(
        "SELECT count(*) AS waiting FROM jobs
         WHERE billed_to = ? AND state = 'queued' AND deleted_ms IS NULL",
    )
    .bind(billed_to)
    .fetch_one(connection)
    .await?;
    Ok(row.get::<i64, _>("waiting").unsigned_abs() >= most)
}

/// Bytes of pictures and solutions of a payer's jobs.
pub async fn stored_bytes(
    connection: &mut SqliteConnection,
    billed_to: &str,
) -> Result<u64, StoreError> {
    let row = sqlx::query("SELECT bytes FROM payers WHERE billed_to = ?")
        .bind(billed_to)
        .fetch_optional(connection)
        .await?;
    Ok(row.map_or(0, |row| row.get::<i64, _>("bytes").unsigned_abs()))
}
