use super::*;
use proptest::prelude::*;

const HOUR: u64 = 3600;
const DAY: u64 = 24 * HOUR;
const GRACE: Duration = Duration::from_secs(DAY);

fn at(seconds: i64) -> Timestamp {
    Timestamp::from_second(1_700_000_000 + seconds).unwrap()
}

fn up(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

fn memory(seconds: i64) -> Option<Memory> {
    Some(Memory { newest_ms: at(seconds).as_millisecond(), ahead_s: 0, served_s: 0 })
}

#[test]
fn a_start_a_year_ahead_is_doubted_for_a_day_of_uptime() {
    let year = 365 * DAY as i64;
    let mut judge = ExpiryClock::new(GRACE, memory(0), at(year), up(0));
    let reading = judge.look(at(year + 60), up(60));
    assert_eq!(reading.now, at(60));
    let why = reading.doubt.unwrap();
    assert!(why.contains("8760.0 h ahead") && why.contains("--clock-grace-hours 0"), "{why}");
    assert!(judge.look(at(year + DAY as i64 - 1), up(DAY - 1)).doubt.is_some());
    let believed = judge.look(at(year + DAY as i64), up(DAY));
    assert_eq!(believed, Reading { now: at(year + DAY as i64), doubt: None });
    // Whoever says that the service was off is believed at once, as is a start within a day.
    assert_eq!(
        ExpiryClock::new(up(0), memory(0), at(year), up(0)).look(at(year), up(0)).doubt,
        None
    );
    let soon = at(DAY as i64 - 1);
    assert_eq!(ExpiryClock::new(GRACE, memory(0), soon, up(0)).look(soon, up(0)).doubt, None);
    assert_eq!(ExpiryClock::new(GRACE, None, soon, up(0)).look(soon, up(0)).doubt, None);
}

#[test]
fn restarts_do_not_begin_the_grace_period_anew_and_do_not_end_it() {
    let year = 365 * DAY as i64;
    let (mut wall, mut kept) = (year, memory(0));
    for _ in 0..3 {
        let mut judge = ExpiryClock::new(GRACE, kept, at(wall), up(0));
        assert!(judge.look(at(wall), up(0)).doubt.is_some());
        wall += 7 * HOUR as i64;
        assert!(judge.look(at(wall), up(7 * HOUR)).doubt.is_some());
        kept = Some(judge.memory(at(wall), up(7 * HOUR)));
    }
    let mut judge = ExpiryClock::new(GRACE, kept, at(wall), up(0));
    assert!(judge.look(at(wall + 2 * HOUR as i64), up(2 * HOUR)).doubt.is_some());
    assert_eq!(judge.look(at(wall + 3 * HOUR as i64), up(3 * HOUR)).doubt, None);
    // Another error of the clock has a grace period of its own.
    let mut judge = ExpiryClock::new(GRACE, kept, at(9 * year), up(0));
    assert!(judge.look(at(9 * year + 4 * HOUR as i64), up(4 * HOUR)).doubt.is_some());
}

#[test]
fn a_clock_that_jumps_while_the_service_runs_is_doubted_until_it_comes_back() {
    for jump in [365 * DAY as i64, -365 * DAY as i64, 2 * HOUR as i64] {
        let mut judge = ExpiryClock::new(GRACE, None, at(0), up(0));
        assert_eq!(judge.look(at(60), up(60)).doubt, None);
        let reading = judge.look(at(120 + jump), up(120));
        assert!(reading.doubt.is_some(), "{jump}");
        assert_eq!(reading.now, at(120 + jump.min(0)), "{jump}");
        assert_eq!(judge.look(at(180), up(180)), Reading { now: at(180), doubt: None });
    }
}

#[test]
fn a_clock_behind_what_is_known_is_doubted() {
    let mut judge = ExpiryClock::new(GRACE, memory(0), at(-30 * DAY as i64), up(0));
    assert!(judge.look(at(-30 * DAY as i64), up(1)).doubt.is_some());
    assert_eq!(judge.look(at(2), up(2)).doubt, None);
}

/// What happens while the clock is behind must not look old once it is right.
#[test]
fn records_go_by_what_is_believed_while_the_clock_is_behind() {
    let year = 365 * DAY as i64;
    let hour = HOUR as i64;
    let mut judge = ExpiryClock::new(GRACE, memory(year), at(hour), up(0));
    judge.look(at(hour), up(0));
    let lag = |judge: &ExpiryClock, wall: i64, uptime| judge.lag(at(wall), up(uptime)).as_secs();
    assert_eq!(hour + lag(&judge, hour, 0), year);
    assert_eq!(hour + 60 + lag(&judge, hour + 60, 60), year + 60, "it goes on");
    judge.look(at(year + 120), up(120));
    assert_eq!(lag(&judge, year + 120, 120), 0, "the clock is right again");
    // A clock that is ahead is what people see: the service may have been off.
    let mut ahead = ExpiryClock::new(GRACE, memory(0), at(year), up(0));
    ahead.look(at(year), up(0));
    assert_eq!(lag(&ahead, year, 0), 0);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    /// Whatever the wall clock does, the time by which things expire is never more than a step
    /// ahead of the true one before a jump has lasted for the grace period.
    #[test]
    fn no_jump_is_believed_at_once(
        steps in prop::collection::vec((1..600u64, prop_oneof![3 => Just(0i64), 1 => -400 * DAY as i64..400 * DAY as i64]), 1..100)
    ) {
        let mut judge = ExpiryClock::new(GRACE, memory(0), at(0), up(0));
        let mut passed = 0;
        for (pause, jump) in steps {
            passed += pause;
            if passed >= DAY {
                break;
            }
            let reading = judge.look(at(passed as i64 + jump), up(passed));
            prop_assert!(reading.now.duration_since(at(passed as i64)) <= MAX_STEP);
            prop_assert_eq!(reading.doubt.is_some(), jump.unsigned_abs() > 3600);
        }
    }
}
