//! Following a run: stores what its executor says, passes on a cancel or a shutdown, and ends an
//! executor that says nothing or does not obey.

use super::checkpoints;
use super::executor::Executor;
use super::snapshots::{Album, PictureFiles};
use super::wire::{ExecutorEvent, Failure, Message, Order};
use crate::api::jobs::{Progress, Stats};
use crate::shared::Shared;
use crate::store::{Claim, Report, StoreError};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Mutex;
use tokio::task::JoinSet;

/// How often events are written.
const FLUSH_INTERVAL: Duration = Duration::from_millis(200);
/// Longest time between two looks at the job's record.
const RECHECK: Duration = Duration::from_secs(1);
/// How long an executor may take to stop where the server shuts down.
const SHUTDOWN_GRACE: Duration = Duration::from_secs(4);

/// Why a run was asked to stop; later ones outrank earlier ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stop {
    /// It was not.
    No,
    /// The server shuts down.
    Shutdown,
    /// The client cancelled.
    Cancel,
    /// The job was deleted, or another worker has it.
    ClaimLost,
}

/// A run that is over.
pub struct Followed {
    /// Its figures, and its picture unless it was stopped and none was wanted; or why it came to
    /// nothing.
    pub result: RunResult,
    /// Whether somebody else killed the executor without a word, as the system does for want of
    /// memory.
    pub was_killed: bool,
    /// Whether it was asked to stop.
    pub stop: Stop,
    /// The latest figures.
    pub latest: Option<Progress>,
}

/// What a run came to.
type RunResult = Result<(Box<Stats>, Option<PictureFiles>), Failure>;

/// Follows a run to its end, with everything that it said stored.
pub async fn follow(
    shared: &Arc<Shared>,
    executor: &mut Executor,
    run: u64,
    claim: Claim,
) -> Followed {
    let mut recorder = RunRecorder {
        shared: shared.clone(),
        claim,
        album: Arc::new(Mutex::new(Album::new(shared.config.guard.max_job_mb << 20))),
        stop: Stop::No,
        was_killed: false,
        latest: None,
        pending: Report::default(),
        snapshots: JoinSet::new(),
        checkpoints: JoinSet::new(),
        turn: Arc::default(),
    };
    let result = recorder.follow(executor, run).await;
    recorder.flush().await;
    while recorder.snapshots.join_next().await.is_some() {}
    while recorder.checkpoints.join_next().await.is_some() {}
    let RunRecorder { was_killed, stop, latest, .. } = recorder;
    Followed { result, was_killed, stop, latest }
}

/// Stores the progress, snapshots and checkpoints that an attempt reports.
struct RunRecorder {
    shared: Arc<Shared>,
    claim: Claim,
    album: Arc<Mutex<Album>>,
    stop: Stop,
    was_killed: bool,
    latest: Option<Progress>,
    pending: Report,
    /// How much less often each lets the next ones come.
    snapshots: JoinSet<u32>,
    /// How long each takes to store.
    checkpoints: JoinSet<Duration>,
    /// Whose turn it is to be stored.
    turn: Arc<Mutex<()>>,
}

impl RunRecorder {
    async fn follow(&mut self, executor: &mut Executor, run: u64) -> RunResult {
        let shared = self.shared.clone();
        let mut bell = shared.bell.listen(self.claim.job);
        let mut flush = tokio::time::interval(FLUSH_INTERVAL);
        flush.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let mut recheck = tokio::time::interval(RECHECK);
        recheck.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let (mut heard, mut told) = (Instant::now(), None);
        loop {
            tokio::select! {
                // What was said is heard before its silence is judged.
                biased;
                message = executor.hear() => {
                    heard = Instant::now();
                    let Some(message) = message else {
                        let end = executor.end();
                        self.was_killed = end.was_killed;
                        return Err(Failure::of_executor(end.how));
                    };
                    if matches!(message.header, ExecutorEvent::Solved) {
                        // It did stop; a large picture takes its time to encode.
                        told = told.map(|_| heard);
                    }
                    if let Some(result) = self.take(message) {
                        return result;
                    }
                }
                () = shared.shutdown.cancelled(), if self.stop < Stop::Shutdown => {
                    self.stop = Stop::Shutdown;
                }
                Some(slower) = self.snapshots.join_next(), if !self.snapshots.is_empty() => {
                    let slower = slower.unwrap_or_default();
                    executor.order(Order::SnapshotKept { run, slower }.into());
                }
                Some(took) = self.checkpoints.join_next(), if !self.checkpoints.is_empty() => {
                    let micros = took.unwrap_or_default().as_micros() as u64;
                    executor.order(Order::CheckpointKept { run, micros }.into());
                }
                _ = flush.tick() => {
                    self.flush().await;
                    if let Some(why) = self.out_of_patience(heard, told) {
                        executor.kill();
                        tracing::warn!(job = %self.claim.job, why, "ended the executor");
                        return Err(Failure::of_executor(why));
                    }
                }
                () = bell.news() => self.look_for_cancel().await,
                _ = recheck.tick() => self.look_for_cancel().await,
            }
            if self.stop > Stop::No && told.is_none() {
                told = Some(Instant::now());
                // What was rendered until a shutdown goes on from its checkpoint.
                let wants_picture = self.stop == Stop::Cancel;
                executor.order(Order::Stop { run, wants_picture }.into());
            }
        }
    }

    /// Why the executor must be ended, if so: it was last heard at one time, and told to stop at
    /// the other.
    fn out_of_patience(&self, heard: Instant, told: Option<Instant>) -> Option<String> {
        let config = &self.shared.config;
        let grace = match self.stop {
            Stop::Shutdown => SHUTDOWN_GRACE,
            _ => Duration::from_secs_f64(config.cancel_grace_s),
        };
        let patience = Duration::from_secs_f64(config.no_progress_s);
        if told.is_some_and(|told| told.elapsed() > grace) {
            Some(format!("it did not stop within {} s", grace.as_secs_f64()))
        } else if heard.elapsed() > patience {
            Some(format!("it made no progress for {} s", patience.as_secs_f64()))
        } else {
            None
        }
    }

    fn take(&mut self, message: Message<ExecutorEvent>) -> Option<RunResult> {
        let torn =
            || Failure::of_executor("the picture does not have the files that it should".into());
        match message.header {
            ExecutorEvent::Ready | ExecutorEvent::Began | ExecutorEvent::Solved => None,
            ExecutorEvent::NoDevice { error } => Some(Err(Failure::of_executor(error))),
            ExecutorEvent::Planned(plan, warnings) => {
                self.pending.plan = Some((plan, warnings));
                None
            }
            ExecutorEvent::Progress(progress) => {
                self.latest = Some(progress.clone());
                self.pending.progress.push(progress);
                None
            }
            ExecutorEvent::Checkpoint(facts) => {
                let (shared, claim, turn) = (self.shared.clone(), self.claim, self.turn.clone());
                self.checkpoints.spawn(async move {
                    checkpoints::keep(&shared, claim, *facts, message.parts, &turn).await
                });
                None
            }
            ExecutorEvent::Snapshot(progress, files) => {
                match PictureFiles::new(files, message.parts) {
                    Some(picture) => {
                        let (shared, claim) = (self.shared.clone(), self.claim);
                        let album = self.album.clone();
                        self.snapshots.spawn(async move {
                            let mut album = album.lock().await;
                            if let Err(error) = album.keep(&shared, claim, picture, progress).await
                            {
                                tracing::warn!(job = %claim.job, %error, "a snapshot was lost");
                            }
                            album.slower()
                        });
                        None
                    }
                    None => Some(Err(torn())),
                }
            }
            ExecutorEvent::Rendered(stats, None) => Some(Ok((stats, None))),
            ExecutorEvent::Rendered(stats, Some(files)) => Some(
                PictureFiles::new(files, message.parts)
                    .map(|picture| (stats, Some(picture)))
                    .ok_or_else(torn),
            ),
            ExecutorEvent::Failed(failure) => Some(Err(failure)),
        }
    }

    fn ask_to_stop(&mut self, stop: Stop) {
        self.stop = self.stop.max(stop);
    }

    async fn flush(&mut self) {
        if self.pending.plan.is_none() && self.pending.progress.is_empty() {
            return;
        }
        let report = std::mem::take(&mut self.pending);
        match self.shared.store.report(self.claim, report).await {
            Ok(cancel) => {
                if cancel {
                    self.ask_to_stop(Stop::Cancel);
                }
                self.shared.bell.ring(self.claim.job);
            }
            Err(StoreError::ClaimLost(_)) => self.ask_to_stop(Stop::ClaimLost),
            Err(error) => tracing::error!(job = %self.claim.job, %error, "progress was lost"),
        }
    }

    async fn look_for_cancel(&mut self) {
        match self.shared.store.job(self.claim.job).await {
            Ok(Some(job)) if job.cancel_requested => self.ask_to_stop(Stop::Cancel),
            Ok(None) => self.ask_to_stop(Stop::ClaimLost),
            Ok(Some(_)) => {}
            Err(error) => tracing::error!(job = %self.claim.job, %error, "cannot read the job"),
        }
    }
}
