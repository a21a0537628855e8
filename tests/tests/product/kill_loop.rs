//! `kill -9` of the server at random moments. Short loops here; `scripts/kill-loop` runs the
//! first test at full size, 200 kills over 100 jobs, and what else its flags say.

use hemilux_tests::kill_loop::{Plan, Uptime, run};
use hemilux_tests::skips::skipped;
use hemilux_tests::small_disk::SmallDisk;
use std::time::Duration;

fn setting(name: &str) -> Option<String> {
    std::env::var(format!("HEMILUX_KILL_LOOP_{name}")).ok()
}

fn number(name: &str, default: u64) -> u64 {
    setting(name).map_or(default, |value| {
        value.parse().unwrap_or_else(|_| panic!("HEMILUX_KILL_LOOP_{name}={value}: not a number"))
    })
}

/// Shortest and longest time between kills, `LOW:HIGH` in seconds.
fn seconds_between_kills() -> Option<Uptime> {
    let text = setting("UPTIME_S")?;
    let (low, high) = text.split_once(':').expect("LOW:HIGH");
    let [low, high] = [low, high].map(|text| text.parse::<f64>().expect("seconds"));
    assert!(low <= high, "HEMILUX_KILL_LOOP_UPTIME_S={text}: not LOW:HIGH");
    Some(Uptime::Seconds(low, high))
}

fn plan() -> Plan {
    let is_set = |name| setting(name).is_some_and(|value| value == "1");
    let uptime = seconds_between_kills();
    Plan {
        jobs: number("JOBS", 10) as usize,
        kills: number("KILLS", 12) as usize,
        throughout: uptime.is_some(),
        clients: 4,
        iterations: number("ITERATIONS", 1200),
        uptime: uptime.unwrap_or(Uptime::Jobs(0.2, 2.5)),
        short_disk: is_set("SHORT_DISK"),
        restore: is_set("RESTORE"),
        patience: Duration::from_secs(if uptime.is_some() { 600 } else { 60 }),
        seed: number("SEED", 1),
    }
}

#[test]
fn nothing_is_lost_or_doubled_by_kill_9() {
    let plan = plan();
    println!("{plan:#?}");
    let tally = run(&plan);
    println!("{tally:#?}");
    assert_eq!(tally.jobs, plan.jobs);
    // The loop is worth something only where it hits.
    assert!(tally.kills_of_running_jobs > 0 && tally.resumed_streams > 0, "{tally:?}");
}

#[test]
fn nothing_is_lost_where_the_disk_is_short_and_the_database_is_put_back() {
    if setting("KILLS").is_some() {
        skipped("the other test runs at the size that was asked for");
        return;
    }
    if !plan().short_disk && !SmallDisk::is_allowed() {
        skipped("the system allows no mount namespaces");
        return;
    }
    let plan = Plan { short_disk: true, restore: true, jobs: 6, kills: 8, ..plan() };
    let tally = run(&plan);
    println!("{tally:#?}");
    assert_eq!(tally.jobs, plan.jobs);
    assert!(tally.shortages > 0 && tally.kills_of_running_jobs > 0, "{tally:?}");
}
