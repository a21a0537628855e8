//! `/v1/jobs/{id}/pin`: what stays however old it gets.

use super::App;
use super::jobs::find;
use super::problem::{Problem, documented};
use super::read::JobId;
use crate::api::jobs::Job;
use axum::Json;
use axum::extract::State;
use uuid::Uuid;

/// Keep a job and its pictures until they are deleted, however old they get.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/pin", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id.")),
    responses(
        (status = 200, description = "The job as it is now.", body = Job),
        documented::BadRequest,
        documented::NotFound,
    )
)]
pub async fn pin_job(State(app): State<App>, JobId(id): JobId) -> Result<Json<Job>, Problem> {
    set(&app, id, true).await
}

/// Let a job expire again when its time comes.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}/pin", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id.")),
    responses(
        (status = 200, description = "The job as it is now.", body = Job),
        documented::BadRequest,
        documented::NotFound,
    )
)]
pub async fn unpin_job(State(app): State<App>, JobId(id): JobId) -> Result<Json<Job>, Problem> {
    set(&app, id, false).await
}

async fn set(app: &App, id: Uuid, pinned: bool) -> Result<Json<Job>, Problem> {
    app.store.pin(id, pinned).await?;
    find(app, id).await.map(Json)
}
