//! Whose turn it is: which of the waiting jobs a worker gets.
//!
//! Higher priority goes first. Within one, those who pay for jobs take turns: who had none for
//! longest gets the next, however many jobs the others have waiting. Of one payer's jobs the first
//! by place is taken. Only the store's own counters decide, no clock.
//!
//! Who comes, or comes back after they were forgotten, goes before the one who had the last turn and
//! behind all others who wait: so a payer waits for as many turns as there are payers, however many
//! new ones come.

use super::rows;
use crate::store::{Asking, StoreError};
use sqlx::Row;
use sqlx::sqlite::SqliteConnection;
use std::collections::HashMap;
use uuid::Uuid;

/// Jobs that may be claimed before one that must run alone, while others run; then nothing is
/// claimed until it can.
const MOST_PASSED_OVER: i64 = 16;
/// Turns after which those are forgotten who have no more jobs here.
const TURNS_BETWEEN_TIDYING: i64 = 64;

/// What the running jobs mean for the waiting ones.
#[derive(Default)]
struct Running {
    jobs: u64,
    any_alone: bool,
    by_payer: HashMap<String, i64>,
    /// JSON list of render keys: identical jobs wait for the result.
    render_keys: String,
}

/// A waiting job.
struct Candidate {
    id: Uuid,
    runs_alone: bool,
    passed_over: i64,
}

/// The next job that may be claimed, chosen as the module says. It passes over the jobs of payers of
/// whom as many run as may, jobs that pause, and a job whose identical twin runs now. A job that runs
/// alone waits until nothing runs.
pub async fn next(
    connection: &mut SqliteConnection,
    asking: &Asking<'_>,
) -> Result<Option<Uuid>, StoreError> {
    let running = running(connection).await?;
    if running.any_alone {
        return Ok(None);
    }
    let paused: Vec<String> = asking.paused.iter().map(Uuid::to_string).collect();
    let paused = rows::to_json(&paused);
    let mut passed_over = None;
    let mut below = i64::MAX;
    while let Some(priority) = highest_priority(connection, below).await? {
        for payer in payers(connection, priority).await? {
            let running_of_payer = running.by_payer.get(&payer).copied().unwrap_or(0);
            if running_of_payer > 0 && is_at_its_limit(connection, &payer, running_of_payer).await?
            {
                continue;
            }
            let mut look = First {
                running: &running,
                priority,
                payer: &payer,
                paused: &paused,
                with_alone: true,
            };
            let mut found = look.find(connection).await?;
            if let Some(alone) = found.as_ref().filter(|job| job.runs_alone && running.jobs > 0) {
                if alone.passed_over >= MOST_PASSED_OVER {
                    return Ok(None);
                }
                passed_over = passed_over.or(Some(alone.id));
                look.with_alone = false;
                found = look.find(connection).await?;
            }
            if let Some(job) = found {
                if let Some(other) = passed_over {
                    pass_over(connection, other).await?;
                }
                take_turn(connection, &payer).await?;
                return Ok(Some(job.id));
            }
        }
        below = priority;
    }
    Ok(None)
}

async fn running(connection: &mut SqliteConnection) -> Result<Running, StoreError> {
    let found = sqlx::query(
        "SELECT billed_to, render_key, runs_alone FROM jobs
         WHERE state = 'running' AND deleted_ms IS NULL",
    )
    .fetch_all(connection)
    .await?;
    let mut running = Running { jobs: found.len() as u64, ..Running::default() };
    let mut keys = Vec::new();
    for row in found {
        running.any_alone |= row.get::<bool, _>("runs_alone");
        *running.by_payer.entry(row.get("billed_to")).or_default() += 1;
        keys.extend(row.get::<Option<String>, _>("render_key"));
    }
    running.render_keys = rows::to_json(&keys);
    Ok(running)
}

/// The highest priority of waiting jobs that is below another. (SQLite would count through all of
/// them by their state, were the index not named.)
async fn highest_priority(
    connection: &mut SqliteConnection,
    below: i64,
) -> Result<Option<i64>, StoreError> {
    let row = sqlx::query(
        "SELECT max(priority) AS priority FROM jobs INDEXED BY jobs_queue
         WHERE state = 'queued' AND deleted_ms IS NULL AND priority < ?",
    )
    .bind(below)
    .fetch_one(connection)
    .await?;
    Ok(row.get("priority"))
}

/// Those who have jobs of that priority waiting, in the order of their turns. The index is asked
/// once for each of them, not for each of their jobs.
async fn payers(
    connection: &mut SqliteConnection,
    priority: i64,
) -> Result<Vec<String>, StoreError> {
    let found = sqlx::query(
        "WITH RECURSIVE payers (payer) AS (
             SELECT min(billed_to) FROM jobs INDEXED BY jobs_queue
             WHERE state = 'queued' AND deleted_ms IS NULL AND priority = ?1
             UNION ALL
             SELECT (SELECT min(billed_to) FROM jobs INDEXED BY jobs_queue
                     WHERE state = 'queued' AND deleted_ms IS NULL AND priority = ?1
                       AND billed_to > payers.payer)
             FROM payers WHERE payers.payer IS NOT NULL)
         SELECT payer,
                coalesce((SELECT last FROM turns WHERE turns.payer = payers.payer), 0) AS last,
                (SELECT min(place) FROM jobs INDEXED BY jobs_queue
                 WHERE state = 'queued' AND deleted_ms IS NULL
                   AND priority = ?1 AND billed_to = payers.payer) AS first
         FROM payers WHERE payer IS NOT NULL ORDER BY last, first",
    )
    .bind(priority)
    .fetch_all(connection)
    .await?;
    Ok(found.iter().map(|row| row.get("payer")).collect())
}

/// Whether so many running jobs are as many as any waiting job of the payer allows: asked before
/// looking through those jobs, which may be many.
async fn is_at_its_limit(
    connection: &mut SqliteConnection,
    payer: &str,
    running: i64,
) -> Result<bool, StoreError> {
    let row = sqlx::query(
        "SELECT NOT EXISTS (SELECT 1 FROM jobs WHERE billed_to = ?1 AND max_running IS NULL
                              AND state = 'queued' AND deleted_ms IS NULL)
            AND NOT EXISTS (SELECT 1 FROM jobs WHERE billed_to = ?1 AND max_running > ?2
                              AND state = 'queued' AND deleted_ms IS NULL) AS at_limit",
    )
    .bind(payer)
    .bind(running)
    .fetch_one(connection)
    .await?;
    Ok(row.get("at_limit"))
}

/// The first job of a payer and priority that may run now.
struct First<'a> {
    running: &'a Running,
    priority: i64,
    payer: &'a str,
    /// JSON list of ids.
    paused: &'a str,
    /// Whether jobs count that run alone.
    with_alone: bool,
}

impl First<'_> {
    async fn find(
        &self,
        connection: &mut SqliteConnection,
    ) -> Result<Option<Candidate>, StoreError> {
        let row = sqlx::query(
            "SELECT id, runs_alone, passed_over FROM jobs INDEXED BY jobs_queue
             WHERE state = 'queued' AND deleted_ms IS NULL AND priority = ?1 AND billed_to = ?2
               AND (max_running IS NULL OR max_running > ?3)
               AND (render_key IS NULL
                    OR render_key NOT IN (SELECT value FROM json_each(?4)))
               AND id NOT IN (SELECT value FROM json_each(?5))
               AND (?6 OR NOT runs_alone)
             ORDER BY place LIMIT 1",
        )
        .bind(self.priority)
        .bind(self.payer)
        .bind(self.running.by_payer.get(self.payer).copied().unwrap_or(0))
        .bind(&self.running.render_keys)
        .bind(self.paused)
        .bind(self.with_alone)
        .fetch_optional(connection)
        .await?;
        let Some(row) = row else { return Ok(None) };
        Ok(Some(Candidate {
            id: rows::parse_id(row.get("id"))?,
            runs_alone: row.get("runs_alone"),
            passed_over: row.get("passed_over"),
        }))
    }
}

/// Another job goes before one that must run alone.
async fn pass_over(connection: &mut SqliteConnection, job: Uuid) -> Result<(), StoreError> {
    sqlx::query("UPDATE jobs SET passed_over = passed_over + 1 WHERE id = ?")
        .bind(job.to_string())
        .execute(connection)
        .await?;
    Ok(())
}

/// Writes down that a payer has jobs, unless that is known. Turns have even numbers, so that there is
/// a place just before the last one.
pub async fn join(connection: &mut SqliteConnection, payer: &str) -> Result<(), StoreError> {
    sqlx::query(
        "INSERT INTO turns (payer, last)
         VALUES (?, (SELECT max(coalesce(max(last), 0) / 2 * 2 - 1, 0) FROM turns))
         ON CONFLICT DO NOTHING",
    )
    .bind(payer)
    .execute(connection)
    .await?;
    Ok(())
}

/// Writes down that a payer has its turn now, and forgets those who have no jobs any more.
async fn take_turn(connection: &mut SqliteConnection, payer: &str) -> Result<(), StoreError> {
    let row = sqlx::query(
        "INSERT INTO turns (payer, last)
         VALUES (?, (SELECT coalesce(max(last), 0) / 2 * 2 + 2 FROM turns))
         ON CONFLICT (payer) DO UPDATE SET last = excluded.last RETURNING last",
    )
    .bind(payer)
    .fetch_one(&mut *connection)
    .await?;
    if row.get::<i64, _>("last") / 2 % TURNS_BETWEEN_TIDYING == 0 {
        sqlx::query(
            "DELETE FROM turns WHERE payer <> ? AND NOT EXISTS (
                 SELECT 1 FROM jobs WHERE billed_to = turns.payer
                   AND state IN ('queued', 'running') AND deleted_ms IS NULL)",
        )
        .bind(payer)
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}
