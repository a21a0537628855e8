//! What the handlers work with.

use super::audit_log::AuditLog;
use super::import_turns::ImportTurns;
use super::rate::RateLimiter;
use super::recent::Recent;
use super::slots::Slots;
use crate::access::KeyUses;
use crate::key_watch::KeyWatch;
use crate::memory;
use crate::retention::Keeper;
use crate::shared::Shared;
use std::sync::Arc;
use tokio::sync::Semaphore;

/// Scenes that may be imported at once: each import is a process with memory of its own.
const IMPORTS_AT_ONCE: usize = 2;
/// Bytes of pictures in events that are on their way to clients, all streams together.
const INLINE_BYTES_AT_ONCE: usize = 64 << 20;

/// What handlers share.
pub type App = Arc<AppState>;

/// What the service shares, and what only requests need.
pub struct AppState {
    /// What all parts of the service share.
    pub shared: Arc<Shared>,
    /// Stores scenes, so that none is removed meanwhile.
    pub keeper: Keeper,
    /// Slots for uploads.
    pub uploads: Slots,
    /// Turns at importing scenes.
    pub imports: ImportTurns,
    /// Bytes of pictures that events may carry at the same time.
    pub inline_room: Arc<Semaphore>,
    /// What the database said last to probes.
    pub recent: Recent,
    /// How often each caller asked.
    pub rates: RateLimiter,
    /// Which keys were used.
    pub key_uses: KeyUses,
    /// Which keys have ended, for what goes on under them.
    pub key_watch: Arc<KeyWatch>,
    /// Where it is written down who did what.
    pub audit: AuditLog,
    /// Most bytes that a job may need by estimate; `None` where the system does not say.
    pub max_job_bytes: Option<u64>,
}

impl AppState {
    /// The state of a service that has answered nothing yet.
    pub fn new(shared: Arc<Shared>, keeper: Keeper, audit: AuditLog) -> Self {
        let config = &shared.config;
        let of_process = config.job_memory_mb.map(|mb| mb << 20);
        let max_job_bytes = config.guard.max_job_memory_mb.map(|mb| mb << 20);
        Self {
            keeper,
            uploads: Slots::new(config.intake.max_uploads, config.intake.max_uploads_each),
            imports: ImportTurns::new(IMPORTS_AT_ONCE),
            inline_room: Arc::new(Semaphore::new(INLINE_BYTES_AT_ONCE)),
            recent: Recent::default(),
            rates: RateLimiter::default(),
            key_uses: KeyUses::default(),
            key_watch: Arc::default(),
            audit,
            max_job_bytes: max_job_bytes.or_else(|| memory::default_estimate_limit(of_process)),
            shared,
        }
    }
}
