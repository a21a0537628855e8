//! `/v1/environments`: maps of skies that jobs can name.

use super::app::App;
use super::documented;
use super::problem::Problem;
use super::read::{Query, in_range, media_type};
use super::scenes::{NameQuery, PageQuery, cursor, given_name, position};
use super::{kept, upload};
use crate::access::Caller;
use crate::api::environments::{EnvironmentMap, EnvironmentPage};
use axum::Json;
use axum::extract::{Path, Request, State};
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;

/// Store a map of a sky.
///
/// Send an equirectangular picture of radiance, OpenEXR or Radiance HDR, as the body; a job names it
/// as its `environment.sky`. The top row is straight up (+Y), the middle of the map looks along +X.
/// The id is the hash of the content: sending the same map again stores nothing and answers 200;
/// where it is given another name, it has that from then on. What is no map is not kept. Maps count
/// towards the same quota as scenes, and expire as they do.
#[utoipa::path(
    post, path = "/v1/environments", tag = "environments", params(NameQuery),
    request_body(
        description = "The map.",
        content(
            (Vec<u8> = "image/x-exr"),
            (Vec<u8> = "image/vnd.radiance"),
            (Vec<u8> = "application/octet-stream"),
        )
    ),
    responses(
        (status = 201, description = "Stored.", body = EnvironmentMap, headers(("location" = String, description = "The map's path."))),
        (status = 200, description = "Was there already.", body = EnvironmentMap, headers(("location" = String, description = "The map's path."))),
        documented::Sent,
    )
)]
pub async fn create_environment(
    State(app): State<App>,
    caller: Caller,
    Query(query): Query<NameQuery>,
    request: Request,
) -> Result<impl IntoResponse, Problem> {
    let name = given_name(query)?;
    let (map, is_new) = match media_type(request.headers()).as_str() {
        "image/x-exr" | "image/aces" | "image/vnd.radiance" | "application/octet-stream" => {
            upload::map_from_body(&app, &caller, request.into_body()).await?
        }
        other => {
            let detail = format!(
                "send image/x-exr, image/vnd.radiance or application/octet-stream, not {other:?}"
            );
            return Err(Problem::unsupported_media(detail));
        }
    };
    let map = kept::named(&app, &caller, map, name).await?;
    let status = if is_new { StatusCode::CREATED } else { StatusCode::OK };
    Ok((status, [(header::LOCATION, format!("/v1/environments/{}", map.id))], Json(map)))
}

/// Get a map's record.
#[utoipa::path(
    get, path = "/v1/environments/{id}", tag = "environments", params(("id" = String, Path, description = "The map's id.")),
    responses((status = 200, description = "The map's record.", body = EnvironmentMap), documented::Named)
)]
pub async fn get_environment(
    State(app): State<App>,
    caller: Caller,
    Path(id): Path<String>,
) -> Result<Json<EnvironmentMap>, Problem> {
    match app.shared.store.shown_environment(&id, caller.viewer()).await? {
        Some(map) => Ok(Json(map)),
        None => Err(Problem::not_found("there is no such environment")),
    }
}

/// Let go of a map.
///
/// As with scenes: others who sent the same keep it, and jobs that name it go on; its file goes when
/// neither is left. Answers 204 whether or not the map was there.
#[utoipa::path(
    delete, path = "/v1/environments/{id}", tag = "environments", params(("id" = String, Path, description = "The map's id.")),
    responses((status = 204, description = "The map is not the caller's any more."), documented::Named)
)]
pub async fn delete_environment(
    State(app): State<App>,
    caller: Caller,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    kept::let_go::<EnvironmentMap>(&app, &caller, &id).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// List maps, newest first.
#[utoipa::path(
    get, path = "/v1/environments", tag = "environments", params(PageQuery),
    responses((status = 200, description = "One page of maps.", body = EnvironmentPage), documented::BadRequest)
)]
pub async fn list_environments(
    State(app): State<App>,
    caller: Caller,
    Query(page): Query<PageQuery>,
) -> Result<Json<EnvironmentPage>, Problem> {
    let limit = in_range("limit", page.limit.unwrap_or(50), 1..=200)?;
    let before = page.cursor.as_deref().map(position).transpose()?;
    let viewer = caller.viewer();
    let mut environments =
        app.shared.store.shown_environments(viewer, before.as_ref(), limit + 1).await?;
    let more = environments.len() > limit as usize;
    environments.truncate(limit as usize);
    let next_cursor = environments.last().filter(|_| more).map(cursor);
    Ok(Json(EnvironmentPage { environments, next_cursor }))
}
