//! Many clients at once: event streams that follow jobs, posts against a full queue, and requests
//! whose time is taken meanwhile. Shared by the test-suite (short) and `bench load` (long).

use crate::server::Server;
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
    /// Resident memory before, at its highest, MiB.
    pub memory_mib: (f64, f64),
    /// Seconds from SIGTERM to the end of the process.
    pub drain_s: f64,
}

impl Report {
    /// The time below which this share of the measured requests stayed, milliseconds.
    pub fn get_quantile_ms(&self, share: f64) -> f64 {
        let last = self.get_ms.len().saturating_sub(1);
        self.get_ms.get((share * last as f64).round() as usize).copied().unwrap_or(f64::NAN)
    }
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
    over: AtomicBool,
    /// Set before SIGTERM: streams that end from now on were not lost.
    ending: AtomicBool,
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
            streams.spawn(follow(address.clone(), job.clone(), tally.clone()));
        }
        let mut others = JoinSet::new();
        let body: Arc<str> = endless.to_string().into();
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
    let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
    let mut get_ms = std::mem::take(&mut *tally.get_ms.lock().expect("no panic"));
    get_ms.sort_by(f64::total_cmp);
    let posts = tally.posts.lock().expect("no panic").clone();
    Report {
        posts,
        without_retry_after: read(&tally.without_retry_after),
        unanswered: read(&tally.unanswered),
        streams: read(&tally.streams),
        events: read(&tally.events),
        streams_lost: read(&tally.streams_lost),
        streams_ended: read(&tally.streams_ended),
        get_ms,
        memory_mib: (before, peak),
        drain_s: drain.as_secs_f64(),
    }
}

/// Resident memory of a process, MiB.
pub fn resident_mib(process: u32) -> f64 {
    status_mib(process, "VmRSS:")
}

/// The most memory that a process has had resident, MiB.
pub fn peak_mib(process: u32) -> f64 {
    status_mib(process, "VmHWM:")
}

fn status_mib(process: u32, name: &str) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(name)).unwrap_or("");
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap_or(0.0) / 1024.0
}

async fn follow(address: Arc<str>, job: String, tally: Arc<Tally>) {
    let followed = async {
        let mut stream = TcpStream::connect(&*address).await?;
        let request = format!("GET /v1/jobs/{job}/events HTTP/1.1\r\nhost: {address}\r\n\r\n");
        stream.write_all(request.as_bytes()).await?;
        let mut buffer = vec![0; 16 << 10];
        let mut is_open = false;
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
        }
    };
    let _ = followed.await;
    let ended = if tally.ending.load(Ordering::Relaxed) {
        &tally.streams_ended
    } else {
        &tally.streams_lost
    };
    ended.fetch_add(1, Ordering::Relaxed);
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
        match connection.ask_patiently(&request).await {
            Some((status, head)) => {
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
