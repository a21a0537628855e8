//! Keeps a multipart body from piling up in memory.
//!
//! The parser reads ahead for as long as the connection has bytes, and looks for the end of a
//! part's header in all that it has read. The gauge counts what went into the parser and what came
//! out as contents of parts. Where too much is inside, the body pauses so that the parser works on
//! what it has; where nothing comes out of that either, the body ends with an error.

use axum::body::{Body, BodyDataStream};
use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};

/// What the parser may hold, bytes.
const WINDOW: usize = 256 << 10;
/// What one part's boundary and header may add to that for good, bytes.
const FRAMING_PER_PART: usize = 8 << 10;
/// Pauses in a row without anything out of the parser. It asks up to a few times for each thing
/// that it finds.
const MAX_PAUSES: u32 = 16;

#[derive(Default)]
struct Count {
    /// Bytes that went in and did not come out as contents.
    inside: usize,
    parts: usize,
    pauses: u32,
    overflowed: bool,
}

/// Counts of one multipart body.
#[derive(Default)]
pub struct Gauge(Mutex<Count>);

impl Gauge {
    fn count(&self) -> MutexGuard<'_, Count> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The body, counted and bounded.
    pub fn watch(self: Arc<Self>, body: Body) -> Body {
        Body::from_stream(Watched { body: body.into_data_stream(), gauge: self })
    }

    /// The parser found a part.
    pub fn part(&self) {
        let mut count = self.count();
        count.parts += 1;
        count.pauses = 0;
    }

    /// The parser gave that many bytes of a part's contents.
    pub fn content(&self, bytes: usize) {
        let mut count = self.count();
        count.inside = count.inside.saturating_sub(bytes);
        count.pauses = 0;
    }

    /// Whether the body was ended for its size.
    pub fn overflowed(&self) -> bool {
        self.count().overflowed
    }
}

struct Watched {
    body: BodyDataStream,
    gauge: Arc<Gauge>,
}

impl Stream for Watched {
    type Item = Result<Bytes, axum::Error>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        {
            let mut count = self.gauge.count();
            if count.inside > WINDOW + FRAMING_PER_PART * count.parts {
                count.pauses += 1;
                if count.pauses > MAX_PAUSES {
                    count.overflowed = true;
                    return Poll::Ready(Some(Err(axum::Error::new("the parts do not end"))));
                }
                context.waker().wake_by_ref();
                return Poll::Pending;
            }
        }
        let next = self.body.poll_next_unpin(context);
        if let Poll::Ready(Some(Ok(bytes))) = &next {
            self.gauge.count().inside += bytes.len();
        }
        next
    }
}
