//! Problem documents (RFC 9457): the one shape of every error answer.

use crate::api::FieldError;
use crate::artifacts::ArtifactError;
use crate::retention::RetentionError;
use crate::store::StoreError;
use crate::trace_context::RequestId;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Media type of problem documents.
pub const MEDIA_TYPE: &str = "application/problem+json";

/// An error answer (RFC 9457).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProblemDocument {
    /// Names the kind of problem for programs.
    #[schema(format = "uri-reference", example = "urn:hemilux:problem:invalid-request")]
    pub r#type: String,
    /// The kind of problem in words; the same for every occurrence.
    pub title: String,
    /// The HTTP status.
    #[schema(minimum = 400, maximum = 599)]
    pub status: u16,
    /// What happened this time and what to do about it.
    pub detail: String,
    /// The path that was asked.
    #[schema(format = "uri-reference")]
    pub instance: String,
    /// The id of the request, as the answer's `x-request-id` and the server's log have it.
    #[serde(default)]
    pub request_id: String,
    /// Which limit was met, for programs: `requests_per_second`, `jobs_queued`, `scene_bytes`,
    /// `stored_bytes`, `pinned_bytes`, `queue`, `disk`, `memory`, `uploads`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub limit: Option<String>,
    /// What is wrong, field by field.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<FieldError>,
}

/// An error on its way to become a [`ProblemDocument`].
#[derive(Clone, Debug)]
pub struct Problem {
    status: StatusCode,
    kind: &'static str,
    title: &'static str,
    detail: String,
    errors: Vec<FieldError>,
    retry_after_s: Option<u32>,
    limit: Option<&'static str>,
    challenge: Challenge,
}

/// What a refused caller is told about keys (RFC 6750).
#[derive(Clone, Copy, Debug)]
enum Challenge {
    None,
    KeyNeeded,
    WrongKey,
    ScopeNeeded,
}

impl Challenge {
    fn header(self) -> Option<HeaderValue> {
        let text = match self {
            Self::None => return None,
            Self::KeyNeeded => "Bearer realm=\"hemilux\"",
            Self::WrongKey => "Bearer realm=\"hemilux\", error=\"invalid_token\"",
            Self::ScopeNeeded => "Bearer realm=\"hemilux\", error=\"insufficient_scope\"",
        };
        Some(HeaderValue::from_static(text))
    }
}

impl Problem {
    fn new(
        status: StatusCode,
        kind: &'static str,
        title: &'static str,
        detail: impl Into<String>,
    ) -> Self {
        Self {
            status,
            kind,
            title,
            detail: detail.into(),
            errors: Vec::new(),
            retry_after_s: None,
            limit: None,
            challenge: Challenge::None,
        }
    }

    /// 400: the request cannot be read.
    pub fn unreadable(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "unreadable", "The request cannot be read", detail)
    }

    /// 401: without a key, or with a wrong one.
    pub fn unauthenticated(detail: impl Into<String>, wrong_key: bool) -> Self {
        let title = "An API key is needed";
        Self {
            challenge: if wrong_key { Challenge::WrongKey } else { Challenge::KeyNeeded },
            ..Self::new(StatusCode::UNAUTHORIZED, "unauthenticated", title, detail)
        }
    }

    /// 403: the key is good, but not for this.
    pub fn insufficient_scope(detail: impl Into<String>) -> Self {
        let title = "The API key does not allow this";
        Self {
            challenge: Challenge::ScopeNeeded,
            ..Self::new(StatusCode::FORBIDDEN, "insufficient-scope", title, detail)
        }
    }

    /// 404: there is no such thing.
    pub fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not-found", "There is no such thing", detail)
    }

    /// 403: not from where it came.
    pub fn forbidden(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::FORBIDDEN, "forbidden", "The request is not allowed", detail)
    }

    /// 408: the client sends too slowly.
    pub fn too_slow(detail: impl Into<String>) -> Self {
        let status = StatusCode::REQUEST_TIMEOUT;
        Self::new(status, "too-slow", "The request took too long to arrive", detail)
    }

    /// 409: the key belongs to another request.
    pub fn key_conflict(detail: impl Into<String>) -> Self {
        let title = "The idempotency key belongs to another request";
        Self::new(StatusCode::CONFLICT, "key-conflict", title, detail)
    }

    /// 409: not to a job in its present state.
    pub fn not_now(detail: impl Into<String>) -> Self {
        let title = "That cannot be done with the job as it is";
        Self::new(StatusCode::CONFLICT, "not-now", title, detail)
    }

    /// 413: over a limit of this server.
    pub fn too_large(detail: impl Into<String>) -> Self {
        let status = StatusCode::PAYLOAD_TOO_LARGE;
        Self::new(status, "too-large", "The request is too large", detail)
    }

    /// 415: not in a form that the route takes.
    pub fn unsupported_media(detail: impl Into<String>) -> Self {
        let status = StatusCode::UNSUPPORTED_MEDIA_TYPE;
        Self::new(status, "unsupported-media-type", "The content type is not supported", detail)
    }

    /// 416: the file has no such part.
    pub fn unsatisfiable_range(detail: impl Into<String>) -> Self {
        let status = StatusCode::RANGE_NOT_SATISFIABLE;
        Self::new(status, "unsatisfiable-range", "The file has no such part", detail)
    }

    /// 422: readable, but some fields cannot be met.
    pub fn invalid(errors: Vec<FieldError>) -> Self {
        let detail = match errors.as_slice() {
            [only] => format!("{}: {}", only.field, only.detail),
            many => format!("{} fields are wrong; see errors", many.len()),
        };
        let title = "The request cannot be met as asked";
        let status = StatusCode::UNPROCESSABLE_ENTITY;
        Self { errors, ..Self::new(status, "invalid-request", title, detail) }
    }

    /// 422: the scene cannot be used.
    pub fn bad_scene(detail: impl Into<String>) -> Self {
        let status = StatusCode::UNPROCESSABLE_ENTITY;
        Self::new(status, "bad-scene", "The scene cannot be used", detail)
    }

    /// 422: the map of a sky cannot be used.
    pub fn bad_environment(detail: impl Into<String>) -> Self {
        let status = StatusCode::UNPROCESSABLE_ENTITY;
        Self::new(status, "bad-environment", "The environment cannot be used", detail)
    }

    /// 429: the queue is full.
    pub fn queue_full(retry_after_s: u32) -> Self {
        let status = StatusCode::TOO_MANY_REQUESTS;
        let detail = format!("too many jobs are waiting; try again in {retry_after_s} seconds");
        Self {
            retry_after_s: Some(retry_after_s),
            limit: Some("queue"),
            ..Self::new(status, "queue-full", "The queue is full", detail)
        }
    }

    /// 429: over a limit of this caller's own, which has room again after `wait_s` or so.
    pub fn over_limit(limit: &'static str, detail: impl Into<String>, wait_s: f64) -> Self {
        let status = StatusCode::TOO_MANY_REQUESTS;
        Self {
            retry_after_s: Some(wait_s.clamp(1.0, 3600.0).ceil() as u32),
            limit: Some(limit),
            ..Self::new(status, "over-limit", "A limit of this caller is reached", detail)
        }
    }

    /// 422: the job could never fit into this server's memory.
    pub fn too_much_memory(detail: impl Into<String>) -> Self {
        let status = StatusCode::UNPROCESSABLE_ENTITY;
        let title = "The job does not fit into this server's memory";
        Self { limit: Some("memory"), ..Self::new(status, "too-much-memory", title, detail) }
    }

    /// 503: as many uploads are open as may be.
    pub fn uploads_full(detail: impl Into<String>) -> Self {
        Self { limit: Some("uploads"), ..Self::unavailable(detail) }
    }

    /// 503: the disk is nearly full; nothing new is taken.
    pub fn disk_full(detail: impl Into<String>) -> Self {
        let status = StatusCode::SERVICE_UNAVAILABLE;
        Self {
            retry_after_s: Some(30),
            limit: Some("disk"),
            ..Self::new(status, "disk-full", "The server's disk is nearly full", detail)
        }
    }

    /// 500: a fault of the server.
    pub fn internal(detail: impl Into<String>) -> Self {
        let status = StatusCode::INTERNAL_SERVER_ERROR;
        Self::new(status, "internal", "The server failed", detail)
    }

    /// 503: not now.
    pub fn unavailable(detail: impl Into<String>) -> Self {
        let status = StatusCode::SERVICE_UNAVAILABLE;
        Self {
            retry_after_s: Some(5),
            ..Self::new(status, "unavailable", "The server cannot do this now", detail)
        }
    }

    /// The same problem with a field named.
    pub fn with_error(mut self, error: FieldError) -> Self {
        self.errors.push(error);
        self
    }

    fn of_status(status: StatusCode, detail: String) -> Self {
        let (kind, title) = match status {
            StatusCode::NOT_FOUND => ("not-found", "There is no such thing"),
            StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE => {
                ("too-large", "The request is too large")
            }
            StatusCode::METHOD_NOT_ALLOWED => {
                ("method-not-allowed", "The method is not allowed here")
            }
            StatusCode::REQUEST_TIMEOUT => ("too-slow", "The request took too long to arrive"),
            StatusCode::PAYLOAD_TOO_LARGE => ("too-large", "The request is too large"),
            StatusCode::UNSUPPORTED_MEDIA_TYPE => {
                ("unsupported-media-type", "The content type is not supported")
            }
            status if status.is_server_error() => ("internal", "The server failed"),
            _ => ("unreadable", "The request cannot be read"),
        };
        Self::new(status, kind, title, detail)
    }

    fn document(self, instance: &str, request_id: &str) -> ProblemDocument {
        ProblemDocument {
            r#type: format!("urn:hemilux:problem:{}", self.kind),
            title: self.title.into(),
            status: self.status.as_u16(),
            detail: self.detail,
            instance: instance.into(),
            request_id: request_id.into(),
            limit: self.limit.map(str::to_owned),
            errors: self.errors,
        }
    }
}

impl IntoResponse for Problem {
    /// An empty answer that carries the problem; [`write_problems`] writes the document, since
    /// only it knows the path.
    fn into_response(self) -> Response {
        let mut response = self.status.into_response();
        if let Some(seconds) = self.retry_after_s {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if let Some(challenge) = self.challenge.header() {
            response.headers_mut().insert(header::WWW_AUTHENTICATE, challenge);
        }
        response.extensions_mut().insert(self);
        response
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        tracing::error!(%error, "store");
        match error {
            StoreError::Database(_) => Self::unavailable("the database does not answer"),
            StoreError::Sick { what, remedy, .. } => {
                Self::unavailable(format!("the database: {what}; an operator can {remedy}"))
            }
            _ => Self::internal("the database holds something unexpected; see the server's log"),
        }
    }
}

impl From<RetentionError> for Problem {
    fn from(error: RetentionError) -> Self {
        match error {
            RetentionError::Store(error) => error.into(),
            RetentionError::Artifacts(error) => error.into(),
        }
    }
}

impl From<ArtifactError> for Problem {
    fn from(error: ArtifactError) -> Self {
        if error.is_not_found() {
            return Self::not_found("the file is not there any more");
        }
        if let ArtifactError::Damaged { .. } = error {
            return Self::internal(error.to_string());
        }
        tracing::error!(%error, "artifacts");
        Self::unavailable("the file storage does not answer")
    }
}

/// Middleware: turns every error answer, the framework's own included, into a document.
pub async fn write_problems(request: Request, next: Next) -> Response {
    let instance = request.uri().path().to_owned();
    let request_id = request.extensions().get::<RequestId>().map(|id| id.0.clone());
    let request_id = request_id.unwrap_or_default();
    let is_head = request.method() == axum::http::Method::HEAD;
    let mut response = next.run(request).await;
    let status = response.status();
    if !(status.is_client_error() || status.is_server_error()) {
        return response;
    }
    let problem = match response.extensions_mut().remove::<Problem>() {
        Some(problem) => problem,
        None => {
            let body = std::mem::replace(response.body_mut(), Body::empty());
            let text = axum::body::to_bytes(body, 16 << 10).await.unwrap_or_default();
            let text = String::from_utf8_lossy(&text).into_owned();
            let detail = match status {
                StatusCode::METHOD_NOT_ALLOWED => "see the Allow header".into(),
                StatusCode::NOT_FOUND => format!("no route leads to {instance}"),
                _ if text.is_empty() => status.to_string(),
                _ => text,
            };
            Problem::of_status(status, detail)
        }
    };
    let document =
        serde_json::to_vec(&problem.document(&instance, &request_id)).unwrap_or_default();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(MEDIA_TYPE));
    headers.insert(header::CONTENT_LENGTH, HeaderValue::from(document.len()));
    if !is_head {
        *response.body_mut() = Body::from(document);
    }
    response
}

/// The answer to a handler that panicked.
pub fn from_panic(panic: Box<dyn std::any::Any + Send>) -> Response {
    tracing::error!(panic = %crate::panic_text(&*panic), "a request handler panicked");
    Problem::internal("an unexpected fault; the server's log has more").into_response()
}
