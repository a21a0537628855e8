//! Sending files: piece by piece, whole or in part (RFC 9110, range requests).

use super::problem::Problem;
use super::read::is_held;
use crate::artifacts::{ArtifactError, Opened};
use axum::body::Body;
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use std::convert::Infallible;
use std::ops::Range;

/// What a file is, as far as its headers go.
pub struct Content<'a> {
    /// Hash of the content, in hex; the strong entity tag.
    pub sha256: &'a str,
    /// Media type.
    pub media_type: &'static str,
    /// `Cache-Control`.
    pub cache: &'static str,
}

/// How a file is asked for: by GET or HEAD, and which part of it.
pub struct FileRequest {
    method: Method,
    /// The headers of the request.
    pub headers: HeaderMap,
}

impl<S: Send + Sync> FromRequestParts<S> for FileRequest {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Infallible> {
        Ok(Self { method: parts.method.clone(), headers: parts.headers.clone() })
    }
}

/// Answers a GET or HEAD of a file, which `open` opens where its bytes or its size are needed.
///
/// # Errors
/// As `open`.
pub async fn answer(
    FileRequest { method, headers }: &FileRequest,
    content: Content<'_>,
    open: impl Future<Output = Result<Opened, ArtifactError>>,
) -> Result<Response, Problem> {
    let etag = format!("\"{}\"", content.sha256);
    let tags = [(header::ETAG, etag.clone()), (header::CACHE_CONTROL, content.cache.to_owned())];
    if is_held(headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, tags).into_response());
    }
    let file = open.await?;
    let size = file.size;
    let kind = [
        (header::CONTENT_TYPE, HeaderValue::from_static(content.media_type)),
        (header::ACCEPT_RANGES, HeaderValue::from_static("bytes")),
    ];
    let (status, range) = match wanted(method, headers, &etag, size) {
        Wanted::Whole => (StatusCode::OK, 0..size),
        Wanted::Part(range) => (StatusCode::PARTIAL_CONTENT, range),
        Wanted::Nothing => {
            let detail = format!("the file has {size} bytes; ask for a range within them");
            let mut refusal = Problem::unsatisfiable_range(detail).into_response();
            let all = HeaderValue::try_from(format!("bytes */{size}"));
            refusal.headers_mut().extend(all.ok().map(|all| (header::CONTENT_RANGE, all)));
            return Ok(refusal);
        }
    };
    let length = [(header::CONTENT_LENGTH, range.end - range.start)];
    let length = length.map(|(name, bytes)| (name, HeaderValue::from(bytes)));
    let place = (status == StatusCode::PARTIAL_CONTENT)
        .then(|| [(header::CONTENT_RANGE, content_range(&range, size))]);
    let body = match *method == Method::HEAD {
        true => Body::empty(),
        false => Body::from_stream(file.pieces(range).await?),
    };
    let mut response = (status, tags, kind, length, body).into_response();
    for (name, value) in place.into_iter().flatten() {
        response.headers_mut().extend(value.parse().ok().map(|value| (name, value)));
    }
    Ok(response)
}

/// Where a part lies in the file, as `Content-Range` has it.
fn content_range(range: &Range<u64>, size: u64) -> String {
    format!("bytes {}-{}/{size}", range.start, range.end.saturating_sub(1))
}

/// What of a file a request wants.
#[derive(Debug, PartialEq, Eq)]
enum Wanted {
    Whole,
    Part(Range<u64>),
    /// A range that the file does not have.
    Nothing,
}

/// What a request wants of a file with that entity tag and size. What cannot be read, and several
/// ranges at once, mean the whole file, which every client must be ready for.
fn wanted(method: &Method, headers: &HeaderMap, etag: &str, size: u64) -> Wanted {
    let text = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    let Some(asked) = text(header::RANGE).filter(|_| *method == Method::GET) else {
        return Wanted::Whole;
    };
    // A part of another version is of no use to who has the rest of this one.
    if headers.contains_key(header::IF_RANGE) && text(header::IF_RANGE) != Some(etag) {
        return Wanted::Whole;
    }
    let parsed =
        asked.split_once('=').filter(|(unit, _)| unit.trim().eq_ignore_ascii_case("bytes"));
    let Some((first, last)) = parsed.and_then(|(_, range)| range.trim().split_once('-')) else {
        return Wanted::Whole;
    };
    match (number(first), number(last)) {
        (Some(first), Some(last)) if first > last => Wanted::Whole,
        (Some(first), _) if last.is_empty() || number(last).is_some() => {
            let end = number(last).map_or(size, |last| last.saturating_add(1).min(size));
            if first < size { Wanted::Part(first..end) } else { Wanted::Nothing }
        }
        (None, Some(length)) if first.is_empty() => match length.min(size) {
            0 => Wanted::Nothing,
            length => Wanted::Part(size - length..size),
        },
        _ => Wanted::Whole,
    }
}

/// A position in a file; what is larger than any file is the largest number there is.
fn number(text: &str) -> Option<u64> {
    let digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    digits.then(|| text.parse().unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(range: &str, if_range: Option<&str>) -> Wanted {
        let mut headers = HeaderMap::new();
        headers.insert(header::RANGE, range.parse().unwrap());
        if let Some(tag) = if_range {
            headers.insert(header::IF_RANGE, tag.parse().unwrap());
        }
        wanted(&Method::GET, &headers, "\"a\"", 100)
    }

    #[test]
    fn ranges_are_read_as_the_standard_says() {
        for (range, first, end) in [
            ("bytes=0-0", 0, 1),
            ("bytes=0-", 0, 100),
            ("Bytes=10-19", 10, 20),
            ("bytes=99-99", 99, 100),
            ("bytes=50-1000", 50, 100),
            ("bytes=0-99999999999999999999999999", 0, 100),
            ("bytes=-1", 99, 100),
            ("bytes=-1000", 0, 100),
        ] {
            assert_eq!(of(range, None), Wanted::Part(first..end), "{range}");
            assert_eq!(of(range, Some("\"a\"")), Wanted::Part(first..end), "{range}");
            assert_eq!(of(range, Some("\"b\"")), Wanted::Whole, "{range}");
            assert_eq!(of(range, Some("W/\"a\"")), Wanted::Whole, "{range}");
        }
        for range in ["bytes=100-", "bytes=100-200", "bytes=-0", "bytes=99999999999999999999999-"] {
            assert_eq!(of(range, None), Wanted::Nothing, "{range}");
        }
        for range in
            ["bytes=2-1", "bytes=a-b", "bytes=-", "bytes=", "bytes", "lines=1-2", "bytes=0-1,3-4"]
        {
            assert_eq!(of(range, None), Wanted::Whole, "{range}");
        }
        let mut headers = HeaderMap::new();
        assert_eq!(wanted(&Method::GET, &headers, "\"a\"", 100), Wanted::Whole);
        headers.insert(header::RANGE, "bytes=0-0".parse().unwrap());
        assert_eq!(wanted(&Method::HEAD, &headers, "\"a\"", 100), Wanted::Whole);
    }
}
