//! What goes, and when: deleted jobs, jobs past their time, scenes that nothing uses, files that
//! nothing names. Maps of skies are kept and go as scenes do, and "scenes" stands for both here.
//!
//! A record goes before its file, so a file that a record names is never removed; a crash in
//! between leaves a file that nothing names, and the [`sweep`] finds it. Scenes are
//! shared: the same bytes may be sent again at any time. So whoever stores a scene holds the lock
//! for reading from its file to its record, and whoever removes one holds it for writing.

pub mod sweep;

use crate::api::environments::EnvironmentMap;
use crate::api::scenes::Scene;
use crate::artifacts::{ArtifactError, Artifacts, Content};
use crate::clock::{Clock, Memory, Reading};
use crate::config::GuardConfig;
use crate::events::JobNotifier;
use crate::shared::Shared;
use crate::store::bytes::Staying;
use crate::store::{Store, StoreError};
use jiff::{SignedDuration, Timestamp};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{OwnedRwLockReadGuard, RwLock};
use uuid::Uuid;

/// How often deleted jobs are looked for.
const PURGE_EVERY: Duration = Duration::from_secs(20);
/// How often expired things are looked for: every so many rounds, and at the start.
const EXPIRE_EVERY_ROUNDS: u32 = 3;
/// How long a deleted job is kept for streams that still follow it.
const PURGE_AFTER_MS: i64 = 60_000;
/// Jobs that make room before everything is added up again, for their scenes may have gone with
/// them.
const EVICTIONS_BETWEEN_LOOKS: u32 = 10;
/// Things looked at together.
const BATCH: u32 = 100;
/// Where only the space is short, scenes stay at least so long: their jobs may be on the way.
const LEAST_SCENE_AGE: SignedDuration = SignedDuration::from_hours(1);

/// Why something could not be removed.
#[derive(Debug, thiserror::Error)]
pub enum RetentionError {
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The files failed.
    #[error(transparent)]
    Artifacts(#[from] ArtifactError),
}

/// How long and how much is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rules {
    /// Longest time that ended jobs, and scenes without jobs, are kept.
    pub age: Option<SignedDuration>,
    /// Most bytes.
    pub bytes: Option<u64>,
}

impl Rules {
    /// As the operator has set them.
    pub fn of(config: &GuardConfig) -> Self {
        let seconds = |days: f64| SignedDuration::from_secs_f64(days * 86_400.0);
        Self { age: config.keep_days.map(seconds), bytes: config.keep_bytes() }
    }
}

/// What a round removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Removed {
    /// Jobs, hidden now and purged later.
    pub jobs: u64,
    /// Scenes and maps with their files.
    pub scenes: u64,
}

/// Removes things, and stores what must not be removed meanwhile.
#[derive(Clone)]
pub struct Keeper {
    store: Arc<dyn Store>,
    artifacts: Artifacts,
    bell: JobNotifier,
    collecting: Arc<RwLock<()>>,
}

impl Keeper {
    /// A keeper of these records and files; there must be only one of them, or copies of one.
    pub fn new(store: Arc<dyn Store>, artifacts: Artifacts, bell: JobNotifier) -> Self {
        Self { store, artifacts, bell, collecting: Arc::default() }
    }

    /// Stores a scene, file first; whether it is new to `holder`.
    ///
    /// # Errors
    /// Where file or record cannot be stored.
    pub async fn keep_scene(
        &self,
        scene: &Scene,
        content: impl Into<Content>,
        holder: &str,
    ) -> Result<bool, RetentionError> {
        let _nothing_goes = self.collecting.read().await;
        self.artifacts.put_scene(&scene.id, content).await?;
        self.store.put_scene(scene).await?;
        self.hold(&scene.id, holder).await
    }

    /// Stores a map of a sky, file first; whether it is new to `holder`.
    ///
    /// # Errors
    /// Where file or record cannot be stored.
    pub async fn keep_environment(
        &self,
        map: &EnvironmentMap,
        content: impl Into<Content>,
        holder: &str,
    ) -> Result<bool, RetentionError> {
        let _nothing_goes = self.collecting.read().await;
        self.artifacts.put_scene(&map.id, content).await?;
        self.store.put_environment(map).await?;
        self.hold(&map.id, holder).await
    }

    /// Makes a stored upload a holder's; whether it is new to them.
    async fn hold(&self, id: &str, holder: &str) -> Result<bool, RetentionError> {
        // It may have been there and about to expire.
        self.store.use_scene(id).await?;
        Ok(self.store.hold_scene(id, holder).await?)
    }

    /// Removes scenes that all their holders have let go of, unless a job names them.
    ///
    /// # Errors
    /// Where the store or the files fail; what is left is removed the next time.
    pub async fn collect_let_go(&self) -> Result<u64, RetentionError> {
        let mut removed = 0;
        for scene in self.store.scenes_let_go(BATCH).await? {
            let _alone = self.collecting.write().await;
            // Looks again, now that nobody can bring it back.
            if self.store.forget_let_go(&scene).await? {
                self.artifacts.remove_scene(&scene).await?;
                removed += 1;
            }
        }
        Ok(removed)
    }

    /// While this is held, no file goes that no record names: for files that are stored before
    /// their job is accepted.
    pub async fn hold_files(&self) -> OwnedRwLockReadGuard<()> {
        self.collecting.clone().read_owned().await
    }

    /// Forgets jobs that were deleted so long ago, and removes their files.
    ///
    /// # Errors
    /// Where the store fails. A file that stays is found by the next sweep.
    pub async fn purge(&self, older_than_ms: i64) -> Result<u64, RetentionError> {
        let mut purged = 0;
        loop {
            let jobs = self.store.purge(older_than_ms).await?;
            if jobs.is_empty() {
                return Ok(purged);
            }
            for job in &jobs {
                if let Err(error) = self.artifacts.remove_job(*job).await {
                    tracing::warn!(%job, %error, "cannot remove the files of a deleted job");
                }
            }
            purged += jobs.len() as u64;
        }
    }

    /// Removes what the rules say. Jobs are hidden, as if deleted; [`Keeper::purge`] follows.
    ///
    /// # Errors
    /// Where the store fails.
    pub async fn expire(&self, rules: Rules, now: Timestamp) -> Result<Removed, RetentionError> {
        let mut removed = Removed::default();
        if let Some(age) = rules.age {
            let before = now.saturating_sub(age).unwrap_or(Timestamp::MIN);
            loop {
                let jobs = self.store.expired(before, BATCH).await?;
                removed.jobs += self.hide(&jobs).await?;
                if jobs.len() < BATCH as usize {
                    break;
                }
            }
            removed.scenes += self.collect_scenes(before).await?;
        }
        if let Some(most) = rules.bytes {
            let over = self.evict(most, now).await?;
            removed =
                Removed { jobs: removed.jobs + over.jobs, scenes: removed.scenes + over.scenes };
        }
        Ok(removed)
    }

    /// Makes room until so many bytes at most are stored: scenes that no job names go first, then
    /// jobs of whoever stores most. Where what may not go is beyond the limit by itself, no job
    /// goes: the results of all others together would not be enough.
    async fn evict(&self, most: u64, now: Timestamp) -> Result<Removed, RetentionError> {
        let mut removed = Removed::default();
        if self.store.stored_bytes().await? <= most {
            return Ok(removed);
        }
        let before = now.saturating_sub(LEAST_SCENE_AGE).unwrap_or(Timestamp::MIN);
        removed.scenes = self.collect_scenes(before).await?;
        loop {
            let Staying { bytes, fixed } = self.store.staying(before).await?;
            if bytes <= most {
                return Ok(removed);
            }
            if fixed > most {
                tracing::error!(
                    limit = most,
                    bytes,
                    fixed,
                    "more than --keep-gb is stored of what may not go: jobs that are pinned or have not ended, and their scenes; nothing is removed for the limit until there is less of it"
                );
                return Ok(removed);
            }
            let mut over = bytes - most;
            for _ in 0..EVICTIONS_BETWEEN_LOOKS {
                let Some((job, freed)) = self.store.evictable().await? else { return Ok(removed) };
                removed.jobs += self.hide(&[job]).await?;
                over = over.saturating_sub(freed);
                if over == 0 {
                    break;
                }
            }
        }
    }

    async fn hide(&self, jobs: &[Uuid]) -> Result<u64, RetentionError> {
        let mut hidden = 0;
        for job in jobs {
            if self.store.hide_expired(*job).await? {
                self.bell.ring(*job);
                hidden += 1;
            }
        }
        Ok(hidden)
    }

    /// Removes scenes that no job names and that nobody sent or used since `before`.
    async fn collect_scenes(&self, before: Timestamp) -> Result<u64, RetentionError> {
        let mut removed = 0;
        for scene in self.store.unused_scenes(before, BATCH).await? {
            let _alone = self.collecting.write().await;
            // Looks again, now that nobody can bring it back.
            if self.store.forget_scene(&scene, before).await? {
                self.artifacts.remove_scene(&scene).await?;
                removed += 1;
            }
        }
        Ok(removed)
    }
}

/// Removes what is to go, now and then, until the task is aborted.
pub async fn keep_order(shared: Arc<Shared>, keeper: Keeper) {
    let mut ticks = tokio::time::interval(PURGE_EVERY);
    let rules = Rules::of(&shared.config.guard);
    let mut doubted = false;
    for round in 0_u32.. {
        ticks.tick().await;
        if let Err(error) = keeper.purge(PURGE_AFTER_MS).await {
            tracing::error!(%error, "cannot purge deleted jobs");
        }
        match keeper.collect_let_go().await {
            Ok(scenes) => report(&shared, Removed { scenes, ..Removed::default() }),
            Err(error) => tracing::error!(%error, "cannot remove scenes that nobody holds"),
        }
        let reading = shared.clock.look();
        match &reading.doubt {
            Some(why) if !doubted => tracing::warn!(why, "the clock is in doubt"),
            None if doubted => tracing::info!("the clock is believed again"),
            _ => {}
        }
        doubted = reading.doubt.is_some();
        if round % EXPIRE_EVERY_ROUNDS == 0 {
            expire(&shared, &keeper, rules, &reading).await;
        }
        shared.metrics.clock_is_doubted(doubted);
    }
}

/// Removes what has expired. While the clock is in doubt, nothing goes because of its age.
async fn expire(shared: &Shared, keeper: &Keeper, rules: Rules, reading: &Reading) {
    let is_believed = reading.doubt.is_none();
    let rules = Rules { age: rules.age.filter(|_| is_believed), ..rules };
    match keeper.expire(rules, reading.now).await {
        Ok(removed) => report(shared, removed),
        Err(error) => tracing::error!(%error, "cannot remove what is expired"),
    }
    if is_believed && let Err(error) = shared.store.forget_messages(crate::webhooks::KEEP).await {
        tracing::error!(%error, "cannot forget old webhook messages");
    }
    if let Err(error) = remember(&*shared.store, &shared.clock.memory()).await {
        tracing::error!(%error, "cannot note the time");
    }
}

/// Name of the fact that is the memory of the clock.
const CLOCK: &str = "clock";

/// A clock that goes on from what the store remembers of it.
///
/// # Errors
/// Where the store fails.
pub async fn clock(store: &dyn Store, grace: Duration) -> Result<Clock, StoreError> {
    let memory = store.fact(CLOCK).await?;
    let memory = memory.and_then(|memory| serde_json::from_str(&memory).ok());
    let memory = match memory {
        Some(memory) => Some(memory),
        // An earlier release kept none; its records say when it ran.
        None => store.newest_record().await?.map(Memory::of),
    };
    Ok(Clock::new(grace, memory))
}

async fn remember(store: &dyn Store, memory: &Memory) -> Result<(), StoreError> {
    store.keep_fact(CLOCK, &serde_json::to_string(memory).unwrap_or_default()).await
}

/// Counts and logs what was removed.
pub fn report(shared: &Shared, removed: Removed) {
    if removed != Removed::default() {
        tracing::info!(?removed, "retention");
    }
    shared.metrics.count_collected("job", removed.jobs);
    shared.metrics.count_collected("scene", removed.scenes);
}

#[cfg(test)]
mod tests;
