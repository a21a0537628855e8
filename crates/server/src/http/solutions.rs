//! What can be made of a job that has ended: more of the same, other pictures, its record, its
//! light.

use super::app::App;
use super::documented;
use super::file::{self, Content, FileRequest};
use super::jobs::{
    answer, check, check_memory, check_priority, check_stored, find, idempotency_key,
    own_queue_full, submitter,
};
use super::problem::Problem;
use super::read::{self, JobId, MAX_JSON_BYTES, media_type};
use super::upload;
use crate::access::Caller;
use crate::api::FieldError;
use crate::api::jobs::{Job, JobRequest};
use crate::api::request_hash::RequestHash;
use crate::api::solutions::{Begins, ExtendRequest, Manifest, Solution, ViewRequest};
use crate::store::solutions::Extended;
use crate::store::{Accepted, NewJob};
use crate::trace_context::TraceParent;
use crate::worker;
use axum::Json;
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::de::DeserializeOwned;
use uuid::Uuid;

/// Tries at a solution that is replaced while it is copied.
const TRIES: u32 = 3;

/// Give an ended job more budget.
///
/// The job goes back to the queue and on from where it was, under the same id; its events go on,
/// too. It must have succeeded or been cancelled, or have failed while it was extended, and its
/// solution must be kept. Its result stays until there is a better one: an extension that fails
/// changes nothing about it, and one that is cancelled replaces it only by a picture of at least as
/// many iterations.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/extend", tag = "jobs", params(documented::OfJob),
    request_body = ExtendRequest,
    responses((status = 202, description = "Queued again.", body = Job), documented::SentToEnded)
)]
pub async fn extend_job(
    State(app): State<App>,
    caller: Caller,
    JobId(id): JobId,
    request: Request,
) -> Result<Response, Problem> {
    let extension: ExtendRequest = body(request).await?;
    let job = find(&app, id).await?;
    let solution = own_solution(&app, &job).await?;
    let mut request = extension.apply(&worker::without_idle_settings(job.request.clone()));
    // Who must not ask for a priority does not get that of the job a second time.
    if check_priority(&caller, &request).is_err() {
        request.priority = 0;
    }
    // Only requests from outside may not say what they are a view of; and who is told was checked
    // when the job was accepted.
    check(&app, &JobRequest { view_of: None, webhook: None, ..request.clone() })?;
    refuse_less(&extension, &solution, job.figures.estimated_error)?;
    check_stored(&app, &caller).await?;
    let own = caller.limits.jobs_queued;
    match app.shared.store.extend(id, &request, app.shared.config.max_queued, own).await? {
        Extended::Queued(job) => {
            app.shared.queue.wake();
            app.shared.bell.ring(id);
            Ok((StatusCode::ACCEPTED, Json(*job)).into_response())
        }
        Extended::Missing => Err(Problem::not_found("there is no such job")),
        Extended::NotNow(job) => Err(Problem::not_now(format!(
            "the job is {}; only one that succeeded, was cancelled, or failed while it was extended can be extended",
            job.state.as_str()
        ))),
        Extended::QueueFull => {
            app.shared.metrics.count_refusal("queue");
            Err(Problem::queue_full(5))
        }
        Extended::OwnQueueFull => Err(own_queue_full(&app, &caller)),
    }
}

/// Take another picture of a scene that a job has solved.
///
/// The new job begins with what that job found out about the light of the scene and keeps its own
/// copy: either may be deleted.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/views", tag = "jobs",
    params(
        documented::OfJob,
        ("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, pattern = "^[!-~]+$", description = "Makes repeating the request safe."),
    ),
    request_body = ViewRequest,
    responses(
        (status = 202, description = "Accepted; `request.view_of` names the job that it begins with.", body = Job, headers(("location" = String, description = "The job's path."))),
        documented::SentToEnded,
    )
)]
pub async fn create_view(
    State(app): State<App>,
    caller: Caller,
    JobId(id): JobId,
    request: Request,
) -> Result<Response, Problem> {
    let trace_parent = request.extensions().get::<TraceParent>().map(|p| p.as_str().to_owned());
    let idempotency_key = idempotency_key(request.headers())?;
    let view: ViewRequest = body(request).await?;
    let job = find(&app, id).await?;
    let mut request = view.apply(&worker::without_idle_settings(job.request.clone()));
    check(&app, &request)?;
    let scene = app.shared.store.scene(&job.scene).await?;
    let scene = scene.ok_or_else(|| Problem::not_found("the scene was removed; send it again"))?;
    if let Some(detail) = request.camera_problem(&scene.cameras) {
        return Err(Problem::invalid(vec![FieldError::new("camera", detail)]));
    }
    let map = match request.environment_map() {
        Some(id) => app.shared.store.environment(id).await?,
        None => None,
    };
    check_memory(&app, &request, &scene, map.as_ref())?;
    check_priority(&caller, &request)?;
    request.view_of = Some(id);
    let request_hash =
        RequestHash::of(&request).map_err(|error| Problem::internal(error.to_string()))?;
    let new = NewJob {
        id: Uuid::now_v7(),
        scene_id: job.scene.clone(),
        request,
        idempotency_key,
        request_hash,
        submitter: submitter(&caller, trace_parent),
        // What it shows depends on what it begins with.
        render_key: None,
    };
    let new_id = new.id;
    // Its file is there before its record is.
    let held = app.keeper.hold_files().await;
    let solution = share(&app, &job, new_id).await?;
    let accepted_as =
        app.shared.store.accept_view(new, &solution, app.shared.config.max_queued).await;
    if !matches!(accepted_as, Ok(Accepted::New(_))) {
        app.shared.artifacts.remove_job(new_id).await?;
    }
    drop(held);
    answer(&app, &caller, accepted_as?)
}

/// The record of a result: hashes, parameters, seed, versions, device, timings.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/manifest", tag = "results", params(documented::OfJob),
    responses((status = 200, description = "The manifest.", body = Manifest), documented::Named, documented::NotNow)
)]
pub async fn manifest(State(app): State<App>, JobId(id): JobId) -> Result<Json<Manifest>, Problem> {
    let job = find(&app, id).await?;
    if !job.state.is_terminal() {
        return Err(Problem::not_now("the job has not ended yet"));
    }
    let scene = app.shared.store.scene(&job.scene).await?.map(|scene| (scene.format, scene.size));
    let solution = kept_solution(&app, &job).await?;
    Ok(Json(Manifest::new(job, scene, solution)))
}

/// The light baked onto the geometry, GLB.
///
/// One unlit mesh with the radiance of every patch as linear vertex colours, in shares of
/// `asset.extras.radiance_of_white`. For methods with patches, where the solution is kept.
#[utoipa::path(
    get,
    path = "/v1/jobs/{id}/solution.glb",
    tag = "results",
    params(documented::OfJob, documented::RangeHeader),
    responses(documented::GlbFile)
)]
pub async fn solution_glb(
    State(app): State<App>,
    JobId(id): JobId,
    asked: FileRequest,
) -> Result<Response, Problem> {
    let job = find(&app, id).await?;
    let baked = kept_solution(&app, &job).await?.and_then(|solution| solution.baked);
    let baked = baked.ok_or_else(|| {
        Problem::not_found(
            "no light of surfaces is kept of this job: it has not ended, its method has no patches, or --keep-solutions-mb does not allow it",
        )
    })?;
    let (sha256, media_type) = (&baked.sha256, "model/gltf-binary");
    let open = app.shared.artifacts.open_kept(id, &baked);
    file::answer(&asked, Content { sha256, media_type, cache: "no-cache" }, open).await
}

async fn body<T: DeserializeOwned>(request: Request) -> Result<T, Problem> {
    match media_type(request.headers()).as_str() {
        "application/json" => {}
        other => {
            let detail = format!("send application/json, not {other:?}");
            return Err(Problem::unsupported_media(detail));
        }
    }
    let too_large =
        || Problem::too_large(format!("a request may have at most {MAX_JSON_BYTES} bytes"));
    read::json(&upload::small_body(request.into_body(), MAX_JSON_BYTES, too_large).await?)
}

/// What is kept of a job. What is not to be kept may still be in the store for a moment after the
/// end.
async fn kept_solution(app: &App, job: &Job) -> Result<Option<Solution>, Problem> {
    let is_kept = app.shared.config.keep_solutions_mb > 0 || !job.state.is_terminal();
    Ok(app.shared.store.solution(job.id).await?.filter(|_| is_kept))
}

/// A job's own solution.
async fn own_solution(app: &App, job: &Job) -> Result<Solution, Problem> {
    let solution = kept_solution(app, job).await?;
    if let (None, Some(twin)) = (&solution, job.result_of) {
        let detail =
            format!("the job shares the result of the identical job {twin}; name that one");
        return Err(Problem::not_now(detail));
    }
    solution.filter(|solution| solution.begins == Begins::Continue).ok_or_else(|| {
        Problem::not_now(format!(
            "nothing is kept of this job to go on from: it is {}, and solutions are kept of jobs that did some work, up to {} MiB (--keep-solutions-mb)",
            job.state.as_str(),
            app.shared.config.keep_solutions_mb
        ))
    })
}

/// Copies a job's solution for another job.
async fn share(app: &App, job: &Job, to: Uuid) -> Result<Solution, Problem> {
    for attempt in 1.. {
        let solution = own_solution(app, job).await?;
        match app.shared.artifacts.share_kept(job.id, &solution.file, to).await {
            Ok(()) => return Ok(Solution { begins: Begins::View, baked: None, ..solution }),
            // A running job has just replaced it.
            Err(error) if error.is_not_found() && attempt < TRIES => {}
            Err(error) => return Err(error.into()),
        }
    }
    unreachable!("the last try returns")
}

/// Refuses limits that the job is beyond already.
fn refuse_less(
    extension: &ExtendRequest,
    solution: &Solution,
    estimated_error: Option<f64>,
) -> Result<(), Problem> {
    let ExtendRequest { target_error, time_budget_s, max_iterations } = *extension;
    let mut errors = Vec::new();
    if target_error.is_none() && time_budget_s.is_none() && max_iterations.is_none() {
        let rule = "name time_budget_s, max_iterations or target_error";
        errors.push(FieldError::new("time_budget_s", rule));
    }
    if let Some(seconds) = time_budget_s
        && seconds <= solution.seconds
    {
        let used = solution.seconds;
        let detail = format!("must be above the {used:.3} s that the job has used, is {seconds}");
        errors.push(FieldError::new("time_budget_s", detail));
    }
    if let Some(iterations) = max_iterations
        && iterations <= solution.iterations
    {
        let done = solution.iterations;
        let detail = format!("must be above the {done} iterations that are done, is {iterations}");
        errors.push(FieldError::new("max_iterations", detail));
    }
    if let (Some(target), Some(error)) = (target_error, estimated_error)
        && target >= error
    {
        let detail = format!("must be below the {error:.5} that is reached, is {target}");
        errors.push(FieldError::new("target_error", detail));
    }
    if errors.is_empty() { Ok(()) } else { Err(Problem::invalid(errors)) }
}
