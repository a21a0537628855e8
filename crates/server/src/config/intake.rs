//! Settings of what the service takes in at a time: connections, uploads, imports of scenes.

use clap::Args;
use std::time::Duration;

/// Settings of `hemilux serve`: connections, uploads, imports.
#[derive(Args, Clone, Debug)]
pub struct IntakeConfig {
    /// Connections at the same time; further ones are closed at once. By default, and at most,
    /// 8192 or as many as the limit on open files allows.
    #[arg(long, env = "HEMILUX_MAX_CONNECTIONS", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub max_connections: Option<u64>,
    /// Connections at the same time from one address (IPv6: from one /64 network). By default half
    /// of all where only this machine reaches the service, else an eighth; behind a proxy on
    /// another machine, all come from the proxy's address.
    #[arg(long, env = "HEMILUX_MAX_CONNECTIONS_EACH", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub max_connections_each: Option<u64>,
    /// Uploads at the same time, each from its first byte until its scene is stored; beyond it the
    /// server answers 503.
    #[arg(long, env = "HEMILUX_MAX_UPLOADS", default_value_t = 32, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub max_uploads: u64,
    /// Uploads of one key or address at the same time; beyond it the server answers 429. Where
    /// callers are not told apart (no keys, no quotas), only --max-uploads holds.
    #[arg(long, env = "HEMILUX_MAX_UPLOADS_EACH", default_value_t = 8, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub max_uploads_each: u64,
    /// Seconds that an upload may take to arrive; besides, 30 seconds of silence end it, and less
    /// than a kilobyte a second.
    #[arg(long, env = "HEMILUX_UPLOAD_SECONDS", default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub upload_seconds: u64,
    /// Most memory of the process that imports an uploaded scene, MiB of address space. What needs
    /// more is refused.
    #[arg(long, env = "HEMILUX_IMPORT_MEMORY_MB", default_value_t = 768, value_parser = clap::value_parser!(u64).range(128..=67_108_864))]
    pub import_memory_mb: u64,
    /// Seconds that importing an uploaded scene may take. What takes longer is refused.
    #[arg(long, env = "HEMILUX_IMPORT_SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub import_seconds: u64,
}

/// One address may have this share of all connections: half of them where only this machine
/// reaches the service, or else an eighth.
const SHARE_OF_AN_ADDRESS: (u64, u64) = (2, 8);

impl IntakeConfig {
    /// Connections in all and of one address, where so many are possible and other machines reach
    /// the service or not.
    pub fn connections(&self, possible: u64, is_remote: bool) -> (u64, u64) {
        let all = self.max_connections.map_or(possible, |most| most.min(possible));
        let (local, remote) = SHARE_OF_AN_ADDRESS;
        let share = all / if is_remote { remote } else { local };
        (all, self.max_connections_each.unwrap_or(share).clamp(1, all))
    }

    /// How long an upload may take to arrive.
    pub fn upload_time(&self) -> Duration {
        Duration::from_secs(self.upload_seconds)
    }
}
