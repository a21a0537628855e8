//! The audit log: who made, changed, removed or took what, one line for each such request.
//!
//! It is written in one place, by method and path, so that no handler can forget it: whatever
//! changes something under `/v1` is in it, routes that nobody thought of here included. A line is one
//! JSON object, whatever the format of the rest of the log; what clients send stands in it as JSON
//! strings, cut where they are long, so nobody can write lines of their own. Keys, secrets and
//! queries are never in it.

use super::app::App;
use crate::access::Caller;
use crate::trace_context::RequestId;
use axum::body::HttpBody;
use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use jiff::Timestamp;
use percent_encoding::percent_decode_str;
use serde::Serialize;
use std::borrow::Cow;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, OnceLock};

/// Longest part of a path that is written.
const MAX_CHARS: usize = 128;

/// Carried by a request to where it is let in, which notes the caller here.
#[derive(Clone, Default)]
pub struct AdmittedCaller(Arc<OnceLock<Caller>>);

impl AdmittedCaller {
    /// Notes who it is.
    pub fn is(&self, caller: &Caller) {
        // A request is let in once.
        let _ = self.0.set(caller.clone());
    }
}

/// What a request is about, by its method and path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Subject<'a> {
    action: &'static str,
    job: Option<&'a str>,
    scene: Option<&'a str>,
    environment: Option<&'a str>,
}

/// Whether a query asks for pictures within events; names of parameters may come in any spelling.
fn inlines(query: &str) -> bool {
    query.split('&').any(|pair| {
        let name = pair.split('=').next().unwrap_or_default();
        percent_decode_str(name).eq(b"inline".iter().copied())
    })
}

fn subject<'a>(method: &Method, path: &'a str, query: &str) -> Option<Subject<'a>> {
    let rest = path.strip_prefix("/v1/")?;
    let parts: Vec<&str> = rest.split('/').collect();
    let (read, post, delete) =
        (method == Method::GET, method == Method::POST, method == Method::DELETE);
    if let ["environments", rest @ ..] = &parts[..] {
        let (action, environment) = match rest {
            [] if post => ("environment.create", None),
            [id] if delete => ("environment.delete", Some(*id)),
            _ if !method.is_safe() => ("other", rest.first().copied()),
            _ => return None,
        };
        return Some(Subject { action, job: None, scene: None, environment });
    }
    let (action, job, scene) = match parts[..] {
        ["jobs"] if post => ("job.create", None, None),
        ["jobs", id] if delete => ("job.delete", Some(id), None),
        ["jobs", id, "cancel"] if post => ("job.cancel", Some(id), None),
        ["jobs", id, "extend"] if post => ("job.extend", Some(id), None),
        ["jobs", id, "views"] if post => ("job.view", Some(id), None),
        ["jobs", id, "pin"] if post => ("job.pin", Some(id), None),
        ["jobs", id, "pin"] if delete => ("job.unpin", Some(id), None),
        ["jobs", id, "image" | "image.png" | "image.exr"] if read => {
            ("picture.download", Some(id), None)
        }
        ["jobs", id, "snapshots", _] if read => ("picture.download", Some(id), None),
        ["jobs", id, "events"] if read && inlines(query) => ("picture.download", Some(id), None),
        ["jobs", id, "solution.glb"] if read => ("solution.download", Some(id), None),
        ["scenes"] if post => ("scene.create", None, None),
        ["scenes", id] if delete => ("scene.delete", None, Some(id)),
        ["jobs", id, ..] if !method.is_safe() => ("other", Some(id), None),
        ["scenes", id, ..] if !method.is_safe() => ("other", None, Some(id)),
        _ if !method.is_safe() => ("other", None, None),
        _ => return None,
    };
    Some(Subject { action, job, scene, environment: None })
}

/// One line.
#[derive(Serialize)]
struct Line<'a> {
    time: String,
    target: &'static str,
    level: &'static str,
    action: &'static str,
    method: &'a str,
    /// Of the answer; where the client went away before there was one, nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    status: Option<u16>,
    /// Whether the client went away before the answer: what it asked for may be done all the same.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    broken_off: bool,
    /// The key's id and name; without keys, nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    key: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    key_name: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    address: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    job: Option<Cow<'a, str>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scene: Option<Cow<'a, str>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    environment: Option<Cow<'a, str>>,
    /// Where the answer says that what was made lies.
    #[serde(skip_serializing_if = "Option::is_none")]
    made: Option<Cow<'a, str>>,
    request_id: &'a str,
    /// Bytes that the request announced to send.
    #[serde(skip_serializing_if = "Option::is_none")]
    bytes_sent: Option<u64>,
    /// Bytes of the answer, where it says so beforehand.
    #[serde(skip_serializing_if = "Option::is_none")]
    bytes_asked: Option<u64>,
    /// Lines of requests that were not let in and that were left out since the last one of these.
    #[serde(skip_serializing_if = "Option::is_none")]
    left_out: Option<u64>,
}

/// What is known of a request that is worth a line. The line is written when this is dropped: also
/// where the client goes away in the middle, and the handler with it.
struct Entry {
    app: App,
    method: Method,
    path: String,
    query: String,
    caller: AdmittedCaller,
    address: Option<IpAddr>,
    request_id: String,
    bytes_sent: Option<u64>,
    answer: Option<Answer>,
}

/// What an answer says about itself.
struct Answer {
    status: StatusCode,
    location: Option<String>,
    size: Option<u64>,
}

impl Answer {
    fn of(response: &Response) -> Self {
        let location = response.headers().get(header::LOCATION);
        Self {
            status: response.status(),
            location: location.and_then(|value| value.to_str().ok()).map(str::to_owned),
            size: length(response.headers()).or_else(|| response.body().size_hint().exact()),
        }
    }
}

impl Drop for Entry {
    fn drop(&mut self) {
        let Some(subject) = subject(&self.method, &self.path, &self.query) else { return };
        let audit = &self.app.audit;
        let left_out = match self.caller.0.get() {
            Some(_) => None,
            // Whoever has no key can send any number of these.
            None => match audit.next_of_strangers() {
                Some(left_out) => Some(left_out).filter(|left_out| *left_out > 0),
                None => return,
            },
        };
        let key = self.caller.0.get().and_then(Caller::key);
        let answer = self.answer.as_ref();
        let good = answer.filter(|answer| answer.status.is_success());
        let line = Line {
            time: Timestamp::now().to_string(),
            target: "audit",
            level: "INFO",
            action: subject.action,
            method: self.method.as_str(),
            status: answer.map(|answer| answer.status.as_u16()),
            broken_off: answer.is_none(),
            key: key.map(|key| key.id.as_str()),
            key_name: key.map(|key| key.name.as_str()),
            address: self.address.map(|address| address.to_canonical().to_string()),
            job: subject.job.map(cut),
            scene: subject.scene.map(cut),
            environment: subject.environment.map(cut),
            made: good.and_then(|answer| answer.location.as_deref()).map(cut),
            request_id: &self.request_id,
            bytes_sent: self.bytes_sent,
            bytes_asked: good
                .and_then(|answer| answer.size)
                .filter(|_| subject.action.ends_with(".download")),
            left_out,
        };
        match serde_json::to_vec(&line) {
            Ok(mut text) => {
                text.push(b'\n');
                if let Err(error) = audit.write(&text) {
                    tracing::error!(%error, "cannot write the audit log");
                }
            }
            Err(error) => tracing::error!(%error, "an audit line does not serialise"),
        }
    }
}

/// Middleware: writes a line for each request that is worth one, once its answer begins.
pub async fn write_down(State(app): State<App>, mut request: Request, next: Next) -> Response {
    let uri = request.uri();
    let (path, query) = (uri.path().to_owned(), uri.query().unwrap_or("").to_owned());
    let method = request.method().clone();
    if !app.audit.is_wanted() || subject(&method, &path, &query).is_none() {
        return next.run(request).await;
    }
    let extensions = request.extensions();
    let caller = AdmittedCaller::default();
    let mut entry = Entry {
        address: extensions.get::<ConnectInfo<SocketAddr>>().map(|info| info.0.ip()),
        request_id: extensions.get::<RequestId>().map(|id| id.0.clone()).unwrap_or_default(),
        bytes_sent: length(request.headers()).filter(|_| !method.is_safe()),
        caller: caller.clone(),
        answer: None,
        app,
        method,
        path,
        query,
    };
    request.extensions_mut().insert(caller);
    let response = next.run(request).await;
    entry.answer = Some(Answer::of(&response));
    response
}

fn length(headers: &HeaderMap) -> Option<u64> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

fn cut(text: &str) -> Cow<'_, str> {
    match text.char_indices().nth(MAX_CHARS) {
        None => text.into(),
        Some((end, _)) => format!("{}…", &text[..end]).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_change_is_in_it_and_of_what_is_read_the_pictures() {
        let action =
            |method: Method, path: &str| subject(&method, path, "").map(|subject| subject.action);
        for (path, expected) in [
            ("/v1/jobs", "job.create"),
            ("/v1/jobs/x/cancel", "job.cancel"),
            ("/v1/jobs/x/extend", "job.extend"),
            ("/v1/jobs/x/views", "job.view"),
            ("/v1/jobs/x/pin", "job.pin"),
            ("/v1/scenes", "scene.create"),
            ("/v1/environments", "environment.create"),
            ("/v1/environments/x/share", "other"),
            // What nobody thought of is in it all the same.
            ("/v1/jobs/x/sell", "other"),
            ("/v1/anything", "other"),
        ] {
            assert_eq!(action(Method::POST, path), Some(expected), "{path}");
        }
        assert_eq!(action(Method::DELETE, "/v1/jobs/x"), Some("job.delete"));
        assert_eq!(action(Method::DELETE, "/v1/jobs/x/pin"), Some("job.unpin"));
        assert_eq!(action(Method::DELETE, "/v1/scenes/x"), Some("scene.delete"));
        assert_eq!(action(Method::DELETE, "/v1/environments/x"), Some("environment.delete"));
        assert_eq!(action(Method::GET, "/v1/environments/x"), None);
        assert_eq!(action(Method::PUT, "/v1/jobs/x"), Some("other"));
        for path in ["image", "image.png", "image.exr", "snapshots/0.png"] {
            let path = format!("/v1/jobs/x/{path}");
            assert_eq!(action(Method::GET, &path), Some("picture.download"), "{path}");
        }
        assert_eq!(action(Method::GET, "/v1/jobs/x/solution.glb"), Some("solution.download"));
        for path in ["/v1/jobs", "/v1/jobs/x", "/v1/jobs/x/events", "/v1/scenes/x", "/metrics"] {
            assert_eq!(action(Method::GET, path), None, "{path}");
        }
        let inline = subject(&Method::GET, "/v1/jobs/x/events", "after=3&inline=exr").unwrap();
        assert_eq!((inline.action, inline.job), ("picture.download", Some("x")));
        for query in ["%69nline=exr", "after=3&inl%69ne=png"] {
            assert!(subject(&Method::GET, "/v1/jobs/x/events", query).is_some(), "{query}");
        }
        assert_eq!(subject(&Method::GET, "/v1/jobs/x/events", "after=inline"), None);
        assert_eq!(action(Method::POST, "/docs"), None);
    }

    #[test]
    fn long_words_are_cut() {
        assert_eq!(cut("short"), "short");
        assert_eq!(cut(&"ä".repeat(500)).chars().count(), MAX_CHARS + 1);
    }
}
