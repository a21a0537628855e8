//! The service under load: event streams, posts, requests timed meanwhile; once with a full queue,
//! once with one that takes every post. Prints what came of it, and fails where the service broke a
//! promise.

use crate::results::Failure;
use hemilux_tests::load::{self, Load, Report};
use hemilux_tests::server::Server;

/// Most that the server's memory may grow, MiB: with a full queue, and with one that takes all.
const MOST_GROWTH_MIB: (f64, f64) = (512.0, 128.0);
/// Longest end, seconds.
const LONGEST_DRAIN_S: f64 = 10.0;
/// The time within which 99 % of the posts that are accepted must be, milliseconds.
const LONGEST_POST_MS: f64 = 250.0;
/// Share of the posts that must get through, of those that there is time for.
const LEAST_SHARE: f64 = 0.9;
/// The soft limit on open files that servers start with, as most systems set it.
const SOFT_LIMIT: u32 = 1024;

/// Arguments of `load`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Event streams open at the same time.
    #[arg(long, default_value_t = 500)]
    streams: usize,
    /// Job posts a second.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    posts_per_s: u32,
    /// How long with a full queue, seconds.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// How long with posts that are accepted, seconds.
    #[arg(long, default_value_t = 15.0)]
    accepted_seconds: f64,
    /// Jobs that fill the queue.
    #[arg(long, default_value_t = 200)]
    queued: usize,
}

/// A promise in words, and whether it was kept.
type Promise = (&'static str, bool);

/// Runs the load against servers of its own.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let &Arguments { streams, posts_per_s, seconds, accepted_seconds, queued } = arguments;
    load::raise_own_limit();
    println!("== a full queue");
    let server = Server::start_with_soft_limit(SOFT_LIMIT, &["--max-queued", &queued.to_string()]);
    let full = load::run(server, queued, Load { streams, posts_per_s, seconds });
    let mut promises = common(&full, streams, MOST_GROWTH_MIB.0);
    print(&full);

    println!("== posts that are accepted");
    let server = Server::start_with_soft_limit(SOFT_LIMIT, &["--max-queued", "1000000"]);
    let accepted = Load { streams, posts_per_s, seconds: accepted_seconds };
    let report = load::run_accepted(server, accepted);
    promises.extend(common(&report, streams, MOST_GROWTH_MIB.1));
    print(&report);
    let posted = report.posts.get(&202).copied().unwrap_or(0);
    let wanted = LEAST_SHARE * f64::from(posts_per_s) * accepted_seconds;
    println!("followed to the end: {} jobs", report.followed_to_the_end);
    promises.extend([
        ("every post is accepted", report.posts.len() == 1 && posted > 0),
        ("posts are accepted as fast as they come", posted as f64 >= wanted),
        ("a post takes less than 250 ms", report.post_quantile_ms(0.99) < LONGEST_POST_MS),
    ]);
    let broken: Vec<_> = promises.iter().filter(|(_, kept)| !kept).map(|(what, _)| *what).collect();
    if broken.is_empty() { Ok(()) } else { Err(format!("broken: {}", broken.join(", ")).into()) }
}

/// What holds whether posts are accepted or not.
fn common(report: &Report, streams: usize, most_growth_mib: f64) -> Vec<Promise> {
    let (before, peak) = report.memory_mib;
    vec![
        ("every stream opens", report.streams == streams as u64),
        ("no stream is lost", report.streams_lost == 0),
        ("every request is answered", report.unanswered == 0),
        ("429 and 503 say when to come back", report.without_retry_after == 0),
        ("no server error", report.posts.keys().all(|status| *status < 500)),
        ("memory is bounded", peak - before < most_growth_mib),
        ("the end is quick", report.drain_s < LONGEST_DRAIN_S),
    ]
}

fn print(report: &Report) {
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
    let [get, post] = [&report.get_ms, &report.post_ms].map(Vec::len);
    println!(
        "GET /v1/jobs/{{id}}: {get} requests, p50 {:.1} ms, p99 {:.1} ms, longest {:.1} ms",
        report.get_quantile_ms(0.5),
        report.get_quantile_ms(0.99),
        report.get_quantile_ms(1.0)
    );
    println!(
        "POST /v1/jobs: {post} requests, p50 {:.1} ms, p99 {:.1} ms, longest {:.1} ms",
        report.post_quantile_ms(0.5),
        report.post_quantile_ms(0.99),
        report.post_quantile_ms(1.0)
    );
    println!("resident memory: {before:.0} MiB before, {peak:.0} MiB at the peak");
    println!("end after SIGTERM: {:.2} s", report.drain_s);
}
