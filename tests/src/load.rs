//! Many clients at once: event streams that follow jobs, posts, and requests whose time is taken
//! meanwhile. Once against a full queue, where every post is refused, and once against one that
//! takes them all. Shared by the test-suite (short) and `bench load` (long).

use crate::server::Server;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::task::JoinSet;

/// Connections that post, and that read jobs.
const POSTERS: u32 = 20;
const READERS: u32 = 4;
/// Requests a second of each reader.
const READS_PER_S: f64 = 25.0;
/// The last bytes of a stream: they hold its terminal event.
const TAIL_BYTES: usize = 16 << 10;
/// Longest wait for an answer.
const PATIENCE: Duration = Duration::from_secs(30);

/// How much to ask for.
#[derive(Clone, Copy, Debug)]
pub struct Load {
    /// Event streams open at the same time.
    pub streams: usize,
    /// Job posts a second.
    pub posts_per_s: u32,
    /// How long, seconds.
    pub seconds: f64,
}

/// What came of it.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Answers to posts by status.
    pub posts: BTreeMap<u16, u64>,
    /// 429s and 503s without Retry-After.
    pub without_retry_after: u64,
    /// Requests that got no answer at all.
    pub unanswered: u64,
    /// Event streams that opened.
    pub streams: u64,
    /// Events that they received.
    pub events: u64,
    /// Streams that were cut off before the server was asked to end.
    pub streams_lost: u64,
    /// Streams that had ended when the server had.
    pub streams_ended: u64,
    /// Milliseconds of `GET /v1/jobs/{id}`, sorted.
    pub get_ms: Vec<f64>,
    /// Milliseconds of posts, sorted.
    pub post_ms: Vec<f64>,
    /// Jobs whose streams came to their terminal event.
    pub followed_to_the_end: u64,
    /// Resident memory before, at its highest, MiB.
    pub memory_mib: (f64, f64),
    /// Seconds from SIGTERM to the end of the process.
    pub drain_s: f64,
}

impl Report {
    /// The time below which this share of the measured requests stayed, milliseconds.
    pub fn get_quantile_ms(&self, share: f64) -> f64 {
        quantile(&self.get_ms, share)
    }

    /// The same of posts.
    pub fn post_quantile_ms(&self, share: f64) -> f64 {
        quantile(&self.post_ms, share)
    }
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    let last = sorted.len().saturating_sub(1);
    sorted.get((share * last as f64).round() as usize).copied().unwrap_or(f64::NAN)
}

#[derive(Default)]
struct Tally {
    posts: Mutex<BTreeMap<u16, u64>>,
    without_retry_after: AtomicU64,
    unanswered: AtomicU64,
    streams: AtomicU64,
    events: AtomicU64,
    streams_lost: AtomicU64,
    streams_ended: AtomicU64,
    get_ms: Mutex<Vec<f64>>,
    post_ms: Mutex<Vec<f64>>,
    /// The newest job that was accepted.
    newest: Mutex<Option<String>>,
    followed_to_the_end: AtomicU64,
    over: AtomicBool,
    /// Set before SIGTERM: streams that end from now on were not lost.
    ending: AtomicBool,
}

/// Raises this process's own soft limit on open files to the hard one: each stream is a file on
/// this side too. Servers that it starts inherit it, except by [`Server::start_with_soft_limit`].
pub fn raise_own_limit() {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit { current: limit.maximum, ..limit };
    setrlimit(Resource::Nofile, raised).expect("the soft limit may be the hard one");
}

/// Puts the load on a server whose queue holds at most `max_queued`, and ends the server with all
/// streams still open.
pub fn run(server: Server, max_queued: usize, load: Load) -> Report {
    // One runs, the others fill the queue.
    let endless = json!({"scene": "cornell", "width": 64, "height": 64, "time_budget_s": 3600,
                         "method": "stochastic", "options": {"patches": 500}});
    let running = server.submit(&endless);
    server.wait_until(&running, |job| job["state"] == "running");
    let mut jobs = vec![running];
    for _ in 0..max_queued {
        jobs.push(server.submit(&endless));
    }
    put(server, &jobs, &endless.to_string(), load, false)
}

/// Posts small jobs, all of which are to be accepted. Half of the streams begin with a job that
/// waits behind all others; each stream follows its job to the end and then another.
pub fn run_accepted(server: Server, load: Load) -> Report {
    let small = json!({"scene": "cornell", "width": 8, "height": 8, "max_iterations": 1,
                       "fresh": true, "method": "stochastic", "options": {"patches": 100}});
    let mut last = small.clone();
    last["priority"] = json!(-100);
    let jobs = [server.submit(&small), server.submit(&last)];
    put(server, &jobs, &small.to_string(), load, true)
}

/// Puts the load on a server. Where posts are `accepted`, each stream moves on to the newest job
/// whenever the one that it follows has ended.
fn put(server: Server, jobs: &[String], body: &str, load: Load, accepted: bool) -> Report {
    let before = resident_mib(server.pid());
    let tally = Arc::new(Tally::default());
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .expect("a runtime");
    let (peak, drain) = runtime.block_on(async {
        let address: Arc<str> = server.address.as_str().into();
        let mut streams = JoinSet::new();
        for number in 0..load.streams {
            // Half of them follow the job that runs, and so has news.
            let job = if number % 2 == 0 { &jobs[0] } else { &jobs[number % jobs.len()] };
            streams.spawn(follow(address.clone(), job.clone(), accepted, tally.clone()));
        }
        let mut others = JoinSet::new();
        let body: Arc<str> = body.into();
        for _ in 0..POSTERS {
            let rate = f64::from(load.posts_per_s) / f64::from(POSTERS);
            others.spawn(post(address.clone(), body.clone(), rate, tally.clone()));
        }
        for _ in 0..READERS {
            others.spawn(read(address.clone(), jobs[0].clone(), tally.clone()));
        }
        let end = Instant::now() + Duration::from_secs_f64(load.seconds);
        let mut peak = before;
        while Instant::now() < end {
            tokio::time::sleep(Duration::from_millis(200)).await;
            peak = peak.max(resident_mib(server.pid()));
        }
        tally.over.store(true, Ordering::Relaxed);
        others.join_all().await;
        tally.ending.store(true, Ordering::Relaxed);
        let drain = tokio::task::spawn_blocking(|| server.terminate()).await.expect("it ends");
        let ended = tokio::time::timeout(Duration::from_secs(5), streams.join_all()).await;
        assert!(ended.is_ok(), "streams are open though the server is gone");
        (peak, drain)
    });
    tally.report((before, peak), drain)
}

impl Tally {
    fn report(&self, memory_mib: (f64, f64), drain: Duration) -> Report {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let sorted = |times: &Mutex<Vec<f64>>| {
            let mut times = std::mem::take(&mut *times.lock().expect("no panic"));
            times.sort_by(f64::total_cmp);
            times
        };
        Report {
            posts: self.posts.lock().expect("no panic").clone(),
            without_retry_after: read(&self.without_retry_after),
            unanswered: read(&self.unanswered),
            streams: read(&self.streams),
            events: read(&self.events),
            streams_lost: read(&self.streams_lost),
            streams_ended: read(&self.streams_ended),
            get_ms: sorted(&self.get_ms),
            post_ms: sorted(&self.post_ms),
            followed_to_the_end: read(&self.followed_to_the_end),
            memory_mib,
            drain_s: drain.as_secs_f64(),
        }
    }
}

/// Resident memory of a process, MiB.
///
/// # Panics
/// Where the process does not run, or the system has no `/proc`.
pub fn resident_mib(process: u32) -> f64 {
    status_mib(process, "VmRSS:")
}

/// The most memory that a process has had resident, MiB.
///
/// # Panics
/// As [`resident_mib`].
pub fn peak_mib(process: u32) -> f64 {
    status_mib(process, "VmHWM:")
}

/// [`peak_mib`]; `None` where the process does not run.
pub fn try_peak_mib(process: u32) -> Option<f64> {
    try_status_mib(process, "VmHWM:")
}

fn status_mib(process: u32, name: &str) -> f64 {
    try_status_mib(process, name).expect("/proc tells of the process")
}

fn try_status_mib(process: u32, name: &str) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.trim().trim_end_matches(" kB").parse::<f64>().ok()? / 1024.0)
}

/// A stream as one of the many: follows `job` until the stream ends, and where it `moves_on`, goes
/// on with the newest job each time the one it follows has come to its end.
async fn follow(address: Arc<str>, mut job: String, moves_on: bool, tally: Arc<Tally>) {
    let mut is_first = true;
    loop {
        let came_to_its_end = follow_one(&address, &job, is_first, &tally).await;
        is_first = false;
        if tally.ending.load(Ordering::Relaxed) {
            tally.streams_ended.fetch_add(1, Ordering::Relaxed);
            return;
        }
        if !(moves_on && came_to_its_end) {
            tally.streams_lost.fetch_add(1, Ordering::Relaxed);
            return;
        }
        tally.followed_to_the_end.fetch_add(1, Ordering::Relaxed);
        let newest = tally.newest.lock().expect("no panic").clone();
        job = newest.unwrap_or(job);
    }
}

/// Follows a job until its stream ends; whether that was with its terminal event.
async fn follow_one(address: &str, job: &str, counts: bool, tally: &Tally) -> bool {
    let mut tail = Vec::new();
    let followed = async {
        let mut stream = TcpStream::connect(address).await?;
        let request = format!(
            "GET /v1/jobs/{job}/events HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).await?;
        let mut buffer = vec![0; 16 << 10];
        let mut is_open = !counts;
        loop {
            let got = stream.read(&mut buffer).await?;
            if got == 0 {
                return Ok::<_, std::io::Error>(());
            }
            let text = &buffer[..got];
            if !is_open && text.starts_with(b"HTTP/1.1 200") {
                is_open = true;
                tally.streams.fetch_add(1, Ordering::Relaxed);
            }
            let events = text.windows(4).filter(|window| window == b"\nid:" || window == b"\nid ");
            tally.events.fetch_add(events.count() as u64, Ordering::Relaxed);
            tail.extend_from_slice(text);
            tail.drain(..tail.len().saturating_sub(TAIL_BYTES));
        }
    };
    let _ = followed.await;
    tail.windows(16).any(|window| window == b"event: succeeded" || window == b"event:succeeded\n")
}

/// A connection that is opened again where it broke.
struct Connection {
    address: Arc<str>,
    stream: Option<TcpStream>,
}

impl Connection {
    fn new(address: Arc<str>) -> Self {
        Self { address, stream: None }
    }

    /// Status and head of the answer; the body is read and dropped.
    async fn ask(&mut self, request: &str) -> std::io::Result<(u16, String)> {
        let mut stream = match self.stream.take() {
            Some(stream) => stream,
            None => TcpStream::connect(&*self.address).await?,
        };
        stream.write_all(request.as_bytes()).await?;
        let mut bytes = Vec::new();
        let mut buffer = vec![0; 16 << 10];
        loop {
            let got = stream.read(&mut buffer).await?;
            if got == 0 {
                return Err(std::io::ErrorKind::UnexpectedEof.into());
            }
            bytes.extend_from_slice(&buffer[..got]);
            let Some(at) = bytes.windows(4).position(|window| window == b"\r\n\r\n") else {
                continue;
            };
            let head = String::from_utf8_lossy(&bytes[..at]).to_ascii_lowercase();
            let length = head.lines().find_map(|line| line.strip_prefix("content-length: "));
            let length: usize = length.and_then(|text| text.trim().parse().ok()).unwrap_or(0);
            let mut left = (at + 4 + length).saturating_sub(bytes.len());
            while left > 0 {
                let got = stream.read(&mut buffer).await?;
                if got == 0 {
                    return Err(std::io::ErrorKind::UnexpectedEof.into());
                }
                left = left.saturating_sub(got);
            }
            self.stream = Some(stream);
            let status = head.get(9..12).and_then(|code| code.parse().ok()).unwrap_or(0);
            return Ok((status, head));
        }
    }

    async fn ask_patiently(&mut self, request: &str) -> Option<(u16, String)> {
        tokio::time::timeout(PATIENCE, self.ask(request)).await.ok()?.ok()
    }
}

async fn post(address: Arc<str>, body: Arc<str>, rate: f64, tally: Arc<Tally>) {
    let mut connection = Connection::new(address.clone());
    let request = format!(
        "POST /v1/jobs HTTP/1.1\r\nhost: {address}\r\ncontent-type: application/json\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    );
    let mut ticks = tokio::time::interval(Duration::from_secs_f64(1.0 / rate));
    while !tally.over.load(Ordering::Relaxed) {
        ticks.tick().await;
        let begun = Instant::now();
        match connection.ask_patiently(&request).await {
            Some((status, head)) => {
                let ms = begun.elapsed().as_secs_f64() * 1e3;
                tally.post_ms.lock().expect("no panic").push(ms);
                let job = head.lines().find_map(|line| line.strip_prefix("location: /v1/jobs/"));
                if let Some(job) = job {
                    *tally.newest.lock().expect("no panic") = Some(job.trim().to_owned());
                }
                *tally.posts.lock().expect("no panic").entry(status).or_default() += 1;
                if matches!(status, 429 | 503) && !head.contains("retry-after: ") {
                    tally.without_retry_after.fetch_add(1, Ordering::Relaxed);
                }
            }
            None => {
                tally.unanswered.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

async fn read(address: Arc<str>, job: String, tally: Arc<Tally>) {
    let mut connection = Connection::new(address.clone());
    let request = format!("GET /v1/jobs/{job} HTTP/1.1\r\nhost: {address}\r\n\r\n");
    let mut ticks = tokio::time::interval(Duration::from_secs_f64(1.0 / READS_PER_S));
    while !tally.over.load(Ordering::Relaxed) {
        ticks.tick().await;
        let begun = Instant::now();
        match connection.ask_patiently(&request).await {
            Some((200, _)) => {
                let ms = begun.elapsed().as_secs_f64() * 1e3;
                tally.get_ms.lock().expect("no panic").push(ms);
            }
            _ => {
                tally.unanswered.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}
