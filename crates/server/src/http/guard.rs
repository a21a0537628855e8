//! Keeps web pages of other sites away from a service that a browser on this machine, or in this
//! network, can reach.
//!
//! A page can make its visitor's browser send requests anywhere. Without API keys whoever reaches
//! the service may use it, so two ways in are closed. A page of another origin may send a form:
//! browsers say where it comes from in `Origin`, and how far away that is in `Sec-Fetch-Site`.
//! Another port of the same host is another origin, although the same *site*. And a name that an
//! attacker owns may lead to this server's address all of a sudden (DNS rebinding), so that their
//! page is of the same origin: the name shows in `Host`.

use super::app::App;
use super::problem::Problem;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::{IpAddr, Ipv6Addr};

/// Middleware: refuses requests that a page of another site sent.
pub async fn refuse_foreign_pages(
    State(app): State<App>,
    request: Request,
    next: Next,
) -> Response {
    let guard = &app.shared.config.guard;
    let foreign = foreign_page(&guard.cors_origin, request.method(), request.headers());
    if let Some(detail) = foreign {
        return Problem::forbidden(detail).into_response();
    }
    // Probes say nothing that a page could use, and come by any name.
    let is_probe = matches!(request.uri().path(), "/livez" | "/readyz");
    if !is_probe && let Some(name) = foreign_name(&guard.allowed_host, request.headers()) {
        // A page under a foreign name knows no key, so where keys are asked for any name will do.
        let asks_for_keys =
            guard.require_keys || app.shared.store.any_keys().await.unwrap_or(false);
        if !asks_for_keys {
            let detail = format!(
                "the Host header says {name:?}; without API keys the server answers only where it is called by an IP address, localhost or a name of --allowed-host (HEMILUX_ALLOWED_HOST): name it there, or make a key with `hemilux keys add`"
            );
            return Problem::forbidden(detail).into_response();
        }
    }
    next.run(request).await
}

/// Why a request that changes something must have been sent by a page that is not the server's own
/// and not invited, if so. What is no browser says nothing of the kind.
fn foreign_page(invited: &[HeaderValue], method: &Method, headers: &HeaderMap) -> Option<String> {
    let origin = headers.get(header::ORIGIN);
    if method.is_safe() || origin.is_some_and(|origin| invited.contains(origin)) {
        return None;
    }
    let remedy = "its operator can invite its origin with --cors-origin";
    let site = headers.get("sec-fetch-site").map(HeaderValue::as_bytes);
    if matches!(site, Some(b"cross-site" | b"same-site")) {
        return Some(format!("a page of another origin sent this request; {remedy}"));
    }
    let origin = origin?.to_str().unwrap_or("");
    let host = host(headers);
    if is_same_origin(origin, host) {
        return None;
    }
    Some(format!(
        "a page of {origin:?} sent this request to {host:?}, which is another origin; {remedy}, and a proxy in between must pass the Host header on"
    ))
}

/// The name that a request calls the server by, where an attacker may have made that name lead
/// here: it is no address, not `localhost`, and not one that the operator has named.
fn foreign_name<'a>(allowed: &[String], headers: &'a HeaderMap) -> Option<&'a str> {
    // Browsers always send it.
    headers.get(header::HOST)?;
    let host = host(headers);
    let is_good = split(host).is_some_and(|(name, _)| {
        is_address(name)
            || name.eq_ignore_ascii_case("localhost")
            || allowed.iter().any(|allowed| allowed.eq_ignore_ascii_case(name))
    });
    (!is_good).then_some(host)
}

fn host(headers: &HeaderMap) -> &str {
    headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or("")
}

/// Whether a page of `origin` is one of this server, which was called by `host`. The schemes may
/// differ: behind a proxy that ends TLS, the page's is https and the server's http.
fn is_same_origin(origin: &str, host: &str) -> bool {
    let (authority, default) = if let Some(authority) = origin.strip_prefix("https://") {
        (authority, 443)
    } else if let Some(authority) = origin.strip_prefix("http://") {
        (authority, 80)
    } else {
        return false;
    };
    let (Some((of_page, port)), Some((called, called_port))) = (split(authority), split(host))
    else {
        return false;
    };
    of_page.eq_ignore_ascii_case(called)
        && port.unwrap_or(default) == called_port.unwrap_or(default)
}

/// Name and port of an authority; the brackets of an IPv6 address stay.
fn split(authority: &str) -> Option<(&str, Option<u16>)> {
    let end = match authority.strip_prefix('[') {
        Some(rest) => rest.find(']')? + 2,
        None => authority.find(':').unwrap_or(authority.len()),
    };
    let (name, rest) = authority.split_at(end);
    let port = match rest {
        "" => None,
        rest => Some(rest.strip_prefix(':')?.parse().ok()?),
    };
    (!name.is_empty()).then_some((name, port))
}

fn is_address(name: &str) -> bool {
    match name.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
        Some(v6) => v6.parse::<Ipv6Addr>().is_ok(),
        None => name.parse::<IpAddr>().is_ok_and(|address| address.is_ipv4()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        pairs
            .iter()
            .map(|(name, value)| ((*name).parse().unwrap(), value.parse().unwrap()))
            .collect()
    }

    #[test]
    fn only_names_that_nobody_else_can_own_pass() {
        let allowed = ["render.example.org".to_owned()];
        let foreign = |host: &str| foreign_name(&allowed, &headers(&[("host", host)])).is_some();
        for host in [
            "localhost",
            "LOCALHOST:8080",
            "127.0.0.1",
            "10.0.0.1:80",
            "[::1]:8080",
            "[fd00::1]",
            "render.example.org",
            "Render.Example.org:8443",
        ] {
            assert!(!foreign(host), "{host}");
        }
        for host in [
            "example.org",
            "localhost.example.org:80",
            "127.0.0.1.nip.io",
            "evil.localhost",
            "x.render.example.org",
            "localhost:1:2",
            "localhost@evil.example",
            "[::1",
            "[::1]x",
            "::1",
            "[127.0.0.1]",
            "",
        ] {
            assert!(foreign(host), "{host}");
        }
        assert!(foreign_name(&allowed, &HeaderMap::new()).is_none());
    }

    #[test]
    fn origins_are_compared_with_what_the_server_was_called() {
        for (origin, host) in [
            ("http://localhost:8080", "localhost:8080"),
            ("http://127.0.0.1", "127.0.0.1:80"),
            ("https://render.example.org", "render.example.org"),
            ("https://render.example.org", "Render.example.org:443"),
            ("https://render.example.org:8443", "render.example.org:8443"),
            ("http://[::1]:8080", "[::1]:8080"),
        ] {
            assert!(is_same_origin(origin, host), "{origin} {host}");
        }
        for (origin, host) in [
            ("http://localhost:8081", "localhost:8080"),
            ("http://localhost", "localhost:8080"),
            ("http://localhost:8080", "127.0.0.1:8080"),
            ("https://render.example.org", "render.example.org:80"),
            ("https://evil.example", "render.example.org"),
            ("file://localhost:8080", "localhost:8080"),
            ("null", "null"),
            ("", ""),
        ] {
            assert!(!is_same_origin(origin, host), "{origin} {host}");
        }
    }

    #[test]
    fn pages_of_other_origins_change_nothing() {
        let invited = [HeaderValue::from_static("https://app.example.org")];
        let refused = |method: Method, pairs: &[(&'static str, &str)]| {
            let pairs = [&[("host", "localhost:8080")], pairs].concat();
            foreign_page(&invited, &method, &headers(&pairs)).is_some()
        };
        let own = ("origin", "http://localhost:8080");
        let other = ("origin", "http://localhost:8081");
        let guest = ("origin", "https://app.example.org");
        for method in [Method::POST, Method::DELETE, Method::PUT] {
            assert!(refused(method.clone(), &[other]));
            assert!(refused(method.clone(), &[("origin", "null")]));
            for site in ["cross-site", "same-site"] {
                assert!(refused(method.clone(), &[("sec-fetch-site", site)]), "{site}");
                assert!(refused(method.clone(), &[own, ("sec-fetch-site", site)]), "{site}");
                assert!(!refused(method.clone(), &[guest, ("sec-fetch-site", site)]), "{site}");
            }
            for site in ["same-origin", "none"] {
                assert!(!refused(method.clone(), &[own, ("sec-fetch-site", site)]), "{site}");
                assert!(refused(method.clone(), &[other, ("sec-fetch-site", site)]), "{site}");
            }
            assert!(!refused(method, &[]));
        }
        assert!(!refused(Method::GET, &[other, ("sec-fetch-site", "cross-site")]));
    }
}
