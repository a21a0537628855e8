//! The pool: one worker per device, each drawing jobs from the queue. This is where the service
//! meets the engine.
//!
//! Two sides, and a line between them. The server's: [`job`] takes an attempt from claim to record,
//! [`watch`] follows it. The engine's: [`perform`] runs tasks on a device, in a thread or, by way of
//! [`process`] and [`child`], in a process of the device's own, and [`encode`]s the pictures there.
//! [`wire`] is what they say;
//! [`executor`] hides which of the two it is. [`import`] looks at uploaded scenes, each in a
//! process of its own.

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
pub mod scenes;
mod snapshots;
mod threads;
mod watch;
mod wire;

pub use process::use_program;

use crate::api::jobs::{Job, JobRequest, OptionValue};
use crate::api::limits::{OptionWord, Vocabulary};
use crate::api::{DeviceStatus, DeviceView, FieldError};
use crate::config::Isolation;
use crate::service::Service;
use crate::trace_context::TraceParent;
use executor::Executor;
use hemilux_engine::render::{Begin, Limits, RenderError, RenderRequest};
use hemilux_engine::transport::{self, METHODS, OPTIONS};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tracing::Instrument;
use tracing::field::Empty;
use uuid::Uuid;

/// Longest wait before a device that does not open is tried again.
const MAX_BACKOFF: Duration = Duration::from_secs(30);

/// A setting whose default is only one of the values that it may have where it is not given.
const BY_LIMITS: &str = "pixel_samples";

/// What the engine can be asked for by name.
pub fn vocabulary() -> Vocabulary {
    Vocabulary {
        methods: METHODS.to_vec(),
        options: OPTIONS
            .iter()
            .map(|option| OptionWord {
                name: option.name,
                default: option.default,
                meaning: option.meaning,
            })
            .collect(),
    }
}

/// The settings in force that a job's own stand for, by name and as text: presets and defaults
/// filled in. Jobs that say the same in other words have the same; `None` where they say something
/// that is refused.
pub fn settings_in_force(
    options: &BTreeMap<String, OptionValue>,
) -> Option<BTreeMap<String, String>> {
    let given = perform::options(options);
    let mut values = transport::settings(&given).ok()?.values().clone();
    // Unless it is given, this one goes by the limits rather than by its default.
    if !given.contains_key(BY_LIMITS) {
        values.remove(BY_LIMITS);
    }
    Some(values)
}

/// What the engine would refuse of a job, whatever its scene: the engine's own check, asked before
/// the job is accepted.
pub fn request_problem(job: &JobRequest) -> Option<FieldError> {
    let request = RenderRequest {
        scene: Arc::default(),
        camera: perform::camera(job.camera.as_ref()),
        width: job.width,
        height: job.height,
        method: job.method.clone(),
        limits: Limits {
            seconds: job.time_budget_s,
            iterations: job.max_iterations,
            target_error: job.target_error,
            cap_seconds: None,
        },
        seed: job.seed,
        options: perform::options(&job.options),
        begin: Begin::Afresh,
    };
    match transport::check(&request).err()? {
        RenderError::Parameter { parameter, what } => {
            let field = match parameter.as_str() {
                "seconds" => "time_budget_s",
                "iterations" => "max_iterations",
                _ => &parameter,
            };
            Some(FieldError::new(field, what))
        }
        error => Some(FieldError::new("options", error.to_string())),
    }
}

/// Memory that a job needs at least, bytes, by the estimate of its method; `None` where the request
/// cannot be understood.
pub fn needed_bytes(job: &JobRequest, triangles: u64) -> Option<u64> {
    let options = job.options.iter().map(|(name, value)| (name.clone(), value.to_string()));
    let size = [job.width, job.height];
    transport::needed_bytes(&job.method, &options.collect(), triangles, size).ok()?
}

/// What the devices do, for whoever asks.
pub struct Pool {
    devices: Mutex<Vec<Member>>,
    /// Threads that the jobs of each device compute with.
    threads: BTreeMap<String, usize>,
}

/// A device of this machine.
struct Member {
    view: DeviceView,
    /// Whether another one was busy at any time of its present job.
    has_company: bool,
}

impl Pool {
    /// A pool of the devices with these ids, all still to be opened, which share so many threads;
    /// without a number, as many as this process may use.
    pub fn new(ids: &[String], threads: Option<usize>) -> Self {
        let mut devices = devices::list();
        for device in &mut devices {
            device.in_pool = ids.contains(&device.id);
            device.status = device.in_pool.then_some(DeviceStatus::Opening);
        }
        let budget = threads.unwrap_or_else(threads::available);
        let shares = threads::shares(budget, ids.len());
        let threads = ids.iter().cloned().zip(shares).collect();
        Self { threads, ..Self::of(devices) }
    }

    fn of(devices: Vec<DeviceView>) -> Self {
        let members = devices.into_iter().map(|view| Member { view, has_company: false });
        Self { devices: Mutex::new(members.collect()), threads: BTreeMap::new() }
    }

    /// Threads that a job on that device computes with.
    pub fn threads_of(&self, device: Option<&str>) -> usize {
        device.and_then(|id| self.threads.get(id)).copied().unwrap_or(1)
    }

    /// All devices as they are now.
    pub fn devices(&self) -> Vec<DeviceView> {
        self.lock().iter().map(|device| device.view.clone()).collect()
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Member>> {
        self.devices.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, id: &str, status: DeviceStatus, job: Option<Uuid>, error: Option<String>) {
        let mut devices = self.lock();
        if let Some(device) = devices.iter_mut().find(|device| device.view.id == id) {
            device.view.status = Some(status);
            device.view.job = job;
            device.view.error = error;
            device.has_company = false;
        }
        let busy = |device: &Member| device.view.status == Some(DeviceStatus::Busy);
        if devices.iter().filter(|device| busy(device)).count() > 1 {
            devices.iter_mut().filter(|device| busy(device)).for_each(|d| d.has_company = true);
        }
    }

    /// Whether the present job of a device was the only one of the pool from its beginning on.
    fn was_alone(&self, id: &str) -> bool {
        !self.lock().iter().any(|device| device.view.id == id && device.has_company)
    }

    /// The device had to be opened again.
    fn restarted(&self, id: &str, fault: &str) {
        if let Some(device) = self.lock().iter_mut().find(|device| device.view.id == id) {
            device.view.restarts += 1;
            device.view.last_fault = Some(fault.to_owned());
        }
    }
}

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
pub fn start(service: &Arc<Service>) -> std::io::Result<Workers> {
    let runtime = tokio::runtime::Handle::current();
    let mut ended = Vec::new();
    for device in service.pool.devices().into_iter().filter(|device| device.in_pool) {
        let (service, runtime) = (service.clone(), runtime.clone());
        let (on_end, end) = tokio::sync::oneshot::channel();
        std::thread::Builder::new().name(format!("device {}", device.id)).spawn(move || {
            runtime.block_on(work(&service, &device.id));
            let _ = on_end.send(());
        })?;
        ended.push(end);
    }
    Ok(Workers { ended })
}

/// A worker's life: open the device, run jobs on it, open it again where a job broke it.
async fn work(service: &Arc<Service>, id: &str) {
    let mut backoff = Duration::from_secs(1);
    while !service.shutdown.is_cancelled() {
        service.pool.set(id, DeviceStatus::Opening, None, None);
        match open(service, id).await {
            Ok(mut executor) => {
                backoff = Duration::from_secs(1);
                if let Err(fault) = run_jobs(service, id, &mut executor).await {
                    tracing::warn!(device = id, fault, "opens the device again");
                    service.pool.restarted(id, &fault);
                }
            }
            Err(error) => {
                tracing::error!(device = id, %error, "cannot open the device");
                service.pool.set(id, DeviceStatus::Failed, None, Some(error));
                tokio::select! {
                    () = tokio::time::sleep(backoff) => {}
                    () = service.shutdown.cancelled() => {}
                }
                backoff = (2 * backoff).min(MAX_BACKOFF);
            }
        }
    }
}

/// The span of an attempt, part of the trace of the request that asked for the job.
async fn job_span(service: &Service, device: &str, job: &Job) -> tracing::Span {
    let attempt = job.attempts;
    let span = tracing::info_span!("job", id = %job.id, attempt, device, trace_id = Empty);
    let parent = service.store.trace_parent(job.id).await;
    let parent = parent.ok().flatten().and_then(|text| TraceParent::parse(&text));
    if let Some(parent) = parent {
        span.record("trace_id", parent.trace_id());
        crate::telemetry::continue_trace(&span, &parent);
    }
    span
}

/// Starts an executor and waits until its device is open.
async fn open(service: &Service, id: &str) -> Result<Executor, String> {
    let mut executor =
        Executor::start(id, &service.config).map_err(|error| format!("no executor: {error}"))?;
    let patience = Duration::from_secs_f64(service.config.no_progress_s);
    let said = tokio::select! {
        said = executor.hear() => said,
        () = tokio::time::sleep(patience) => {
            executor.kill();
            return Err(format!("it did not open within {} s", patience.as_secs_f64()));
        }
        () = service.shutdown.cancelled() => return Err("the server shuts down".into()),
    };
    match said.map(|message| message.header) {
        Some(wire::Said::Ready) => Ok(executor),
        Some(wire::Said::NoDevice { error }) => Err(error),
        Some(other) => Err(format!("it said {other:?} before it was ready")),
        None => Err(executor.epitaph().how),
    }
}

/// Runs jobs until shutdown, or until the device must be opened again: why.
async fn run_jobs(service: &Arc<Service>, id: &str, executor: &mut Executor) -> Result<(), String> {
    let own_process = service.config.isolation == Isolation::Process;
    loop {
        service.pool.set(id, DeviceStatus::Idle, None, None);
        let next = tokio::select! {
            biased;
            () = service.shutdown.cancelled() => return Ok(()),
            next = service.queue.next(id, own_process, &service.disk) => next,
        };
        let (claim, job) = next;
        if executor.is_gone() {
            // It ended while it had nothing to do: not this job's fault.
            let fault = executor.epitaph().how;
            job::hand_back(service, claim, fault.clone()).await;
            return Err(fault);
        }
        service.pool.set(id, DeviceStatus::Busy, Some(job.id), None);
        service.metrics.count_wait(job.timings.queued_s);
        let span = job_span(service, id, &job).await;
        let ran = job::run(service, executor, claim, &job).instrument(span).await;
        service.bell.ring(job.id);
        ran?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_has_company_while_another_one_is_busy_at_any_time_of_its_job() {
        let view = |id: &str| DeviceView {
            id: id.into(),
            name: String::new(),
            kind: String::new(),
            driver: String::new(),
            in_pool: true,
            status: None,
            job: None,
            error: None,
            restarts: 0,
            last_fault: None,
        };
        let pool = Pool::of(vec![view("a"), view("b"), view("c")]);
        let set = |id, status| pool.set(id, status, None, None);
        set("a", DeviceStatus::Busy);
        set("b", DeviceStatus::Opening);
        assert!(pool.was_alone("a"));
        set("b", DeviceStatus::Busy);
        assert!(!pool.was_alone("a") && !pool.was_alone("b"));
        // The other one is done, but it may have taken the memory while it was there.
        set("b", DeviceStatus::Idle);
        assert!(!pool.was_alone("a"));
        set("c", DeviceStatus::Busy);
        assert!(!pool.was_alone("c"), "a still works");
        set("a", DeviceStatus::Idle);
        set("c", DeviceStatus::Idle);
        set("b", DeviceStatus::Busy);
        assert!(pool.was_alone("b"), "a new job begins anew");
    }

    fn needed(method: &str, triangles: u64, patches: u64, side: u32) -> u64 {
        let job = serde_json::json!({"method": method, "width": side, "height": side,
                                     "options": {"patches": patches}});
        let job = serde_json::from_value(job).unwrap();
        needed_bytes(&job, triangles).unwrap_or_else(|| panic!("{method} does not say"))
    }

    #[test]
    fn every_method_says_what_it_needs_and_more_for_more() {
        for method in METHODS {
            let little = needed(method, 1000, 2000, 100);
            assert!((1 << 20..1 << 30).contains(&little), "{method}: {little}");
            assert!(needed(method, 1_000_000, 2000, 100) > little, "{method}");
            assert!(needed(method, 1000, 2000, 4000) > little, "{method}");
            // Methods without patches do not care for them.
            assert!(needed(method, 1000, 200_000, 100) >= little, "{method}");
        }
        assert!(needed("stochastic", 1000, 2_000_000, 100) > 500_000_000);
        // The matrix of form factors, with at least a patch a triangle.
        assert!(needed("gauss-seidel", 1000, 20_000, 100) > 1_600_000_000);
        assert!(needed("gauss-seidel", 20_000, 1, 100) > 1_600_000_000);
        assert!(needed("auto", 1000, 2000, 4000) <= needed("hemilux", 1000, 2000, 4000));
    }
}
