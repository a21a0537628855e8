//! Error answers for the API's description.

use super::problem::ProblemDocument;
use utoipa::IntoResponses;

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
