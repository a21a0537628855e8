//! What a SQLite store knows of itself.

use super::database::SqliteStore;
use super::{rows, tables};
use crate::store::StoreError;
use crate::store::meta::Meta;
use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::Row;
use uuid::Uuid;

#[async_trait]
impl Meta for SqliteStore {
    async fn store_id(&self) -> Result<Uuid, StoreError> {
        tables::store_id(&mut *self.reader.acquire().await?).await
    }

    async fn is_blank(&self) -> Result<bool, StoreError> {
        let row = sqlx::query(
            "SELECT NOT EXISTS (SELECT 1 FROM jobs) AND NOT EXISTS (SELECT 1 FROM scenes) AS blank",
        )
        .fetch_one(&self.reader)
        .await?;
        Ok(row.get("blank"))
    }

    async fn newest_record(&self) -> Result<Option<Timestamp>, StoreError> {
        // Ids sort by age, and the ends of jobs have an index.
        let row = sqlx::query(
            "SELECT max(
                 coalesce((SELECT created_ms FROM jobs ORDER BY id DESC LIMIT 1), 0),
                 coalesce((SELECT max(finished_ms) FROM jobs WHERE finished_ms IS NOT NULL
                           AND pinned = 0 AND deleted_ms IS NULL), 0)) AS newest",
        )
        .fetch_one(&self.reader)
        .await?;
        let newest: i64 = row.get("newest");
        (newest > 0).then(|| rows::time(newest)).transpose()
    }

    async fn fact(&self, name: &str) -> Result<Option<String>, StoreError> {
        tables::fact(&mut *self.reader.acquire().await?, name).await
    }

    async fn keep_fact(&self, name: &str, value: &str) -> Result<(), StoreError> {
        sqlx::query(
            "INSERT INTO meta (key, value) VALUES (?, ?)
             ON CONFLICT (key) DO UPDATE SET value = excluded.value",
        )
        .bind(name)
        .bind(value)
        .execute(&self.writer)
        .await?;
        Ok(())
    }
}
