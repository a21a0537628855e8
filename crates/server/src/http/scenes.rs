//! `/v1/scenes`.

use super::App;
use super::problem::{Problem, documented};
use super::read::{Query, in_range, media_type};
use super::upload;
use crate::access::Caller;
use crate::api::scenes::{Scene, ScenePage};
use axum::Json;
use axum::extract::{Path, Request, State};
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

/// A scene of several files.
#[derive(ToSchema)]
#[allow(dead_code, reason = "stands for the request in the API's description")]
pub struct SceneFiles {
    /// The .gltf or .glb file. Further parts are its resources, named by the relative URIs that
    /// the scene uses.
    #[schema(value_type = String, format = Binary, content_media_type = "application/octet-stream")]
    scene: Vec<u8>,
}

/// Store a scene.
///
/// Send one `.glb` (or a `.gltf` with embedded data) as the body, or a multipart form with the
/// scene and its resources, 128 parts at most. The id is the hash of the content: sending the same scene again
/// stores nothing and answers 200. A scene that cannot be imported is not kept.
#[utoipa::path(
    post, path = "/v1/scenes", tag = "scenes",
    request_body(
        description = "The scene.",
        content(
            (Vec<u8> = "model/gltf-binary"),
            (Vec<u8> = "application/octet-stream"),
            (Vec<u8> = "model/gltf+json"),
            (SceneFiles = "multipart/form-data"),
        )
    ),
    responses(
        (status = 201, description = "Stored.", body = Scene, headers(("location" = String, description = "The scene's path."))),
        (status = 200, description = "Was there already.", body = Scene, headers(("location" = String, description = "The scene's path."))),
        documented::BadRequest,
        documented::TooSlow,
        documented::TooLarge,
        documented::UnsupportedMedia,
        documented::Invalid,
        documented::OverLimit,
    )
)]
pub async fn create_scene(
    State(app): State<App>,
    caller: Caller,
    request: Request,
) -> Result<impl IntoResponse, Problem> {
    let (scene, is_new) = match media_type(request.headers()).as_str() {
        "multipart/form-data" => {
            upload::parts(&app, request, false).await?.store(&app, &caller).await?
        }
        "model/gltf-binary" | "application/octet-stream" | "model/gltf+json" => {
            upload::scene_from_body(&app, &caller, request.into_body()).await?
        }
        other => {
            let detail = format!(
                "send model/gltf-binary, model/gltf+json, application/octet-stream or multipart/form-data, not {other:?}"
            );
            return Err(Problem::unsupported_media(detail));
        }
    };
    let status = if is_new { StatusCode::CREATED } else { StatusCode::OK };
    Ok((status, [(header::LOCATION, format!("/v1/scenes/{}", scene.id))], Json(scene)))
}

/// Get a scene.
#[utoipa::path(
    get, path = "/v1/scenes/{id}", tag = "scenes",
    params(("id" = String, Path, description = "The scene's id.")),
    responses(
        (status = 200, description = "The scene.", body = Scene),
        documented::BadRequest,
        documented::NotFound,
    )
)]
pub async fn get_scene(
    State(app): State<App>,
    Path(id): Path<String>,
) -> Result<Json<Scene>, Problem> {
    match app.store.scene(&id).await? {
        Some(scene) => Ok(Json(scene)),
        None => Err(Problem::not_found("there is no such scene")),
    }
}

/// A page.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct PageQuery {
    /// How many, at most.
    #[param(minimum = 1, maximum = 200, default = 50)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    #[param(max_length = 64)]
    cursor: Option<String>,
}

/// List scenes, newest first.
#[utoipa::path(
    get, path = "/v1/scenes", tag = "scenes",
    params(PageQuery),
    responses(
        (status = 200, description = "One page of scenes.", body = ScenePage),
        documented::BadRequest,
    )
)]
pub async fn list_scenes(
    State(app): State<App>,
    caller: Caller,
    Query(page): Query<PageQuery>,
) -> Result<Json<ScenePage>, Problem> {
    let limit = in_range("limit", page.limit.unwrap_or(50), 1..=200)?;
    if page.cursor.as_ref().is_some_and(|cursor| cursor.len() > 64) {
        return Err(Problem::unreadable("cursor must be a next_cursor"));
    }
    let cursor = page.cursor.as_deref();
    let mut scenes = if caller.sees_all() {
        app.store.scenes(cursor, limit + 1).await?
    } else {
        app.store.scenes_of(caller.billed_to(), cursor, limit + 1).await?
    };
    let more = scenes.len() > limit as usize;
    scenes.truncate(limit as usize);
    let next_cursor = scenes.last().filter(|_| more).map(|scene| scene.id.clone());
    Ok(Json(ScenePage { scenes, next_cursor }))
}
