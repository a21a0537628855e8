//! Who may do what: the one place where every request is let in or refused, before its handler.
//!
//! It goes by the path, not by the handler, so that a new route is closed until it is opened here.

use super::app::App;
use super::audit::AdmittedCaller;
use super::problem::Problem;
use crate::access::{self, Caller};
use crate::api::keys::Scope;
use axum::RequestExt;
use axum::extract::{ConnectInfo, FromRequestParts, RawPathParams, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use jiff::Timestamp;
use std::net::SocketAddr;
use std::time::Instant;
use uuid::Uuid;

/// The kind of a route, which decides whether a request to it needs an API key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RouteAccess {
    /// Probes, the description, the page: open to all.
    Open,
    /// `/metrics`.
    Metrics,
    /// Everything else of the API.
    Api,
}

fn route_access(path: &str) -> RouteAccess {
    if path == "/metrics" {
        RouteAccess::Metrics
    } else if path == "/v1" || path.starts_with("/v1/") {
        RouteAccess::Api
    } else {
        RouteAccess::Open
    }
}

/// Cancel and delete are let through whatever the limits say: they make room.
fn makes_room(method: &Method, path: &str) -> bool {
    method == Method::DELETE || method == Method::POST && path.ends_with("/cancel")
}

/// Whether a request asks the server to take or make something new.
fn brings_work(method: &Method, path: &str) -> bool {
    method == Method::POST && !path.ends_with("/cancel") && !path.ends_with("/pin")
}

/// Middleware: lets a request in and notes its [`Caller`], or refuses it.
pub async fn check(State(app): State<App>, mut request: Request, next: Next) -> Response {
    let route_access = route_access(request.uri().path());
    if route_access == RouteAccess::Open {
        return next.run(request).await;
    }
    match admit(&app, route_access, &mut request).await {
        Ok(None) => next.run(request).await,
        Ok(Some(answer)) => answer,
        Err(problem) => problem.into_response(),
    }
}

/// Lets a request in; an answer where that is all there is to say.
async fn admit(
    app: &App,
    route_access: RouteAccess,
    request: &mut Request,
) -> Result<Option<Response>, Problem> {
    let address = request.extensions().get::<ConnectInfo<SocketAddr>>().map(|info| info.0.ip());
    let needs_key = match route_access {
        RouteAccess::Metrics => app.shared.config.guard.metrics_need_key,
        _ => app.shared.config.guard.require_keys || app.shared.store.any_keys().await?,
    };
    let limits = app.shared.config.guard.limits(!app.shared.config.listen.ip().is_loopback());
    let caller = if needs_key {
        let key = good_key(app, request.headers()).await?;
        Caller::with_key(key, limits)
    } else if route_access == RouteAccess::Metrics {
        return Ok(None);
    } else {
        Caller::without_key(address, limits)
    };
    if let Some(admitted) = request.extensions().get::<AdmittedCaller>() {
        admitted.is(&caller);
    }
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    if route_access == RouteAccess::Api {
        let scope = if method.is_safe() { Scope::Read } else { Scope::Submit };
        if !caller.may(scope) {
            let name = scope.as_str();
            return Err(Problem::insufficient_scope(format!("the key lacks the scope {name:?}")));
        }
    }
    if !makes_room(&method, &path)
        && let Some(rate) = caller.limits.requests_per_s
    {
        let name = match caller.key() {
            Some(key) => key.id.clone(),
            None => address.map(access::counted_as).unwrap_or_default(),
        };
        app.rates.take(&name, rate, Instant::now()).map_err(|wait| {
            app.shared.metrics.count_refusal("requests_per_second");
            let detail = format!("more than {rate} requests a second; slow down");
            Problem::over_limit("requests_per_second", detail, wait.as_secs_f64())
        })?;
    }
    if brings_work(&method, &path)
        && let Some(detail) = app.shared.disk.shortage()
    {
        app.shared.metrics.count_refusal("disk");
        return Err(Problem::disk_full(detail));
    }
    if !caller.sees_all()
        && let Some(answer) = hide_foreign(app, &caller, request).await?
    {
        return Ok(Some(answer));
    }
    tracing::Span::current().record("key", caller.owner());
    request.extensions_mut().insert(caller);
    Ok(None)
}

/// The key that a request carries, if it is good.
async fn good_key(app: &App, headers: &HeaderMap) -> Result<crate::api::keys::KeyRecord, Problem> {
    let Some(header) = headers.get(header::AUTHORIZATION) else {
        let detail = "send an API key: Authorization: Bearer hmx_…; `hemilux keys add` makes one";
        return Err(Problem::unauthenticated(detail, false));
    };
    let wrong = || Problem::unauthenticated("the API key is unknown, expired or revoked", true);
    let (scheme, key) =
        header.to_str().ok().and_then(|value| value.split_once(' ')).ok_or_else(wrong)?;
    if !scheme.eq_ignore_ascii_case("bearer") {
        return Err(wrong());
    }
    let record = app.shared.store.key(&access::hash(key.trim())).await?.ok_or_else(wrong)?;
    let now = Timestamp::now();
    if !record.is_good(now) {
        return Err(wrong());
    }
    if app.key_uses.is_news(&record.id) {
        let (store, id) = (app.shared.store.clone(), record.id.clone());
        tokio::spawn(async move {
            if let Err(error) = store.key_used(&id, now).await {
                tracing::warn!(%error, key = id, "cannot note the use of a key");
            }
        });
    }
    Ok(record)
}

/// Makes what belongs to others look as if it were not there.
async fn hide_foreign(
    app: &App,
    caller: &Caller,
    request: &mut Request,
) -> Result<Option<Response>, Problem> {
    let path = request.uri().path();
    let is_job = path.starts_with("/v1/jobs/");
    let what = match path {
        _ if is_job => "job",
        _ if path.starts_with("/v1/scenes/") => "scene",
        _ if path.starts_with("/v1/environments/") => "environment",
        _ => return Ok(None),
    };
    let method = request.method().clone();
    // "/v1/jobs/{id}" and their like have three parts behind the empty first one.
    let is_whole = path.split('/').count() == 4;
    let params = request.extract_parts::<RawPathParams>().await.ok();
    let id = params.as_ref().and_then(|params| params.iter().find(|(name, _)| *name == "id"));
    // Without an id no route matched; what answers then shows nothing.
    let Some((_, id)) = id else { return Ok(None) };
    let is_own = if is_job {
        match id.parse::<Uuid>() {
            Ok(id) => app.shared.store.job_owner(id).await?.as_deref() == Some(caller.owner()),
            Err(_) => false,
        }
    } else {
        app.shared.store.holds_scene(id, caller.billed_to()).await?
    };
    if is_own {
        return Ok(None);
    }
    if is_whole && method == Method::DELETE {
        // As for what is not there.
        return Ok(Some(StatusCode::NO_CONTENT.into_response()));
    }
    Err(Problem::not_found(format!("there is no such {what}")))
}

impl<S: Send + Sync> FromRequestParts<S> for Caller {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Problem> {
        // Every route of the API lies behind the middleware.
        let caller = parts.extensions.get::<Self>().cloned();
        caller.ok_or_else(|| Problem::internal("the request was not checked"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_api_is_closed_and_the_rest_is_open() {
        for path in ["/v1", "/v1/", "/v1/jobs", "/v1/anything/new"] {
            assert_eq!(route_access(path), RouteAccess::Api, "{path}");
        }
        for path in ["/", "/livez", "/readyz", "/openapi.yaml", "/docs/", "/assets/app.js"] {
            assert_eq!(route_access(path), RouteAccess::Open, "{path}");
        }
        assert_eq!(route_access("/metrics"), RouteAccess::Metrics);
    }

    #[test]
    fn ends_are_let_through_and_beginnings_are_counted() {
        assert!(makes_room(&Method::POST, "/v1/jobs/x/cancel"));
        assert!(makes_room(&Method::DELETE, "/v1/jobs/x"));
        assert!(!makes_room(&Method::POST, "/v1/jobs"));
        assert!(!makes_room(&Method::GET, "/v1/jobs/x"));
        assert!(brings_work(&Method::POST, "/v1/jobs") && brings_work(&Method::POST, "/v1/scenes"));
        assert!(!brings_work(&Method::POST, "/v1/jobs/x/cancel"));
        assert!(!brings_work(&Method::POST, "/v1/jobs/x/pin"));
        assert!(!brings_work(&Method::GET, "/v1/jobs"));
    }
}
