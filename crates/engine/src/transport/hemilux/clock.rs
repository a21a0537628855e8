//! A stopwatch for the diagnostics of a job: seconds by part of the method.

use std::collections::BTreeMap;
use std::time::Instant;

/// Seconds by what they were spent on.
pub struct Clock {
    last: Instant,
    pub spent: BTreeMap<&'static str, f64>,
}

impl Default for Clock {
    fn default() -> Self {
        Self { last: Instant::now(), spent: BTreeMap::new() }
    }
}

impl Clock {
    /// Leaves out the time until now.
    pub fn start(&mut self) {
        self.last = Instant::now();
    }

    /// Counts the time since the last lap, or [`Clock::start`], as spent on `what`.
    pub fn lap(&mut self, what: &'static str) {
        let now = Instant::now();
        *self.spent.entry(what).or_default() += (now - self.last).as_secs_f64();
        self.last = now;
    }

    /// Seconds that were spent on some parts together.
    pub fn of(&self, parts: &[&str]) -> f64 {
        parts.iter().filter_map(|part| self.spent.get(part)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn laps_add_up_and_pauses_are_left_out() {
        let mut clock = Clock::default();
        std::thread::sleep(Duration::from_millis(30));
        clock.lap("one");
        std::thread::sleep(Duration::from_millis(30));
        clock.start();
        clock.lap("two");
        clock.lap("one");
        assert!(clock.spent["one"] >= 0.03, "{:?}", clock.spent);
        assert!(clock.spent["two"] < 0.03, "{:?}", clock.spent);
        assert_eq!(clock.of(&["two", "three", "one"]), clock.spent["one"] + clock.spent["two"]);
    }
}
