//! Keeps web pages of other sites away from a service that trusts whoever reaches it.
//!
//! A browser on the same machine reaches loopback too. Two ways in are closed: a page of another
//! origin posting a form (browsers mark it `Sec-Fetch-Site: cross-site`), and a host name that an
//! attacker rebinds to 127.0.0.1 (it shows in `Host`).

use super::App;
use super::problem::Problem;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::IpAddr;

/// Refuses requests that a page of another site sent.
pub async fn refuse_foreign_pages(
    State(app): State<App>,
    request: Request,
    next: Next,
) -> Response {
    let on_loopback = !app.config.allow_remote && app.config.listen.ip().is_loopback();
    let origins = &app.config.guard.cors_origin;
    match refusal(on_loopback, origins, request.method(), request.headers()) {
        Some(detail) => Problem::forbidden(detail).into_response(),
        None => next.run(request).await,
    }
}

fn refusal(
    on_loopback: bool,
    origins: &[HeaderValue],
    method: &Method,
    headers: &HeaderMap,
) -> Option<&'static str> {
    let header = |name: &str| headers.get(name).and_then(|value| value.to_str().ok());
    let is_invited = headers.get("origin").is_some_and(|origin| origins.contains(origin));
    if header("sec-fetch-site") == Some("cross-site") && !method.is_safe() && !is_invited {
        return Some("a page of another site sent this request");
    }
    if on_loopback && header("host").is_some_and(|host| !is_loopback_host(host)) {
        return Some(
            "the Host header must be localhost or a loopback address; listen with --allow-remote to serve other names",
        );
    }
    None
}

fn is_loopback_host(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(v6) => v6.split(']').next().unwrap_or(v6),
        None => host.rsplit_once(':').map_or(host, |(name, _port)| name),
    };
    name.eq_ignore_ascii_case("localhost")
        || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::is_loopback_host;

    #[test]
    fn only_loopback_names_pass() {
        for host in
            ["localhost", "LOCALHOST:8080", "127.0.0.1", "127.0.0.1:80", "[::1]:8080", "[::1]"]
        {
            assert!(is_loopback_host(host), "{host}");
        }
        for host in ["example.org", "localhost.example.org:80", "10.0.0.1", "127.0.0.1.nip.io", ""]
        {
            assert!(!is_loopback_host(host), "{host}");
        }
    }
}
