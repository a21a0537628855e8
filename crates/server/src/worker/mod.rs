//! One worker per device of the pool, each drawing jobs from the queue. This is where the service
//! meets the engine.
//!
//! Two sides, and a line between them. The server's: [`job`] takes an attempt from claim to record,
//! [`watch`] follows it. The engine's: [`perform`] runs tasks on a device, in a thread or, by way of
//! [`process`] and [`child`], in a process of the device's own, and [`encode`]s the pictures there.
//! [`wire`] is what they say, [`translation`] turns the API's words into the engine's and back;
//! [`executor`] hides whether it is a thread or a process. [`requests`] asks the engine about jobs
//! before they run. [`import`] looks at uploaded scenes, each in a process of its own.

mod checkpoints;
pub mod child;
pub mod devices;
mod encode;
mod executor;
pub mod import;
mod job;
mod pacing;
mod perform;
mod process;
mod requests;
pub mod scenes;
mod shelf;
mod snapshots;
pub mod threads;
mod translation;
mod watch;
mod wire;

pub use process::use_program;
pub use requests::{
    METHODS, listed_settings, method_problems, needed_bytes, public_settings, request_problem,
    settings_in_force, without_idle_settings,
};

use crate::api::DeviceStatus;
use crate::api::jobs::Job;
use crate::config::Isolation;
use crate::shared::Shared;
use crate::trace_context::TraceParent;
use executor::Executor;
use std::sync::Arc;
use std::time::Duration;
use tracing::Instrument;
use tracing::field::Empty;

/// Longest wait before a device that does not open is tried again.
const MAX_BACKOFF: Duration = Duration::from_secs(30);

/// The threads of a pool.
pub struct Workers {
    ended: Vec<tokio::sync::oneshot::Receiver<()>>,
}

impl Workers {
    /// Waits until every worker has stopped.
    pub async fn joined(self) {
        for ended in self.ended {
            // An error means that the thread is gone, which is as good.
            let _ = ended.await;
        }
    }
}

/// Starts a worker for each device of the service's pool.
///
/// # Errors
/// Where the system gives no thread.
pub fn start(shared: &Arc<Shared>) -> std::io::Result<Workers> {
    let runtime = tokio::runtime::Handle::current();
    let mut ended = Vec::new();
    for device in shared.pool.devices().into_iter().filter(|device| device.in_pool) {
        let (shared, runtime) = (shared.clone(), runtime.clone());
        let (on_end, end) = tokio::sync::oneshot::channel();
        std::thread::Builder::new().name(format!("device {}", device.id)).spawn(move || {
            runtime.block_on(work(&shared, &device.id));
            let _ = on_end.send(());
        })?;
        ended.push(end);
    }
    Ok(Workers { ended })
}

/// A worker's life: open the device, run jobs on it, open it again where a job broke it.
async fn work(shared: &Arc<Shared>, id: &str) {
    let mut backoff = Duration::from_secs(1);
    while !shared.shutdown.is_cancelled() {
        shared.pool.set(id, DeviceStatus::Opening, None, None);
        match open(shared, id).await {
            Ok(mut executor) => {
                backoff = Duration::from_secs(1);
                if let Err(fault) = run_jobs(shared, id, &mut executor).await {
                    tracing::warn!(device = id, fault, "opens the device again");
                    shared.pool.restarted(id, &fault);
                }
            }
            Err(error) => {
                tracing::error!(device = id, %error, "cannot open the device");
                shared.pool.set(id, DeviceStatus::Failed, None, Some(error));
                tokio::select! {
                    () = tokio::time::sleep(backoff) => {}
                    () = shared.shutdown.cancelled() => {}
                }
                backoff = (2 * backoff).min(MAX_BACKOFF);
            }
        }
    }
}

/// The span of an attempt, part of the trace of the request that asked for the job.
async fn job_span(shared: &Shared, device: &str, job: &Job) -> tracing::Span {
    let attempt = job.attempts;
    let span = tracing::info_span!("job", id = %job.id, attempt, device, trace_id = Empty);
    let parent = shared.store.trace_parent(job.id).await;
    let parent = parent.ok().flatten().and_then(|text| TraceParent::parse(&text));
    if let Some(parent) = parent {
        span.record("trace_id", parent.trace_id());
        crate::telemetry::continue_trace(&span, &parent);
    }
    span
}

/// Starts an executor and waits until its device is open.
async fn open(shared: &Shared, id: &str) -> Result<Executor, String> {
    let mut executor =
        Executor::start(id, &shared.config).map_err(|error| format!("no executor: {error}"))?;
    let patience = Duration::from_secs_f64(shared.config.no_progress_s);
    let said = tokio::select! {
        said = executor.hear() => said,
        () = tokio::time::sleep(patience) => {
            executor.kill();
            return Err(format!("it did not open within {} s", patience.as_secs_f64()));
        }
        () = shared.shutdown.cancelled() => return Err("the server shuts down".into()),
    };
    match said.map(|message| message.header) {
        Some(wire::ExecutorEvent::Ready) => Ok(executor),
        Some(wire::ExecutorEvent::NoDevice { error }) => Err(error),
        Some(other) => Err(format!("it said {other:?} before it was ready")),
        None => Err(executor.end().how),
    }
}

/// Runs jobs until shutdown, or until the device must be opened again: why.
async fn run_jobs(shared: &Arc<Shared>, id: &str, executor: &mut Executor) -> Result<(), String> {
    let own_process = shared.config.isolation == Isolation::Process;
    loop {
        shared.pool.set(id, DeviceStatus::Idle, None, None);
        let next = tokio::select! {
            biased;
            () = shared.shutdown.cancelled() => return Ok(()),
            next = shared.queue.next(id, own_process, &shared.disk) => next,
        };
        let (claim, job) = next;
        if executor.is_gone() {
            // It ended while it had nothing to do: not this job's fault.
            let fault = executor.end().how;
            job::hand_back(shared, claim, fault.clone()).await;
            return Err(fault);
        }
        shared.pool.set(id, DeviceStatus::Busy, Some(job.id), None);
        shared.metrics.count_wait(job.timings.queued_s);
        let span = job_span(shared, id, &job).await;
        let ran = job::run(shared, executor, claim, &job).instrument(span).await;
        shared.bell.ring(job.id);
        ran?;
    }
}
