//! Webhooks: who is told when a job ends, and what became of it.

use super::{FieldError, instant};
use crate::job_state::JobState;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Longest address.
const MAX_URL_BYTES: usize = 2048;
/// Longest secret.
const MAX_SECRET_BYTES: usize = 256;

/// How a job may end, for whoever is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// The result is there.
    Succeeded,
    /// Given up.
    Failed,
    /// Stopped at the client's wish.
    Cancelled,
}

impl Ending {
    /// Every way to end.
    pub const ALL: [Self; 3] = [Self::Succeeded, Self::Failed, Self::Cancelled];

    /// The state of the job.
    pub fn state(self) -> JobState {
        match self {
            Self::Succeeded => JobState::Succeeded,
            Self::Failed => JobState::Failed,
            Self::Cancelled => JobState::Cancelled,
        }
    }
}

fn every_ending() -> Vec<Ending> {
    Ending::ALL.to_vec()
}

/// Who is told when a job ends.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WebhookTarget {
    /// Where to POST the message; http or https, no user name in it. Addresses inside the
    /// server's own network are refused unless its operator allows them.
    #[schema(
        min_length = 1,
        max_length = 2048,
        pattern = "^https?://[A-Za-z0-9.-]+(:[0-9]{1,5})?(/[!-~]*)?$",
        example = "https://example.org/hemilux"
    )]
    pub url: String,
    /// Which endings to tell of.
    #[serde(default = "every_ending")]
    #[schema(min_items = 1, max_items = 3)]
    pub events: Vec<Ending>,
    /// Signs the messages (HMAC-SHA256). Never shown again.
    #[serde(default, skip_serializing)]
    #[schema(nullable = false, write_only, min_length = 16, max_length = 256)]
    pub secret: Option<String>,
}

impl WebhookTarget {
    /// What is wrong with it, field by field below `at`.
    pub fn problems(&self, at: &str) -> Vec<FieldError> {
        let mut errors = Vec::new();
        let mut wrong = |field: &str, detail: &str| {
            errors.push(FieldError::new(format!("{at}.{field}"), detail));
        };
        if self.url.is_empty()
            || self.url.len() > MAX_URL_BYTES
            || host_and_port(&self.url).is_none()
        {
            wrong(
                "url",
                "must be http:// or https://, a host, and optionally a port and a path, in at most 2048 visible ASCII characters, without a user name",
            );
        }
        if self.events.is_empty() || self.events.len() > Ending::ALL.len() {
            wrong("events", "must name one to three endings; leave it out for all of them");
        }
        if self.secret.as_ref().is_some_and(|s| !(16..=MAX_SECRET_BYTES).contains(&s.len())) {
            wrong("secret", "must have 16 to 256 bytes");
        }
        errors
    }
}

/// Host (an address without brackets) and port of an http or https address; `None` where it is
/// not one that a webhook may have.
pub fn host_and_port(url: &str) -> Option<(String, u16)> {
    if !url.bytes().all(|byte| byte.is_ascii_graphic()) {
        return None;
    }
    let uri: axum::http::Uri = url.parse().ok()?;
    let default = match uri.scheme_str()? {
        "http" => 80,
        "https" => 443,
        _ => return None,
    };
    let authority = uri.authority()?;
    if authority.as_str().contains('@') {
        return None;
    }
    let host = authority.host();
    let host = host.strip_prefix('[').and_then(|h| h.strip_suffix(']')).unwrap_or(host);
    let port = match authority.as_str().strip_prefix(authority.host())? {
        "" => default,
        port => port.strip_prefix(':')?.parse().ok()?,
    };
    (!host.is_empty() && port > 0).then(|| (host.to_owned(), port))
}

/// A message that a webhook is sent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WebhookMessage {
    /// The same in every attempt; what came twice has the same one.
    pub id: String,
    /// How the job ended.
    pub event: Ending,
    /// The job.
    pub job: Uuid,
    /// When it ended.
    #[schema(value_type = String, format = DateTime)]
    #[serde(serialize_with = "instant::serialize")]
    pub ended_at: Timestamp,
    /// Where to read the job.
    pub url: String,
}

/// Where a message to a webhook stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DeliveryState {
    /// To be sent, perhaps again.
    Pending,
    /// The receiver answered 2xx.
    Delivered,
    /// The receiver is gone, or did not answer 2xx for too long.
    GivenUp,
}

/// What became of a message.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Delivery {
    /// The message's id.
    pub id: String,
    /// Its ending.
    pub event: Ending,
    /// Where it goes.
    pub url: String,
    /// Where it stands.
    pub state: DeliveryState,
    /// Times that it was sent.
    pub attempts: u32,
    /// When it is sent next.
    #[schema(required, value_type = Option<String>, format = DateTime)]
    #[serde(serialize_with = "instant::serialize_if_any")]
    pub next_attempt_at: Option<Timestamp>,
    /// When it arrived.
    #[schema(required, value_type = Option<String>, format = DateTime)]
    #[serde(serialize_with = "instant::serialize_if_any")]
    pub delivered_at: Option<Timestamp>,
    /// What came of the last attempt.
    #[schema(required)]
    pub last_answer: Option<String>,
}

/// What became of a job's messages, oldest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeliveryList {
    /// The messages.
    pub deliveries: Vec<Delivery>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_plain_web_addresses_pass() {
        for (url, host, port) in [
            ("https://example.org/a?b=c", "example.org", 443),
            ("http://127.0.0.1:81", "127.0.0.1", 81),
            ("http://[::1]:82/x", "::1", 82),
            ("HTTPS://Example.org", "Example.org", 443),
        ] {
            assert_eq!(host_and_port(url), Some((host.to_owned(), port)), "{url}");
        }
        for url in [
            "",
            "example.org",
            "ftp://example.org",
            "file:///etc/passwd",
            "http://",
            "http://:80/",
            "http://a:0/",
            "http://a:99999/",
            "http://user@host/",
            "http://user:word@host/",
            "http://exa mple.org/",
            "http://example.org/\r\nx: y",
            "//example.org/",
            "/relative",
        ] {
            assert_eq!(host_and_port(url), None, "{url}");
        }
    }

    #[test]
    fn the_secret_is_read_and_never_written() {
        let target: WebhookTarget = serde_json::from_str(
            r#"{"url": "https://example.org/", "secret": "0123456789abcdef"}"#,
        )
        .unwrap();
        assert_eq!(target.secret.as_deref(), Some("0123456789abcdef"));
        assert!(target.problems("webhook").is_empty());
        let shown = serde_json::to_string(&target).unwrap();
        assert!(!shown.contains("0123456789abcdef"), "{shown}");
        let short = WebhookTarget { secret: Some("short".into()), ..target };
        assert_eq!(short.problems("webhook")[0].field, "webhook.secret");
    }
}
