//! `hemilux serve`.

use super::process::{self, Failure};
use crate::config::Config;
use crate::service::{self, ServeError};
use std::io::Write;
use tokio::signal::unix::{SignalKind, signal};
use tokio_util::sync::CancellationToken;

/// How long tasks that ignore the end may hold the process.
const LAST_WAIT: std::time::Duration = std::time::Duration::from_secs(1);

/// Serves until SIGINT or SIGTERM.
pub fn run(config: Config) -> Result<(), Failure> {
    process::keep_files_private();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(Failure::failed)?;
    let done = runtime.block_on(async {
        let stop = CancellationToken::new();
        let (mut interrupt, mut terminate) =
            (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?);
        let on_signal = stop.clone();
        tokio::spawn(async move {
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
            }
            on_signal.cancel();
        });
        service::serve(config, stop, |address| {
            // On standard output for whoever started it with port 0; a closed pipe is fine.
            let _ = writeln!(std::io::stdout(), "http://{address}");
            let _ = std::io::stdout().flush();
        })
        .await
    });
    runtime.shutdown_timeout(LAST_WAIT);
    done.map_err(|error| match error {
        ServeError::Remote(_) | ServeError::Devices(_) => Failure::usage(error),
        _ => Failure::failed(error),
    })
}
