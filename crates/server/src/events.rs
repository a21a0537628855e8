//! In-process wake-ups: who waits for news of a job learns that there is some, and reads it from
//! the store. Only ids travel, so a missed wake-up costs nothing but a read.

use tokio::sync::broadcast;
use uuid::Uuid;

/// Rings when a job has news.
#[derive(Clone)]
pub struct Bell {
    sender: broadcast::Sender<Uuid>,
}

impl Default for Bell {
    fn default() -> Self {
        Self { sender: broadcast::channel(1024).0 }
    }
}

impl Bell {
    /// Tells everyone that `job` has news in the store.
    pub fn ring(&self, job: Uuid) {
        // Nobody listening is fine.
        let _ = self.sender.send(job);
    }

    /// Starts to listen; subscribe before reading the store, or news in between is missed.
    pub fn listen(&self) -> Listener {
        Listener { receiver: self.sender.subscribe() }
    }
}

/// Hears the bell.
pub struct Listener {
    receiver: broadcast::Receiver<Uuid>,
}

impl Listener {
    /// Waits until `job` may have news. A listener that fell behind is told so at once: what it
    /// missed may have been about `job`.
    pub async fn news_of(&mut self, job: Uuid) {
        loop {
            match self.receiver.recv().await {
                Ok(id) if id == job => return,
                Ok(_) => {}
                Err(broadcast::error::RecvError::Lagged(_)) => return,
                // The sender lives in the same application state as the listener's owner.
                Err(broadcast::error::RecvError::Closed) => std::future::pending().await,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[tokio::test]
    async fn only_the_own_job_wakes_and_lagging_wakes_too() {
        let bell = Bell::default();
        let mut listener = bell.listen();
        let (mine, other) = (Uuid::now_v7(), Uuid::now_v7());
        bell.ring(other);
        let short = Duration::from_millis(20);
        assert!(tokio::time::timeout(short, listener.news_of(mine)).await.is_err());
        bell.ring(mine);
        assert!(tokio::time::timeout(short, listener.news_of(mine)).await.is_ok());
        for _ in 0..5000 {
            bell.ring(other);
        }
        assert!(tokio::time::timeout(short, listener.news_of(mine)).await.is_ok());
    }
}
