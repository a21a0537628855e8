//! `/v1/scenes`.

use super::app::App;
use super::documented;
use super::problem::Problem;
use super::read::{Query, in_range, media_type};
use super::{kept, upload};
use crate::access::Caller;
use crate::api::FieldError;
use crate::api::scenes::{MAX_NAME_CHARS, Scene, ScenePage, name_of_file};
use crate::api::uploads::Upload;
use crate::store::scenes::ScenePosition;
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
    /// The .gltf or .glb file, or a .zip with it and its resources. Beside a .gltf or .glb, further
    /// parts are its resources, named by the relative URIs that the scene uses.
    #[schema(value_type = String, format = Binary, content_media_type = "application/octet-stream")]
    scene: Vec<u8>,
}

/// What an upload is called.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct NameQuery {
    /// A name for it; in a form, the name of the scene's file counts where this is left out.
    #[param(max_length = 255)]
    name: Option<String>,
}

/// Store a scene.
///
/// Send one `.glb` (or a `.gltf` with embedded data) as the body, or a multipart form with the
/// scene and its resources, 128 parts at most. Either may be a `.zip` with one `.glb` or `.gltf` and
/// its resources, in any folder: files that are stored or deflated, 4,096 at most, together no larger
/// once unpacked than an upload may be; no links, no encryption, no paths out of the archive. Of
/// several scenes in it, the one that lies less deep than all others is taken. The id is the hash of the content: sending the same scene again
/// stores nothing and answers 200; where it is given another name, it has that from then on. A
/// scene that cannot be imported is not kept.
#[utoipa::path(
    post, path = "/v1/scenes", tag = "scenes", params(NameQuery),
    request_body(
        description = "The scene.",
        content(
            (Vec<u8> = "model/gltf-binary"),
            (Vec<u8> = "application/octet-stream"),
            (Vec<u8> = "model/gltf+json"),
            (Vec<u8> = "application/zip"),
            (SceneFiles = "multipart/form-data"),
        )
    ),
    responses(
        (status = 201, description = "Stored.", body = Scene, headers(("location" = String, description = "The scene's path."))),
        (status = 200, description = "Was there already.", body = Scene, headers(("location" = String, description = "The scene's path."))),
        documented::Sent,
    )
)]
pub async fn create_scene(
    State(app): State<App>,
    caller: Caller,
    Query(query): Query<NameQuery>,
    request: Request,
) -> Result<impl IntoResponse, Problem> {
    let mut name = given_name(query)?;
    let (scene, is_new) = match media_type(request.headers()).as_str() {
        "multipart/form-data" => {
            let mut parts = upload::parts(&app, &caller, request, false).await?;
            name = name.or_else(|| parts.scene_name.take());
            parts.store(&app, &caller).await?
        }
        "model/gltf-binary"
        | "application/octet-stream"
        | "model/gltf+json"
        | "application/zip"
        | "application/x-zip-compressed" => {
            upload::scene_from_body(&app, &caller, request.into_body()).await?
        }
        other => {
            let detail = format!(
                "send model/gltf-binary, model/gltf+json, application/zip, application/octet-stream or multipart/form-data, not {other:?}"
            );
            return Err(Problem::unsupported_media(detail));
        }
    };
    let scene = kept::named(&app, &caller, scene, name).await?;
    let status = if is_new { StatusCode::CREATED } else { StatusCode::OK };
    Ok((status, [(header::LOCATION, format!("/v1/scenes/{}", scene.id))], Json(scene)))
}

/// The name that was given, fit to be shown.
pub fn given_name(query: NameQuery) -> Result<Option<String>, Problem> {
    let Some(name) = query.name else { return Ok(None) };
    if name.chars().count() > MAX_NAME_CHARS {
        let rule = format!("must have at most {MAX_NAME_CHARS} characters");
        return Err(
            Problem::unreadable(format!("name {rule}")).with_error(FieldError::new("name", rule))
        );
    }
    Ok(name_of_file(&name))
}

/// Get a scene.
#[utoipa::path(
    get, path = "/v1/scenes/{id}", tag = "scenes", params(("id" = String, Path, description = "The scene's id.")),
    responses((status = 200, description = "The scene.", body = Scene), documented::Named)
)]
pub async fn get_scene(
    State(app): State<App>,
    caller: Caller,
    Path(id): Path<String>,
) -> Result<Json<Scene>, Problem> {
    match app.shared.store.shown_scene(&id, caller.viewer()).await? {
        Some(scene) => Ok(Json(scene)),
        None => Err(Problem::not_found("there is no such scene")),
    }
}

/// Let go of a scene.
///
/// It is not the caller's any more and does not count towards their quota. Others who sent the same
/// keep it, and jobs that name it go on; its file goes when neither is left. Who sees everyone's
/// scenes ends it for all. Answers 204 whether or not the scene was there, so that it can be
/// repeated safely.
#[utoipa::path(
    delete, path = "/v1/scenes/{id}", tag = "scenes", params(("id" = String, Path, description = "The scene's id.")),
    responses((status = 204, description = "The scene is not the caller's any more."), documented::Named)
)]
pub async fn delete_scene(
    State(app): State<App>,
    caller: Caller,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    kept::let_go::<Scene>(&app, &caller, &id).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// A page.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct PageQuery {
    /// How many, at most.
    #[param(minimum = 1, maximum = 200, default = 50)]
    pub limit: Option<u32>,
    /// `next_cursor` of the page before. It names a place in the list and stays good when
    /// what is there goes.
    #[param(pattern = "^[0-9]{1,18}\\.[0-9a-f]{64}$")]
    pub cursor: Option<String>,
}

/// List scenes, newest first.
#[utoipa::path(
    get, path = "/v1/scenes", tag = "scenes", params(PageQuery),
    responses((status = 200, description = "One page of scenes.", body = ScenePage), documented::BadRequest)
)]
pub async fn list_scenes(
    State(app): State<App>,
    caller: Caller,
    Query(page): Query<PageQuery>,
) -> Result<Json<ScenePage>, Problem> {
    let limit = in_range("limit", page.limit.unwrap_or(50), 1..=200)?;
    let before = page.cursor.as_deref().map(position).transpose()?;
    let mut scenes =
        app.shared.store.shown_scenes(caller.viewer(), before.as_ref(), limit + 1).await?;
    let more = scenes.len() > limit as usize;
    scenes.truncate(limit as usize);
    let next_cursor = scenes.last().filter(|_| more).map(cursor);
    Ok(Json(ScenePage { scenes, next_cursor }))
}

/// The place behind an upload, with nothing in it that its viewer does not see.
pub fn cursor<T: Upload>(upload: &T) -> String {
    format!("{}.{}", upload.created_at().as_millisecond(), upload.id())
}

/// The place that a cursor names. Whether there is, or ever was, an upload plays no part in it.
pub fn position(cursor: &str) -> Result<ScenePosition, Problem> {
    let parts = cursor.split_once('.').and_then(|(ms, id)| Some((ms.parse().ok()?, id)));
    match parts {
        Some((created_ms, id)) if id.len() == 64 && id.bytes().all(|b| b.is_ascii_hexdigit()) => {
            Ok(ScenePosition { created_ms, id: id.to_owned() })
        }
        _ => Err(Problem::unreadable(
            "cursor must be a next_cursor of this version; start again without one",
        )),
    }
}
