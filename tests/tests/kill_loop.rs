//! `kill -9` of the server at random moments. A short loop here; `scripts/kill-loop` runs this
//! test at full size, 200 kills over 100 jobs.

use hemilux_tests::kill_loop::{Plan, run};

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(default)
}

#[test]
fn nothing_is_lost_or_doubled_by_kill_9() {
    let plan = Plan {
        jobs: setting("HEMILUX_KILL_LOOP_JOBS", 10) as usize,
        kills: setting("HEMILUX_KILL_LOOP_KILLS", 12) as usize,
        clients: 4,
        iterations: setting("HEMILUX_KILL_LOOP_ITERATIONS", 1200),
        uptime: (0.2, 2.5),
        seed: setting("HEMILUX_KILL_LOOP_SEED", 1),
    };
    println!("{plan:#?}");
    let tally = run(&plan);
    println!("{tally:#?}");
    assert_eq!(tally.jobs, plan.jobs);
    // The loop is worth something only where it hits.
    assert!(tally.kills_of_running_jobs > 0 && tally.resumed_streams > 0, "{tally:?}");
}
