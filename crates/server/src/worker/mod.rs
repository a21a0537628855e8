//! The pool: one operating-system thread per device, each drawing jobs from the queue. This is
//! where the service meets the engine.

mod checkpoints;
pub mod devices;
mod job;
pub mod scenes;
mod watch;

use crate::api::jobs::OptionValue;
use crate::api::limits::{OptionWord, Vocabulary};
use crate::api::{DeviceStatus, DeviceView, FieldError};
use crate::service::Service;
use hemilux_engine::device::Device;
use hemilux_engine::render::RenderError;
use hemilux_engine::transport::options::Settings;
use hemilux_engine::transport::{METHODS, OPTIONS};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use uuid::Uuid;

/// Longest wait before a device that does not open is tried again.
const MAX_BACKOFF: Duration = Duration::from_secs(30);

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

/// What is wrong with a job's settings of the method, if anything.
pub fn setting_problem(options: &BTreeMap<String, OptionValue>) -> Option<FieldError> {
    let options = options.iter().map(|(name, value)| (name.clone(), value.to_string())).collect();
    match Settings::new(&options).err()? {
        RenderError::Parameter { parameter, what } => Some(FieldError::new(parameter, what)),
        error => Some(FieldError::new("options", error.to_string())),
    }
}

/// What the devices do, for whoever asks.
pub struct Pool {
    devices: Mutex<Vec<DeviceView>>,
}

impl Pool {
    /// A pool of the devices with these ids, all still to be opened.
    pub fn new(ids: &[String]) -> Self {
        let mut devices = devices::list();
        for device in &mut devices {
            device.in_pool = ids.contains(&device.id);
            device.status = device.in_pool.then_some(DeviceStatus::Opening);
        }
        Self { devices: Mutex::new(devices) }
    }

    /// All devices as they are now.
    pub fn devices(&self) -> Vec<DeviceView> {
        self.devices.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set(&self, id: &str, status: DeviceStatus, job: Option<Uuid>, error: Option<String>) {
        let mut devices = self.devices.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(device) = devices.iter_mut().find(|device| device.id == id) {
            device.status = Some(status);
            device.job = job;
            device.error = error;
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
            work(&service, &runtime, &device.id);
            let _ = on_end.send(());
        })?;
        ended.push(end);
    }
    Ok(Workers { ended })
}

/// A worker's life: open the device, run jobs on it, open it again where a job broke it.
fn work(service: &Arc<Service>, runtime: &tokio::runtime::Handle, id: &str) {
    let mut backoff = Duration::from_secs(1);
    while !service.shutdown.is_cancelled() {
        service.pool.set(id, DeviceStatus::Opening, None, None);
        match devices::open(id) {
            Ok(mut device) => {
                backoff = Duration::from_secs(1);
                run_jobs(service, runtime, id, device.as_mut());
            }
            Err(error) => {
                tracing::error!(device = id, %error, "cannot open the device");
                service.pool.set(id, DeviceStatus::Failed, None, Some(error));
                runtime.block_on(async {
                    tokio::select! {
                        () = tokio::time::sleep(backoff) => {}
                        () = service.shutdown.cancelled() => {}
                    }
                });
                backoff = (2 * backoff).min(MAX_BACKOFF);
            }
        }
    }
}

/// Runs jobs until shutdown, or until the device must be opened again.
fn run_jobs(
    service: &Arc<Service>,
    runtime: &tokio::runtime::Handle,
    id: &str,
    device: &mut dyn Device,
) {
    loop {
        service.pool.set(id, DeviceStatus::Idle, None, None);
        let next = runtime.block_on(async {
            tokio::select! {
                biased;
                () = service.shutdown.cancelled() => None,
                next = service.queue.next(id) => Some(next),
            }
        });
        let Some((claim, job)) = next else { return };
        service.pool.set(id, DeviceStatus::Busy, Some(job.id), None);
        let device_is_sound = job::run(service, runtime, device, claim, &job);
        service.bell.ring(job.id);
        if !device_is_sound {
            return;
        }
    }
}
