//! The queue that workers draw from. Its content is the store's; this adds waking, pauses after
//! what went wrong, and patience while the disk is short.

use crate::api::jobs::Job;
use crate::disk::Disk;
use crate::events::JobNotifier;
use crate::failpoints;
use crate::store::{Asking, Claim, Store};
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Notify;
use uuid::Uuid;

/// How often an idle worker looks without having been woken: jobs put back by a failing worker
/// or, with a shared store, by another process.
const POLL: Duration = Duration::from_secs(1);
/// Pause of a job after its first trouble; it doubles with each further one, up to the other.
const PAUSES: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(300));
/// How long after its pause a job is remembered, so that the next one is longer.
const MEMORY: Duration = Duration::from_secs(600);
/// Most jobs that pause at once. Beyond it, the pause that is over soonest ends now.
const MOST_PAUSES: usize = 1000;

/// Hands jobs to workers.
pub struct Queue {
    store: Arc<dyn Store>,
    bell: JobNotifier,
    wake: Notify,
    pauses: Mutex<Pauses>,
    /// Whether the disk was short at the last look.
    is_short: AtomicBool,
}

impl Queue {
    /// A queue over `store`.
    pub fn new(store: Arc<dyn Store>, bell: JobNotifier) -> Self {
        let (pauses, is_short) = (Mutex::default(), AtomicBool::new(false));
        Self { store, bell, wake: Notify::new(), pauses, is_short }
    }

    /// Wakes a waiting worker: there is a new job.
    pub fn wake(&self) {
        self.wake.notify_one();
    }

    /// Lets a job pause that failed, or whose storage does not answer, longer each time. To be
    /// called before the job is put back, or it might be claimed in between.
    pub fn put_off(&self, job: Uuid) {
        let pause = self.pauses().begin(Instant::now(), job);
        tracing::info!(%job, seconds = pause.as_secs_f64(), "pauses before its next attempt");
    }

    /// Forgets the pauses of a job that has ended.
    pub fn forget(&self, job: Uuid) {
        self.pauses().of.remove(&job);
    }

    fn pauses(&self) -> MutexGuard<'_, Pauses> {
        self.pauses.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Claims the next job for `device`, waiting until there is one and the disk has room for what
    /// it writes; `own_process` says whether it will run in a process of its own.
    pub async fn next(&self, device: &str, own_process: bool, disk: &Disk) -> (Claim, Job) {
        loop {
            let mut patience = POLL;
            if self.has_room(disk) {
                let paused = self.pauses().present(Instant::now());
                let asking = Asking { device, own_process, paused: &paused };
                match self.store.claim(&asking).await {
                    Ok(Some((claim, job))) => {
                        self.bell.ring(claim.job);
                        // There may be more; one wake-up can stand for several jobs.
                        self.wake();
                        return (claim, job);
                    }
                    Ok(None) => {}
                    Err(error) => tracing::error!(%error, "cannot read the queue"),
                }
                if let Some(soonest) = self.pauses().soonest(Instant::now()) {
                    patience = patience.min(soonest);
                }
            }
            let _ = tokio::time::timeout(patience, self.wake.notified()).await;
        }
    }

    /// Whether the disk has room for another job. Each would fail for want of it, one after the
    /// other; waiting costs nothing.
    fn has_room(&self, disk: &Disk) -> bool {
        let shortage = disk.shortage();
        let was_short = self.is_short.swap(shortage.is_some(), Ordering::Relaxed);
        match &shortage {
            Some(why) if !was_short => tracing::warn!(why, "no job is begun for now"),
            None if was_short => tracing::info!("the disk has room again; jobs are begun"),
            _ => {}
        }
        shortage.is_none()
    }
}

/// Jobs that pause. In memory, by the monotonic clock: a server that starts again tries each at once.
#[derive(Default)]
struct Pauses {
    of: HashMap<Uuid, Pause>,
}

#[derive(Clone, Copy)]
struct Pause {
    length: Duration,
    until: Instant,
}

impl Pauses {
    /// Begins a job's next pause; how long it is.
    fn begin(&mut self, now: Instant, job: Uuid) -> Duration {
        self.of.retain(|_, pause| now.saturating_duration_since(pause.until) < MEMORY);
        let (first, longest) = PAUSES;
        let length = self.of.get(&job).map_or(first, |last| (2 * last.length).min(longest));
        let until = now + failpoints::lasting("retry-pause", length);
        self.of.insert(job, Pause { length, until });
        if self.of.len() > MOST_PAUSES
            && let Some((&soonest, _)) = self.of.iter().min_by_key(|(_, pause)| pause.until)
        {
            self.of.remove(&soonest);
        }
        length
    }

    /// Those whose pause is not over.
    fn present(&self, now: Instant) -> Vec<Uuid> {
        let present = self.of.iter().filter(|(_, pause)| pause.until > now);
        present.map(|(job, _)| *job).collect()
    }

    /// Time until the next pause is over.
    fn soonest(&self, now: Instant) -> Option<Duration> {
        self.of.values().filter(|pause| pause.until > now).map(|pause| pause.until - now).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_end_and_are_forgotten() {
        let (mut pauses, mut now) = (Pauses::default(), Instant::now());
        let (job, other) = (Uuid::from_u128(1), Uuid::from_u128(2));
        let mut lengths = Vec::new();
        for _ in 0..12 {
            let length = pauses.begin(now, job);
            assert_eq!(pauses.present(now), [job]);
            assert_eq!(pauses.soonest(now), Some(length));
            now += length;
            assert!(pauses.present(now).is_empty());
            assert_eq!(pauses.soonest(now), None);
            lengths.push(length.as_secs());
        }
        assert_eq!(lengths, [1, 2, 4, 8, 16, 32, 64, 128, 256, 300, 300, 300]);
        // Five failures are over within a minute.
        assert!(lengths[..4].iter().sum::<u64>() < 60);
        assert_eq!(pauses.begin(now, other).as_secs(), 1, "each has its own");
        now += MEMORY + PAUSES.1;
        assert_eq!(pauses.begin(now, job).as_secs(), 1, "that was long ago");
        assert_eq!(pauses.of.len(), 1);
    }

    #[test]
    fn pauses_are_bounded() {
        let (mut pauses, now) = (Pauses::default(), Instant::now());
        let late = Uuid::from_u128(u128::MAX);
        pauses.begin(now, late);
        pauses.begin(now, late);
        for job in 0..3 * MOST_PAUSES {
            pauses.begin(now, Uuid::from_u128(job as u128));
        }
        assert_eq!(pauses.of.len(), MOST_PAUSES);
        assert!(pauses.of.contains_key(&late), "the longest pauses stay");
    }
}
