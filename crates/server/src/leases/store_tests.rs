//! Leases in a store: clocks that jump, and a runtime that stands still.

use super::{Leases, Sweep, supervise};
use crate::job_state::JobState;
use crate::store::conformance::fixture::{ASKING, Home};
use crate::store::sqlite::tests::{Folder, first_release};
use crate::store::sqlite::time::CLOCK_JUMP_MS;
use crate::store::{Lease, Outcome};
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

/// The wall clock jumps while a job runs; leases, results and recovery do not care.
#[tokio::test]
async fn clocks_may_jump() {
    const DAY_MS: i64 = 86_400_000;
    let folder = Folder::new();
    first_release(&folder.file()).await;
    let store = folder.open().await;
    store.recover().await.unwrap();
    for jump in [400 * DAY_MS, -400 * DAY_MS] {
        let (claim, job) = store.claim(&ASKING).await.unwrap().unwrap();
        let mut sweep = Sweep::default();
        let silence = Duration::from_secs(30);
        let mut look = async |second| {
            let leases = store.leases().await.unwrap();
            sweep.look(Duration::from_secs(second), silence, &leases)
        };
        assert_eq!(look(0).await, []);
        CLOCK_JUMP_MS.set(CLOCK_JUMP_MS.get() + jump);
        // Its holder is alive and says so; only monotonic seconds count.
        assert_eq!(look(29).await, []);
        assert_eq!(store.renew(&[claim]).await.unwrap(), []);
        assert_eq!(look(31).await, []);
        assert_eq!(store.recover().await.unwrap(), Vec::<Uuid>::new());
        store.finish(claim, Outcome::of(JobState::Succeeded)).await.unwrap();
        let ended = store.job(job.id).await.unwrap().unwrap();
        assert_eq!(ended.state, JobState::Succeeded);
        assert!(ended.timings.running_s >= 0.0 && ended.timings.total_s >= 0.0);
        let events = store.events(job.id, 0, 100).await.unwrap();
        assert!(events.windows(2).all(|pair| pair[0].seq < pair[1].seq));
    }
    CLOCK_JUMP_MS.set(0);
}

/// Renewal does not depend on the runtime that serves requests, nor on the rendering thread: here
/// both are this one, and it is blocked.
#[tokio::test]
async fn leases_are_renewed_while_the_runtime_stands_still() {
    let folder = Folder::new();
    first_release(&folder.file()).await;
    let store = folder.open().await;
    store.recover().await.unwrap();
    let (held, _) = store.claim(&ASKING).await.unwrap().unwrap();
    let (leaked, job) = store.claim(&ASKING).await.unwrap().unwrap();
    let leases: Arc<Leases> = Arc::default();
    let hold = leases.hold(held);
    let stop = CancellationToken::new();
    let of_expiry = (Duration::from_millis(20), Duration::from_millis(200));
    let (expired, heard) = std::sync::mpsc::channel();
    let tell = move |lease: &Lease| expired.send(lease.claim).unwrap();
    supervise(store.clone(), leases, stop.clone(), of_expiry, tell).unwrap();
    // Nobody renews a claim whose worker is gone, though its process lives.
    assert_eq!(heard.recv_timeout(Duration::from_secs(10)).unwrap(), leaked);
    std::thread::sleep(Duration::from_millis(400));
    assert!(heard.try_recv().is_err(), "a renewed lease expired");
    // Looked at from elsewhere: the store's own connection for leases is the supervisor's.
    let lease = folder.open().await.leases().await.unwrap().pop().unwrap();
    assert!(lease.claim == held && lease.beat >= 5, "{lease:?}");
    assert_eq!(store.job(job.id).await.unwrap().unwrap().state, JobState::Queued);
    // A worker that ends, however it does, stops renewing.
    drop(hold);
    assert_eq!(heard.recv_timeout(Duration::from_secs(10)).unwrap(), held);
    stop.cancel();
}
