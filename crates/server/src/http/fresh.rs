//! Answers that cost something and that anybody may ask for: they are made about once a second,
//! however many ask, and whoever asks meanwhile gets the last one.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Notify;

/// How long an answer is good.
const GOOD_FOR: Duration = Duration::from_secs(1);
/// How many times as long as it took to make an answer is good at least: making them takes a
/// twentieth of the time at most.
const TIMES_ITS_COST: u32 = 20;

/// The last answer of one kind.
pub struct Fresh<T> {
    last: Mutex<Last<T>>,
    made: Notify,
}

struct Last<T> {
    answer: Option<(Instant, T)>,
    good_until: Option<Instant>,
    /// Whether one is being made.
    underway: bool,
}

impl<T> Default for Fresh<T> {
    fn default() -> Self {
        let last = Last { answer: None, good_until: None, underway: false };
        Self { last: Mutex::new(last), made: Notify::new() }
    }
}

/// Lets another one be made, also where making this one failed.
struct Underway<T>(Arc<Fresh<T>>);

impl<T> Drop for Underway<T> {
    fn drop(&mut self) {
        self.0.lock().underway = false;
        self.0.made.notify_waiters();
    }
}

impl<T: Clone + Send + 'static> Fresh<T> {
    /// The answer, made by `make` where the last one is too old, and when it was made. Waits for it
    /// for `patience` and then takes the last one; `None` where there is none yet.
    pub async fn get<F>(
        self: &Arc<Self>,
        patience: Duration,
        make: impl FnOnce() -> F,
    ) -> Option<(Instant, T)>
    where
        F: Future<Output = T> + Send + 'static,
    {
        let made = self.made.notified();
        tokio::pin!(made);
        made.as_mut().enable();
        let is_mine = {
            let mut last = self.lock();
            if last.good_until.is_some_and(|until| Instant::now() < until) {
                return last.answer.clone();
            }
            !std::mem::replace(&mut last.underway, true)
        };
        if is_mine {
            // A task of its own: whoever asked may go away.
            let (underway, answer) = (Underway(self.clone()), make());
            tokio::spawn(async move {
                let begun = Instant::now();
                let answer = answer.await;
                let good_for = GOOD_FOR.max(begun.elapsed() * TIMES_ITS_COST);
                let now = Instant::now();
                let mut last = underway.0.lock();
                (last.answer, last.good_until) = (Some((now, answer)), Some(now + good_for));
            });
        }
        // An answer that does not come in time is told from its age.
        let _ = tokio::time::timeout(patience, made).await;
        self.lock().answer.clone()
    }
}

impl<T> Fresh<T> {
    fn lock(&self) -> std::sync::MutexGuard<'_, Last<T>> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    const LONG: Duration = Duration::from_secs(60);

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn however_many_ask_it_is_made_once() {
        let fresh: Arc<Fresh<u32>> = Arc::default();
        let made = Arc::new(AtomicU32::new(0));
        let asking: Vec<_> = (0..200)
            .map(|_| {
                let (fresh, made) = (fresh.clone(), made.clone());
                tokio::spawn(async move {
                    let make = || async move {
                        tokio::time::sleep(Duration::from_millis(100)).await;
                        made.fetch_add(1, Ordering::Relaxed) + 1
                    };
                    fresh.get(LONG, make).await.unwrap().1
                })
            })
            .collect();
        for answer in asking {
            assert_eq!(answer.await.unwrap(), 1);
        }
        assert_eq!(made.load(Ordering::Relaxed), 1);
        // It took a tenth of a second, so it is good for two; then there is another one.
        fresh.lock().good_until = Some(Instant::now());
        let next = fresh.get(LONG, || async move { made.fetch_add(1, Ordering::Relaxed) + 1 });
        assert_eq!(next.await.unwrap().1, 2);
    }

    #[tokio::test]
    async fn one_that_takes_too_long_or_fails_holds_nobody_up() {
        let fresh: Arc<Fresh<u32>> = Arc::default();
        assert_eq!(fresh.get(LONG, || async { 1 }).await.unwrap().1, 1);
        fresh.lock().good_until = Some(Instant::now());
        let (go, gone) = tokio::sync::oneshot::channel::<()>();
        let slow = || async move {
            let _ = gone.await;
            2
        };
        let short = Duration::from_millis(1);
        assert_eq!(fresh.get(short, slow).await.unwrap().1, 1);
        assert_eq!(fresh.get(short, || async { panic!("one is underway") }).await.unwrap().1, 1);
        go.send(()).unwrap();
        assert_eq!(fresh.get(LONG, || async { 3 }).await.unwrap().1, 2);
        // A panic lets the next one try.
        fresh.lock().good_until = Some(Instant::now());
        assert_eq!(fresh.get(LONG, || async { panic!("on purpose") }).await.unwrap().1, 2);
        assert_eq!(fresh.get(LONG, || async { 4 }).await.unwrap().1, 4);
        let never: Arc<Fresh<u32>> = Arc::default();
        assert!(never.get(short, std::future::pending::<u32>).await.is_none());
    }
}
