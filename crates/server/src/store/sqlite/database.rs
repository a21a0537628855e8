//! The database: a file, and the connections to it.

use super::tables;
use crate::store::StoreError;
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{Connection, Sqlite, Transaction};
use std::path::Path;
use std::time::Duration;
use uuid::Uuid;

/// Rows that one write removes, so that whoever wants to write meanwhile waits for milliseconds.
pub const ROWS_AT_ONCE: u32 = 500;

/// A SQLite database file.
pub struct SqliteStore {
    /// The one connection that writes.
    pub(super) writer: SqlitePool,
    /// Connections that read.
    pub(super) reader: SqlitePool,
    /// Leases have a connection of their own: one that a starved runtime has not yet handed back
    /// must not keep them from being renewed.
    pub(super) leases: SqlitePool,
    /// Names this process in leases.
    pub(super) owner: String,
}

impl SqliteStore {
    /// Opens or creates the database and brings its tables up to date.
    ///
    /// # Errors
    /// [`StoreError`] where the file cannot be opened or is of a later version.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let options = Self::options(path).create_if_missing(true);
        let writer = Self::writer(&options).await?;
        tables::MIGRATIONS.run(&writer).await?;
        tables::ensure_id(&writer).await?;
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
        tables::check_version(&mut *writer.acquire().await?).await?;
        Self::with(writer, options).await
    }

    pub(super) fn options(path: &Path) -> SqliteConnectOptions {
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

    /// Begins a write.
    pub(super) async fn begin(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }

    /// Writes the log of what was written back into the database and empties it; whether it could
    /// before the patience with whoever reads it ran out.
    pub(super) async fn empty_log(&self) -> Result<bool, StoreError> {
        let busy: i64 =
            sqlx::query_scalar("PRAGMA wal_checkpoint(TRUNCATE)").fetch_one(&self.writer).await?;
        Ok(busy == 0)
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
