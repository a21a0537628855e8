//! Answers for the API's description: errors, those of them that go together, and files.

use super::problem::ProblemDocument;
use std::collections::BTreeMap;
use utoipa::openapi::{Content, Header, RefOr, Response, ResponseBuilder};
use utoipa::{IntoParams, IntoResponses, PartialSchema};

/// Answers by their status.
type Responses = BTreeMap<String, RefOr<Response>>;

macro_rules! documented {
    ($($name:ident $status:literal $text:literal)*) => {$(
        #[doc = $text]
        #[derive(IntoResponses)]
        #[response(status = $status, description = $text, content_type = "application/problem+json")]
        #[allow(dead_code, reason = "stands for the answer in the API's description")]
        pub struct $name(ProblemDocument);
    )*};
}

documented! {
    BadRequest 400 "The request cannot be read."
    NotFound 404 "There is no such thing."
    TooSlow 408 "The request took too long to arrive."
    Conflict 409 "The idempotency key belongs to another request."
    NotNow 409 "That cannot be done with the job as it is."
    TooLarge 413 "The request is over a size limit."
    UnsupportedMedia 415 "The content type is not supported."
    BadRange 416 "The file has no such part."
    Invalid 422 "Readable, but some fields cannot be met; `errors` names them."
    OverLimit 429 "Too many jobs wait, or a limit of this caller is reached; see `limit` and Retry-After."
}

macro_rules! together {
    ($($(#[$doc:meta])* $name:ident: $($part:ident)*;)*) => {$(
        $(#[$doc])*
        pub struct $name;

        impl IntoResponses for $name {
            fn responses() -> Responses {
                let mut all = Responses::new();
                $(all.extend(<$part as IntoResponses>::responses());)*
                all
            }
        }
    )*};
}

together! {
    /// Errors of a request that only names something.
    Named: BadRequest NotFound;
    /// Answers to who may have the newest already.
    NamedOrNewest: Named Newest;
    /// Errors of a request that sends something.
    Sent: BadRequest TooSlow TooLarge UnsupportedMedia Invalid OverLimit;
    /// Errors of a request that asks more of an ended job.
    SentToEnded: NotFound NotNow Sent;
}

/// Which job is meant.
#[derive(IntoParams)]
#[into_params(parameter_in = Path)]
#[allow(dead_code, reason = "stands for the path in the API's description")]
pub struct OfJob {
    /// The job's id.
    id: uuid::Uuid,
}

/// Where nothing has changed since the client asked last.
#[derive(IntoResponses)]
#[response(status = 304, description = "The client's copy is the newest.")]
pub struct Newest;

/// Which part of a file is wanted.
#[derive(IntoParams)]
#[into_params(parameter_in = Header)]
#[allow(dead_code, reason = "stands for the header in the API's description")]
pub struct RangeHeader {
    /// A part of the file: `bytes=first-last`, `bytes=first-` or `bytes=-length`.
    #[param(rename = "Range")]
    range: Option<String>,
}

macro_rules! files {
    ($($name:ident $media_types:expr, $what:literal, $held:literal;)*) => {$(
        #[doc = $what]
        pub struct $name;

        impl IntoResponses for $name {
            fn responses() -> Responses {
                file(&$media_types, $what, $held)
            }
        }
    )*};
}

files! {
    AnyPicture ["image/png", "image/x-exr"], "The picture.", "The client's copy is the newest.";
    PngPicture ["image/png"], "The picture.", "The client's copy is the newest.";
    ExrPicture ["image/x-exr"], "The picture.", "The client's copy is the newest.";
    Snapshot ["image/png", "image/x-exr"], "The picture.", "The client's copy is good.";
    GlbFile ["model/gltf-binary"], "The file.", "The client's copy is good.";
}

/// The answers to who asks for a file, or for a part of it.
fn file(media_types: &[&str], what: &str, held: &str) -> Responses {
    let header = |description: &str| {
        let mut header = Header::new(String::schema());
        header.description = Some(description.into());
        header
    };
    let sends = |description: &str| {
        let mut response = ResponseBuilder::new()
            .description(description)
            .header("etag", header("Names the content."));
        for media_type in media_types {
            response = response.content(*media_type, Content::new(Some(Vec::<u8>::schema())));
        }
        response
    };
    let part = sends("The part that `Range` asks for.")
        .header("content-range", header("Where the part lies."));
    let mut all = Named::responses();
    all.extend(BadRange::responses());
    all.insert("200".into(), RefOr::T(sends(what).build()));
    all.insert("206".into(), RefOr::T(part.build()));
    all.insert("304".into(), RefOr::T(ResponseBuilder::new().description(held).build()));
    all
}
