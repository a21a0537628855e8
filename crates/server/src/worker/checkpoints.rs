//! Checkpoints of jobs, as the server sees them: files that it keeps, what a job begins with, and
//! what is forgotten at the end.

use super::translation::to_solution;
use crate::api::jobs::Job;
use crate::api::solutions::{Begins, KeptFile, Solution};
use crate::artifacts::Content;
use crate::clock;
use crate::config::Config;
use crate::failpoints;
use crate::job_state::JobState;
use crate::shared::Shared;
use crate::store::{Claim, StoreError};
use hemilux_engine::checkpoint::Header;
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
    shared: &Shared,
    claim: Claim,
    header: Header,
    parts: Vec<Content>,
    turn: &Mutex<()>,
) -> Duration {
    let _turn = turn.lock().await;
    let began = Instant::now();
    let mut parts = parts.into_iter();
    let checkpoint = parts.next().unwrap_or_else(|| Vec::new().into());
    if let Err(error) = write(shared, claim, header, checkpoint, parts.next()).await {
        tracing::warn!(job = %claim.job, %error, "a checkpoint was lost");
    }
    began.elapsed()
}

async fn write(
    shared: &Shared,
    claim: Claim,
    header: Header,
    checkpoint: Content,
    glb: Option<Content>,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    // Never a name that was there before: what is recorded is never half of another.
    let name = Uuid::now_v7();
    let file = format!("{name}.checkpoint");
    let mut solution = to_solution(header, file, checkpoint.size()?);
    shared.artifacts.put_kept(claim.job, &solution.file, checkpoint).await?;
    if let Some(glb) = glb {
        let file = format!("{name}.glb");
        let (glb, size, sha256) = glb.hashed().await?;
        shared.artifacts.put_kept(claim.job, &file, glb).await?;
        solution.baked = Some(KeptFile { file, sha256, size });
    }
    let about = || format!("iteration {}", solution.iterations);
    failpoints::pass("checkpoint", about)?;
    match shared.store.keep_solution(claim, &solution).await {
        Ok(before) => {
            failpoints::pass("checkpoint-kept", about)?;
            if let Some(before) = before {
                remove(shared, claim.job, &before).await;
            }
            tracing::debug!(job = %claim.job, bytes = solution.size, "kept a checkpoint");
            Ok(())
        }
        Err(error) => {
            // Any other error leaves open whether the record names these files now; if it does
            // not, they go when the job begins again, or with the next sweep.
            if matches!(error, StoreError::ClaimLost(_)) {
                remove(shared, claim.job, &solution).await;
            }
            Err(error.into())
        }
    }
}

async fn remove(shared: &Shared, job: Uuid, solution: &Solution) {
    for file in solution.files() {
        if let Err(error) = shared.artifacts.remove_kept(job, file).await {
            tracing::warn!(%job, file, %error, "cannot remove a file");
        }
    }
}

/// How a job begins.
pub enum Start {
    /// With a checkpoint.
    With(Begins, Content),
    /// From nothing; where something should have been there, why it cannot be used.
    Afresh(Option<String>),
}

/// What a job begins with.
///
/// # Errors
/// Where the storage does not answer: to begin afresh would throw away, and then overwrite, what is
/// perhaps good.
pub async fn begin(shared: &Shared, job: &Job) -> Result<Start, String> {
    let recorded = match shared.store.solution(job.id).await {
        Err(error) if error.is_lasting() => return Ok(Start::Afresh(Some(error.to_string()))),
        recorded => recorded.map_err(|error| error.to_string())?,
    };
    let files: Vec<&str> = recorded.iter().flat_map(Solution::files).collect();
    if let Err(error) = shared.artifacts.tidy_kept(job.id, &files, clock::now()).await {
        tracing::warn!(job = %job.id, %error, "cannot tidy up");
    }
    let Some(solution) = recorded else { return Ok(Start::Afresh(None)) };
    match shared.artifacts.kept_file(job.id, &solution.file).await {
        Ok(checkpoint) => Ok(Start::With(solution.begins, checkpoint)),
        Err(error) if error.is_lasting() => Ok(Start::Afresh(Some(error.to_string()))),
        Err(error) => Err(error.to_string()),
    }
}

/// Forgets what an ended job knew, where nobody can go on from there or the operator doesn't want
/// it kept.
pub async fn settle(shared: &Shared, job: Uuid) {
    // An extension that failed goes on from here when it is tried again.
    let (ended, has_result) = match shared.store.job(job).await {
        Ok(Some(job)) if job.state.is_terminal() => (job.state, job.result.is_some()),
        _ => return,
    };
    if shared.config.keep_solutions_mb > 0 && (ended != JobState::Failed || has_result) {
        return;
    }
    match shared.store.drop_solution(job).await {
        Ok(Some(solution)) => remove(shared, job, &solution).await,
        Ok(None) => {}
        Err(error) => tracing::warn!(%job, %error, "cannot forget a checkpoint"),
    }
}
