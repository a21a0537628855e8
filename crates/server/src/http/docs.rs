//! The API's description and its reader.

use super::{App, openapi};
use axum::Router;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use utoipa_swagger_ui::{Config, SwaggerUi, Url};

/// This description.
#[utoipa::path(
    get, path = "/openapi.yaml", tag = "operations",
    responses((status = 200, description = "OpenAPI 3.1.", body = String, content_type = "application/yaml"))
)]
pub async fn openapi_yaml() -> Response {
    ([(header::CONTENT_TYPE, "application/yaml")], openapi::yaml()).into_response()
}

/// Pages under `/docs` that show the description; all files come from this program.
pub fn swagger_ui() -> Router<App> {
    let config = Config::new([Url::new("Hemilux", "/openapi.yaml")]).try_it_out_enabled(true);
    SwaggerUi::new("/docs").config(config).into()
}
