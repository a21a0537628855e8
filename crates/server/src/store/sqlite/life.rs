//! What happens to jobs, written down as the state machine decides. Callers hold the transaction;
//! nothing here commits but [`report`], which has one of its own.

use super::jobs::{expect, get};
use super::time::now_ms;
use super::{claims, events, rows};
use crate::api::events::{EventData, ProgressEvent, SnapshotEvent, StateEvent};
use crate::api::jobs::{Job, JobError, JobRequest};
use crate::job_state::{Event, JobState, Life, Refusal};
use crate::store::{Asking, Claim, MAX_PROGRESS_EVENTS, Outcome, Report, StoreError};
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Connection, Row};
use uuid::Uuid;

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
    let row = rows::of_job(&mut *connection, "SELECT * FROM jobs WHERE id = ?", id).await?;
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
        events::append_state(connection, id, change.after, None, None).await?;
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
    events::append_state(
        connection,
        id,
        change.after,
        Some("it was given more budget".into()),
        None,
    )
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
                events::append_state(connection, id, change.after, reason, None).await?;
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
    events::append_state(connection, id, change.after, None, None).await?;
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
        events::add_pictures(&mut transaction, claim.job, seq, &pictures).await?;
    }
    for notice in report.notices {
        events::append(&mut transaction, claim.job, &EventData::Notice(notice)).await?;
    }
    transaction.commit().await?;
    Ok(change.after.cancel_requested)
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
    events::add_pictures(connection, claim.job, seq, &pictures).await
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
    events::append_state(connection, claim.job, change.after, Some(reason.to_owned()), error).await
}

fn given_up(mishaps: &[String]) -> String {
    let told: Vec<_> = (1..).zip(mishaps).map(|(n, what)| format!("attempt {n}: {what}")).collect();
    format!("given up after {} attempts; {}", mishaps.len(), told.join("; "))
}
