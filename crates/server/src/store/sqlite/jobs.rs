//! The life of jobs in SQLite. Callers hold the transaction; nothing here commits.

use super::{events, now_ms, rows};
use crate::api::events::{EventData, ProgressEvent, SnapshotEvent, StateEvent};
use crate::api::jobs::{Job, JobError, Picture};
use crate::job_state::{JobState, MAX_ATTEMPTS, after_lost_worker};
use crate::store::{Accepted, Claim, JobCounts, JobFilter, NewJob, Outcome, Report, StoreError};
use sqlx::sqlite::{SqliteConnection, SqlitePool};
use sqlx::{Connection, QueryBuilder, Row, Sqlite};
use uuid::Uuid;

/// The job of that id, unless deleted.
pub async fn get(connection: &mut SqliteConnection, id: Uuid) -> Result<Option<Job>, StoreError> {
    let row = sqlx::query("SELECT * FROM jobs WHERE id = ? AND deleted_ms IS NULL")
        .bind(id.to_string())
        .fetch_optional(connection)
        .await?;
    row.as_ref().map(rows::job).transpose()
}

async fn expect(connection: &mut SqliteConnection, id: Uuid) -> Result<Job, StoreError> {
    get(connection, id).await?.ok_or_else(|| StoreError::Corrupt {
        what: format!("job {id}"),
        reason: "it vanished within a transaction".into(),
    })
}

/// Queues a job, or finds the one that the same key made.
pub async fn accept(
    connection: &mut SqliteConnection,
    job: NewJob,
    max_queued: u64,
) -> Result<Accepted, StoreError> {
    if let Some(key) = &job.idempotency_key {
        let before = sqlx::query(
            "SELECT id, request_hash FROM jobs WHERE idempotency_key = ? AND deleted_ms IS NULL",
        )
        .bind(key)
        .fetch_optional(&mut *connection)
        .await?;
        if let Some(row) = before {
            if row.get::<&str, _>("request_hash") != job.request_hash {
                return Ok(Accepted::KeyConflict);
            }
            let id = rows::parse_id(row.get("id"))?;
            return Ok(Accepted::Again(Box::new(expect(connection, id).await?)));
        }
    }
    if waiting(connection).await? >= max_queued {
        return Ok(Accepted::QueueFull);
    }
    sqlx::query(
        "INSERT INTO jobs (id, scene_id, state, priority, created_ms, idempotency_key,
                           request_hash, request)
         VALUES (?, ?, 'queued', ?, ?, ?, ?, ?)",
    )
    .bind(job.id.to_string())
    .bind(&job.scene_id)
    .bind(job.request.priority)
    .bind(now_ms())
    .bind(&job.idempotency_key)
    .bind(&job.request_hash)
    .bind(rows::to_json(&job.request))
    .execute(&mut *connection)
    .await?;
    for (key, value) in &job.request.labels {
        sqlx::query("INSERT INTO job_labels (job_id, key, value) VALUES (?, ?, ?)")
            .bind(job.id.to_string())
            .bind(key)
            .bind(value)
            .execute(&mut *connection)
            .await?;
    }
    append_state(connection, job.id, JobState::Queued, 0, None).await?;
    Ok(Accepted::New(Box::new(expect(connection, job.id).await?)))
}

/// How many jobs wait.
pub async fn waiting(connection: &mut SqliteConnection) -> Result<u64, StoreError> {
    let row = sqlx::query(
        "SELECT count(*) AS waiting FROM jobs WHERE state = 'queued' AND deleted_ms IS NULL",
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
    if let Some(before) = filter.before {
        query.push(" AND id < ").push_bind(before.to_string());
    }
    query.push(" ORDER BY id DESC LIMIT ").push_bind(filter.limit);
    query.build().fetch_all(pool).await?.iter().map(rows::job).collect()
}

/// Jobs by state.
pub async fn counts(pool: &SqlitePool) -> Result<JobCounts, StoreError> {
    let found = sqlx::query(
        "SELECT state, count(*) AS jobs FROM jobs WHERE deleted_ms IS NULL GROUP BY state",
    )
    .fetch_all(pool)
    .await?;
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

/// Asks a job to end: a queued one ends now, a running one when its worker hears of it.
pub async fn cancel(
    connection: &mut SqliteConnection,
    id: Uuid,
) -> Result<Option<Job>, StoreError> {
    let Some(job) = get(connection, id).await? else { return Ok(None) };
    match job.state {
        JobState::Queued => {
            set_state(connection, &job, JobState::Cancelled).await?;
            append_state(connection, id, JobState::Cancelled, job.attempts, None).await?;
        }
        JobState::Running => {
            sqlx::query("UPDATE jobs SET cancel_requested = 1 WHERE id = ?")
                .bind(id.to_string())
                .execute(&mut *connection)
                .await?;
        }
        _ => {}
    }
    get(connection, id).await
}

/// Hides a job. One that has not ended is cancelled first, with its terminal event, and the
/// worker's claim on it is over.
pub async fn delete(connection: &mut SqliteConnection, id: Uuid) -> Result<bool, StoreError> {
    let Some(job) = get(connection, id).await? else { return Ok(false) };
    if !job.state.is_terminal() {
        set_state(connection, &job, JobState::Cancelled).await?;
        let reason = Some("the job was deleted".to_owned());
        append_state(connection, id, JobState::Cancelled, job.attempts, reason).await?;
    }
    sqlx::query("UPDATE jobs SET deleted_ms = ?, fence = fence + 1 WHERE id = ?")
        .bind(now_ms())
        .bind(id.to_string())
        .execute(connection)
        .await?;
    Ok(true)
}

/// Takes the next job of the queue: highest priority, then oldest.
pub async fn claim(
    connection: &mut SqliteConnection,
    device: &str,
    owner: &str,
) -> Result<Option<(Claim, Job)>, StoreError> {
    let next = sqlx::query(
        "SELECT * FROM jobs WHERE state = 'queued' AND deleted_ms IS NULL
         ORDER BY priority DESC, id LIMIT 1",
    )
    .fetch_optional(&mut *connection)
    .await?;
    let Some(row) = next else { return Ok(None) };
    let job = rows::job(&row)?;
    let fence = row.get::<i64, _>("fence") + 1;
    sqlx::query(
        "UPDATE jobs SET state = 'running', lease_owner = ?, fence = ?, attempts = attempts + 1,
             started_ms = ?, device = ?, progress = NULL, plan = NULL, warnings = '[]'
         WHERE id = ?",
    )
    .bind(owner)
    .bind(fence)
    .bind(now_ms())
    .bind(device)
    .bind(job.id.to_string())
    .execute(&mut *connection)
    .await?;
    append_state(connection, job.id, JobState::Running, job.attempts + 1, None).await?;
    let claim = Claim { job: job.id, fence: fence.unsigned_abs() };
    Ok(Some((claim, expect(connection, job.id).await?)))
}

/// The job of a claim that still holds.
async fn held(connection: &mut SqliteConnection, claim: Claim) -> Result<Job, StoreError> {
    let row = sqlx::query(
        "SELECT * FROM jobs
         WHERE id = ? AND fence = ? AND state = 'running' AND deleted_ms IS NULL",
    )
    .bind(claim.job.to_string())
    .bind(claim.fence as i64)
    .fetch_optional(connection)
    .await?;
    row.as_ref().map(rows::job).transpose()?.ok_or(StoreError::ClaimLost(claim.job))
}

/// Writes a worker's report in a transaction of its own; whether the job is asked to end.
pub async fn report(
    connection: &mut SqliteConnection,
    claim: Claim,
    report: Report,
) -> Result<bool, StoreError> {
    let mut transaction = connection.begin_with("BEGIN IMMEDIATE").await?;
    let job = held(&mut transaction, claim).await?;
    if let Some((plan, warnings)) = &report.plan {
        sqlx::query("UPDATE jobs SET plan = ?, warnings = ? WHERE id = ?")
            .bind(rows::to_json(plan))
            .bind(rows::to_json(warnings))
            .bind(claim.job.to_string())
            .execute(&mut *transaction)
            .await?;
    }
    if let Some(progress) = report.progress.last() {
        sqlx::query("UPDATE jobs SET progress = ? WHERE id = ?")
            .bind(rows::to_json(progress))
            .bind(claim.job.to_string())
            .execute(&mut *transaction)
            .await?;
    }
    for progress in report.progress {
        let event = EventData::Progress(ProgressEvent { fence: claim.fence, progress });
        let seq = events::append(&mut transaction, claim.job, &event).await?;
        if seq % (events::MAX_PROGRESS_EVENTS / 8) == 0 {
            events::thin(&mut transaction, claim.job).await?;
        }
    }
    for (pictures, progress) in report.snapshots {
        let event = EventData::Snapshot(SnapshotEvent { pictures: pictures.clone(), progress });
        let seq = events::append(&mut transaction, claim.job, &event).await?;
        add_pictures(&mut transaction, claim.job, seq, &pictures).await?;
    }
    transaction.commit().await?;
    Ok(job.cancel_requested)
}

async fn add_pictures(
    connection: &mut SqliteConnection,
    job: Uuid,
    seq: i64,
    pictures: &[Picture],
) -> Result<(), StoreError> {
    for picture in pictures {
        sqlx::query(
            "INSERT INTO pictures (job_id, seq, sha256, format, record) VALUES (?, ?, ?, ?, ?)",
        )
        .bind(job.to_string())
        .bind(seq)
        .bind(&picture.sha256)
        .bind(picture.format.suffix())
        .bind(rows::to_json(picture))
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}

/// Ends a claimed job.
pub async fn finish(
    connection: &mut SqliteConnection,
    claim: Claim,
    outcome: Outcome,
) -> Result<(), StoreError> {
    let job = held(connection, claim).await?;
    if let Some(progress) = &outcome.progress {
        let event =
            EventData::Progress(ProgressEvent { fence: claim.fence, progress: progress.clone() });
        events::append(connection, claim.job, &event).await?;
        sqlx::query("UPDATE jobs SET progress = ? WHERE id = ?")
            .bind(rows::to_json(progress))
            .bind(claim.job.to_string())
            .execute(&mut *connection)
            .await?;
    }
    set_state(connection, &job, outcome.state).await?;
    sqlx::query("UPDATE jobs SET stats = ?, error = ?, result = ? WHERE id = ?")
        .bind(outcome.stats.as_ref().map(rows::to_json))
        .bind(outcome.error.as_ref().map(rows::to_json))
        .bind((!outcome.pictures.is_empty()).then(|| rows::to_json(&outcome.pictures)))
        .bind(claim.job.to_string())
        .execute(&mut *connection)
        .await?;
    let event = EventData::State(StateEvent {
        state: outcome.state,
        attempts: job.attempts,
        reason: None,
        pictures: outcome.pictures.clone(),
        error: outcome.error,
    });
    let seq = events::append(connection, claim.job, &event).await?;
    add_pictures(connection, claim.job, seq, &outcome.pictures).await
}

/// Takes a claim back: the job is queued again, cancelled if that was asked, or given up after
/// too many counted attempts.
pub async fn release(
    connection: &mut SqliteConnection,
    claim: Claim,
    counted: bool,
    reason: &str,
) -> Result<(), StoreError> {
    let job = held(connection, claim).await?;
    let attempts = if counted { job.attempts } else { job.attempts.saturating_sub(1) };
    let next = after_lost_worker(attempts, job.cancel_requested);
    let error = (next == JobState::Failed).then(|| JobError {
        code: "poisoned".into(),
        detail: format!(
            "given up after {MAX_ATTEMPTS} attempts; the last one ended because {reason}"
        ),
    });
    set_state(connection, &job, next).await?;
    sqlx::query("UPDATE jobs SET attempts = ?, error = ? WHERE id = ?")
        .bind(attempts)
        .bind(error.as_ref().map(rows::to_json))
        .bind(claim.job.to_string())
        .execute(&mut *connection)
        .await?;
    let event = EventData::State(StateEvent {
        state: next,
        attempts,
        reason: Some(reason.to_owned()),
        pictures: Vec::new(),
        error,
    });
    events::append(connection, claim.job, &event).await?;
    Ok(())
}

/// Claims of running jobs: those of `owner`, or all.
pub async fn leased(
    connection: &mut SqliteConnection,
    owner: Option<&str>,
) -> Result<Vec<Claim>, StoreError> {
    let found = sqlx::query(
        "SELECT id, fence FROM jobs
         WHERE state = 'running' AND deleted_ms IS NULL AND (?1 IS NULL OR lease_owner = ?1)",
    )
    .bind(owner)
    .fetch_all(connection)
    .await?;
    found
        .iter()
        .map(|row| {
            let fence = row.get::<i64, _>("fence").unsigned_abs();
            Ok(Claim { job: rows::parse_id(row.get("id"))?, fence })
        })
        .collect()
}

/// The one place where a state changes, apart from claiming.
async fn set_state(
    connection: &mut SqliteConnection,
    job: &Job,
    next: JobState,
) -> Result<(), StoreError> {
    if !job.state.may_become(next) {
        return Err(StoreError::Corrupt {
            what: format!("job {}", job.id),
            reason: format!("{:?} may not become {next:?}", job.state),
        });
    }
    let changed = sqlx::query(
        "UPDATE jobs SET state = ?1, lease_owner = NULL, finished_ms = ?2,
             started_ms = CASE WHEN ?1 = 'queued' THEN NULL ELSE started_ms END
         WHERE id = ?3 AND state = ?4",
    )
    .bind(next.as_str())
    .bind(next.is_terminal().then(now_ms))
    .bind(job.id.to_string())
    .bind(job.state.as_str())
    .execute(connection)
    .await?;
    if changed.rows_affected() != 1 {
        return Err(StoreError::Corrupt {
            what: format!("job {}", job.id),
            reason: format!("it is not {:?} any more", job.state),
        });
    }
    Ok(())
}

async fn append_state(
    connection: &mut SqliteConnection,
    id: Uuid,
    state: JobState,
    attempts: u32,
    reason: Option<String>,
) -> Result<(), StoreError> {
    let event =
        EventData::State(StateEvent { state, attempts, reason, pictures: Vec::new(), error: None });
    events::append(connection, id, &event).await?;
    Ok(())
}
