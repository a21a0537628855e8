//! Kills a server with SIGKILL again and again while clients send jobs and follow them, and checks
//! that nothing is lost and nothing happens twice.

use crate::server::{PATIENCE, Server, try_events, try_send};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// How much to kill.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Jobs, each with a seed of its own.
    pub jobs: usize,
    /// Kills, spread over the jobs.
    pub kills: usize,
    /// Clients that send and follow jobs at once.
    pub clients: usize,
    /// Iterations of a job.
    pub iterations: u64,
    /// How long the server lives between two kills, shortest and longest, in times that an
    /// undisturbed job takes on this machine now.
    pub uptime: (f64, f64),
    /// Seed of the moments.
    pub seed: u64,
}

/// What happened.
#[derive(Debug, Default)]
pub struct Tally {
    /// Jobs that succeeded with the picture of an undisturbed run.
    pub jobs: usize,
    /// Kills.
    pub kills: usize,
    /// Kills that hit a running job.
    pub kills_of_running_jobs: u64,
    /// Event streams that were opened again with `Last-Event-ID`.
    pub resumed_streams: u64,
    /// Requests that were sent again because the server went away.
    pub repeated_requests: u64,
    /// Events that clients received.
    pub events: u64,
    /// Largest number of attempts of a job.
    pub most_attempts: u64,
    /// Longest time from a kill to the next server's readiness, seconds.
    pub longest_restart_s: f64,
    /// Seconds that an undisturbed job ran, the median.
    pub job_s: f64,
    /// Seconds of the disturbed part.
    pub seconds: f64,
}

/// Runs the loop.
///
/// # Panics
/// Where a promise is broken.
pub fn run(plan: &Plan) -> Tally {
    let (undisturbed, job_s) = undisturbed(plan);
    let folder = TempDir::new().expect("a temporary folder");
    let stage = Stage {
        plan: plan.clone(),
        address: RwLock::default(),
        kills: AtomicUsize::new(0),
        next_job: AtomicUsize::new(0),
        counts: Counts::default(),
        accepted: Mutex::default(),
    };
    let began = Instant::now();
    let mut tally = Tally { job_s, ..Tally::default() };
    let millis = |times: f64| (1e3 * times * job_s) as u64;
    let uptime_ms = (millis(plan.uptime.0), millis(plan.uptime.1));
    let server = std::thread::scope(|scope| {
        let clients: Vec<_> =
            (0..plan.clients).map(|_| scope.spawn(|| stage.be_a_client())).collect();
        let mut chance = Chance(plan.seed | 1);
        let mut killed = None;
        for _ in 0..plan.kills {
            let server = Server::start_in(folder.path(), &[]);
            if let Some(killed) = killed {
                let took: Duration = Instant::now() - killed;
                tally.longest_restart_s = tally.longest_restart_s.max(took.as_secs_f64());
            }
            stage.moved_to(&server);
            std::thread::sleep(Duration::from_millis(chance.between(uptime_ms)));
            let running = server.get("/v1/jobs?state=running").json();
            tally.kills_of_running_jobs +=
                u64::from(running["jobs"].as_array().is_some_and(|jobs| !jobs.is_empty()));
            let children = server.children();
            assert!(!children.is_empty(), "the device has no process of its own");
            killed = Some(Instant::now());
            server.kill();
            no_orphans(&children);
            stage.kills.fetch_add(1, Ordering::Relaxed);
        }
        let server = Server::start_in(folder.path(), &[]);
        stage.moved_to(&server);
        for client in clients {
            client.join().expect("a client saw a broken promise");
        }
        server
    });
    tally.seconds = began.elapsed().as_secs_f64();
    tally.kills = plan.kills;
    tally.resumed_streams = stage.counts.resumed.load(Ordering::Relaxed);
    tally.repeated_requests = stage.counts.repeated.load(Ordering::Relaxed);
    tally.events = stage.counts.events.load(Ordering::Relaxed);
    let accepted = stage.accepted.into_inner().unwrap_or_else(PoisonError::into_inner);
    judge(&server, &accepted, &undisturbed, &mut tally);
    tally
}

fn wish(seed: usize, iterations: u64) -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 24, "height": 24,
        "max_iterations": iterations, "seed": seed,
        "options": {"patches": 500, "hemicube_resolution": 32}
    })
}

/// Hashes of the pictures, by seed, of a server that nobody kills, and the median of the seconds
/// that a job ran.
fn undisturbed(plan: &Plan) -> (Vec<Value>, f64) {
    let server = Server::start();
    let submit = |seed| server.submit(&wish(seed, plan.iterations));
    let jobs: Vec<String> = (0..plan.jobs).map(submit).collect();
    let records: Vec<Value> = jobs.iter().map(|job| server.wait(job)).collect();
    let ran = |job: &Value| job["timings"]["running_s"].as_f64().expect("a time");
    let mut seconds: Vec<f64> = records.iter().map(ran).collect();
    seconds.sort_unstable_by(f64::total_cmp);
    (records.iter().map(hashes).collect(), seconds[seconds.len() / 2])
}

fn hashes(job: &Value) -> Value {
    let files = job["result"].as_array().unwrap_or_else(|| panic!("no result: {job}"));
    files.iter().map(|file| file["sha256"].clone()).collect()
}

/// The processes of a server that was killed end by themselves.
fn no_orphans(children: &[u32]) {
    let deadline = Instant::now() + PATIENCE;
    for child in children {
        let status = format!("/proc/{child}/status");
        let lives = || {
            std::fs::read_to_string(&status).is_ok_and(|text| {
                text.lines().any(|line| line.starts_with("State:") && !line.contains('Z'))
            })
        };
        while lives() {
            assert!(Instant::now() < deadline, "process {child} outlived its server");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Whether all that was promised is so: each accepted job is there once, has succeeded, has one
/// terminal event and the picture of the undisturbed run.
fn judge(server: &Server, accepted: &BTreeMap<usize, String>, hoped: &[Value], tally: &mut Tally) {
    assert_eq!(accepted.len(), hoped.len(), "jobs were lost by their clients");
    let listed = server.get("/v1/jobs?limit=200").json();
    assert_eq!(listed["jobs"].as_array().expect("a list").len(), hoped.len(), "doubled or lost");
    for (seed, id) in accepted {
        let job = server.get(&format!("/v1/jobs/{id}")).json();
        assert_eq!(job["state"], "succeeded", "{job}");
        assert_eq!(job["request"]["seed"], *seed);
        assert_eq!(hashes(&job), hoped[*seed], "job {id} has another picture");
        assert_eq!(server.get(&format!("/v1/jobs/{id}/image.exr")).status, 200);
        let events: Vec<_> = server.events(&format!("/v1/jobs/{id}/events"), &[]).collect();
        assert!(events.windows(2).all(|pair| pair[0].id < pair[1].id));
        let terminal: Vec<_> = events.iter().filter(|event| is_terminal(&event.name)).collect();
        assert_eq!(terminal.len(), 1, "{terminal:?}");
        assert_eq!(events.last().map(|event| event.name.as_str()), Some("succeeded"));
        tally.most_attempts = tally.most_attempts.max(job["attempts"].as_u64().unwrap_or(0));
        tally.jobs += 1;
    }
}

fn is_terminal(name: &str) -> bool {
    matches!(name, "succeeded" | "failed" | "cancelled")
}

#[derive(Default)]
struct Counts {
    resumed: AtomicU64,
    repeated: AtomicU64,
    events: AtomicU64,
}

/// What clients and killer share.
struct Stage {
    plan: Plan,
    /// Where the present server listens.
    address: RwLock<String>,
    kills: AtomicUsize,
    next_job: AtomicUsize,
    counts: Counts,
    /// Job ids by seed.
    accepted: Mutex<BTreeMap<usize, String>>,
}

impl Stage {
    fn moved_to(&self, server: &Server) {
        *self.address.write().unwrap_or_else(PoisonError::into_inner) = server.address.clone();
    }

    fn address(&self) -> String {
        self.address.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sends jobs and follows each to its end, whatever happens to the server.
    fn be_a_client(&self) {
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
            let id = self.submit(seed);
            // A client that did not hear the answer sends again.
            assert_eq!(self.submit(seed), id, "a repeated request made another job");
            let mut accepted = self.accepted.lock().unwrap_or_else(PoisonError::into_inner);
            accepted.insert(seed, id.clone());
            drop(accepted);
            self.follow(&id);
        }
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
        let mut last = 0;
        let mut deadline = Instant::now() + PATIENCE;
        loop {
            let last_seen = last.to_string();
            let headers = [("last-event-id", last_seen.as_str())];
            let headers = if last > 0 { &headers[..] } else { &[] };
            match try_events(&self.address(), &path, headers) {
                Ok(Ok(events)) => {
                    self.counts.resumed.fetch_add(u64::from(last > 0), Ordering::Relaxed);
                    for event in events {
                        assert!(event.id > last, "event {} came again after {last}", event.id);
                        last = event.id;
                        deadline = Instant::now() + PATIENCE;
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

/// Numbers that look random (xorshift).
struct Chance(u64);

impl Chance {
    fn between(&mut self, (low, high): (u64, u64)) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        low + self.0 % (high - low + 1)
    }
}
