//! What a job may spend: what was asked for, and apart from that what whoever runs it allows.

use crate::device::Tally;
use crate::render::{ErrorBounds, Figures, Limits, Progress, StopReason};

/// What a job may spend.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// Seconds that were asked for.
    seconds: Option<f64>,
    /// Iterations that were asked for.
    iterations: Option<u64>,
    /// Estimated rRMSE that was asked for.
    target_error: Option<f64>,
    /// Most seconds that are allowed, whatever was asked for.
    allowed_seconds: Option<f64>,
}

/// Where a job stands.
#[derive(Clone, Copy, Debug, Default)]
pub struct Standing {
    /// What was done so far.
    pub tally: Tally,
    /// Seconds since solving began, in all attempts.
    pub seconds: f64,
    /// Seconds that the last picture will take; they are part of the budget.
    pub picture_seconds: f64,
    /// Estimated rRMSE of the present picture.
    pub estimated_error: Option<f64>,
    /// What the true one most likely lies between.
    pub error_bounds: Option<ErrorBounds>,
    /// Whether there is nothing to estimate the error from: the method can't, or every pixel sees
    /// an emitter or darkness. Then a target error alone does not end the job, the default time
    /// budget does.
    pub without_estimate: bool,
    /// Share of the work done, where the method knows it better than the budget does.
    pub known_fraction: Option<f64>,
}

impl Budget {
    /// The budget that these limits set.
    pub fn new(limits: Limits) -> Self {
        let Limits { seconds, iterations, target_error, cap_seconds } = limits;
        Self { seconds, iterations, target_error, allowed_seconds: cap_seconds }
    }

    /// Why to stop before another iteration, if at all. At least one iteration is done, however
    /// little time there is.
    pub fn stop(&self, at: &Standing) -> Option<StopReason> {
        if self.iterations.is_some_and(|limit| at.tally.iterations >= limit) {
            return Some(StopReason::Iterations);
        }
        if at.tally.iterations > 0
            && let Some(reason) = self.out_of_time(at)
        {
            return Some(reason);
        }
        let error = at.estimated_error?;
        self.target_error.is_some_and(|target| error <= target).then_some(StopReason::TargetError)
    }

    /// Which of the times only suffices for the last picture, if any does: the one that was asked
    /// for, or the longest that is allowed.
    pub fn out_of_time(&self, at: &Standing) -> Option<StopReason> {
        let needed = at.seconds + at.picture_seconds;
        let is_over = |limit: Option<f64>| limit.is_some_and(|limit| needed >= limit);
        if is_over(self.seconds_asked(at)) {
            Some(StopReason::TimeBudget)
        } else if is_over(self.allowed_seconds) {
            Some(StopReason::ServerLimit)
        } else {
            None
        }
    }

    /// Seconds until it is out of time, the last picture's not left out; `None` where no time ends it.
    pub fn seconds_left(&self, at: &Standing) -> Option<f64> {
        let limits = [self.seconds_asked(at), self.allowed_seconds].into_iter().flatten();
        limits.reduce(f64::min).map(|limit| limit - at.seconds)
    }

    /// Whether the job may end by its estimated error.
    pub fn wants_estimate(&self) -> bool {
        self.target_error.is_some()
    }

    /// Iterations that are left of those asked for.
    pub fn iterations_left(&self, at: &Standing) -> u64 {
        self.iterations.unwrap_or(u64::MAX).saturating_sub(at.tally.iterations)
    }

    /// The seconds that were asked for, or the default where nothing else would end the job.
    fn seconds_asked(&self, at: &Standing) -> Option<f64> {
        let endless = self.target_error.is_none() || at.without_estimate;
        let unlimited = self.iterations.is_none() && endless;
        self.seconds.or(unlimited.then_some(Limits::DEFAULT_SECONDS))
    }

    /// How far a job that stands there is on its way to the nearest limit.
    pub fn progress(&self, at: &Standing) -> Progress {
        let seconds = at.seconds;
        let Tally { iterations: done, shots, light_shots } = at.tally;
        let by_time = self.seconds_left(at).map(|left| left.max(0.0));
        let by_iterations = (self.iterations)
            .filter(|_| done > 0)
            .map(|limit| seconds / done as f64 * limit.saturating_sub(done) as f64);
        // Noise falls with the square root of time.
        let by_error = (self.target_error)
            .zip(at.estimated_error)
            .map(|(target, error)| seconds * ((error / target).powi(2) - 1.0).max(0.0));
        let by_fraction = (at.known_fraction)
            .filter(|fraction| *fraction > 0.0)
            .map(|fraction| seconds * (1.0 / fraction - 1.0).max(0.0));
        let seconds_remaining =
            [by_time, by_iterations, by_error, by_fraction].into_iter().flatten().reduce(f64::min);
        Progress {
            figures: Figures {
                iterations: done,
                shots,
                light_source_selection_ratio: light_shots as f64 / shots.max(1) as f64,
                estimated_error: at.estimated_error,
                error_bounds: at.error_bounds,
            },
            seconds,
            seconds_remaining,
            fraction: seconds_remaining.map_or(0.0, |rest| seconds / (seconds + rest).max(1e-9)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_that_cannot_be_estimated_ends_by_time() {
        let mut budget = Budget::new(Limits { target_error: Some(0.05), ..Limits::default() });
        let tally = Tally { iterations: 1, ..Tally::default() };
        let mut at = Standing { tally, seconds: 60.0, ..Standing::default() };
        assert_eq!(budget.stop(&at), None, "an estimate may still come");
        at.without_estimate = true;
        assert_eq!(budget.stop(&at), Some(StopReason::TimeBudget));
        budget.seconds = Some(120.0);
        assert_eq!(budget.stop(&at), None, "a longer time was asked for");
        (at.estimated_error, at.without_estimate) = (Some(0.04), false);
        assert_eq!(budget.stop(&at), Some(StopReason::TargetError));
    }

    #[test]
    fn what_was_asked_for_goes_before_what_is_allowed() {
        let limits = Limits { target_error: Some(0.05), seconds: Some(120.0), ..Limits::default() };
        let mut budget = Budget::new(Limits { cap_seconds: Some(90.0), ..limits });
        let tally = Tally { iterations: 1, ..Tally::default() };
        let error = Some(0.06);
        let at = Standing { tally, seconds: 60.0, estimated_error: error, ..Standing::default() };
        assert_eq!(budget.stop(&at), None, "the longest time is not reached");
        assert!(budget.progress(&at).seconds_remaining.is_some_and(|rest| rest <= 30.0));
        budget.allowed_seconds = Some(30.0);
        assert_eq!(budget.stop(&at), Some(StopReason::ServerLimit));
        budget.seconds = Some(20.0);
        assert_eq!(budget.stop(&at), Some(StopReason::TimeBudget));
        // The last picture takes its share.
        budget.allowed_seconds = None;
        let slow = Standing { seconds: 19.0, picture_seconds: 2.0, ..at };
        assert_eq!(budget.out_of_time(&slow), Some(StopReason::TimeBudget));
        assert_eq!(budget.out_of_time(&Standing { picture_seconds: 0.5, ..slow }), None);
    }
}
