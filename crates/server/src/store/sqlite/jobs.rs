//! Jobs as they are recorded in SQLite. Callers hold the transaction; nothing here commits.

use super::rows;
use crate::api::jobs::Job;
use crate::job_state::JobState;
use crate::store::{Claim, JobCounts, JobFilter, Lease, StoreError};
use sqlx::sqlite::{SqliteConnection, SqlitePool};
use sqlx::{QueryBuilder, Row, Sqlite};
use uuid::Uuid;

/// The job of that id, unless deleted.
pub async fn get(connection: &mut SqliteConnection, id: Uuid) -> Result<Option<Job>, StoreError> {
    let row =
        rows::of_job(connection, "SELECT * FROM jobs WHERE id = ? AND deleted_ms IS NULL", id)
            .await?;
    row.as_ref().map(rows::job).transpose()
}

/// The job of that id, which this transaction has written.
pub async fn expect(connection: &mut SqliteConnection, id: Uuid) -> Result<Job, StoreError> {
    get(connection, id).await?.ok_or_else(|| StoreError::Corrupt {
        what: format!("job {id}"),
        reason: "it vanished within a transaction".into(),
    })
}

/// How many jobs wait.
pub async fn waiting(connection: &mut SqliteConnection) -> Result<u64, StoreError> {
    let row = sqlx::query(
        // By another index every waiting job's row would be read, at every post.
        "SELECT count(*) AS waiting FROM jobs INDEXED BY jobs_queue
         WHERE state = 'queued' AND deleted_ms IS NULL",
    )
    .fetch_one(connection)
    .await?;
    Ok(row.get::<i64, _>("waiting").unsigned_abs())
}

/// Jobs, newest first.
pub async fn list(pool: &SqlitePool, filter: &JobFilter) -> Result<Vec<Job>, StoreError> {
    let mut query: QueryBuilder<Sqlite> =
        QueryBuilder::new("SELECT * FROM jobs WHERE deleted_ms IS NULL");
    if let Some(state) = filter.state {
        query.push(" AND state = ").push_bind(state.as_str());
    }
    if let Some((key, value)) = &filter.label {
        query.push(" AND id IN (SELECT job_id FROM job_labels WHERE key = ").push_bind(key.clone());
        query.push(" AND value = ").push_bind(value.clone()).push(")");
    }
    if let Some(owner) = &filter.owner {
        query.push(" AND owner = ").push_bind(owner.clone());
    }
    if let Some(before) = filter.before {
        query.push(" AND id < ").push_bind(before.to_string());
    }
    query.push(" ORDER BY id DESC LIMIT ").push_bind(filter.limit);
    query.build().fetch_all(pool).await?.iter().map(rows::job).collect()
}

/// Jobs by state: all of each, by an index alone, without those that are deleted, which are few.
/// Rows are wide, and reading those of a million jobs takes seconds.
pub const COUNTS: &str = "SELECT state, sum(jobs) AS jobs FROM (
         SELECT state, count(*) AS jobs FROM jobs INDEXED BY jobs_by_state GROUP BY state
         UNION ALL
         SELECT state, -count(*) FROM jobs INDEXED BY jobs_deleted
             WHERE deleted_ms IS NOT NULL GROUP BY state
     ) GROUP BY state";

/// Jobs by state.
pub async fn counts(pool: &SqlitePool) -> Result<JobCounts, StoreError> {
    let found = sqlx::query(COUNTS).fetch_all(pool).await?;
    let mut counts = JobCounts::default();
    for row in found {
        let state = rows::state(row.get("state"))?;
        for (slot, of) in counts.by_state.iter_mut().zip(JobState::ALL) {
            if of == state {
                *slot = row.get::<i64, _>("jobs").unsigned_abs();
            }
        }
    }
    Ok(counts)
}

/// Whether any job waits.
pub async fn any_queued(pool: &SqlitePool) -> Result<bool, StoreError> {
    let row = sqlx::query(
        "SELECT EXISTS (SELECT 1 FROM jobs WHERE state = 'queued' AND deleted_ms IS NULL) AS any",
    )
    .fetch_one(pool)
    .await?;
    Ok(row.get("any"))
}

/// Leases of running jobs with their owners.
pub async fn leases(connection: &mut SqliteConnection) -> Result<Vec<Lease>, StoreError> {
    let found = sqlx::query(
        "SELECT id, fence, lease_owner, lease_beat FROM jobs
         WHERE state = 'running' AND deleted_ms IS NULL ORDER BY id",
    )
    .fetch_all(connection)
    .await?;
    found
        .iter()
        .map(|row| {
            let fence = row.get::<i64, _>("fence").unsigned_abs();
            Ok(Lease {
                claim: Claim { job: rows::parse_id(row.get("id"))?, fence },
                owner: row.get("lease_owner"),
                beat: row.get::<i64, _>("lease_beat").unsigned_abs(),
            })
        })
        .collect()
}

/// A sign of life for a claim; whether it still holds.
pub async fn renew(connection: &mut SqliteConnection, claim: Claim) -> Result<bool, StoreError> {
    let renewed = sqlx::query(
        "UPDATE jobs SET lease_beat = lease_beat + 1
         WHERE id = ? AND fence = ? AND state = 'running' AND deleted_ms IS NULL",
    )
    .bind(claim.job.to_string())
    .bind(claim.fence as i64)
    .execute(connection)
    .await?;
    Ok(renewed.rows_affected() == 1)
}
