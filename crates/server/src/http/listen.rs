//! Connections (HTTP/1.1): how many, how long a client may take over a request's head, how they end.

use super::app::App;
use super::slots::{NoSlot, Slots};
use crate::access::counted_as;
use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use rustix::net::sockopt;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tower_service::Service;

/// Longest wait for the whole head of a request; an idle connection is closed after it too.
const HEAD_PATIENCE: Duration = Duration::from_secs(60);
/// How long the system waits for a client that takes nothing of what it is sent.
const UNREAD_TIMEOUT_MS: u32 = 60_000;
/// Pause where no connection can be accepted, for want of files perhaps.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);

/// Answers requests until the service is to end, then lets open ones end for as long as `grace`;
/// whether they all did. A connection for which there is no slot is closed at once: it must not
/// keep others from being accepted.
pub async fn serve(
    listener: TcpListener,
    router: Router,
    app: App,
    slots: Slots,
    grace: Duration,
) -> bool {
    let mut connections = http1::Builder::new();
    connections.timer(TokioTimer::new()).header_read_timeout(HEAD_PATIENCE);
    let mut routers = router.into_make_service_with_connect_info::<SocketAddr>();
    let ending = GracefulShutdown::new();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = app.shared.shutdown.cancelled() => break,
        };
        let (stream, peer) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!(%error, "cannot accept a connection");
                tokio::time::sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        let slot = match slots.take(&counted_as(peer.ip())) {
            Ok(slot) => slot,
            Err(full) => {
                let limit = match full {
                    NoSlot::All => "all",
                    NoSlot::Own => "address",
                };
                tracing::debug!(%peer, limit, "closes a connection too many");
                app.shared.metrics.count_refused_connection(limit);
                continue;
            }
        };
        let count = app.shared.metrics.count_connection();
        drop_deaf_clients(&stream);
        let router = match routers.call(peer).await {
            Ok(router) => TowerToHyperService::new(router),
            Err(never) => match never {},
        };
        let connection = ending.watch(connections.serve_connection(TokioIo::new(stream), router));
        tokio::spawn(async move {
            if let Err(error) = connection.await {
                tracing::trace!(%error, "a connection broke off");
            }
            drop((slot, count));
        });
    }
    drop(listener);
    tokio::time::timeout(grace, ending.shutdown()).await.is_ok()
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
