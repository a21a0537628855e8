//! The service under load: event streams, posts against a full queue, requests timed meanwhile.
//! Prints what came of it, and fails where the service broke a promise.

use crate::results::Failure;
use hemilux_tests::load::{Load, run as put};
use hemilux_tests::server::Server;

/// Most that the server's memory may grow, MiB.
const MOST_GROWTH_MIB: f64 = 512.0;
/// Longest end, seconds.
const LONGEST_DRAIN_S: f64 = 10.0;

/// Arguments of `load`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Event streams open at the same time.
    #[arg(long, default_value_t = 500)]
    streams: usize,
    /// Job posts a second.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    posts_per_s: u32,
    /// How long, seconds.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Jobs that fill the queue.
    #[arg(long, default_value_t = 200)]
    queued: usize,
}

/// Runs the load against a server of its own.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let &Arguments { streams, posts_per_s, seconds, queued } = arguments;
    let server = Server::start_with(&["--max-queued", &queued.to_string()]);
    let report = put(server, queued, Load { streams, posts_per_s, seconds });
    let (before, peak) = report.memory_mib;
    println!(
        "streams: {} open, {} lost, {} events",
        report.streams, report.streams_lost, report.events
    );
    println!("posts by status: {:?}", report.posts);
    println!(
        "without Retry-After: {}; without an answer: {}",
        report.without_retry_after, report.unanswered
    );
    println!(
        "GET /v1/jobs/{{id}}: {} requests, p50 {:.1} ms, p99 {:.1} ms, longest {:.1} ms",
        report.get_ms.len(),
        report.get_quantile_ms(0.5),
        report.get_quantile_ms(0.99),
        report.get_quantile_ms(1.0)
    );
    println!("resident memory: {before:.0} MiB before, {peak:.0} MiB at the peak");
    println!("end after SIGTERM: {:.2} s", report.drain_s);
    let promises = [
        ("every stream opens", report.streams == streams as u64),
        ("no stream is lost", report.streams_lost == 0),
        ("every request is answered", report.unanswered == 0),
        ("429 and 503 say when to come back", report.without_retry_after == 0),
        (
            "no server error but 503",
            report.posts.keys().all(|status| *status < 500 || *status == 503),
        ),
        ("memory is bounded", peak - before < MOST_GROWTH_MIB),
        ("the end is quick", report.drain_s < LONGEST_DRAIN_S),
    ];
    let broken: Vec<_> = promises.iter().filter(|(_, kept)| !kept).map(|(what, _)| *what).collect();
    if broken.is_empty() { Ok(()) } else { Err(format!("broken: {}", broken.join(", ")).into()) }
}
