//! Holders of scenes in SQLite.

use super::database::SqliteStore;
use super::time::now_ms;
use super::uploads;
use crate::api::scenes::Scene;
use crate::builtin;
use crate::store::StoreError;
use crate::store::scenes::{Holdings, ScenePosition, Viewer};
use async_trait::async_trait;
use sqlx::Row;
use sqlx::sqlite::SqliteConnection;

/// What `holder` calls a scene, or what it is called as a built-in one.
pub async fn name_for(
    connection: &mut SqliteConnection,
    scene: &str,
    holder: &str,
) -> Result<Option<String>, StoreError> {
    let row = sqlx::query("SELECT name FROM scene_holders WHERE scene_id = ? AND holder = ?")
        .bind(scene)
        .bind(holder)
        .fetch_optional(connection)
        .await?;
    let name = row.and_then(|row| row.get("name"));
    Ok(name.or_else(|| builtin::name_of(scene).map(str::to_owned)))
}

#[async_trait]
impl Holdings for SqliteStore {
    async fn hold_scene(&self, scene: &str, holder: &str) -> Result<bool, StoreError> {
        let mut transaction = self.begin().await?;
        // A scene that was collected meanwhile is nobody's.
        let done = sqlx::query(
            "INSERT INTO scene_holders (scene_id, holder, created_ms)
             SELECT id, ?2, ?3 FROM scenes WHERE id = ?1 ON CONFLICT DO NOTHING",
        )
        .bind(scene)
        .bind(holder)
        .bind(now_ms())
        .execute(&mut *transaction)
        .await?;
        sqlx::query("UPDATE scenes SET let_go = 0 WHERE id = ? AND let_go = 1")
            .bind(scene)
            .execute(&mut *transaction)
            .await?;
        transaction.commit().await?;
        Ok(done.rows_affected() == 1)
    }

    async fn name_scene(&self, scene: &str, holder: &str, name: &str) -> Result<(), StoreError> {
        sqlx::query("UPDATE scene_holders SET name = ?3 WHERE scene_id = ?1 AND holder = ?2")
            .bind(scene)
            .bind(holder)
            .bind(name)
            .execute(&self.writer)
            .await?;
        Ok(())
    }

    async fn holds_scene(&self, scene: &str, holder: &str) -> Result<bool, StoreError> {
        let row = sqlx::query(
            "SELECT EXISTS (SELECT 1 FROM scene_holders WHERE scene_id = ? AND holder = ?) AS held",
        )
        .bind(scene)
        .bind(holder)
        .fetch_one(&self.reader)
        .await?;
        Ok(row.get("held"))
    }

    async fn is_stored(&self, id: &str) -> Result<bool, StoreError> {
        let row = sqlx::query("SELECT EXISTS (SELECT 1 FROM scenes WHERE id = ?) AS stored")
            .bind(id)
            .fetch_one(&self.reader)
            .await?;
        Ok(row.get("stored"))
    }

    async fn shown_scene(
        &self,
        scene: &str,
        viewer: Viewer<'_>,
    ) -> Result<Option<Scene>, StoreError> {
        uploads::shown(self, scene, viewer).await
    }

    async fn shown_scenes(
        &self,
        viewer: Viewer<'_>,
        before: Option<&ScenePosition>,
        limit: u32,
    ) -> Result<Vec<Scene>, StoreError> {
        uploads::list(self, viewer, before, limit).await
    }

    async fn scene_bytes_of(&self, holder: &str) -> Result<u64, StoreError> {
        let row = sqlx::query(
            "SELECT coalesce(sum(json_extract(record, '$.size')), 0) AS bytes
             FROM scenes JOIN scene_holders ON scene_id = id AND holder = ?",
        )
        .bind(holder)
        .fetch_one(&self.reader)
        .await?;
        Ok(row.get::<i64, _>("bytes").unsigned_abs())
    }

    async fn let_go_scene(&self, scene: &str, holder: Option<&str>) -> Result<(), StoreError> {
        let mut transaction = self.begin().await?;
        let held = sqlx::query(
            "DELETE FROM scene_holders WHERE scene_id = ?1 AND (?2 IS NULL OR holder = ?2)",
        )
        .bind(scene)
        .bind(holder)
        .execute(&mut *transaction)
        .await?;
        // Scenes of the first release have no holders; who sees all may let go of them as well.
        if held.rows_affected() > 0 || holder.is_none() {
            sqlx::query(
                "UPDATE scenes SET let_go = 1 WHERE id = ?1
                   AND NOT EXISTS (SELECT 1 FROM scene_holders WHERE scene_id = ?1)",
            )
            .bind(scene)
            .execute(&mut *transaction)
            .await?;
        }
        Ok(transaction.commit().await?)
    }

    async fn scenes_let_go(&self, limit: u32) -> Result<Vec<String>, StoreError> {
        let found = sqlx::query(
            "SELECT id FROM scenes WHERE let_go = 1
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE scene_id = scenes.id)
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE environment_id = scenes.id) LIMIT ?",
        )
        .bind(limit)
        .fetch_all(&self.reader)
        .await?;
        Ok(found.iter().map(|row| row.get("id")).collect())
    }

    async fn forget_let_go(&self, scene: &str) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "DELETE FROM scenes WHERE id = ? AND let_go = 1
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE scene_id = scenes.id)
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE environment_id = scenes.id)",
        )
        .bind(scene)
        .execute(&self.writer)
        .await?;
        Ok(done.rows_affected() == 1)
    }
}
