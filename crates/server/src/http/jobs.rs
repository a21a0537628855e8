//! `/v1/jobs`.

use super::app::App;
use super::documented;
use super::problem::Problem;
use super::read::{self, JobId, MAX_JSON_BYTES, Query, in_range, media_type};
use super::{kept, upload};
use crate::access::Caller;
use crate::api::FieldError;
use crate::api::environments::EnvironmentMap;
use crate::api::jobs::{CameraRequest, Job, JobPage, JobRequest};
use crate::api::keys::Scope;
use crate::api::request_hash::RequestHash;
use crate::api::scenes::Scene;
use crate::api::webhooks::host_and_port;
use crate::builtin;
use crate::hash::sha256_hex;
use crate::job_state::JobState;
use crate::networks::may_receive;
use crate::store::{Accepted, JobFilter, NewJob, Submitter};
use crate::trace_context::TraceParent;
use crate::worker;
use axum::Json;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use std::time::Duration;
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// How long a waiting request trusts that no news is no news.
const RECHECK: Duration = Duration::from_secs(10);

/// Memory of a job for each texel of the map that is its sky: the map as it is read and as it is
/// kept, and what light is sampled by.
const BYTES_OF_A_TEXEL: u64 = 48;

/// A job and its scene in one request.
#[derive(ToSchema)]
#[allow(dead_code, reason = "stands for the request in the API's description")]
pub struct JobWithScene {
    /// A JobRequest as JSON, without `scene`.
    #[schema(value_type = String, content_media_type = "application/json", example = r#"{"width": 64, "height": 64, "time_budget_s": 1}"#)]
    job: String,
    /// The .gltf or .glb file, or a .zip with it. Further parts are its resources, named by the relative URIs that
    /// the scene uses.
    #[schema(value_type = String, format = Binary, content_media_type = "application/octet-stream")]
    scene: Vec<u8>,
}

/// Ask for a picture.
///
/// The answer comes as soon as the job is safely stored; it survives a restart of the server.
/// Under an `Idempotency-Key`, sending the same request again answers with the same job.
#[utoipa::path(
    post, path = "/v1/jobs", tag = "jobs",
    params(("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, pattern = "^[!-~]+$", description = "Makes repeating the request safe.")),
    request_body(
        description = "The job; in a multipart form with its scene.",
        content((JobRequest = "application/json"), (JobWithScene = "multipart/form-data"))
    ),
    responses(
        (status = 202, description = "Accepted.", body = Job, headers(("location" = String, description = "The job's path."))),
        documented::Sent,
        documented::NotFound,
        documented::Conflict,
    )
)]
pub async fn create_job(
    State(app): State<App>,
    caller: Caller,
    request: Request,
) -> Result<Response, Problem> {
    let trace_parent = request.extensions().get::<TraceParent>().map(|p| p.as_str().to_owned());
    let idempotency_key = idempotency_key(request.headers())?;
    let (mut job, scene) = arrived(&app, &caller, request, idempotency_key.is_some()).await?;
    if let Some(detail) = job.camera_problem(&scene.cameras) {
        return Err(Problem::invalid(vec![FieldError::new("camera", detail)]));
    }
    if let Some(detail) = job.variant_problem(scene.variants.as_deref()) {
        return Err(Problem::invalid(vec![FieldError::new("variant", detail)]));
    }
    if let Some((field, detail)) = job.part_problem(&scene) {
        return Err(Problem::invalid(vec![FieldError::new(field, detail)]));
    }
    let map = named_map(&app, &caller, &job).await?;
    check_memory(&app, &job, &scene, map.as_ref())?;
    job.scene = Some(scene.id.clone());
    let webhook = job.webhook.clone().or_else(|| caller.key().and_then(|key| key.webhook.clone()));
    let unserialisable = |error: serde_json::Error| Problem::internal(error.to_string());
    let request_hash = RequestHash::of(&job).map_err(unserialisable)?;
    let render_key = render_key(caller.owner(), &job, &scene).map_err(unserialisable)?;
    let new = NewJob {
        id: Uuid::now_v7(),
        scene_id: scene.id,
        request: job,
        idempotency_key,
        request_hash,
        submitter: Submitter { webhook, ..submitter(&caller, trace_parent) },
        render_key,
    };
    answer(&app, &caller, app.shared.store.accept(new, app.shared.config.max_queued).await?)
}

/// What a request brings: a job, and its scene, stored. One that `is_repeatable` may be the
/// repetition of one that was accepted, which no quota refuses.
async fn arrived(
    app: &App,
    caller: &Caller,
    request: Request,
    is_repeatable: bool,
) -> Result<(JobRequest, Scene), Problem> {
    match media_type(request.headers()).as_str() {
        "application/json" => {
            let too_large =
                || Problem::too_large(format!("a job may have at most {MAX_JSON_BYTES} bytes"));
            let body = request.into_body();
            let body = upload::small_body(body, MAX_JSON_BYTES, too_large).await?;
            let job: JobRequest = read::json(&body)?;
            check_new(app, &job)?;
            check_priority(caller, &job)?;
            let scene = named_scene(app, caller, &job).await?;
            Ok((job, scene))
        }
        "multipart/form-data" => {
            let mut parts = upload::parts(app, caller, request, true).await?;
            let job: JobRequest = match parts.job.take() {
                Some(json) => read::json_part("job", &json)?,
                None => read::json(b"{}")?,
            };
            check_new(app, &job)?;
            check_priority(caller, &job)?;
            if !is_repeatable {
                // Its scene would be kept, and the job refused.
                check_stored(app, caller).await?;
            }
            let scene = match (parts.has_scene(), &job.scene) {
                (true, None) => {
                    let name = parts.scene_name.take();
                    let (scene, _) = parts.store(app, caller).await?;
                    kept::named(app, caller, scene, name).await?
                }
                (false, _) => named_scene(app, caller, &job).await?,
                (true, Some(_)) => {
                    let twice = "given both as a part and by id";
                    return Err(Problem::invalid(vec![FieldError::new("scene", twice)]));
                }
            };
            Ok((job, scene))
        }
        other => {
            let detail = format!("send application/json or multipart/form-data, not {other:?}");
            Err(Problem::unsupported_media(detail))
        }
    }
}

/// Who submits a job, told by the webhook of the key.
pub fn submitter(caller: &Caller, trace_parent: Option<String>) -> Submitter {
    Submitter {
        owner: caller.owner().to_owned(),
        billed_to: caller.billed_to().to_owned(),
        max_queued: caller.limits.jobs_queued,
        max_running: caller.limits.jobs_running,
        max_stored: caller.limits.stored_bytes,
        webhook: caller.key().and_then(|key| key.webhook.clone()),
        trace_parent,
    }
}

/// The answer to who submitted a job.
pub fn answer(app: &App, caller: &Caller, accepted_as: Accepted) -> Result<Response, Problem> {
    match accepted_as {
        Accepted::New(job) => {
            app.shared.queue.wake();
            app.shared.bell.ring(job.id);
            Ok(accepted(*job, false))
        }
        Accepted::Again(job) => Ok(accepted(*job, true)),
        Accepted::KeyConflict => Err(Problem::key_conflict(
            "this Idempotency-Key was used for another request; use a new key for a new job",
        )),
        Accepted::QueueFull => {
            app.shared.metrics.count_refusal("queue");
            Err(Problem::queue_full(5))
        }
        Accepted::OwnQueueFull => Err(own_queue_full(app, caller)),
        Accepted::StoreFull { stored } => Err(store_full(app, caller, stored)),
        Accepted::SceneGone => Err(Problem::not_found("the scene was removed; send it again")),
        Accepted::EnvironmentGone => {
            Err(Problem::not_found("the environment was removed; send it again"))
        }
    }
}

/// The answer to who has as many jobs waiting as they may.
pub fn own_queue_full(app: &App, caller: &Caller) -> Problem {
    app.shared.metrics.count_refusal("jobs_queued");
    let most = caller.limits.jobs_queued.unwrap_or(0);
    let detail = format!("{most} jobs of this caller wait already, which is its limit");
    Problem::over_limit("jobs_queued", detail, 5.0)
}

/// Hash of all that a job's picture depends on, where that determines it: only jobs that end by
/// their iterations, since a time budget makes the picture depend on what else the machine does,
/// and that ask for no snapshots, since who does wants to see it happen. Nobody shares the jobs of
/// another owner: the event that says so names them. Jobs that say the same in other words, or
/// leave out what is the default, have the same key.
fn render_key(
    owner: &str,
    job: &JobRequest,
    stored: &Scene,
) -> Result<Option<String>, serde_json::Error> {
    let determined = job.max_iterations.is_some() && job.time_budget_s.is_none();
    if job.fresh || !determined || job.snapshots.is_some() {
        return Ok(None);
    }
    let Some(settings) = worker::settings_in_force(job) else { return Ok(None) };
    let cameras = &stored.cameras;
    let position = |name: &str| cameras.iter().position(|camera| camera.name == name);
    let camera = match &job.camera {
        // The cameras that are known are those of the file's default scene.
        other if job.gltf_scene.is_some() => other.clone(),
        None if !cameras.is_empty() => Some(CameraRequest::Index(0)),
        Some(CameraRequest::Name(name)) => {
            position(name).map(|index| CameraRequest::Index(index as u32))
        }
        other => other.clone(),
    };
    // Everything else travels with the job but does not show in the picture.
    let JobRequest { scene, variant, environment, background, units, method, .. } = job;
    let limits = (job.target_error, job.max_iterations);
    let size = (job.width, job.height);
    let shown =
        ((scene, variant, job.shown_parts(stored)), environment, camera, size, (background, units));
    let asked = (shown, method, limits, job.seed, settings);
    let whole = serde_json::to_vec(&(env!("CARGO_PKG_VERSION"), owner, asked))?;
    Ok(Some(sha256_hex(&whole)))
}

/// The answer to a job that is accepted.
fn accepted(job: Job, again: bool) -> Response {
    let location = [(header::LOCATION, format!("/v1/jobs/{}", job.id))];
    let mut response = (StatusCode::ACCEPTED, location, Json(job)).into_response();
    if again {
        let value = header::HeaderValue::from_static("true");
        response.headers_mut().insert("idempotency-replayed", value);
    }
    response
}

/// The key under which repeating a request is safe.
pub fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(key) = headers.get("idempotency-key") else { return Ok(None) };
    let key = key.to_str().unwrap_or("");
    if key.is_empty() || key.len() > 255 || !key.bytes().all(|byte| byte.is_ascii_graphic()) {
        let rule = "must be 1 to 255 visible ASCII characters";
        return Err(Problem::unreadable(format!("Idempotency-Key {rule}"))
            .with_error(FieldError::new("Idempotency-Key", rule)));
    }
    Ok(Some(key.to_owned()))
}

/// Refuses a place before the jobs of others to who may not have one.
pub fn check_priority(caller: &Caller, job: &JobRequest) -> Result<(), Problem> {
    if job.priority <= 0 || caller.may(Scope::Priority) {
        return Ok(());
    }
    let detail = format!(
        "the key lacks the scope {:?}, which a priority above 0 needs; leave the priority out",
        Scope::Priority.as_str()
    );
    Err(Problem::insufficient_scope(detail).with_error(FieldError::new("priority", "at most 0")))
}

/// Refuses what the server or the engine would not do, of a job that is new: its settings are of
/// the types and for the methods that the API says.
fn check_new(app: &App, job: &JobRequest) -> Result<(), Problem> {
    refuse(app, job, worker::method_problems(job))
}

/// Refuses what the server or the engine would not do, of a job that begins with another's request.
pub fn check(app: &App, job: &JobRequest) -> Result<(), Problem> {
    refuse(app, job, Vec::new())
}

/// Refuses a job for these problems of its method's, for more of the server's own, or else for the
/// first of the engine's.
fn refuse(app: &App, job: &JobRequest, of_method: Vec<FieldError>) -> Result<(), Problem> {
    let mut errors = job.problems(&app.shared.config.job_limits());
    errors.extend(webhook_problem(app, job));
    let of_method =
        of_method.into_iter().filter(|error| errors.iter().all(|e| e.field != error.field));
    let of_method: Vec<_> = of_method.collect();
    errors.extend(of_method);
    if errors.is_empty() {
        errors.extend(worker::request_problem(job));
    }
    if errors.is_empty() { Ok(()) } else { Err(Problem::invalid(errors)) }
}

/// Why a message could never be sent: the webhook's URL has an address in it, not a name, and
/// messages may not go there.
fn webhook_problem(app: &App, job: &JobRequest) -> Option<FieldError> {
    let (host, _) = host_and_port(&job.webhook.as_ref()?.url)?;
    let address = host.parse().ok()?;
    let rule =
        "must not be an address inside a network, unless --webhook-allow of the server names it";
    (!may_receive(address, &app.shared.config.guard.webhook_allow))
        .then(|| FieldError::new("webhook.url", rule))
}

/// Refuses a job that could never fit into this server's memory, rather than to let it fail.
pub fn check_memory(
    app: &App,
    job: &JobRequest,
    scene: &Scene,
    map: Option<&EnvironmentMap>,
) -> Result<(), Problem> {
    let kept = scene.kept_triangles.unwrap_or(scene.triangles);
    let needed = worker::needed_bytes(job, [scene.triangles, kept]);
    let Some((needed, most)) = needed.zip(app.max_job_bytes) else { return Ok(()) };
    let of_map =
        map.map_or(0, |map| BYTES_OF_A_TEXEL * u64::from(map.width) * u64::from(map.height));
    let needed = needed.saturating_add(of_map);
    if needed <= most {
        return Ok(());
    }
    app.shared.metrics.count_refusal("memory");
    let (needed, most) = (needed >> 20, most >> 20);
    let detail = format!(
        "{} needs about {needed} MiB for this scene and picture, and jobs may have {most} MiB; ask for a smaller picture, a simpler scene or another method",
        job.method
    );
    Err(Problem::too_much_memory(detail))
}

/// Refuses a job of a caller whose pictures and solutions have as many bytes as they may. What is
/// queued or runs at that time is still done: then the limit is exceeded by its final pictures.
pub async fn check_stored(app: &App, caller: &Caller) -> Result<(), Problem> {
    let Some(most) = caller.limits.stored_bytes else { return Ok(()) };
    let stored = app.shared.store.payer_bytes(caller.billed_to()).await?;
    if stored < most { Ok(()) } else { Err(store_full(app, caller, stored)) }
}

/// The answer to who has so many bytes stored, which is as many as they may.
fn store_full(app: &App, caller: &Caller, stored: u64) -> Problem {
    app.shared.metrics.count_refusal("stored_bytes");
    let most = caller.limits.stored_bytes.unwrap_or(0);
    let detail = format!(
        "the pictures and solutions of this caller have {stored} bytes and may have {most}; delete jobs first"
    );
    Problem::over_limit("stored_bytes", detail, 600.0)
}

/// The scene that a job names: a stored one, or a built-in one, which is stored on first use.
async fn named_scene(app: &App, caller: &Caller, job: &JobRequest) -> Result<Scene, Problem> {
    let Some(name) = &job.scene else {
        let rule = "required: the id of a stored scene, or the name of a built-in one";
        return Err(Problem::invalid(vec![FieldError::new("scene", rule)]));
    };
    if let Some(bytes) = builtin::scene(name) {
        return upload::store_builtin(app, caller, sha256_hex(bytes), bytes).await;
    }
    let found = app.shared.store.shown_scene(name, caller.viewer()).await?;
    found.ok_or_else(|| {
        let detail = format!(
            "no stored scene has this id; POST it to /v1/scenes first, or name one of {:?}",
            builtin::names()
        );
        Problem::not_found(detail.clone()).with_error(FieldError::new("scene", detail))
    })
}

/// The stored map that a job names as its sky, if it does.
async fn named_map(
    app: &App,
    caller: &Caller,
    job: &JobRequest,
) -> Result<Option<EnvironmentMap>, Problem> {
    let Some(id) = job.environment_map() else { return Ok(None) };
    let found = app.shared.store.shown_environment(id, caller.viewer()).await?;
    found.map(Some).ok_or_else(|| {
        let detail = "no stored environment has this id; POST it to /v1/environments first";
        Problem::not_found(detail).with_error(FieldError::new("environment.sky", detail))
    })
}

/// Which jobs to list.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct ListQuery {
    /// How many, at most.
    #[param(minimum = 1, maximum = 200, default = 50)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    #[param(value_type = Option<Uuid>)]
    cursor: Option<String>,
    /// Only jobs in this state.
    #[param(inline)]
    state: Option<JobState>,
    /// Only jobs with this label, `key:value`.
    #[param(pattern = "^[^:]+:", example = "project:atrium")]
    label: Option<String>,
}

/// List jobs, newest first.
#[utoipa::path(
    get, path = "/v1/jobs", tag = "jobs", params(ListQuery),
    responses((status = 200, description = "One page of jobs.", body = JobPage), documented::BadRequest)
)]
pub async fn list_jobs(
    State(app): State<App>,
    caller: Caller,
    Query(query): Query<ListQuery>,
) -> Result<Json<JobPage>, Problem> {
    let limit = in_range("limit", query.limit.unwrap_or(50), 1..=200)?;
    let label = match query.label.as_deref().map(|label| label.split_once(':')) {
        None => None,
        Some(Some((key, value))) if !key.is_empty() => Some((key.to_owned(), value.to_owned())),
        Some(_) => return Err(Problem::unreadable("label must read key:value")),
    };
    let before = query.cursor.map(|cursor| cursor.parse::<Uuid>()).transpose();
    let before = before.map_err(|_| Problem::unreadable("cursor must be a next_cursor"))?;
    let owner = (!caller.sees_all()).then(|| caller.owner().to_owned());
    let filter = JobFilter { state: query.state, label, before, owner, limit: limit + 1 };
    let mut jobs = app.shared.store.jobs(&filter).await?;
    let more = jobs.len() > limit as usize;
    jobs.truncate(limit as usize);
    let next_cursor = jobs.last().filter(|_| more).map(|job| job.id.to_string());
    Ok(Json(JobPage { jobs, next_cursor }))
}

/// How long to wait.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct WaitQuery {
    /// Answer when the job has ended, or after so many seconds.
    #[param(minimum = 0.0, maximum = 60.0)]
    wait: Option<f64>,
    /// What to wait for: the job's end, which is the default, or any change of its state.
    #[param(inline)]
    until: Option<Until>,
}

/// What a request with `wait` waits for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Until {
    /// The job has ended.
    #[default]
    End,
    /// The job's state is another than when the request came, or the job has ended.
    Change,
}

/// Get a job.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs", params(documented::OfJob, WaitQuery),
    responses((status = 200, description = "The job.", body = Job), documented::Named)
)]
pub async fn get_job(
    State(app): State<App>,
    caller: Caller,
    JobId(id): JobId,
    Query(query): Query<WaitQuery>,
) -> Result<Json<Job>, Problem> {
    let wait = in_range("wait", query.wait.unwrap_or(0.0), 0.0..=60.0)?;
    let deadline = tokio::time::Instant::now() + Duration::from_secs_f64(wait);
    let until = query.until.unwrap_or_default();
    let mut listener = app.shared.bell.listen(id);
    let mut key_end = app.key_watch.of(&caller);
    let mut first = None;
    loop {
        let job = find(&app, id).await?;
        let changed = *first.get_or_insert(job.state) != job.state;
        let is_there = job.state.is_terminal() || until == Until::Change && changed;
        if is_there || tokio::time::Instant::now() >= deadline {
            return Ok(Json(job));
        }
        tokio::select! {
            () = listener.news() => {}
            () = tokio::time::sleep_until(deadline) => {}
            // What changed the state may have forgotten to ring.
            () = tokio::time::sleep(RECHECK) => {}
            () = key_end.comes() => {
                return Err(Problem::unauthenticated("the API key has ended meanwhile", true));
            }
            () = app.shared.shutdown.cancelled() => return Ok(Json(job)),
        }
    }
}

/// The job of that id, or a 404.
pub async fn find(app: &App, id: Uuid) -> Result<Job, Problem> {
    app.shared.store.job(id).await?.ok_or_else(|| Problem::not_found("there is no such job"))
}

/// Ask a job to end.
///
/// A queued job ends at once; a running one soon, keeping the picture so far; an ended one stays
/// as it is.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/cancel", tag = "jobs", params(documented::OfJob),
    responses((status = 200, description = "The job as it is now.", body = Job), documented::Named)
)]
pub async fn cancel_job(State(app): State<App>, JobId(id): JobId) -> Result<Json<Job>, Problem> {
    let job = app.shared.store.cancel(id).await?;
    app.shared.bell.ring(id);
    job.map(Json).ok_or_else(|| Problem::not_found("there is no such job"))
}

/// Remove a job and its pictures, ending it first.
///
/// Answers 204 whether or not the job was there, so that it can be repeated safely.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}", tag = "jobs", params(documented::OfJob),
    responses((status = 204, description = "The job is not there any more."), documented::Named)
)]
pub async fn delete_job(State(app): State<App>, JobId(id): JobId) -> Result<StatusCode, Problem> {
    app.shared.store.delete(id).await?;
    app.shared.bell.ring(id);
    Ok(StatusCode::NO_CONTENT)
}
