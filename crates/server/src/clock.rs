//! Which time to believe. Wall clocks jump: a machine boots with a flat battery, or a year ahead.
//! What is removed because of its age is removed for ever, so a time that nothing bears out removes
//! nothing at first.
//!
//! The newest time that was believed is kept in the store. A start more than [`MAX_AWAY`] after it,
//! and a wall clock that moves by more than [`MAX_STEP`] against the monotonic clock, put the wall
//! clock in doubt. While it is, the believed time goes on by the monotonic clock, and what expires
//! by age waits. The doubt ends when the wall clock comes back, or after a grace period of uptime,
//! in which an operator can see the warning.

use crate::failpoints;
use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A start later than this after the newest time that was believed is doubted, seconds: a day.
pub const MAX_AWAY: SignedDuration = SignedDuration::from_hours(24);
/// A wall clock that moves by more than this against the monotonic clock is doubted: an hour.
pub const MAX_STEP: SignedDuration = SignedDuration::from_hours(1);
/// How often the wall clock is taken as the measure again, so that slow drift never adds up.
const MEASURE_EVERY: Duration = Duration::from_secs(86_400);

/// The wall clock.
pub fn wall() -> Timestamp {
    let now = Timestamp::now();
    now.saturating_add(failpoints::clock_jump()).unwrap_or(now)
}

/// How far the wall clock of this process is behind what is believed, milliseconds.
static LAG_MS: AtomicI64 = AtomicI64::new(0);

/// The time for records: that of the wall clock, or, while that is in doubt and behind, what is
/// believed. What happens now must not look so old that it goes once the clock is right.
pub fn now() -> Timestamp {
    let lag = SignedDuration::from_millis(LAG_MS.load(Ordering::Relaxed));
    let wall = wall();
    wall.saturating_add(lag).unwrap_or(wall)
}

/// What is remembered of the clock between runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Memory {
    /// The newest time that was believed, milliseconds since 1970.
    pub newest_ms: i64,
    /// How far the wall clock was ahead of it, where that was in doubt, seconds.
    #[serde(default)]
    pub ahead_s: i64,
    /// How much of the grace period has passed in that doubt, seconds.
    #[serde(default)]
    pub served_s: u64,
}

impl Memory {
    /// Nothing but that this time is believed.
    pub fn of(newest: Timestamp) -> Self {
        Self { newest_ms: newest.as_millisecond(), ahead_s: 0, served_s: 0 }
    }
}

/// What the clock says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reading {
    /// The time by which things expire: never later than the wall clock says, and never later than
    /// what is believed.
    pub now: Timestamp,
    /// Why the wall clock is in doubt, where it is; then nothing is removed because of its age.
    pub doubt: Option<String>,
}

/// A reason to distrust the wall clock.
#[derive(Clone, Debug, PartialEq)]
struct Doubt {
    /// When it began, by the monotonic clock.
    since: Duration,
    /// What of the grace period passed in earlier runs.
    served: Duration,
    /// How far the wall clock is ahead of the believed time.
    ahead: SignedDuration,
}

/// The clock by which things expire: pure, told of both clocks by its callers.
#[derive(Clone, Debug)]
pub struct ExpiryClock {
    grace: Duration,
    /// A believed time, and the monotonic time at that moment.
    anchor: (Timestamp, Duration),
    doubt: Option<Doubt>,
}

fn signed(duration: Duration) -> SignedDuration {
    SignedDuration::try_from(duration).unwrap_or(SignedDuration::MAX)
}

impl ExpiryClock {
    /// A start at `wall`, by the monotonic clock `at`, where `memory` is what the run before left.
    pub fn new(grace: Duration, memory: Option<Memory>, wall: Timestamp, at: Duration) -> Self {
        let fresh = Self { grace, anchor: (wall, at), doubt: None };
        let newest = memory.and_then(|memory| Timestamp::from_millisecond(memory.newest_ms).ok());
        let (Some(newest), Some(memory)) = (newest, memory) else { return fresh };
        let ahead = wall.duration_since(newest);
        let is_near = ahead <= MAX_AWAY && ahead >= -MAX_STEP;
        if grace.is_zero() || is_near {
            return fresh;
        }
        // The doubt of the run before goes on where it is about the same error of the clock.
        let same = (ahead - SignedDuration::from_secs(memory.ahead_s)).abs() <= MAX_AWAY;
        let served = Duration::from_secs(if same { memory.served_s } else { 0 });
        Self { grace, anchor: (newest, at), doubt: Some(Doubt { since: at, served, ahead }) }
    }

    fn believed(&self, at: Duration) -> Timestamp {
        let since = signed(at.saturating_sub(self.anchor.1));
        self.anchor.0.saturating_add(since).unwrap_or(Timestamp::MAX)
    }

    fn served(&self, doubt: &Doubt, at: Duration) -> Duration {
        doubt.served + at.saturating_sub(doubt.since)
    }

    /// Takes a look at both clocks.
    pub fn look(&mut self, wall: Timestamp, at: Duration) -> Reading {
        let believed = self.believed(at);
        let ahead = wall.duration_since(believed);
        let is_near = ahead.abs() <= MAX_STEP;
        match &self.doubt {
            None if is_near || self.grace.is_zero() => {
                if !is_near || at.saturating_sub(self.anchor.1) >= MEASURE_EVERY {
                    self.anchor = (wall, at);
                }
            }
            None => self.doubt = Some(Doubt { since: at, served: Duration::ZERO, ahead }),
            Some(doubt) => {
                if is_near {
                    self.doubt = None;
                } else if self.served(doubt, at) >= self.grace {
                    (self.anchor, self.doubt) = ((wall, at), None);
                } else if (ahead - doubt.ahead).abs() > MAX_STEP {
                    // It jumped again: another doubt, with a grace period of its own.
                    self.doubt = Some(Doubt { since: at, served: Duration::ZERO, ahead });
                }
            }
        }
        match &self.doubt {
            None => Reading { now: wall, doubt: None },
            Some(doubt) => Reading {
                now: wall.min(believed),
                doubt: Some(self.explain(doubt, wall, believed, at)),
            },
        }
    }

    fn explain(&self, doubt: &Doubt, wall: Timestamp, believed: Timestamp, at: Duration) -> String {
        let left = self.grace.saturating_sub(self.served(doubt, at)).as_secs_f64() / 3600.0;
        let hours = doubt.ahead.as_secs_f64().abs() / 3600.0;
        let side = if doubt.ahead.is_negative() { "behind" } else { "ahead of" };
        format!(
            "the clock says {wall:.0}, {hours:.1} h {side} {believed:.0}, the newest time that this service knows to be right; nothing is removed because of its age for {left:.1} more hours of uptime, or until the clock is right; start with --clock-grace-hours 0 if the clock is right and the service was off"
        )
    }

    /// How far the wall clock is behind the believed time, where that is why it is in doubt.
    pub fn lag(&self, wall: Timestamp, at: Duration) -> SignedDuration {
        match &self.doubt {
            Some(_) => self.believed(at).duration_since(wall).max(SignedDuration::ZERO),
            None => SignedDuration::ZERO,
        }
    }

    /// What to remember for the next run.
    pub fn memory(&self, wall: Timestamp, at: Duration) -> Memory {
        let believed = self.believed(at);
        match &self.doubt {
            None => Memory { newest_ms: wall.as_millisecond(), ahead_s: 0, served_s: 0 },
            Some(doubt) => Memory {
                newest_ms: believed.as_millisecond(),
                ahead_s: wall.duration_since(believed).as_secs(),
                served_s: self.served(doubt, at).as_secs(),
            },
        }
    }
}

/// The clock of a running service.
pub struct Clock {
    began: Instant,
    judge: Mutex<ExpiryClock>,
}

impl Clock {
    /// A clock that begins now.
    pub fn new(grace: Duration, memory: Option<Memory>) -> Self {
        let judge = ExpiryClock::new(grace, memory, wall(), Duration::ZERO);
        let clock = Self { began: Instant::now(), judge: Mutex::new(judge) };
        clock.look();
        clock
    }

    /// Takes a look; [`now`] goes by it.
    pub fn look(&self) -> Reading {
        let mut judge = self.judge.lock().unwrap_or_else(PoisonError::into_inner);
        let (wall, at) = (wall(), self.began.elapsed());
        let reading = judge.look(wall, at);
        let lag = i64::try_from(judge.lag(wall, at).as_millis()).unwrap_or(0);
        LAG_MS.store(lag, Ordering::Relaxed);
        reading
    }

    /// What to remember for the next run.
    pub fn memory(&self) -> Memory {
        let judge = self.judge.lock().unwrap_or_else(PoisonError::into_inner);
        judge.memory(wall(), self.began.elapsed())
    }
}

#[cfg(test)]
mod tests;
