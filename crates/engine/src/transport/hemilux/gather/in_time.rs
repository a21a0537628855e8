//! How many records are made, and with how many rays, where there is no time for all of them.

use std::time::Instant;

/// Share of what is left of the time that one batch of records may take: others follow.
const SHARE: f64 = 0.5;
/// Rays of a record are a multiple of this.
const STEP: u32 = 8;

/// The time that there is for records, and how fast their rays are.
pub struct TimeLimit {
    until: Option<Instant>,
    began: Instant,
    rays: f64,
    /// Whether records were left out for it.
    pub is_felt: bool,
}

impl TimeLimit {
    /// From now on, until then if there is an end.
    pub fn new(until: Option<Instant>) -> Self {
        Self { until, began: Instant::now(), rays: 0.0, is_felt: false }
    }

    /// Learns that so many rays have been traced.
    pub fn count(&mut self, records: usize, rays: u32) {
        self.rays += records as f64 * f64::from(rays);
    }

    /// Rays that one batch may have; ∞ without an end, and as long as no speed is known.
    fn allowed(&self) -> f64 {
        let Some(until) = self.until.filter(|_| self.rays > 0.0) else { return f64::INFINITY };
        let left = until.saturating_duration_since(Instant::now()).as_secs_f64();
        let each = self.began.elapsed().as_secs_f64() / self.rays;
        SHARE * left / each.max(f64::MIN_POSITIVE)
    }

    /// Rays of each of so many records, `wanted` if there is time.
    pub fn rays(&self, records: usize, wanted: u32) -> u32 {
        let each = self.allowed() / records.max(1) as f64;
        if each >= f64::from(wanted) { wanted } else { each as u32 / STEP * STEP }
    }

    /// Which of these places get a record, and how many rays it has: `wanted`, or fewer but no less than
    /// `fewest`; where there is no time for that, every n-th place gets one.
    pub fn records(&mut self, places: Vec<u32>, wanted: u32, fewest: u32) -> (Vec<u32>, u32) {
        let rays = self.rays(places.len(), wanted);
        if rays >= wanted.min(fewest) || places.is_empty() {
            return (places, rays);
        }
        self.is_felt = true;
        let fewest = fewest.min(wanted);
        let count = (self.allowed() / f64::from(fewest)) as usize;
        let every = places.len().div_ceil(count.max(1));
        let chosen = places.into_iter().step_by(every).take(count);
        (chosen.collect(), fewest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// So many seconds before the end, at 1000 rays a second.
    fn limit(seconds: f64) -> TimeLimit {
        let now = Instant::now();
        TimeLimit {
            until: Some(now + Duration::from_secs_f64(seconds)),
            began: now - Duration::from_secs(10),
            rays: 10_000.0,
            is_felt: false,
        }
    }

    #[test]
    fn without_an_end_nothing_is_left_out() {
        let mut limit = TimeLimit::new(None);
        limit.count(1_000_000, 64);
        assert_eq!(limit.records((0..500).collect(), 64, 16), ((0..500).collect(), 64));
        assert!(!limit.is_felt);
    }

    #[test]
    fn less_time_means_fewer_rays_and_then_fewer_records() {
        let places = || (0..100).collect::<Vec<u32>>();
        // Half of the rays that fit: 6400, 2500, 800 and none.
        assert_eq!(limit(12.9).records(places(), 64, 16), (places(), 64));
        let (all, rays) = limit(5.0).records(places(), 64, 16);
        assert!(all.len() == 100 && rays == 24, "{} {rays}", all.len());
        let mut short = limit(1.61);
        let (some, rays) = short.records(places(), 64, 16);
        assert!((30..=50).contains(&some.len()) && rays == 16, "{} {rays}", some.len());
        assert!(short.is_felt && some.windows(2).all(|pair| pair[1] > pair[0]));
        assert!(limit(0.0).records(places(), 64, 16).0.is_empty());
        assert!(limit(0.0).records(Vec::new(), 64, 16).0.is_empty());
    }
}
