//! Counters for Prometheus.

use crate::job_state::JobState;
use crate::store::JobCounts;
use axum::http::{Method, StatusCode};
use prometheus_client::encoding::{EncodeLabelSet, text};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
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
struct StateLabel {
    state: &'static str,
}

/// Everything that is counted.
pub struct Metrics {
    registry: Registry,
    requests: Family<RequestLabels, Counter>,
    jobs: Family<StateLabel, Gauge>,
    queue_depth: Gauge,
    streams: Gauge,
    iterations: Counter,
    shots: Counter,
    job_seconds: Family<StateLabel, Histogram>,
}

impl Default for Metrics {
    fn default() -> Self {
        let mut registry = Registry::with_prefix("hemilux");
        let requests = Family::default();
        registry.register("http_requests", "HTTP requests", requests.clone());
        let jobs = Family::default();
        registry.register("jobs", "Jobs by state", jobs.clone());
        let queue_depth = Gauge::default();
        registry.register("queue_depth", "Jobs that wait", queue_depth.clone());
        let streams = Gauge::default();
        registry.register("event_streams", "Open event streams", streams.clone());
        let iterations = Counter::default();
        registry.register("iterations", "Iterations of ended jobs", iterations.clone());
        let shots = Counter::default();
        registry.register("shots", "Hemicube shots of ended jobs", shots.clone());
        let job_seconds = Family::<StateLabel, Histogram>::new_with_constructor(|| {
            Histogram::new(exponential_buckets(0.1, 2.0, 16))
        });
        let help = "Seconds that a worker spent on a job, by end state";
        registry.register("job_seconds", help, job_seconds.clone());
        Self { registry, requests, jobs, queue_depth, streams, iterations, shots, job_seconds }
    }
}

/// Counts an open stream until dropped.
pub struct StreamCount(Gauge);

impl Drop for StreamCount {
    fn drop(&mut self) {
        self.0.dec();
    }
}

impl Metrics {
    /// Counts an answered request.
    pub fn count_request(&self, method: &Method, route: String, status: StatusCode) {
        // Made-up methods must not make new time series.
        let known = [Method::GET, Method::HEAD, Method::POST, Method::DELETE];
        let method = if known.contains(method) { method.as_str() } else { "other" };
        let labels = RequestLabels { method: method.into(), route, status: status.as_u16() };
        self.requests.get_or_create(&labels).inc();
    }

    /// Counts an event stream that opens.
    pub fn count_stream(&self) -> StreamCount {
        self.streams.inc();
        StreamCount(self.streams.clone())
    }

    /// Counts a job that ended.
    pub fn count_job(&self, state: JobState, seconds: f64, iterations: u64, shots: u64) {
        self.job_seconds.get_or_create(&StateLabel { state: state.as_str() }).observe(seconds);
        self.iterations.inc_by(iterations);
        self.shots.inc_by(shots);
    }

    /// All of it as text, with the store's present job counts.
    pub fn encode(&self, counts: &JobCounts) -> Result<String, std::fmt::Error> {
        for (state, count) in JobState::ALL.into_iter().zip(counts.by_state) {
            let count = i64::try_from(count).unwrap_or(i64::MAX);
            self.jobs.get_or_create(&StateLabel { state: state.as_str() }).set(count);
            if state == JobState::Queued {
                self.queue_depth.set(count);
            }
        }
        let mut out = String::new();
        text::encode(&mut out, &self.registry)?;
        Ok(out)
    }
}
