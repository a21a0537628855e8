//! The life of a job as a pure state machine: states, what can happen, and what becomes of it.
//! The store loads a [`Life`], asks [`Life::after`] and writes what comes out; it decides nothing.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Failed attempts after which a job is given up.
pub const MAX_FAILURES: u32 = 5;
/// Attempts within the server's own process that ended with it, after which a job is given up all
/// the same. More than failures, since whoever ends servers seldom means the job; but no job may end
/// servers forever. A job in a process of its own cannot end its server, so nothing bounds those.
pub const MAX_OUTAGES: u32 = 20;
/// Interruptions after which a job hurries and lets others go first.
const HURRIES_AFTER: u32 = 3;
/// Deaths for want of memory beside other jobs after which a job runs alone.
const ALONE_AFTER: u32 = 2;
/// First checkpoint of a job that hurries, seconds after its beginning; half as long after each
/// further interruption, down to the second number.
const FIRST_CHECKPOINT_S: (f64, f64) = (1.0, 0.1);

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
    /// How many of them ran within the server and ended with it.
    pub outages: u32,
    /// Further attempts, which do not count: the server died beside the job's own process, or that
    /// process was killed for want of memory while other jobs ran.
    pub interruptions: u32,
    /// How many of the interruptions were for want of memory.
    pub memory_deaths: u32,
    /// Whether the latest attempt runs, or ran, in a process of its own.
    pub own_process: bool,
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
    Claim {
        /// Whether it will run in a process of its own.
        own_process: bool,
    },
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
        /// What broke the attempt off.
        cause: Cause,
    },
    /// Its server died.
    ServerDied {
        /// Of the claim that the server held.
        fence: u64,
    },
    /// Nothing was heard of its worker for longer than a lease.
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

/// What broke an attempt off, as far as it says something of the job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The job or its device failed: counts.
    Failure,
    /// The server shut down, or the storage does not answer: does not count.
    Circumstances,
    /// The system killed the job's process, as it does where memory runs out.
    OutOfMemory {
        /// Whether no other job ran beside it. Only then it must have been this one that took too
        /// much, and the death counts.
        alone: bool,
    },
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
        interruptions: 0,
        memory_deaths: 0,
        own_process: false,
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
            Event::Release { fence, cause } => {
                let held = self.held_by(fence)?;
                Ok(match cause {
                    Cause::Failure | Cause::OutOfMemory { alone: true } => held,
                    Cause::Circumstances => held.uncounted(),
                    Cause::OutOfMemory { alone: false } => Self {
                        memory_deaths: held.memory_deaths.saturating_add(1),
                        ..held.interrupted()
                    },
                }
                .put_back())
            }
            Event::ServerDied { fence } | Event::LeaseExpired { fence } => {
                let held = self.held_by(fence)?;
                let after = if held.own_process { held.interrupted() } else { held.outage() };
                Ok(after.put_back())
            }
            _ if self.deleted => Err(Refusal::Deleted),
            Event::Claim { own_process } => match self.state {
                Queued => Ok(Self {
                    state: Running,
                    attempts: self.attempts + 1,
                    fence: self.fence + 1,
                    own_process,
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

    /// Whether it may only run while no other job does: what killed it for want of memory beside
    /// others is then told from what it takes itself.
    pub fn runs_alone(self) -> bool {
        self.memory_deaths >= ALONE_AFTER
    }

    /// Whether the other waiting jobs go first.
    pub fn lets_others_go_first(self) -> bool {
        self.interruptions >= HURRIES_AFTER
    }

    fn uncounted(self) -> Self {
        Self { attempts: self.attempts - 1, ..self }
    }

    fn interrupted(self) -> Self {
        Self { interruptions: self.interruptions.saturating_add(1), ..self.uncounted() }
    }

    fn outage(self) -> Self {
        Self { outages: self.outages + 1, ..self }
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

/// When a job that was interrupted so often takes its first checkpoint, seconds after it begins;
/// `None` where it takes them as any job does.
pub fn first_checkpoint_s(interruptions: u32) -> Option<f64> {
    let beyond = i32::try_from(interruptions.checked_sub(HURRIES_AFTER)?).unwrap_or(i32::MAX);
    let (longest, shortest) = FIRST_CHECKPOINT_S;
    Some((longest * 0.5f64.powi(beyond)).max(shortest))
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

    /// A claim by a worker whose jobs run in a process of their own.
    const CLAIM: Event = Event::Claim { own_process: true };

    fn live(events: &[Event]) -> Life {
        events.iter().fold(Life::NEW, |life, event| life.after(*event).unwrap())
    }

    /// The life after a claim that was broken off so.
    fn broken_off(life: Life, own_process: bool, end: impl FnOnce(u64) -> Event) -> Life {
        let claimed = life.after(Event::Claim { own_process }).unwrap();
        claimed.after(end(claimed.fence)).unwrap()
    }

    fn out_of_memory(alone: bool) -> impl FnOnce(u64) -> Event {
        move |fence| Event::Release { fence, cause: Cause::OutOfMemory { alone } }
    }

    #[test]
    fn the_ways_of_a_life() {
        let held = Event::Finish { fence: 1, end: JobState::Succeeded };
        let done = live(&[CLAIM, Event::Report { fence: 1 }, held]);
        assert_eq!((done.state, done.attempts, done.fence), (JobState::Succeeded, 1, 1));
        assert_eq!(done.after(held), Err(Refusal::ClaimLost), "one result");
        assert_eq!(done.after(CLAIM), Err(Refusal::NotNow(JobState::Succeeded)));
        assert_eq!(done.after(Event::Cancel), Ok(done), "a cancel comes too late");

        let uncounted = Event::Release { fence: 1, cause: Cause::Circumstances };
        let as_new = Life { fence: 1, own_process: true, ..Life::NEW };
        assert_eq!(live(&[CLAIM, uncounted]), as_new);
        let stopping = live(&[CLAIM, Event::Cancel]);
        assert_eq!((stopping.state, stopping.cancel_requested), (JobState::Running, true));
        for end in [Event::LeaseExpired { fence: 1 }, Event::ServerDied { fence: 1 }] {
            let ended = stopping.after(end).unwrap();
            assert_eq!(ended.state, JobState::Cancelled, "nobody is left to obey");
        }

        let again = done.after(Event::Extend).unwrap();
        assert_eq!((again.state, again.attempts, again.fence), (JobState::Queued, 0, 1));
        assert_eq!(again.after(Event::Extend), Err(Refusal::NotNow(JobState::Queued)));
        let gone = live(&[CLAIM, Event::Delete]);
        assert_eq!((gone.state, gone.deleted), (JobState::Cancelled, true));
        assert_eq!(gone.after(Event::Report { fence: 1 }), Err(Refusal::ClaimLost));
        assert_eq!(gone.after(Event::Extend), Err(Refusal::Deleted));
        let running = live(&[CLAIM]);
        let no_end = Event::Finish { fence: 1, end: JobState::Queued };
        assert_eq!(running.after(no_end), Err(Refusal::NotNow(JobState::Running)));
    }

    #[test]
    fn deaths_of_the_server_say_nothing_of_a_job_in_its_own_process() {
        let mut life = Life::NEW;
        for death in 1..=1000 {
            life = broken_off(life, true, |fence| Event::ServerDied { fence });
            assert_eq!((life.state, life.attempts), (JobState::Queued, 0));
            assert_eq!(life.interruptions, death);
            assert_eq!(life.lets_others_go_first(), death >= 3);
            assert!(!life.runs_alone());
        }
        // Within the server they count, wherever it ran before.
        for death in 1..=MAX_OUTAGES {
            life = broken_off(life, false, |fence| Event::ServerDied { fence });
            assert_eq!((life.attempts, life.outages), (death, death));
        }
        assert_eq!(life.state, JobState::Failed);
    }

    #[test]
    fn a_death_for_want_of_memory_counts_where_the_job_ran_alone() {
        let once = broken_off(Life::NEW, true, out_of_memory(false));
        assert_eq!((once.attempts, once.interruptions, once.memory_deaths), (0, 1, 1));
        assert!(!once.runs_alone());
        let mut life = broken_off(once, true, out_of_memory(false));
        assert!(life.runs_alone(), "the next death is to count");
        for failure in 1..=MAX_FAILURES {
            assert_eq!(life.state, JobState::Queued);
            life = broken_off(life, true, out_of_memory(true));
            assert_eq!(life.attempts, failure);
        }
        assert_eq!(life.state, JobState::Failed);
    }

    #[test]
    fn first_checkpoints_come_sooner_after_each_interruption() {
        assert_eq!([0, 1, 2].map(first_checkpoint_s), [None; 3]);
        let soon = [3, 4, 5, 6, 7, 1000, u32::MAX].map(|n| first_checkpoint_s(n).unwrap());
        assert_eq!(soon, [1.0, 0.5, 0.25, 0.125, 0.1, 0.1, 0.1]);
    }

    fn causes() -> impl Strategy<Value = Cause> {
        prop::sample::select(vec![
            Cause::Failure,
            Cause::Circumstances,
            Cause::OutOfMemory { alone: true },
            Cause::OutOfMemory { alone: false },
        ])
    }

    /// Events with fences around those that a short life has.
    fn events() -> impl Strategy<Value = Event> {
        let fence = 0..30u64;
        let end = prop::sample::select(JobState::ALL.to_vec());
        prop_oneof![
            4 => any::<bool>().prop_map(|own_process| Event::Claim { own_process }),
            1 => fence.clone().prop_map(|fence| Event::Report { fence }),
            2 => (fence.clone(), end).prop_map(|(fence, end)| Event::Finish { fence, end }),
            4 => (fence.clone(), causes())
                .prop_map(|(fence, cause)| Event::Release { fence, cause }),
            1 => fence.clone().prop_map(|fence| Event::ServerDied { fence }),
            1 => fence.prop_map(|fence| Event::LeaseExpired { fence }),
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
                let is_claim = matches!(event, Event::Claim { .. });
                prop_assert!(next.fence >= life.fence);
                prop_assert!(!is_claim || next.fence > life.fence);
                // A job that runs was claimed; one that succeeded was finished by its holder.
                if next.state == JobState::Running && life.state != JobState::Running {
                    prop_assert!(is_claim);
                }
                if next.state == JobState::Succeeded && life.state != JobState::Succeeded {
                    let held = Event::Finish { fence: life.fence, end: JobState::Succeeded };
                    prop_assert_eq!(event, held);
                }
                // What was deleted stays so, and nothing happens to it any more.
                prop_assert!(!life.deleted);
                // Attempts are counted by claims and bounded; only what says nothing of the job
                // and new runs take them back.
                let innocent = match event {
                    Event::Release { cause, .. } => {
                        matches!(cause, Cause::Circumstances | Cause::OutOfMemory { alone: false })
                    }
                    Event::ServerDied { .. } | Event::LeaseExpired { .. } => life.own_process,
                    _ => false,
                };
                let takes_back = innocent || event == Event::Extend;
                prop_assert!(next.attempts >= life.attempts || takes_back);
                prop_assert!(!innocent || next.state != JobState::Failed);
                prop_assert!(next.attempts >= next.outages);
                let (failures, outages) = (next.attempts - next.outages, next.outages);
                prop_assert!(failures <= MAX_FAILURES && outages <= MAX_OUTAGES);
                prop_assert!(
                    next.state != JobState::Queued
                        || failures < MAX_FAILURES && outages < MAX_OUTAGES
                );
                if event == Event::Extend {
                    (results, claims) = (0, 0);
                }
                claims += u32::from(is_claim);
                prop_assert!(next.attempts + next.interruptions <= claims);
                prop_assert!(next.memory_deaths <= next.interruptions);
                if next.state.is_terminal() && !life.state.is_terminal() {
                    results += 1;
                }
                prop_assert!(results <= 1);
                life = next;
            }
        }

        /// A job that nobody cancels and that always fails, or that runs in a server that always
        /// dies, is given up, not run forever, whatever else happens in between; and nothing else
        /// gives it up.
        #[test]
        fn a_poisoned_job_ends(deaths in prop::collection::vec(0..6u8, 200)) {
            let mut life = Life::NEW;
            let (mut failures, mut outages) = (0, 0);
            for death in deaths {
                life = match death {
                    0 => broken_off(life, true, |fence| {
                        Event::Release { fence, cause: Cause::Circumstances }
                    }),
                    1 => broken_off(life, true, |fence| Event::ServerDied { fence }),
                    2 => broken_off(life, true, out_of_memory(false)),
                    3 => broken_off(life, true, out_of_memory(true)),
                    4 => broken_off(life, true, |fence| {
                        Event::Release { fence, cause: Cause::Failure }
                    }),
                    _ => broken_off(life, false, |fence| Event::ServerDied { fence }),
                };
                failures += u32::from(death == 3 || death == 4);
                outages += u32::from(death == 5);
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
