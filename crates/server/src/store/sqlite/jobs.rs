//! The life of jobs in SQLite. Callers hold the transaction; nothing here commits.

use super::{bytes, claims, events, now_ms, outbox, rows, scenes};
use crate::api::events::{EventData, ProgressEvent, SnapshotEvent, StateEvent};
use crate::api::jobs::{Job, JobError, JobRequest, Picture};
use crate::job_state::{Event, JobState, Life, Refusal};
use crate::store::{
    Accepted, Asking, Claim, JobCounts, JobFilter, Lease, MAX_PROGRESS_EVENTS, NewJob, Outcome,
    Report, StoreError, Submitter,
};
use sqlx::sqlite::{SqliteConnection, SqlitePool, SqliteRow};
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
            "SELECT id, request_hash FROM jobs
             WHERE owner = ? AND idempotency_key = ? AND deleted_ms IS NULL",
        )
        .bind(&job.submitter.owner)
        .bind(key)
        .fetch_optional(&mut *connection)
        .await?;
        if let Some(row) = before {
            if !job.request_hash.matches(row.get("request_hash")) {
                return Ok(Accepted::KeyConflict);
            }
            let id = rows::parse_id(row.get("id"))?;
            return Ok(Accepted::Again(Box::new(expect(connection, id).await?)));
        }
    }
    if let Some(refused) = refusal(connection, &job, max_queued).await? {
        return Ok(refused);
    }
    insert(connection, &job).await?;
    claims::join(connection, &job.submitter.billed_to).await?;
    append_state(connection, job.id, Life::NEW, None, None).await?;
    Ok(Accepted::New(Box::new(expect(connection, job.id).await?)))
}

/// Why a job is not queued, if so; its scene counts as used.
async fn refusal(
    connection: &mut SqliteConnection,
    job: &NewJob,
    max_queued: u64,
) -> Result<Option<Accepted>, StoreError> {
    if waiting(connection).await? >= max_queued {
        return Ok(Some(Accepted::QueueFull));
    }
    let Submitter { billed_to, max_queued: most, max_stored, .. } = &job.submitter;
    if own_queue_is_full(connection, billed_to, *most).await? {
        return Ok(Some(Accepted::OwnQueueFull));
    }
    if let Some(most) = max_stored {
        let stored = bytes::of_payer(connection, billed_to).await?;
        if stored >= *most {
            return Ok(Some(Accepted::StoreFull { stored }));
        }
    }
    let scene = sqlx::query("UPDATE scenes SET used_ms = max(used_ms, ?) WHERE id = ?")
        .bind(now_ms())
        .bind(&job.scene_id)
        .execute(&mut *connection)
        .await?;
    Ok((scene.rows_affected() == 0).then_some(Accepted::SceneGone))
}

async fn insert(connection: &mut SqliteConnection, job: &NewJob) -> Result<(), StoreError> {
    let quota = |most: Option<u64>| most.map(|most| i64::try_from(most).unwrap_or(i64::MAX));
    sqlx::query(
        "INSERT INTO jobs (id, scene_id, state, priority, created_ms, idempotency_key,
                           request_hash, request, owner, billed_to, max_running, trace_parent,
                           render_key, max_stored, scene_name, place)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?,
                 (SELECT coalesce(max(place), 0) + 1 FROM jobs))",
    )
    .bind(job.id.to_string())
    .bind(&job.scene_id)
    .bind(Life::NEW.state.as_str())
    .bind(job.request.priority)
    .bind(now_ms())
    .bind(&job.idempotency_key)
    .bind(&job.request_hash.now)
    .bind(rows::to_json(&job.request))
    .bind(&job.submitter.owner)
    .bind(&job.submitter.billed_to)
    .bind(quota(job.submitter.max_running))
    .bind(&job.submitter.trace_parent)
    .bind(&job.render_key)
    .bind(quota(job.submitter.max_stored))
    .bind(scenes::name_for(connection, &job.scene_id, &job.submitter.billed_to).await?)
    .execute(&mut *connection)
    .await?;
    if let Some(webhook) = &job.submitter.webhook {
        outbox::register(connection, job.id, webhook).await?;
    }
    for (key, value) in &job.request.labels {
        sqlx::query("INSERT INTO job_labels (job_id, key, value) VALUES (?, ?, ?)")
            .bind(job.id.to_string())
            .bind(key)
            .bind(value)
            .execute(&mut *connection)
            .await?;
    }
    Ok(())
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

/// Under which name a job counts.
pub async fn payer(connection: &mut SqliteConnection, job: Uuid) -> Result<String, StoreError> {
    let row = sqlx::query("SELECT billed_to FROM jobs WHERE id = ?")
        .bind(job.to_string())
        .fetch_one(connection)
        .await?;
    Ok(row.get("billed_to"))
}

/// Whether as many jobs under that name wait as may.
pub async fn own_queue_is_full(
    connection: &mut SqliteConnection,
    billed_to: &str,
    most: Option<u64>,
) -> Result<bool, StoreError> {
    let Some(most) = most else { return Ok(false) };
    let row = sqlx::query(
        "SELECT count(*) AS waiting FROM jobs
         WHERE billed_to = ? AND state = 'queued' AND deleted_ms IS NULL",
    )
    .bind(billed_to)
    .fetch_one(connection)
    .await?;
    Ok(row.get::<i64, _>("waiting").unsigned_abs() >= most)
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

/// A job before and after something happened to it.
pub(super) struct Change {
    row: SqliteRow,
    before: Life,
    after: Life,
}

impl Change {
    fn ends(&self) -> bool {
        self.after.state.is_terminal() && !self.before.state.is_terminal()
    }
}

fn life(row: &SqliteRow) -> Result<Life, StoreError> {
    Ok(Life {
        state: rows::state(row.get("state"))?,
        attempts: row.get("attempts"),
        outages: row.get("outages"),
        interruptions: row.get("interruptions"),
        memory_deaths: row.get("memory_deaths"),
        own_process: row.get("own_process"),
        fence: row.get::<i64, _>("fence").unsigned_abs(),
        cancel_requested: row.get("cancel_requested"),
        deleted: row.get::<Option<i64>, _>("deleted_ms").is_some(),
    })
}

/// The one place where a job's life changes: the state machine decides, this writes. `owner` is
/// who holds the lease from now on, where something does. `None` where there is no such job.
async fn happens(
    connection: &mut SqliteConnection,
    id: Uuid,
    event: Event,
    owner: Option<&str>,
) -> Result<Option<Result<Change, Refusal>>, StoreError> {
    let row = sqlx::query("SELECT * FROM jobs WHERE id = ?")
        .bind(id.to_string())
        .fetch_optional(&mut *connection)
        .await?;
    let Some(row) = row else { return Ok(None) };
    let before = life(&row)?;
    let after = match before.after(event) {
        Ok(after) => after,
        Err(refusal) => return Ok(Some(Err(refusal))),
    };
    let change = Change { row, before, after };
    if after != before {
        write(connection, id, &change, event, owner).await?;
    }
    Ok(Some(Ok(change)))
}

/// Writes down a change of a job's life.
async fn write(
    connection: &mut SqliteConnection,
    id: Uuid,
    change: &Change,
    event: Event,
    owner: Option<&str>,
) -> Result<(), StoreError> {
    let Change { row, before, after } = change;
    let now = now_ms();
    let started: Option<i64> = match (before.state, after.state) {
        (JobState::Queued, JobState::Running) => Some(now),
        (_, JobState::Queued) => None,
        _ => row.get("started_ms"),
    };
    let finished: Option<i64> = match (before.state.is_terminal(), after.state.is_terminal()) {
        (false, true) => Some(now),
        (true, true) => row.get("finished_ms"),
        (_, false) => None,
    };
    let runs = after.state == JobState::Running;
    let holder = owner.or(row.get("lease_owner")).filter(|_| runs);
    sqlx::query(
        "UPDATE jobs SET state = ?, attempts = ?, outages = ?, interruptions = ?,
             memory_deaths = ?, own_process = ?, runs_alone = ?, fence = ?,
             cancel_requested = ?, deleted_ms = ?, started_ms = ?, finished_ms = ?, lease_owner = ?,
             render_key = iif(?, NULL, render_key), mishaps = iif(?, '[]', mishaps)
         WHERE id = ?",
    )
    .bind(after.state.as_str())
    .bind(after.attempts)
    .bind(after.outages)
    .bind(after.interruptions)
    .bind(after.memory_deaths)
    .bind(after.own_process)
    .bind(after.runs_alone())
    .bind(after.fence as i64)
    .bind(after.cancel_requested)
    .bind(after.deleted.then_some(now))
    .bind(started)
    .bind(finished)
    .bind(holder)
    // An extended job's picture is not what its first request determined.
    .bind(event == Event::Extend)
    .bind(event == Event::Extend)
    .bind(id.to_string())
    .execute(&mut *connection)
    .await?;
    Ok(())
}

/// What happens to a claimed job; an error where the claim is over.
pub(super) async fn happens_to_held(
    connection: &mut SqliteConnection,
    claim: Claim,
    event: Event,
) -> Result<Change, StoreError> {
    match happens(connection, claim.job, event, None).await? {
        Some(Ok(change)) => Ok(change),
        Some(Err(Refusal::ClaimLost)) | None => Err(StoreError::ClaimLost(claim.job)),
        Some(Err(refusal)) => Err(StoreError::Illegal { job: claim.job, refusal }),
    }
}

/// Asks a job to end: a queued one ends now, a running one when its worker hears of it.
pub async fn cancel(
    connection: &mut SqliteConnection,
    id: Uuid,
) -> Result<Option<Job>, StoreError> {
    if let Some(Ok(change)) = happens(connection, id, Event::Cancel, None).await?
        && change.ends()
    {
        append_state(connection, id, change.after, None, None).await?;
    }
    get(connection, id).await
}

/// Queues an ended job again with another request; `None` where there is no such job, else whether
/// it could be.
pub async fn extend(
    connection: &mut SqliteConnection,
    id: Uuid,
    request: &JobRequest,
) -> Result<Option<bool>, StoreError> {
    let change = match happens(connection, id, Event::Extend, None).await? {
        Some(Ok(change)) => change,
        Some(Err(Refusal::Deleted)) | None => return Ok(None),
        Some(Err(_)) => return Ok(Some(false)),
    };
    sqlx::query(
        // The result stays until there is another good one.
        "UPDATE jobs SET request = ?, error = NULL WHERE id = ?",
    )
    .bind(rows::to_json(request))
    .bind(id.to_string())
    .execute(&mut *connection)
    .await?;
    append_state(connection, id, change.after, Some("it was given more budget".into()), None)
        .await?;
    Ok(Some(true))
}

/// Hides a job. One that has not ended is cancelled first, with its terminal event, and the
/// worker's claim on it is over.
pub async fn delete(connection: &mut SqliteConnection, id: Uuid) -> Result<bool, StoreError> {
    match happens(connection, id, Event::Delete, None).await? {
        Some(Ok(change)) => {
            if change.ends() {
                let reason = Some("the job was deleted".to_owned());
                append_state(connection, id, change.after, reason, None).await?;
            }
            Ok(true)
        }
        Some(Err(_)) | None => Ok(false),
    }
}

/// Takes the next job of the queue, which [`claims::next`] chooses.
pub async fn claim(
    connection: &mut SqliteConnection,
    asking: &Asking<'_>,
    owner: &str,
) -> Result<Option<(Claim, Job)>, StoreError> {
    let Some(id) = claims::next(connection, asking).await? else { return Ok(None) };
    let event = Event::Claim { own_process: asking.own_process };
    let change = match happens(connection, id, event, Some(owner)).await? {
        Some(Ok(change)) => change,
        Some(Err(refusal)) => return Err(StoreError::Illegal { job: id, refusal }),
        None => return Ok(None),
    };
    sqlx::query(
        "UPDATE jobs SET device = ?, progress = NULL, plan = NULL, warnings = '[]',
             passed_over = 0 WHERE id = ?",
    )
    .bind(asking.device)
    .bind(id.to_string())
    .execute(&mut *connection)
    .await?;
    append_state(connection, id, change.after, None, None).await?;
    let claim = Claim { job: id, fence: change.after.fence };
    Ok(Some((claim, expect(connection, id).await?)))
}

/// Writes a worker's report in a transaction of its own; whether the job is asked to end.
pub async fn report(
    connection: &mut SqliteConnection,
    claim: Claim,
    report: Report,
) -> Result<bool, StoreError> {
    let mut transaction = connection.begin_with("BEGIN IMMEDIATE").await?;
    let event = Event::Report { fence: claim.fence };
    let change = happens_to_held(&mut transaction, claim, event).await?;
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
        if seq % (MAX_PROGRESS_EVENTS / 8) == 0 {
            events::thin(&mut transaction, claim.job).await?;
        }
    }
    for (pictures, progress) in report.snapshots {
        let event = EventData::Snapshot(SnapshotEvent { pictures: pictures.clone(), progress });
        let seq = events::append(&mut transaction, claim.job, &event).await?;
        add_pictures(&mut transaction, claim.job, seq, &pictures).await?;
    }
    for notice in report.notices {
        events::append(&mut transaction, claim.job, &EventData::Notice(notice)).await?;
    }
    transaction.commit().await?;
    Ok(change.after.cancel_requested)
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
    let event = Event::Finish { fence: claim.fence, end: outcome.state };
    let change = happens_to_held(connection, claim, event).await?;
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
    let before = rows::job(&change.row)?;
    let pictures = match before.result {
        Some(earlier) if !outcome.is_better_than(before.stats.as_ref()) => earlier,
        _ => {
            sqlx::query("UPDATE jobs SET stats = ?, result = ?, result_of = ? WHERE id = ?")
                .bind(outcome.stats.as_ref().map(rows::to_json))
                .bind((!outcome.pictures.is_empty()).then(|| rows::to_json(&outcome.pictures)))
                .bind(outcome.result_of.map(|twin| twin.to_string()))
                .bind(claim.job.to_string())
                .execute(&mut *connection)
                .await?;
            outcome.pictures
        }
    };
    sqlx::query("UPDATE jobs SET error = ? WHERE id = ?")
        .bind(outcome.error.as_ref().map(rows::to_json))
        .bind(claim.job.to_string())
        .execute(&mut *connection)
        .await?;
    let event = EventData::State(StateEvent {
        state: outcome.state,
        attempts: change.after.attempts,
        reason: outcome.result_of.map(|twin| format!("shares the result of {twin}")),
        pictures: pictures.clone(),
        error: outcome.error,
    });
    let seq = events::append(connection, claim.job, &event).await?;
    // So that the newest picture is the result, whatever snapshots came after an earlier one.
    add_pictures(connection, claim.job, seq, &pictures).await
}

/// Takes a claim back: the job is queued again, cancelled if that was asked, or given up after
/// too many counted attempts, with all that happened.
pub async fn release(
    connection: &mut SqliteConnection,
    claim: Claim,
    event: Event,
    reason: &str,
) -> Result<(), StoreError> {
    let change = happens_to_held(connection, claim, event).await?;
    let counted = change.after.attempts == change.before.attempts;
    let mut mishaps: Vec<String> = rows::from_json("mishaps", change.row.get("mishaps"))?;
    if counted {
        mishaps.push(reason.to_owned());
    }
    let error = (change.after.state == JobState::Failed)
        .then(|| JobError { code: "poisoned".into(), detail: given_up(&mishaps) });
    let interrupted = change.after.interruptions > change.before.interruptions;
    let goes_last = interrupted && change.after.lets_others_go_first();
    sqlx::query(
        "UPDATE jobs SET error = ?, mishaps = ?,
             place = iif(?, (SELECT max(place) + 1 FROM jobs), place) WHERE id = ?",
    )
    .bind(error.as_ref().map(rows::to_json))
    .bind(rows::to_json(&mishaps))
    .bind(goes_last)
    .bind(claim.job.to_string())
    .execute(&mut *connection)
    .await?;
    append_state(connection, claim.job, change.after, Some(reason.to_owned()), error).await
}

fn given_up(mishaps: &[String]) -> String {
    let told: Vec<_> = (1..).zip(mishaps).map(|(n, what)| format!("attempt {n}: {what}")).collect();
    format!("given up after {} attempts; {}", mishaps.len(), told.join("; "))
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

async fn append_state(
    connection: &mut SqliteConnection,
    id: Uuid,
    life: Life,
    reason: Option<String>,
    error: Option<JobError>,
) -> Result<(), StoreError> {
    // An extension that ends without a picture leaves the earlier result, which is then the newest
    // picture again, whatever snapshots came after it.
    let result = match life.state.is_terminal() {
        true => get(connection, id).await?.and_then(|job| job.result).unwrap_or_default(),
        false => Vec::new(),
    };
    let event = EventData::State(StateEvent {
        state: life.state,
        attempts: life.attempts,
        reason,
        pictures: result.clone(),
        error,
    });
    let seq = events::append(connection, id, &event).await?;
    add_pictures(connection, id, seq, &result).await
}
