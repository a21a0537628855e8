//! Expiry in SQLite.

use super::database::{ROWS_AT_ONCE, SqliteStore};
use super::time::now_ms;
use super::{life, rows, solutions};
use crate::store::StoreError;
use crate::store::retention::{Recorded, Retention};
use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Connection, Row};
use std::collections::BTreeSet;
use uuid::Uuid;

/// Hidden jobs that one call forgets.
const JOBS_AT_ONCE: u32 = 100;
/// A job that was hidden so far in the future was hidden by a clock that was wrong.
const CLOCK_WAS_AHEAD_MS: i64 = 3_600_000;

#[async_trait]
impl Retention for SqliteStore {
    async fn expired(&self, before: Timestamp, limit: u32) -> Result<Vec<Uuid>, StoreError> {
        let found = sqlx::query(
            "SELECT id FROM jobs
             WHERE finished_ms < ? AND pinned = 0 AND deleted_ms IS NULL
               AND state IN ('succeeded', 'failed', 'cancelled')
             ORDER BY finished_ms, id LIMIT ?",
        )
        .bind(before.as_millisecond())
        .bind(limit)
        .fetch_all(&self.reader)
        .await?;
        found.iter().map(|row| rows::parse_id(row.get("id"))).collect()
    }

    async fn hide_expired(&self, job: Uuid) -> Result<bool, StoreError> {
        let mut transaction = self.begin().await?;
        let may_go = rows::of_job(
            &mut *transaction,
            "SELECT 1 FROM jobs WHERE id = ? AND pinned = 0 AND deleted_ms IS NULL
               AND state IN ('succeeded', 'failed', 'cancelled')",
            job,
        )
        .await?
        .is_some();
        let is_gone = may_go && life::delete(&mut transaction, job).await?;
        transaction.commit().await?;
        Ok(is_gone)
    }

    async fn unused_scenes(
        &self,
        before: Timestamp,
        limit: u32,
    ) -> Result<Vec<String>, StoreError> {
        let found = sqlx::query(
            "SELECT id FROM scenes
             WHERE used_ms < ? AND NOT EXISTS (SELECT 1 FROM jobs WHERE scene_id = scenes.id)
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE environment_id = scenes.id)
             ORDER BY used_ms, id LIMIT ?",
        )
        .bind(before.as_millisecond())
        .bind(limit)
        .fetch_all(&self.reader)
        .await?;
        Ok(found.iter().map(|row| row.get("id")).collect())
    }

    async fn forget_scene(&self, scene: &str, before: Timestamp) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "DELETE FROM scenes WHERE id = ? AND used_ms < ?
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE scene_id = scenes.id)
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE environment_id = scenes.id)",
        )
        .bind(scene)
        .bind(before.as_millisecond())
        .execute(&self.writer)
        .await?;
        Ok(done.rows_affected() == 1)
    }

    async fn use_scene(&self, scene: &str) -> Result<bool, StoreError> {
        let done = sqlx::query("UPDATE scenes SET used_ms = max(used_ms, ?) WHERE id = ?")
            .bind(now_ms())
            .bind(scene)
            .execute(&self.writer)
            .await?;
        Ok(done.rows_affected() == 1)
    }

    async fn recorded_files(&self, job: Uuid) -> Result<Recorded, StoreError> {
        let mut reader = self.reader.acquire().await?;
        // One read transaction: an extension between two queries would look like an end.
        let mut reading = reader.begin().await?;
        let row = rows::of_job(
            &mut *reading,
            "SELECT state, deleted_ms IS NOT NULL AS hidden FROM jobs WHERE id = ?",
            job,
        )
        .await?;
        let Some(row) = row else { return Ok(Recorded::Unknown) };
        let names = file_names(&mut reading, job).await?;
        let has_ended =
            rows::state(row.get("state"))?.is_terminal() && !row.get::<bool, _>("hidden");
        Ok(if has_ended { Recorded::Ended(names) } else { Recorded::Open(names) })
    }
}

/// Names of all files of a job that its records name.
pub async fn file_names(
    connection: &mut SqliteConnection,
    job: Uuid,
) -> Result<BTreeSet<String>, StoreError> {
    let found = sqlx::query("SELECT DISTINCT sha256, format FROM pictures WHERE job_id = ?")
        .bind(job.to_string())
        .fetch_all(&mut *connection)
        .await?;
    let picture = |row: &SqliteRow| {
        format!("{}.{}", row.get::<&str, _>("sha256"), row.get::<&str, _>("format"))
    };
    let mut names: BTreeSet<_> = found.iter().map(picture).collect();
    if let Some(solution) = solutions::find(connection, job).await? {
        names.extend(solution.files().map(str::to_owned));
    }
    Ok(names)
}

/// Forgets the jobs that were hidden so long ago, a few at a time: their events and pictures first,
/// some in each write, so that whoever wants to write meanwhile waits for milliseconds.
pub async fn purge(store: &SqliteStore, older_than_ms: i64) -> Result<Vec<Uuid>, StoreError> {
    let now = now_ms();
    let found = sqlx::query(
        "SELECT id FROM jobs WHERE deleted_ms <= ?1 OR deleted_ms > ?2 ORDER BY deleted_ms LIMIT ?3",
    )
    .bind(now.saturating_sub(older_than_ms))
    // One that was hidden by a clock that was ahead is not kept until that time comes.
    .bind(now.saturating_add(CLOCK_WAS_AHEAD_MS))
    .bind(JOBS_AT_ONCE)
    .fetch_all(&store.reader)
    .await?;
    let mut gone = Vec::new();
    for row in found {
        let id: &str = row.get("id");
        for rows in [
            "DELETE FROM events WHERE job_id = ?1 AND seq IN
                 (SELECT seq FROM events WHERE job_id = ?1 LIMIT ?2)",
            "DELETE FROM pictures WHERE job_id = ?1 AND (format, seq) IN
                 (SELECT format, seq FROM pictures WHERE job_id = ?1 LIMIT ?2)",
        ] {
            loop {
                let delete = sqlx::query(rows).bind(id).bind(ROWS_AT_ONCE);
                let done = delete.execute(&store.writer).await?;
                if done.rows_affected() < ROWS_AT_ONCE.into() {
                    break;
                }
            }
        }
        sqlx::query("DELETE FROM jobs WHERE id = ?").bind(id).execute(&store.writer).await?;
        gone.push(rows::parse_id(id)?);
    }
    Ok(gone)
}
