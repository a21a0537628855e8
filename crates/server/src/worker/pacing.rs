//! When checkpoints of a run are taken: not too seldom, and not so often that it costs.

use std::time::{Duration, Instant};

/// Taking and writing checkpoints may cost this share of the time.
const SHARE: f64 = 0.02;

/// Decides when to take the next one.
pub struct Pacing {
    every: Option<Duration>,
    /// The next pause, where it is shorter than that; it doubles with each checkpoint.
    hurry: Option<Duration>,
    since: Instant,
    /// When the one under way was asked for.
    asked: Option<Instant>,
    /// Whether one is on its way and not yet stored.
    underway: bool,
    /// What the last one took to make, and to store.
    costs: [Duration; 2],
}

impl Pacing {
    /// One every so many seconds, where that is not too often; none with 0. The first one comes
    /// after `first_s` seconds where that is sooner, and the pauses after it double.
    pub fn new(every_s: f64, first_s: Option<f64>, now: Instant) -> Self {
        let seconds = |s: f64| (s > 0.0).then(|| Duration::from_secs_f64(s));
        Self {
            every: seconds(every_s),
            hurry: first_s.and_then(seconds),
            since: now,
            asked: None,
            underway: false,
            costs: [Duration::ZERO; 2],
        }
    }

    /// Whether to take one now.
    pub fn is_due(&mut self, now: Instant) -> bool {
        let Some(every) = self.every.filter(|_| !self.underway) else { return false };
        let pause = self.hurry.map_or(every, |hurry| hurry.min(every));
        let pause = pause.max((self.costs[0] + self.costs[1]).div_f64(SHARE));
        let due = now.duration_since(self.since) >= pause;
        if due {
            (self.since, self.asked) = (now, Some(now));
        }
        due
    }

    /// One was made; whether [`Pacing::is_due`] had asked for it, rather than the end of the run.
    pub fn made(&mut self, now: Instant) -> bool {
        let Some(asked) = self.asked.take() else { return false };
        self.costs[0] = now.duration_since(asked);
        (self.since, self.underway) = (now, true);
        self.hurry = self.hurry.map(|pause| 2 * pause).filter(|pause| Some(*pause) < self.every);
        true
    }

    /// Whether one is on its way and not yet stored.
    pub fn is_underway(&self) -> bool {
        self.underway
    }

    /// It is stored, which took so long.
    pub fn stored(&mut self, cost: Duration) {
        (self.costs[1], self.underway) = (cost, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checkpoints_are_neither_crowded_nor_dear() {
        let begun = Instant::now();
        let after = |ms| begun + Duration::from_millis(ms);
        let mut pacing = Pacing::new(0.03, None, begun);
        assert!(!pacing.is_due(after(29)));
        assert!(pacing.is_due(after(30)) && pacing.made(after(30)));
        assert!(!pacing.is_due(after(90)), "the last one is still on its way");
        pacing.stored(Duration::from_micros(10));
        assert!(pacing.is_due(after(90)) && pacing.made(after(90)));
        pacing.stored(Duration::from_secs(10));
        assert!(
            !pacing.is_due(after(499_000)),
            "ten seconds of writing are for five hundred of work"
        );
        assert!(!pacing.made(after(499_000)), "at the end nobody asked");
        assert!(pacing.is_due(after(501_000)));
        let mut never = Pacing::new(0.0, Some(0.01), begun);
        assert!(!never.is_due(after(1_000_000)));
    }

    #[test]
    fn a_hurried_run_takes_its_first_checkpoints_sooner() {
        let begun = Instant::now();
        let after = |ms| begun + Duration::from_millis(ms);
        let mut hurried = Pacing::new(3600.0, Some(0.02), begun);
        assert!(!hurried.is_due(after(19)));
        assert!(hurried.is_due(after(20)) && hurried.made(after(20)));
        hurried.stored(Duration::ZERO);
        assert!(!hurried.is_due(after(59)), "twice the first pause has not passed");
        assert!(hurried.is_due(after(60)) && hurried.made(after(60)));
        assert!(!Pacing::new(3600.0, None, begun).is_due(after(3_599_000)));
        let mut often = Pacing::new(0.02, Some(3600.0), begun);
        assert!(often.is_due(after(20)), "never later than without hurry");
    }
}
