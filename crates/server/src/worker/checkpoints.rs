//! Checkpoints of jobs, as the server sees them: files that it keeps, what a job begins with, and
//! what is forgotten at the end.

use super::wire::Checkpointed;
use crate::api::jobs::Job;
use crate::api::solutions::{Begins, KeptFile, Solution};
use crate::artifacts::{ArtifactError, sha256_hex};
use crate::config::Config;
use crate::failpoints;
use crate::job_state::JobState;
use crate::service::Service;
use crate::store::Claim;
use bytes::Bytes;
use hemilux_engine::checkpoint::Checkpoint;
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

/// How a job begins.
pub enum Start {
    /// With a checkpoint.
    With(Begins, Bytes),
    /// From nothing; where something should have been there, why it cannot be used.
    Afresh(Option<String>),
}

/// What a job begins with.
///
/// # Errors
/// Where the storage does not answer: to begin afresh would throw away, and then overwrite, what is
/// perhaps good.
pub async fn begin(service: &Service, job: &Job) -> Result<Start, String> {
    let recorded = match service.store.solution(job.id).await {
        Err(error) if error.is_lasting() => return Ok(Start::Afresh(Some(error.to_string()))),
        recorded => recorded.map_err(|error| error.to_string())?,
    };
    let files: Vec<&str> = recorded.iter().flat_map(Solution::files).collect();
    if let Err(error) = service.artifacts.tidy_kept(job.id, &files).await {
        tracing::warn!(job = %job.id, %error, "cannot tidy up");
    }
    let Some(solution) = recorded else { return Ok(Start::Afresh(None)) };
    match read(service, job.id, &solution.file).await {
        Ok(bytes) => Ok(Start::With(solution.begins, bytes)),
        Err(error) if error.is_lasting() => Ok(Start::Afresh(Some(error.to_string()))),
        Err(error) => Err(error.to_string()),
    }
}

/// A checkpoint's bytes. What looks damaged is read once more, since it will be overwritten if it is
/// so; the executor tells what is wrong with it.
async fn read(service: &Service, job: Uuid, file: &str) -> Result<Bytes, ArtifactError> {
    let bytes = service.artifacts.kept(job, file).await?;
    let content = bytes.clone();
    let checked = tokio::task::spawn_blocking(move || Checkpoint::from_bytes(&content).is_ok());
    match checked.await {
        Ok(true) => Ok(bytes),
        _ => service.artifacts.kept(job, file).await,
    }
}

/// Forgets what an ended job knew, where nobody can go on from there or the operator doesn't want
/// it kept.
pub async fn settle(service: &Service, job: Uuid) {
    // An extension that failed goes on from here when it is tried again.
    let (ended, has_result) = match service.store.job(job).await {
        Ok(Some(job)) if job.state.is_terminal() => (job.state, job.result.is_some()),
        _ => return,
    };
    if service.config.keep_solutions_mb > 0 && (ended != JobState::Failed || has_result) {
        return;
    }
    match service.store.drop_solution(job).await {
        Ok(Some(solution)) => remove(service, job, &solution).await,
        Ok(None) => {}
        Err(error) => tracing::warn!(%job, %error, "cannot forget a checkpoint"),
    }
}
