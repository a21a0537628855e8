//! The API's description and its reader.

use super::app::App;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Router};
use std::sync::Arc;
use utoipa_swagger_ui::{Config, SwaggerUi, Url};

/// The API's description in YAML, which the router carries.
#[derive(Clone)]
pub struct Description(pub Arc<str>);

/// This description.
#[utoipa::path(
    get, path = "/openapi.yaml", tag = "operations",
    responses((status = 200, description = "OpenAPI 3.1.", body = String, content_type = "application/yaml"))
)]
pub async fn openapi_yaml(Extension(description): Extension<Description>) -> Response {
    let text = description.0.to_string();
    ([(header::CONTENT_TYPE, "application/yaml")], text).into_response()
}

/// Pages under `/docs` that show the description; all files come from this program.
pub fn swagger_ui() -> Router<App> {
    let config = Config::new([Url::new("Hemilux", "/openapi.yaml")]).try_it_out_enabled(true);
    SwaggerUi::new("/docs").config(config).into()
}
