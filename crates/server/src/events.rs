//! In-process wake-ups: who waits for news of a job learns that there is some, and reads it from
//! the store. Nothing else travels, so a missed wake-up costs nothing but a read. A job's news
//! wakes those who listen to that job, however many others there are.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;
use uuid::Uuid;

/// The channel of each job that somebody waits for, by the job's id.
type JobChannels = HashMap<Uuid, watch::Sender<()>>;

/// Wakes those who wait for a job's next event; it carries no data but the job's id.
#[derive(Clone, Default)]
pub struct JobNotifier {
    /// The jobs that somebody listens to.
    heard: Arc<Mutex<JobChannels>>,
}

impl JobNotifier {
    /// Tells who listens to `job` that it has news in the store.
    pub fn ring(&self, job: Uuid) {
        if let Some(listeners) = self.heard().get(&job) {
            listeners.send_replace(());
        }
    }

    /// Starts to listen to a job; do so before reading the store, or news in between is missed.
    pub fn listen(&self, job: Uuid) -> Listener {
        let receiver =
            self.heard().entry(job).or_insert_with(|| watch::Sender::new(())).subscribe();
        Listener { bell: self.clone(), job, receiver }
    }

    fn heard(&self) -> MutexGuard<'_, JobChannels> {
        self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A subscription to the events of one job, made by [`JobNotifier::listen`].
pub struct Listener {
    bell: JobNotifier,
    job: Uuid,
    receiver: watch::Receiver<()>,
}

impl Listener {
    /// Waits until the job has news since this was last asked.
    pub async fn news(&mut self) {
        if self.receiver.changed().await.is_err() {
            // The sender goes with the last listener, and this is one.
            std::future::pending().await
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        let mut heard = self.bell.heard();
        // This one is still among them.
        if heard.get(&self.job).is_some_and(|listeners| listeners.receiver_count() <= 1) {
            heard.remove(&self.job);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[tokio::test]
    async fn only_the_own_job_wakes_and_nothing_is_missed() {
        let bell = JobNotifier::default();
        let (mine, other) = (Uuid::now_v7(), Uuid::now_v7());
        let (mut listener, mut second) = (bell.listen(mine), bell.listen(mine));
        let short = Duration::from_millis(20);
        let wakes =
            async |listener: &mut Listener| tokio::time::timeout(short, listener.news()).await;
        bell.ring(other);
        assert!(wakes(&mut listener).await.is_err());
        // What comes before it waits is heard, once.
        bell.ring(mine);
        bell.ring(mine);
        assert!(wakes(&mut listener).await.is_ok() && wakes(&mut second).await.is_ok());
        assert!(wakes(&mut listener).await.is_err());
        drop(second);
        bell.ring(mine);
        assert!(wakes(&mut listener).await.is_ok());
        drop(listener);
        assert!(bell.heard().is_empty(), "nobody listens any more");
        bell.ring(mine);
    }
}
