//! Records of uploads of any kind in SQLite: stored, read, and shown to who may see them.

use super::database::SqliteStore;
use super::rows;
use super::time::now_ms;
use crate::api::uploads::Upload;
use crate::builtin;
use crate::store::StoreError;
use crate::store::scenes::{ScenePosition, Viewer};
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

/// Uploads of kind ?2 as their holder ?1 sees them, or as who sees all does: since they were first
/// stored, under their own name for it, or that of its first holder who has one.
const HELD: &str = "SELECT scenes.id, record, held.created_ms AS since_ms, held.name AS name
     FROM scene_holders AS held JOIN scenes ON scenes.id = scene_id
     WHERE holder = ?1 AND kind = ?2";
const ALL: &str = "SELECT id, record, created_ms AS since_ms, (
         SELECT name FROM scene_holders WHERE scene_id = id AND name IS NOT NULL
         ORDER BY holder <> ?1, created_ms LIMIT 1) AS name
     FROM scenes WHERE let_go = 0 AND kind = ?2";

fn of(viewer: Viewer<'_>) -> &'static str {
    if viewer.sees_all { ALL } else { HELD }
}

fn seen<T: Upload>(row: &SqliteRow) -> Result<T, StoreError> {
    let upload: T = rows::from_json(T::KIND, row.get("record"))?;
    let name = row.get::<Option<String>, _>("name");
    let name = name.or_else(|| builtin::name_of(upload.id()).map(str::to_owned));
    Ok(upload.seen_as(name, rows::time(row.get("since_ms"))?))
}

/// Stores a record; false where it was there already.
pub async fn put<T: Upload>(store: &SqliteStore, upload: &T) -> Result<bool, StoreError> {
    let done = sqlx::query(
        "INSERT INTO scenes (id, created_ms, record, used_ms, kind) VALUES (?, ?, ?, ?, ?)
         ON CONFLICT DO NOTHING",
    )
    .bind(upload.id())
    .bind(upload.created_at().as_millisecond())
    .bind(rows::to_json(upload))
    .bind(now_ms())
    .bind(T::KIND)
    .execute(&store.writer)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// The record of that id, whoever holds it.
pub async fn get<T: Upload>(store: &SqliteStore, id: &str) -> Result<Option<T>, StoreError> {
    let row = sqlx::query("SELECT record FROM scenes WHERE id = ? AND kind = ?")
        .bind(id)
        .bind(T::KIND)
        .fetch_optional(&store.reader)
        .await?;
    row.map(|row| rows::from_json(T::KIND, row.get("record"))).transpose()
}

/// A record as `viewer` sees it; nothing where they may not.
pub async fn shown<T: Upload>(
    store: &SqliteStore,
    id: &str,
    viewer: Viewer<'_>,
) -> Result<Option<T>, StoreError> {
    let query = format!("{} AND scenes.id = ?3", of(viewer));
    let row = sqlx::query(sqlx::AssertSqlSafe(query))
        .bind(viewer.holder)
        .bind(T::KIND)
        .bind(id)
        .fetch_optional(&store.reader)
        .await?;
    row.as_ref().map(seen).transpose()
}

/// Records that `viewer` sees, newest first; `before` is the place of the last one of the page
/// before.
pub async fn list<T: Upload>(
    store: &SqliteStore,
    viewer: Viewer<'_>,
    before: Option<&ScenePosition>,
    limit: u32,
) -> Result<Vec<T>, StoreError> {
    let column = if viewer.sees_all { "scenes.created_ms" } else { "held.created_ms" };
    let place = if viewer.sees_all { "scenes.id" } else { "held.scene_id" };
    let query = format!(
        "{} AND (?3 IS NULL OR ({column}, {place}) < (?3, ?4))
         ORDER BY {column} DESC, {place} DESC LIMIT ?5",
        of(viewer)
    );
    let found = sqlx::query(sqlx::AssertSqlSafe(query))
        .bind(viewer.holder)
        .bind(T::KIND)
        .bind(before.map(|place| place.created_ms))
        .bind(before.map(|place| place.id.as_str()))
        .bind(limit)
        .fetch_all(&store.reader)
        .await?;
    found.iter().map(seen).collect()
}
