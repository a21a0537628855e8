//! One attempt at one job.

use super::watch::{Stop, Watcher, keep_picture};
use super::{checkpoints, scenes};
use crate::api;
use crate::api::jobs::{CameraRequest, Job, JobError, PictureFormat};
use crate::artifacts::ArtifactError;
use crate::job_state::JobState;
use crate::service::Service;
use crate::store::{Claim, Outcome, StoreError};
use hemilux_engine::device::{Device, DeviceError};
use hemilux_engine::image;
use hemilux_engine::render::{
    Begin, CameraChoice, ExplicitCamera, Limits, RenderError, RenderRequest, Rendered, Stats,
    StopReason, render,
};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::runtime::Handle;

/// Why an attempt came to nothing.
struct Failure {
    code: &'static str,
    detail: String,
    /// Whether another attempt may succeed.
    retry: bool,
    /// Whether the device can go on.
    device_is_sound: bool,
}

impl Failure {
    fn new(code: &'static str, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into(), retry: false, device_is_sound: true }
    }
}

/// Runs a claimed job to its end and records it; false where the device must be opened again.
pub fn run(
    service: &Arc<Service>,
    runtime: &Handle,
    device: &mut dyn Device,
    claim: Claim,
    job: &Job,
) -> bool {
    let started = Instant::now();
    tracing::info!(job = %job.id, attempt = job.attempts, "starts");
    let (mut watcher, scribe) = Watcher::start(service, runtime, claim, job);
    let attempted =
        catch_unwind(AssertUnwindSafe(|| attempt(service, runtime, device, job, &mut watcher)))
            .unwrap_or_else(|panic| {
                let text = crate::panic_text(&*panic);
                tracing::error!(job = %job.id, panic = text, "the render panicked");
                let failure = Failure::new("panic", format!("an unexpected fault: {text}"));
                Err(Failure { device_is_sound: false, ..failure })
            });
    watcher.hand_over();
    let (stop, latest) = (watcher.stop(), watcher.latest());
    drop(watcher);
    runtime.block_on(async {
        if let Err(error) = scribe.await {
            tracing::error!(job = %job.id, %error, "the recording task failed");
        }
    });
    let device_is_sound = attempted.as_ref().err().is_none_or(|failure| failure.device_is_sound);

    let ending = match attempted {
        _ if stop == Stop::ClaimLost => Ending::Dropped,
        Ok(rendered) => match (rendered.stats.stopped, stop) {
            (StopReason::Cancelled, Stop::No) => {
                Ending::PutBack { counted: false, why: "the server shut down".into() }
            }
            (StopReason::Cancelled, _) => Ending::Done(JobState::Cancelled, Box::new(rendered)),
            _ => Ending::Done(JobState::Succeeded, Box::new(rendered)),
        },
        Err(failure) if failure.retry => Ending::PutBack { counted: true, why: failure.detail },
        Err(failure) => Ending::Failed(failure),
    };
    record(service, runtime, claim, ending, latest, started);
    runtime.block_on(checkpoints::settle(service, claim.job));
    device_is_sound
}

enum Ending {
    Done(JobState, Box<Rendered>),
    Failed(Failure),
    PutBack { counted: bool, why: String },
    Dropped,
}

/// Renders; everything that can go wrong on the way is a [`Failure`].
fn attempt(
    service: &Arc<Service>,
    runtime: &Handle,
    device: &mut dyn Device,
    job: &Job,
    watcher: &mut Watcher,
) -> Result<Rendered, Failure> {
    let stored = runtime.block_on(async {
        let record = service.store.scene(&job.scene).await.map_err(|e| e.to_string())?;
        let record = record.ok_or_else(|| format!("scene {} is not there any more", job.scene))?;
        let bytes = service.artifacts.scene(&job.scene).await.map_err(|e| e.to_string())?;
        Ok::<_, String>((record.format, bytes))
    });
    let (format, bytes) =
        stored.map_err(|detail| Failure { retry: true, ..Failure::new("storage", detail) })?;
    let scene = scenes::load(format, &bytes, service.config.max_triangles)
        .map_err(|refusal| Failure::new("scene", refusal.to_string()))?;
    drop(bytes);
    let (begin, trouble) = runtime.block_on(checkpoints::begin(service, job));
    watcher.beginning = trouble.map(begins_afresh);
    let mut request = RenderRequest {
        scene: Arc::new(scene),
        camera: camera(job.request.camera.as_ref()),
        width: job.request.width,
        height: job.request.height,
        method: job.request.method.clone(),
        limits: limits(job, service.config.max_seconds),
        seed: job.request.seed,
        options: job.request.options.iter().map(|(k, v)| (k.clone(), v.to_string())).collect(),
        begin,
    };
    let mut rendered = render(device, &request, watcher);
    if let Err(RenderError::Checkpoint(error)) = &rendered {
        tracing::warn!(job = %job.id, %error, "begins afresh");
        watcher.beginning = Some(begins_afresh(error.to_string()));
        request.begin = Begin::Afresh;
        rendered = render(device, &request, watcher);
    }
    rendered.map_err(|error| match error {
        RenderError::Parameter { parameter, what } => {
            Failure::new("parameter", format!("{parameter}: {what}"))
        }
        RenderError::Device(error) => {
            let lost = matches!(error, DeviceError::Lost { .. });
            let failure = Failure::new("device", error.to_string());
            Failure { retry: lost, device_is_sound: !lost, ..failure }
        }
        RenderError::Checkpoint(error) => Failure::new("checkpoint", error.to_string()),
    })
}

/// Says that a job does not begin with what it should.
fn begins_afresh(why: String) -> api::Warning {
    let what = format!("what was kept of it cannot be used, so the job began afresh: {why}");
    api::Warning { at: "job".into(), what }
}

fn camera(request: Option<&CameraRequest>) -> CameraChoice {
    match request {
        None => CameraChoice::First,
        Some(CameraRequest::Index(index)) => CameraChoice::Index(*index),
        Some(CameraRequest::Name(name)) => CameraChoice::Name(name.clone()),
        Some(CameraRequest::Explicit(camera)) => {
            let api::jobs::ExplicitCamera { eye, target, up, yfov_degrees } = *camera;
            CameraChoice::Explicit(ExplicitCamera { eye, target, up, yfov_degrees })
        }
    }
}

/// The job's limits. One that names only iterations or an accuracy it may never reach still ends:
/// after the longest time budget of the server.
fn limits(job: &Job, max_seconds: f64) -> Limits {
    let request = &job.request;
    let names_another = request.max_iterations.is_some() || request.target_error.is_some();
    let default =
        if names_another { max_seconds } else { Limits::DEFAULT_SECONDS.min(max_seconds) };
    Limits {
        seconds: Some(request.time_budget_s.unwrap_or(default)),
        iterations: request.max_iterations,
        target_error: request.target_error,
    }
}

/// Pause before the next try at storing something: doubles from a second to this.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// Tries at storing the picture before the job fails; about two minutes.
const PICTURE_TRIES: u32 = 8;

/// What is to be stored about the end of an attempt.
enum Record {
    /// The files of the picture first, then the rest.
    Picture {
        state: JobState,
        picture: Arc<image::Picture>,
        stats: Box<Stats>,
    },
    Outcome(Box<Outcome>),
    Release {
        counted: bool,
        why: String,
    },
}

/// Stores how the attempt ended, trying again where the storage does not answer: the work is
/// done, and a passing trouble should not waste it. It gives up where the service shuts down; the
/// job then goes back to the queue.
fn record(
    service: &Arc<Service>,
    runtime: &Handle,
    claim: Claim,
    ending: Ending,
    latest: Option<api::jobs::Progress>,
    started: Instant,
) {
    let mut record = match ending {
        Ending::Done(state, rendered) => {
            let Rendered { picture, stats } = *rendered;
            Record::Picture { state, picture: Arc::new(picture), stats: Box::new(stats) }
        }
        Ending::Failed(failure) => {
            Record::Outcome(Box::new(failed(failure.code, failure.detail, latest.clone())))
        }
        Ending::PutBack { counted, why } => Record::Release { counted, why },
        Ending::Dropped => {
            tracing::info!(job = %claim.job, "was taken away");
            runtime.block_on(remove_if_deleted(service, claim));
            return;
        }
    };
    runtime.block_on(async {
        let mut pause = Duration::from_secs(1);
        let mut picture_tries = 0;
        loop {
            if let Record::Picture { state, picture, stats } = &record {
                let formats = vec![PictureFormat::Png, PictureFormat::Exr];
                picture_tries += 1;
                match keep_picture(service, claim, picture.clone(), formats).await {
                    Ok(pictures) => {
                        let stats = to_stats(stats, started.elapsed().as_secs_f64());
                        let progress = Some(final_progress(&stats));
                        let (state, stats) = (*state, Some(stats));
                        let outcome = Outcome { state, stats, pictures, error: None, progress };
                        record = Record::Outcome(Box::new(outcome));
                    }
                    Err(error) => {
                        tracing::error!(job = %claim.job, %error, "cannot keep the picture");
                        // Only the storage may do better next time.
                        if picture_tries >= PICTURE_TRIES || !error.is::<ArtifactError>() {
                            let detail = format!("the picture could not be kept: {error}");
                            let outcome = failed("storage", detail, latest.clone());
                            record = Record::Outcome(Box::new(outcome));
                        }
                    }
                }
            }
            match write(service, claim, &record).await {
                Some(Ok(())) => return ended(service, claim, &record, started),
                Some(Err(StoreError::ClaimLost(_))) => {
                    tracing::warn!(job = %claim.job, "was taken away before it could be recorded");
                    return remove_if_deleted(service, claim).await;
                }
                Some(Err(error)) => {
                    tracing::error!(job = %claim.job, %error, "cannot record the end");
                }
                None => {}
            }
            tokio::select! {
                () = tokio::time::sleep(pause) => pause = (pause * 2).min(LONGEST_PAUSE),
                () = service.shutdown.cancelled() => {
                    tracing::error!(job = %claim.job, "shuts down before the end was recorded");
                    return;
                }
            }
        }
    });
}

/// Writes what needs no more files; `None` where the picture is still to be kept.
async fn write(service: &Service, claim: Claim, record: &Record) -> Option<Result<(), StoreError>> {
    match record {
        Record::Picture { .. } => None,
        Record::Outcome(outcome) => Some(service.store.finish(claim, (**outcome).clone()).await),
        Record::Release { counted, why } => Some(service.store.release(claim, *counted, why).await),
    }
}

/// Logs and counts an end that is recorded.
fn ended(service: &Service, claim: Claim, record: &Record, started: Instant) {
    match record {
        Record::Outcome(outcome) => {
            let (iterations, shots) =
                outcome.progress.as_ref().map_or((0, 0), |p| (p.iterations, p.shots));
            let seconds = started.elapsed().as_secs_f64();
            tracing::info!(job = %claim.job, state = outcome.state.as_str(), seconds, iterations, "ended");
            service.metrics.count_job(outcome.state, seconds, iterations, shots);
        }
        Record::Release { why, .. } => {
            tracing::info!(job = %claim.job, why, "went back to the queue");
        }
        Record::Picture { .. } => {}
    }
}

/// Removes the files that this attempt may have written after its job was deleted.
async fn remove_if_deleted(service: &Service, claim: Claim) {
    let removed = match service.store.job(claim.job).await {
        Ok(None) => service.artifacts.remove_job(claim.job).await,
        _ => Ok(()),
    };
    if let Err(error) = removed {
        tracing::warn!(job = %claim.job, %error, "cannot remove files");
    }
}

fn failed(code: &str, detail: String, progress: Option<api::jobs::Progress>) -> Outcome {
    let error = Some(JobError { code: code.into(), detail });
    Outcome { state: JobState::Failed, stats: None, pictures: Vec::new(), error, progress }
}

fn to_stats(stats: &Stats, seconds_total: f64) -> api::jobs::Stats {
    let finite = |x: f64| if x.is_finite() { x } else { 0.0 };
    let stopped = serde_json::to_value(stats.stopped).ok();
    api::jobs::Stats {
        method: stats.method.clone(),
        stopped: stopped.and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default(),
        iterations: stats.iterations,
        shots: stats.shots,
        light_source_selection_ratio: finite(stats.light_source_selection_ratio),
        estimated_error: stats.estimated_error.filter(|error| error.is_finite()),
        seconds_solve: finite(stats.seconds_solve),
        seconds_total,
        patches: stats.patches,
        triangles: stats.triangles,
        diagnostics: stats.diagnostics.iter().map(|(k, v)| (k.clone(), finite(*v))).collect(),
    }
}

fn final_progress(stats: &api::jobs::Stats) -> api::jobs::Progress {
    api::jobs::Progress {
        iterations: stats.iterations,
        shots: stats.shots,
        light_source_selection_ratio: stats.light_source_selection_ratio,
        estimated_error: stats.estimated_error,
        seconds: stats.seconds_solve,
        seconds_remaining: Some(0.0),
        fraction: 1.0,
    }
}
