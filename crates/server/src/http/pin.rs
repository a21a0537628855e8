//! `/v1/jobs/{id}/pin`: what stays however old it gets.

use super::app::App;
use super::documented;
use super::jobs::find;
use super::problem::Problem;
use super::read::JobId;
use crate::access::Caller;
use crate::api::jobs::Job;
use crate::store::bytes::Pinned;
use axum::Json;
use axum::extract::State;
use uuid::Uuid;

/// Keep a job and its pictures until they are deleted, however old they get.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/pin", tag = "jobs", params(documented::OfJob),
    responses((status = 200, description = "The job as it is now.", body = Job), documented::Named, documented::NotNow, documented::OverLimit)
)]
pub async fn pin_job(
    State(app): State<App>,
    caller: Caller,
    JobId(id): JobId,
) -> Result<Json<Job>, Problem> {
    set(&app, id, true, caller.limits.pinned_bytes).await
}

/// Let a job expire again when its time comes.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}/pin", tag = "jobs", params(documented::OfJob),
    responses((status = 200, description = "The job as it is now.", body = Job), documented::Named)
)]
pub async fn unpin_job(State(app): State<App>, JobId(id): JobId) -> Result<Json<Job>, Problem> {
    set(&app, id, false, None).await
}

async fn set(app: &App, id: Uuid, pinned: bool, most: Option<u64>) -> Result<Json<Job>, Problem> {
    let done = app.shared.store.pin(id, pinned, most).await?;
    if done == Pinned::NotYet {
        return Err(Problem::not_now(
            "the job has not ended, and what this caller may pin is limited: pin it when it has",
        ));
    }
    if let Pinned::OverQuota { pinned, job } = done {
        app.shared.metrics.count_refusal("pinned_bytes");
        let most = most.unwrap_or(0);
        let detail = format!(
            "this caller has {pinned} bytes of pinned jobs and may have {most}; this job has {job}. Let another one expire first"
        );
        return Err(Problem::over_limit("pinned_bytes", detail, 600.0));
    }
    find(app, id).await.map(Json)
}
