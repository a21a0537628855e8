//! The running service: everything that handlers and workers share, its start and its end.

use crate::api::limits::Vocabulary;
use crate::artifacts::Artifacts;
use crate::config::Config;
use crate::events::Bell;
use crate::http;
use crate::leases::{self, Leases};
use crate::metrics::Metrics;
use crate::queue::Queue;
use crate::store::sqlite::SqliteStore;
use crate::store::{Store, StoreError};
use crate::worker::{self, Pool};
use std::fs::{File, TryLockError};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

/// Scenes that may be imported at once: imports hold whole files in memory.
const IMPORTS_AT_ONCE: usize = 2;
/// How long open requests and running jobs get to end.
const GRACE: Duration = Duration::from_secs(8);
/// How long a deleted job is kept for streams that still follow it.
const PURGE_AFTER_MS: i64 = 60_000;

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
    /// Turns at importing scenes.
    pub imports: Arc<Semaphore>,
    /// Cancelled when the service is to end.
    pub shutdown: CancellationToken,
}

/// Why the service did not start or run.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address reaches beyond this machine.
    #[error(
        "--listen {0} can be reached from other machines and the service has no authentication; add --allow-remote if that is meant"
    )]
    Remote(SocketAddr),
    /// The address cannot be had.
    #[error("cannot listen on {0}: {1}")]
    Listen(SocketAddr, std::io::Error),
    /// The data folder cannot be used.
    #[error("cannot use the data folder {}: {source}", path.display())]
    DataFolder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Another process uses the data folder.
    #[error("the data folder {} is in use by another hemilux process; stop it, or give another --data-dir", .0.display())]
    InUse(PathBuf),
    /// The database cannot be opened or read.
    #[error("cannot use the database {}: {source}", path.display())]
    Database {
        /// Its file.
        path: PathBuf,
        /// What is wrong.
        source: StoreError,
    },
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

/// Runs the service until `stop` is cancelled. `ready` hears the address once it listens.
///
/// # Errors
/// [`ServeError`] where it cannot start.
pub async fn serve(
    config: Config,
    stop: CancellationToken,
    ready: impl FnOnce(SocketAddr),
) -> Result<(), ServeError> {
    if !config.listen.ip().is_loopback() && !config.allow_remote {
        return Err(ServeError::Remote(config.listen));
    }
    let devices = worker::devices::choose(&config.devices).map_err(ServeError::Devices)?;
    let _lock = lock_data_folder(&config)?;
    let folder_trouble = |source| ServeError::DataFolder { path: config.data_dir.clone(), source };
    std::fs::create_dir_all(config.data_dir.join("tmp")).map_err(folder_trouble)?;
    let artifacts = Artifacts::local(&config.data_dir.join("artifacts")).map_err(folder_trouble)?;
    let database = config.data_dir.join("hemilux.sqlite");
    let trouble = |source| ServeError::Database { path: database.clone(), source };
    let store: Arc<dyn Store> = Arc::new(SqliteStore::open(&database).await.map_err(trouble)?);
    // The lock proves that whoever holds leases here is gone; nothing needs to run out.
    for job in store.recover().await.map_err(trouble)? {
        tracing::warn!(%job, "an earlier process left this job running");
    }
    let listener = TcpListener::bind(config.listen)
        .await
        .map_err(|error| ServeError::Listen(config.listen, error))?;
    let address = listener.local_addr()?;

    let bell = Bell::default();
    let service = Arc::new(Service {
        queue: Queue::new(store.clone(), bell.clone()),
        store,
        artifacts,
        bell,
        leases: Arc::default(),
        metrics: Metrics::default(),
        pool: Pool::new(&devices),
        vocabulary: worker::vocabulary(),
        imports: Arc::new(Semaphore::new(IMPORTS_AT_ONCE)),
        shutdown: stop.clone(),
        config,
    });
    let (news, of_expiry) = (service.bell.clone(), (leases::BEAT, leases::LEASE));
    let (store, held) = (service.store.clone(), service.leases.clone());
    leases::supervise(store, held, stop.clone(), of_expiry, move |lease| {
        news.ring(lease.claim.job);
    })?;
    let workers = worker::start(&service)?;
    let purge = tokio::spawn(purge_deleted(service.clone()));
    tracing::info!(%address, data = %service.config.data_dir.display(), "listening");
    ready(address);

    let server = axum::serve(listener, http::router(service.clone()))
        .with_graceful_shutdown(stop.clone().cancelled_owned());
    let server = tokio::spawn(server.into_future());
    stop.cancelled().await;
    tracing::info!("shutting down");
    // Event streams and workers hear of it through the same token.
    let deadline = tokio::time::Instant::now() + GRACE;
    if tokio::time::timeout_at(deadline, server).await.is_err() {
        tracing::warn!("some requests did not end in time");
    }
    if tokio::time::timeout_at(deadline, workers.joined()).await.is_err() {
        tracing::warn!("some workers did not stop in time; their jobs go back to the queue");
    }
    purge.abort();
    let released = service.store.release_all().await?;
    if released > 0 {
        tracing::info!(released, "running jobs went back to the queue");
    }
    service.store.close().await;
    Ok(())
}

/// Holds the data folder for this process; the system lets go of it when the process ends,
/// however it ends.
fn lock_data_folder(config: &Config) -> Result<File, ServeError> {
    let trouble = |source| ServeError::DataFolder { path: config.data_dir.clone(), source };
    std::fs::create_dir_all(&config.data_dir).map_err(trouble)?;
    let lock = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(config.data_dir.join("lock"))
        .map_err(trouble)?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(TryLockError::WouldBlock) => Err(ServeError::InUse(config.data_dir.clone())),
        Err(TryLockError::Error(error)) => Err(trouble(error)),
    }
}

/// Forgets deleted jobs and removes their files, now and then.
async fn purge_deleted(service: Arc<Service>) {
    let mut ticks = tokio::time::interval(Duration::from_secs(20));
    loop {
        ticks.tick().await;
        match service.store.purge(PURGE_AFTER_MS).await {
            Ok(jobs) => {
                for job in jobs {
                    if let Err(error) = service.artifacts.remove_job(job).await {
                        tracing::warn!(%job, %error, "cannot remove the files of a deleted job");
                    }
                }
            }
            Err(error) => tracing::error!(%error, "cannot purge deleted jobs"),
        }
    }
}
