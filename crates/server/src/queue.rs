//! The queue that workers draw from. Its content is the store's; this adds waking.

use crate::api::jobs::Job;
use crate::events::Bell;
use crate::store::{Asking, Claim, Store};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Notify;

/// How often an idle worker looks without having been woken: jobs put back by a failing worker
/// or, with a shared store, by another process.
const POLL: Duration = Duration::from_secs(1);

/// Hands jobs to workers.
pub struct Queue {
    store: Arc<dyn Store>,
    bell: Bell,
    wake: Notify,
}

impl Queue {
    /// A queue over `store`.
    pub fn new(store: Arc<dyn Store>, bell: Bell) -> Self {
        Self { store, bell, wake: Notify::new() }
    }

    /// Wakes a waiting worker: there is a new job.
    pub fn wake(&self) {
        self.wake.notify_one();
    }

    /// Claims the next job for `device`, waiting until there is one; `own_process` says whether
    /// it will run in a process of its own.
    pub async fn next(&self, device: &str, own_process: bool) -> (Claim, Job) {
        loop {
            let asking = Asking { device, own_process, paused: &[] };
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
            let _ = tokio::time::timeout(POLL, self.wake.notified()).await;
        }
    }
}
