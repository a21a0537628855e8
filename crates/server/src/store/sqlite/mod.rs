//! The embedded store: SQLite in WAL mode with one writing connection, one for leases and a few
//! reading ones.
//!
//! Every write is one `BEGIN IMMEDIATE` transaction, and every commit reaches the
//! disk before it returns (`synchronous = FULL`).

mod accept;
mod bytes;
mod claims;
mod database;
mod environments;
mod events;
mod jobs;
mod keys;
mod life;
mod meta;
mod outbox;
mod payers;
mod retention;
mod rows;
mod scenes;
pub mod snapshot;
mod solutions;
pub mod tables;
#[cfg(test)]
pub(crate) mod tests;
pub(crate) mod time;
mod trouble;
mod uploads;

pub use database::SqliteStore;

use super::{
    Accepted, Asking, Claim, JobCounts, JobFilter, Lease, NewJob, Outcome, Report, Store,
    StoreError,
};
use crate::api::events::Event;
use crate::api::jobs::{Job, Picture, PictureFormat, Progress};
use crate::api::scenes::Scene;
use crate::job_state::{Cause, Event as JobEvent};
use async_trait::async_trait;
use sqlx::Row;
use trouble::failpoint;
use uuid::Uuid;

#[async_trait]
impl Store for SqliteStore {
    async fn put_scene(&self, scene: &Scene) -> Result<bool, StoreError> {
        uploads::put(self, scene).await
    }

    async fn scene(&self, id: &str) -> Result<Option<Scene>, StoreError> {
        uploads::get(self, id).await
    }

    async fn accept(&self, job: NewJob, max_queued: u64) -> Result<Accepted, StoreError> {
        let id = job.id;
        let mut transaction = self.begin().await?;
        let accepted = accept::accept(&mut transaction, job, max_queued).await?;
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
        let job = life::cancel(&mut transaction, id).await?;
        transaction.commit().await?;
        Ok(job)
    }

    async fn delete(&self, id: Uuid) -> Result<bool, StoreError> {
        let mut transaction = self.begin().await?;
        let was_there = life::delete(&mut transaction, id).await?;
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
        let claimed = life::claim(&mut transaction, asking, &self.owner).await?;
        failpoint("claim", &claimed)?;
        transaction.commit().await?;
        failpoint("claimed", &claimed)?;
        Ok(claimed)
    }

    async fn report(&self, claim: Claim, report: Report) -> Result<bool, StoreError> {
        failpoint("report", claim)?;
        let mut writer = self.writer.acquire().await?;
        life::report(&mut writer, claim, report).await
    }

    async fn finish(&self, claim: Claim, outcome: Outcome) -> Result<(), StoreError> {
        let mut transaction = self.begin().await?;
        life::finish(&mut transaction, claim, outcome).await?;
        failpoint("finish", claim)?;
        transaction.commit().await?;
        failpoint("finished", claim)
    }

    async fn release(&self, claim: Claim, cause: Cause, reason: &str) -> Result<(), StoreError> {
        failpoint("release", claim)?;
        let mut transaction = self.begin().await?;
        let event = JobEvent::Release { fence: claim.fence, cause };
        life::release(&mut transaction, claim, event, reason).await?;
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
                life::release(&mut transaction, lease.claim, event, reason).await?;
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
                life::release(&mut transaction, lease.claim, event, "the server died").await?;
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
        life::release(&mut transaction, lease.claim, event, reason).await?;
        transaction.commit().await?;
        Ok(true)
    }

    async fn twin(&self, claim: Claim) -> Result<Option<Job>, StoreError> {
        let row = rows::of_job(
            &self.reader,
            "SELECT twin.* FROM jobs AS own JOIN jobs AS twin ON twin.render_key = own.render_key
             WHERE own.id = ?1 AND twin.id <> ?1 AND twin.state = 'succeeded'
               AND twin.deleted_ms IS NULL ORDER BY twin.id DESC LIMIT 1",
            claim.job,
        )
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
        // SQLite writes its log back into the database when the last connection closes. One that
        // was still being made when its task was ended may outlive the writer: a log that stays is
        // read into whatever database is put in this one's place, which ruins it.
        if !matches!(self.empty_log().await, Ok(true)) {
            tracing::warn!(
                "what was written last stands in the file that ends in -wal: keep it beside the \
                 database"
            );
        }
        self.writer.close().await;
    }
}
