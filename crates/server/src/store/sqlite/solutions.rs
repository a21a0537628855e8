//! Solutions in SQLite.

use super::database::SqliteStore;
use super::{accept, claims, jobs, life, payers, rows};
use crate::api::jobs::JobRequest;
use crate::api::solutions::Solution;
use crate::job_state::{Event, JobState};
use crate::store::solutions::{Extended, Solutions};
use crate::store::{Accepted, Claim, NewJob, StoreError};
use async_trait::async_trait;
use sqlx::Row;
use sqlx::sqlite::SqliteConnection;
use uuid::Uuid;

#[async_trait]
impl Solutions for SqliteStore {
    async fn keep_solution(
        &self,
        claim: Claim,
        solution: &Solution,
    ) -> Result<Option<Solution>, StoreError> {
        let mut transaction = self.begin().await?;
        let held = Event::Report { fence: claim.fence };
        life::happens_to_held(&mut transaction, claim, held).await?;
        let before = find(&mut transaction, claim.job).await?;
        put(&mut transaction, claim.job, solution).await?;
        transaction.commit().await?;
        Ok(before)
    }

    async fn solution(&self, job: Uuid) -> Result<Option<Solution>, StoreError> {
        find(&mut *self.reader.acquire().await?, job).await
    }

    async fn drop_solution(&self, job: Uuid) -> Result<Option<Solution>, StoreError> {
        let row = rows::of_job(
            &self.writer,
            "DELETE FROM solutions WHERE job_id = ? RETURNING record",
            job,
        )
        .await?;
        row.map(|row| rows::from_json("solution", row.get("record"))).transpose()
    }

    async fn accept_view(
        &self,
        job: NewJob,
        solution: &Solution,
        max_queued: u64,
    ) -> Result<Accepted, StoreError> {
        let mut transaction = self.begin().await?;
        let accepted = accept::accept(&mut transaction, job, max_queued).await?;
        if let Accepted::New(job) = &accepted {
            put(&mut transaction, job.id, solution).await?;
        }
        transaction.commit().await?;
        Ok(accepted)
    }

    async fn extend(
        &self,
        id: Uuid,
        request: &JobRequest,
        max_queued: u64,
        max_own: Option<u64>,
    ) -> Result<Extended, StoreError> {
        let mut transaction = self.begin().await?;
        let Some(job) = jobs::get(&mut transaction, id).await? else {
            return Ok(Extended::Missing);
        };
        // After a failed extension there is the result of before, and another may do better.
        let may = match job.state {
            JobState::Succeeded | JobState::Cancelled => true,
            JobState::Failed => job.result.is_some(),
            JobState::Queued | JobState::Running => false,
        };
        if !may {
            return Ok(Extended::NotNow(Box::new(job)));
        }
        if jobs::waiting(&mut transaction).await? >= max_queued {
            return Ok(Extended::QueueFull);
        }
        let payer = payers::of_job(&mut transaction, id).await?;
        if payers::own_queue_is_full(&mut transaction, &payer, max_own).await? {
            return Ok(Extended::OwnQueueFull);
        }
        match life::extend(&mut transaction, id, request).await? {
            Some(true) => {}
            Some(false) => return Ok(Extended::NotNow(Box::new(job))),
            None => return Ok(Extended::Missing),
        }
        claims::join(&mut transaction, &payer).await?;
        let job = jobs::get(&mut transaction, id).await?;
        transaction.commit().await?;
        Ok(job.map_or(Extended::Missing, |job| Extended::Queued(Box::new(job))))
    }
}

/// What a job begins with, or knew last.
pub async fn find(
    connection: &mut SqliteConnection,
    job: Uuid,
) -> Result<Option<Solution>, StoreError> {
    let row =
        rows::of_job(connection, "SELECT record FROM solutions WHERE job_id = ?", job).await?;
    row.map(|row| rows::from_json("solution", row.get("record"))).transpose()
}

async fn put(
    connection: &mut SqliteConnection,
    job: Uuid,
    solution: &Solution,
) -> Result<(), StoreError> {
    sqlx::query(
        "INSERT INTO solutions (job_id, record) VALUES (?, ?)
         ON CONFLICT (job_id) DO UPDATE SET record = excluded.record",
    )
    .bind(job.to_string())
    .bind(rows::to_json(solution))
    .execute(connection)
    .await?;
    Ok(())
}
