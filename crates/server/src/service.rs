//! The running service: everything that handlers and workers share, its start and its end.

use crate::access::KeyUses;
use crate::api::limits::Vocabulary;
use crate::artifacts::Artifacts;
use crate::clock::Clock;
use crate::config::Config;
use crate::data_folder::{self, FolderError};
use crate::descriptors;
use crate::disk::Disk;
use crate::events::Bell;
use crate::http;
use crate::http::audit::Audit;
use crate::http::import_turns::ImportTurns;
use crate::http::places::Places;
use crate::http::rate::RateLimiter;
use crate::key_watch::{self, KeyWatch};
use crate::leases::{self, Leases};
use crate::memory;
use crate::metrics::Metrics;
use crate::queue::Queue;
use crate::retention::{self, Keeper};
use crate::store::{Store, StoreError};
use crate::webhooks;
use crate::worker::{self, Pool};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

/// Scenes that may be imported at once: each import is a process with memory of its own.
const IMPORTS_AT_ONCE: usize = 2;
/// How long open requests and running jobs get to end.
const GRACE: Duration = Duration::from_secs(8);
/// How long open requests get: a client that reads nothing must not hold the end up.
const REQUEST_GRACE: Duration = Duration::from_secs(4);

/// What handlers and workers share.
pub struct Service {
    /// Settings.
    pub config: Config,
    /// Scenes, jobs, events.
    pub store: Arc<dyn Store>,
    /// Files.
    pub artifacts: Artifacts,
    /// News of jobs.
    pub bell: Bell,
    /// Jobs for workers.
    pub queue: Queue,
    /// Claims that workers hold.
    pub leases: Arc<Leases>,
    /// Counters.
    pub metrics: Metrics,
    /// The devices.
    pub pool: Pool,
    /// What the engine can be asked for.
    pub vocabulary: Vocabulary,
    /// Places for uploads.
    pub uploads: Places,
    /// Turns at importing scenes.
    pub imports: ImportTurns,
    /// Bytes of pictures that events may carry at the same time.
    pub inline_room: Arc<Semaphore>,
    /// What probes were told last.
    pub probes: http::Probes,
    /// How often each caller asked.
    pub rates: RateLimiter,
    /// Which keys were used.
    pub key_uses: KeyUses,
    /// Which keys have ended, for what goes on under them.
    pub key_watch: KeyWatch,
    /// Where it is written down who did what.
    pub audit: Audit,
    /// How full the disk is.
    pub disk: Disk,
    /// Most bytes that a job may need by estimate; `None` where the system does not say.
    pub max_job_bytes: Option<u64>,
    /// What goes, and when.
    pub keeper: Keeper,
    /// Which time to believe.
    pub clock: Clock,
    /// Cancelled when the service is to end.
    pub shutdown: CancellationToken,
}

/// Why the service did not start or run.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address reaches beyond this machine.
    #[error(
        "--listen {0} can be reached from other machines and there is no API key yet; make one with `hemilux keys add`, or add --require-keys; --allow-remote serves everyone who reaches the port, if that is meant"
    )]
    Remote(SocketAddr),
    /// The address cannot be had.
    #[error("cannot listen on {0}: {1}")]
    Listen(SocketAddr, std::io::Error),
    /// The data folder cannot be used.
    #[error("{0}")]
    Folder(#[from] FolderError),
    /// The audit log cannot be written.
    #[error("cannot write the file of --audit-file: {0}")]
    Audit(std::io::Error),
    /// The store failed at the end.
    #[error("{0}")]
    Store(#[from] StoreError),
    /// A device of --devices is not there.
    #[error("{0}")]
    Devices(String),
    /// The system failed.
    #[error("{0}")]
    Io(#[from] std::io::Error),
}

impl Service {
    fn new(
        config: Config,
        devices: &[String],
        (store, artifacts): (Arc<dyn Store>, Artifacts),
        clock: Clock,
        audit: Audit,
        stop: &CancellationToken,
    ) -> Self {
        let bell = Bell::default();
        let of_process = config.job_memory_mb.map(|mb| mb << 20);
        let max_job_bytes = config.guard.max_job_memory_mb.map(|mb| mb << 20);
        Self {
            queue: Queue::new(store.clone(), bell.clone()),
            keeper: Keeper::new(store.clone(), artifacts.clone(), bell.clone()),
            store,
            artifacts,
            clock,
            bell,
            leases: Arc::default(),
            metrics: Metrics::default(),
            pool: Pool::new(devices, config.threads),
            vocabulary: worker::vocabulary(),
            uploads: Places::new(config.intake.max_uploads, config.intake.max_uploads_each),
            imports: ImportTurns::new(IMPORTS_AT_ONCE),
            inline_room: Arc::new(Semaphore::new(http::INLINE_BYTES_AT_ONCE)),
            probes: http::Probes::default(),
            rates: RateLimiter::default(),
            key_uses: KeyUses::default(),
            key_watch: KeyWatch::default(),
            audit,
            disk: Disk::new(config.data_dir.clone(), config.guard.min_free_mb),
            max_job_bytes: max_job_bytes.or_else(|| memory::default_estimate_limit(of_process)),
            shutdown: stop.clone(),
            config,
        }
    }
}

/// Runs the service until `stop` is cancelled. `ready` hears the address once it listens.
///
/// # Errors
/// [`ServeError`] where it cannot start.
pub async fn serve(
    config: Config,
    stop: CancellationToken,
    ready: impl FnOnce(SocketAddr),
) -> Result<(), ServeError> {
    let files = descriptors::raise_limit();
    let devices = worker::devices::choose(&config.devices).map_err(ServeError::Devices)?;
    let _lock = data_folder::lock(&config.data_dir)?;
    std::fs::create_dir_all(config.data_dir.join("tmp"))
        .map_err(|source| FolderError::System { path: config.data_dir.clone(), source })?;
    let (store, artifacts) = data_folder::open(&config.data_dir, config.guard.adopt_files).await?;
    let store: Arc<dyn Store> = Arc::new(store);
    let database = config.data_dir.join(data_folder::DATABASE);
    let trouble = |source| FolderError::Database { path: database.clone(), source };
    let any_keys = store.any_keys().await.map_err(trouble)?;
    let is_closed = config.guard.require_keys || any_keys;
    if !config.listen.ip().is_loopback() && !is_closed && !config.allow_remote {
        return Err(ServeError::Remote(config.listen));
    }
    // The lock proves that whoever holds leases here is gone; nothing needs to run out.
    for job in store.recover().await.map_err(trouble)? {
        tracing::warn!(%job, "an earlier process left this job running");
    }
    let audit = Audit::new(&config.guard).map_err(ServeError::Audit)?;
    let listener = TcpListener::bind(config.listen)
        .await
        .map_err(|error| ServeError::Listen(config.listen, error))?;
    let address = listener.local_addr()?;

    let grace = Duration::from_secs_f64(3600.0 * config.guard.clock_grace_hours);
    let clock = retention::clock(&*store, grace).await.map_err(trouble)?;
    let service = Arc::new(Service::new(config, &devices, (store, artifacts), clock, audit, &stop));
    let (news, of_expiry) = (service.bell.clone(), (leases::BEAT, leases::LEASE));
    let (store, held) = (service.store.clone(), service.leases.clone());
    leases::supervise(store, held, stop.clone(), of_expiry, move |lease| {
        news.ring(lease.claim.job);
    })?;
    let workers = worker::start(&service)?;
    let tasks = [
        tokio::spawn(retention::keep_order(service.clone())),
        tokio::spawn(retention::sweep::keep_sweeping(service.clone())),
        tokio::spawn(webhooks::deliver(service.clone())),
        tokio::spawn(key_watch::look_after(service.clone())),
    ];
    if is_closed && !any_keys {
        tracing::warn!(
            "keys are required and there is none: make the first with `hemilux keys --data-dir {} add NAME` (in a container: docker exec CONTAINER hemilux keys --data-dir {0} add NAME)",
            service.config.data_dir.display()
        );
    }
    tracing::info!(%address, data = %service.config.data_dir.display(), "listening");
    ready(address);

    let router = http::router(service.clone());
    let places = places(&service.config, files);
    let server =
        tokio::spawn(http::listen::serve(listener, router, service.clone(), places, REQUEST_GRACE));
    stop.cancelled().await;
    tracing::info!("shutting down");
    // Event streams and workers hear of it through the same token.
    let deadline = tokio::time::Instant::now() + GRACE;
    if !matches!(server.await, Ok(true)) {
        tracing::warn!("some requests did not end in time");
    }
    if tokio::time::timeout_at(deadline, workers.joined()).await.is_err() {
        tracing::warn!("some workers did not stop in time; their jobs go back to the queue");
    }
    for task in tasks {
        task.abort();
    }
    let released = service.store.release_all().await?;
    if released > 0 {
        tracing::info!(released, "running jobs went back to the queue");
    }
    service.store.close().await;
    Ok(())
}

/// Places for connections where so many files may be open.
fn places(config: &Config, files: u64) -> Places {
    let intake = &config.intake;
    let possible = descriptors::connections(files, intake.max_uploads);
    let (all, each) = intake.connections(possible, !config.listen.ip().is_loopback());
    if intake.max_connections.is_some_and(|wanted| wanted > possible) {
        tracing::warn!(
            files,
            connections = all,
            "the limit on open files allows fewer connections than --max-connections"
        );
    }
    tracing::info!(files, connections = all, of_one_address = each, "limits");
    Places::new(all, each)
}
