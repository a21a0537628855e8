//! Answers that cost something and that anybody may ask for: they are made about once a second,
//! however many ask, and whoever asks meanwhile gets the last one.

use super::problem::Problem;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Notify;

/// How long an answer is good.
const GOOD_FOR: Duration = Duration::from_secs(1);
/// How many times as long as it took to make a costly answer is good at least: making them takes a
/// twentieth of the time at most.
const TIMES_ITS_COST: u32 = 20;
/// How long a costly answer is good at most.
const GOOD_FOR_AT_MOST: Duration = Duration::from_secs(30);

/// The last answer of one kind.
pub struct Fresh<T> {
    /// Whether making one is much work, not only a wait.
    is_costly: bool,
    last: Mutex<Last<T>>,
    made: Notify,
}

/// An answer, or why there is none.
pub type Answer<T> = Result<T, Problem>;

struct Last<T> {
    answer: Option<(Instant, Answer<T>)>,
    good_until: Option<Instant>,
    /// Whether one is being made.
    underway: bool,
}

impl<T> Default for Fresh<T> {
    fn default() -> Self {
        let last = Last { answer: None, good_until: None, underway: false };
        Self { is_costly: false, last: Mutex::new(last), made: Notify::new() }
    }
}

impl<T> Fresh<T> {
    /// Answers that are much work to make: the longer one takes, the longer it is good.
    pub fn costly() -> Self {
        Self { is_costly: true, ..Self::default() }
    }

    /// How long an answer is good that took so long to make. A failure took as long as the wait for
    /// what failed, and may be over.
    fn good_for(&self, answer: &Answer<T>, took: Duration) -> Duration {
        match answer {
            Ok(_) if self.is_costly => (took * TIMES_ITS_COST).clamp(GOOD_FOR, GOOD_FOR_AT_MOST),
            _ => GOOD_FOR,
        }
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
    ) -> Option<(Instant, Answer<T>)>
    where
        F: Future<Output = Answer<T>> + Send + 'static,
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
                let good_for = underway.0.good_for(&answer, begun.elapsed());
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

    fn said(answer: Option<(Instant, Answer<u32>)>) -> Option<u32> {
        answer.and_then(|(_, answer)| answer.ok())
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn however_many_ask_it_is_made_once() {
        let fresh: Arc<Fresh<u32>> = Arc::new(Fresh::costly());
        let made = Arc::new(AtomicU32::new(0));
        let asking: Vec<_> = (0..200)
            .map(|_| {
                let (fresh, made) = (fresh.clone(), made.clone());
                tokio::spawn(async move {
                    let make = || async move {
                        tokio::time::sleep(Duration::from_millis(100)).await;
                        Ok(made.fetch_add(1, Ordering::Relaxed) + 1)
                    };
                    said(fresh.get(LONG, make).await)
                })
            })
            .collect();
        for answer in asking {
            assert_eq!(answer.await.unwrap(), Some(1));
        }
        assert_eq!(made.load(Ordering::Relaxed), 1);
        // It took a tenth of a second, so it is good for two; then there is another one.
        fresh.lock().good_until = Some(Instant::now());
        let next = fresh.get(LONG, || async move { Ok(made.fetch_add(1, Ordering::Relaxed) + 1) });
        assert_eq!(said(next.await), Some(2));
    }

    /// A database that did not answer for half a minute may do so a second later.
    #[test]
    fn a_long_wait_or_a_failure_is_soon_looked_at_again() {
        let (cheap, costly) = (Fresh::<u32>::default(), Fresh::<u32>::costly());
        let seconds = Duration::from_secs;
        let failed = || Err(Problem::unavailable("no answer"));
        assert_eq!(cheap.good_for(&Ok(1), seconds(30)), GOOD_FOR);
        assert_eq!(cheap.good_for(&failed(), seconds(30)), GOOD_FOR);
        assert_eq!(costly.good_for(&failed(), seconds(30)), GOOD_FOR);
        assert_eq!(costly.good_for(&Ok(1), Duration::ZERO), GOOD_FOR);
        assert_eq!(costly.good_for(&Ok(1), Duration::from_millis(500)), seconds(10));
        assert_eq!(costly.good_for(&Ok(1), seconds(100)), GOOD_FOR_AT_MOST);
    }

    #[tokio::test]
    async fn one_that_takes_too_long_or_fails_holds_nobody_up() {
        let fresh: Arc<Fresh<u32>> = Arc::default();
        assert_eq!(said(fresh.get(LONG, || async { Ok(1) }).await), Some(1));
        fresh.lock().good_until = Some(Instant::now());
        let (go, gone) = tokio::sync::oneshot::channel::<()>();
        let slow = || async move {
            let _ = gone.await;
            Ok(2)
        };
        let short = Duration::from_millis(1);
        assert_eq!(said(fresh.get(short, slow).await), Some(1));
        assert_eq!(said(fresh.get(short, || async { panic!("one is underway") }).await), Some(1));
        go.send(()).unwrap();
        assert_eq!(said(fresh.get(LONG, || async { Ok(3) }).await), Some(2));
        // A panic lets the next one try.
        fresh.lock().good_until = Some(Instant::now());
        assert_eq!(said(fresh.get(LONG, || async { panic!("on purpose") }).await), Some(2));
        assert_eq!(said(fresh.get(LONG, || async { Ok(4) }).await), Some(4));
        let never: Arc<Fresh<u32>> = Arc::default();
        assert!(never.get(short, std::future::pending::<Answer<u32>>).await.is_none());
    }
}
