//! The dashboard: static files, part of the program.

use super::App;
use axum::Router;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use axum::routing::get;

/// `/` and `/assets/…`.
pub fn pages() -> Router<App> {
    let page = |media_type: &'static str, bytes: &'static [u8]| {
        get(move || async move { file(media_type, bytes) })
    };
    Router::new()
        .route("/", page("text/html; charset=utf-8", include_bytes!("../dashboard/index.html")))
        .route(
            "/assets/app.js",
            page("text/javascript; charset=utf-8", include_bytes!("../dashboard/app.js")),
        )
        .route(
            "/assets/style.css",
            page("text/css; charset=utf-8", include_bytes!("../dashboard/style.css")),
        )
}

fn file(media_type: &'static str, bytes: &'static [u8]) -> Response {
    let policy = "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; frame-ancestors 'none'";
    let headers = [
        (header::CONTENT_TYPE, media_type),
        (header::CACHE_CONTROL, "no-cache"),
        (header::CONTENT_SECURITY_POLICY, policy),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    (headers, bytes).into_response()
}
