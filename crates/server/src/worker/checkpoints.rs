//! Checkpoints of jobs, as the server sees them: files that it keeps, what a job begins with, and
//! what is forgotten at the end.

use super::wire::Checkpointed;
use crate::api::jobs::Job;
use crate::api::solutions::{Begins, KeptFile, Solution};
use crate::artifacts::sha256_hex;
use crate::config::Config;
use crate::failpoints;
use crate::job_state::JobState;
use crate::service::Service;
use crate::store::Claim;
use bytes::Bytes;
use std::time::{Duration, Instant};
use tokio::sync::Mutex;
use uuid::Uuid;

/// Most bytes of checkpoints on the way, where none is kept beyond the end.
const UNKEPT_BYTES: u64 = 1 << 30;

/// Most bytes of a checkpoint.
pub fn most_bytes(config: &Config) -> u64 {
    match config.keep_solutions_mb {
        0 => UNKEPT_BYTES,
        most => most << 20,
    }
}

/// Keeps a checkpoint of a claimed job, and baked light with the last one, and removes the one
/// before; how long that took. `turn` puts those of a run in order.
pub async fn keep(
    service: &Service,
    claim: Claim,
    facts: Checkpointed,
    mut parts: Vec<Vec<u8>>,
    turn: &Mutex<()>,
) -> Duration {
    let _turn = turn.lock().await;
    let began = Instant::now();
    parts.truncate(2);
    let glb = if parts.len() == 2 { parts.pop() } else { None };
    let kept = write(service, claim, facts, parts.pop().unwrap_or_default(), glb).await;
    if let Err(error) = kept {
        tracing::warn!(job = %claim.job, %error, "a checkpoint was lost");
    }
    began.elapsed()
}

async fn write(
    service: &Service,
    claim: Claim,
    facts: Checkpointed,
    bytes: Vec<u8>,
    glb: Option<Vec<u8>>,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    // Never a name that was there before: what is recorded is never half of another.
    let name = Uuid::now_v7();
    let Checkpointed { method, iterations, seconds, estimated_error } = facts;
    let mut solution = Solution {
        file: format!("{name}.checkpoint"),
        size: bytes.len() as u64,
        begins: Begins::Continue,
        method,
        iterations,
        seconds,
        estimated_error,
        baked: None,
    };
    service.artifacts.put_kept(claim.job, &solution.file, bytes).await?;
    if let Some(glb) = glb {
        let (file, size) = (format!("{name}.glb"), glb.len() as u64);
        let (glb, sha256) = tokio::task::spawn_blocking(move || {
            let sha256 = sha256_hex(&glb);
            (glb, sha256)
        })
        .await?;
        service.artifacts.put_kept(claim.job, &file, glb).await?;
        solution.baked = Some(KeptFile { file, sha256, size });
    }
    let about = || format!("iteration {}", solution.iterations);
    failpoints::pass("checkpoint", about)?;
    match service.store.keep_solution(claim, &solution).await {
        Ok(before) => {
            failpoints::pass("checkpoint-kept", about)?;
            if let Some(before) = before {
                remove(service, claim.job, &before).await;
            }
            tracing::debug!(job = %claim.job, bytes = solution.size, "kept a checkpoint");
            Ok(())
        }
        Err(error) => {
            remove(service, claim.job, &solution).await;
            Err(error.into())
        }
    }
}

async fn remove(service: &Service, job: Uuid, solution: &Solution) {
    for file in solution.files() {
        if let Err(error) = service.artifacts.remove_kept(job, file).await {
            tracing::warn!(%job, file, %error, "cannot remove a file");
        }
    }
}

/// The checkpoint that a job begins with, if any; or why not, where it should.
pub async fn begin(service: &Service, job: &Job) -> Result<Option<(Begins, Bytes)>, String> {
    let solution = service.store.solution(job.id).await.map_err(|error| error.to_string())?;
    let recorded: Vec<&str> = solution.iter().flat_map(Solution::files).collect();
    if let Err(error) = service.artifacts.tidy_kept(job.id, &recorded).await {
        tracing::warn!(job = %job.id, %error, "cannot tidy up");
    }
    let Some(solution) = solution else { return Ok(None) };
    let bytes = service.artifacts.kept(job.id, &solution.file).await;
    let bytes = bytes.map_err(|error| error.to_string())?;
    Ok(Some((solution.begins, bytes)))
}

/// Forgets what an ended job knew, where nobody can go on from there or the operator doesn't want
/// it kept.
pub async fn settle(service: &Service, job: Uuid) {
    let ended = match service.store.job(job).await {
        Ok(Some(job)) if job.state.is_terminal() => job.state,
        _ => return,
    };
    if service.config.keep_solutions_mb > 0 && ended != JobState::Failed {
        return;
    }
    match service.store.drop_solution(job).await {
        Ok(Some(solution)) => remove(service, job, &solution).await,
        Ok(None) => {}
        Err(error) => tracing::warn!(%job, %error, "cannot forget a checkpoint"),
    }
}
