//! The clients of the loop: they send jobs and follow each to its end, whatever happens to the
//! server.

use super::Plan;
use crate::server::{PATIENCE, Server, try_events, try_send};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};

/// The job of a seed.
pub fn wish(seed: usize, iterations: u64) -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 24, "height": 24,
        "max_iterations": iterations, "seed": seed,
        "options": {"patches": 500, "hemicube_resolution": 32}
    })
}

/// Whether an event of that name ends a job.
pub fn is_terminal(name: &str) -> bool {
    matches!(name, "succeeded" | "failed" | "cancelled")
}

/// What clients count.
#[derive(Default)]
pub struct Counts {
    /// Streams that were opened again with `Last-Event-ID`.
    pub resumed: AtomicU64,
    /// Requests that were sent again.
    pub repeated: AtomicU64,
    /// Events that came.
    pub events: AtomicU64,
    /// Posts that were refused for want of space on the disk.
    pub refused: AtomicU64,
}

/// What clients and killer share.
pub struct Stage {
    plan: Plan,
    /// Where the present server listens.
    address: RwLock<String>,
    /// Kills so far.
    pub kills: AtomicUsize,
    next_job: AtomicUsize,
    /// What clients count.
    pub counts: Counts,
    /// Job ids by seed.
    pub accepted: Mutex<BTreeMap<usize, String>>,
    /// Held for reading while a job is sent: whoever holds it for writing knows that all jobs that
    /// were accepted are in [`Stage::accepted`].
    pub sending: RwLock<()>,
    /// How often the database was replaced by an earlier one; the numbers of events begin again
    /// where that one was.
    pub restores: AtomicUsize,
}

impl Stage {
    /// A stage without a server yet.
    pub fn new(plan: Plan) -> Self {
        Self {
            plan,
            address: RwLock::default(),
            kills: AtomicUsize::new(0),
            next_job: AtomicUsize::new(0),
            counts: Counts::default(),
            accepted: Mutex::default(),
            sending: RwLock::default(),
            restores: AtomicUsize::new(0),
        }
    }

    /// From now on that server is the one to talk to.
    pub fn moved_to(&self, server: &Server) {
        *self.address.write().unwrap_or_else(PoisonError::into_inner) = server.address.clone();
    }

    fn address(&self) -> String {
        self.address.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sends jobs and follows each to its end, whatever happens to the server.
    pub fn be_a_client(&self) {
        loop {
            let seed = self.next_job.fetch_add(1, Ordering::Relaxed);
            if seed >= self.plan.jobs {
                return;
            }
            // So that there is work at every kill.
            let due = seed * self.plan.kills / self.plan.jobs;
            while self.kills.load(Ordering::Relaxed) + self.plan.clients < due {
                std::thread::sleep(Duration::from_millis(5));
            }
            let id = self.submit_twice(seed);
            self.follow(&id);
        }
    }

    fn submit_twice(&self, seed: usize) -> String {
        let _sending = self.sending.read().unwrap_or_else(PoisonError::into_inner);
        let id = self.submit(seed);
        // A client that did not hear the answer sends again.
        assert_eq!(self.submit(seed), id, "a repeated request made another job");
        let mut accepted = self.accepted.lock().unwrap_or_else(PoisonError::into_inner);
        accepted.insert(seed, id.clone());
        id
    }

    fn submit(&self, seed: usize) -> String {
        let key = format!("kill-loop-{seed}");
        let headers = [("content-type", "application/json"), ("idempotency-key", key.as_str())];
        let body = wish(seed, self.plan.iterations).to_string();
        let deadline = Instant::now() + PATIENCE;
        loop {
            let answer = try_send(&self.address(), ("POST", "/v1/jobs"), &headers, body.as_bytes());
            // An answer that broke off is no answer.
            let job = answer.ok().and_then(|answer| {
                let job = serde_json::from_slice::<Value>(&answer.body).ok()?;
                if answer.status == 503 {
                    self.counts.refused.fetch_add(1, Ordering::Relaxed);
                    return None;
                }
                assert_eq!(answer.status, 202, "{job}");
                Some(job["id"].as_str()?.to_owned())
            });
            if let Some(id) = job {
                return id;
            }
            self.counts.repeated.fetch_add(1, Ordering::Relaxed);
            assert!(Instant::now() < deadline, "no server takes job {seed}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Follows a job over as many streams as it takes; its terminal event comes once.
    fn follow(&self, id: &str) {
        let path = format!("/v1/jobs/{id}/events");
        let restores = || self.restores.load(Ordering::Relaxed);
        let (mut last, mut epoch) = (0, restores());
        let mut deadline = Instant::now() + self.plan.patience;
        loop {
            if epoch != restores() {
                (last, epoch) = (0, restores());
            }
            let last_seen = last.to_string();
            let headers = [("last-event-id", last_seen.as_str())];
            let headers = if last > 0 { &headers[..] } else { &[] };
            match try_events(&self.address(), &path, headers) {
                Ok(Ok(events)) => {
                    self.counts.resumed.fetch_add(u64::from(last > 0), Ordering::Relaxed);
                    for event in events {
                        assert!(event.id > last, "event {} came again after {last}", event.id);
                        last = event.id;
                        deadline = Instant::now() + self.plan.patience;
                        self.counts.events.fetch_add(1, Ordering::Relaxed);
                        if is_terminal(&event.name) {
                            assert_eq!(event.name, "succeeded", "{}", event.data);
                            return;
                        }
                    }
                }
                Ok(Err(status)) => assert!(status >= 500, "job {id} is gone: {status}"),
                Err(_) => {}
            }
            assert!(Instant::now() < deadline, "job {id} never ended");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
