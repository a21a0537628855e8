//! The HTTP side of the service.

mod access;
pub mod app;
mod audit;
pub mod audit_log;
mod cors;
mod dashboard;
mod docs;
mod documented;
mod environments;
mod events;
mod file;
mod fresh;
mod gauge;
mod guard;
mod images;
pub mod import_turns;
mod jobs;
mod kept;
pub mod listen;
mod openapi;
mod pin;
mod probes;
pub mod problem;
pub mod rate;
mod read;
mod recent;
mod scenes;
pub mod slots;
mod solutions;
mod spool;
mod trace;
mod traces;
mod unzip;
mod upload;
mod webhooks;

use app::App;
use axum::extract::DefaultBodyLimit;
use axum::middleware::from_fn;
use axum::middleware::from_fn_with_state;
use axum::{Extension, Router};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{DefaultPredicate, NotForContentType, Predicate};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// The documented routes.
fn api() -> OpenApiRouter<App> {
    OpenApiRouter::with_openapi(openapi::base())
        .routes(routes!(scenes::create_scene, scenes::list_scenes))
        .routes(routes!(scenes::get_scene, scenes::delete_scene))
        .routes(routes!(environments::create_environment, environments::list_environments))
        .routes(routes!(environments::get_environment, environments::delete_environment))
        .routes(routes!(jobs::create_job, jobs::list_jobs))
        .routes(routes!(jobs::get_job, jobs::delete_job))
        .routes(routes!(jobs::cancel_job))
        .routes(routes!(solutions::extend_job))
        .routes(routes!(solutions::create_view))
        .routes(routes!(solutions::manifest))
        .routes(routes!(solutions::solution_glb))
        .routes(routes!(pin::pin_job, pin::unpin_job))
        .routes(routes!(webhooks::list_deliveries))
        .routes(routes!(events::stream_events))
        .routes(routes!(images::newest_image))
        .routes(routes!(images::newest_png))
        .routes(routes!(images::newest_exr))
        .routes(routes!(images::snapshot))
        .routes(routes!(traces::chart_svg))
        .routes(routes!(traces::trace))
        .routes(routes!(traces::trace_json))
        .routes(routes!(traces::trace_csv))
        .routes(routes!(probes::list_devices))
        .routes(routes!(probes::livez))
        .routes(routes!(probes::readyz))
        .routes(routes!(probes::metrics))
        .routes(routes!(docs::openapi_yaml))
}

/// The API's description, OpenAPI in YAML.
pub fn description() -> String {
    openapi::yaml(api().split_for_parts().1)
}

/// Which answers are compressed: not those that are files, of which clients ask for parts.
fn compressed() -> impl Predicate {
    DefaultPredicate::new().and(NotForContentType::const_new("model/gltf-binary"))
}

/// The whole application.
pub fn router(app: App) -> Router {
    let (api, paths) = api().split_for_parts();
    let description = docs::Description(openapi::yaml(paths).into());
    let api = api
        .merge(docs::swagger_ui())
        .merge(dashboard::pages())
        .layer(Extension(description))
        // Uploads count their own bytes; everything else is small.
        .layer(DefaultBodyLimit::disable())
        .layer(from_fn_with_state(app.clone(), access::check))
        .layer(CatchPanicLayer::custom(problem::from_panic))
        .layer(from_fn_with_state(app.clone(), guard::refuse_foreign_pages))
        .layer(from_fn(problem::write_problems))
        .layer(from_fn_with_state(app.clone(), audit::write_down));
    let origins = &app.shared.config.guard.cors_origin;
    let api = if origins.is_empty() { api } else { api.layer(cors::layer(origins)) };
    api
        // Outside the problems, which read the framework's own error texts.
        .layer(CompressionLayer::new().compress_when(compressed()))
        .layer(from_fn_with_state(app.clone(), probes::count_requests))
        .layer(from_fn(trace::name_request))
        .with_state(app)
}
