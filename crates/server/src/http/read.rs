//! Reading requests: JSON with the field named in the error, ids, queries.

use super::problem::Problem;
use crate::api::FieldError;
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use serde::de::{DeserializeOwned, IgnoredAny};
use uuid::Uuid;

/// Largest JSON request, bytes.
pub const MAX_JSON_BYTES: usize = 256 << 10;

/// Parses a JSON document; 400 where it is no JSON, 422 naming the field where it does not fit.
pub fn json<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    parse(bytes).map_err(|error| match error {
        JsonError::Syntax(text) => Problem::unreadable(format!("not valid JSON: {text}")),
        JsonError::Field(error) => Problem::invalid(vec![error]),
    })
}

/// Parses a part of a form; the form itself is readable, so whatever is wrong is 422.
pub fn json_part<T: DeserializeOwned>(name: &str, bytes: &[u8]) -> Result<T, Problem> {
    parse(bytes).map_err(|error| {
        Problem::invalid(vec![match error {
            JsonError::Syntax(text) => FieldError::new(name, format!("not valid JSON: {text}")),
            JsonError::Field(error) => error,
        }])
    })
}

enum JsonError {
    Syntax(String),
    Field(FieldError),
}

fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, JsonError> {
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let field = error.path().to_string();
        let inner = error.into_inner();
        if inner.classify() == serde_json::error::Category::Data {
            let detail = inner.to_string();
            JsonError::Field(FieldError::new(whole_path(field, &detail), detail))
        } else if serde_json::from_slice::<IgnoredAny>(bytes).is_ok() {
            // The parser says "syntax" too where a word must stand and something else does.
            let detail = format!("is of a kind that does not belong here: {inner}");
            JsonError::Field(FieldError::new(field, detail))
        } else {
            JsonError::Syntax(inner.to_string())
        }
    })?;
    deserializer.end().map_err(|error| JsonError::Syntax(error.to_string()))?;
    Ok(value)
}

/// The path of what an error is about: of a field that is missing, its own, not that of the object
/// that should have it.
fn whole_path(path: String, detail: &str) -> String {
    let rest = detail.strip_prefix("missing field `");
    match rest.and_then(|rest| rest.split_once('`')) {
        Some((field, _)) if path == "." => field.to_owned(),
        Some((field, _)) => format!("{path}.{field}"),
        None => path,
    }
}

/// The media type of a request's body, lower-case and without parameters.
pub fn media_type(headers: &HeaderMap) -> String {
    let value = headers.get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok()).unwrap_or("");
    value.split(';').next().unwrap_or("").trim().to_ascii_lowercase()
}

/// Whether `Accept` prefers `offered` to `fallback`: it names `offered` and gives it a higher
/// quality than `fallback` gets.
pub fn prefers(headers: &HeaderMap, offered: &str, fallback: &str) -> bool {
    let accept = headers.get(header::ACCEPT).and_then(|v| v.to_str().ok()).unwrap_or("");
    quality(accept, offered) > quality(accept, fallback)
}

/// Quality that an `Accept` value gives to a media type, most specific range first.
fn quality(accept: &str, media_type: &str) -> f32 {
    let group = media_type.split('/').next().unwrap_or("");
    let mut best = (0, 0.0);
    for item in accept.split(',') {
        let mut parts = item.split(';').map(str::trim);
        let range = parts.next().unwrap_or("").to_ascii_lowercase();
        let quality = parts
            .find_map(|parameter| parameter.strip_prefix("q="))
            .and_then(|q| q.parse::<f32>().ok())
            .unwrap_or(1.0);
        let rank = if range == media_type {
            3
        } else if range.strip_suffix("/*") == Some(group) {
            2
        } else if range == "*/*" {
            1
        } else {
            0
        };
        if rank > best.0 {
            best = (rank, quality);
        }
    }
    best.1
}

/// Whether `If-None-Match` says that the client holds what `etag` (quoted, without `W/`) names.
pub fn is_held(headers: &HeaderMap, etag: &str) -> bool {
    let held = headers.get(header::IF_NONE_MATCH).and_then(|value| value.to_str().ok());
    held.is_some_and(|held| {
        held.trim() == "*" || held.split(',').any(|tag| tag.trim().trim_start_matches("W/") == etag)
    })
}

/// The job id in a path. One that is no UUID names no job: 404, not 400.
pub struct JobId(pub Uuid);

impl<S: Send + Sync> FromRequestParts<S> for JobId {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        use axum::extract::RawPathParams;
        let unknown = || Problem::not_found("there is no such job");
        let params =
            RawPathParams::from_request_parts(parts, state).await.map_err(|_| unknown())?;
        params
            .iter()
            .find(|(name, _)| *name == "id")
            .and_then(|(_, value)| value.parse().ok())
            .map(Self)
            .ok_or_else(unknown)
    }
}

/// The query, with unreadable ones answered 400 naming the parameter.
pub struct Query<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequestParts<S> for Query<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Problem> {
        axum::extract::Query::try_from_uri(&parts.uri)
            .map(|axum::extract::Query(value)| Self(value))
            .map_err(|rejection| Problem::unreadable(rejection.body_text()))
    }
}

/// `value` if it lies in the range; else a 400 that says so.
pub fn in_range<T: PartialOrd + std::fmt::Display>(
    name: &str,
    value: T,
    range: std::ops::RangeInclusive<T>,
) -> Result<T, Problem> {
    if range.contains(&value) {
        return Ok(value);
    }
    let detail = format!("must be between {} and {}, is {value}", range.start(), range.end());
    Err(Problem::unreadable(format!("{name} {detail}")).with_error(FieldError::new(name, detail)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accept_follows_quality_and_specificity() {
        let prefers = |accept: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::ACCEPT, accept.parse().unwrap());
            super::prefers(&headers, "image/x-exr", "image/png")
        };
        assert!(prefers("image/x-exr"));
        assert!(prefers("image/png;q=0.5, image/x-exr"));
        assert!(!prefers("*/*"));
        assert!(!prefers("image/*"));
        assert!(!prefers("image/avif,image/png,*/*;q=0.8"));
        assert!(prefers("image/*;q=0.2, image/x-exr;q=0.3"));
    }

    #[test]
    fn a_client_says_what_it_holds() {
        let is_held = |held: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::IF_NONE_MATCH, held.parse().unwrap());
            super::is_held(&headers, "\"a\"")
        };
        assert!(is_held("\"a\"") && is_held("W/\"a\"") && is_held("\"b\", \"a\"") && is_held("*"));
        assert!(!is_held("\"b\"") && !is_held("a") && !is_held(""));
        assert!(!super::is_held(&HeaderMap::new(), "\"a\""));
    }

    #[test]
    fn json_errors_name_the_field() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Inner {
            #[allow(dead_code)]
            n: u32,
        }
        #[derive(Debug, serde::Deserialize)]
        struct Outer {
            #[allow(dead_code)]
            inner: Vec<Inner>,
        }
        let problem = json::<Outer>(br#"{"inner": [{"n": 1}, {"n": -1}]}"#).unwrap_err();
        assert!(format!("{problem:?}").contains("inner[1].n"), "{problem:?}");
        for (text, field) in [("{\"inner\": [{}]}", "\"inner[0].n\""), ("{}", "\"inner\"")] {
            let problem = json::<Outer>(text.as_bytes()).unwrap_err();
            assert!(format!("{problem:?}").contains(field), "{problem:?}");
        }
        #[derive(Debug, serde::Deserialize)]
        #[serde(rename_all = "snake_case")]
        enum Word {
            One,
        }
        assert!(json::<Word>(b"\"one\"").is_ok_and(|word| matches!(word, Word::One)));
        let problem = json::<std::collections::BTreeMap<String, Word>>(b"{\"a\": 1}").unwrap_err();
        assert!(format!("{problem:?}").contains("\"a\""), "{problem:?}");
        let problem = json::<Outer>(b"{").unwrap_err();
        assert!(format!("{problem:?}").contains("not valid JSON"), "{problem:?}");
        assert!(json::<Outer>(br#"{"inner": []} x"#).is_err());
    }
}
