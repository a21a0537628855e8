//! How often each caller may ask: a bucket of tokens for each, refilled at a steady rate.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Seconds of the rate that may come at once.
const BURST_S: f64 = 2.0;
/// Fewest requests that may come at once: a page asks for some things together.
const LEAST_BURST: f64 = 5.0;
/// Callers that are remembered. Beyond it full buckets are forgotten, which changes nothing, and
/// then those that were quiet for the longest time.
const MAX_CALLERS: usize = 20_000;

#[derive(Clone, Copy)]
struct Bucket {
    tokens: f64,
    at: Instant,
    rate: f64,
}

impl Bucket {
    fn level(&self, now: Instant) -> f64 {
        let gained = now.saturating_duration_since(self.at).as_secs_f64() * self.rate;
        (self.tokens + gained).min(burst(self.rate))
    }
}

fn burst(rate: f64) -> f64 {
    (BURST_S * rate).max(LEAST_BURST)
}

/// The buckets of all callers.
#[derive(Default)]
pub struct RateLimiter {
    buckets: Mutex<HashMap<String, Bucket>>,
}

impl RateLimiter {
    /// Takes a token from the bucket of `caller`, which may ask `rate` times a second.
    ///
    /// # Errors
    /// How long until there is one, where there is none.
    pub fn take(&self, caller: &str, rate: f64, now: Instant) -> Result<(), Duration> {
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        if buckets.len() >= MAX_CALLERS && !buckets.contains_key(caller) {
            make_room(&mut buckets, now);
        }
        let full = Bucket { tokens: burst(rate), at: now, rate };
        let bucket = buckets.entry(caller.to_owned()).or_insert(full);
        let level = bucket.level(now).min(burst(rate));
        let enough = level >= 1.0;
        *bucket = Bucket { tokens: if enough { level - 1.0 } else { level }, at: now, rate };
        if enough { Ok(()) } else { Err(Duration::from_secs_f64((1.0 - level) / rate)) }
    }
}

fn make_room(buckets: &mut HashMap<String, Bucket>, now: Instant) {
    buckets.retain(|_, bucket| bucket.level(now) < burst(bucket.rate));
    if buckets.len() >= MAX_CALLERS {
        let mut times: Vec<Instant> = buckets.values().map(|bucket| bucket.at).collect();
        let middle = times.len() / 2;
        let (_, &mut median, _) = times.select_nth_unstable(middle);
        buckets.retain(|_, bucket| bucket.at > median);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_passes_and_then_the_rate() {
        let limiter = RateLimiter::default();
        let start = Instant::now();
        let after = |seconds: f64| start + Duration::from_secs_f64(seconds);
        for _ in 0..20 {
            assert!(limiter.take("a", 10.0, start).is_ok());
        }
        let wait = limiter.take("a", 10.0, start).unwrap_err();
        assert!((wait.as_secs_f64() - 0.1).abs() < 1e-9, "{wait:?}");
        // Others are not concerned.
        assert!(limiter.take("b", 10.0, start).is_ok());
        // A tenth of a second later there is one, and one only.
        assert!(limiter.take("a", 10.0, after(0.101)).is_ok());
        assert!(limiter.take("a", 10.0, after(0.102)).is_err());
        // In the long run the rate holds.
        let passed = (0..10_000)
            .filter(|i| limiter.take("a", 10.0, after(1.0 + f64::from(*i) / 100.0)).is_ok())
            .count();
        assert!((1000..=1025).contains(&passed), "{passed}");
    }

    #[test]
    fn callers_are_forgotten_before_memory_runs_out() {
        let limiter = RateLimiter::default();
        let start = Instant::now();
        for caller in 0..3 * MAX_CALLERS {
            let now = start + Duration::from_micros(caller as u64);
            limiter.take(&caller.to_string(), 1.0, now).unwrap();
        }
        assert!(limiter.buckets.lock().unwrap().len() <= MAX_CALLERS);
    }
}
