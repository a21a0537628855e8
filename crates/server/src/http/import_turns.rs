//! Turns at importing scenes: so many at the same time, and among those who wait the next is that of
//! a caller with the fewest under way, so that nobody waits behind all the scenes of another.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::oneshot;

/// The turns that are taken, and who waits.
#[derive(Clone)]
pub struct ImportTurns {
    inner: Arc<Mutex<Inner>>,
}

struct Inner {
    free: usize,
    underway: HashMap<String, usize>,
    /// In the order in which they came.
    waiting: Vec<(String, oneshot::Sender<Turn>)>,
}

/// A turn, until dropped.
pub struct Turn {
    turns: ImportTurns,
    caller: String,
}

impl ImportTurns {
    /// So many turns at the same time.
    pub fn new(most: usize) -> Self {
        let inner = Inner { free: most, underway: HashMap::new(), waiting: Vec::new() };
        Self { inner: Arc::new(Mutex::new(inner)) }
    }

    /// Waits for a turn of that caller.
    pub async fn take(&self, caller: &str) -> Turn {
        loop {
            let (sender, turn) = oneshot::channel();
            self.lock().waiting.push((caller.to_owned(), sender));
            self.pass_on();
            // An error would mean that the sender was dropped, which never happens to one who waits.
            if let Ok(turn) = turn.await {
                return turn;
            }
        }
    }

    /// Gives free turns to those who wait.
    fn pass_on(&self) {
        while let Some((caller, sender)) = self.lock().next() {
            // Where nobody waits any more the turn comes back and is dropped, which frees it.
            drop(sender.send(Turn { turns: self.clone(), caller }));
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    /// Whose turn it is, where one is free; it is counted as taken.
    fn next(&mut self) -> Option<(String, oneshot::Sender<Turn>)> {
        self.waiting.retain(|(_, sender)| !sender.is_closed());
        if self.free == 0 {
            return None;
        }
        let count = |caller: &str| self.underway.get(caller).copied().unwrap_or(0);
        let fewest = |(_, (caller, _)): &(usize, &(String, _))| count(caller);
        let (place, _) = self.waiting.iter().enumerate().min_by_key(fewest)?;
        let (caller, sender) = self.waiting.remove(place);
        self.free -= 1;
        *self.underway.entry(caller.clone()).or_default() += 1;
        Some((caller, sender))
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut inner = self.turns.lock();
        inner.free += 1;
        if let Some(count) = inner.underway.get_mut(&self.caller) {
            *count -= 1;
            if *count == 0 {
                inner.underway.remove(&self.caller);
            }
        }
        drop(inner);
        self.turns.pass_on();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::pin::pin;
    use std::task::Poll;

    /// Whether it has a turn by now; it waits in line from the first time on.
    async fn has<F: Future>(turn: &mut std::pin::Pin<&mut F>) -> Option<F::Output> {
        std::future::poll_fn(|context| match turn.as_mut().poll(context) {
            Poll::Ready(turn) => Poll::Ready(Some(turn)),
            Poll::Pending => Poll::Ready(None),
        })
        .await
    }

    #[tokio::test]
    async fn nobody_waits_behind_all_scenes_of_another() {
        let turns = ImportTurns::new(2);
        let (first, second) = (turns.take("many").await, turns.take("many").await);
        let (mut third, mut other) = (pin!(turns.take("many")), pin!(turns.take("one")));
        assert!(has(&mut third).await.is_none() && has(&mut other).await.is_none());
        drop(first);
        assert!(has(&mut third).await.is_none(), "the other one has none under way");
        let others = has(&mut other).await.expect("its turn");
        drop(second);
        let thirds = has(&mut third).await.expect("its turn");
        drop((others, thirds));
        let inner = turns.lock();
        assert_eq!((inner.free, inner.underway.len(), inner.waiting.len()), (2, 0, 0));
    }

    #[tokio::test]
    async fn who_gives_up_waiting_takes_no_turn_along() {
        let turns = ImportTurns::new(1);
        let held = turns.take("").await;
        {
            let mut gone = pin!(turns.take(""));
            assert!(has(&mut gone).await.is_none());
        }
        let mut next = pin!(turns.take(""));
        assert!(has(&mut next).await.is_none());
        drop(held);
        assert!(has(&mut next).await.is_some());
        assert_eq!(turns.lock().free, 1);
    }
}
