//! Health, metrics and the pool. Health and metrics are open to all, so whatever they ask of the
//! database is asked about once a second.

use super::app::App;
use super::problem::Problem;
use crate::access::Caller;
use crate::api::{DeviceList, DeviceStatus};
use crate::metrics::{self, Present};
use axum::Json;
use axum::extract::{MatchedPath, Request, State};
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use std::time::{Duration, Instant};
use utoipa::ToSchema;

/// How long a probe waits for the database before it goes by what was so last. Those who probe
/// often give up after a second.
const PATIENCE: Duration = Duration::from_millis(700);
/// How long the database may be silent before the service counts as not ready: a busy one, behind
/// a long write, is.
const LONGEST_SILENCE: Duration = Duration::from_secs(10);
/// How long metrics wait for figures before they take those of before; those who scrape often give
/// up after ten seconds.
const FIGURES_PATIENCE: Duration = Duration::from_secs(5);

/// A probe's answer.
#[derive(Serialize, ToSchema)]
pub struct Healthy {
    /// Always `ok`; anything else is a problem document.
    #[schema(example = "ok")]
    status: &'static str,
}

/// Whether the process answers.
#[utoipa::path(
    get, path = "/livez", tag = "operations",
    responses((status = 200, description = "It does.", body = Healthy))
)]
pub async fn livez() -> Json<Healthy> {
    Json(Healthy { status: "ok" })
}

/// Whether the service can take and run jobs: the database can be written and a device works.
#[utoipa::path(
    get, path = "/readyz", tag = "operations",
    responses((status = 200, description = "It can.", body = Healthy))
)]
pub async fn readyz(State(app): State<App>) -> Result<Json<Healthy>, Problem> {
    if app.shared.shutdown.is_cancelled() {
        return Err(Problem::unavailable("the server is shutting down"));
    }
    let store = app.shared.store.clone();
    let ping = || async move { store.ping().await.map_err(Problem::from) };
    match app.recent.database.get(PATIENCE, ping).await {
        Some((at, answer)) if at.elapsed() < LONGEST_SILENCE => answer?,
        _ => return Err(Problem::unavailable("the database does not answer")),
    }
    let mut statuses = app.shared.pool.devices().into_iter().filter_map(|device| device.status);
    if !statuses.any(|status| matches!(status, DeviceStatus::Idle | DeviceStatus::Busy)) {
        return Err(Problem::unavailable("no device of the pool is ready"));
    }
    Ok(Json(Healthy { status: "ok" }))
}

/// Metrics in the OpenMetrics text format.
///
/// Counts of jobs and messages are up to a second old; with very many jobs, up to twenty times as
/// old as it takes to count them.
#[utoipa::path(
    get, path = "/metrics", tag = "operations",
    responses((status = 200, description = "The metrics.", body = String, content_type = "application/openmetrics-text"))
)]
pub async fn metrics(State(app): State<App>) -> Result<Response, Problem> {
    let store = app.shared.store.clone();
    let count = || async move { Ok((store.counts().await?, store.undelivered().await?)) };
    let counted = app.recent.figures.get(FIGURES_PATIENCE, count).await;
    let unknown = || Problem::unavailable("the database does not answer");
    let (jobs, webhooks_pending) = counted.ok_or_else(unknown)?.1?;
    let present = Present {
        jobs,
        devices: app.shared.pool.devices(),
        webhooks_pending,
        disk_free_bytes: app.shared.disk.free_bytes(),
    };
    let text = app
        .shared
        .metrics
        .encode(&present)
        .map_err(|error| Problem::internal(error.to_string()))?;
    Ok(([(header::CONTENT_TYPE, metrics::MEDIA_TYPE)], text).into_response())
}

/// The devices of this machine, and what those of the pool do.
#[utoipa::path(
    get, path = "/v1/devices", tag = "operations",
    responses((status = 200, description = "The devices.", body = DeviceList))
)]
pub async fn list_devices(
    State(app): State<App>,
    caller: Caller,
) -> Result<Json<DeviceList>, Problem> {
    let mut devices = app.shared.pool.devices();
    if !caller.sees_all() {
        for device in &mut devices {
            let Some(job) = device.job else { continue };
            let owner = app.shared.store.job_owner(job).await?;
            device.job = device.job.filter(|_| owner.as_deref() == Some(caller.owner()));
        }
    }
    Ok(Json(DeviceList { devices }))
}

/// Middleware: counts requests by method, route and status.
pub async fn count_requests(State(app): State<App>, request: Request, next: Next) -> Response {
    let method = request.method().clone();
    // The route, not the path: a metric per job id would never stop growing.
    let route = request
        .extensions()
        .get::<MatchedPath>()
        .map_or_else(|| "none".to_owned(), |path| path.as_str().to_owned());
    let begun = Instant::now();
    let response = next.run(request).await;
    let seconds = begun.elapsed().as_secs_f64();
    app.shared.metrics.count_request(&method, route, response.status(), seconds);
    response
}
