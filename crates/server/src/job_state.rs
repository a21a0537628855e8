//! The life of a job: its states and the only legal ways between them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Attempts after which a job that keeps killing its worker is given up.
pub const MAX_ATTEMPTS: u32 = 5;

/// Where a job stands in its life.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Accepted and waiting for a device.
    Queued,
    /// A worker holds it.
    Running,
    /// Done; the result is there.
    Succeeded,
    /// Given up; the job's `error` says why.
    Failed,
    /// Stopped at the client's wish.
    Cancelled,
}

impl JobState {
    /// Every state.
    pub const ALL: [JobState; 5] =
        [Self::Queued, Self::Running, Self::Succeeded, Self::Failed, Self::Cancelled];

    /// The name in the API and in the store.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// The state of that name.
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.as_str() == name)
    }

    /// Whether nothing can happen to the job any more.
    pub fn is_terminal(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }

    /// Whether a job may go from `self` to `next`.
    pub fn may_become(self, next: Self) -> bool {
        use JobState::{Cancelled, Failed, Queued, Running, Succeeded};
        matches!(
            (self, next),
            (Queued, Running | Cancelled)
                | (Running, Succeeded | Failed | Cancelled)
                // The worker died or was asked to shut down.
                | (Running, Queued)
        )
    }
}

/// What becomes of a running job whose worker is gone, after `attempts` counted attempts.
pub fn after_lost_worker(attempts: u32, cancel_requested: bool) -> JobState {
    if cancel_requested {
        JobState::Cancelled
    } else if attempts >= MAX_ATTEMPTS {
        JobState::Failed
    } else {
        JobState::Queued
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminal_states_are_final() {
        for from in JobState::ALL {
            let ways = JobState::ALL.into_iter().filter(|&to| from.may_become(to)).count();
            assert_eq!(ways == 0, from.is_terminal(), "{from:?}");
        }
    }

    #[test]
    fn a_job_runs_before_it_succeeds() {
        assert!(!JobState::Queued.may_become(JobState::Succeeded));
        assert!(!JobState::Queued.may_become(JobState::Failed));
        assert!(JobState::Queued.may_become(JobState::Running));
        assert!(JobState::Running.may_become(JobState::Queued));
        assert!(!JobState::Running.may_become(JobState::Running));
    }

    #[test]
    fn names_round_trip() {
        for state in JobState::ALL {
            assert_eq!(JobState::parse(state.as_str()), Some(state));
            assert_eq!(serde_json::to_value(state).unwrap(), state.as_str());
        }
        assert_eq!(JobState::parse("deleted"), None);
    }

    #[test]
    fn a_lost_worker_costs_an_attempt_and_five_are_enough() {
        assert_eq!(after_lost_worker(1, false), JobState::Queued);
        assert_eq!(after_lost_worker(MAX_ATTEMPTS - 1, false), JobState::Queued);
        assert_eq!(after_lost_worker(MAX_ATTEMPTS, false), JobState::Failed);
        assert_eq!(after_lost_worker(1, true), JobState::Cancelled);
        for attempts in 0..10 {
            for cancel in [false, true] {
                assert!(JobState::Running.may_become(after_lost_worker(attempts, cancel)));
            }
        }
    }
}
