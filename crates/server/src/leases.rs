//! Leases: who runs a job shows signs of life, and who shows none loses it.
//!
//! A thread of its own, with a runtime of its own, renews the claims that this process holds, so
//! that neither a busy rendering thread nor a starved async runtime lets one lapse. It also sweeps:
//! a lease whose beat has not moved for [`LEASE`] *by the sweeper's own monotonic clock* is
//! expired. Wall clocks decide nothing, so they may jump; a process that stood still (a suspended
//! machine) finds its claims over by the fence if it was swept meanwhile.

use crate::store::{Claim, Lease, Store, StoreError};
use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;

/// Time between signs of life.
pub const BEAT: Duration = Duration::from_secs(5);
/// Silence after which a lease is over.
pub const LEASE: Duration = Duration::from_secs(30);

/// The claims that workers of this process hold.
#[derive(Default)]
pub struct Leases {
    held: Mutex<HashSet<Claim>>,
}

/// A claim that is renewed until this is dropped, however its worker ends.
pub struct Hold {
    leases: Arc<Leases>,
    claim: Claim,
}

impl Drop for Hold {
    fn drop(&mut self) {
        self.leases.lock().remove(&self.claim);
    }
}

impl Leases {
    /// Renews a claim from now on.
    pub fn hold(self: &Arc<Self>, claim: Claim) -> Hold {
        self.lock().insert(claim);
        Hold { leases: self.clone(), claim }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashSet<Claim>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn held(&self) -> Vec<Claim> {
        self.lock().iter().copied().collect()
    }
}

/// What a sweeper remembers: when it first saw each lease with the beat that it has.
#[derive(Default)]
pub struct Sweep {
    seen: HashMap<Claim, (u64, Duration)>,
}

impl Sweep {
    /// Takes a look: `now` is any monotonic time, `leases` all that there are. Returns those
    /// whose beat has not moved for `silence`.
    pub fn look(&mut self, now: Duration, silence: Duration, leases: &[Lease]) -> Vec<Lease> {
        let mut seen = HashMap::with_capacity(leases.len());
        let mut lapsed = Vec::new();
        for lease in leases {
            let since = match self.seen.get(&lease.claim) {
                Some((beat, since)) if *beat == lease.beat => *since,
                _ => now,
            };
            if now.saturating_sub(since) >= silence {
                lapsed.push(lease.clone());
            }
            seen.insert(lease.claim, (lease.beat, since));
        }
        self.seen = seen;
        lapsed
    }
}

/// Renews and sweeps until `stop`, on a thread of its own.
///
/// # Errors
/// Where the system gives no thread or runtime.
pub fn supervise(
    store: Arc<dyn Store>,
    leases: Arc<Leases>,
    stop: CancellationToken,
    (beat, silence): (Duration, Duration),
    on_expiry: impl Fn(&Lease) + Send + 'static,
) -> std::io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let tend = async move {
        let (began, mut sweep) = (Instant::now(), Sweep::default());
        loop {
            let round = tend_once(&*store, &leases, &mut sweep, began.elapsed(), silence);
            match round.await {
                Ok(expired) => expired.iter().for_each(&on_expiry),
                // Nothing can lapse either while the store does not answer.
                Err(error) => tracing::error!(%error, "cannot renew leases"),
            }
            tokio::select! {
                () = tokio::time::sleep(beat) => {}
                () = stop.cancelled() => return,
            }
        }
    };
    std::thread::Builder::new().name("leases".into()).spawn(move || runtime.block_on(tend))?;
    Ok(())
}

/// Renews what this process holds, then ends what shows no life; what it ended.
async fn tend_once(
    store: &dyn Store,
    leases: &Leases,
    sweep: &mut Sweep,
    now: Duration,
    silence: Duration,
) -> Result<Vec<Lease>, StoreError> {
    for lost in store.renew(&leases.held()).await? {
        // Its worker finds out by its next write, or by looking at the job once a second.
        tracing::debug!(job = %lost.job, "a claim is over");
    }
    let mut expired = Vec::new();
    for lease in sweep.look(now, silence, &store.leases().await?) {
        let reason = format!("its worker gave no sign of life for {} s", silence.as_secs());
        if store.expire(&lease, &reason).await? {
            tracing::warn!(job = %lease.claim.job, owner = lease.owner, "a lease expired");
            expired.push(lease);
        }
    }
    Ok(expired)
}

#[cfg(test)]
mod store_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use uuid::Uuid;

    const SILENCE: Duration = Duration::from_secs(30);

    fn lease(job: u128, fence: u64, beat: u64) -> Lease {
        let claim = Claim { job: Uuid::from_u128(job), fence };
        Lease { claim, owner: "boot".into(), beat }
    }

    fn at(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    #[test]
    fn only_a_beat_that_stands_still_for_a_whole_lease_expires() {
        let mut sweep = Sweep::default();
        let (still, lively) = (lease(1, 1, 7), |beat| lease(2, 1, beat));
        assert_eq!(sweep.look(at(100), SILENCE, &[still.clone(), lively(0)]), []);
        assert_eq!(sweep.look(at(129), SILENCE, &[still.clone(), lively(1)]), []);
        let lapsed = sweep.look(at(130), SILENCE, &[still.clone(), lively(2)]);
        assert_eq!(lapsed, std::slice::from_ref(&still));
        // The same job under a new claim begins anew, and so does one that was away.
        assert_eq!(sweep.look(at(131), SILENCE, &[lease(1, 2, 7)]), []);
        assert_eq!(sweep.look(at(500), SILENCE, &[still]), []);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        /// However the rounds are spaced, a holder that beats between any two of them keeps its
        /// lease, and one that stopped loses it in the first round after a whole lease.
        #[test]
        fn holders_that_beat_keep_their_leases(pauses in prop::collection::vec(0..100u64, 1..50)) {
            let mut sweep = Sweep::default();
            let (mut now, mut first) = (at(0), None);
            for (pause, beat) in pauses.into_iter().zip(0..) {
                now += at(pause);
                let first = *first.get_or_insert(now);
                let lapsed = sweep.look(now, SILENCE, &[lease(1, 1, beat), lease(2, 1, 0)]);
                prop_assert!(!lapsed.contains(&lease(1, 1, beat)));
                prop_assert_eq!(lapsed.contains(&lease(2, 1, 0)), now - first >= SILENCE);
            }
        }
    }
}
