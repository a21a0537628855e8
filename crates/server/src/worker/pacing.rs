//! When checkpoints of a run are taken: not too seldom, and not so often that it costs.

use std::time::{Duration, Instant};

/// Taking and writing checkpoints may cost this share of the time.
const SHARE: f64 = 0.02;

/// Decides when to take the next one.
pub struct Pacing {
    every: Option<Duration>,
    since: Instant,
    /// When the one under way was asked for.
    asked: Option<Instant>,
    /// Whether one is on its way and not yet stored.
    underway: bool,
    /// What the last one took to make, and to store.
    costs: [Duration; 2],
}

impl Pacing {
    /// One every so many seconds, where that is not too often; none with 0.
    pub fn new(every_s: f64) -> Self {
        Self {
            every: (every_s > 0.0).then(|| Duration::from_secs_f64(every_s)),
            since: Instant::now(),
            asked: None,
            underway: false,
            costs: [Duration::ZERO; 2],
        }
    }

    /// Whether to take one now.
    pub fn is_due(&mut self) -> bool {
        let Some(every) = self.every.filter(|_| !self.underway) else { return false };
        let pause = every.max((self.costs[0] + self.costs[1]).div_f64(SHARE));
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
        let mut pacing = Pacing::new(0.03);
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
        let mut never = Pacing::new(0.0);
        pause();
        assert!(!never.is_due());
    }
}
