//! `/v1/jobs/{id}/events`: server-sent events, replayed from the store and then live.

use super::app::App;
use super::documented;
use super::jobs::find;
use super::problem::Problem;
use super::read::{JobId, Query};
use crate::access::Caller;
use crate::api::events::{Event, EventData};
use crate::api::jobs::{Picture, PictureFormat};
use crate::events::Listener;
use crate::key_watch::KeyEnd;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::IntoResponse;
use axum::response::sse::{self, KeepAlive, Sse};
use base64::Engine;
use futures_util::Stream;
use serde::Deserialize;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::time::Duration;
use tokio::sync::OwnedSemaphorePermit;
use utoipa::IntoParams;
use uuid::Uuid;

/// Events read at once.
const BATCH: u32 = 256;
/// Largest picture that an event carries, bytes.
const MAX_INLINE_BYTES: u64 = 1 << 20;
/// How long an event waits for its share of them, before it goes without its picture.
const INLINE_PATIENCE: Duration = Duration::from_secs(2);
/// How long to trust that no news is no news.
const RECHECK: Duration = Duration::from_secs(10);

/// Where to begin and what to carry.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct EventsQuery {
    /// Begin after this event; `Last-Event-ID` means the same and wins.
    #[param(minimum = 0, maximum = 9_223_372_036_854_775_807_u64)]
    after: Option<u64>,
    /// Carry snapshots and the final picture in the events themselves, in this format: in
    /// `base64`, which is left out of pictures above 1 MiB (1,048,576 bytes) and while too many
    /// others are on their way. Their `url` always leads to them.
    #[param(inline)]
    inline: Option<PictureFormat>,
}

/// Follow a job.
///
/// Events: `state`, `progress`, `snapshot`, `notice`, and at last one of `succeeded`, `failed`,
/// `cancelled`, after which the stream ends. Each carries an id that only grows within the job;
/// reconnecting with `Last-Event-ID` continues after it without gap or repetition. The `data` of
/// each is a StateEvent, ProgressEvent, SnapshotEvent or NoticeEvent. Clients do well to ignore
/// events of names that they do not know.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/events", tag = "jobs",
    params(
        documented::OfJob,
        EventsQuery,
        ("Last-Event-ID" = Option<u64>, Header, maximum = 9_223_372_036_854_775_807_u64, description = "The last event that was seen."),
    ),
    responses(
        (
            status = 200, description = "The stream.", body = String, content_type = "text/event-stream",
            example = "id: 1\nevent: state\ndata: {\"state\":\"queued\",\"attempts\":0}\n\n"
        ),
        documented::Named,
    )
)]
pub async fn stream_events(
    State(app): State<App>,
    caller: Caller,
    JobId(id): JobId,
    Query(query): Query<EventsQuery>,
    headers: HeaderMap,
) -> Result<impl IntoResponse, Problem> {
    let last_seen = match headers.get("last-event-id") {
        // A browser that has seen no id yet sends an empty one.
        Some(value) if !value.is_empty() => {
            let number = value.to_str().ok().and_then(|text| text.trim().parse::<u64>().ok());
            Some(number.ok_or_else(|| Problem::unreadable("Last-Event-ID must be a number"))?)
        }
        _ => None,
    };
    let follower = Follower {
        listener: app.shared.bell.listen(id),
        key_end: app.key_watch.of(&caller),
        after: last_seen.or(query.after).unwrap_or(0),
        inline: query.inline,
        waiting: VecDeque::new(),
        share: None,
        has_waited: false,
        ended: false,
        job: id,
        _count: app.shared.metrics.count_stream(),
        app: app.clone(),
    };
    find(&app, id).await?;
    let stream = futures_util::stream::unfold(follower, |mut follower| async move {
        follower.next().await.map(|event| (Ok::<_, Infallible>(event), follower))
    });
    // A proxy in between is to pass events on as they come.
    let unbuffered = [("x-accel-buffering", "no")];
    let stream = Sse::new(Box::pin(stream) as std::pin::Pin<Box<dyn Stream<Item = _> + Send>>)
        .keep_alive(KeepAlive::new().interval(Duration::from_secs(15)));
    Ok((unbuffered, stream))
}

/// One client's position in a job's events.
struct Follower {
    app: App,
    job: Uuid,
    after: u64,
    inline: Option<PictureFormat>,
    listener: Listener,
    key_end: KeyEnd,
    waiting: VecDeque<Event>,
    /// What the event that was written last takes of the bytes on their way. The next one is asked
    /// for once the connection has taken that.
    share: Option<OwnedSemaphorePermit>,
    /// Whether it has waited for room in vain.
    has_waited: bool,
    ended: bool,
    _count: crate::metrics::OpenCount,
}

impl Follower {
    /// The next event; `None` after the terminal one, on shutdown, when the caller's key ends, and
    /// where the store fails (the client reconnects and continues where it was).
    async fn next(&mut self) -> Option<sse::Event> {
        self.share = None;
        loop {
            if self.key_end.has_come() {
                return None;
            }
            if let Some(event) = self.waiting.pop_front() {
                self.after = event.seq;
                self.ended = event.data.is_terminal();
                return Some(self.write(event).await);
            }
            // An extended job has events behind its first end.
            if self.ended && self.nothing_will_come().await {
                return None;
            }
            let events = self.app.shared.store.events(self.job, self.after, BATCH).await;
            match events {
                Ok(events) => self.waiting.extend(events),
                Err(error) => {
                    tracing::error!(%error, job = %self.job, "cannot read events");
                    return None;
                }
            }
            if self.waiting.is_empty() {
                if self.nothing_will_come().await {
                    return None;
                }
                tokio::select! {
                    () = self.listener.news() => {}
                    () = tokio::time::sleep(RECHECK) => {}
                    () = self.key_end.comes() => return None,
                    () = self.app.shared.shutdown.cancelled() => return None,
                }
            }
        }
    }

    /// Whether the job has ended, or is gone, and all its events lie behind `after`.
    async fn nothing_will_come(&self) -> bool {
        let job = self.app.shared.store.job(self.job).await;
        let over = matches!(&job, Ok(None)) || matches!(&job, Ok(Some(j)) if j.state.is_terminal());
        // The end may have come between reading the events and reading the job.
        over && matches!(self.app.shared.store.events(self.job, self.after, 1).await, Ok(e) if e.is_empty())
    }

    async fn write(&mut self, mut event: Event) -> sse::Event {
        if let Some(format) = self.inline {
            self.embed(&mut event.data, format).await;
        }
        let frame = sse::Event::default().id(event.seq.to_string()).event(event.data.kind());
        frame.json_data(&event.data).unwrap_or_else(|error| {
            tracing::error!(%error, "an event does not serialise");
            sse::Event::default().comment("an event was lost")
        })
    }

    /// Room for so many bytes, where there is some. Waits for it once: a stream that found none in
    /// time goes on without pictures until there is some, rather than wait at every event.
    async fn room(&mut self, bytes: u32) -> Option<OwnedSemaphorePermit> {
        let room = self.app.inline_room.clone();
        if self.has_waited {
            let share = room.try_acquire_many_owned(bytes).ok();
            self.has_waited = share.is_none();
            return share;
        }
        let share = tokio::select! {
            share = room.acquire_many_owned(bytes) => share.ok(),
            () = tokio::time::sleep(INLINE_PATIENCE) => None,
            () = self.key_end.comes() => None,
            () = self.app.shared.shutdown.cancelled() => None,
        };
        self.has_waited = share.is_none();
        share
    }

    /// Puts the picture itself into the event, where it exists in that format, is small enough and
    /// there is room for it.
    async fn embed(&mut self, data: &mut EventData, format: PictureFormat) {
        let pictures = match data {
            EventData::Snapshot(event) => &mut event.pictures,
            EventData::State(event) => &mut event.pictures,
            EventData::Progress(_) | EventData::Notice(_) => return,
        };
        let is_fit =
            |picture: &&mut Picture| picture.format == format && picture.size <= MAX_INLINE_BYTES;
        let Some(picture) = pictures.iter_mut().find(is_fit) else { return };
        // As text, a third longer; and once more, while it is put together.
        let bytes = u32::try_from(3 * picture.size).unwrap_or(u32::MAX);
        let Some(share) = self.room(bytes).await else { return };
        match self.app.shared.artifacts.picture(self.job, &picture.sha256, format).await {
            Ok(bytes) => {
                let engine = base64::engine::general_purpose::STANDARD;
                picture.base64 = Some(engine.encode(bytes));
                self.share = Some(share);
            }
            Err(error) => tracing::warn!(%error, job = %self.job, "no picture to embed"),
        }
    }
}
