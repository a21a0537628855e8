//! One attempt at one job, as the server sees it: hands the task to the device's executor, follows
//! it, and stores how it ended.

use super::checkpoints::{self, Start};
use super::executor::Executor;
use super::snapshots::PictureFiles;
use super::watch::{Followed, Stop, follow};
use super::wire::{Failure, Message, Order, STORAGE, Task};
use crate::api::jobs::{Job, JobError, Progress};
use crate::artifacts::Content;
use crate::failpoints;
use crate::job_state::{self, Cause, JobState};
use crate::shared::Shared;
use crate::store::{Claim, Outcome, Report, StoreError};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Pause of a device that could not read its job from the storage, beside the job's own: where the
/// whole storage does not answer, a long queue is not run through at full speed.
const STORAGE_PAUSE: Duration = Duration::from_secs(1);

/// Pause before the next try at storing something: doubles from a second to this.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// Tries at storing the picture before the job is put back, uncounted; about two minutes.
const PICTURE_TRIES: u32 = 8;

/// What becomes of a job after an attempt.
enum AttemptEnd {
    /// It has ended, with a picture whose files are still to be stored, where there is one.
    Finish { outcome: Box<Outcome>, picture: Option<PictureFiles> },
    /// It goes back to the queue.
    PutBack { cause: Cause, why: String },
    /// It was deleted, or another worker has it.
    ClaimLost,
}

impl AttemptEnd {
    /// An end with nothing that is still to be stored.
    fn finish(outcome: Outcome) -> Self {
        Self::Finish { outcome: Box::new(outcome), picture: None }
    }

    /// A failure that another attempt would meet again; the figures are the last that there were.
    fn failed(failure: Failure, progress: Option<Progress>) -> Self {
        let error = Some(JobError { code: failure.code, detail: failure.detail });
        Self::finish(Outcome { error, progress, ..Outcome::of(JobState::Failed) })
    }

    /// Back to the queue by no fault of the job's own.
    fn not_its_fault(why: impl Into<String>) -> Self {
        Self::PutBack { cause: Cause::Circumstances, why: why.into() }
    }
}

/// Runs a claimed job to its end and records it; why the executor cannot go on, if so.
pub async fn run(
    shared: &Arc<Shared>,
    executor: &mut Executor,
    claim: Claim,
    job: &Job,
) -> Result<(), String> {
    let _renewed = shared.leases.hold(claim);
    let attempt = Attempt { shared, claim, started: Instant::now() };
    tracing::info!(job = %job.id, attempt = job.attempts, "starts");
    if let Some(outcome) = share(shared, claim, job).await {
        attempt.record(AttemptEnd::finish(outcome)).await;
        return Ok(());
    }
    let (task, parts) = match prepare(shared, executor, job).await {
        Ok(ready) => ready,
        Err(reason) => {
            attempt.cannot_begin(reason).await;
            return Ok(());
        }
    };
    let run = task.run;
    executor.order(Message { header: Order::Run(Box::new(task)), parts });
    let followed = follow(shared, executor, run, claim).await;

    let sound = match &followed.result {
        Err(failure) if !failure.device_is_sound => Err(failure.detail.clone()),
        _ => Ok(()),
    };
    let alone = job.device.as_deref().is_none_or(|device| shared.pool.was_alone(device));
    let stop = followed.stop;
    let end = judge(followed, alone);
    if matches!(&end, AttemptEnd::PutBack { .. }) && stop != Stop::Shutdown {
        shared.queue.put_off(job.id);
    }
    attempt.record(end).await;
    checkpoints::settle(shared, claim.job).await;
    sound
}

/// What becomes of a job whose run ended so; `alone` says whether no other one ran meanwhile.
fn judge(followed: Followed, alone: bool) -> AttemptEnd {
    let Followed { result, was_killed, stop, latest } = followed;
    // A client's cancel that came after it is heeded as the job goes back.
    let shut_down = || AttemptEnd::not_its_fault("the server shut down");
    match result {
        _ if stop == Stop::ClaimLost => AttemptEnd::ClaimLost,
        Ok((_, None)) => shut_down(),
        Ok((stats, Some(picture))) => {
            let state = match (stats.stopped == "cancelled", stop) {
                (false, _) => JobState::Succeeded,
                (true, Stop::Cancel) => JobState::Cancelled,
                (true, _) => return shut_down(),
            };
            let outcome = Outcome { stats: Some(*stats), ..Outcome::of(state) };
            AttemptEnd::Finish { outcome: Box::new(outcome), picture: Some(picture) }
        }
        Err(failure) if failure.code == STORAGE => AttemptEnd::not_its_fault(failure.detail),
        Err(failure) if failure.retry => {
            let cause = match (stop, was_killed) {
                // What a shutdown broke off is no failure of the job.
                (Stop::Shutdown, _) => Cause::Circumstances,
                (_, true) => Cause::OutOfMemory { alone },
                (_, false) => Cause::Failure,
            };
            AttemptEnd::PutBack { cause, why: failure.detail }
        }
        Err(failure) => AttemptEnd::failed(failure, latest),
    }
}

/// Puts back a job that could not be begun by no fault of its own.
pub async fn hand_back(shared: &Arc<Shared>, claim: Claim, why: String) {
    let _renewed = shared.leases.hold(claim);
    let attempt = Attempt { shared, claim, started: Instant::now() };
    attempt.record(AttemptEnd::not_its_fault(why)).await;
}

/// Why an attempt cannot begin.
enum CannotBegin {
    /// The job can never run.
    Useless(Failure),
    /// The storage does not answer.
    NotNow(String),
}

/// Reads what the job needs.
async fn prepare(
    shared: &Shared,
    executor: &mut Executor,
    job: &Job,
) -> Result<(Task, Vec<Content>), CannotBegin> {
    let gone = |what: String| CannotBegin::Useless(Failure::new("scene", what));
    let record = shared.store.scene(&job.scene).await;
    let record = record.map_err(|error| CannotBegin::NotNow(error.to_string()))?;
    let record = record.ok_or_else(|| gone(format!("scene {} is not there", job.scene)))?;
    let scene = shared.artifacts.scene(&job.scene).await.map_err(|error| {
        if error.is_lasting() {
            gone(format!("{error}; send the scene again, then the job"))
        } else {
            CannotBegin::NotNow(error.to_string())
        }
    })?;
    let mut parts = vec![scene];
    parts.extend(sky_of(shared, job).await?);
    let (begins, begins_without) =
        match checkpoints::begin(shared, job).await.map_err(CannotBegin::NotNow)? {
            Start::With(begins, checkpoint) => {
                parts.push(checkpoint);
                (Some(begins), None)
            }
            Start::Afresh(why) => (None, why),
        };
    let thinned = match job.request.snapshots.is_some() {
        true => shared.store.snapshots(job.id).await.map(|snapshots| snapshots.thinned),
        false => Ok(0),
    };
    let config = &shared.config;
    let task = Task {
        run: executor.next_run(),
        job: job.id,
        attempt: job.attempts,
        scene: job.scene.clone(),
        scene_format: record.format,
        max_triangles: shared.config.max_triangles,
        request: job.request.clone(),
        max_seconds: shared.config.max_seconds,
        threads: shared.pool.threads_of(job.device.as_deref()),
        snapshots_slower: thinned.map_err(|error| CannotBegin::NotNow(error.to_string()))?,
        begins,
        begins_without,
        checkpoint_every_s: config.checkpoint_every_s,
        first_checkpoint_s: job_state::first_checkpoint_s(job.interruptions),
        most_checkpoint_bytes: checkpoints::most_bytes(config),
        keeps_solution: config.keep_solutions_mb > 0,
        kept_scene_bytes: config.kept_scene_bytes(job.device.as_deref().unwrap_or_default()),
    };
    Ok((task, parts))
}

/// The file of the map that a job's sky is, where it is one.
async fn sky_of(shared: &Shared, job: &Job) -> Result<Option<Content>, CannotBegin> {
    let Some(id) = job.request.environment_map() else { return Ok(None) };
    shared.artifacts.scene(id).await.map(Some).map_err(|error| {
        if error.is_lasting() {
            let what = format!("{error}; send the environment again, then the job");
            CannotBegin::Useless(Failure::new("environment", what))
        } else {
            CannotBegin::NotNow(error.to_string())
        }
    })
}

/// The end of a job whose identical twin has one already. Anything that goes wrong means that the
/// job is rendered after all.
async fn share(shared: &Shared, claim: Claim, job: &Job) -> Option<Outcome> {
    let twin = shared.store.twin(claim).await.ok()??;
    let (stats, result) = (twin.stats?, twin.result?);
    // One that ran out of time shows how busy the machine was.
    if !["iterations", "target_error", "converged", "no_light"].contains(&stats.stopped.as_str()) {
        return None;
    }
    let mut pictures = Vec::new();
    for picture in &result {
        pictures.push(shared.artifacts.share_picture(twin.id, job.id, picture).await.ok()?);
    }
    // Its chart is that of the run that made the picture; the last point comes with the end.
    let mut progress = shared.store.trace(twin.id).await.ok()?;
    progress.pop();
    let plan = twin.plan.map(|plan| (plan, twin.warnings));
    let report = Report { plan, progress, ..Report::default() };
    shared.store.report(claim, report).await.ok()?;
    Some(Outcome {
        progress: Some(stats.last_progress()),
        stats: Some(stats),
        pictures,
        result_of: Some(twin.id),
        ..Outcome::of(JobState::Succeeded)
    })
}

/// An attempt at a claimed job.
struct Attempt<'a> {
    shared: &'a Arc<Shared>,
    claim: Claim,
    started: Instant,
}

impl Attempt<'_> {
    /// Records that it cannot begin.
    async fn cannot_begin(&self, reason: CannotBegin) {
        match reason {
            CannotBegin::Useless(failure) => self.record(AttemptEnd::failed(failure, None)).await,
            CannotBegin::NotNow(why) => {
                // Not the job's fault: it waits until the storage answers.
                tracing::error!(job = %self.claim.job, why, "cannot read what the job needs");
                self.shared.queue.put_off(self.claim.job);
                self.record(AttemptEnd::not_its_fault(why)).await;
                tokio::select! {
                    () = tokio::time::sleep(STORAGE_PAUSE) => {}
                    () = self.shared.shutdown.cancelled() => {}
                }
            }
        }
    }

    /// Stores how the attempt ended, trying again where the storage does not answer: the work is
    /// done, and a passing trouble should not waste it. It gives up where the service shuts down;
    /// the job then goes back to the queue.
    async fn record(&self, mut end: AttemptEnd) {
        let job = self.claim.job;
        if matches!(end, AttemptEnd::ClaimLost) {
            tracing::info!(%job, "was taken away");
            return self.remove_if_deleted().await;
        }
        let mut pause = Duration::from_secs(1);
        for tries in 0.. {
            end = self.with_files(end, tries).await;
            match self.write(&end).await {
                Some(Ok(())) => return self.count(&end),
                Some(Err(StoreError::ClaimLost(_))) => {
                    tracing::warn!(%job, "was taken away before it could be recorded");
                    return self.remove_if_deleted().await;
                }
                Some(Err(error)) => tracing::error!(%job, %error, "cannot record the end"),
                None => {}
            }
            tokio::select! {
                () = tokio::time::sleep(failpoints::lasting("record-pause", pause)) => {
                    pause = (pause * 2).min(LONGEST_PAUSE);
                }
                () = self.shared.shutdown.cancelled() => {
                    tracing::error!(%job, "shuts down before the end was recorded");
                    return;
                }
            }
        }
    }

    /// Stores the files of a picture, where that is still to be done; what is to be recorded then.
    /// The storage has refused them so many times.
    async fn with_files(&self, end: AttemptEnd, refused: u32) -> AttemptEnd {
        let AttemptEnd::Finish { mut outcome, picture: Some(picture) } = end else { return end };
        match picture.store(self.shared, self.claim).await {
            Ok(pictures) => {
                if let Some(stats) = &mut outcome.stats {
                    stats.seconds_total = self.started.elapsed().as_secs_f64();
                    outcome.progress = Some(stats.last_progress());
                }
                AttemptEnd::finish(Outcome { pictures, ..*outcome })
            }
            Err(error) => {
                tracing::error!(job = %self.claim.job, %error, "cannot keep the picture");
                if refused + 1 < PICTURE_TRIES {
                    return AttemptEnd::Finish { outcome, picture: Some(picture) };
                }
                // Others may fit where this one does not; it goes on from its last checkpoint when
                // its pause is over.
                self.shared.queue.put_off(self.claim.job);
                AttemptEnd::not_its_fault(format!("the picture could not be kept: {error}"))
            }
        }
    }

    /// Writes what needs no more files; `None` where a picture is still to be kept.
    async fn write(&self, end: &AttemptEnd) -> Option<Result<(), StoreError>> {
        let store = &self.shared.store;
        match end {
            AttemptEnd::Finish { picture: Some(_), .. } => None,
            AttemptEnd::Finish { outcome, .. } => {
                Some(store.finish(self.claim, (**outcome).clone()).await)
            }
            AttemptEnd::PutBack { cause, why } => {
                Some(store.release(self.claim, *cause, why).await)
            }
            AttemptEnd::ClaimLost => Some(Err(StoreError::ClaimLost(self.claim.job))),
        }
    }

    /// Logs and counts an end that is recorded.
    fn count(&self, end: &AttemptEnd) {
        let job = self.claim.job;
        match end {
            AttemptEnd::Finish { outcome, .. } => {
                // What was shared is no work of this job's.
                let own = outcome.progress.as_ref().filter(|_| outcome.result_of.is_none());
                let (iterations, shots) =
                    own.map_or((0, 0), |p| (p.figures.iterations, p.figures.shots));
                let seconds = self.started.elapsed().as_secs_f64();
                let state = outcome.state;
                tracing::info!(%job, state = state.as_str(), seconds, iterations, "ended");
                self.shared.metrics.count_job(state, seconds, iterations, shots);
                self.shared.queue.forget(job);
            }
            AttemptEnd::PutBack { why, .. } => tracing::info!(%job, why, "went back to the queue"),
            AttemptEnd::ClaimLost => {}
        }
    }

    /// Removes the files that this attempt may have written after its job was deleted.
    async fn remove_if_deleted(&self) {
        let job = self.claim.job;
        let removed = match self.shared.store.job(job).await {
            Ok(None) => self.shared.artifacts.remove_job(job).await,
            _ => Ok(()),
        };
        if let Err(error) = removed {
            tracing::warn!(%job, %error, "cannot remove files");
        }
    }
}
