//! Bytes in SQLite. The sums are kept by triggers (migration 9).

use super::database::SqliteStore;
use super::{events, life, payers, rows};
use crate::api::events::{EventData, NoticeEvent};
use crate::api::jobs::Picture;
use crate::job_state::Event;
use crate::store::bytes::{Bytes, Pinned, Snapshots, Staying};
use crate::store::{Claim, StoreError};
use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::Row;
use uuid::Uuid;

#[async_trait]
impl Bytes for SqliteStore {
    async fn stored_bytes(&self) -> Result<u64, StoreError> {
        let row = sqlx::query(
            "SELECT (SELECT bytes FROM scene_bytes)
                  + (SELECT coalesce(sum(bytes), 0) FROM payers) AS bytes",
        )
        .fetch_one(&self.reader)
        .await?;
        Ok(row.get::<i64, _>("bytes").unsigned_abs())
    }

    async fn payer_bytes(&self, billed_to: &str) -> Result<u64, StoreError> {
        payers::stored_bytes(&mut *self.reader.acquire().await?, billed_to).await
    }

    async fn room(&self, job: Uuid) -> Result<Option<u64>, StoreError> {
        let row = rows::of_job(
            &self.reader,
            "SELECT max(0, max_stored - coalesce(payers.bytes, 0)) AS room FROM jobs
             LEFT JOIN payers ON payers.billed_to = jobs.billed_to
             WHERE jobs.id = ? AND max_stored IS NOT NULL",
            job,
        )
        .await?;
        Ok(row.map(|row| row.get::<i64, _>("room").unsigned_abs()))
    }

    async fn pin(&self, job: Uuid, pinned: bool, most: Option<u64>) -> Result<Pinned, StoreError> {
        let mut transaction = self.begin().await?;
        let row = rows::of_job(&mut *transaction, "SELECT pinned, finished_ms IS NOT NULL AS has_ended, jobs.bytes, coalesce(pinned_bytes, 0) AS pinned_bytes FROM jobs
             LEFT JOIN payers ON payers.billed_to = jobs.billed_to
             WHERE id = ? AND deleted_ms IS NULL", job).await?;
        let Some(row) = row else { return Ok(Pinned::Missing) };
        let bytes = |column| row.get::<i64, _>(column).unsigned_abs();
        let (own, others) = (bytes("bytes"), bytes("pinned_bytes"));
        let is_new = pinned && !row.get::<bool, _>("pinned");
        if is_new && most.is_some() && !row.get::<bool, _>("has_ended") {
            return Ok(Pinned::NotYet);
        }
        if is_new && most.is_some_and(|most| others.saturating_add(own) > most) {
            return Ok(Pinned::OverQuota { pinned: others, job: own });
        }
        sqlx::query("UPDATE jobs SET pinned = ? WHERE id = ?")
            .bind(pinned)
            .bind(job.to_string())
            .execute(&mut *transaction)
            .await?;
        transaction.commit().await?;
        Ok(Pinned::Done)
    }

    async fn staying(&self, before: Timestamp) -> Result<Staying, StoreError> {
        // Jobs without files stay, and so do their scenes, until they expire.
        let row = sqlx::query(
            "WITH needed AS (
                 SELECT json_extract(record, '$.size') AS size, used_ms >= ?1 AS is_new,
                   EXISTS (SELECT 1 FROM jobs WHERE scene_id = scenes.id AND deleted_ms IS NULL)
                     OR EXISTS (SELECT 1 FROM jobs
                                WHERE environment_id = scenes.id AND deleted_ms IS NULL)
                       AS is_named,
                   EXISTS (SELECT 1 FROM jobs INDEXED BY jobs_that_stay
                           WHERE scene_id = scenes.id AND deleted_ms IS NULL
                             AND (pinned = 1 OR finished_ms IS NULL OR bytes = 0))
                     OR EXISTS (SELECT 1 FROM jobs
                                WHERE environment_id = scenes.id AND deleted_ms IS NULL
                                  AND (pinned = 1 OR finished_ms IS NULL OR bytes = 0)) AS is_fixed
                 FROM scenes)
             SELECT (SELECT coalesce(sum(bytes), 0) FROM payers)
                      + coalesce(sum(iif(is_new OR is_named, size, 0)), 0) AS bytes,
                    (SELECT coalesce(sum(bytes), 0) FROM jobs INDEXED BY jobs_that_stay
                     WHERE deleted_ms IS NULL
                       AND (pinned = 1 OR finished_ms IS NULL OR bytes = 0))
                      + coalesce(sum(iif(is_new OR is_fixed, size, 0)), 0) AS fixed
             FROM needed",
        )
        .bind(before.as_millisecond())
        .fetch_one(&self.reader)
        .await?;
        let bytes = |column| row.get::<i64, _>(column).unsigned_abs();
        Ok(Staying { bytes: bytes("bytes"), fixed: bytes("fixed") })
    }

    async fn evictable(&self) -> Result<Option<(Uuid, u64)>, StoreError> {
        let row = sqlx::query(
            "SELECT job, (SELECT jobs.bytes FROM jobs WHERE id = job) AS bytes FROM (
             SELECT (SELECT id FROM jobs
                     WHERE jobs.billed_to = payers.billed_to AND finished_ms IS NOT NULL
                       AND pinned = 0 AND deleted_ms IS NULL AND jobs.bytes > 0
                     ORDER BY finished_ms, id LIMIT 1) AS job
             FROM payers LEFT JOIN
                  (SELECT holder, sum(json_extract(record, '$.size')) AS scene_bytes
                   FROM scene_holders JOIN scenes ON scenes.id = scene_id GROUP BY holder)
                  ON holder = billed_to
             WHERE job IS NOT NULL
             ORDER BY bytes + coalesce(scene_bytes, 0) DESC, billed_to DESC LIMIT 1)",
        )
        .fetch_optional(&self.reader)
        .await?;
        row.map(|row| {
            let bytes = row.get::<i64, _>("bytes").unsigned_abs();
            Ok((rows::parse_id(row.get("job"))?, bytes))
        })
        .transpose()
    }

    async fn snapshots(&self, job: Uuid) -> Result<Snapshots, StoreError> {
        let found = sqlx::query(
            "SELECT seq, sum(json_extract(record, '$.size')) AS bytes
             FROM pictures JOIN events USING (job_id, seq)
             WHERE job_id = ? AND kind = 'snapshot' GROUP BY seq ORDER BY seq",
        )
        .bind(job.to_string())
        .fetch_all(&self.reader)
        .await?;
        let number =
            |row: &sqlx::sqlite::SqliteRow, column| row.get::<i64, _>(column).unsigned_abs();
        let row = sqlx::query(
            "SELECT count(*) AS thinned FROM events WHERE job_id = ? AND kind = 'notice'
               AND json_extract(data, '$.what') = 'snapshots_thinned'",
        )
        .bind(job.to_string())
        .fetch_one(&self.reader)
        .await?;
        Ok(Snapshots {
            stored: found.iter().map(|row| (number(row, "seq"), number(row, "bytes"))).collect(),
            thinned: row.get("thinned"),
        })
    }

    async fn drop_snapshots(
        &self,
        claim: Claim,
        dropped: &[u64],
        notice: NoticeEvent,
    ) -> Result<Vec<Picture>, StoreError> {
        let mut transaction = self.begin().await?;
        let held = Event::Report { fence: claim.fence };
        life::happens_to_held(&mut transaction, claim, held).await?;
        let job = claim.job.to_string();
        let mut pictures: Vec<Picture> = Vec::new();
        for seq in dropped {
            let seq = i64::try_from(*seq).unwrap_or(i64::MAX);
            sqlx::query("DELETE FROM events WHERE job_id = ? AND seq = ? AND kind = 'snapshot'")
                .bind(&job)
                .bind(seq)
                .execute(&mut *transaction)
                .await?;
            let found =
                sqlx::query("DELETE FROM pictures WHERE job_id = ? AND seq = ? RETURNING record")
                    .bind(&job)
                    .bind(seq)
                    .fetch_all(&mut *transaction)
                    .await?;
            for row in found {
                pictures.push(rows::from_json("picture", row.get("record"))?);
            }
        }
        let mut unnamed = Vec::new();
        for picture in pictures {
            let named = sqlx::query(
                "SELECT 1 FROM pictures WHERE job_id = ? AND format = ? AND sha256 = ? LIMIT 1",
            )
            .bind(&job)
            .bind(picture.format.suffix())
            .bind(&picture.sha256)
            .fetch_optional(&mut *transaction)
            .await?;
            if named.is_none() {
                unnamed.push(picture);
            }
        }
        events::append(&mut transaction, claim.job, &EventData::Notice(notice)).await?;
        transaction.commit().await?;
        Ok(unnamed)
    }
}

#[cfg(test)]
mod tests;
