//! Checkpoints of running jobs: when one is taken, where it goes, and what a job begins with.

use crate::api::jobs::Job;
use crate::api::solutions::{Begins, KeptFile, Solution};
use crate::artifacts::sha256_hex;
use crate::config::Config;
use crate::job_state::JobState;
use crate::service::Service;
use crate::store::Claim;
use hemilux_engine::checkpoint::Checkpoint;
use hemilux_engine::render::Begin;
use hemilux_engine::scene::gltf::BakedMesh;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tokio::sync::Mutex;
use uuid::Uuid;

/// Taking and writing a checkpoint may cost this share of the time.
const SHARE: f64 = 0.02;

/// Most bytes of checkpoints on the way, where none is kept beyond the end.
const UNKEPT_BYTES: u64 = 1 << 30;

/// What is to be kept at the end of an attempt.
pub struct Ending {
    /// All that the method knows.
    pub checkpoint: Checkpoint,
    /// The light of the surfaces.
    pub baked: Option<BakedMesh>,
}

/// What writers tell the one who decides when to take the next.
#[derive(Default)]
pub struct Costs {
    /// Whether one is being written.
    writing: AtomicBool,
    /// What the last one took to write, µs.
    micros: AtomicU64,
    /// One after the other, so that the latest is what stays.
    turn: Mutex<()>,
}

/// Decides when to take checkpoints: not too seldom, and not so often that it costs.
pub struct Pacing {
    every: Option<Duration>,
    /// Most bytes of one.
    pub most_bytes: u64,
    /// Whether what is known at the end is kept, too.
    pub keeps_solutions: bool,
    since: Instant,
    /// When the one under way was asked for.
    asked: Option<Instant>,
    /// What the last one took to make.
    making: Duration,
    /// What writers say.
    pub costs: Arc<Costs>,
}

impl Pacing {
    /// As the operator set it.
    pub fn new(config: &Config) -> Self {
        let every = config.checkpoint_every_s;
        Self {
            every: (every > 0.0).then(|| Duration::from_secs_f64(every)),
            most_bytes: match config.keep_solutions_mb {
                0 => UNKEPT_BYTES,
                most => most << 20,
            },
            keeps_solutions: config.keep_solutions_mb > 0,
            since: Instant::now(),
            asked: None,
            making: Duration::ZERO,
            costs: Arc::default(),
        }
    }

    /// Whether to take one now.
    pub fn is_due(&mut self) -> bool {
        let Some(every) = self.every else { return false };
        if self.costs.writing.load(Ordering::Acquire) {
            return false;
        }
        let writing = Duration::from_micros(self.costs.micros.load(Ordering::Relaxed));
        let pause = every.max((self.making + writing).div_f64(SHARE));
        let due = self.since.elapsed() >= pause;
        if due {
            self.asked = Some(Instant::now());
            self.since = Instant::now();
        }
        due
    }

    /// One was made; whether it was asked for by [`Pacing::is_due`], rather than at the end.
    pub fn made(&mut self) -> bool {
        let Some(asked) = self.asked.take() else { return false };
        self.making = asked.elapsed();
        self.since = Instant::now();
        self.costs.writing.store(true, Ordering::Release);
        true
    }
}

/// Writes a checkpoint of a claimed job, and removes the one before.
///
/// # Errors
/// Where the storage fails, or the claim is over.
pub async fn keep(
    service: &Service,
    claim: Claim,
    checkpoint: Checkpoint,
    baked: Option<BakedMesh>,
    costs: &Costs,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let _turn = costs.turn.lock().await;
    let began = Instant::now();
    let kept = write(service, claim, checkpoint, baked).await;
    costs.micros.store(began.elapsed().as_micros() as u64, Ordering::Relaxed);
    costs.writing.store(false, Ordering::Release);
    kept
}

async fn write(
    service: &Service,
    claim: Claim,
    checkpoint: Checkpoint,
    baked: Option<BakedMesh>,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let header = checkpoint.header().clone();
    let (bytes, baked) = tokio::task::spawn_blocking(move || {
        let baked = baked.map(|mesh| mesh.to_glb()).map(|glb| (sha256_hex(&glb), glb));
        (checkpoint.to_bytes(), baked)
    })
    .await?;
    // Never a name that was there before: what is recorded is never half of another.
    let name = Uuid::now_v7();
    let mut solution = Solution {
        file: format!("{name}.checkpoint"),
        size: bytes.len() as u64,
        begins: Begins::Continue,
        method: header.method,
        iterations: header.iterations,
        seconds: header.seconds,
        estimated_error: header.estimated_error.filter(|error| error.is_finite()),
        baked: None,
    };
    service.artifacts.put_kept(claim.job, &solution.file, bytes).await?;
    if let Some((sha256, glb)) = baked {
        let (file, size) = (format!("{name}.glb"), glb.len() as u64);
        service.artifacts.put_kept(claim.job, &file, glb).await?;
        solution.baked = Some(KeptFile { file, sha256, size });
    }
    match service.store.keep_solution(claim, &solution).await {
        Ok(before) => {
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

/// What a job begins with, and why not with what it should, if so.
pub async fn begin(service: &Service, job: &Job) -> (Begin, Option<String>) {
    let solution = match service.store.solution(job.id).await {
        Ok(Some(solution)) => solution,
        Ok(None) => return (Begin::Afresh, None),
        Err(error) => return (Begin::Afresh, Some(error.to_string())),
    };
    let bytes = match service.artifacts.kept(job.id, &solution.file).await {
        Ok(bytes) => bytes,
        Err(error) => return (Begin::Afresh, Some(error.to_string())),
    };
    let read = tokio::task::spawn_blocking(move || Checkpoint::from_bytes(&bytes)).await;
    match read {
        Ok(Ok(checkpoint)) => {
            let checkpoint = Arc::new(checkpoint);
            let begin = match solution.begins {
                Begins::Continue => Begin::Continue(checkpoint),
                Begins::View => Begin::View(checkpoint),
            };
            (begin, None)
        }
        Ok(Err(error)) => (Begin::Afresh, Some(error.to_string())),
        Err(error) => (Begin::Afresh, Some(error.to_string())),
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn pacing(every_s: f64) -> Pacing {
        Pacing {
            every: Some(Duration::from_secs_f64(every_s)),
            most_bytes: 1,
            keeps_solutions: true,
            since: Instant::now(),
            asked: None,
            making: Duration::ZERO,
            costs: Arc::default(),
        }
    }

    #[test]
    fn checkpoints_are_neither_crowded_nor_dear() {
        let mut pacing = pacing(0.03);
        assert!(!pacing.is_due(), "not at once");
        std::thread::sleep(Duration::from_millis(40));
        assert!(pacing.is_due());
        assert!(pacing.made());
        std::thread::sleep(Duration::from_millis(40));
        assert!(!pacing.is_due(), "the last one is still being written");
        pacing.costs.writing.store(false, Ordering::Release);
        assert!(pacing.is_due());
        pacing.made();
        pacing.costs.writing.store(false, Ordering::Release);
        pacing.costs.micros.store(10_000_000, Ordering::Relaxed);
        std::thread::sleep(Duration::from_millis(40));
        assert!(!pacing.is_due(), "ten seconds of writing are for five hundred of work");
        assert!(!pacing.made(), "at the end nobody asked");
    }
}
