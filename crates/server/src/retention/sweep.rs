//! Files that no record names: leftovers of a crash, or all files where the wrong database lies
//! beside them. So none is removed straight away. The sweep moves them into quarantine, where they
//! wait for days; where they would be a large share of all files, it moves nothing and asks.
//!
//! It runs while the service does. Files of jobs that have not ended come before their records, so
//! it leaves those alone; whoever stores a file for a job or a scene that is only about to be
//! recorded holds the keeper's lock for reading. What it moves it looks at again afterwards, and
//! puts back what is named by then.

use super::{Keeper, RetentionError};
use crate::artifacts::{FilePlace, SetAside};
use crate::clock::Reading;
use crate::failpoints;
use crate::shared::Shared;
use crate::store::Recorded;
use jiff::{SignedDuration, Timestamp};
use std::sync::Arc;
use std::time::Duration;

/// How often the quarantine is looked through.
const TEND_EVERY: Duration = Duration::from_secs(3600);
/// How often all files are looked through, in rounds.
const SWEEP_EVERY_ROUNDS: u32 = 24;
/// So many files may go into quarantine however few there are.
const FEW_FILES: u64 = 20;
/// Beyond that, at most one file in so many.
const LARGE_SHARE: u64 = 10;
/// Jobs looked at before others get a turn.
const JOBS_A_TURN: usize = 64;

/// Counts of files that one sweep looked at, moved into quarantine and left.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SweepCounts {
    /// Files that were looked at.
    pub files: u64,
    /// Files that were moved into quarantine.
    pub set_aside: u64,
    /// Files that no record names, and that stay where they are because they are too many.
    pub left: u64,
}

/// Counts of the quarantined files that were put back and that were removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QuarantineCounts {
    /// Files that a record names again, and that are back where they belong.
    pub put_back: u64,
    /// Files that were there for long enough, and are gone.
    pub removed: u64,
}

impl Keeper {
    /// Moves files that no record names into quarantine, as of `now`; nothing where they are a
    /// large share of all files, unless that is allowed.
    ///
    /// # Errors
    /// Where store or files fail.
    pub async fn sweep(&self, now: Timestamp, large: bool) -> Result<SweepCounts, RetentionError> {
        let mut swept = SweepCounts::default();
        let mut orphans = Vec::new();
        for (number, job) in self.artifacts.jobs_with_files().await?.into_iter().enumerate() {
            if number % JOBS_A_TURN == 0 {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
            // The files first: what is written after this is none of them.
            let files = self.artifacts.files_of(job).await?;
            swept.files += files.len() as u64;
            let recorded = self.store.recorded_files(job).await?;
            let unnamed = files.into_iter().filter(|name| is_orphan(&recorded, name));
            orphans.extend(unnamed.map(|name| FilePlace::Job(job, name)));
        }
        for scene in self.artifacts.scenes_with_files().await? {
            swept.files += 1;
            if !self.store.is_stored(&scene).await? {
                orphans.push(FilePlace::Scene(scene));
            }
        }
        let found = orphans.len() as u64;
        if found > FEW_FILES && found > swept.files / LARGE_SHARE && !large {
            return Ok(SweepCounts { left: found, ..swept });
        }
        for place in orphans {
            swept.set_aside += u64::from(self.set_aside(&SetAside { at: now, place }).await?);
        }
        Ok(swept)
    }

    /// Moves a file into quarantine unless a record names it, or may be about to; whether it did.
    async fn set_aside(&self, file: &SetAside) -> Result<bool, RetentionError> {
        let _alone = self.collecting.write().await;
        if !self.is_unnamed(&file.place).await? {
            return Ok(false);
        }
        match self.artifacts.set_aside(file).await {
            Err(error) if error.is_not_found() => return Ok(false),
            done => done?,
        }
        // A job may have been extended meanwhile, and have written the same content again.
        if self.is_unnamed(&file.place).await? {
            tracing::info!(file = ?file.place, "no record names this file; it is in quarantine");
            return Ok(true);
        }
        self.artifacts.put_back(file).await?;
        Ok(false)
    }

    async fn is_unnamed(&self, place: &FilePlace) -> Result<bool, RetentionError> {
        Ok(match place {
            FilePlace::Scene(id) => !self.store.is_stored(id).await?,
            FilePlace::Job(job, name) => is_orphan(&self.store.recorded_files(*job).await?, name),
        })
    }

    /// Puts back what a record names again, and removes what was in quarantine since `before`.
    ///
    /// # Errors
    /// Where store or files fail.
    pub async fn tend_quarantine(
        &self,
        before: Option<Timestamp>,
    ) -> Result<QuarantineCounts, RetentionError> {
        let mut tended = QuarantineCounts::default();
        for file in self.artifacts.all_set_aside().await? {
            let _alone = self.collecting.write().await;
            // Where there is another one in its place, it waits like the others.
            if self.is_named(&file.place).await? && self.artifacts.put_back(&file).await? {
                tended.put_back += 1;
            } else if before.is_some_and(|before| file.at < before) {
                self.artifacts.remove_set_aside(&file).await?;
                tended.removed += 1;
            }
        }
        Ok(tended)
    }

    async fn is_named(&self, place: &FilePlace) -> Result<bool, RetentionError> {
        Ok(match place {
            FilePlace::Scene(id) => self.store.is_stored(id).await?,
            FilePlace::Job(job, name) => match self.store.recorded_files(*job).await? {
                Recorded::Unknown => false,
                Recorded::Open(names) | Recorded::Ended(names) => names.contains(name),
            },
        })
    }
}

/// Whether a file of a job is one that no record names, nor is about to.
fn is_orphan(recorded: &Recorded, name: &str) -> bool {
    match recorded {
        Recorded::Unknown => true,
        Recorded::Open(_) => false,
        Recorded::Ended(names) => !names.contains(name),
    }
}

/// Looks through the files, now and then, until the task is aborted.
pub async fn keep_sweeping(shared: Arc<Shared>, keeper: Keeper) {
    let mut ticks = tokio::time::interval(TEND_EVERY);
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let mut is_due = false;
    for round in 0_u32.. {
        ticks.tick().await;
        // Where a test may hold the sweep up; on a thread that may be held up.
        let _ = tokio::task::spawn_blocking(|| failpoints::pass("sweep", String::new)).await;
        let reading = shared.clock.look();
        if let Err(error) = tend(&shared, &keeper, &reading).await {
            tracing::error!(%error, "cannot look through the quarantine");
        }
        is_due |= round % SWEEP_EVERY_ROUNDS == 0;
        // The quarantine counts from the moment at which a file came into it: that must be right.
        if is_due && reading.doubt.is_none() {
            is_due = false;
            if let Err(error) = sweep(&shared, &keeper, reading.now).await {
                tracing::error!(%error, "cannot look for files that nothing names");
            }
        }
    }
}

async fn tend(shared: &Shared, keeper: &Keeper, reading: &Reading) -> Result<(), RetentionError> {
    let days = shared.config.guard.quarantine_days;
    let age = SignedDuration::from_secs_f64(days * 86_400.0);
    let before = match reading.doubt {
        None => reading.now.saturating_sub(age).ok(),
        Some(_) => None,
    };
    let tended = keeper.tend_quarantine(before).await?;
    if tended != QuarantineCounts::default() {
        tracing::info!(?tended, "quarantine");
    }
    shared.metrics.count_collected("quarantined", tended.removed);
    Ok(())
}

async fn sweep(shared: &Shared, keeper: &Keeper, now: Timestamp) -> Result<(), RetentionError> {
    match shared.artifacts.remove_half_written().await {
        Ok(0) => {}
        Ok(files) => tracing::info!(files, "removed what was left half-written"),
        Err(error) => tracing::error!(%error, "cannot remove what was left half-written"),
    }
    let swept = keeper.sweep(now, shared.config.guard.sweep_large).await?;
    if swept.left > 0 {
        tracing::error!(
            files = swept.files,
            orphans = swept.left,
            "so many files are named by no record that the database may be the wrong one, or an old one; they stay where they are. If they are to go into quarantine, start with --sweep-large"
        );
    }
    tracing::debug!(?swept, "sweep");
    shared.metrics.count_collected("orphan", swept.set_aside);
    shared.metrics.orphans_left(swept.left);
    Ok(())
}
