//! Figures for Prometheus. `docs/grafana.json` draws them; a test holds the two together.

use crate::api::{DeviceStatus, DeviceView};
use crate::job_state::JobState;
use crate::store::JobCounts;
use axum::http::{Method, StatusCode};
use prometheus_client::encoding::{EncodeLabelSet, text};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::Registry;

/// Media type of the answer.
pub const MEDIA_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RequestLabels {
    method: String,
    route: String,
    status: u16,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RouteLabel {
    route: String,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct StateLabel {
    state: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct DeviceLabels {
    device: String,
    state: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct LimitLabel {
    limit: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct OutcomeLabel {
    outcome: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct KindLabel {
    kind: &'static str,
}

/// From a millisecond to half a minute.
fn short_times() -> Histogram {
    Histogram::new(exponential_buckets(0.001, 2.0, 16))
}

/// From a tenth of a second to an hour.
fn long_times() -> Histogram {
    Histogram::new(exponential_buckets(0.1, 2.0, 16))
}

/// Everything that is counted.
pub struct Metrics {
    registry: Registry,
    requests: Family<RequestLabels, Counter>,
    request_seconds: Family<RouteLabel, Histogram, fn() -> Histogram>,
    refusals: Family<LimitLabel, Counter>,
    jobs: Family<StateLabel, Gauge>,
    queue_depth: Gauge,
    streams: Gauge,
    connections: Gauge,
    refused_connections: Family<LimitLabel, Counter>,
    iterations: Counter,
    shots: Counter,
    job_wait_seconds: Histogram,
    job_seconds: Family<StateLabel, Histogram, fn() -> Histogram>,
    job_shots_per_second: Histogram,
    snapshot_seconds: Histogram,
    devices: Family<DeviceLabels, Gauge>,
    webhooks: Family<OutcomeLabel, Counter>,
    webhooks_pending: Gauge,
    disk_free_bytes: Gauge,
    collected: Family<KindLabel, Counter>,
    orphans_left: Gauge,
    clock_doubted: Gauge,
}

impl Default for Metrics {
    fn default() -> Self {
        let metrics = Self {
            registry: Registry::with_prefix("hemilux"),
            requests: Family::default(),
            request_seconds: Family::new_with_constructor(short_times),
            refusals: Family::default(),
            jobs: Family::default(),
            queue_depth: Gauge::default(),
            streams: Gauge::default(),
            connections: Gauge::default(),
            refused_connections: Family::default(),
            iterations: Counter::default(),
            shots: Counter::default(),
            job_wait_seconds: long_times(),
            job_seconds: Family::new_with_constructor(long_times),
            job_shots_per_second: Histogram::new(exponential_buckets(10.0, 4.0, 12)),
            snapshot_seconds: short_times(),
            devices: Family::default(),
            webhooks: Family::default(),
            webhooks_pending: Gauge::default(),
            disk_free_bytes: Gauge::default(),
            collected: Family::default(),
            orphans_left: Gauge::default(),
            clock_doubted: Gauge::default(),
        };
        metrics.named()
    }
}

impl Metrics {
    fn named(mut self) -> Self {
        let to = &mut self.registry;
        to.register("build", "This program", Info::new([("version", env!("CARGO_PKG_VERSION"))]));
        to.register("http_requests", "HTTP requests", self.requests.clone());
        let help = "Seconds until the head of the answer, by route";
        to.register("http_request_seconds", help, self.request_seconds.clone());
        let help = "Requests refused for a limit, by limit";
        to.register("refusals", help, self.refusals.clone());
        to.register("jobs", "Jobs by state", self.jobs.clone());
        to.register("queue_depth", "Jobs that wait", self.queue_depth.clone());
        to.register("event_streams", "Open event streams", self.streams.clone());
        to.register("connections", "Open connections", self.connections.clone());
        let help = "Connections closed at once because there were too many, by limit";
        to.register("refused_connections", help, self.refused_connections.clone());
        to.register("iterations", "Iterations of ended jobs", self.iterations.clone());
        to.register("shots", "Hemicube shots of ended jobs", self.shots.clone());
        let help = "Seconds that jobs waited for a device";
        to.register("job_wait_seconds", help, self.job_wait_seconds.clone());
        let help = "Seconds that a worker spent on a job, by end state";
        to.register("job_seconds", help, self.job_seconds.clone());
        let help = "Hemicube shots a second, over a job";
        to.register("job_shots_per_second", help, self.job_shots_per_second.clone());
        let help = "Seconds of encoding and storing a snapshot";
        to.register("snapshot_seconds", help, self.snapshot_seconds.clone());
        let help = "1 for the state that a device of the pool is in";
        to.register("device_state", help, self.devices.clone());
        to.register("webhooks", "Attempts at webhooks, by outcome", self.webhooks.clone());
        let help = "Messages to webhooks still to be delivered";
        to.register("webhooks_pending", help, self.webhooks_pending.clone());
        let help = "Bytes free on the disk of the data folder";
        to.register("disk_free_bytes", help, self.disk_free_bytes.clone());
        let help =
            "Jobs and scenes removed by retention; files moved into and removed from quarantine";
        to.register("collected", help, self.collected.clone());
        let help = "Files that no record names, left where they are because they are too many";
        to.register("orphans_left", help, self.orphans_left.clone());
        let help = "1 while the clock is in doubt and nothing is removed because of its age";
        to.register("clock_doubted", help, self.clock_doubted.clone());
        self.begin_at_zero();
        self
    }
}

impl Metrics {
    /// Makes series that are there from the start: the rate of one that appears with its first
    /// count leaves that count out.
    fn begin_at_zero(&self) {
        for limit in [
            "requests_per_second",
            "jobs_queued",
            "scene_bytes",
            "stored_bytes",
            "pinned_bytes",
            "queue",
            "disk",
            "memory",
            "uploads",
        ] {
            let _ = self.refusals.get_or_create(&LimitLabel { limit });
        }
        for limit in ["all", "address"] {
            let _ = self.refused_connections.get_or_create(&LimitLabel { limit });
        }
        for outcome in ["delivered", "failed", "given_up"] {
            let _ = self.webhooks.get_or_create(&OutcomeLabel { outcome });
        }
        for kind in ["job", "scene", "orphan", "quarantined"] {
            let _ = self.collected.get_or_create(&KindLabel { kind });
        }
        for state in JobState::ALL.into_iter().filter(|state| state.is_terminal()) {
            let _ = self.job_seconds.get_or_create(&StateLabel { state: state.as_str() });
        }
    }
}

/// Counts something open, a stream or a connection, until dropped.
pub struct OpenCount(Gauge);

impl Drop for OpenCount {
    fn drop(&mut self) {
        self.0.dec();
    }
}

/// What is so now, as against what has happened.
pub struct Present {
    /// Jobs by state.
    pub jobs: JobCounts,
    /// The devices.
    pub devices: Vec<DeviceView>,
    /// Messages to webhooks still to be delivered.
    pub webhooks_pending: u64,
    /// Bytes free on the disk, where the system says.
    pub disk_free_bytes: Option<u64>,
}

fn gauge_value(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

impl Metrics {
    /// Counts an answered request; `seconds` until the head of the answer.
    pub fn count_request(&self, method: &Method, route: String, status: StatusCode, seconds: f64) {
        // Made-up methods must not make new time series.
        let known = [Method::GET, Method::HEAD, Method::POST, Method::DELETE];
        let method = if known.contains(method) { method.as_str() } else { "other" };
        self.request_seconds.get_or_create(&RouteLabel { route: route.clone() }).observe(seconds);
        let labels = RequestLabels { method: method.into(), route, status: status.as_u16() };
        self.requests.get_or_create(&labels).inc();
    }

    /// Counts a request that was refused for a limit.
    pub fn count_refusal(&self, limit: &'static str) {
        self.refusals.get_or_create(&LimitLabel { limit }).inc();
    }

    /// Counts an event stream that opens.
    pub fn count_stream(&self) -> OpenCount {
        self.streams.inc();
        OpenCount(self.streams.clone())
    }

    /// Counts a connection that opens.
    pub fn count_connection(&self) -> OpenCount {
        self.connections.inc();
        OpenCount(self.connections.clone())
    }

    /// Counts a connection that was closed at once for a limit.
    pub fn count_refused_connection(&self, limit: &'static str) {
        self.refused_connections.get_or_create(&LimitLabel { limit }).inc();
    }

    /// Counts a job that starts after so many seconds of waiting.
    pub fn count_wait(&self, seconds: f64) {
        self.job_wait_seconds.observe(seconds);
    }

    /// Counts a job that ended.
    pub fn count_job(&self, state: JobState, seconds: f64, iterations: u64, shots: u64) {
        self.job_seconds.get_or_create(&StateLabel { state: state.as_str() }).observe(seconds);
        self.iterations.inc_by(iterations);
        self.shots.inc_by(shots);
        if shots > 0 && seconds > 0.0 {
            self.job_shots_per_second.observe(shots as f64 / seconds);
        }
    }

    /// Counts a snapshot that took so long to encode and store.
    pub fn count_snapshot(&self, seconds: f64) {
        self.snapshot_seconds.observe(seconds);
    }

    /// Counts an attempt at a webhook.
    pub fn count_webhook(&self, outcome: &'static str) {
        self.count_webhooks(outcome, 1);
    }

    /// Counts messages to webhooks of which the same came.
    pub fn count_webhooks(&self, outcome: &'static str, messages: u64) {
        self.webhooks.get_or_create(&OutcomeLabel { outcome }).inc_by(messages);
    }

    /// Counts what retention removed.
    pub fn count_collected(&self, kind: &'static str, things: u64) {
        self.collected.get_or_create(&KindLabel { kind }).inc_by(things);
    }

    /// Says how many files that no record names the sweep left where they are.
    pub fn orphans_left(&self, files: u64) {
        self.orphans_left.set(gauge_value(files));
    }

    /// Says whether the clock is in doubt.
    pub fn clock_is_doubted(&self, doubted: bool) {
        self.clock_doubted.set(doubted.into());
    }

    /// All of it as text.
    ///
    /// # Errors
    /// Where a figure cannot be written as text.
    pub fn encode(&self, present: &Present) -> Result<String, std::fmt::Error> {
        for (state, count) in JobState::ALL.into_iter().zip(present.jobs.by_state) {
            let count = gauge_value(count);
            self.jobs.get_or_create(&StateLabel { state: state.as_str() }).set(count);
            if state == JobState::Queued {
                self.queue_depth.set(count);
            }
        }
        for device in present.devices.iter().filter(|device| device.in_pool) {
            for (status, state) in [
                (DeviceStatus::Opening, "opening"),
                (DeviceStatus::Idle, "idle"),
                (DeviceStatus::Busy, "busy"),
                (DeviceStatus::Failed, "failed"),
            ] {
                let labels = DeviceLabels { device: device.id.clone(), state };
                self.devices.get_or_create(&labels).set((device.status == Some(status)).into());
            }
        }
        self.webhooks_pending.set(gauge_value(present.webhooks_pending));
        if let Some(free) = present.disk_free_bytes {
            self.disk_free_bytes.set(gauge_value(free));
        }
        let mut out = String::new();
        text::encode(&mut out, &self.registry)?;
        Ok(out)
    }
}
