//! Keeps web pages of other sites away from a service that trusts whoever reaches it.
//!
//! A browser on the same machine reaches loopback too. Two ways in are closed: a page of another
//! origin posting a form (browsers mark it `Sec-Fetch-Site: cross-site`), and a host name that an
//! attacker rebinds to 127.0.0.1 (it shows in `Host`).

use super::App;
use super::problem::Problem;
use axum::extract::{Request, State};
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::IpAddr;

/// Refuses requests that a page of another site sent.
pub async fn refuse_foreign_pages(State(app): State<App>, request: Request, next: Next) -> Response {
    let header = |name| request.headers().get(name).and_then(|value| value.to_str().ok());
    if header(header::HeaderName::from_static("sec-fetch-site")) == Some("cross-site")
        && !request.method().is_safe()
    {
        return Problem::forbidden("a page of another site sent this request").into_response();
    }
    if app.config.listen.ip().is_loopback()
        && let Some(host) = header(header::HOST)
        && !is_loopback_host(host)
    {
        let detail = "the Host header must be localhost or a loopback address; listen with --allow-remote to serve other names";
        return Problem::forbidden(detail).into_response();
    }
    next.run(request).await
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
        for host in ["localhost", "LOCALHOST:8080", "127.0.0.1", "127.0.0.1:80", "[::1]:8080", "[::1]"] {
            assert!(is_loopback_host(host), "{host}");
        }
        for host in ["example.org", "localhost.example.org:80", "10.0.0.1", "127.0.0.1.nip.io", ""] {
            assert!(!is_loopback_host(host), "{host}");
        }
    }
}
