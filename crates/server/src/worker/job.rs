//! One attempt at one job, as the server sees it: hands the task to the device's executor, follows
//! it, and stores how it ended.

use super::checkpoints::{self, Start};
use super::executor::Executor;
use super::snapshots::Drawn;
use super::watch::{Ended, Followed, Stop, follow};
use super::wire::{Failure, Message, Order, STORAGE, Task};
use crate::api::jobs::{Job, JobError, Progress, Stats};
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

enum Ending {
    Done(JobState, Box<Stats>, Drawn),
    /// With the result of an identical job.
    Shared(Box<Outcome>),
    Failed(Failure),
    PutBack {
        cause: Cause,
        why: String,
    },
    Dropped,
}

/// Runs a claimed job to its end and records it; why the executor cannot go on, if so.
pub async fn run(
    shared: &Arc<Shared>,
    executor: &mut Executor,
    claim: Claim,
    job: &Job,
) -> Result<(), String> {
    let _renewed = shared.leases.hold(claim);
    let started = Instant::now();
    tracing::info!(job = %job.id, attempt = job.attempts, "starts");
    if let Some(outcome) = share(shared, claim, job).await {
        record(shared, claim, Ending::Shared(Box::new(outcome)), None, started).await;
        return Ok(());
    }
    let (task, parts) = match prepare(shared, executor, job).await {
        Ok(ready) => ready,
        Err(unready) => {
            cannot_begin(shared, claim, unready, started).await;
            return Ok(());
        }
    };
    let run = task.run;
    executor.order(Message { header: Order::Run(Box::new(task)), parts });
    let Followed { ended, stop, latest } = follow(shared, executor, run, claim).await;

    let sound = match &ended {
        Ended::Rendered(..) => Ok(()),
        Ended::Failed(failure) if failure.device_is_sound => Ok(()),
        Ended::Failed(failure) => Err(failure.detail.clone()),
        Ended::Lost(epitaph) => Err(epitaph.how.clone()),
    };
    let alone = job.device.as_deref().is_none_or(|device| shared.pool.was_alone(device));
    let ending = judge(ended, stop, alone);
    if matches!(&ending, Ending::PutBack { .. }) && stop != Stop::Shutdown {
        shared.queue.put_off(job.id);
    }
    record(shared, claim, ending, latest, started).await;
    checkpoints::settle(shared, claim.job).await;
    sound
}

/// Records that an attempt cannot begin.
async fn cannot_begin(shared: &Arc<Shared>, claim: Claim, unready: Unready, started: Instant) {
    match unready {
        Unready::Useless(failure) => {
            record(shared, claim, Ending::Failed(failure), None, started).await;
        }
        Unready::NotNow(why) => {
            // Not the job's fault: it waits until the storage answers.
            tracing::error!(job = %claim.job, why, "cannot read what the job needs");
            shared.queue.put_off(claim.job);
            let ending = Ending::PutBack { cause: Cause::Circumstances, why };
            record(shared, claim, ending, None, started).await;
            tokio::select! {
                () = tokio::time::sleep(STORAGE_PAUSE) => {}
                () = shared.shutdown.cancelled() => {}
            }
        }
    }
}

/// What becomes of a job whose run ended so; `alone` says whether no other one ran meanwhile.
fn judge(ended: Ended, stop: Stop, alone: bool) -> Ending {
    let put_back = |why, was_killed| {
        let cause = match (stop, was_killed) {
            // What a shutdown broke off is no failure of the job.
            (Stop::Shutdown, _) => Cause::Circumstances,
            (_, true) => Cause::OutOfMemory { alone },
            (_, false) => Cause::Failure,
        };
        Ending::PutBack { cause, why }
    };
    // A client's cancel that came after it is heeded as the job goes back.
    let shut_down =
        || Ending::PutBack { cause: Cause::Circumstances, why: "the server shut down".into() };
    match ended {
        _ if stop == Stop::ClaimLost => Ending::Dropped,
        Ended::Rendered(_, None) => shut_down(),
        Ended::Rendered(stats, Some(drawn)) if stats.stopped == "cancelled" => match stop {
            Stop::Cancel => Ending::Done(JobState::Cancelled, stats, drawn),
            _ => shut_down(),
        },
        Ended::Rendered(stats, Some(drawn)) => Ending::Done(JobState::Succeeded, stats, drawn),
        Ended::Failed(failure) if failure.code == STORAGE => {
            Ending::PutBack { cause: Cause::Circumstances, why: failure.detail }
        }
        Ended::Failed(failure) if failure.retry => put_back(failure.detail, false),
        Ended::Failed(failure) => Ending::Failed(failure),
        Ended::Lost(epitaph) => put_back(epitaph.how, epitaph.was_killed),
    }
}

/// Puts back a job that could not be begun by no fault of its own.
pub async fn hand_back(shared: &Arc<Shared>, claim: Claim, why: String) {
    let _renewed = shared.leases.hold(claim);
    let ending = Ending::PutBack { cause: Cause::Circumstances, why };
    record(shared, claim, ending, None, Instant::now()).await;
}

/// Why an attempt cannot begin.
enum Unready {
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
) -> Result<(Task, Vec<Content>), Unready> {
    let gone = |what: String| Unready::Useless(Failure::new("scene", what));
    let record = shared.store.scene(&job.scene).await;
    let record = record.map_err(|error| Unready::NotNow(error.to_string()))?;
    let record = record.ok_or_else(|| gone(format!("scene {} is not there", job.scene)))?;
    let scene = shared.artifacts.scene(&job.scene).await.map_err(|error| {
        if error.is_lasting() {
            gone(format!("{error}; send the scene again, then the job"))
        } else {
            Unready::NotNow(error.to_string())
        }
    })?;
    let mut parts = vec![scene];
    let (begins, begins_without) =
        match checkpoints::begin(shared, job).await.map_err(Unready::NotNow)? {
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
        scene_format: record.format,
        max_triangles: shared.config.max_triangles,
        request: job.request.clone(),
        max_seconds: shared.config.max_seconds,
        threads: shared.pool.threads_of(job.device.as_deref()),
        snapshots_slower: thinned.map_err(|error| Unready::NotNow(error.to_string()))?,
        begins,
        begins_without,
        checkpoint_every_s: config.checkpoint_every_s,
        first_checkpoint_s: job_state::first_checkpoint_s(job.interruptions),
        most_checkpoint_bytes: checkpoints::most_bytes(config),
        keeps_solution: config.keep_solutions_mb > 0,
    };
    Ok((task, parts))
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
        progress: Some(final_progress(&stats)),
        stats: Some(stats),
        pictures,
        result_of: Some(twin.id),
        ..Outcome::of(JobState::Succeeded)
    })
}

/// Pause before the next try at storing something: doubles from a second to this.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// Tries at storing the picture before the job is put back, uncounted; about two minutes.
const PICTURE_TRIES: u32 = 8;

/// What is to be stored about the end of an attempt.
enum Record {
    /// The files of the picture first, then the rest.
    Picture {
        state: JobState,
        drawn: Drawn,
        stats: Box<Stats>,
    },
    Outcome(Box<Outcome>),
    Release {
        cause: Cause,
        why: String,
    },
}

impl Record {
    fn of(ending: Ending, latest: Option<Progress>) -> Option<Self> {
        Some(match ending {
            Ending::Done(state, stats, drawn) => Self::Picture { state, drawn, stats },
            Ending::Shared(outcome) => Self::Outcome(outcome),
            Ending::Failed(failure) => {
                let error = Some(JobError { code: failure.code, detail: failure.detail });
                let progress = latest;
                let outcome = Outcome { error, progress, ..Outcome::of(JobState::Failed) };
                Self::Outcome(Box::new(outcome))
            }
            Ending::PutBack { cause, why } => Self::Release { cause, why },
            Ending::Dropped => return None,
        })
    }

    /// Stores the files of a picture, where that is still to be done; what is to be recorded then.
    /// The storage has refused them so many times.
    async fn with_files(
        self,
        shared: &Shared,
        claim: Claim,
        refused: u32,
        started: Instant,
    ) -> Self {
        let Self::Picture { state, drawn, stats } = self else { return self };
        match drawn.store(shared, claim).await {
            Ok(pictures) => {
                let seconds_total = started.elapsed().as_secs_f64();
                let stats = Stats { seconds_total, ..*stats };
                Self::Outcome(Box::new(Outcome {
                    progress: Some(final_progress(&stats)),
                    stats: Some(stats),
                    pictures,
                    ..Outcome::of(state)
                }))
            }
            Err(error) => {
                tracing::error!(job = %claim.job, %error, "cannot keep the picture");
                if refused + 1 < PICTURE_TRIES {
                    return Self::Picture { state, drawn, stats };
                }
                // Others may fit where this one does not; it goes on from its last checkpoint when
                // its pause is over.
                shared.queue.put_off(claim.job);
                let why = format!("the picture could not be kept: {error}");
                Self::Release { cause: Cause::Circumstances, why }
            }
        }
    }
}

/// Stores how the attempt ended, trying again where the storage does not answer: the work is
/// done, and a passing trouble should not waste it. It gives up where the service shuts down; the
/// job then goes back to the queue.
async fn record(
    shared: &Arc<Shared>,
    claim: Claim,
    ending: Ending,
    latest: Option<Progress>,
    started: Instant,
) {
    let Some(mut record) = Record::of(ending, latest) else {
        tracing::info!(job = %claim.job, "was taken away");
        return remove_if_deleted(shared, claim).await;
    };
    let mut pause = Duration::from_secs(1);
    for tries in 0.. {
        record = record.with_files(shared, claim, tries, started).await;
        match write(shared, claim, &record).await {
            Some(Ok(())) => return ended(shared, claim, &record, started),
            Some(Err(StoreError::ClaimLost(_))) => {
                tracing::warn!(job = %claim.job, "was taken away before it could be recorded");
                return remove_if_deleted(shared, claim).await;
            }
            Some(Err(error)) => {
                tracing::error!(job = %claim.job, %error, "cannot record the end");
            }
            None => {}
        }
        tokio::select! {
            () = tokio::time::sleep(failpoints::lasting("record-pause", pause)) => {
                pause = (pause * 2).min(LONGEST_PAUSE);
            }
            () = shared.shutdown.cancelled() => {
                tracing::error!(job = %claim.job, "shuts down before the end was recorded");
                return;
            }
        }
    }
}

/// Writes what needs no more files; `None` where the picture is still to be kept.
async fn write(shared: &Shared, claim: Claim, record: &Record) -> Option<Result<(), StoreError>> {
    match record {
        Record::Picture { .. } => None,
        Record::Outcome(outcome) => Some(shared.store.finish(claim, (**outcome).clone()).await),
        Record::Release { cause, why } => Some(shared.store.release(claim, *cause, why).await),
    }
}

/// Logs and counts an end that is recorded.
fn ended(shared: &Shared, claim: Claim, record: &Record, started: Instant) {
    match record {
        Record::Outcome(outcome) => {
            // What was shared is no work of this job's.
            let own = outcome.progress.as_ref().filter(|_| outcome.result_of.is_none());
            let (iterations, shots) = own.map_or((0, 0), |p| (p.iterations, p.shots));
            let seconds = started.elapsed().as_secs_f64();
            tracing::info!(job = %claim.job, state = outcome.state.as_str(), seconds, iterations, "ended");
            shared.metrics.count_job(outcome.state, seconds, iterations, shots);
            shared.queue.forget(claim.job);
        }
        Record::Release { why, .. } => {
            tracing::info!(job = %claim.job, why, "went back to the queue");
        }
        Record::Picture { .. } => {}
    }
}

/// Removes the files that this attempt may have written after its job was deleted.
async fn remove_if_deleted(shared: &Shared, claim: Claim) {
    let removed = match shared.store.job(claim.job).await {
        Ok(None) => shared.artifacts.remove_job(claim.job).await,
        _ => Ok(()),
    };
    if let Err(error) = removed {
        tracing::warn!(job = %claim.job, %error, "cannot remove files");
    }
}

fn final_progress(stats: &Stats) -> Progress {
    Progress {
        iterations: stats.iterations,
        shots: stats.shots,
        light_source_selection_ratio: stats.light_source_selection_ratio,
        estimated_error: stats.estimated_error,
        seconds: stats.seconds_solve,
        seconds_remaining: Some(0.0),
        fraction: 1.0,
    }
}
