//! The embedded store: SQLite in WAL mode with one writing connection, one for leases and a few
//! reading ones.
//!
//! Every write is one `BEGIN IMMEDIATE` transaction, and every commit reaches the
//! disk before it returns (`synchronous = FULL`).

mod bytes;
mod claims;
mod events;
mod jobs;
mod keys;
pub mod meta;
mod outbox;
mod retention;
mod rows;
mod scenes;
pub mod snapshot;
mod solutions;
#[cfg(test)]
pub(crate) mod tests;

use super::{
    Accepted, Asking, Claim, JobCounts, JobFilter, Lease, NewJob, Outcome, Report, Store,
    StoreError,
};
use crate::api::events::Event;
use crate::api::jobs::{Job, Picture, PictureFormat, Progress};
use crate::api::scenes::Scene;
use crate::failpoints;
use crate::job_state::{Cause, Event as JobEvent};
use async_trait::async_trait;
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{Connection, Row, Sqlite, Transaction};
use std::path::Path;
use std::time::Duration;
use uuid::Uuid;

/// A SQLite database file.
pub struct SqliteStore {
    writer: SqlitePool,
    reader: SqlitePool,
    /// Leases have a connection of their own: one that a starved runtime has not yet handed back
    /// must not keep them from being renewed.
    leases: SqlitePool,
    /// Names this process in leases.
    owner: String,
}

impl SqliteStore {
    /// Opens or creates the database and brings its tables up to date.
    ///
    /// # Errors
    /// [`StoreError`] where the file cannot be opened or is of a later version.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let options = Self::options(path).create_if_missing(true);
        let writer = Self::writer(&options).await?;
        meta::MIGRATIONS.run(&writer).await?;
        meta::ensure_id(&writer).await?;
        Self::with(writer, options).await
    }

    /// Opens a database that is there, as it is: for commands beside a running server, under which
    /// the tables must not change.
    ///
    /// # Errors
    /// [`StoreError`] where there is none, or its tables are those of another version.
    pub async fn open_as_it_is(path: &Path) -> Result<Self, StoreError> {
        let options = Self::options(path);
        let writer = Self::writer(&options).await?;
        meta::check_version(&mut *writer.acquire().await?).await?;
        Self::with(writer, options).await
    }

    fn options(path: &Path) -> SqliteConnectOptions {
        SqliteConnectOptions::new()
            .filename(path)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(Duration::from_secs(10))
    }

    async fn writer(options: &SqliteConnectOptions) -> Result<SqlitePool, StoreError> {
        let pool = pool().max_connections(1).acquire_timeout(Duration::from_secs(30));
        Ok(pool.connect_with(options.clone()).await?)
    }

    async fn with(writer: SqlitePool, options: SqliteConnectOptions) -> Result<Self, StoreError> {
        let leases = pool()
            .max_connections(1)
            .acquire_timeout(Duration::from_secs(10))
            .connect_lazy_with(options.clone());
        let reader = pool()
            .max_connections(4)
            .acquire_timeout(Duration::from_secs(30))
            .connect_with(options.pragma("query_only", "on"))
            .await?;
        Ok(Self { writer, reader, leases, owner: Uuid::new_v4().to_string() })
    }

    async fn begin(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }
}

/// A pool whose connections are sound. Where the disk is full or fails, SQLite ends a transaction
/// by itself, which sqlx does not learn of: it would refuse to begin another one on that connection
/// forever.
fn pool() -> SqlitePoolOptions {
    SqlitePoolOptions::new().before_acquire(|connection, _| {
        let is_sound = !connection.is_in_transaction();
        Box::pin(async move { Ok(is_sound) })
    })
}

/// What an error of SQLite means for whoever runs the server, and what they can do.
pub fn diagnose(error: &sqlx::Error) -> Option<(&'static str, &'static str)> {
    let code = error.as_database_error()?.code()?.parse::<u32>().ok()?;
    // The primary codes of https://sqlite.org/rescode.html, the lowest byte.
    Some(match code & 0xff {
        3 | 14 => ("its file cannot be opened", "check the permissions of the data folder"),
        8 => ("its file cannot be written", "make the data folder writable for the server"),
        10 => ("the disk does not read or write", "check the disk and the space left on it"),
        11 => ("its file is damaged", "stop the server and restore the file from a backup"),
        13 => ("the disk is full", "free space under the data folder"),
        26 => ("its file is not a database", "stop the server and restore the file from a backup"),
        _ => return None,
    })
}

/// Milliseconds since 1970 by the wall clock. For people and for sorting: it jumps, so nothing
/// that a promise hangs on is decided by it.
fn now_ms() -> i64 {
    let now = crate::clock::now().as_millisecond();
    #[cfg(test)]
    let now = now + CLOCK_JUMP_MS.get();
    now
}

#[cfg(test)]
thread_local! {
    /// How far the wall clock of this test has jumped.
    static CLOCK_JUMP_MS: std::cell::Cell<i64> = const { std::cell::Cell::new(0) };
}

/// Where a test may make the store fail or die.
fn failpoint(point: &'static str, about: impl std::fmt::Debug) -> Result<(), StoreError> {
    failpoints::pass(point, || format!("{about:?}"))
        .map_err(|injected| StoreError::Database(sqlx::Error::Io(std::io::Error::other(injected))))
}

#[async_trait]
impl Store for SqliteStore {
    async fn put_scene(&self, scene: &Scene) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "INSERT INTO scenes (id, created_ms, record, used_ms) VALUES (?, ?, ?, ?)
             ON CONFLICT DO NOTHING",
        )
        .bind(&scene.id)
        .bind(scene.created_at.as_millisecond())
        .bind(rows::to_json(scene))
        .bind(now_ms())
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

    async fn accept(&self, job: NewJob, max_queued: u64) -> Result<Accepted, StoreError> {
        let id = job.id;
        let mut transaction = self.begin().await?;
        let accepted = jobs::accept(&mut transaction, job, max_queued).await?;
        failpoint("create", id)?;
        transaction.commit().await?;
        failpoint("created", id)?;
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
        retention::purge(self, older_than_ms).await
    }

    async fn claim(&self, asking: &Asking<'_>) -> Result<Option<(Claim, Job)>, StoreError> {
        // An idle worker asks often; the queue is looked at without the writer first.
        if !jobs::any_queued(&self.reader).await? {
            return Ok(None);
        }
        let mut transaction = self.begin().await?;
        let claimed = jobs::claim(&mut transaction, asking, &self.owner).await?;
        failpoint("claim", &claimed)?;
        transaction.commit().await?;
        failpoint("claimed", &claimed)?;
        Ok(claimed)
    }

    async fn report(&self, claim: Claim, report: Report) -> Result<bool, StoreError> {
        failpoint("report", claim)?;
        let mut writer = self.writer.acquire().await?;
        jobs::report(&mut writer, claim, report).await
    }

    async fn finish(&self, claim: Claim, outcome: Outcome) -> Result<(), StoreError> {
        let mut transaction = self.begin().await?;
        jobs::finish(&mut transaction, claim, outcome).await?;
        failpoint("finish", claim)?;
        transaction.commit().await?;
        failpoint("finished", claim)
    }

    async fn release(&self, claim: Claim, cause: Cause, reason: &str) -> Result<(), StoreError> {
        failpoint("release", claim)?;
        let mut transaction = self.begin().await?;
        let event = JobEvent::Release { fence: claim.fence, cause };
        jobs::release(&mut transaction, claim, event, reason).await?;
        Ok(transaction.commit().await?)
    }

    async fn release_all(&self) -> Result<u64, StoreError> {
        let mut transaction = self.begin().await?;
        let mut released = 0;
        for lease in jobs::leases(&mut transaction).await? {
            if lease.owner == self.owner {
                let cause = Cause::Circumstances;
                let event = JobEvent::Release { fence: lease.claim.fence, cause };
                let reason = "the server shut down";
                jobs::release(&mut transaction, lease.claim, event, reason).await?;
                released += 1;
            }
        }
        transaction.commit().await?;
        Ok(released)
    }

    async fn recover(&self) -> Result<Vec<Uuid>, StoreError> {
        let mut transaction = self.begin().await?;
        let mut recovered = Vec::new();
        for lease in jobs::leases(&mut transaction).await? {
            if lease.owner != self.owner {
                let event = JobEvent::ServerDied { fence: lease.claim.fence };
                jobs::release(&mut transaction, lease.claim, event, "the server died").await?;
                recovered.push(lease.claim.job);
            }
        }
        transaction.commit().await?;
        Ok(recovered)
    }

    async fn renew(&self, claims: &[Claim]) -> Result<Vec<Claim>, StoreError> {
        let mut lost = Vec::new();
        if claims.is_empty() {
            return Ok(lost);
        }
        let mut transaction = self.leases.begin_with("BEGIN IMMEDIATE").await?;
        for claim in claims {
            if !jobs::renew(&mut transaction, *claim).await? {
                lost.push(*claim);
            }
        }
        transaction.commit().await?;
        Ok(lost)
    }

    async fn leases(&self) -> Result<Vec<Lease>, StoreError> {
        jobs::leases(&mut *self.leases.acquire().await?).await
    }

    async fn expire(&self, lease: &Lease, reason: &str) -> Result<bool, StoreError> {
        let mut transaction = self.leases.begin_with("BEGIN IMMEDIATE").await?;
        if !jobs::leases(&mut transaction).await?.contains(lease) {
            return Ok(false);
        }
        let event = JobEvent::LeaseExpired { fence: lease.claim.fence };
        jobs::release(&mut transaction, lease.claim, event, reason).await?;
        transaction.commit().await?;
        Ok(true)
    }

    async fn twin(&self, claim: Claim) -> Result<Option<Job>, StoreError> {
        let row = sqlx::query(
            "SELECT twin.* FROM jobs AS own JOIN jobs AS twin ON twin.render_key = own.render_key
             WHERE own.id = ?1 AND twin.id <> ?1 AND twin.state = 'succeeded'
               AND twin.deleted_ms IS NULL ORDER BY twin.id DESC LIMIT 1",
        )
        .bind(claim.job.to_string())
        .fetch_optional(&self.reader)
        .await?;
        row.as_ref().map(rows::job).transpose()
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
        self.leases.close().await;
        self.reader.close().await;
        self.writer.close().await;
    }
}
