//! Short versions of `scripts/load-test`: many streams and posts, against a full queue and against one
//! that takes all.

use hemilux_tests::load::{Load, raise_own_limit, run, run_accepted};
use hemilux_tests::server::Server;

#[test]
fn a_full_queue_says_so_and_the_rest_goes_on() {
    let server = Server::start_with(&["--max-queued", "20"]);
    let load = Load { streams: 100, posts_per_s: 100, seconds: 4.0 };
    let report = run(server, 20, load);
    println!("{:?}", Report(&report));
    assert_eq!(report.streams, 100);
    assert_eq!((report.streams_lost, report.streams_ended), (0, 100));
    assert!(report.events > 500, "{}", report.events);
    // Nothing but "the queue is full", every time with when to come back.
    assert_eq!(report.posts.keys().copied().collect::<Vec<_>>(), [429], "{:?}", report.posts);
    assert!(report.posts[&429] >= 200, "{:?}", report.posts);
    assert_eq!((report.without_retry_after, report.unanswered), (0, 0));
    assert!(report.get_ms.len() > 100);
    assert!(report.get_quantile_ms(0.99) < 2000.0, "{}", report.get_quantile_ms(0.99));
    let (before, peak) = report.memory_mib;
    assert!(peak < before + 150.0, "{before} MiB before, {peak} MiB at the peak");
    assert!(report.drain_s < 10.0, "{}", report.drain_s);
}

/// The figures without the single times.
struct Report<'a>(&'a hemilux_tests::load::Report);

impl std::fmt::Debug for Report<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self(report) = self;
        write!(
            f,
            "posts {:?}, events {}, p99 {:.1} ms, memory {:?} MiB, drain {:.2} s",
            report.posts,
            report.events,
            report.get_quantile_ms(0.99),
            report.memory_mib,
            report.drain_s
        )
    }
}

#[test]
fn posts_are_accepted_beside_many_streams() {
    raise_own_limit();
    let server = Server::start_with_soft_limit(256, &["--max-queued", "100000"]);
    let load = Load { streams: 400, posts_per_s: 50, seconds: 4.0 };
    let report = run_accepted(server, load);
    println!("{:?}, {} followed to the end", Report(&report), report.followed_to_the_end);
    assert_eq!(report.posts.keys().copied().collect::<Vec<_>>(), [202], "{:?}", report.posts);
    assert_eq!((report.streams, report.streams_lost, report.unanswered), (400, 0, 0));
    let (before, peak) = report.memory_mib;
    assert!(peak < before + 128.0, "{before} MiB before, {peak} MiB at the peak");
}
