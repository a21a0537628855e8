//! The life of a job as a pure state machine: states, what can happen, and what becomes of it.
//! The store loads a [`Life`], asks [`Life::after`] and writes what comes out; it decides nothing.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Failed attempts after which a job is given up.
pub const MAX_FAILURES: u32 = 5;
/// Attempts that ended with their server, after which a job is given up all the same. More than
/// failures, since whoever ends servers seldom means the job; but no job may end servers forever.
pub const MAX_OUTAGES: u32 = 20;

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

    /// Whether the job has ended.
    pub fn is_terminal(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }
}

/// The part of a job's record that says what may happen to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Life {
    /// Where it stands.
    pub state: JobState,
    /// Attempts that count, the present one included.
    pub attempts: u32,
    /// How many of them ended with their server.
    pub outages: u32,
    /// The fencing token: grows with every claim, so that no two workers ever share one.
    pub fence: u64,
    /// Whether its worker is asked to end it.
    pub cancel_requested: bool,
    /// Whether it is hidden for good.
    pub deleted: bool,
}

/// Something that happens to a job. Workers prove by the fence of their claim that the job is
/// still theirs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A worker takes it.
    Claim,
    /// Its worker has news.
    Report {
        /// Of the worker's claim.
        fence: u64,
    },
    /// Its worker has brought it to an end.
    Finish {
        /// Of the worker's claim.
        fence: u64,
        /// A terminal state.
        end: JobState,
    },
    /// Its worker, or whoever knows the worker's fate, puts it back.
    Release {
        /// Of the worker's claim.
        fence: u64,
        /// Whether the attempt counts: not where the server shut down in order.
        counted: bool,
    },
    /// Its server died, or nothing was heard of its worker for longer than a lease.
    LeaseExpired {
        /// Of the claim that lapsed.
        fence: u64,
    },
    /// The client wants it to end.
    Cancel,
    /// The client wants it gone.
    Delete,
    /// The client adds budget to an ended job.
    Extend,
}

/// Why something cannot happen to a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The worker's claim is over: the job ended, was put back, or another worker has it.
    #[error("the claim is over")]
    ClaimLost,
    /// The job was deleted.
    #[error("the job was deleted")]
    Deleted,
    /// The job is not in a state in which this happens.
    #[error("that cannot happen to a job that is {}", .0.as_str())]
    NotNow(JobState),
}

impl Life {
    /// A job that was just accepted.
    pub const NEW: Self = Self {
        state: JobState::Queued,
        attempts: 0,
        outages: 0,
        fence: 0,
        cancel_requested: false,
        deleted: false,
    };

    /// What becomes of the job when `event` happens.
    ///
    /// # Errors
    /// [`Refusal`] where it cannot happen; the job stays as it is.
    pub fn after(self, event: Event) -> Result<Self, Refusal> {
        use JobState::{Cancelled, Queued, Running};
        match event {
            Event::Report { fence } => self.held_by(fence),
            Event::Finish { fence, end } => {
                let held = self.held_by(fence)?;
                if !end.is_terminal() {
                    return Err(Refusal::NotNow(self.state));
                }
                Ok(Self { state: end, ..held })
            }
            Event::Release { fence, counted } => {
                let held = self.held_by(fence)?;
                let attempts = held.attempts - u32::from(!counted);
                Ok(Self { attempts, ..held }.put_back())
            }
            Event::LeaseExpired { fence } => {
                let held = self.held_by(fence)?;
                Ok(Self { outages: held.outages + 1, ..held }.put_back())
            }
            _ if self.deleted => Err(Refusal::Deleted),
            Event::Claim => match self.state {
                Queued => Ok(Self {
                    state: Running,
                    attempts: self.attempts + 1,
                    fence: self.fence + 1,
                    ..self
                }),
                state => Err(Refusal::NotNow(state)),
            },
            Event::Cancel => Ok(match self.state {
                Queued => Self { state: Cancelled, ..self },
                Running => Self { cancel_requested: true, ..self },
                _ => self,
            }),
            Event::Delete => {
                let state = if self.state.is_terminal() { self.state } else { Cancelled };
                // Whoever runs it finds its claim over.
                Ok(Self { state, fence: self.fence + 1, deleted: true, ..self })
            }
            Event::Extend => match self.state {
                state if state.is_terminal() => Ok(Self { fence: self.fence, ..Self::NEW }),
                state => Err(Refusal::NotNow(state)),
            },
        }
    }

    fn held_by(self, fence: u64) -> Result<Self, Refusal> {
        let held = self.state == JobState::Running && self.fence == fence && !self.deleted;
        if held { Ok(self) } else { Err(Refusal::ClaimLost) }
    }

    fn put_back(self) -> Self {
        let failures = self.attempts - self.outages;
        let state = if self.cancel_requested {
            JobState::Cancelled
        } else if failures >= MAX_FAILURES || self.outages >= MAX_OUTAGES {
            JobState::Failed
        } else {
            JobState::Queued
        };
        Self { state, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn names_round_trip() {
        for state in JobState::ALL {
            assert_eq!(JobState::parse(state.as_str()), Some(state));
            assert_eq!(serde_json::to_value(state).unwrap(), state.as_str());
        }
        assert_eq!(JobState::parse("deleted"), None);
    }

    fn live(events: &[Event]) -> Life {
        events.iter().fold(Life::NEW, |life, event| life.after(*event).unwrap())
    }

    #[test]
    fn the_ways_of_a_life() {
        let held = Event::Finish { fence: 1, end: JobState::Succeeded };
        let done = live(&[Event::Claim, Event::Report { fence: 1 }, held]);
        assert_eq!((done.state, done.attempts, done.fence), (JobState::Succeeded, 1, 1));
        assert_eq!(done.after(held), Err(Refusal::ClaimLost), "one result");
        assert_eq!(done.after(Event::Claim), Err(Refusal::NotNow(JobState::Succeeded)));
        assert_eq!(done.after(Event::Cancel), Ok(done), "a cancel comes too late");

        let uncounted = Event::Release { fence: 1, counted: false };
        assert_eq!(live(&[Event::Claim, uncounted]), Life { fence: 1, ..Life::NEW });
        let stopping = live(&[Event::Claim, Event::Cancel]);
        assert_eq!((stopping.state, stopping.cancel_requested), (JobState::Running, true));
        let lapsed = stopping.after(Event::LeaseExpired { fence: 1 }).unwrap();
        assert_eq!(lapsed.state, JobState::Cancelled, "nobody is left to obey");

        let again = done.after(Event::Extend).unwrap();
        assert_eq!((again.state, again.attempts, again.fence), (JobState::Queued, 0, 1));
        assert_eq!(again.after(Event::Extend), Err(Refusal::NotNow(JobState::Queued)));
        let gone = live(&[Event::Claim, Event::Delete]);
        assert_eq!((gone.state, gone.deleted), (JobState::Cancelled, true));
        assert_eq!(gone.after(Event::Report { fence: 1 }), Err(Refusal::ClaimLost));
        assert_eq!(gone.after(Event::Extend), Err(Refusal::Deleted));
        let running = live(&[Event::Claim]);
        let no_end = Event::Finish { fence: 1, end: JobState::Queued };
        assert_eq!(running.after(no_end), Err(Refusal::NotNow(JobState::Running)));
    }

    /// Events with fences around those that a short life has.
    fn events() -> impl Strategy<Value = Event> {
        let fence = 0..30u64;
        let end = prop::sample::select(JobState::ALL.to_vec());
        prop_oneof![
            4 => Just(Event::Claim),
            1 => fence.clone().prop_map(|fence| Event::Report { fence }),
            2 => (fence.clone(), end).prop_map(|(fence, end)| Event::Finish { fence, end }),
            4 => (fence.clone(), any::<bool>())
                .prop_map(|(fence, counted)| Event::Release { fence, counted }),
            2 => fence.prop_map(|fence| Event::LeaseExpired { fence }),
            1 => Just(Event::Cancel),
            1 => Just(Event::Delete),
            1 => Just(Event::Extend),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        /// Whatever happens in whatever order, with workers that come back from the dead.
        #[test]
        fn invariants_hold_in_any_order(story in prop::collection::vec(events(), 0..200)) {
            let mut life = Life::NEW;
            // Of the present run, which begins when the job is queued by a client.
            let (mut results, mut claims) = (0, 0);
            for event in story {
                let Ok(next) = life.after(event) else { continue };
                // A run ends once; only an extension begins another.
                if life.state.is_terminal() && event != Event::Extend {
                    prop_assert_eq!(next.state, life.state);
                }
                // Fences never shrink, and no two claims share one.
                prop_assert!(next.fence >= life.fence);
                prop_assert!(event != Event::Claim || next.fence > life.fence);
                // A job that runs was claimed; one that succeeded was finished by its holder.
                if next.state == JobState::Running && life.state != JobState::Running {
                    prop_assert_eq!(event, Event::Claim);
                }
                if next.state == JobState::Succeeded && life.state != JobState::Succeeded {
                    let held = Event::Finish { fence: life.fence, end: JobState::Succeeded };
                    prop_assert_eq!(event, held);
                }
                // What was deleted stays so, and nothing happens to it any more.
                prop_assert!(!life.deleted);
                // Attempts are counted by claims and bounded; only uncounted releases and new
                // runs take them back.
                let takes_back = matches!(event, Event::Release { counted: false, .. })
                    || event == Event::Extend;
                prop_assert!(next.attempts >= life.attempts || takes_back);
                prop_assert!(next.attempts >= next.outages);
                let (failures, outages) = (next.attempts - next.outages, next.outages);
                prop_assert!(failures <= MAX_FAILURES && outages <= MAX_OUTAGES);
                prop_assert!(
                    next.state != JobState::Queued
                        || failures < MAX_FAILURES && outages < MAX_OUTAGES
                );
                match event {
                    Event::Extend => (results, claims) = (0, 0),
                    Event::Claim => claims += 1,
                    _ => {}
                }
                prop_assert!(next.attempts <= claims);
                if next.state.is_terminal() && !life.state.is_terminal() {
                    results += 1;
                }
                prop_assert!(results <= 1);
                life = next;
            }
        }

        /// A job that nobody cancels and that always fails, or whose server always dies, is given
        /// up, not run forever.
        #[test]
        fn a_poisoned_job_ends(deaths in prop::collection::vec(0..3u8, 100)) {
            let mut life = Life::NEW;
            let (mut failures, mut outages) = (0, 0);
            for death in deaths {
                life = life.after(Event::Claim).unwrap();
                let fence = life.fence;
                let event = match death {
                    0 => Event::Release { fence, counted: false },
                    1 => Event::Release { fence, counted: true },
                    _ => Event::LeaseExpired { fence },
                };
                failures += u32::from(death == 1);
                outages += u32::from(death == 2);
                life = life.after(event).unwrap();
                prop_assert_eq!((life.attempts, life.outages), (failures + outages, outages));
                if failures == MAX_FAILURES || outages == MAX_OUTAGES {
                    prop_assert_eq!(life.state, JobState::Failed);
                    return Ok(());
                }
                prop_assert_eq!(life.state, JobState::Queued);
            }
        }
    }
}
