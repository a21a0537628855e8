//! Every request gets an id and a span; both go wherever the request goes.

use crate::trace_context::{REQUEST_ID, RequestId, TraceParent};
use axum::extract::Request;
use axum::http::HeaderValue;
use axum::middleware::Next;
use axum::response::Response;
use std::time::Instant;
use tracing::Instrument;
use tracing::field::Empty;

/// Middleware: names the request, for the log, for problem documents and for the client.
pub async fn name_request(mut request: Request, next: Next) -> Response {
    let id = RequestId::of(request.headers());
    let parent = TraceParent::of(request.headers());
    let span = tracing::info_span!(
        "request",
        id = id.0,
        method = %request.method(),
        path = request.uri().path(),
        trace_id = Empty,
        key = Empty,
    );
    if let Some(parent) = parent {
        span.record("trace_id", parent.trace_id());
        crate::telemetry::continue_trace(&span, &parent);
        request.extensions_mut().insert(parent);
    }
    let value = HeaderValue::from_str(&id.0).ok();
    request.extensions_mut().insert(id);
    async move {
        let begun = Instant::now();
        let mut response = next.run(request).await;
        let (status, ms) = (response.status().as_u16(), begun.elapsed().as_millis() as u64);
        if response.status().is_server_error() {
            tracing::warn!(status, ms, "answered");
        } else {
            tracing::debug!(status, ms, "answered");
        }
        if let Some(value) = value {
            response.headers_mut().insert(REQUEST_ID, value);
        }
        response
    }
    .instrument(span)
    .await
}
