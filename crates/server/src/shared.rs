//! What all parts of the running service work with: each of them is given this, and none of them is
//! named here.

use crate::artifacts::Artifacts;
use crate::clock::Clock;
use crate::config::Config;
use crate::disk::Disk;
use crate::events::JobNotifier;
use crate::leases::Leases;
use crate::metrics::Metrics;
use crate::pool::Pool;
use crate::queue::Queue;
use crate::store::Store;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;

/// What HTTP, workers, retention and webhooks share.
pub struct Shared {
    /// Settings.
    pub config: Config,
    /// Scenes, jobs, events.
    pub store: Arc<dyn Store>,
    /// Files.
    pub artifacts: Artifacts,
    /// News of jobs.
    pub bell: JobNotifier,
    /// Jobs for workers.
    pub queue: Queue,
    /// Claims that workers hold.
    pub leases: Arc<Leases>,
    /// Counters.
    pub metrics: Metrics,
    /// The devices.
    pub pool: Pool,
    /// How full the disk is.
    pub disk: Disk,
    /// Which time to believe.
    pub clock: Clock,
    /// Cancelled when the service is to end.
    pub shutdown: CancellationToken,
}

impl Shared {
    /// What a service shares that is about to start, with these records and files.
    pub fn new(
        config: Config,
        pool: Pool,
        (store, artifacts): (Arc<dyn Store>, Artifacts),
        clock: Clock,
        shutdown: CancellationToken,
    ) -> Self {
        let bell = JobNotifier::default();
        Self {
            queue: Queue::new(store.clone(), bell.clone()),
            store,
            artifacts,
            bell,
            leases: Arc::default(),
            metrics: Metrics::default(),
            pool,
            disk: Disk::new(config.data_dir.clone(), config.guard.min_free_mb),
            clock,
            shutdown,
            config,
        }
    }
}
