//! The tables of a database: whether they are those of this version, and whose they are.

use super::rows;
use crate::store::StoreError;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqlitePool};
use sqlx::{ConnectOptions, Connection, Row, migrate::Migrator};
use std::path::Path;
use uuid::Uuid;

/// Name of the fact that is the store's id.
const STORE_ID: &str = "store_id";

/// The tables of this version.
pub static MIGRATIONS: Migrator = sqlx::migrate!("src/store/migrations");

/// The newest version of the tables that this program knows.
pub fn newest_version() -> i64 {
    MIGRATIONS.iter().map(|migration| migration.version).max().unwrap_or(0)
}

/// Gives the store an id if it has none.
pub async fn ensure_id(writer: &SqlitePool) -> Result<(), StoreError> {
    if fact(&mut *writer.acquire().await?, STORE_ID).await?.is_some() {
        return Ok(());
    }
    sqlx::query("INSERT INTO meta (key, value) VALUES (?, ?) ON CONFLICT DO NOTHING")
        .bind(STORE_ID)
        .bind(Uuid::new_v4().to_string())
        .execute(writer)
        .await?;
    Ok(())
}

/// Refuses a database whose tables are not exactly those of this version: whoever reads them beside
/// a running server must not change them under it.
pub async fn check_version(connection: &mut SqliteConnection) -> Result<(), StoreError> {
    let is_there = "SELECT 1 FROM sqlite_master WHERE name = '_sqlx_migrations'";
    let done: Vec<i64> = if sqlx::query(is_there).fetch_optional(&mut *connection).await?.is_some()
    {
        let done = "SELECT version FROM _sqlx_migrations ORDER BY version";
        let done = sqlx::query(done).fetch_all(&mut *connection).await?;
        done.iter().map(|row| row.get("version")).collect()
    } else {
        Vec::new()
    };
    if MIGRATIONS.iter().map(|migration| migration.version).eq(done.iter().copied()) {
        return Ok(());
    }
    let version = done.last().copied().unwrap_or(0);
    Err(StoreError::OtherVersion { version, own: newest_version() })
}

/// The id in the database `live`, which is read and not changed; `None` where it has none, as those
/// of early releases.
///
/// # Errors
/// Where it cannot be read.
pub async fn peek_id(live: &Path) -> Result<Option<String>, StoreError> {
    let options = SqliteConnectOptions::new().filename(live).read_only(true);
    let mut connection = options.connect().await?;
    let is_there = "SELECT 1 FROM sqlite_master WHERE name = 'meta'";
    let id = match sqlx::query(is_there).fetch_optional(&mut connection).await? {
        Some(_) => fact(&mut connection, STORE_ID).await?,
        None => None,
    };
    connection.close().await?;
    Ok(id)
}

/// A fact that was kept under a name.
pub async fn fact(
    connection: &mut SqliteConnection,
    name: &str,
) -> Result<Option<String>, StoreError> {
    let row = sqlx::query("SELECT value FROM meta WHERE key = ?")
        .bind(name)
        .fetch_optional(connection)
        .await?;
    Ok(row.map(|row| row.get("value")))
}

/// The id of the store that a connection leads to.
pub async fn store_id(connection: &mut SqliteConnection) -> Result<Uuid, StoreError> {
    let id = fact(connection, STORE_ID).await?;
    rows::parse_id(&id.unwrap_or_default())
}
