//! How a job that has but so much time uses all of it: work that does not fit is cut short, and what is
//! left after the last whole iteration goes where it lowers the error most.

use std::time::{Duration, Instant};

/// A kind of ray, each with its own speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Of records.
    Gather,
    /// From fragments to lights.
    Shadow,
    /// By lobes; counted by what they cost.
    Lobe,
}

/// Time that doubling the links takes, in what they took so far, and share of the rest of the time that it
/// may take.
const LINKS_LONGER: f64 = 1.5;
const LINKS_TIME: f64 = 0.5;
/// Time of an iteration with more links or more records, in that of the one before.
const LONGER: f64 = 1.6;

/// Speeds as measured, and the moment at which the last picture has to begin.
#[derive(Default)]
pub struct Pace {
    deadline: Option<Instant>,
    /// Of each kind: seconds, and rays in them.
    measured: [(f64, f64); 3],
    /// Seconds that an iteration takes: of the last one what the next repeats.
    iteration: Option<f64>,
}

impl Pace {
    /// From now on work has to end in so many seconds; `None` if it need not.
    pub fn ends_in(&mut self, seconds: Option<f64>) {
        let until = |seconds: f64| Instant::now() + Duration::from_secs_f64(seconds);
        // Nobody waits for longer than a year.
        self.deadline = seconds.filter(|left| *left < 3e7).map(|left| until(left.max(0.0)));
    }

    /// When such a share of what is left will have passed, if there is an end.
    pub fn until(&self, share: f64) -> Option<Instant> {
        let left = self.deadline.map(|_| Duration::from_secs_f64(share * self.left()));
        left.map(|left| Instant::now() + left)
    }

    /// Seconds that are left; ∞ if there is no end.
    pub fn left(&self) -> f64 {
        self.deadline.map_or(f64::INFINITY, |deadline| {
            deadline.saturating_duration_since(Instant::now()).as_secs_f64()
        })
    }

    /// Whether doubling the links, which took so many seconds so far, leaves time for what they improve.
    pub fn allows_links(&self, seconds: f64) -> bool {
        LINKS_LONGER * seconds <= LINKS_TIME * self.left()
    }

    /// Whether it is known how long an iteration takes.
    pub fn has_measured(&self) -> bool {
        self.iteration.is_some()
    }

    /// Whether another iteration fits into the time that is left; the first one always does.
    pub fn allows_iteration(&self, is_longer: bool) -> bool {
        let longer = if is_longer { LONGER } else { 1.0 };
        self.iteration.is_none_or(|seconds| longer * seconds <= self.left())
    }

    /// Learns how long an iteration takes, by one that began then and spent so many seconds on what the
    /// next one does not repeat. Returns the seconds of the rest.
    pub fn measure_iteration(&mut self, began: Instant, once: f64) -> f64 {
        let seconds = (began.elapsed().as_secs_f64() - once).max(0.0);
        self.iteration = Some(seconds);
        seconds
    }

    /// Forgets how long an iteration takes: the next one is of another picture.
    pub fn forget_iteration(&mut self) {
        self.iteration = None;
    }

    /// Learns how long rays of a kind take, by what has been done since.
    pub fn measure(&mut self, kind: Kind, began: Instant, rays: f64) {
        if rays > 0.0 {
            self.measured[kind as usize] = (began.elapsed().as_secs_f64(), rays);
        }
    }

    /// Rays of a kind that fit into so many seconds: at the speed of the last ones.
    pub fn rays_in(&self, kind: Kind, seconds: f64) -> f64 {
        let (measured, rays) = self.measured[kind as usize];
        if measured > 0.0 { rays * seconds / measured } else { f64::INFINITY }
    }

    /// Rays of a kind that fit into the time that is left.
    pub fn rays_left(&self, kind: Kind) -> f64 {
        self.rays_in(kind, self.left())
    }
}

/// Shares so many seconds out among causes whose errors fall with the root of the time that they got:
/// so that the sum of their squares becomes least. `spent` is what each has got so far.
pub fn shared_out(seconds: f64, errors: [f64; 3], spent: [f64; 3]) -> [f64; 3] {
    let worth = |k: usize| errors[k] * spent[k].sqrt();
    let mut takes: Vec<usize> = (0..3).filter(|k| worth(*k) > 0.0).collect();
    // Without those that have had enough already.
    loop {
        let all: f64 = takes.iter().map(|k| worth(*k)).sum();
        let time = seconds + takes.iter().map(|k| spent[*k]).sum::<f64>();
        let more = |k: usize| time * worth(k) / all - spent[k];
        match takes.iter().position(|k| more(*k) < 0.0) {
            Some(place) => {
                takes.remove(place);
            }
            None => {
                return std::array::from_fn(|k| if takes.contains(&k) { more(k) } else { 0.0 });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_goes_where_it_lowers_the_error_most() {
        let all = [[0.02, 0.1, 0.05], [0.0, 0.1, 0.0], [0.1, 0.1, 0.1], [0.3, 0.01, 0.02]];
        let spent = [1.0, 0.5, 2.0];
        for errors in all {
            let shares = shared_out(1.5, errors, spent);
            assert!((shares.iter().sum::<f64>() - 1.5).abs() < 1e-9, "{shares:?}");
            let left = |shares: [f64; 3]| -> f64 {
                (0..3).map(|k| errors[k].powi(2) * spent[k] / (spent[k] + shares[k])).sum()
            };
            let best = left(shares);
            for (from, to) in [(0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)] {
                let mut other = shares;
                let moved = 0.01f64.min(other[from]);
                other[from] -= moved;
                other[to] += moved;
                assert!(left(other) >= best - 1e-12, "{errors:?} {shares:?} {other:?}");
            }
        }
        assert_eq!(shared_out(1.0, [0.0; 3], spent), [0.0; 3], "nothing is known to be wrong");
    }

    #[test]
    fn rays_are_as_fast_as_the_last_ones() {
        let mut pace = Pace::default();
        assert_eq!(pace.rays_left(Kind::Lobe), f64::INFINITY);
        pace.ends_in(Some(10.0));
        pace.measure(Kind::Lobe, Instant::now() - Duration::from_secs(2), 200.0);
        let rays = pace.rays_left(Kind::Lobe);
        assert!((900.0..1001.0).contains(&rays), "{rays}");
        assert_eq!(pace.rays_left(Kind::Gather), f64::INFINITY, "their speed is not known");
        let until = pace.until(0.5).expect("there is an end");
        let half = until.duration_since(Instant::now()).as_secs_f64();
        assert!((4.5..5.01).contains(&half), "{half}");
        pace.ends_in(Some(-1.0));
        assert_eq!(pace.left(), 0.0);
        pace.ends_in(Some(f64::INFINITY));
        assert_eq!(pace.left(), f64::INFINITY);
        assert!(pace.until(0.5).is_none());
    }

    /// Links that were doubled in the last one say nothing of the next.
    #[test]
    fn an_iteration_is_expected_to_take_what_the_last_did_but_for_its_links() {
        let mut pace = Pace::default();
        pace.ends_in(Some(0.0));
        assert!(!pace.has_measured() && pace.allows_iteration(true), "the first one");
        let began = Instant::now() - Duration::from_secs(4);
        for (once, left, is_longer, fits) in [
            (0.0, 3.0, false, false),
            (2.0, 3.0, false, true),
            (2.0, 3.0, true, false),
            (2.0, 4.0, true, true),
            (5.0, 0.1, true, true),
        ] {
            pace.measure_iteration(began, once);
            pace.ends_in(Some(left));
            assert_eq!(pace.allows_iteration(is_longer), fits, "{once} {left} {is_longer}");
        }
        assert!(pace.has_measured());
        pace.forget_iteration();
        assert!(pace.allows_iteration(true));
    }

    #[test]
    fn links_leave_half_of_the_time() {
        let mut pace = Pace::default();
        assert!(pace.allows_links(1e9), "there is no end");
        pace.ends_in(Some(3.0));
        assert_eq!([0.9, 1.1].map(|spent| pace.allows_links(spent)), [true, false]);
    }
}
