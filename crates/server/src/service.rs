//! The running service: its start, what it starts, and its end.

use crate::config::Config;
use crate::data_folder::{self, FolderError};
use crate::descriptors;
use crate::http::app::AppState;
use crate::http::audit_log::AuditLog;
use crate::http::slots::Slots;
use crate::http::{self, listen};
use crate::key_watch;
use crate::leases;
use crate::pool::Pool;
use crate::retention::{self, Keeper, sweep};
use crate::shared::Shared;
use crate::store::{Store, StoreError};
use crate::webhooks;
use crate::worker::{self, devices, threads};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// How long open requests and running jobs get to end.
const GRACE: Duration = Duration::from_secs(8);
/// How long open requests get: a client that reads nothing must not hold the end up.
const REQUEST_GRACE: Duration = Duration::from_secs(4);

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
    let devices = devices::choose(&config.devices).map_err(ServeError::Devices)?;
    let _lock = data_folder::lock(&config.data_dir)?;
    let (shared, audit, listener) = prepare(config, &devices, &stop).await?;
    let keeper = Keeper::new(shared.store.clone(), shared.artifacts.clone(), shared.bell.clone());
    let app = Arc::new(AppState::new(shared.clone(), keeper.clone(), audit));

    let (news, of_expiry) = (shared.bell.clone(), (leases::BEAT, leases::LEASE));
    let (store, held) = (shared.store.clone(), shared.leases.clone());
    leases::supervise(store, held, stop.clone(), of_expiry, move |lease| {
        news.ring(lease.claim.job);
    })?;
    let workers = worker::start(&shared)?;
    let tasks = start_tasks(&shared, &keeper, &app);
    let address = listener.local_addr()?;
    tracing::info!(%address, data = %shared.config.data_dir.display(), "listening");
    ready(address);

    let router = http::router(app.clone());
    let slots = slots(&shared.config, files);
    let server = tokio::spawn(listen::serve(listener, router, app, slots, REQUEST_GRACE));
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
    let released = shared.store.release_all().await?;
    if released > 0 {
        tracing::info!(released, "running jobs went back to the queue");
    }
    shared.store.close().await;
    Ok(())
}

/// Opens the data folder, which is locked, and the address; what the service then begins with.
async fn prepare(
    config: Config,
    devices: &[String],
    stop: &CancellationToken,
) -> Result<(Arc<Shared>, AuditLog, TcpListener), ServeError> {
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
    let audit = AuditLog::new(&config.guard).map_err(ServeError::Audit)?;
    let listener = TcpListener::bind(config.listen)
        .await
        .map_err(|error| ServeError::Listen(config.listen, error))?;
    if is_closed && !any_keys {
        tracing::warn!(
            "keys are required and there is none: make the first with `hemilux keys --data-dir {} add NAME` (in a container: docker exec CONTAINER hemilux keys --data-dir {0} add NAME)",
            config.data_dir.display()
        );
    }
    let grace = Duration::from_secs_f64(3600.0 * config.guard.clock_grace_hours);
    let clock = retention::clock(&*store, grace).await.map_err(trouble)?;
    let budget = config.threads.unwrap_or_else(threads::available);
    let pool = Pool::new(devices::list(), devices, threads::shares(budget, devices.len()));
    let shared = Shared::new(config, pool, (store, artifacts), clock, stop.clone());
    Ok((Arc::new(shared), audit, listener))
}

/// Starts what goes on beside requests and jobs, until it is aborted.
fn start_tasks(shared: &Arc<Shared>, keeper: &Keeper, app: &AppState) -> [JoinHandle<()>; 4] {
    [
        tokio::spawn(retention::keep_order(shared.clone(), keeper.clone())),
        tokio::spawn(sweep::keep_sweeping(shared.clone(), keeper.clone())),
        tokio::spawn(webhooks::deliver(shared.clone())),
        tokio::spawn(key_watch::look_after(app.key_watch.clone(), shared.store.clone())),
    ]
}

/// Slots for connections where so many files may be open.
fn slots(config: &Config, files: u64) -> Slots {
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
    Slots::new(all, each)
}
