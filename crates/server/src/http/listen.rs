//! Connections (HTTP/1.1): how many, how long a client may take over a request's head, how they end.

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use rustix::net::sockopt;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tower_service::Service;

/// Connections at the same time; further ones wait to be accepted. Each costs a file and some
/// kilobytes.
const MAX_CONNECTIONS: usize = 8192;
/// Longest wait for the whole head of a request; an idle connection is closed after it too.
const HEAD_PATIENCE: Duration = Duration::from_secs(60);
/// How long the system waits for a client that takes nothing of what it is sent.
const UNREAD_TIMEOUT_MS: u32 = 60_000;
/// Pause where no connection can be accepted, for want of files perhaps.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);

/// Answers requests until `stop` is cancelled, then lets open ones end for as long as `grace`;
/// whether they all did.
pub async fn serve(
    listener: TcpListener,
    app: Router,
    stop: CancellationToken,
    grace: Duration,
) -> bool {
    let mut connections = http1::Builder::new();
    connections.timer(TokioTimer::new()).header_read_timeout(HEAD_PATIENCE);
    let mut apps = app.into_make_service_with_connect_info::<SocketAddr>();
    let room = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    let ending = GracefulShutdown::new();
    loop {
        let accepted = tokio::select! {
            accepted = accept(&listener, &room) => accepted,
            () = stop.cancelled() => break,
        };
        let (stream, peer, place) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!(%error, "cannot accept a connection");
                tokio::time::sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        drop_deaf_clients(&stream);
        let app = match apps.call(peer).await {
            Ok(app) => TowerToHyperService::new(app),
            Err(never) => match never {},
        };
        let connection = ending.watch(connections.serve_connection(TokioIo::new(stream), app));
        tokio::spawn(async move {
            if let Err(error) = connection.await {
                tracing::trace!(%error, "a connection broke off");
            }
            drop(place);
        });
    }
    drop(listener);
    tokio::time::timeout(grace, ending.shutdown()).await.is_ok()
}

/// The next connection, once there is a place for it.
async fn accept(
    listener: &TcpListener,
    room: &Arc<Semaphore>,
) -> std::io::Result<(TcpStream, SocketAddr, tokio::sync::OwnedSemaphorePermit)> {
    let place = room.clone().acquire_owned().await.map_err(std::io::Error::other)?;
    let (stream, peer) = listener.accept().await?;
    Ok((stream, peer, place))
}

/// Tells the system to drop a connection whose client has vanished or reads nothing, so that
/// neither holds a stream for ever.
fn drop_deaf_clients(stream: &TcpStream) {
    let set = |done: rustix::io::Result<()>| {
        if let Err(error) = done {
            tracing::debug!(%error, "cannot set an option of a connection");
        }
    };
    set(sockopt::set_socket_keepalive(stream, true));
    #[cfg(target_os = "linux")]
    {
        set(sockopt::set_tcp_keepidle(stream, Duration::from_secs(60)));
        set(sockopt::set_tcp_user_timeout(stream, UNREAD_TIMEOUT_MS));
    }
}
