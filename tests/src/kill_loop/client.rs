//! The clients of the loop: they send jobs and follow each to its end, whatever happens to the
//! server.

use super::Plan;
use crate::server::{PATIENCE, Server, try_events, try_send};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
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
    /// Set once nobody kills servers any more.
    pub over: AtomicBool,
    /// Set where the kills ended with a panic: there will be no server to talk to.
    pub broken_off: AtomicBool,
}

/// Says that the kills are over when it is dropped, also where a panic drops it. Whoever waits for
/// the next kill, or goes on until there is none, then ends; otherwise the threads of the loop
/// would wait for each other for ever.
pub struct Ending<'a>(pub &'a Stage);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        self.0.broken_off.fetch_or(std::thread::panicking(), Ordering::Relaxed);
        self.0.over.store(true, Ordering::Relaxed);
    }
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
            over: AtomicBool::new(false),
            broken_off: AtomicBool::new(false),
        }
    }

    fn is_broken_off(&self) -> bool {
        self.broken_off.load(Ordering::Relaxed)
    }

    /// From now on that server is the one to talk to.
    pub fn moved_to(&self, server: &Server) {
        *self.address.write().unwrap_or_else(PoisonError::into_inner) = server.address.clone();
    }

    fn address(&self) -> String {
        self.address.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sends jobs and follows each to its end, whatever happens to the server; until there will be
    /// none.
    pub fn be_a_client(&self) {
        loop {
            let seed = self.next_job.fetch_add(1, Ordering::Relaxed);
            if seed >= self.plan.jobs {
                return;
            }
            // So that there is work at every kill.
            let due = seed * self.plan.kills / self.plan.jobs;
            while self.kills.load(Ordering::Relaxed) + self.plan.clients < due
                && !self.over.load(Ordering::Relaxed)
            {
                std::thread::sleep(Duration::from_millis(5));
            }
            let Some(id) = self.submit_twice(seed) else { return };
            self.follow(&id);
        }
    }

    /// The id of the job; `None` where the loop is broken off.
    fn submit_twice(&self, seed: usize) -> Option<String> {
        let _sending = self.sending.read().unwrap_or_else(PoisonError::into_inner);
        let id = self.submit(seed)?;
        // A client that did not hear the answer sends again.
        assert_eq!(self.submit(seed)?, id, "a repeated request made another job");
        let mut accepted = self.accepted.lock().unwrap_or_else(PoisonError::into_inner);
        accepted.insert(seed, id.clone());
        Some(id)
    }

    fn submit(&self, seed: usize) -> Option<String> {
        let key = format!("kill-loop-{seed}");
        let headers = [("content-type", "application/json"), ("idempotency-key", key.as_str())];
        let body = wish(seed, self.plan.iterations).to_string();
        let deadline = Instant::now() + PATIENCE;
        while !self.is_broken_off() {
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
            if job.is_some() {
                return job;
            }
            self.counts.repeated.fetch_add(1, Ordering::Relaxed);
            assert!(Instant::now() < deadline, "no server takes job {seed}");
            std::thread::sleep(Duration::from_millis(10));
        }
        None
    }

    /// Follows a job over as many streams as it takes; its terminal event comes once.
    fn follow(&self, id: &str) {
        let path = format!("/v1/jobs/{id}/events");
        let restores = || self.restores.load(Ordering::Relaxed);
        let (mut last, mut epoch) = (0, restores());
        let mut deadline = Instant::now() + self.plan.patience;
        while !self.is_broken_off() {
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
