//! Expiry in SQLite.

use super::{SqliteStore, now_ms, rows};
use crate::store::StoreError;
use crate::store::retention::Retention;
use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::Row;
use std::collections::BTreeSet;
use uuid::Uuid;

#[async_trait]
impl Retention for SqliteStore {
    async fn pin(&self, job: Uuid, pinned: bool) -> Result<bool, StoreError> {
        let done = sqlx::query("UPDATE jobs SET pinned = ? WHERE id = ? AND deleted_ms IS NULL")
            .bind(pinned)
            .bind(job.to_string())
            .execute(&self.writer)
            .await?;
        Ok(done.rows_affected() == 1)
    }

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

    async fn stored_bytes(&self) -> Result<u64, StoreError> {
        let row = sqlx::query(
            "SELECT (SELECT coalesce(sum(json_extract(record, '$.size')), 0) FROM scenes)
                  + (SELECT coalesce(sum(json_extract(record, '$.size')), 0) FROM pictures
                     WHERE EXISTS (SELECT 1 FROM jobs WHERE id = job_id AND deleted_ms IS NULL))
                 AS bytes",
        )
        .fetch_one(&self.reader)
        .await?;
        Ok(row.get::<i64, _>("bytes").unsigned_abs())
    }

    async fn unused_scenes(
        &self,
        before: Timestamp,
        limit: u32,
    ) -> Result<Vec<String>, StoreError> {
        let found = sqlx::query(
            "SELECT id FROM scenes
             WHERE used_ms < ? AND NOT EXISTS (SELECT 1 FROM jobs WHERE scene_id = scenes.id)
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
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE scene_id = scenes.id)",
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

    async fn knows_job(&self, job: Uuid) -> Result<bool, StoreError> {
        let row = sqlx::query("SELECT EXISTS (SELECT 1 FROM jobs WHERE id = ?) AS known")
            .bind(job.to_string())
            .fetch_one(&self.reader)
            .await?;
        Ok(row.get("known"))
    }

    async fn picture_hashes(&self, job: Uuid) -> Result<BTreeSet<String>, StoreError> {
        let found = sqlx::query("SELECT DISTINCT sha256 FROM pictures WHERE job_id = ?")
            .bind(job.to_string())
            .fetch_all(&self.reader)
            .await?;
        Ok(found.iter().map(|row| row.get("sha256")).collect())
    }
}
