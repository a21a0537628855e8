//! Keys and owners in SQLite.

use super::database::SqliteStore;
use super::rows;
use super::time::now_ms;
use crate::api::keys::KeyRecord;
use crate::api::webhooks::WebhookTarget;
use crate::store::StoreError;
use crate::store::keys::Keys;
use async_trait::async_trait;
use jiff::Timestamp;
use serde_json::json;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;
use uuid::Uuid;

/// A webhook with its secret, which its own serialisation leaves out.
fn webhook_json(webhook: &WebhookTarget) -> String {
    json!({"url": webhook.url, "events": webhook.events, "secret": webhook.secret}).to_string()
}

fn key(row: &SqliteRow) -> Result<KeyRecord, StoreError> {
    let time = |column| row.get::<Option<i64>, _>(column).map(rows::time).transpose();
    let webhook = row.get::<Option<&str>, _>("webhook");
    Ok(KeyRecord {
        id: row.get("id"),
        name: row.get("name"),
        scopes: rows::from_json("scopes", row.get("scopes"))?,
        limits: rows::from_json("limits", row.get("limits"))?,
        webhook: webhook.map(|json| rows::from_json("webhook", json)).transpose()?,
        created_at: rows::time(row.get("created_ms"))?,
        expires_at: time("expires_ms")?,
        revoked_at: time("revoked_ms")?,
        last_used_at: time("last_used_ms")?,
    })
}

#[async_trait]
impl Keys for SqliteStore {
    async fn add_key(&self, key: &KeyRecord, hash: &str) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "INSERT INTO api_keys (id, name, hash, scopes, limits, webhook, created_ms, expires_ms)
             SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8
             WHERE NOT EXISTS (SELECT 1 FROM api_keys WHERE name = ?2 AND revoked_ms IS NULL)",
        )
        .bind(&key.id)
        .bind(&key.name)
        .bind(hash)
        .bind(rows::to_json(&key.scopes))
        .bind(rows::to_json(&key.limits))
        .bind(key.webhook.as_ref().map(webhook_json))
        .bind(key.created_at.as_millisecond())
        .bind(key.expires_at.map(|end| end.as_millisecond()))
        .execute(&self.writer)
        .await?;
        Ok(done.rows_affected() == 1)
    }

    async fn keys(&self) -> Result<Vec<KeyRecord>, StoreError> {
        let found = sqlx::query("SELECT * FROM api_keys ORDER BY created_ms, id")
            .fetch_all(&self.reader)
            .await?;
        found.iter().map(key).collect()
    }

    async fn revoke_key(&self, id_or_name: &str) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "UPDATE api_keys SET revoked_ms = ?1 WHERE revoked_ms IS NULL AND (id = ?2 OR name = ?2)",
        )
        .bind(now_ms())
        .bind(id_or_name)
        .execute(&self.writer)
        .await?;
        Ok(done.rows_affected() > 0)
    }

    async fn key(&self, hash: &str) -> Result<Option<KeyRecord>, StoreError> {
        let row = sqlx::query("SELECT * FROM api_keys WHERE hash = ?")
            .bind(hash)
            .fetch_optional(&self.reader)
            .await?;
        row.as_ref().map(key).transpose()
    }

    async fn any_keys(&self) -> Result<bool, StoreError> {
        let row = sqlx::query("SELECT EXISTS (SELECT 1 FROM api_keys) AS any_keys")
            .fetch_one(&self.reader)
            .await?;
        Ok(row.get("any_keys"))
    }

    async fn key_used(&self, id: &str, at: Timestamp) -> Result<(), StoreError> {
        sqlx::query(
            "UPDATE api_keys SET last_used_ms = max(coalesce(last_used_ms, 0), ?) WHERE id = ?",
        )
        .bind(at.as_millisecond())
        .bind(id)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    async fn job_owner(&self, job: Uuid) -> Result<Option<String>, StoreError> {
        let row = rows::of_job(
            &self.reader,
            "SELECT owner FROM jobs WHERE id = ? AND deleted_ms IS NULL",
            job,
        )
        .await?;
        Ok(row.map(|row| row.get("owner")))
    }

    async fn trace_parent(&self, job: Uuid) -> Result<Option<String>, StoreError> {
        let row =
            rows::of_job(&self.reader, "SELECT trace_parent FROM jobs WHERE id = ?", job).await?;
        Ok(row.and_then(|row| row.get("trace_parent")))
    }
}
