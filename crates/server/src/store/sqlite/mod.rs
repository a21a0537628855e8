//! The embedded store: SQLite in WAL mode with one writing connection and a few reading ones.
//!
//! Every write is one `BEGIN IMMEDIATE` transaction on the writer, and every commit reaches the
//! disk before it returns (`synchronous = FULL`).

mod events;
mod jobs;
mod rows;
mod solutions;
#[cfg(test)]
mod tests;

use super::{Accepted, Claim, JobCounts, JobFilter, NewJob, Outcome, Report, Store, StoreError};
use crate::api::events::Event;
use crate::api::jobs::{Job, Picture, PictureFormat, Progress};
use crate::api::scenes::Scene;
use async_trait::async_trait;
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{Row, Sqlite, Transaction};
use std::path::Path;
use std::time::Duration;
use uuid::Uuid;

/// A SQLite database file.
pub struct SqliteStore {
    writer: SqlitePool,
    reader: SqlitePool,
    /// Names this process in leases.
    owner: String,
}

impl SqliteStore {
    /// Opens or creates the database and brings its tables up to date.
    ///
    /// # Errors
    /// [`StoreError`] where the file cannot be opened or is of a later version.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(Duration::from_secs(10));
        let writer = SqlitePoolOptions::new()
            .max_connections(1)
            .acquire_timeout(Duration::from_secs(30))
            .connect_with(options.clone())
            .await?;
        sqlx::migrate!("src/store/migrations").run(&writer).await?;
        let reader = SqlitePoolOptions::new()
            .max_connections(4)
            .acquire_timeout(Duration::from_secs(30))
            .connect_with(options.pragma("query_only", "on"))
            .await?;
        Ok(Self { writer, reader, owner: Uuid::new_v4().to_string() })
    }

    async fn begin(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }
}

/// Milliseconds since 1970.
fn now_ms() -> i64 {
    jiff::Timestamp::now().as_millisecond()
}

#[async_trait]
impl Store for SqliteStore {
    async fn put_scene(&self, scene: &Scene) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "INSERT INTO scenes (id, created_ms, record) VALUES (?, ?, ?) ON CONFLICT DO NOTHING",
        )
        .bind(&scene.id)
        .bind(scene.created_at.as_millisecond())
        .bind(rows::to_json(scene))
        .execute(&self.writer)
        .await?;
        Ok(done.rows_affected() == 1)
    }

    async fn scene(&self, id: &str) -> Result<Option<Scene>, StoreError> {
        let row = sqlx::query("SELECT record FROM scenes WHERE id = ?")
            .bind(id)
            .fetch_optional(&self.reader)
            .await?;
        row.map(|row| rows::from_json("scene", row.get("record"))).transpose()
    }

    async fn scenes(&self, before: Option<&str>, limit: u32) -> Result<Vec<Scene>, StoreError> {
        let found = sqlx::query(
            "SELECT record FROM scenes
             WHERE ?1 IS NULL OR (created_ms, id) < (SELECT created_ms, id FROM scenes WHERE id = ?1)
             ORDER BY created_ms DESC, id DESC LIMIT ?2",
        )
        .bind(before)
        .bind(limit)
        .fetch_all(&self.reader)
        .await?;
        found.iter().map(|row| rows::from_json("scene", row.get("record"))).collect()
    }

    async fn accept(&self, job: NewJob, max_queued: u64) -> Result<Accepted, StoreError> {
        let mut transaction = self.begin().await?;
        let accepted = jobs::accept(&mut transaction, job, max_queued).await?;
        transaction.commit().await?;
        Ok(accepted)
    }

    async fn job(&self, id: Uuid) -> Result<Option<Job>, StoreError> {
        jobs::get(&mut *self.reader.acquire().await?, id).await
    }

    async fn jobs(&self, filter: &JobFilter) -> Result<Vec<Job>, StoreError> {
        jobs::list(&self.reader, filter).await
    }

    async fn counts(&self) -> Result<JobCounts, StoreError> {
        jobs::counts(&self.reader).await
    }

    async fn cancel(&self, id: Uuid) -> Result<Option<Job>, StoreError> {
        let mut transaction = self.begin().await?;
        let job = jobs::cancel(&mut transaction, id).await?;
        transaction.commit().await?;
        Ok(job)
    }

    async fn delete(&self, id: Uuid) -> Result<bool, StoreError> {
        let mut transaction = self.begin().await?;
        let was_there = jobs::delete(&mut transaction, id).await?;
        transaction.commit().await?;
        Ok(was_there)
    }

    async fn purge(&self, older_than_ms: i64) -> Result<Vec<Uuid>, StoreError> {
        let rows = sqlx::query("DELETE FROM jobs WHERE deleted_ms <= ? RETURNING id")
            .bind(now_ms() - older_than_ms)
            .fetch_all(&self.writer)
            .await?;
        rows.iter().map(|row| rows::parse_id(row.get("id"))).collect()
    }

    async fn claim(&self, device: &str) -> Result<Option<(Claim, Job)>, StoreError> {
        // An idle worker asks often; the queue is looked at without the writer first.
        if !jobs::any_queued(&self.reader).await? {
            return Ok(None);
        }
        let mut transaction = self.begin().await?;
        let claimed = jobs::claim(&mut transaction, device, &self.owner).await?;
        transaction.commit().await?;
        Ok(claimed)
    }

    async fn report(&self, claim: Claim, report: Report) -> Result<bool, StoreError> {
        let mut writer = self.writer.acquire().await?;
        jobs::report(&mut writer, claim, report).await
    }

    async fn finish(&self, claim: Claim, outcome: Outcome) -> Result<(), StoreError> {
        let mut transaction = self.begin().await?;
        jobs::finish(&mut transaction, claim, outcome).await?;
        Ok(transaction.commit().await?)
    }

    async fn release(&self, claim: Claim, counted: bool, reason: &str) -> Result<(), StoreError> {
        let mut transaction = self.begin().await?;
        jobs::release(&mut transaction, claim, counted, reason).await?;
        Ok(transaction.commit().await?)
    }

    async fn release_all(&self) -> Result<u64, StoreError> {
        let mut transaction = self.begin().await?;
        let held = jobs::leased(&mut transaction, Some(&self.owner)).await?;
        for claim in &held {
            jobs::release(&mut transaction, *claim, false, "the server shut down").await?;
        }
        transaction.commit().await?;
        Ok(held.len() as u64)
    }

    async fn recover(&self) -> Result<Vec<Uuid>, StoreError> {
        let mut transaction = self.begin().await?;
        let orphans = jobs::leased(&mut transaction, None).await?;
        for claim in &orphans {
            jobs::release(&mut transaction, *claim, true, "its worker died").await?;
        }
        transaction.commit().await?;
        Ok(orphans.into_iter().map(|claim| claim.job).collect())
    }

    async fn events(&self, job: Uuid, after: u64, limit: u32) -> Result<Vec<Event>, StoreError> {
        events::after(&self.reader, job, after, limit).await
    }

    async fn trace(&self, job: Uuid) -> Result<Vec<Progress>, StoreError> {
        events::trace(&self.reader, job).await
    }

    async fn newest_picture(
        &self,
        job: Uuid,
        format: PictureFormat,
    ) -> Result<Option<Picture>, StoreError> {
        let row = sqlx::query(
            "SELECT record FROM pictures
             WHERE job_id = ? AND format = ?
               AND EXISTS (SELECT 1 FROM jobs WHERE id = job_id AND deleted_ms IS NULL)
             ORDER BY seq DESC LIMIT 1",
        )
        .bind(job.to_string())
        .bind(format.suffix())
        .fetch_optional(&self.reader)
        .await?;
        row.map(|row| rows::from_json("picture", row.get("record"))).transpose()
    }

    async fn picture(
        &self,
        job: Uuid,
        sha256: &str,
        format: PictureFormat,
    ) -> Result<Option<Picture>, StoreError> {
        let row = sqlx::query(
            "SELECT record FROM pictures
             WHERE job_id = ? AND format = ? AND sha256 = ?
               AND EXISTS (SELECT 1 FROM jobs WHERE id = job_id AND deleted_ms IS NULL) LIMIT 1",
        )
        .bind(job.to_string())
        .bind(format.suffix())
        .bind(sha256)
        .fetch_optional(&self.reader)
        .await?;
        row.map(|row| rows::from_json("picture", row.get("record"))).transpose()
    }

    async fn ping(&self) -> Result<(), StoreError> {
        sqlx::query("SELECT 1").fetch_one(&self.reader).await?;
        // Taking the write lock shows that the file is there and can be written.
        self.begin().await?.rollback().await?;
        Ok(())
    }

    async fn close(&self) {
        self.reader.close().await;
        self.writer.close().await;
    }
}
