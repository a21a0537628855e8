//! Request ids and W3C trace context: what ties a line of the log to a request, and a job to the
//! request that asked for it, across programs.

use axum::http::HeaderMap;

/// The header that carries request ids in and out.
pub const REQUEST_ID: &str = "x-request-id";
/// The W3C header.
pub const TRACE_PARENT: &str = "traceparent";
/// Longest request id that is taken over from a client.
const MAX_ID_BYTES: usize = 128;

/// A request's id: the client's own where it sends a sensible one, else a new one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RequestId(pub String);

impl RequestId {
    /// The id of a request with these headers.
    pub fn of(headers: &HeaderMap) -> Self {
        let sent = headers.get(REQUEST_ID).and_then(|value| value.to_str().ok()).unwrap_or("");
        let is_fit = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.:/+=".contains(&byte);
        if (1..=MAX_ID_BYTES).contains(&sent.len()) && sent.bytes().all(is_fit) {
            return Self(sent.to_owned());
        }
        Self(uuid::Uuid::now_v7().to_string())
    }
}

/// A valid `traceparent`: version, trace id, parent id, flags.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraceParent(String);

impl TraceParent {
    /// Reads the header; `None` where it is missing or not as W3C Trace Context has it.
    pub fn of(headers: &HeaderMap) -> Option<Self> {
        let mut values = headers.get_all(TRACE_PARENT).iter();
        match (values.next(), values.next()) {
            (Some(only), None) => Self::parse(only.to_str().ok()?),
            _ => None,
        }
    }

    /// Reads a header's text.
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        let mut parts = text.split('-');
        let (version, trace, parent, flags) =
            (parts.next()?, parts.next()?, parts.next()?, parts.next()?);
        let is_hex = |part: &str, length: usize| {
            part.len() == length
                && part.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
        };
        let is_something = |part: &str| part.bytes().any(|byte| byte != b'0');
        let is_known = version == "00" && parts.next().is_none();
        // Later versions may have more parts, and are read as far as they are understood.
        let is_later = version != "00" && version != "ff" && is_hex(version, 2);
        ((is_known || is_later)
            && is_hex(trace, 32)
            && is_something(trace)
            && is_hex(parent, 16)
            && is_something(parent)
            && is_hex(flags, 2))
        .then(|| Self(format!("00-{trace}-{parent}-{flags}")))
    }

    /// The header's text, as version 00.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The trace's id, 32 hex digits.
    pub fn trace_id(&self) -> &str {
        &self.0[3..35]
    }

    /// The id of the span that sent the request, 16 hex digits.
    pub fn parent_id(&self) -> &str {
        &self.0[36..52]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";

    #[test]
    fn only_what_w3c_allows_is_a_trace_parent() {
        let parent = TraceParent::parse(GOOD).unwrap();
        assert_eq!(parent.as_str(), GOOD);
        assert_eq!(parent.trace_id(), "0af7651916cd43dd8448eb211c80319c");
        assert_eq!(parent.parent_id(), "b7ad6b7169203331");
        let later = GOOD.replacen("00-", "cc-", 1) + "-what-the-future-will-be-like";
        assert_eq!(TraceParent::parse(&later).unwrap().as_str(), GOOD);
        for bad in [
            "",
            "00",
            &GOOD.to_uppercase(),
            &GOOD.replacen("00-", "ff-", 1),
            &(GOOD.to_owned() + "-more"),
            &GOOD.replace("0af7651916cd43dd8448eb211c80319c", &"0".repeat(32)),
            &GOOD.replace("b7ad6b7169203331", &"0".repeat(16)),
            &GOOD[..54],
            &GOOD.replace("b7ad", "b7aé"),
        ] {
            assert_eq!(TraceParent::parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn request_ids_are_the_clients_where_sensible() {
        let id = |text: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(REQUEST_ID, text.parse().unwrap());
            RequestId::of(&headers).0
        };
        assert_eq!(id("abc-1.2:3"), "abc-1.2:3");
        for odd in ["", "a b", "a\"b", &"x".repeat(129)] {
            assert_ne!(id(odd), odd);
        }
        assert_ne!(RequestId::of(&HeaderMap::new()), RequestId::of(&HeaderMap::new()));
    }
}
