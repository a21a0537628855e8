//! Which web pages of other origins may use the API.

use axum::http::{HeaderName, HeaderValue, Method, header};
use std::time::Duration;
use tower_http::cors::CorsLayer;

/// How long a browser may trust a preflight answer.
const MAX_AGE: Duration = Duration::from_secs(3600);

/// Lets pages of these origins in, and no other. There are no cookies: a page must hold a key, so
/// credentials of the browser are never asked for.
pub fn layer(origins: &[HeaderValue]) -> CorsLayer {
    let named = HeaderName::from_static;
    CorsLayer::new()
        .allow_origin(origins.to_vec())
        .allow_methods([Method::GET, Method::HEAD, Method::POST, Method::DELETE])
        .allow_headers([
            header::AUTHORIZATION,
            header::CONTENT_TYPE,
            header::IF_NONE_MATCH,
            header::IF_RANGE,
            header::RANGE,
            named("idempotency-key"),
            named("last-event-id"),
            named("traceparent"),
            named("x-request-id"),
        ])
        .expose_headers([
            header::ACCEPT_RANGES,
            header::CONTENT_RANGE,
            header::ETAG,
            header::LOCATION,
            header::RETRY_AFTER,
            named("idempotency-replayed"),
            named("x-request-id"),
        ])
        .max_age(MAX_AGE)
}
