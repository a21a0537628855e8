//! Kills a server with SIGKILL again and again while clients send jobs and follow them, and checks
//! that nothing is lost and nothing happens twice. On the way the disk may be short for half of the
//! time, and the database may be put back to an earlier one from a backup.

mod client;
mod place;

use crate::server::{PATIENCE, Server};
use crate::small_disk::SmallDisk;
use client::{Ending, Stage, is_terminal, wish};
use place::{Place, be_short, restore, succeeded};
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::PoisonError;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// How long the server lives between two kills, shortest and longest.
#[derive(Clone, Copy, Debug)]
pub enum Uptime {
    /// In times that an undisturbed job takes on this machine now.
    Jobs(f64, f64),
    /// In seconds.
    Seconds(f64, f64),
}

/// How much to kill, and what else is wrong meanwhile.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Jobs, each with a seed of its own.
    pub jobs: usize,
    /// Kills, spread over the jobs.
    pub kills: usize,
    /// Whether kills go on until every job has ended, however many it takes.
    pub throughout: bool,
    /// Clients that send and follow jobs at once.
    pub clients: usize,
    /// Iterations of a job.
    pub iterations: u64,
    /// How long the server lives between two kills.
    pub uptime: Uptime,
    /// Whether the disk is short for half of the time.
    pub short_disk: bool,
    /// Whether the database is put back to an earlier one, from a backup, once: when a third of the
    /// jobs have succeeded, or after half of the kills.
    pub restore: bool,
    /// Longest time that a job may go without news.
    pub patience: Duration,
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
    /// Requests that were sent again because the server went away or had no space.
    pub repeated_requests: u64,
    /// Posts that were refused for want of space.
    pub refused_for_space: u64,
    /// How often the disk was short.
    pub shortages: u64,
    /// Starts that ended at once, which they may do on a full disk.
    pub failed_starts: u64,
    /// Jobs that had ended when the database was put back to one in which they had not.
    pub undone_by_restore: usize,
    /// Events that clients received.
    pub events: u64,
    /// Largest number of attempts of a job, those included that ended without its doing.
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
/// Where a promise is broken, or the disk is to be short and the system allows no small one
/// ([`SmallDisk::is_allowed`]).
pub fn run(plan: &Plan) -> Tally {
    let (undisturbed, job_s) = undisturbed(plan);
    let folder = TempDir::new().expect("a temporary folder");
    let disk = plan.short_disk.then(|| {
        SmallDisk::mount(folder.path(), place::DISK_MIB).expect("the system allows namespaces")
    });
    let stage = Stage::new(plan.clone());
    let began = Instant::now();
    let mut tally = Tally { job_s, ..Tally::default() };
    let mut place = Place::new(folder.path(), disk.as_ref());
    let server = std::thread::scope(|scope| {
        let _ending = Ending(&stage);
        let clients: Vec<_> =
            (0..plan.clients).map(|_| scope.spawn(|| stage.be_a_client())).collect();
        let shortages =
            disk.as_ref().map(|disk| scope.spawn(|| be_short(disk, plan.seed, &stage.over)));
        let goes_on = |kills: usize| {
            let all_ended = || clients.iter().all(|client| client.is_finished());
            if plan.throughout { !all_ended() } else { kills < plan.kills }
        };
        kill(plan, &stage, &mut place, goes_on, &mut tally);
        // From here on nobody disturbs.
        stage.over.store(true, Ordering::Relaxed);
        tally.shortages = shortages.map_or(0, |thread| thread.join().expect("the disk works"));
        let server = place.start();
        stage.moved_to(&server);
        for client in clients {
            client.join().expect("a client saw a broken promise");
        }
        server
    });
    tally.seconds = began.elapsed().as_secs_f64();
    tally.failed_starts = place.failed_starts;
    tally.resumed_streams = stage.counts.resumed.load(Ordering::Relaxed);
    tally.repeated_requests = stage.counts.repeated.load(Ordering::Relaxed);
    tally.refused_for_space = stage.counts.refused.load(Ordering::Relaxed);
    tally.events = stage.counts.events.load(Ordering::Relaxed);
    let accepted = stage.accepted.into_inner().unwrap_or_else(PoisonError::into_inner);
    judge(&server, &accepted, &undisturbed, &mut tally);
    tally
}

/// Starts and kills servers for as long as `goes_on` says of the kills so far.
fn kill(
    plan: &Plan,
    stage: &Stage,
    place: &mut Place<'_>,
    goes_on: impl Fn(usize) -> bool,
    tally: &mut Tally,
) {
    let (low, high) = match plan.uptime {
        Uptime::Jobs(low, high) => (low * tally.job_s, high * tally.job_s),
        Uptime::Seconds(low, high) => (low, high),
    };
    let uptime_ms = ((1e3 * low) as u64, (1e3 * high) as u64);
    let mut chance = Chance(plan.seed | 1);
    let mut killed: Option<Instant> = None;
    let mut restores = plan.restore;
    while goes_on(tally.kills) {
        let server = place.start();
        if let Some(killed) = killed {
            tally.longest_restart_s = tally.longest_restart_s.max(killed.elapsed().as_secs_f64());
        }
        stage.moved_to(&server);
        std::thread::sleep(Duration::from_millis(chance.between(uptime_ms)));
        let running = server.get("/v1/jobs?state=running").json();
        tally.kills_of_running_jobs +=
            u64::from(running["jobs"].as_array().is_some_and(|jobs| !jobs.is_empty()));
        let children = server.children();
        assert!(plan.throughout || !children.is_empty(), "the device has no process of its own");
        killed = Some(Instant::now());
        // While there are jobs to be undone, however fast they are.
        let is_due = tally.kills >= plan.kills / 2 || 3 * succeeded(&server) >= plan.jobs;
        if restores && is_due {
            tally.undone_by_restore = restore(stage, place, server);
            (killed, restores) = (None, false);
        } else {
            server.kill();
        }
        no_orphans(&children);
        tally.kills += 1;
        stage.kills.fetch_add(1, Ordering::Relaxed);
    }
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
        // One that had ended before the database was put back is done again.
        let job = server.wait(id);
        assert_eq!(job["state"], "succeeded", "{job}");
        assert_eq!(job["request"]["seed"], *seed);
        assert_eq!(hashes(&job), hoped[*seed], "job {id} has another picture");
        assert_eq!(server.get(&format!("/v1/jobs/{id}/image.exr")).status, 200);
        let events: Vec<_> = server.events(&format!("/v1/jobs/{id}/events"), &[]).collect();
        assert!(events.windows(2).all(|pair| pair[0].id < pair[1].id));
        let terminal: Vec<_> = events.iter().filter(|event| is_terminal(&event.name)).collect();
        assert_eq!(terminal.len(), 1, "{terminal:?}");
        assert_eq!(events.last().map(|event| event.name.as_str()), Some("succeeded"));
        let tried = |field: &str| job[field].as_u64().unwrap_or(0);
        tally.most_attempts = tally.most_attempts.max(tried("attempts") + tried("interruptions"));
        tally.jobs += 1;
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
