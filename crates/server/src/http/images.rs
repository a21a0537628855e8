//! Pictures of a job: the newest one, and each by its content.

use super::app::App;
use super::documented;
use super::file::{self, Content, FileRequest};
use super::jobs::find;
use super::problem::Problem;
use super::read::{JobId, prefers};
use crate::access::Caller;
use crate::api::jobs::{Picture, PictureFormat};
use axum::extract::{Path, State};
use axum::http::{HeaderValue, header};
use axum::response::Response;
use uuid::Uuid;

/// The newest picture, PNG or, where `Accept` prefers image/x-exr, EXR.
#[utoipa::path(
    get,
    path = "/v1/jobs/{id}/image",
    tag = "results",
    params(documented::OfJob, documented::RangeHeader),
    responses(documented::AnyPicture)
)]
pub async fn newest_image(
    State(app): State<App>,
    JobId(id): JobId,
    asked: FileRequest,
) -> Result<Response, Problem> {
    let wants_exr = prefers(&asked.headers, PictureFormat::Exr.media_type(), "image/png");
    let format = if wants_exr { PictureFormat::Exr } else { PictureFormat::Png };
    let mut response = newest(&app, id, format, &asked).await?;
    response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    Ok(response)
}

/// The newest picture, PNG.
#[utoipa::path(
    get,
    path = "/v1/jobs/{id}/image.png",
    tag = "results",
    params(documented::OfJob, documented::RangeHeader),
    responses(documented::PngPicture)
)]
pub async fn newest_png(
    State(app): State<App>,
    JobId(id): JobId,
    asked: FileRequest,
) -> Result<Response, Problem> {
    newest(&app, id, PictureFormat::Png, &asked).await
}

/// The newest picture, EXR.
#[utoipa::path(
    get,
    path = "/v1/jobs/{id}/image.exr",
    tag = "results",
    params(documented::OfJob, documented::RangeHeader),
    responses(documented::ExrPicture)
)]
pub async fn newest_exr(
    State(app): State<App>,
    JobId(id): JobId,
    asked: FileRequest,
) -> Result<Response, Problem> {
    newest(&app, id, PictureFormat::Exr, &asked).await
}

/// A picture by its content; never changes.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/snapshots/{file}", tag = "results",
    params(
        ("id" = Uuid, Path, description = "The job's id."),
        ("file" = String, Path, pattern = "^[0-9a-f]{64}\\.(png|exr)$", description = "SHA-256 of the file, a dot, and png or exr."),
        documented::RangeHeader,
    ),
    responses(documented::Snapshot)
)]
pub async fn snapshot(
    State(app): State<App>,
    caller: Caller,
    Path((id, file)): Path<(String, String)>,
    asked: FileRequest,
) -> Result<Response, Problem> {
    let unknown = || Problem::not_found("there is no such picture");
    let id: Uuid = id.parse().map_err(|_| unknown())?;
    let (sha256, suffix) = file.split_once('.').ok_or_else(unknown)?;
    let format = PictureFormat::parse(suffix).ok_or_else(unknown)?;
    let picture = app.shared.store.picture(id, sha256, format).await?.ok_or_else(unknown)?;
    // What a key protects must not come out of a cache that others share.
    let cache = match caller.key() {
        Some(_) => "private, max-age=31536000, immutable",
        None => "public, max-age=31536000, immutable",
    };
    send(&app, id, &picture, &asked, cache).await
}

async fn newest(
    app: &App,
    id: Uuid,
    format: PictureFormat,
    asked: &FileRequest,
) -> Result<Response, Problem> {
    let Some(picture) = app.shared.store.newest_picture(id, format).await? else {
        find(app, id).await?;
        let detail = format!(
            "the job has no {} picture yet; snapshots and the final picture appear here",
            format.suffix()
        );
        return Err(Problem::not_found(detail));
    };
    send(app, id, &picture, asked, "no-cache").await
}

async fn send(
    app: &App,
    job: Uuid,
    picture: &Picture,
    asked: &FileRequest,
    cache: &'static str,
) -> Result<Response, Problem> {
    let (sha256, media_type) = (&picture.sha256, picture.format.media_type());
    let open = app.shared.artifacts.open_picture(job, sha256, picture.format);
    file::answer(asked, Content { sha256, media_type, cache }, open).await
}
