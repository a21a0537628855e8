//! The devices of this machine that run jobs, and what each of them does at present.

use crate::api::{DeviceStatus, DeviceView};
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use uuid::Uuid;

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
    /// A pool of those of the machine's devices that have these ids, all still to be opened, and
    /// the threads that the jobs of each compute with.
    pub fn new(mut devices: Vec<DeviceView>, ids: &[String], threads: Vec<usize>) -> Self {
        for device in &mut devices {
            device.in_pool = ids.contains(&device.id);
            device.status = device.in_pool.then_some(DeviceStatus::Opening);
        }
        let threads = ids.iter().cloned().zip(threads).collect();
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

    /// What a device does from now on.
    pub fn set(&self, id: &str, status: DeviceStatus, job: Option<Uuid>, error: Option<String>) {
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
    pub fn was_alone(&self, id: &str) -> bool {
        !self.lock().iter().any(|device| device.view.id == id && device.has_company)
    }

    /// The device had to be opened again.
    pub fn restarted(&self, id: &str, fault: &str) {
        if let Some(device) = self.lock().iter_mut().find(|device| device.view.id == id) {
            device.view.restarts += 1;
            device.view.last_fault = Some(fault.to_owned());
        }
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
}
