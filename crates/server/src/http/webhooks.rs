//! `/v1/jobs/{id}/webhooks`: what became of the messages about a job.

use super::app::App;
use super::documented;
use super::jobs::find;
use super::problem::Problem;
use super::read::JobId;
use crate::api::webhooks::DeliveryList;
use axum::Json;
use axum::extract::State;

/// What became of the messages about a job's end.
///
/// They are kept for a week after they were delivered or given up.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/webhooks", tag = "jobs", params(documented::OfJob),
    responses((status = 200, description = "The messages, oldest first.", body = DeliveryList), documented::Named)
)]
pub async fn list_deliveries(
    State(app): State<App>,
    JobId(id): JobId,
) -> Result<Json<DeliveryList>, Problem> {
    find(&app, id).await?;
    Ok(Json(DeliveryList { deliveries: app.shared.store.deliveries(id).await? }))
}
