//! What goes on for long, an event stream or a request that waits, ends with its key. Keys are ended
//! by other processes too, so the store is asked, about once a second for all of them together.

use crate::access::Caller;
use crate::store::{Store, StoreError};
use jiff::Timestamp;
use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;

/// How often keys are looked at while anything goes on under one.
const EVERY: Duration = Duration::from_secs(1);

/// Tells what goes on under keys that they have ended.
pub struct KeyWatch {
    /// Ids of keys that are revoked or expired.
    ended: watch::Sender<HashSet<String>>,
}

impl Default for KeyWatch {
    fn default() -> Self {
        Self { ended: watch::Sender::new(HashSet::new()) }
    }
}

impl KeyWatch {
    /// Watches the key of that caller, if there is one.
    pub fn of(&self, caller: &Caller) -> KeyEnd {
        KeyEnd(caller.key().map(|key| (key.id.clone(), self.ended.subscribe())))
    }

    async fn look(&self, store: &dyn Store) -> Result<(), StoreError> {
        if self.ended.receiver_count() == 0 {
            return Ok(());
        }
        let now = Timestamp::now();
        let keys = store.keys().await?;
        let ended: HashSet<String> =
            keys.into_iter().filter(|key| !key.is_good(now)).map(|key| key.id).collect();
        self.ended.send_if_modified(|known| {
            let is_news = *known != ended;
            *known = ended;
            is_news
        });
        Ok(())
    }
}

/// The end of one caller's key.
pub struct KeyEnd(Option<(String, watch::Receiver<HashSet<String>>)>);

impl KeyEnd {
    /// Whether it has come.
    pub fn has_come(&self) -> bool {
        self.0.as_ref().is_some_and(|(id, ended)| ended.borrow().contains(id))
    }

    /// Waits for it; for ever where no key is needed.
    pub async fn comes(&mut self) {
        if let Some((id, ended)) = &mut self.0
            && ended.wait_for(|ended| ended.contains(id)).await.is_ok()
        {
            return;
        }
        std::future::pending().await
    }
}

/// Looks at the keys of that store now and then, until the task is aborted.
pub async fn look_after(watch: Arc<KeyWatch>, store: Arc<dyn Store>) {
    let mut ticks = tokio::time::interval(EVERY);
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        if let Err(error) = watch.look(&*store).await {
            tracing::error!(%error, "cannot look whether keys have ended");
        }
    }
}
