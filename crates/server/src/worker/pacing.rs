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
    pub fn new(every_s: f64, first_s: Option<f64>) -> Self {
        let seconds = |s: f64| (s > 0.0).then(|| Duration::from_secs_f64(s));
        Self {
            every: seconds(every_s),
            hurry: first_s.and_then(seconds),
            since: Instant::now(),
            asked: None,
            underway: false,
            costs: [Duration::ZERO; 2],
        }
    }

    /// Whether to take one now.
    pub fn is_due(&mut self) -> bool {
        let Some(every) = self.every.filter(|_| !self.underway) else { return false };
        let pause = self.hurry.map_or(every, |hurry| hurry.min(every));
        let pause = pause.max((self.costs[0] + self.costs[1]).div_f64(SHARE));
        let due = self.since.elapsed() >= pause;
        if due {
            (self.since, self.asked) = (Instant::now(), Some(Instant::now()));
        }
        due
    }

    /// One was made; whether [`Pacing::is_due`] had asked for it, rather than the end of the run.
    pub fn made(&mut self) -> bool {
        let Some(asked) = self.asked.take() else { return false };
        self.costs[0] = asked.elapsed();
        (self.since, self.underway) = (Instant::now(), true);
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
        let pause = || std::thread::sleep(Duration::from_millis(40));
        let mut pacing = Pacing::new(0.03, None);
        assert!(!pacing.is_due(), "not at once");
        pause();
        assert!(pacing.is_due() && pacing.made());
        pause();
        assert!(!pacing.is_due(), "the last one is still on its way");
        pacing.stored(Duration::from_micros(10));
        pause();
        assert!(pacing.is_due() && pacing.made());
        pacing.stored(Duration::from_secs(10));
        pause();
        assert!(!pacing.is_due(), "ten seconds of writing are for five hundred of work");
        assert!(!pacing.made(), "at the end nobody asked");
        let mut never = Pacing::new(0.0, Some(0.01));
        pause();
        assert!(!never.is_due());
    }

    #[test]
    fn a_hurried_run_takes_its_first_checkpoints_sooner() {
        let pause = |ms| std::thread::sleep(Duration::from_millis(ms));
        let mut hurried = Pacing::new(3600.0, Some(0.02));
        assert!(!hurried.is_due(), "not at once");
        pause(25);
        assert!(hurried.is_due() && hurried.made());
        hurried.stored(Duration::ZERO);
        pause(25);
        assert!(!hurried.is_due(), "twice the first pause has not passed");
        pause(25);
        assert!(hurried.is_due() && hurried.made());
        assert!(!Pacing::new(3600.0, None).is_due());
        let mut often = Pacing::new(0.02, Some(3600.0));
        pause(25);
        assert!(often.is_due(), "never later than without hurry");
    }
}
